"""Libraries that only some uses need, imported when these come."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from elvis.core.base.errors import ElvisError


class MissingPackageError(ElvisError):
    """A package that only some uses need is not installed."""


def require_module(module: str, what: str, extra: str = "") -> Any:
    """Import a module; if it is missing, raise MissingPackageError with its purpose and how to install it.

    extra  extra of ElVis that provides it, if any
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise _missing(module, what, extra) from error


def check_module(module: str, what: str, extra: str = "") -> None:
    """Check that a module of the top is there, as `require_module` does, without the time that importing it takes."""
    if not is_there(module):
        raise _missing(module, what, extra)


def is_there(module: str) -> bool:
    """Whether a module of the top can be imported, without doing so."""
    return sys.modules[module] is not None if module in sys.modules else find_spec(module) is not None


def _missing(module: str, what: str, extra: str) -> MissingPackageError:
    package = module.partition(".")[0]
    command = f"pip install 'elvis-viz[{extra}]'" if extra else f"pip install {package}"
    return MissingPackageError(f"{what} needs {package}, which is not installed; {command} installs it")
