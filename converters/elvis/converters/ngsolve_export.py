"""Sampling of NGSolve meshes and functions from a session in Python, into files that `elvis convert` reads.

from elvis.converters.ngsolve_export import export
export("flow.elems.npz", mesh, {"u": velocity, "p": pressure})

The functions of NGSolve depend on how elements are turned, so none of its coefficients are kept: every element is
sampled at as many points as determine its polynomials.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from elvis.converters.unit import UNIT
from elvis.core.arrays import Floats, Ints, frozen_floats
from elvis.core.bounded_cache import bounded_cache
from elvis.core.errors import ElvisError, FormatError
from elvis.core.files.output import replacing
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.quadrature import gauss, lobatto
from elvis.core.shapes import Shape
from elvis.plugins.conversion import PyramidSpace
from elvis.plugins.nodal import affine_image, space_size, space_values, tensor_nodes

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

#: which of the library's vertices each vertex of a unit element is
UNIT_VERTICES = {
    "segm": (1, 0),
    "trig": (2, 0, 1),
    "quad": (0, 1, 2, 3),
    "tet": (3, 0, 1, 2),
    "pyramid": (0, 1, 2, 3, 4),
    "prism": (2, 0, 1, 5, 3, 4),
    "hex": (0, 1, 2, 3, 4, 5, 6, 7),
}

#: orders above its own that a field of H(div) or H(curl) is sampled with, and spaces of continuous fields
_VECTOR, _CONTINUOUS = 2, ("h1ho", "VectorH1", "nodalfespace")


def export(
    path: str | Path, mesh: Any, fields: Mapping[str, Any], order: int | None = None, time: float | None = None
) -> None:
    """Write a mesh and its functions to ``path``, a name that ends in ``.npz``.

    fields  grid functions by name, or coefficient functions, for which ``order`` must be given
    order   polynomial degree of the samples; that of the spaces and of the map where it is not given
    """
    path = Path(path)
    data = samples(mesh, fields, order)
    if time is not None:
        data["time"] = np.array(time)
    with replacing(path) as temporary, Path(temporary).open("wb") as file:
        np.savez(file, **data)


def samples(mesh: Any, fields: Mapping[str, Any], order: int | None = None) -> dict[str, Any]:
    """What a file holds: for each shape its elements, their vertices, reference points, and values there."""
    import ngsolve

    orders = {name: _order(name, field, order) for name, field in fields.items()}
    bend = 0 if mesh.deformation is None else mesh.deformation.space.globalorder
    geometry = max(mesh.GetCurveOrder(), bend, 1)
    highest = max([geometry, *orders.values()])
    elements = _elements(mesh.Elements(ngsolve.VOL))
    if not elements:
        raise ElvisError("expected elements, found none")
    rules = {name: _rule(SHAPES[name], highest) for name in elements}
    own = {getattr(ngsolve.ET, name.upper()): _own_rule(ngsolve, points) for name, points in rules.items()}
    mapped = mesh.MapToAllElements(own, ngsolve.VOL)
    place = ngsolve.CoefficientFunction((ngsolve.x, ngsolve.y, ngsolve.z)[: mesh.dim])
    values = {"xyz": _table(place(mapped)), **{f"f_{name}": _table(field(mapped)) for name, field in fields.items()}}
    data: dict[str, Any] = {"order": np.array([geometry, highest])}
    data["continuous"] = np.array([name for name, field in fields.items() if _is_continuous(field)], dtype="U")
    data |= {f"order_{name}": np.array(each) for name, each in orders.items()}
    for name, (numbers, vertices, regions, _) in elements.items():
        rows = np.isin(mapped["nr"], numbers)
        data |= {f"{name}_elem": numbers, f"{name}_verts": vertices, f"{name}_region": regions}
        data[f"{name}_ref"] = rules[name]
        data |= {f"{name}_{key}": v[rows].reshape(len(numbers), len(rules[name]), -1) for key, v in values.items()}
    for name, (_, vertices, regions, indices) in _elements(mesh.Elements(ngsolve.BND)).items():
        data |= {f"boundary_{name}_verts": vertices, f"boundary_{name}_region": regions}
        data[f"boundary_{name}_number"] = indices + 1
    return data


def _order(name: str, field: Any, order: int | None) -> int:
    space = getattr(field, "space", None)
    if order is None and space is None:
        raise ElvisError(f"expected an order for {name}, which is no grid function, found none")
    if order is not None:
        return order
    assert space is not None
    return int(space.globalorder) + (_VECTOR if space.type in ("hdivho", "hcurlho") else 0)


def _is_continuous(field: Any) -> bool:
    space = getattr(field, "space", None)
    return space is not None and space.type in _CONTINUOUS


def _elements(found: Any) -> dict[str, tuple[Ints, Ints, Any, Ints]]:
    """Of each shape the numbers of the elements, (n, n_vertices) vertices, and names and numbers of regions."""
    parts: dict[str, tuple[list[int], list[list[int]], list[str], list[int]]] = {}
    for element in found:
        numbers, vertices, regions, indices = parts.setdefault(element.type.name.lower(), ([], [], [], []))
        numbers.append(element.nr)
        vertices.append([vertex.nr for vertex in element.vertices])
        regions.append(element.mat)
        indices.append(int(element.index))
    return {
        name: (
            np.array(numbers, np.int64),
            np.array(vertices, np.int64),
            np.array(regions, dtype="U"),
            np.array(indices),
        )
        for name, (numbers, vertices, names, indices) in parts.items()
    }


def _table(values: Any) -> Floats:
    array = np.asarray(values, np.float64)
    return array.reshape(len(array), -1)


def _own_rule(ngsolve: Any, points: Floats) -> Any:
    padded = [tuple(point) + (0.0,) * (3 - len(point)) for point in points.tolist()]
    return ngsolve.IntegrationRule([point[: points.shape[1]] for point in padded], [1.0] * len(padded))


@bounded_cache
def _rule(shape: Shape, order: int) -> Floats:
    """(m, d) points of the unit element that determine its functions of an order well.

    Gauss-Lobatto points on cubes, else approximate Fekete points: of many, the rows that pivoting picks from the
    matrix of the functions; Sommariva, Vianello, Computing approximate Fekete points by QR factorizations of
    Vandermonde matrices, 2009.
    """
    is_cube = len(shape.vertices) == 2**shape.dimension
    line = lobatto(order + 1)[0] if is_cube else gauss(order + 3)[0]
    box = (Shape.SEGMENT, Shape.QUADRILATERAL, Shape.HEXAHEDRON)[shape.dimension - 1]
    last_fastest = tensor_nodes(box, tuple(line.tolist()))[:, ::-1]
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
    """What the library does with files, in a process of its own: samples of a mesh and of functions as arrays."""

    def __init__(self) -> None:
        import ngsolve

        self._ngsolve: Any = ngsolve

    def samples(self, path: str, named: str, fields: Mapping[str, tuple[str, str, int]]) -> dict[str, Any]:
        """See `samples`; ``fields`` are file, space and order by name.

        FormatError where a function has another number of values than its space, or, naming ``named``, where the
        samples can't be made.
        """
        mesh = self._ngsolve.Mesh(path)
        functions = {
            name: _function(self._ngsolve, mesh, Path(file), kind, order)
            for name, (file, kind, order) in fields.items()
        }
        try:
            return samples(mesh, functions)
        except ElvisError as error:
            raise FormatError(str(error), file=named) from error


def _function(ngsolve: Any, mesh: Any, path: Path, kind: str, order: int) -> Any:
    """The grid function of a file; FormatError where it has another number of values than the space."""
    space = getattr(ngsolve, kind)(mesh, order=order)
    if path.stat().st_size != 8 * space.ndof:
        expected = f"{space.ndof} numbers of {kind} of order {order}"
        raise FormatError(f"expected {expected}, found {path.stat().st_size / 8:g}", file=path)
    function = ngsolve.GridFunction(space)
    function.Load(str(path))
    return function
