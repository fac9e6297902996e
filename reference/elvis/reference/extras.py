"""Packages that only comparisons need."""

from __future__ import annotations

from typing import Any

from elvis.core.base.needing import require_module


def comparison_module(module: str, extra: str = "compare") -> Any:
    """The module; raises MissingPackageError with the command that installs the extra which brings it."""
    return require_module(module, "a comparison", extra)
