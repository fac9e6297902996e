"""Polygonal lines and triangles with values at their points as VTK's PolyData files (.vtp), which ParaView opens.

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

from elvis.core.base.arrays import Floats, Ints
from elvis.core.files.columns import Columns
from elvis.core.files.output import replacing

_TYPES = {"f": "Float64", "i": "Int64"}
_ORDER = {"little": "LittleEndian", "big": "BigEndian"}


def write_polylines(path: str | Path, points: Floats, offsets: Ints, at_points: Columns, at_lines: Columns) -> None:
    """Write lines through points (m, 3); line i has the points offsets[i] to offsets[i+1].

    at_points, at_lines  arrays (m,), (m, 3) and (n,) by name, of floats or whole numbers
    """
    cells = {"connectivity": np.arange(len(points)), "offsets": offsets[1:]}
    _write(path, points, "Lines", cells, at_points, at_lines)


def write_triangles(path: str | Path, points: Floats, triangles: Ints, at_points: Columns) -> None:
    """Write triangles (m, 3) of points (n, 3).

    at_points  arrays (n,) or (n, 3) by name, of floats or whole numbers
    """
    cells = {"connectivity": triangles.reshape(-1), "offsets": 3 * np.arange(1, len(triangles) + 1)}
    _write(path, points, "Polys", cells, at_points, {})


def _write(path: str | Path, points: Floats, kind: str, cells: Columns, at_points: Columns, at_cells: Columns) -> None:
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.writelines(f"{line}\n" for line in _lines(points, kind, cells, at_points, at_cells))


def _lines(points: Floats, kind: str, cells: Columns, at_points: Columns, at_cells: Columns) -> Iterator[str]:
    yield '<?xml version="1.0"?>'
    order = _ORDER[sys.byteorder]
    yield f'<VTKFile type="PolyData" version="1.0" byte_order="{order}" header_type="UInt64">'
    yield f'<PolyData><Piece NumberOfPoints="{len(points)}" NumberOfVerts="0" NumberOf{kind}="{len(cells["offsets"])}">'
    yield from _section("Points", {"points": points})
    yield from _section(kind, cells)
    yield from _section("PointData", at_points)
    yield from _section("CellData", at_cells)
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
