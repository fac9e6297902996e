"""Critical points of a velocity: all places inside of elements where it is zero, isolated by Bernstein bounds.

Elements are images of boxes (`subcells`), in which `zero_search` finds them.  Each of several ranks looks through the
elements of its part, once it knows the vertices and edges of the outer boundary that others have.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, pair_numbers
from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import ALONE, Ranks
from elvis.core.bounds.zero_search import ZeroSearch
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import Mesh
from elvis.core.distances.boundaries import outer_sides, owners_of_sides
from elvis.core.mapping.margins import heights
from elvis.core.mapping.orientation import chunks, local_vertices
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.net_zeros import BEYOND
from elvis.core.portions.portion import Portion
from elvis.core.quantities.elements.points import ElementPoints, Lattice
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.expression_nets import degree_on
from elvis.core.quantities.levels import same_level
from elvis.core.quantities.tree import AXES, world_derivative
from elvis.core.streamlines.velocity import velocity_expressions

#: elements at once
_CHUNK = 256
#: eigenvalues whose real part is less than this part of the largest one have none
_NEUTRAL = 1e-9


@dataclass(frozen=True)
class CriticalPoint:
    """A place where the velocity is zero.

    kind         node in, node out, saddle, spiral in, spiral out, centre, spiral saddle, degenerate
    index        sign of the gradient's determinant: what Poincare-Hopf adds up
    position     (x, y, z)
    element      id of an element that holds it
    eigenvalues  of the velocity's gradient
    """

    kind: str
    index: int
    position: tuple[float, float, float]
    element: int
    eigenvalues: tuple[complex, ...]


@dataclass(frozen=True, eq=False)
class CriticalPoints:
    """All zeros of a velocity in a domain.

    points      each once
    undecided   ascending ids of elements in which the search ended before every box was decided, for example along a
                line of zeros
    near_boundary
                ascending ids of elements in which undecided boxes lie only near the outer boundary, within 1/128 of
                the element
    """

    points: tuple[CriticalPoint, ...]
    undecided: tuple[int, ...]
    near_boundary: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.points)

    def facts(self) -> dict[str, object]:
        """As plain data; eigenvalues as real and imaginary parts."""
        points = []
        for each in self.points:
            values = [[value.real, value.imag] for value in each.eigenvalues]
            points.append({**vars(each), "position": list(each.position), "eigenvalues": values})
        return {"points": points, "undecided": list(self.undecided), "near_boundary": list(self.near_boundary)}


def critical_points(dataset: Dataset, velocity: Sequence[str] | None = None) -> CriticalPoints:
    """All points inside the domain where a velocity is zero; points on the outer boundary are excluded.

    velocity  names of its components; None for the usual names in the data
    Raises ElvisError if the zeros of a component are not zeros of a polynomial, and for surfaces in space and Fourier
    directions.

    >>> ds = elvis.from_arrays({"triangle": [[[-1, -1], [2, -1], [-1, 2]]]}, u=[[-1, 2, -1]], v=[[-1, -1, 2]])
    >>> elvis.critical_points(ds).points[0].kind
    'node out'
    """
    outer = _Outer.of(dataset.mesh, np.arange(len(dataset.mesh.vertices)), ALONE)
    return united([_found(dataset, velocity, outer)])


def shared_critical_points(portion: Portion, velocity: Sequence[str] | None, ranks: Ranks) -> CriticalPoints | None:
    """`critical_points` if each of several ranks has a part of the data; None except at the first rank.

    Each part knows its inner sides (`knows_inner_sides`).
    """
    dataset = portion.dataset
    found = _found(dataset, velocity, _Outer.of(dataset.mesh, portion.rows[None], ranks))
    every = ranks.gather(found, f"critical points of {velocity}")
    return united(every) if every else None


@dataclass(frozen=True, eq=False)
class Found:
    """The zeros in some elements, as in `CriticalPoints`, and the extrema of the coefficients of their maps."""

    points: list[CriticalPoint]
    undecided: list[int]
    near_boundary: list[int]
    ends: list[float]


def united(every: Sequence[Found]) -> CriticalPoints:
    """All that was found in several parts."""
    points = [point for own in every for point in own.points]
    spread = _spread([end for own in every for end in own.ends])
    undecided = sorted(id for own in every for id in own.undecided)
    near_boundary = sorted(id for own in every for id in own.near_boundary)
    return CriticalPoints(tuple(_distinct(points, spread)), tuple(undecided), tuple(near_boundary))


def _found(dataset: Dataset, velocity: Sequence[str] | None, outer: _Outer) -> Found:
    """The zeros in all elements of a dataset."""
    components = velocity_expressions(dataset, velocity)
    zeros = [numerator(each) for each in components]
    slopes = [
        Expression(f"{each.text}_{AXES[axis]}", world_derivative(each.root, axis))
        for each in components
        for axis in range(len(components))
    ]
    evaluator = Evaluator(dataset, [*zeros, *slopes])
    found: list[CriticalPoint] = []
    undecided: list[int] = []
    near_boundary: list[int] = []
    for patch in evaluator.patches:
        if patch.periods or patch.shape.dimension != len(components):
            raise ElvisError("expected 2D data in the plane or 3D data, without Fourier directions")
        search = _Search(dataset, evaluator, patch, zeros, outer)
        for rows in chunks(len(patch), _CHUNK):
            search.run(np.arange(len(patch))[rows])
        found += search.classified(slopes)
        undecided += patch.element_ids[list(search.undecided)].tolist()
        near_boundary += patch.element_ids[list(search.near_boundary - search.undecided)].tolist()
    return Found(found, undecided, near_boundary, ends(evaluator.patches))


def numerator(component: Expression) -> Expression:
    """A polynomial that is zero if a component is; the component itself where none is known."""
    same = same_level(component.root, 0.0)
    if same is None or same.spurious is not None or same.value != 0:
        return component
    return Expression(component.text, same.root)


def degree_of(expression: Expression, evaluator: Evaluator, patch: Patch) -> int:
    """Degree of a component in each direction of eta, at least 1; raises ElvisError if it is not a polynomial."""
    degree = degree_on(expression, evaluator, patch, is_affine=False)
    if degree is None:
        raise ElvisError(
            f"{expression.text}: expected a component that is zero where a polynomial of fields and coordinates is"
        )
    return max(degree, 1)


@dataclass(frozen=True, eq=False)
class _Outer:
    """The outer boundary of a mesh: sides that a single element has.

    numbers   (vertices,) of vertices in the whole
    count     of vertices there
    vertices  (vertices,) whether vertices are on it
    pairs     sorted codes of the vertices of its edges
    sides     (sides,) which of the mesh's faces, or edges in 2D, are of it
    """

    numbers: Ints
    count: int
    vertices: Bools
    pairs: Ints
    sides: Bools

    @staticmethod
    def of(mesh: Mesh, numbers: Ints, ranks: Ranks) -> _Outer:
        """The outer boundary of the whole mesh.

        Elements of one rank may touch it at the sides of another rank's elements.

        numbers  (vertices,) of vertices in the whole
        """
        count, empty = mesh.counts.vertices, np.empty(0, np.int64)
        owners = owners_of_sides(mesh, [own.members for own in mesh.elements.values()])
        owners = np.where(outer_sides(mesh, owners), 1, 2)
        vertices, pairs = [empty], [empty]
        for shape, entities in mesh.elements.items():
            own = numbers[local_vertices(mesh, shape)]
            for number, local in enumerate(shape.edges if shape.dimension == 2 else shape.faces):
                around = own[owners[entities.members[:, number]] == 1][:, list(local)]
                vertices.append(around.reshape(-1))
                pairs.append(_codes(around, np.roll(around, 1, axis=1), count).reshape(-1))
        every = ranks.exchange([np.unique(np.concatenate(own)) for own in (vertices, pairs)], "the outer boundary")
        touched, edges = (np.unique(np.concatenate(own)) for own in zip(*every, strict=True))
        return _Outer(numbers, count, np.isin(numbers, touched), edges, owners == 1)


def _codes(first: Ints, second: Ints, count: int) -> Ints:
    """One number for each unordered pair of vertices."""
    return pair_numbers(np.minimum(first, second), np.maximum(first, second), count)


def size(patches: Sequence[Patch]) -> float:
    """Approximate size of the data: largest minus smallest coefficient of maps."""
    return _spread(ends(patches))


def ends(patches: Sequence[Patch]) -> list[float]:
    """The smallest and the largest coefficients of maps."""
    every = [patch.geometry_coefficients for patch in patches]
    return [float(end) for own in every for end in (own.min(), own.max())]


def _spread(ends: Sequence[float]) -> float:
    """Maximum minus minimum of some numbers; 1 without any."""
    return max(ends) - min(ends) if ends else 1.0


class _Search(ZeroSearch):
    """The zeros of velocities in elements of a patch.

    ``rows`` and ``xi`` hold the rows and reference coordinates of the zeros.
    """

    def __init__(
        self, dataset: Dataset, evaluator: Evaluator, patch: Patch, zeros: Sequence[Expression], outer: _Outer
    ) -> None:
        super().__init__(patch.shape, max(degree_of(each, evaluator, patch) for each in zeros))
        self.evaluator, self.patch, self.zeros, self.outer = evaluator, patch, zeros, outer
        entities = dataset.mesh.of(patch.shape)
        own = entities.rows_of(patch.element_ids)
        self.vertices, self.members = local_vertices(dataset.mesh, patch.shape)[own], entities.members[own]

    def values(self, rows: Ints, lattice: Floats) -> Floats:
        """The velocity, as required by `ZeroSearch`."""
        places = Lattice(self.patch, rows, lattice)
        found = [np.broadcast_to(value, len(places)) for value in self.evaluator.values_at(self.zeros, places)]
        return np.stack(found, axis=1)

    def is_outer(self, rows: Ints, touched: Bools) -> Bools:
        """(k,) whether places that touch facets (k, f) of elements are on the outer boundary.

        They are on a vertex, an edge or a side, by the vertices that all these facets share.
        """
        shape, numbers = self.patch.shape, self.outer.numbers
        on_facet = heights(shape, shape.vertices) == 0
        is_missed = np.asarray((touched[:, None] & ~on_facet).any(axis=2))
        shared = ~is_missed & touched.any(axis=1, keepdims=True)
        number, own = shared.sum(axis=1), self.vertices[rows]
        first = shared.argmax(axis=1)
        last = shared.shape[1] - 1 - shared[:, ::-1].argmax(axis=1)
        every = np.arange(len(rows))
        pairs = _codes(numbers[own[every, first]], numbers[own[every, last]], self.outer.count)
        found = (number == 1) & self.outer.vertices[own[every, first]]
        found |= (number == 2) & np.isin(pairs, self.outer.pairs)
        for side, local in enumerate(shape.faces if shape.dimension == 3 else ()):
            same = (shared == np.isin(np.arange(shared.shape[1]), local)).all(axis=1)
            found |= same & self.outer.sides[self.members[rows, side]]
        return np.asarray(found)

    def classified(self, slopes: Sequence[Expression]) -> Iterator[CriticalPoint]:
        """The zeros, each with its kind."""
        if not self.rows:
            return
        rows, xi = np.array(self.rows), np.array(self.xi)
        places = ElementPoints(self.patch, rows, xi)
        d = self.patch.shape.dimension
        gradients = np.stack([np.broadcast_to(value, len(rows)) for value in self.evaluator.values_at(slopes, places)])
        for row, place, gradient in zip(rows, places.positions, gradients.T.reshape(-1, d, d), strict=True):
            yield classified(gradient, place, int(self.patch.element_ids[row]))


def classified(gradient: Floats, place: Floats, element: int) -> CriticalPoint:
    """A zero with its kind, from the velocity's gradient (d, d) there.

    Classified by the signs of the eigenvalues' real parts, and by whether some are complex (Chong, Perry and Cantwell,
    Physics of Fluids A 2, 1990).
    """
    x, y, z = map(float, place)
    if not np.isfinite(gradient).all():
        return CriticalPoint("degenerate", 0, (x, y, z), element, ())
    values = np.linalg.eigvals(gradient).astype(complex)
    order = np.lexsort((values.imag, values.real))
    values = values[order]
    neutral = np.abs(values.real) <= _NEUTRAL * np.abs(values).max()
    turning = bool((np.abs(values.imag) > _NEUTRAL * np.abs(values).max()).any())
    index = int(np.sign(np.linalg.det(gradient)))
    if (np.abs(values) <= _NEUTRAL * np.abs(values).max()).any():
        kind, index = "degenerate", 0
    elif neutral.any():
        kind = "centre"
    elif (values.real > 0).all() or (values.real < 0).all():
        kind = ("spiral " if turning else "node ") + ("out" if values.real[0] > 0 else "in")
    else:
        kind = "spiral saddle" if turning else "saddle"
    return CriticalPoint(kind, index, (x, y, z), element, tuple(map(complex, values)))


def _distinct(points: Sequence[CriticalPoint], size: float) -> Iterator[CriticalPoint]:
    """Each place once, in the order of elements; elements that share a side find a zero on it twice."""
    kept: list[CriticalPoint] = []
    places = np.empty((0, 3))
    for point in sorted(points, key=lambda each: each.element):
        if len(kept) and np.abs(places - point.position).max(axis=1).min() <= BEYOND * size:
            continue
        kept.append(point)
        places = np.vstack([places, point.position])
    yield from kept
