"""MFEM meshes and grid functions, read and evaluated by the library itself.

Of spaces with one value a degree of freedom (H1, L2, of any basis) the functions are evaluated once a shape and order;
everything else (NURBS, H(div), H(curl), integral L2) is asked of the library element by element.
"""

from __future__ import annotations

import ctypes
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from elvis.converters.mfem_files import check_mesh, is_field, is_mesh, named_attributes, rounding, values_after_header
from elvis.converters.mfem_pieces import Piece, Source, is_stream, pieces
from elvis.converters.names import components
from elvis.converters.unit import UNIT
from elvis.core.arrays import Floats, Ints
from elvis.core.errors import FormatError
from elvis.core.shapes import Shape
from elvis.plugins.conversion import Boundary, Converter, Elements, PyramidSpace, SourceField
from elvis.plugins.projection.vertices import clusters

#: by dimension and number of vertices
_SHAPES = {(shape.dimension, len(shape.vertices)): shape for shape in Shape}

#: orders that functions which are no polynomials get above their own
_RATIONAL, _VECTOR = 4, 2

#: the library's numbers: of functions that are vectors, of those that are divided by the Jacobian, of continuous spaces
_IS_VECTOR, _IS_INTEGRAL, _IS_CONTINUOUS = 1, 1, 0

#: the library's number of pyramids; how near to the apex discontinuous functions still have one value
_PYRAMID, _NEAR_APEX = 7, 1e-13

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
        import mfem.ser as mfem

        mfem.out.Disable()
        mfem.err.Disable()
        with TemporaryDirectory() as folder:
            self._parts = [_Part(piece, Path(folder)) for piece in pieces(paths)]
        self.is_conforming = all(part.is_conforming for part in self._parts)
        self.precision = max(part.precision for part in self._parts)
        vertices = _numbered([part.vertices() for part in self._parts])
        self.blocks, self._orders, first = [], [], 0
        for part, numbers in zip(self._parts, vertices, strict=True):
            for block, orders in part.blocks(numbers, first):
                self.blocks.append(block)
                self._orders.append(orders)
            first += part.mesh.GetNE()
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
            for i, component in enumerate(components(name, own.count)):
                fields.append(SourceField(component, orders, own.is_continuous, is_exact, (number, i)))
        self.fields = fields


class _Part:
    """One mesh of the library with the functions on it."""

    def __init__(self, piece: Piece, folder: Path) -> None:
        import mfem.ser as mfem

        self.path, text = piece.mesh.named, piece.mesh.text
        check_mesh(self.path, piece.mesh.file(folder), text)
        self.mesh = mesh = _guarded(self.path, lambda: mfem.Mesh(str(piece.mesh.file(folder)), 1, 0, False))
        self.is_rational = mesh.NURBSext is not None and not _has_unit_weights(text)
        self._linear = mfem.LinearFECollection()
        self._straight = _guarded(self.path, lambda: mfem.FiniteElementSpace(mesh, self._linear))
        self._corners = _Table(self._straight)
        self.geometry = self._map(text)
        self.names = list(piece.functions)
        self.functions = [_read(mfem, mesh, each, folder) for each in piece.functions.values()]
        self.is_conforming = self._straight.GetTrueVSize() == self._straight.GetVSize()
        self.precision = rounding(text)
        self._regions, self._borders = (named_attributes(text, f"{w}attribute_sets") for w in ("", "bdr_"))

    def _map(self, text: str) -> _Function:
        import mfem.ser as mfem

        nodes = self.mesh.GetNodes()
        if nodes is not None:
            if "FiniteElementCollection:" in text:
                values_after_header(self.path, text, nodes.Size(), is_last=False)
            return _Function(nodes, nodes.FESpace())
        vertices = mfem.Vector()
        self.mesh.GetVertices(vertices)
        return _Function(vertices, self._straight, self.mesh.SpaceDimension())

    def vertices(self) -> Floats:
        """(n, d) where the library has its vertices."""
        import mfem.ser as mfem

        found = mfem.Vector()
        self.mesh.GetVertices(found)
        return np.array(found.GetDataArray(), np.float64).reshape(-1, self.mesh.GetNV()).T

    def blocks(self, numbers: Ints, first: int) -> Iterator[tuple[Elements, Ints]]:
        """Elements by shape, region and the orders of all functions on them, with these orders.

        numbers  (n,) of the vertices, over all parts
        first    number of the first element
        """
        attributes = np.asarray(self.mesh.GetAttributeArray(), np.int64)
        if not len(attributes):
            raise FormatError("expected elements, found none", file=self.path, place="elements")
        own = np.unique(attributes)
        regions = np.array([self._regions.get(int(n), f"attribute{n}") for n in own])
        if len(regions) == 1 and not self._regions:
            regions[:] = ""
        of = np.unique(regions, return_inverse=True)[1][np.searchsorted(own, attributes)]
        functions = [self.geometry, *self.functions]
        columns = [self._corners.sizes, of, *(each.orders(self._corners.sizes) for each in functions)]
        kinds, which = np.unique(np.stack(columns, axis=1), axis=0, return_inverse=True)
        for number, kind in enumerate(kinds):
            rows = np.flatnonzero(which.reshape(-1) == number)
            shape = _SHAPES[self.mesh.Dimension(), int(kind[0])]
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
        for i in range(self.mesh.GetNBE()):
            attribute = self.mesh.GetBdrAttribute(i)
            name = self._borders.get(attribute, f"boundary{attribute}")
            yield name, tuple(numbers[list(self.mesh.GetBdrElementVertices(i))].tolist())

    def positions(self, elements: Ints, points: Floats) -> Floats:
        """(n, n_points, d) where points of elements lie."""
        if self.geometry.is_nodal:
            return self.geometry.values(elements, points)
        return self._each(elements, points, self.mesh.SpaceDimension(), self._places)

    def sample(self, elements: Ints, function: int, component: int, points: Floats) -> Floats:
        """(n, n_points) values of a component of a function."""
        own = self.functions[function]
        if own.is_nodal:
            return own.values(elements, points, component)
        return np.asarray(self._each(elements, points, own.count, own.evaluate)[:, :, component])

    def _each(self, elements: Ints, points: Floats, count: int, evaluate: Any) -> Floats:
        """(n, n_points, count) from a function of the map of one element and a rule."""
        import mfem.ser as mfem

        result = np.empty((len(elements), len(points), count))
        if not len(elements):
            return result
        rule = _rule(points, self.mesh.GetElementBaseGeometry(int(elements[0])))
        table = mfem.DenseMatrix()
        for row, element in enumerate(elements.tolist()):
            evaluate(element, self.mesh.GetElementTransformation(element), rule, table)
            result[row] = np.asarray(table.GetDataArray()).T
        return result

    @staticmethod
    def _places(element: int, transformation: Any, rule: Any, table: Any) -> None:
        transformation.Transform(rule, table)


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

    def __init__(self, space: Any) -> None:
        table = space.GetElementToDofTable()
        self.offsets = _ints(table.HostReadI(), table.Size() + 1)
        self.numbers = _ints(table.HostReadJ(), table.Size_of_connections())
        self.sizes = np.diff(self.offsets)

    def rows(self, elements: Ints) -> Ints:
        """(n, k) those of elements that have k each."""
        count = int(self.sizes[elements[0]]) if len(elements) else 0
        return np.asarray(self.numbers[self.offsets[elements][:, None] + np.arange(count)])


class _Function:
    """A function of the library with its space; ``dimension`` where the values are a mere vector."""

    def __init__(self, function: Any, space: Any, dimension: int | None = None) -> None:
        self.function, self.space = function, space
        first, name = space.GetFE(0), space.FEColl().Name()
        self.is_nurbs = name.startswith("NURBS")
        self.is_vector = first.GetRangeType() == _IS_VECTOR
        self.is_nodal = not (self.is_nurbs or self.is_vector or first.GetMapType() == _IS_INTEGRAL)
        self.is_continuous = space.FEColl().GetContType() == _IS_CONTINUOUS and not self.is_vector
        self.count = dimension or (space.GetMesh().SpaceDimension() if self.is_vector else space.GetVDim())
        self.highest = max(int(first.GetOrder()), 1)
        self._tables: dict[Any, tuple[Floats, Floats]] = {}
        if self.is_nodal:
            self.table, flat = _Table(space), np.array(function.GetDataArray(), np.float64)
            by_node = flat.reshape(self.count, -1).T if dimension or space.GetOrdering() == 0 else None
            self.data = flat.reshape(-1, self.count) if by_node is None else by_node

    def orders(self, corners: Ints) -> Ints:
        """(n,) order on every element; ``corners`` tell the shapes."""
        if self.is_nurbs or self.space.IsVariableOrder():
            return np.array([self.space.GetFE(i).GetOrder() for i in range(len(corners))], np.int64)
        _, first, which = np.unique(corners, return_index=True, return_inverse=True)
        return np.array([self.space.GetFE(int(i)).GetOrder() for i in first], np.int64)[which.reshape(-1)]

    def values(self, elements: Ints, points: Floats, component: int | None = None) -> Floats:
        """(n, n_points) of a component of a nodal function on elements of one kind; for None (n, n_points, count)."""
        if not len(elements):
            return np.empty((0, len(points), self.count)[: 3 if component is None else 2])
        dofs, basis = self.table.rows(elements), self._basis(int(elements[0]), points)
        if component is None:
            return np.asarray(np.einsum("enc,pn->epc", self.data[dofs], basis))
        return np.asarray(self.data[:, component][dofs] @ basis.T)

    def evaluate(self, element: int, transformation: Any, rule: Any, table: Any) -> None:
        """Fill a (count, n_points) table of the library with the values on an element."""
        if self.is_vector:
            self.function.GetVectorValues(transformation, rule, table)
            return
        import mfem.ser as mfem

        values = mfem.Vector()
        table.SetSize(self.count, rule.GetNPoints())
        for component in range(self.count):
            self.function.GetValues(element, rule, values, component + 1)
            table.SetRow(component, values)

    def _basis(self, element: int, points: Floats) -> Floats:
        """(n_points, n) the functions of the space on elements of the kind of one."""
        import mfem.ser as mfem

        own = self.space.GetFE(element)
        key = (own.GetGeomType(), own.GetOrder())
        if key not in self._tables or self._tables[key][0] is not points:
            rule, values, rows = _rule(points, own.GetGeomType()), mfem.Vector(own.GetDof()), []
            for i in range(len(points)):
                own.CalcShape(rule.IntPoint(i), values)
                rows.append(np.array(values.GetDataArray()))
            self._tables[key] = (points, np.array(rows))
        return self._tables[key][1]


def _read(mfem: Any, mesh: Any, source: Source, folder: Path) -> _Function:
    """A grid function from its text."""
    file = source.file(folder)
    function = _guarded(source.named, lambda: mfem.GridFunction(mesh, str(file)))
    values_after_header(source.named, source.text, function.Size(), is_last=True)
    return _Function(function, function.FESpace())


def _guarded(path: Path, read: Any) -> Any:
    """What ``read`` returns; FormatError with the library's reason where it fails."""
    try:
        return read()
    except RuntimeError as error:
        lines = [line.strip(" ->") for line in str(error).splitlines() if "... in " not in line]
        reason = " ".join(" ".join(lines).replace("PyMFEM error (mfem::ErrorException):", "").split())
        raise FormatError(f"expected data that MFEM reads, found: {reason}", file=path) from None


def _has_unit_weights(text: str) -> bool:
    """Whether the weights of a NURBS mesh are listed, and all 1."""
    _, found, after = text.partition("\nweights")
    words = after.split("FiniteElementSpace")[0].split()
    return bool(found) and all(word.replace(".", "").strip("0") == "1" for word in words)


def _rule(points: Floats, geometry: int) -> Any:
    """Points (n, d) as the library takes them; the apex of pyramids as the end of the edge at the origin."""
    import mfem.ser as mfem

    if geometry == _PYRAMID:
        points = np.where(points[:, 2:] > 1 - _NEAR_APEX, (0, 0, 1 - _NEAR_APEX), points)

    rule = mfem.IntegrationRule(len(points))
    for i, point in enumerate(points.tolist()):
        rule.IntPoint(i).Set3(*point, *(0.0,) * (3 - len(point)))
    return rule


def _ints(pointer: Any, count: int) -> Ints:
    """A copy of an array of the library."""
    array = np.ctypeslib.as_array(ctypes.cast(int(pointer), ctypes.POINTER(ctypes.c_int)), (count,))
    return np.array(array, np.int64)
