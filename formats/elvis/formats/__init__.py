"""The native format: ``write(dataset, "copy.xml")``; `elvis.formats.reading` reads it.

Programs use ``import elvis``.  Its other names are found here too, for scripts that were written before it had them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from elvis.core.base.lazy import names_of_elvis

if TYPE_CHECKING:
    from elvis.core.base.errors import FormatError
    from elvis.formats.writing import write

__all__ = ["FormatError", "write"]


__getattr__ = names_of_elvis(__name__)


def __dir__() -> list[str]:
    return __all__
