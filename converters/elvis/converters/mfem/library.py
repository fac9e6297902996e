"""Worker for MFEM's library in a separate process: meshes and functions as arrays, and their values."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from elvis.converters.mfem.hanging import hanging_sides
from elvis.core.base.arrays import Floats, Ints, joined_ints, starts_of
from elvis.core.base.errors import FormatError

#: the library's codes: vector functions, functions divided by the Jacobian, continuous spaces
_IS_VECTOR, _IS_INTEGRAL, _IS_CONTINUOUS = 1, 1, 0

#: the library's number of pyramids; distance from the apex at which discontinuous functions still have one value
_PYRAMID, _NEAR_APEX = 7, 1e-13


class Library:
    """The library, with the meshes that it has read, by number."""

    def __init__(self) -> None:
        # half of its loading time is this compiler for functions written in Python; the library works without it
        sys.modules.setdefault("numba", None)  # type: ignore[arg-type]
        import mfem.ser as mfem

        mfem.out.Disable()
        mfem.err.Disable()
        self._mfem: Any = mfem
        self._meshes: list[_Mesh] = []

    def mesh(self, file: str, named: str) -> dict[str, Any]:
        """A mesh, which gets the next number; FormatError, naming ``named``, where the library can't read it.

        vertices    (n, d) places
        attributes  (m,) of the elements
        corners     table of the vertices of the elements
        faces       table of the vertices of faces on the border, with their attributes
        map         as `function` returns; has_nodes and has_weights: whether it is one of the file, and is rational
        """
        own = _Mesh(self._mfem, file, named)
        self._meshes.append(own)
        return own.description()

    def function(self, mesh: int, file: str, named: str) -> dict[str, Any]:
        """A function of a mesh, where 0 is the map; raises FormatError, naming ``named``, if it can't be read.

        orders  (m,) on every element
        count   of components
        size    number of values
        is_nodal  whether each of its values belongs to a function of the space; then
        table     the functions of every element, and
        data      (n, count) the values
        """
        own = self._meshes[mesh]
        found = _guard(named, lambda: self._mfem.GridFunction(own.mesh, file))
        own.functions.append(_Function(self._mfem, found, found.FESpace()))
        return own.functions[-1].description(own.corners)

    def rule(self, mesh: int, element: int, order: int, named: str) -> dict[str, Any]:
        """The ``points`` (n, d) of the library's rule of an order in an element; raises FormatError if it has none."""
        own = self._meshes[mesh].mesh
        rule = _guard(named, lambda: self._mfem.IntRules.Get(own.GetElementBaseGeometry(element), order))
        points = [rule.IntPoint(i) for i in range(rule.GetNPoints())]
        table = np.array([(point.x, point.y, point.z) for point in points], np.float64).reshape(-1, 3)
        return {"points": table[:, : own.Dimension()]}

    def basis(self, mesh: int, elements: Ints, points: Floats, function: int) -> Floats:
        """(n_points, n) the functions of the space of a function on the first of some elements."""
        return self._meshes[mesh].functions[function].basis(int(elements[0]), points)

    def positions(self, mesh: int, elements: Ints, points: Floats) -> Floats:
        """(n, n_points, d) where points of elements of one shape lie."""
        return self._meshes[mesh].positions(elements, points)

    def values(self, mesh: int, elements: Ints, points: Floats, function: int) -> Floats:
        """(n, n_points, count) values of a function on elements of one shape."""
        return self._meshes[mesh].values(elements, points, function)


class _Mesh:
    """A mesh of the library with functions on it; the first of these is the map."""

    def __init__(self, mfem: Any, file: str, named: str) -> None:
        self._mfem = mfem
        self.mesh = mesh = _guard(named, lambda: mfem.Mesh(file, 1, 0, False))
        self._linear = mfem.LinearFECollection()
        self._straight = _guard(named, lambda: mfem.FiniteElementSpace(mesh, self._linear))
        self._vertices = mfem.Vector()
        mesh.GetVertices(self._vertices)
        nodes = mesh.GetNodes()
        if nodes is None:
            own = _Function(mfem, self._vertices, self._straight, mesh.SpaceDimension())
        else:
            own = _Function(mfem, nodes, nodes.FESpace())
        self.functions = [own]
        self._table = _table(self._straight)
        self.corners = np.diff(self._table["offsets"])

    def description(self) -> dict[str, Any]:
        """See `Library.mesh`."""
        mesh = self.mesh
        faces = [np.array(list(mesh.GetBdrElementVertices(i)), np.int64) for i in range(mesh.GetNBE())]
        return {
            "dimension": int(mesh.Dimension()),
            "vertices": np.array(self._vertices.GetDataArray(), np.float64).reshape(-1, mesh.GetNV()).T,
            "attributes": np.array(mesh.GetAttributeArray(), np.int64),
            "corners": self._table,
            "faces": {
                "attributes": np.array([mesh.GetBdrAttribute(i) for i in range(mesh.GetNBE())], np.int64),
                "offsets": starts_of(faces),
                "vertices": joined_ints(faces),
            },
            "hanging": hanging_sides(self._mfem, mesh) if mesh.Nonconforming() else None,
            "is_conforming": self._straight.GetTrueVSize() == self._straight.GetVSize(),
            "has_nodes": mesh.GetNodes() is not None,
            "has_weights": mesh.NURBSext is not None,
            "map": self.functions[0].description(self.corners),
        }

    def positions(self, elements: Ints, points: Floats) -> Floats:
        """See `Library.positions`."""

        def places(element: int, transformation: Any, rule: Any, table: Any) -> None:
            transformation.Transform(rule, table)

        return self._each(elements, points, self.mesh.SpaceDimension(), places)

    def values(self, elements: Ints, points: Floats, function: int) -> Floats:
        """See `Library.values`."""
        own = self.functions[function]
        return self._each(elements, points, own.count, own.evaluate)

    def _each(self, elements: Ints, points: Floats, count: int, evaluate: Callable[..., None]) -> Floats:
        """(n, n_points, count) from a function of the map of one element and a rule."""
        result = np.empty((len(elements), len(points), count))
        if not len(elements):
            return result
        rule = _rule(self._mfem, points, self.mesh.GetElementBaseGeometry(int(elements[0])))
        table = self._mfem.DenseMatrix()
        for row, element in enumerate(elements.tolist()):
            evaluate(element, self.mesh.GetElementTransformation(element), rule, table)
            result[row] = np.asarray(table.GetDataArray()).T
        return result


class _Function:
    """A function of the library with its space; ``dimension`` where the values are a mere vector."""

    def __init__(self, mfem: Any, function: Any, space: Any, dimension: int | None = None) -> None:
        self._mfem, self.function, self.space = mfem, function, space
        first, name = space.GetFE(0), space.FEColl().Name()
        self.is_nurbs = name.startswith("NURBS")
        self.is_vector = first.GetRangeType() == _IS_VECTOR
        self.is_nodal = not (self.is_nurbs or self.is_vector or first.GetMapType() == _IS_INTEGRAL)
        self.is_continuous = space.FEColl().GetContType() == _IS_CONTINUOUS and not self.is_vector
        # vectors on a plane may have three components (ND_R2D, RT_R2D)
        self.count = int(dimension or (function.VectorDim() if self.is_vector else space.GetVDim()))
        self.highest = max(int(first.GetOrder()), 1)
        self._is_by_node = dimension is not None or space.GetOrdering() == 0

    def description(self, corners: Ints) -> dict[str, Any]:
        """See `Library.function`; ``corners`` (m,) of the elements determine their shapes."""
        found = {
            "is_nurbs": self.is_nurbs,
            "is_nodal": self.is_nodal,
            "is_continuous": self.is_continuous,
            "count": self.count,
            "highest": self.highest,
            "orders": self._orders(corners),
            "size": int(self.function.Size()),
        }
        if self.is_nodal:
            flat = np.array(self.function.GetDataArray(), np.float64)
            data = flat.reshape(self.count, -1).T if self._is_by_node else flat.reshape(-1, self.count)
            found |= {"table": _table(self.space), "data": data}
        return found

    def _orders(self, corners: Ints) -> Ints:
        """(n,) order on every element."""
        if self.is_nurbs or self.space.IsVariableOrder():
            return np.array([self.space.GetFE(i).GetOrder() for i in range(len(corners))], np.int64)
        _, first, which = np.unique(corners, return_index=True, return_inverse=True)
        return np.array([self.space.GetFE(int(i)).GetOrder() for i in first], np.int64)[which.reshape(-1)]

    def basis(self, element: int, points: Floats) -> Floats:
        """(n_points, n) the functions of the space on an element."""
        own = self.space.GetFE(element)
        rule, values, rows = _rule(self._mfem, points, own.GetGeomType()), self._mfem.Vector(own.GetDof()), []
        for i in range(len(points)):
            own.CalcShape(rule.IntPoint(i), values)
            rows.append(np.array(values.GetDataArray()))
        return np.array(rows)

    def evaluate(self, element: int, transformation: Any, rule: Any, table: Any) -> None:
        """Fill a (count, n_points) table of the library with the values on an element."""
        if self.is_vector:
            self.function.GetVectorValues(transformation, rule, table)
            return
        values = self._mfem.Vector()
        table.SetSize(self.count, rule.GetNPoints())
        for component in range(self.count):
            self.function.GetValues(element, rule, values, component + 1)
            table.SetRow(component, values)


def _guard(named: str, read: Callable[[], Any]) -> Any:
    """Result of ``read``; raises FormatError with the library's reason if it fails."""
    try:
        return read()
    except RuntimeError as error:
        lines = [line.strip(" ->") for line in str(error).splitlines() if "... in " not in line]
        reason = " ".join(" ".join(lines).replace("PyMFEM error (mfem::ErrorException):", "").split())
        raise FormatError(f"expected data that MFEM reads, found: {reason}", file=named) from None


def _table(space: Any) -> dict[str, Ints]:
    """The degrees of freedom of every element of a space: of element i numbers[offsets[i]:offsets[i + 1]]."""
    found = space.GetElementToDofTable()
    offsets = _ints(found.HostReadI(), found.Size() + 1)
    return {"offsets": offsets, "numbers": _ints(found.HostReadJ(), found.Size_of_connections())}


def _rule(mfem: Any, points: Floats, geometry: int) -> Any:
    """Points (n, d) as the library takes them; the apex of pyramids as the end of the edge at the origin."""
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
