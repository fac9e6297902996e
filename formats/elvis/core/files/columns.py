"""Columns of numbers and words in files: text with every digit, NumPy's own archive, or Parquet by pandas."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import ZipFile, ZipInfo

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.errors import ElvisError
from elvis.core.base.needing import require_module
from elvis.core.base.terminal import visible
from elvis.core.files.output import replacing

Columns = Mapping[str, NDArray[np.generic]]

_ROWS_AT_ONCE = 4096
_PARQUET = ".parquet"
#: of cells, by the kind of their column; others are whole numbers
_FORMATS = {"f": "%.17g", "U": "%s"}


def check_suffix(path: str | Path) -> None:
    """Raise ElvisError if the suffix names no format that is written, or a package is missing that writes it."""
    suffix = Path(path).suffix
    if suffix.lower() not in (".csv", ".npz", _PARQUET):
        raise ElvisError(f"{path}: expected a name that ends in .csv, .npz or .parquet, found {suffix or 'no suffix'}")
    if suffix.lower() == _PARQUET:
        require_module("pandas", "a Parquet table", "notebook")
        require_module("pyarrow", "a Parquet table")


def write_columns(path: str | Path, columns: Columns) -> None:
    """Write columns of equal length as ``.csv``, ``.npz`` or ``.parquet``, by the suffix; raises as `check_suffix`."""
    check_suffix(path)
    suffix = Path(path).suffix.lower()
    with replacing(path) as temporary, temporary.open("wb") as file:
        if suffix == ".npz":
            _write_npz(file, columns)
        elif suffix == _PARQUET:
            table = require_module("pandas", "a Parquet table", "notebook").DataFrame(dict(columns))
            table.to_parquet(file, engine="pyarrow", index=False)
        else:
            file.writelines(text.encode() for text in csv_lines(columns))


def _write_npz(file: BinaryIO, columns: Columns) -> None:
    """An archive for ``numpy.load``; unlike ``numpy.savez``, every name is allowed and equal data give equal bytes."""
    with ZipFile(file, "w") as archive:
        for name, array in columns.items():
            with archive.open(ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.ascontiguousarray(array), allow_pickle=False)


def csv_lines(columns: Columns) -> Iterator[str]:
    """The text of the table, many lines at a time: a header, integers plain, floats with 17 significant digits.

    Names and words that hold a comma, a quote or a line end are quoted, and control characters become question marks,
    since a terminal may show the text; NaN is written as ``nan``.
    """
    yield ",".join(map(_quote, columns)) + "\n"
    line = ",".join(_FORMATS.get(array.dtype.kind, "%d") for array in columns.values()) + "\n"
    rows = len(next(iter(columns.values())))
    for first in range(0, rows, _ROWS_AT_ONCE):
        block = [_cells(array[first : first + _ROWS_AT_ONCE]) for array in columns.values()]
        yield "".join(line % row for row in zip(*block, strict=True))


def _cells(array: NDArray[np.generic]) -> list[Any]:
    return [_quote(word) for word in array.tolist()] if array.dtype.kind == "U" else array.tolist()


def _quote(name: str) -> str:
    shown = visible(name)
    doubled = shown.replace('"', '""')
    return f'"{doubled}"' if any(c in shown for c in ',"\n') else shown
