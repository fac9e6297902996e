"""Polygonal lines with values at their points as VTK's PolyData files (.vtp), which ParaView opens.

The XML form of VTK's file formats (https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html), version
1.0: arrays in base64, each after its length in bytes.
"""

from __future__ import annotations

import base64
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from elvis.core.arrays import Floats, Ints
from elvis.core.files.columns import Columns
from elvis.core.files.output import replacing

_TYPES = {"f": "Float64", "i": "Int64"}
_ORDER = {"little": "LittleEndian", "big": "BigEndian"}


def write_polylines(path: str | Path, points: Floats, offsets: Ints, at_points: Columns, at_lines: Columns) -> None:
    """Write lines through points (m, 3); line i has the points offsets[i] to offsets[i+1].

    at_points, at_lines  arrays (m,), (m, 3) and (n,) by name, of floats or whole numbers
    """
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.writelines(f"{line}\n" for line in _lines(points, offsets, at_points, at_lines))


def _lines(points: Floats, offsets: Ints, at_points: Columns, at_lines: Columns) -> Iterator[str]:
    yield '<?xml version="1.0"?>'
    order = _ORDER[sys.byteorder]
    yield f'<VTKFile type="PolyData" version="1.0" byte_order="{order}" header_type="UInt64">'
    yield f'<PolyData><Piece NumberOfPoints="{len(points)}" NumberOfVerts="0" NumberOfLines="{len(offsets) - 1}">'
    yield from _section("Points", {"points": points})
    yield from _section("Lines", {"connectivity": np.arange(len(points)), "offsets": offsets[1:]})
    yield from _section("PointData", at_points)
    yield from _section("CellData", at_lines)
    yield "</Piece></PolyData></VTKFile>"


def _section(name: str, arrays: Mapping[str, NDArray[np.generic]]) -> Iterator[str]:
    from xml.sax.saxutils import quoteattr

    yield f"<{name}>"
    for title, array in arrays.items():
        own = np.ascontiguousarray(array, np.float64 if array.dtype.kind == "f" else np.int64)
        components = own.shape[1] if own.ndim > 1 else 1
        facts = f"Name={quoteattr(title)} NumberOfComponents={quoteattr(str(components))}"
        yield f'<DataArray type="{_TYPES[own.dtype.kind]}" {facts} format="binary">'
        length = np.array([own.nbytes], np.uint64).tobytes()
        yield base64.b64encode(length + own.tobytes()).decode("ascii")
        yield "</DataArray>"
    yield f"</{name}>"
