"""MFEM meshes and grid functions, read and evaluated by the library itself, in a process of its own.

Of spaces with one value a degree of freedom (H1, L2, of any basis) the functions are evaluated once a shape and order;
everything else (NURBS, H(div), H(curl), integral L2) is asked of the library element by element.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from elvis.converters.apart import Apart, LibraryError
from elvis.converters.mfem_files import check_mesh, is_field, is_mesh, named_attributes, rounding, values_after_header
from elvis.converters.mfem_pieces import Piece, is_stream, pieces
from elvis.converters.unit import UNIT
from elvis.core.arrays import Floats, Ints
from elvis.core.errors import FormatError
from elvis.core.shapes import Shape
from elvis.plugins.conversion import Boundary, Converter, Elements, PyramidSpace, SourceField
from elvis.plugins.nodal import component_names
from elvis.plugins.projection.vertices import clusters

#: by dimension and number of vertices
_SHAPES = {(shape.dimension, len(shape.vertices)): shape for shape in Shape}

#: orders that functions which are no polynomials get above their own
_RATIONAL, _VECTOR = 4, 2

#: reads and evaluates in another process
_WORKER = "elvis.converters.mfem_library:Library"

#: vertices of several parts that are as near as this, as a share of the largest coordinate, are one
_TOGETHER = 1e-10


class Mfem(Converter):
    """A mesh, with the grid functions that live on it."""

    format = "MFEM meshes and grid functions (.mesh, .gf, .saved; pieces of parallel ones)"
    keeps = "elements of all shapes and orders, H1 and L2 fields exactly; NURBS, H(div), H(curl) with a measured error"
    loses = "hanging nodes make fields discontinuous; complex functions and functions at quadrature points are refused"
    needs = ("mfem",)

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether every file is a mesh, a grid function, or a stream of both."""
        return bool(paths) and all(is_mesh(path) or is_field(path) or is_stream(path) for path in paths)

    def __init__(self, paths: Sequence[Path]) -> None:
        found = pieces(paths)
        texts = [source.text for piece in found for source in (piece.mesh, *piece.functions.values())]
        library = Apart(_WORKER, sum(map(len, texts)))
        with TemporaryDirectory() as folder:
            self._parts = [_Part(number, piece, Path(folder), library) for number, piece in enumerate(found)]
        self.is_conforming = all(part.is_conforming for part in self._parts)
        self.precision = max(part.precision for part in self._parts)
        vertices = _numbered([part.vertices for part in self._parts])
        self.blocks, self._orders, first = [], [], 0
        for part, numbers in zip(self._parts, vertices, strict=True):
            for block, orders in part.blocks(numbers, first):
                self.blocks.append(block)
                self._orders.append(orders)
            first += len(part.attributes)
        self._make_fields()
        self.boundaries = _joined(self._parts, vertices)

    def positions(self, block: Elements, points: Floats) -> Floats:
        """The library's map, at points in its own coordinates."""
        part, rows = block.key
        return np.asarray(part.positions(rows[block.rows], points))

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """The library's functions, at points in its own coordinates."""
        (part, rows), (function, component) = block.key, field.key
        return np.asarray(part.sample(rows[block.rows], function, component, points))

    def _make_fields(self) -> None:
        fields, part = [], self._parts[0]
        is_bent = any(each.geometry.highest > 1 for each in self._parts)
        is_bent |= any(len(b.shape.vertices) > b.shape.dimension + 1 for b in self.blocks)
        for number, (name, own) in enumerate(zip(part.names, part.functions, strict=True)):
            is_exact = own.is_nodal or (own.is_nurbs and not part.is_rational)
            raised = 0 if is_exact else _RATIONAL if own.is_nurbs else _VECTOR * is_bent
            orders = [int(order[number]) + raised for order in self._orders]
            for i, component in enumerate(component_names(name, own.count)):
                fields.append(SourceField(component, orders, own.is_continuous, is_exact, (number, i)))
        self.fields = fields


class _Asked:
    """A mesh in the library's process, by its number there; ``path`` is its file."""

    def __init__(self, library: Apart, number: int, path: Path) -> None:
        self._library, self._number, self._path = library, number, path

    def read(self, method: str, *given: Any, size: int, path: Path) -> dict[str, Any]:
        """What the library reads from a file of so many bytes; FormatError, naming ``path``, where it doesn't."""
        try:
            found: dict[str, Any] = self._library.ask(method, *given, str(path), size=size)
        except LibraryError as failure:
            raise _refused(failure, path) from failure
        return found

    def function(self, file: Path, size: int, path: Path) -> dict[str, Any]:
        """As `read`, a function on the mesh."""
        return self.read("function", self._number, str(file), size=size, path=path)

    def values(self, method: str, elements: Ints, points: Floats, *given: Any, width: int) -> Floats:
        """What the library finds at points in elements, ``width`` numbers for each element."""
        size = 8 * width * len(elements)
        try:
            return np.asarray(self._library.ask(method, self._number, elements, points, *given, size=size))
        except LibraryError as failure:
            raise _refused(failure, self._path) from failure


def _refused(failure: LibraryError, path: Path) -> FormatError:
    found = f"some on which it {'takes too long' if failure.is_out_of_time else 'crashes'}"
    return FormatError(f"expected data that MFEM reads, found {found}", file=path)


class _Part:
    """One mesh with the functions on it: those of ``number`` in the library's process.

    vertices    (n, d) places
    attributes  (m,) of the elements
    """

    def __init__(self, number: int, piece: Piece, folder: Path, library: Apart) -> None:
        self.path, text = piece.mesh.named, piece.mesh.text
        self._asked = _Asked(library, number, self.path)
        check_mesh(self.path, text)
        found = self._asked.read("mesh", str(piece.mesh.file(folder)), size=len(text), path=self.path)
        self.vertices, self.attributes = found["vertices"], found["attributes"]
        self.is_rational = found["has_weights"] and not _has_unit_weights(text)
        self.is_conforming = found["is_conforming"]
        self._dimension, self._faces = found["dimension"], found["faces"]
        self._corners = _Table(found["corners"])
        self.geometry = _Function(self._asked, 0, found["map"], self._corners.sizes)
        if found["has_nodes"] and "FiniteElementCollection:" in text:
            values_after_header(self.path, text, found["map"]["size"], is_last=False)
        self.names, self.functions = list(piece.functions), []
        for at, source in enumerate(piece.functions.values(), 1):
            own = self._asked.function(source.file(folder), len(source.text), source.named)
            values_after_header(source.named, source.text, own["size"], is_last=True)
            self.functions.append(_Function(self._asked, at, own, self._corners.sizes))
        self.precision = rounding(text)
        self._regions, self._borders = (named_attributes(text, f"{w}attribute_sets") for w in ("", "bdr_"))

    def blocks(self, numbers: Ints, first: int) -> Iterator[tuple[Elements, Ints]]:
        """Elements by shape, region and the orders of all functions on them, with these orders.

        numbers  (n,) of the vertices, over all parts
        first    number of the first element
        """
        attributes = self.attributes
        if not len(attributes):
            raise FormatError("expected elements, found none", file=self.path, place="elements")
        own = np.unique(attributes)
        regions = np.array([self._regions.get(int(n), f"attribute{n}") for n in own])
        if len(regions) == 1 and not self._regions:
            regions[:] = ""
        of = np.unique(regions, return_inverse=True)[1][np.searchsorted(own, attributes)]
        functions = [self.geometry, *self.functions]
        columns = [self._corners.sizes, of, *(each.orders for each in functions)]
        kinds, which = np.unique(np.stack(columns, axis=1), axis=0, return_inverse=True)
        for number, kind in enumerate(kinds):
            rows = np.flatnonzero(which.reshape(-1) == number)
            shape = _SHAPES[self._dimension, int(kind[0])]
            block = Elements(
                shape,
                len(rows),
                max(int(kind[2]), 1) + (_RATIONAL if self.is_rational else 0),
                vertices=numbers[self._corners.rows(rows)[:, UNIT[shape].corners]],
                frame=UNIT[shape].frame,
                ids=first + rows,
                region=str(np.unique(regions)[kind[1]]),
                pyramid=PyramidSpace.TENSOR,
                is_polynomial=not self.is_rational,
                key=(self, rows),
            )
            yield block, kind[3:]

    def borders(self, numbers: Ints) -> Iterator[tuple[str, tuple[int, ...]]]:
        """Name or number of the attribute, and vertices, of every face on the border; ``numbers`` of the vertices."""
        attributes, vertices = self._faces["attributes"].tolist(), self._faces["vertices"]
        for attribute, own in zip(attributes, np.split(vertices, self._faces["offsets"][:-1])[1:], strict=True):
            name = self._borders.get(attribute, f"boundary{attribute}")
            yield name, tuple(numbers[own].tolist())

    def positions(self, elements: Ints, points: Floats) -> Floats:
        """(n, n_points, d) where points of elements lie."""
        if self.geometry.is_nodal:
            return self.geometry.values(elements, points)
        return self._asked.values("positions", elements, points, width=len(points) * self.vertices.shape[1])

    def sample(self, elements: Ints, function: int, component: int, points: Floats) -> Floats:
        """(n, n_points) values of a component of a function."""
        own = self.functions[function]
        if own.is_nodal:
            return own.values(elements, points, component)
        width = len(points) * own.count
        return self._asked.values("values", elements, points, function + 1, component, width=width)


def _numbered(places: Sequence[Floats]) -> list[Ints]:
    """Numbers of the vertices of each part, places (n, d): those of several parts are one where they lie together."""
    if len(places) == 1:
        return [np.arange(len(places[0]))]
    stacked = np.concatenate([np.pad(own, ((0, 0), (0, 3 - own.shape[1]))) for own in places])
    which = clusters(stacked, _TOGETHER * float(np.abs(stacked).max(initial=0)))
    return np.split(which, np.cumsum([len(own) for own in places])[:-1])


def _joined(parts: Sequence[_Part], vertices: Sequence[Ints]) -> list[Boundary]:
    """Faces on the border by name; those that two parts have are inside."""
    found: dict[str, dict[int, list[tuple[int, ...]]]] = {}
    faces = [face for part, numbers in zip(parts, vertices, strict=True) for face in set(part.borders(numbers))]
    counts = Counter(tuple(sorted(face)) for _, face in faces)
    for name, face in sorted(faces):
        if counts[tuple(sorted(face))] == 1 or len(parts) == 1:
            found.setdefault(name, {}).setdefault(len(face), []).append(face)
    return [Boundary(n, vertices=[np.array(f, np.int64) for f in of.values()]) for n, of in sorted(found.items())]


class _Table:
    """The degrees of freedom of every element of a space, (n, k) for elements of one kind."""

    def __init__(self, plain: Mapping[str, Ints]) -> None:
        self.offsets, self.numbers = plain["offsets"], plain["numbers"]
        self.sizes = np.diff(self.offsets)

    def rows(self, elements: Ints) -> Ints:
        """(n, k) those of elements that have k each."""
        count = int(self.sizes[elements[0]]) if len(elements) else 0
        return np.asarray(self.numbers[self.offsets[elements][:, None] + np.arange(count)])


class _Function:
    """A function, ``which`` of those that the library has on a mesh, made of what that says of it.

    corners  (m,) of the elements, which tell their shapes
    """

    def __init__(self, asked: _Asked, which: int, plain: Mapping[str, Any], corners: Ints) -> None:
        self._asked, self._which, self._corners = asked, which, corners
        self.is_nurbs, self.is_nodal, self.is_continuous = (plain[f"is_{w}"] for w in ("nurbs", "nodal", "continuous"))
        self.count, self.highest, self.orders = plain["count"], plain["highest"], plain["orders"]
        self._tables: dict[Any, tuple[Floats, Floats]] = {}
        if self.is_nodal:
            self._table, self._data = _Table(plain["table"]), plain["data"]

    def values(self, elements: Ints, points: Floats, component: int | None = None) -> Floats:
        """(n, n_points) of a component of a nodal function on elements of one kind; for None (n, n_points, count)."""
        if not len(elements):
            return np.empty((0, len(points), self.count)[: 3 if component is None else 2])
        dofs, basis = self._table.rows(elements), self._basis(int(elements[0]), points)
        if component is None:
            return np.asarray(np.einsum("enc,pn->epc", self._data[dofs], basis))
        return np.asarray(self._data[:, component][dofs] @ basis.T)

    def _basis(self, element: int, points: Floats) -> Floats:
        """(n_points, n) the functions of the space on elements of the kind of one."""
        key = (int(self._corners[element]), int(self.orders[element]))
        if key not in self._tables or self._tables[key][0] is not points:
            width = len(points) * int(self._table.sizes[element])
            one = np.array([element])
            self._tables[key] = (points, self._asked.values("basis", one, points, self._which, width=width))
        return self._tables[key][1]


def _has_unit_weights(text: str) -> bool:
    """Whether the weights of a NURBS mesh are listed, and all 1."""
    _, found, after = text.partition("\nweights")
    words = after.split("FiniteElementSpace")[0].split()
    return bool(found) and all(word.replace(".", "").strip("0") == "1" for word in words)
