"""MFEM meshes and grid functions, read and evaluated by the library itself, in a separate process.

In spaces with one value per degree of freedom (H1, L2, with any basis), the functions are evaluated once per shape and
order; everything else (NURBS, H(div), H(curl), integral L2) is evaluated by the library element by element.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from elvis.converters.mfem.files import (
    building_seconds,
    check_mesh,
    check_space,
    declared_elements,
    header,
    is_field,
    is_mesh,
    is_root,
    named_attributes,
    read_root,
    rounding,
    values_after_header,
)
from elvis.converters.mfem.hanging import SIDES
from elvis.converters.mfem.pieces import Piece, Source, is_piece, is_stream, pieces
from elvis.converters.mfem.quadrature import QUADRATURE, QuadratureFunction
from elvis.converters.shared.apart import BYTES_PER_SECOND, Apart, LibraryError
from elvis.converters.shared.evaluated import EvaluatedValues
from elvis.converters.shared.inputs import excess_of_parts
from elvis.converters.shared.unit import UNIT, side_numbers
from elvis.core.base.arrays import Bools, Floats, Ints, distinct_rows, rows_by_number
from elvis.core.base.errors import FormatError
from elvis.core.data.mesh import PERIODIC
from elvis.core.shapes import Shape
from elvis.plugins.conversion.declared import Declared
from elvis.plugins.conversion.nodal import NodalBlock, NodalConverter, NodalValues, ShapeFunctions, component_names
from elvis.plugins.conversion.plugin import Boundary, Elements, PyramidSpace, Reads
from elvis.plugins.projection.vertices import clusters

#: by dimension and number of vertices
_SHAPES = {(shape.dimension, len(shape.vertices)): shape for shape in Shape}

#: reads and evaluates in another process
_WORKER = "elvis.converters.mfem.library:Library"

#: vertices of several parts that are as near as this, as a share of the largest coordinate, are one
_TOGETHER = 1e-10


class Mfem(NodalConverter):
    """A mesh, with the grid functions that live on it."""

    format = "MFEM meshes and grid functions (.mesh, .gf, .saved; pieces of parallel ones; .mfem_root)"
    keeps = "elements of all shapes and orders, H1 and L2 fields exactly; NURBS, H(div), H(curl) with a measured error"
    loses = "hanging nodes make fields discontinuous; functions at quadrature points are polynomials through these"
    reads = Reads(
        "all",
        "any, variable",
        "H1, L2, H(div), H(curl), plane vectors of three components, NURBS, quadrature points",
        "attributes and sets by name",
        "collections, numbered files",
        "pieces, `.mfem_root`",
        "NCMesh",
        "two fields, `u_re` and `u_im`",
    )
    needs = ("mfem",)

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether every file is a mesh, a grid function, or a stream of both."""
        if any(map(is_root, paths)):
            return len(paths) == 1
        return bool(paths) and all(is_mesh(path) or is_field(path) or is_stream(path) for path in paths)

    @classmethod
    def joins(cls, paths: Sequence[Path]) -> bool:
        """Whether these are pieces by their names, or functions of different spaces.

        Functions of one space, and meshes, whose names differ in a number are steps.
        """
        if all(map(is_piece, paths)):
            return True
        return all(map(is_field, paths)) and len({header(path) for path in paths}) == len(paths)

    @classmethod
    def times(cls, paths: Sequence[Path]) -> Sequence[float]:
        """The time in the index of a collection."""
        time = read_root(paths[0])[0] if is_root(paths[0]) else None
        return [] if time is None else [time]

    def __init__(self, paths: Sequence[Path]) -> None:
        files = paths
        if is_root(paths[0]):
            self.time, files = read_root(paths[0])
        self._take(pieces(files))

    @classmethod
    def of(cls, found: Sequence[Piece]) -> Mfem:
        """The meshes and functions of texts that are in memory."""
        own = cls.__new__(cls)
        own._take(found)
        return own

    def _take(self, found: Sequence[Piece]) -> None:
        """Blocks, fields and boundaries of meshes with functions."""
        sources = [source for piece in found for source in (piece.mesh, *piece.functions.values())]
        self.further_files = [source.named for source in sources]
        texts = [source.text for source in sources]
        library = Apart(_WORKER, sum(map(len, texts)))
        with TemporaryDirectory() as folder:
            parts = [_Part(number, piece, Path(folder), library) for number, piece in enumerate(found)]
        self.is_conforming = all(part.is_conforming for part in parts)
        self.precision = max(part.precision for part in parts)
        counts = [declared_elements(piece.mesh.text) for piece in found]
        stated = [count for count in counts if count is not None]
        self.declared = Declared(sum(stated) if len(stated) == len(counts) else None)
        vertices = _numbered([part.vertices for part in parts])
        has_boundaries = self._check_attributes(parts)
        self.blocks, values, first = [], [], 0
        for part, numbers in zip(parts, vertices, strict=True):
            for block, rows in part.blocks(numbers, first):
                self.blocks.append(block)
                values.append([function.on(rows) for function in part.functions])
            first += len(part.attributes)
        self._add_fields(parts, values)
        self.boundaries = _join(parts, vertices) if has_boundaries else []
        if len(parts) == 1 and parts[0].hanging is not None:
            self.mortars, periodic = _sides_of(self.blocks, parts[0].hanging)
            self.boundaries += [Boundary(PERIODIC, sides=periodic)] if periodic else []

    def _check_attributes(self, parts: Sequence[_Part]) -> bool:
        """Whether attributes of the border name boundaries; too many different attributes of elements become one."""
        of_elements = excess_of_parts([part.attributes for part in parts], "attributes of elements")
        of_faces = excess_of_parts([part.face_attributes for part in parts], "attributes of the boundary")
        self.warnings = [remark for remark in (of_elements, of_faces) if remark]
        for part in parts if of_elements else ():
            part.attributes = np.ones_like(part.attributes)
        return not of_faces

    def _add_fields(self, parts: Sequence[_Part], values: Sequence[Sequence[NodalValues]]) -> None:
        """Fields of the functions, whose values on each block are given."""
        part = parts[0]
        for number, (name, function) in enumerate(zip(part.names, part.functions, strict=True)):
            is_exact = function.is_nodal or (function.is_nurbs and not part.is_rational)
            own = [each[number] for each in values]
            labels = component_names(name, function.count)
            self.add_field(number, labels, own, function.is_continuous, is_exact)


class _RemoteMesh:
    """A mesh in the library's process, by its number there; ``path`` is its file."""

    def __init__(self, library: Apart, number: int, path: Path) -> None:
        self._library, self._number, self.path = library, number, path

    def read(self, method: str, *given: Any, size: int, path: Path) -> dict[str, Any]:
        """The library's data from a file with this number of bytes.

        Raises FormatError, naming ``path``, if it fails.
        """
        try:
            found: dict[str, Any] = self._library.ask(method, *given, str(path), size=size)
        except LibraryError as failure:
            raise _refuse(failure, path) from failure
        return found

    def function(self, file: Path, size: int, path: Path) -> dict[str, Any]:
        """`read` for a function on the mesh."""
        return self.read("function", self._number, str(file), size=size, path=path)

    def values(self, method: str, elements: Ints, points: Floats, *given: Any, width: int) -> Floats:
        """The library's values at points in elements, ``width`` numbers for each element."""
        size = 8 * width * len(elements)
        try:
            return np.asarray(self._library.ask(method, self._number, elements, points, *given, size=size))
        except LibraryError as failure:
            raise _refuse(failure, self.path) from failure


def _work(text: str) -> int:
    """Bytes of a file that take the library as long to read as a text and the spaces that it names."""
    return len(text) + BYTES_PER_SECOND * building_seconds(text)


def _refuse(failure: LibraryError, path: Path) -> FormatError:
    found = f"some on which it {'takes too long' if failure.is_out_of_time else 'crashes'}"
    return FormatError(f"expected data that MFEM reads, found {found}", file=path)


class _Part:
    """One mesh with its functions, both under ``number`` in the library's process.

    vertices    (n, d) positions
    attributes  (m,) of the elements
    """

    def __init__(self, number: int, piece: Piece, folder: Path, library: Apart) -> None:
        self.path, text = piece.mesh.named, piece.mesh.text
        self._asked, self._number = _RemoteMesh(library, number, self.path), number
        check_mesh(self.path, text)
        found = self._asked.read("mesh", str(piece.mesh.file(folder)), size=_work(text), path=self.path)
        self.vertices, self.attributes = found["vertices"], found["attributes"]
        check_space(self.path, found["map"]["count"], found["dimension"])
        self.is_rational = found["has_weights"] and not _has_unit_weights(text)
        self.is_conforming = found["is_conforming"]
        self.hanging = found["hanging"]
        self._dimension, self._faces = found["dimension"], found["faces"]
        self.face_attributes = np.asarray(self._faces["attributes"])
        self._corners = _Table(found["corners"])
        self.geometry = _Function(self._asked, 0, found["map"])
        if found["has_nodes"] and "FiniteElementCollection:" in text:
            values_after_header(self.path, text, found["map"]["size"], is_last=False)
        self.names, self.functions = list(piece.functions), self._functions(piece, folder)
        self.precision = rounding(text)
        self._regions, self._borders = (named_attributes(text, f"{w}attribute_sets") for w in ("", "bdr_"))

    def _functions(self, piece: Piece, folder: Path) -> list[_Function | QuadratureFunction]:
        """The functions on the mesh; raises FormatError if one has another number of values than its space."""
        found: list[_Function | QuadratureFunction] = []
        for source in piece.functions.values():
            if source.text.startswith(QUADRATURE):
                found.append(self._quadrature(source))
                continue
            own = self._asked.function(source.file(folder), _work(source.text), source.named)
            values_after_header(source.named, source.text, own["size"], is_last=True)
            at = 1 + sum(isinstance(each, _Function) for each in found)
            found.append(_Function(self._asked, at, own))
        return found

    def _quadrature(self, source: Source) -> QuadratureFunction:
        """A function at quadrature points."""
        corners = self._corners.sizes
        shapes = {number: self._shape(number) for number in np.unique(corners).tolist()}

        def rule(element: int, order: int) -> Floats:
            found = self._asked.read("rule", self._number, element, order, size=_work(source.text), path=source.named)
            return np.asarray(found["points"])

        return QuadratureFunction(source.named, source.text, shapes, corners, rule)

    def _shape(self, corners: int) -> Shape:
        """The shape of elements with this many corners; raises FormatError if none of the mesh's dimension has."""
        try:
            return _SHAPES[self._dimension, corners]
        except KeyError:
            sentence = f"expected elements of dimension {self._dimension}, found some with {corners} vertices"
            raise FormatError(sentence, file=self.path, place="elements") from None

    def blocks(self, numbers: Ints, first: int) -> Iterator[tuple[Elements, Ints]]:
        """Elements by shape, region and the orders of all functions on them, with their rows.

        numbers  (n,) of the vertices, over all parts
        first    number of the first element
        """
        attributes = self.attributes
        if not len(attributes):
            raise FormatError("expected elements, found none", file=self.path, place="elements")
        own = np.unique(attributes)
        regions = [self._regions.get(n, (f"attribute{n}",)) for n in own.tolist()]
        if len(regions) == 1 and not self._regions:
            regions = [("",)]
        distinct = sorted(set(regions))
        places = {names: place for place, names in enumerate(distinct)}
        of = np.array([places[names] for names in regions])[np.searchsorted(own, attributes)]
        functions = [self.geometry, *self.functions]
        columns = [self._corners.sizes, of, *(each.orders for each in functions)]
        kinds, which = np.unique(np.stack(columns, axis=1), axis=0, return_inverse=True)
        for number, rows in rows_by_number(which.reshape(-1)):
            kind = kinds[number]
            shape = self._shape(int(kind[0]))
            region, *others = distinct[kind[1]]
            block = Elements(
                shape,
                len(rows),
                max(int(kind[2]), 1),
                vertices=numbers[self._corners.rows(rows)[:, UNIT[shape].corners]],
                frame=UNIT[shape].frame,
                ids=first + rows,
                region=region,
                other_regions=tuple(others),
                pyramid=PyramidSpace.TENSOR,
                is_polynomial=not self.is_rational,
                key=NodalBlock(self.geometry.on(rows)),
            )
            yield block, rows

    def borders(self, numbers: Ints) -> Iterator[tuple[Ints, Ints]]:
        """Attributes (n,) and vertices (n, k) of the distinct faces on the border, for each number of vertices.

        numbers  (n,) of the vertices, over all parts
        """
        offsets, vertices = self._faces["offsets"], self._faces["vertices"]
        for _, rows in rows_by_number(np.diff(offsets)):
            corners = np.arange(offsets[rows[0] + 1] - offsets[rows[0]])
            places = offsets[rows][:, None] + corners
            yield self.face_attributes[rows], numbers[vertices[places]]

    def border_names(self, attribute: int) -> tuple[str, ...]:
        """The names of the boundaries that an attribute of faces means."""
        return self._borders.get(attribute, (f"boundary{attribute}",))


def _sides_of(
    blocks: Sequence[Elements], hanging: Mapping[str, Any]
) -> tuple[list[tuple[int, Ints, Ints]], list[tuple[int, Ints, Ints]]]:
    """Block, rows and local sides that meet parts of other sides, and sides that a periodic mesh identifies."""
    mortars: list[tuple[int, Ints, Ints]] = []
    periodic: list[tuple[int, Ints, Ints]] = []
    elements, sides, is_apart = (np.asarray(hanging[name]) for name in ("elements", "sides", "is_apart"))
    for number, block in enumerate(blocks):
        table = side_numbers(block.shape, SIDES[block.shape])
        assert block.ids is not None
        order = np.argsort(block.ids)
        place = np.minimum(np.searchsorted(block.ids[order], elements), len(order) - 1)
        is_own = block.ids[order][place] == elements
        for chosen, result in ((is_own & ~is_apart, mortars), (is_own & is_apart, periodic)):
            if chosen.any():
                result.append((number, order[place[chosen]], table[sides[chosen]]))
    return mortars, periodic


def _numbered(places: Sequence[Floats]) -> list[Ints]:
    """Numbers of the vertices of each part, at places (n, d); coincident vertices of several parts are one."""
    if len(places) == 1:
        return [np.arange(len(places[0]))]
    stacked = np.concatenate([np.pad(own, ((0, 0), (0, 3 - own.shape[1]))) for own in places])
    which = clusters(stacked, _TOGETHER * float(np.abs(stacked).max(initial=0)))
    return np.split(which, np.cumsum([len(own) for own in places])[:-1])


def _join(parts: Sequence[_Part], vertices: Sequence[Ints]) -> list[Boundary]:
    """Faces on the border by name; faces of two parts are inside."""
    by_corners: dict[int, list[tuple[_Part, Ints, Ints]]] = {}
    for part, numbers in zip(parts, vertices, strict=True):
        for attributes, corners in part.borders(numbers):
            by_corners.setdefault(corners.shape[1], []).append((part, attributes, corners))
    found: dict[str, list[Ints]] = {}
    for alike in by_corners.values():
        is_inside = _in_several([corners for *_, corners in alike])
        for (part, attributes, corners), is_shared in zip(alike, is_inside, strict=True):
            outer = corners[~is_shared]
            for attribute, rows in rows_by_number(attributes[~is_shared]):
                for name in part.border_names(attribute):
                    found.setdefault(name, []).append(outer[rows])
    return [Boundary(name, vertices=own) for name, own in sorted(found.items())]


def _in_several(faces: Sequence[Ints]) -> list[Bools]:
    """(n,) for each array (n, k) which of its faces other arrays also contain, with the vertices in any order."""
    counts = [len(own) for own in faces]
    owner = np.repeat(np.arange(len(faces)), counts)
    first, which = distinct_rows(np.concatenate(faces))
    lowest = np.full(len(first), len(faces))
    highest = np.full(len(first), -1)
    np.minimum.at(lowest, which, owner)
    np.maximum.at(highest, which, owner)
    return np.split((lowest < highest)[which], np.cumsum(counts)[:-1])


class _Table:
    """The degrees of freedom of every element of a space, (n, k) for elements of one kind."""

    def __init__(self, plain: Mapping[str, Ints]) -> None:
        self.offsets, self.numbers = plain["offsets"], plain["numbers"]
        self.sizes = np.diff(self.offsets)

    def rows(self, elements: Ints) -> Ints:
        """(n, k) numbers of elements that have k each."""
        count = int(self.sizes[elements[0]]) if len(elements) else 0
        return np.asarray(self.numbers[self.offsets[elements][:, None] + np.arange(count)])


class _Function:
    """A function, number ``which`` of the library's functions on a mesh, built from the library's description."""

    def __init__(self, asked: _RemoteMesh, which: int, plain: Mapping[str, Any]) -> None:
        self._asked, self._which = asked, which
        self.is_nurbs, self.is_nodal, self.is_continuous = (plain[f"is_{w}"] for w in ("nurbs", "nodal", "continuous"))
        self.count, self.highest, self.orders = plain["count"], plain["highest"], plain["orders"]
        if self.is_nodal:
            self._table, self._data = _Table(plain["table"]), plain["data"]

    def on(self, elements: Ints) -> NodalValues:
        """Its values on elements of one shape and order."""
        first = int(elements[0])
        order = int(self.orders[first])
        if not self.is_nodal:
            return EvaluatedValues.of(self._evaluate, elements, order, self.count)
        nodes = self._table.rows(elements)
        basis = _Basis(self._asked, self._which, first, nodes.shape[1], order)
        return NodalValues(self._data, basis, nodes)

    def _evaluate(self, elements: Ints, points: Floats) -> Floats:
        """(k, n, c) places, or values of the function, on elements (k,) at points (n, d)."""
        width = len(points) * self.count
        if not self._which:
            return self._asked.values("positions", elements, points, width=width)
        return self._asked.values("values", elements, points, self._which, width=width)


class _Basis(ShapeFunctions):
    """The functions of a space on elements like one, as the library evaluates them."""

    def __init__(self, asked: _RemoteMesh, which: int, element: int, count: int, order: int) -> None:
        self._asked, self._which, self._element = asked, which, element
        self._count, self.order = count, order

    def tabulate(self, points: Floats) -> Floats:
        """(n, count) values at points (n, d) in the library's coordinates."""
        one = np.array([self._element])
        found = self._asked.values("basis", one, points, self._which, width=len(points) * self._count)
        if found.shape[-1] != self._count:
            # the library's serendipity space has no elements of its own on prisms
            sentence = f"expected a space with as many functions as values, found {found.shape[-1]} for {self._count}"
            raise FormatError(f"{sentence} on element {self._element}", file=self._asked.path, place="GridFunction")
        return found


def _has_unit_weights(text: str) -> bool:
    """Whether the weights of a NURBS mesh are listed, and all 1."""
    _, found, after = text.partition("\nweights")
    words = after.split("FiniteElementSpace")[0].split()
    return bool(found) and all(word.replace(".", "").strip("0") == "1" for word in words)
