"""Libraries that only some uses need, imported when these come."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from elvis.core.errors import ElvisError


class MissingPackageError(ElvisError):
    """A package that only some uses need is not installed."""


def require_module(module: str, what: str, extra: str = "") -> Any:
    """The module; MissingPackageError that tells what needs it, and how it is installed, where it is missing.

    extra  of ElVis that brings it, where it has one
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        command = f"pip install 'elvis-viz[{extra}]'" if extra else f"pip install {package}"
        raise MissingPackageError(f"{what} needs {package}, which is not installed; {command} brings it") from error
