"""Packages that only comparisons need; what is missing is named with the extra that brings it."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from elvis.core.errors import ElvisError


class MissingExtraError(ElvisError):
    """A package of the extra ``compare`` is not installed."""


def needed(module: str, extra: str = "compare") -> Any:
    """The module; MissingExtraError with the command that installs it."""
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise MissingExtraError(
            f"comparisons need the package {package}: install it with pip install 'elvis-viz[{extra}]' ({error})"
        ) from error
