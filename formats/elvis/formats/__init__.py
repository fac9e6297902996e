"""The native format: ``write(dataset, "copy.xml")``; `elvis.formats.reading` reads it.

Programs use ``import elvis``.  Its other names are found here too, for scripts that were written before it had them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from elvis.core.errors import FormatError
    from elvis.formats.writing import write

__all__ = ["FormatError", "write"]


def __getattr__(name: str) -> object:
    if name.startswith("__"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("elvis"), name)


def __dir__() -> list[str]:
    return __all__
