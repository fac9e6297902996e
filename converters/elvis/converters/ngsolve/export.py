"""NGSolve's meshes and functions in a session of Python: evaluated anywhere, or sampled into files.

from elvis.converters.ngsolve.export import export
export("flow.elems.npz", mesh, {"u": velocity, "p": pressure})

The functions of NGSolve depend on the orientation of elements, so none of its coefficients are stored: `Session`
obtains values at points of elements from the library.  A file has samples at as many points as determine polynomials,
and the errors of these.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from elvis.converters.ngsolve.points import PointValues
from elvis.converters.shared.unit import UNIT, unit_basis
from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.base.relative import error_limit
from elvis.core.files.output import replacing
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.quadrature import gauss, lobatto
from elvis.core.shapes import TENSOR, Shape
from elvis.plugins.conversion.nodal import affine_image, space_size, space_values, tensor_nodes
from elvis.plugins.conversion.plugin import PyramidSpace
from elvis.plugins.projection.checking import check_points
from elvis.plugins.projection.raising import GOAL, added_orders

#: our shape by the library's name of one, which is also its name in the files
SHAPES = {
    "segm": Shape.SEGMENT,
    "trig": Shape.TRIANGLE,
    "quad": Shape.QUADRILATERAL,
    "tet": Shape.TETRAHEDRON,
    "pyramid": Shape.PYRAMID,
    "prism": Shape.PRISM,
    "hex": Shape.HEXAHEDRON,
}

#: for each vertex of a unit element, the library's vertex
UNIT_VERTICES = {
    "segm": (1, 0),
    "trig": (2, 0, 1),
    "quad": (0, 1, 2, 3),
    "tet": (3, 0, 1, 2),
    "pyramid": (0, 1, 2, 3, 4),
    "prism": (2, 0, 1, 5, 3, 4),
    "hex": (0, 1, 2, 3, 4, 5, 6, 7),
}

#: types of spaces of continuous fields, and of all fields that are polynomials in the reference element
_CONTINUOUS = ("h1ho", "VectorH1", "nodalfespace")
#: types of functions with values at quadrature points, and at the quadrature points of surfaces only
_AT_POINTS, _AT_SURFACE_POINTS = "irspace", "irspacesurface"
_POLYNOMIAL = (*_CONTINUOUS, "l2ho", "VectorL2", "number", "Periodich1ho", _AT_POINTS)

#: the dimension of meshes that may be surfaces
_SPACE_DIMENSION = 3

#: the highest order of samples
_HIGHEST = 16

#: points inside each element at which samples are compared with the functions
_INSIDE = 40


class Sampled(NamedTuple):
    """A function that is evaluated, and its origin.

    space    of the grid function that it is or is a part of, None for other functions
    regions  names of the parts of the mesh that have it, None for all
    """

    function: Any
    space: Any = None
    regions: tuple[str, ...] | None = None


class Session:
    """A mesh of the library with functions on it, evaluated at reference points of elements.

    fields  grid functions by name, coefficient functions, for which ``order`` must be given, or `Sampled`; the real
            part of a complex one is called ``NAME_re``, the imaginary part ``NAME_im``, the parts of a function on
            several spaces ``NAME_1``, ``NAME_2``
    order   polynomial degree of all fields; by default the degree of each space

    Elements are the elements of the volume, or of the surface of a mesh without a volume.  Raises ElvisError without
    elements or an order, or if a function has no values inside elements.
    """

    def __init__(self, mesh: Any, fields: Mapping[str, Any], order: int | None = None) -> None:
        import ngsolve

        self._ngsolve, self._mesh, self._fields = ngsolve, mesh, _real_fields(fields)
        bend = 0 if mesh.deformation is None else mesh.deformation.space.globalorder
        self.geometry = max(mesh.GetCurveOrder(), bend, 1)
        self._parts, self._sides = ngsolve.VOL, ngsolve.BND
        self.elements = _elements(mesh.Elements(ngsolve.VOL))
        if not self.elements and mesh.dim == _SPACE_DIMENSION:
            self._parts, self._sides = ngsolve.BND, ngsolve.BBND
            self.elements = _elements(mesh.Elements(ngsolve.BND))
        if not self.elements:
            raise ElvisError("expected elements, found none")
        own = mesh.Elements(self._parts)
        rows = {shape: (SHAPES[shape], numbers) for shape, (numbers, *_) in self.elements.items()}
        at_points = {name: field for name, field in self._fields.items() if _type(field) == _AT_POINTS}
        self._at_points = {
            name: PointValues(name, field.function, self._parts, rows) for name, field in at_points.items()
        }
        self.orders = {name: _order(own, name, field.space, order) for name, field in self._fields.items()}
        self.orders |= {name: values.order for name, values in self._at_points.items()}
        self._place = ngsolve.CoefficientFunction((ngsolve.x, ngsolve.y, ngsolve.z)[: mesh.dim])
        one = {getattr(ngsolve.ET, name.upper()): _one_point(ngsolve, SHAPES[name]) for name in self.elements}
        self._first = mesh.MapToAllElements(one, self._parts)[:1]

    def description(self) -> dict[str, Any]:
        """The content of a file (see `elvis.converters.ngsolve.ngsolve`) without points, positions and values.

        And counts of components.

        polynomial  names of the functions that are polynomials of their order
        count_NAME  number of components
        regions_NAME  the parts of the mesh that have the function, if not all
        """
        data: dict[str, Any] = {"order": np.array([self.geometry, max([self.geometry, *self.orders.values()])])}
        types = {name: _type(own) for name, own in self._fields.items()}
        data["continuous"] = np.array([name for name, own in types.items() if own in _CONTINUOUS], dtype="U")
        data["polynomial"] = np.array([name for name, own in types.items() if own in _POLYNOMIAL], dtype="U")
        data |= {f"order_{name}": np.array(each) for name, each in self.orders.items()}
        data |= {f"count_{name}": np.array(int(field.function.dim)) for name, field in self._fields.items()}
        for name, field in self._fields.items():
            if field.regions is not None:
                data[f"regions_{name}"] = np.array(field.regions, dtype="U")
        for name, (numbers, vertices, regions, _) in self.elements.items():
            data |= {f"{name}_elem": numbers, f"{name}_verts": vertices, f"{name}_region": regions}
        for name, (_, vertices, regions, indices) in _elements(self._mesh.Elements(self._sides)).items():
            data |= {f"boundary_{name}_verts": vertices, f"boundary_{name}_region": regions}
            data[f"boundary_{name}_number"] = 1 + indices
        return data

    def positions(self, elements: Ints, points: Floats) -> Floats:
        """(k, n, D) world coordinates at the library's reference points (n, d) of elements (k,)."""
        return self._table(self._place, elements, points)

    def values(self, name: str, elements: Ints, points: Floats) -> Floats:
        """(k, n, c) components of a function at reference points (n, d) of elements (k,)."""
        if name in self._at_points:
            return self._at_points[name].at(elements, points)
        try:
            return self._table(self._fields[name].function, elements, points)
        except Exception as error:
            # the library does not export its class of exceptions
            if type(error).__name__ != "NgException":
                raise
            raise ElvisError(f"{name}: expected values inside of elements, found none: {error}") from error

    def _table(self, function: Any, elements: Ints, points: Floats) -> Floats:
        """(k, n, c) values; the library takes points as records of coordinates and an element's number."""
        records = np.repeat(self._first, len(elements) * len(points))
        for axis, name in enumerate("xyz"):
            own = points[:, axis] if axis < points.shape[1] else np.zeros(len(points))
            records[name] = np.tile(own, len(elements))
        records["nr"] = np.repeat(elements, len(points))
        found = np.asarray(function(records), np.float64) if len(records) else np.empty((0, 1))
        return found.reshape(len(elements), len(points), -1)


def _type(field: Sampled) -> str:
    """The library's name for the kind of a field's space, empty if unknown."""
    return getattr(field.space, "type", "")


def export(
    path: str | Path, mesh: Any, fields: Mapping[str, Any], order: int | None = None, time: float | None = None
) -> None:
    """Write a mesh and its functions to ``path``, a name that ends in ``.npz``.

    fields  grid functions by name, or coefficient functions, for which ``order`` must be given
    order   polynomial degree of the samples; by default the degree of the spaces and of the map, or a higher one for
            functions that are not polynomials of this degree

    The file contains the maximum difference of the polynomials through the samples from the functions.
    """
    path = Path(path)
    session = Session(mesh, fields, order)
    if order is None:
        session.orders = {name: own + _added(session, name) for name, own in session.orders.items()}
    data = samples(session)
    if time is not None:
        data["time"] = np.array(time)
    with replacing(path) as temporary, Path(temporary).open("wb") as file:
        np.savez(file, **data)


def samples(session: Session) -> dict[str, Any]:
    """The content of a file: for each shape its elements, their vertices, reference points, and values there."""
    data = session.description()
    highest = max([session.geometry, *session.orders.values()])
    for name, (numbers, *_) in session.elements.items():
        points = _rule(SHAPES[name], highest)
        data |= {f"{name}_ref": points, f"{name}_xyz": session.positions(numbers, points)}
        data |= {f"{name}_f_{field}": session.values(field, numbers, points) for field in session.orders}
    data |= {f"error_{field}": np.array(_error(session, field, highest)) for field in session.orders}
    return data | {"error": np.array(_error(session, None, highest))}


def _values(session: Session, field: str | None, elements: Ints, points: Floats) -> Floats:
    """(k, n, c) values of a function, or places."""
    return session.positions(elements, points) if field is None else session.values(field, elements, points)


def _error(session: Session, field: str | None, order: int) -> float:
    """The largest difference between a function, or the map, and polynomials through samples of an order."""
    worst = 0.0
    for name, (numbers, *_) in session.elements.items():
        shape, nodes = SHAPES[name], _rule(SHAPES[name], order)
        points = affine_image(check_points(shape, _INSIDE)[: -len(shape.vertices)], shape.vertices, UNIT[shape].frame)
        table = unit_basis(shape, order, nodes).at(affine_image(points, UNIT[shape].frame, shape.vertices))
        ours = np.einsum("pn,knc->kpc", table, _values(session, field, numbers, nodes))
        off = np.abs(ours - _values(session, field, numbers, points))
        worst = max(worst, float(np.nanmax(off, initial=0.0)))
    return worst


def _added(session: Session, field: str) -> int:
    """Number of orders that a function needs in addition to its own."""
    own = session.orders[field]
    nodes = [(numbers, _rule(SHAPES[name], own)) for name, (numbers, *_) in session.elements.items()]
    values = [session.values(field, numbers, points) for numbers, points in nodes]
    low, high = (float(f([f(each) for each in values])) for f in (np.nanmin, np.nanmax))
    goal = error_limit(GOAL, high - low, max(abs(low), abs(high)))
    more = added_orders(lambda added: _error(session, field, own + added), goal, lambda added: own + added <= _HIGHEST)
    return more.added


def _real_fields(fields: Mapping[str, Any]) -> dict[str, Sampled]:
    """Functions with real values: of complex ones two, of those on several spaces one for each."""
    found: dict[str, Sampled] = {}
    for name, field in fields.items():
        own = field if isinstance(field, Sampled) else Sampled(field, getattr(field, "space", None))
        if _type(own) == _AT_SURFACE_POINTS:
            raise ElvisError(f"{name}: expected a function inside of elements, found one at points of surfaces")
        # spaces of vectors have components too, and a type; products of spaces have none
        if own.space is not None and not own.space.type and own.function.components:
            parts = {f"{name}_{number}": part for number, part in enumerate(own.function.components, 1)}
            found |= _real_fields(parts)
            continue
        if own.function.is_complex and _type(own) != _AT_POINTS:
            found[f"{name}_re"] = own._replace(function=own.function.real)
            found[f"{name}_im"] = own._replace(function=own.function.imag)
        else:
            found[name] = own
    return found


def _order(elements: Any, name: str, space: Any, order: int | None) -> int:
    """The requested order, or the highest of the elements of a field's space."""
    if order is None and space is None:
        raise ElvisError(f"expected an order for {name}, which is not a grid function, found none")
    if order is not None:
        return order
    # orders may differ by element (SetOrder), which the order of the space doesn't show
    return max([int(space.globalorder), *(int(space.GetFE(element).order) for element in elements)])


def _elements(found: Any) -> dict[str, tuple[Ints, Ints, Any, Ints]]:
    """For each shape, the numbers of the elements, (n, n_vertices) vertices, and names and indices of regions."""
    parts: dict[str, tuple[list[int], list[list[int]], list[str], list[int]]] = {}
    for element in found:
        numbers, vertices, regions, indices = parts.setdefault(element.type.name.lower(), ([], [], [], []))
        numbers.append(element.nr)
        vertices.append([vertex.nr for vertex in element.vertices])
        regions.append(element.mat)
        indices.append(element.index)
    return {
        name: (np.array(own[0], np.int64), np.array(own[1], np.int64), np.array(own[2], dtype="U"), np.array(own[3]))
        for name, own in parts.items()
    }


def _one_point(ngsolve: Any, shape: Shape) -> Any:
    """A rule of one point inside of an element."""
    return ngsolve.IntegrationRule([(0.2,) * shape.dimension], [1.0])


@bounded_cache
def _rule(shape: Shape, order: int) -> Floats:
    """(m, d) points of the unit element that determine its functions of an order well.

    Gauss-Lobatto points on cubes, else approximate Fekete points: of many, the rows that pivoting picks from the
    matrix of the functions; Sommariva, Vianello, Computing approximate Fekete points by QR factorizations of
    Vandermonde matrices, 2009.
    """
    is_cube = len(shape.vertices) == 2**shape.dimension
    line = lobatto(order + 1)[0] if is_cube else gauss(order + 3)[0]
    last_fastest = tensor_nodes(TENSOR[shape.dimension - 1], tuple(line.tolist()))[:, ::-1]
    many = uncollapse(shape, last_fastest)
    chosen = list(range(len(many))) if is_cube else _pivots(shape, order, many)
    return frozen_floats(affine_image(many[chosen], shape.vertices, UNIT[shape].frame))


def _pivots(shape: Shape, order: int, many: Floats) -> list[int]:
    """The rows of points that determine the functions of an order, each the farthest from those before."""
    left = space_values(shape, order, many, PyramidSpace.RATIONAL).copy()
    chosen = []
    for _ in range(space_size(shape, order, PyramidSpace.RATIONAL)):
        sizes = (left**2).sum(axis=1)
        best = int(sizes.argmax())
        chosen.append(best)
        direction = left[best] / np.sqrt(sizes[best])
        left -= np.outer(left @ direction, direction)
    return chosen


class Library:
    """Worker for the library in a separate process: a mesh and functions, evaluated at any points."""

    def __init__(self) -> None:
        import ngsolve

        self._ngsolve: Any = ngsolve

    def read(self, path: str, named: str, fields: Mapping[str, tuple[str, Sequence[Sequence[Any]]]]) -> dict[str, Any]:
        """The `Session.description` of a mesh and functions.

        fields  file and spaces (see `_space`) by name; functions of several spaces are called ``NAME_1``, ``NAME_2``
        Raises FormatError if a function has another number of values than its space, or, naming ``named``, if the
        samples can't be made.
        """
        mesh = self._ngsolve.Mesh(path)
        functions: dict[str, Sampled] = {}
        for name, (file, spaces) in fields.items():
            parts = _functions(self._ngsolve, mesh, Path(file), spaces)
            names = [name] if len(parts) == 1 else [f"{name}_{number + 1}" for number in range(len(parts))]
            functions |= dict(zip(names, parts, strict=True))
        try:
            self._session = Session(mesh, functions)
        except ElvisError as error:
            raise FormatError(str(error), file=named) from error
        return self._session.description()

    def positions(self, elements: Ints, points: Floats) -> Floats:
        """See `Session.positions`."""
        return self._session.positions(elements, points)

    def values(self, name: str, elements: Ints, points: Floats) -> Floats:
        """See `Session.values`."""
        return self._session.values(name, elements, points)


def _functions(ngsolve: Any, mesh: Any, path: Path, spaces: Sequence[Sequence[Any]]) -> list[Sampled]:
    """The functions of a file, one of each space; raises FormatError if it has another number of values than these."""
    own = [_space(ngsolve, mesh, path, *each) for each in spaces]
    space = own[0] if len(own) == 1 else ngsolve.FESpace(own)
    width = 16 if space.is_complex else 8
    if path.stat().st_size != width * space.ndof:
        names = " and ".join(f"{kind} of order {order}" for kind, order, *_ in spaces)
        expected = f"{space.ndof} {'complex ' if space.is_complex else ''}numbers of {names}"
        raise FormatError(f"expected {expected}, found {path.stat().st_size / width:g}", file=path)
    function = ngsolve.GridFunction(space)
    function.Load(str(path))
    parts = [function] if len(own) == 1 else list(function.components)
    regions = [_regions(mesh, region) for _, _, _, region in spaces]
    return [Sampled(*each) for each in zip(parts, own, regions, strict=True)]


def _space(ngsolve: Any, mesh: Any, path: Path, kind: str, order: int, is_complex: bool, region: str) -> Any:
    """A space by its kind and order, on all of the mesh or on the parts that a regular expression names."""
    if not region:
        return getattr(ngsolve.comp, kind)(mesh, order=order, complex=is_complex)
    names = _regions(mesh, region)
    if not names:
        known = ", ".join(sorted(set(mesh.GetMaterials())))
        raise FormatError(f"expected parts of the mesh among {known}, found {region!r}", file=path)
    return getattr(ngsolve.comp, kind)(mesh, order=order, complex=is_complex, definedon=mesh.Materials("|".join(names)))


def _regions(mesh: Any, region: str) -> tuple[str, ...] | None:
    """The names of the parts of a mesh that a regular expression fits, None for all."""
    if not region:
        return None
    return tuple(name for name in sorted(set(mesh.GetMaterials())) if re.fullmatch(region, name))
