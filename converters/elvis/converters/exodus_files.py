"""Exodus II files as arrays, in either container of netCDF, and what is known of their types of elements.

Layout and numbering: Schoof and Yarberry, EXODUS II: A Finite Element Data Model, 1994, and its later releases.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from elvis.converters.hdf5 import holds, opened
from elvis.formats.arrays import Floats, Ints
from elvis.formats.errors import FormatError
from elvis.formats.shapes import Shape

_CLASSIC = (b"CDF\x01", b"CDF\x02", b"CDF\x05")

#: beginnings of the names of types
_NAMES = {
    "TET": Shape.TETRAHEDRON,
    "HEX": Shape.HEXAHEDRON,
    "WED": Shape.PRISM,
    "PENTA": Shape.PRISM,
    "PYR": Shape.PYRAMID,
    "QUAD": Shape.QUADRILATERAL,
    "SHELL": Shape.QUADRILATERAL,
    "TRI": Shape.TRIANGLE,
}

#: the file's corner at each local vertex; wedges are given as two triangles
CORNERS = {Shape.PRISM: (0, 2, 5, 3, 1, 4)}

_TRIANGLE = [(0, 1), (1, 2), (2, 0)]
_SQUARE = [(0, 1), (1, 2), (2, 3), (3, 0)]
_BLOCK = [*_SQUARE, (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6), (6, 7), (7, 4)]
_WEDGE = [*_TRIANGLE, (0, 3), (1, 4), (2, 5), (3, 4), (4, 5), (5, 3)]

#: nodes beyond the corners, each the middle of these corners, by shape and number of nodes
_MIDDLES: Mapping[tuple[Shape, int], list[tuple[int, ...]]] = {
    (Shape.TRIANGLE, 3): [],
    (Shape.TRIANGLE, 6): [*_TRIANGLE],
    (Shape.QUADRILATERAL, 4): [],
    (Shape.QUADRILATERAL, 8): [*_SQUARE],
    (Shape.QUADRILATERAL, 9): [*_SQUARE, (0, 1, 2, 3)],
    (Shape.TETRAHEDRON, 4): [],
    (Shape.TETRAHEDRON, 10): [*_TRIANGLE, (0, 3), (1, 3), (2, 3)],
    (Shape.PYRAMID, 5): [],
    (Shape.PYRAMID, 13): [*_SQUARE, (0, 4), (1, 4), (2, 4), (3, 4)],
    (Shape.PYRAMID, 14): [*_SQUARE, (0, 4), (1, 4), (2, 4), (3, 4), (0, 1, 2, 3)],
    (Shape.PRISM, 6): [],
    (Shape.PRISM, 15): [*_WEDGE],
    (Shape.PRISM, 18): [*_WEDGE, (0, 1, 4, 3), (1, 2, 5, 4), (0, 2, 5, 3)],
    (Shape.HEXAHEDRON, 8): [],
    (Shape.HEXAHEDRON, 20): [*_BLOCK],
    (Shape.HEXAHEDRON, 27): [
        *_BLOCK,
        tuple(range(8)),
        (0, 1, 2, 3),
        (4, 5, 6, 7),
        (0, 3, 7, 4),
        (1, 2, 6, 5),
        (0, 1, 5, 4),
        (2, 3, 7, 6),
    ],
}

#: corners of the sides, in the order of their numbers
SIDES: Mapping[Shape, list[tuple[int, ...]]] = {
    Shape.TRIANGLE: [*_TRIANGLE],
    Shape.QUADRILATERAL: [*_SQUARE],
    Shape.TETRAHEDRON: [(0, 1, 3), (1, 2, 3), (0, 2, 3), (0, 1, 2)],
    Shape.PYRAMID: [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (0, 1, 2, 3)],
    Shape.PRISM: [(0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2), (0, 1, 2), (3, 4, 5)],
    Shape.HEXAHEDRON: [(0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (0, 1, 2, 3), (4, 5, 6, 7)],
}


def shape_of(name: str, nodes: int, path: Path) -> Shape | None:
    """The shape of a type of elements; None for lines and points, FormatError for what can't be converted."""
    kind = re.sub(r"[^A-Z].*", "", name.upper())
    if kind.startswith(("BAR", "BEAM", "TRUSS", "EDGE", "SPHERE", "CIRCLE", "NULL")):
        return None
    shape = next((shape for start, shape in _NAMES.items() if kind.startswith(start)), None)
    if kind.startswith("SHELL") and nodes in (3, 6):
        shape = Shape.TRIANGLE
    if shape is None or (shape, nodes) not in _MIDDLES:
        expected = ", ".join(f"{s.label.lower()}s of {n}" for s, n in _MIDDLES)
        raise FormatError(f"expected {expected} nodes, found {name} of {nodes}", file=path)
    return shape


def nodes_of(shape: Shape, count: int) -> Floats:
    """(count, d) reference coordinates, in ours, of the nodes in the file's order."""
    corners = np.empty_like(shape.vertices)
    corners[list(CORNERS.get(shape, range(len(corners))))] = shape.vertices
    return np.stack([*corners, *(corners[list(own)].mean(axis=0) for own in _MIDDLES[shape, count])])


def is_exodus(path: Path) -> bool:
    """Whether a file is one of netCDF that holds a mesh of this kind."""
    try:
        with path.open("rb") as file:
            head = file.read(1 << 14)
    except OSError:
        return False
    if head.startswith(_CLASSIC):
        return b"num_el_blk" in head
    return holds(path, "num_el_blk", "connect1")


class Variables:
    """The variables of a file, by name: arrays as they are stored, in the order of this machine."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open("rb") as file:
            is_classic = file.read(4) in _CLASSIC
        self._arrays, self._types = self._classic() if is_classic else self._hdf5()

    def __contains__(self, name: str) -> bool:
        return name in self._arrays

    def __getitem__(self, name: str) -> Any:
        if name not in self._arrays:
            raise FormatError(f"expected a variable {name}, found none", file=self.path)
        return self._arrays[name]

    def element_type(self, name: str) -> str:
        """The attribute elem_type of a table of elements."""
        return self._types.get(name, "")

    def texts(self, name: str) -> list[str]:
        """An array of characters, as texts; none where there is no such variable."""
        if name not in self:
            return []
        rows = np.atleast_2d(self[name])
        return [b"".join(row.tolist()).split(b"\0")[0].decode("utf-8", "replace").strip() for row in rows]

    def ints(self, name: str) -> Ints:
        """Whole numbers."""
        return np.asarray(self[name], np.int64)

    def _classic(self) -> tuple[dict[str, Any], dict[str, str]]:
        from scipy.io import netcdf_file

        try:
            with netcdf_file(str(self.path), "r", mmap=False) as file:
                arrays = {name: np.array(own[...]) for name, own in file.variables.items()}
                types = {name: getattr(own, "elem_type", b"").decode() for name, own in file.variables.items()}
        except (ValueError, TypeError, KeyError, IndexError, OSError, OverflowError) as error:
            raise FormatError(f"expected a whole netCDF file, found: {error}", file=self.path) from error
        return {name: own.astype(own.dtype.newbyteorder("=")) for name, own in arrays.items()}, types

    def _hdf5(self) -> tuple[dict[str, Any], dict[str, str]]:
        from elvis.converters.hdf5 import text

        with opened(self.path) as file:
            arrays = {name: np.asarray(own) for name, own in file.items()}
            types = {name: text(own.attrs["elem_type"]) for name, own in file.items() if "elem_type" in own.attrs}
        return arrays, types
