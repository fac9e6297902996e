"""The native format: ``read("wing.xml", "wing.fld")`` and ``write(dataset, "copy.xml")``.

Programs use ``import elvis``, whose ``read`` takes every format.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from elvis.core.lazy import lazy_names

if TYPE_CHECKING:
    from elvis.core.errors import FormatError
    from elvis.formats.reading import read
    from elvis.formats.writing import write

__all__ = ["FormatError", "read", "write"]

__getattr__ = lazy_names(
    __name__,
    {
        "elvis.core.errors": ("FormatError",),
        "elvis.formats.reading": ("read",),
        "elvis.formats.writing": ("write",),
    },
)


def __dir__() -> list[str]:
    return __all__
