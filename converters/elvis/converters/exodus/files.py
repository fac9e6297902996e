"""Exodus II files as arrays, in either container of netCDF, and their types of elements.

Layout and numbering: Schoof and Yarberry, EXODUS II: A Finite Element Data Model, 1994, and its later releases.
"""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from elvis.converters.shared.hdf5 import attribute, holds, reading, rows, text
from elvis.converters.shared.unit import UNIT
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.files.plain import leading
from elvis.core.shapes import Shape

_CLASSIC = (b"CDF\x01", b"CDF\x02", b"CDF\x05")

#: exceptions of the library for damaged files; types of numbers pass through the parser of Python
_FAULTS = (ValueError, TypeError, LookupError, OSError, ArithmeticError, AttributeError, AssertionError, SyntaxError)

#: beginnings of the names of types
_NAMES = {
    "BAR": Shape.SEGMENT,
    "BEAM": Shape.SEGMENT,
    "TRUSS": Shape.SEGMENT,
    "EDGE": Shape.SEGMENT,
    "TET": Shape.TETRAHEDRON,
    "HEX": Shape.HEXAHEDRON,
    "WED": Shape.PRISM,
    "PENTA": Shape.PRISM,
    "PYR": Shape.PYRAMID,
    "QUAD": Shape.QUADRILATERAL,
    "SHELL": Shape.QUADRILATERAL,
    "TRI": Shape.TRIANGLE,
}

_TRIANGLE = [(0, 1), (1, 2), (2, 0)]
_TETRAHEDRON = [*_TRIANGLE, (0, 3), (1, 3), (2, 3)]
_SQUARE = [(0, 1), (1, 2), (2, 3), (3, 0)]
_BLOCK = [*_SQUARE, (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6), (6, 7), (7, 4)]
_PYRAMID = [*_SQUARE, (0, 4), (1, 4), (2, 4), (3, 4)]
_WEDGE = [*_TRIANGLE, (0, 3), (1, 4), (2, 5), (3, 4), (4, 5), (5, 3)]

_FACES_OF_PYRAMID = [(0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (0, 3, 4)]
_FACES_OF_TETRAHEDRON = [(0, 1, 2), (1, 2, 3), (0, 2, 3), (0, 1, 3)]

#: nodes beyond the corners, each the mean of these corners, by shape and number of nodes; the centroid of a pyramid is
#: a quarter of its height above the base
_MIDDLES: Mapping[tuple[Shape, int], list[tuple[int, ...]]] = {
    (Shape.SEGMENT, 2): [],
    (Shape.SEGMENT, 3): [(0, 1)],
    (Shape.TRIANGLE, 3): [],
    (Shape.TRIANGLE, 6): [*_TRIANGLE],
    (Shape.TRIANGLE, 7): [*_TRIANGLE, (0, 1, 2)],
    (Shape.QUADRILATERAL, 4): [],
    (Shape.QUADRILATERAL, 8): [*_SQUARE],
    (Shape.QUADRILATERAL, 9): [*_SQUARE, (0, 1, 2, 3)],
    (Shape.TETRAHEDRON, 4): [],
    (Shape.TETRAHEDRON, 10): [*_TETRAHEDRON],
    (Shape.TETRAHEDRON, 14): [*_TETRAHEDRON, *_FACES_OF_TETRAHEDRON],
    (Shape.TETRAHEDRON, 15): [*_TETRAHEDRON, *_FACES_OF_TETRAHEDRON, tuple(range(4))],
    (Shape.PYRAMID, 5): [],
    (Shape.PYRAMID, 13): [*_PYRAMID],
    (Shape.PYRAMID, 14): [*_PYRAMID, (0, 1, 2, 3)],
    (Shape.PYRAMID, 18): [*_PYRAMID, *_FACES_OF_PYRAMID],
    (Shape.PYRAMID, 19): [*_PYRAMID, *_FACES_OF_PYRAMID, (*range(4), *range(4), *range(4), 4, 4, 4, 4)],
    (Shape.PRISM, 6): [],
    (Shape.PRISM, 15): [*_WEDGE],
    (Shape.PRISM, 18): [*_WEDGE, (0, 1, 4, 3), (1, 2, 5, 4), (0, 2, 5, 3)],
    (Shape.PRISM, 20): [*_WEDGE, (0, 1, 2), (3, 4, 5), (1, 2, 5, 4), (0, 2, 5, 3), (0, 1, 4, 3)],
    (Shape.PRISM, 21): [*_WEDGE, tuple(range(6)), (0, 1, 2), (3, 4, 5), (1, 2, 5, 4), (0, 2, 5, 3), (0, 1, 4, 3)],
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
    Shape.SEGMENT: [(0,), (1,)],
    Shape.TRIANGLE: [*_TRIANGLE],
    Shape.QUADRILATERAL: [*_SQUARE],
    Shape.TETRAHEDRON: [(0, 1, 3), (1, 2, 3), (0, 2, 3), (0, 1, 2)],
    Shape.PYRAMID: [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (0, 1, 2, 3)],
    Shape.PRISM: [(0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2), (0, 1, 2), (3, 4, 5)],
    Shape.HEXAHEDRON: [(0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (0, 1, 2, 3), (4, 5, 6, 7)],
}


def shape_of(name: str, nodes: int, path: Path) -> Shape | None:
    """The shape of a type of elements; None for points and for lines of other nodes, such as beams with a direction.

    Raises FormatError for unsupported types.
    """
    kind = re.sub(r"[^A-Z].*", "", name.upper())
    if kind.startswith(("SPHERE", "CIRCLE", "NULL")):
        return None
    shape = next((shape for start, shape in _NAMES.items() if kind.startswith(start)), None)
    if kind.startswith("SHELL") and nodes in (3, 6, 7):
        shape = Shape.TRIANGLE
    if shape is None:
        labels = ", ".join(dict.fromkeys(known.label.lower() for known, _ in _MIDDLES))
        raise FormatError(f"expected elements of the shapes {labels}, found the type {name}", file=path)
    if (shape, nodes) not in _MIDDLES:
        if shape is Shape.SEGMENT:
            return None
        *first, last = (str(count) for known, count in _MIDDLES if known is shape)
        expected = f"a {shape.label.lower()} of {', '.join(first)} or {last} nodes"
        raise FormatError(f"expected {expected}, found {name} of {nodes}", file=path)
    return shape


def nodes_of(shape: Shape, count: int) -> Floats:
    """(count, d) reference coordinates, in ours, of the nodes in the file's order."""
    corners = np.empty_like(shape.vertices)
    corners[UNIT[shape].corners] = shape.vertices
    return np.stack([*corners, *(corners[list(own)].mean(axis=0) for own in _MIDDLES[shape, count])])


def is_exodus(path: Path) -> bool:
    """Whether a file is one of netCDF that holds a mesh of this kind."""
    head = leading(path, 1 << 14)
    if head.startswith(_CLASSIC):
        return b"num_el_blk" in head
    return holds(path, "num_el_blk", "num_nodes")


class Variables:
    """The variables of a file, by name: read on demand, in the order of bytes of this machine."""

    def __init__(self, path: Path) -> None:
        self.path = path
        is_classic = leading(path, 4) in _CLASSIC
        self._container: _Classic | _Hdf5 = _Classic(path) if is_classic else _Hdf5(path)

    def __contains__(self, name: str) -> bool:
        return name in self._container.types

    def __getitem__(self, name: str) -> Any:
        return self.at(name)

    def size(self, dimension: str) -> int:
        """The length of a dimension; 0 if the file doesn't define it."""
        return self._container.sizes.get(dimension, 0)

    def numbers(self, dimension: str) -> range:
        """The numbers, from 1, of the blocks or sets that a dimension counts.

        Raises FormatError for more than can be here.
        """
        count, most = self.size(dimension), self.path.stat().st_size
        if count > most:
            expected = f"at most {most}, from the size of the file"
            raise FormatError(f"expected {expected}, found {count}", file=self.path, place=dimension)
        return range(1, count + 1)

    def at(self, name: str, *index: int) -> Any:
        """A variable, or a part of it at first indices; raises FormatError if it is missing or can't be read."""
        if name not in self:
            raise FormatError(f"expected a variable {name}, found none", file=self.path)
        found = np.asarray(self._container.array(name, index))
        return found.astype(found.dtype.newbyteorder("="))

    def element_type(self, name: str) -> str:
        """The attribute elem_type of a table of elements."""
        return self._container.types[name]

    def texts(self, name: str) -> list[str]:
        """An array of characters, as texts; empty if the variable does not exist."""
        if name not in self:
            return []
        rows = np.atleast_2d(self[name])
        if rows.dtype.kind != "S" or rows.ndim != 2:
            raise FormatError(f"expected texts, found {rows.dtype} of shape {rows.shape}", file=self.path, place=name)
        # some writers leave rubbish behind the zero that ends a name
        return [row.tobytes().split(b"\0")[0].decode("utf-8", "replace").strip() for row in rows]

    def ints(self, name: str, dimension: int = 1) -> Ints:
        """Whole numbers in an array of this many dimensions."""
        found = self[name]
        if found.dtype.kind not in "iu" or found.ndim != dimension:
            what = f"{found.dtype} of shape {found.shape}"
            raise FormatError(f"expected whole numbers, found {what}", file=self.path, place=name)
        return np.asarray(found, np.int64)

    def floats(self, name: str, *index: int, dimension: int = 1) -> Floats:
        """Numbers in an array of this many dimensions, of their own precision."""
        found = self.at(name, *index)
        if found.dtype.kind not in "iuf" or found.ndim != dimension:
            what = f"{found.dtype} of shape {found.shape}"
            raise FormatError(f"expected numbers, found {what}", file=self.path, place=name)
        return np.asarray(found)


class _Classic:
    """The classic container.

    types  by name of a variable: its attribute elem_type, empty if it has none
    sizes  of dimensions by name
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        with self._guard():
            self._file = _mapped(path)
            found = {name: getattr(own, "elem_type", b"") for name, own in self._file.variables.items()}
            # the length of the unlimited dimension is None
            self.sizes = {name: int(size or 0) for name, size in self._file.dimensions.items()}
        self.types = {
            name: own.decode("ascii", "replace") if isinstance(own, bytes) else "" for name, own in found.items()
        }

    def array(self, name: str, index: tuple[int, ...]) -> Any:
        """A part of a variable, copied out of the file."""
        with self._guard():
            return np.array(self._file.variables[name][index or ...])

    @contextmanager
    def _guard(self) -> Iterator[None]:
        try:
            yield
        except _FAULTS as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise FormatError(f"expected a complete netCDF file, found: {reason}", file=self._path) from error


def _mapped(path: Path) -> Any:
    """A netCDF file in the classic container, mapped; no part of it is used longer than the file is."""
    from scipy.io import netcdf_file

    class Mapped(netcdf_file):  # type: ignore[misc]
        def close(self) -> None:
            # arrays that are freed together with the file cause a warning that they are still in use
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)
                super().close()

        def __del__(self) -> None:
            # at the end of the program the module of warnings may be gone
            if not sys.is_finalizing():
                self.close()

    return Mapped(_CheckedFile(path), "r", mmap=True)


class _CheckedFile:
    """A file from which reads are limited to its actual size, independent of its header."""

    def __init__(self, path: Path) -> None:
        self._file, self._size = path.open("rb"), path.stat().st_size

    def read(self, count: int = -1) -> bytes:
        left = max(0, self._size - self._file.tell())
        return self._file.read(left if count < 0 else min(count, left))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def __del__(self) -> None:
        self._file.close()


class _Hdf5:
    """HDF5; ``types`` and ``sizes`` as in the classic container.

    A dimension is a dataset of its name, and as long as the shape of that.
    """

    def __init__(self, path: Path) -> None:
        import h5py  # type: ignore[import-untyped]

        self._path = path
        self.types: dict[str, str] = {}
        self.sizes: dict[str, int] = {}
        with reading(path) as file:
            for name in file:
                own = file.get(name, getlink=True)
                found = file[name] if isinstance(own, h5py.HardLink) else None
                # the library opens the files of a virtual dataset to determine its shape
                if isinstance(found, h5py.Dataset) and not found.is_virtual:
                    attributes, shape = found.attrs, found.shape
                    self.types[name] = text(attribute(found, "elem_type")) if "elem_type" in attributes else ""
                    if "CLASS" in attributes and shape:
                        self.sizes[name] = int(shape[0])

    def array(self, name: str, index: tuple[int, ...]) -> Any:
        """A part of a variable."""
        with reading(self._path) as file:
            return rows(file, name, index)
