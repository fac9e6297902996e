"""Reference values in a file next to the data: NAME.elvis.toml for NAME.xml, NAME.fld, NAME_3.chk."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from elvis.core.base.errors import FormatError
from elvis.core.files.plain import content
from elvis.core.quantities.reference_values import checked_reference

SUFFIX = ".elvis.toml"
_TABLE = "reference"
#: bytes of such a file at most
_MOST = 1 << 16


def reference_beside(paths: Sequence[Path]) -> dict[str, float]:
    """The values in the files next to data; FormatError for one that can't be read, ElvisError for wrong values.

    The file next to the first data file overrides the others.
    """
    found: dict[str, float] = {}
    for path in _files_beside(paths):
        table = _table(path)
        if table.keys() - {_TABLE} or not isinstance(table.get(_TABLE), dict):
            raise FormatError(f"expected only the table [{_TABLE}], found {', '.join(table) or 'nothing'}", file=path)
        found = {**checked_reference(table[_TABLE], str(path)), **found}
    return found


def _files_beside(paths: Sequence[Path]) -> list[Path]:
    """The files that exist, each once."""
    names = [path.with_name(path.name.partition(".")[0] + SUFFIX) for path in paths if path.name]
    return [path for path in dict.fromkeys(names) if path.is_file()]


def _table(path: Path) -> dict[str, Any]:
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib
    data = content(path)
    if len(data) > _MOST:
        raise FormatError(f"expected {_MOST} bytes at most, found {len(data)}", file=path)
    try:
        return tomllib.loads(data.decode("utf-8"))
    except ValueError as error:
        raise FormatError(f"expected TOML: {error}", file=path) from error
