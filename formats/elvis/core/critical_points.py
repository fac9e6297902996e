"""Critical points of a velocity: all places inside of elements where it is zero, isolated by Bernstein bounds.

Elements are images of boxes (`subcells`).  A component has no zero in a box where its Bernstein net has one sign.  Nets
are combined so that the Jacobian at the box's centre becomes the unit matrix, which sharpens that; where the
combination's derivatives stay near the unit matrix all over the box, it has one zero at most, and Newton's method finds
it.  Other boxes are halved.  Where the velocity is zero on all of a side, as on a wall, it is divided by the height
over that side first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.dataset import Dataset
from elvis.core.errors import ElvisError
from elvis.core.integrals.subcells import corners, subcell_map
from elvis.core.mapping.margins import heights
from elvis.core.mapping.orientation import chunks, local_vertices
from elvis.core.patch import Patch
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import all_half_boxes, all_halves, box_degrees, nets_through
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.net_zeros import (
    BEYOND,
    derivatives,
    divided,
    has_no_zero,
    inverses,
    is_injective,
    newton_zeros,
)
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities.element_points import ElementPoints, Lattice
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.levels import same_level
from elvis.core.quantities.tree import AXES, Node, world_derivative
from elvis.core.shapes import Shape
from elvis.core.streamlines.velocity import velocity_expressions

#: elements at once; halvings at most, and beside outer sides, where zeros are no surprise
_CHUNK, _DEPTH, _DEPTH_BESIDE = 256, 14, 7
#: what counts as zero on a side, and how far nets may be off, in parts of the element's greatest coefficient
_ZERO, _ROUNDING = 1e-11, 1e-13
#: eigenvalues whose real part is less than this part of the greatest one have none
_NEUTRAL = 1e-9
#: boxes of an element, after some halvings, that tell of a line or a surface of zeros
_CROWD = 64

#: places (n, d) in [0, 1]^d to reference coordinates (n, d)
_Map = Callable[[Floats], Floats]


@dataclass(frozen=True)
class CriticalPoint:
    """A place where the velocity is zero.

    kind         node in, node out, saddle, spiral in, spiral out, centre, spiral saddle, degenerate
    index        sign of the gradient's determinant: what Poincare-Hopf adds up
    place        (x, y, z)
    element      id of an element that holds it
    eigenvalues  of the velocity's gradient
    """

    kind: str
    index: int
    place: tuple[float, float, float]
    element: int
    eigenvalues: tuple[complex, ...]


@dataclass(frozen=True, eq=False)
class CriticalPoints:
    """All of them.

    points      each once
    undecided   ids of elements in which the search ended before every box was decided, as along a line of zeros
    beside      ids of elements where that happened only beside the outer boundary, within 1/128 of the element
    """

    points: tuple[CriticalPoint, ...]
    undecided: tuple[int, ...]
    beside: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.points)

    def facts(self) -> dict[str, object]:
        """As plain data; eigenvalues as real and imaginary parts."""
        points = []
        for each in self.points:
            values = [[value.real, value.imag] for value in each.eigenvalues]
            points.append({**vars(each), "place": list(each.place), "eigenvalues": values})
        return {"points": points, "undecided": list(self.undecided), "beside": list(self.beside)}


def critical_points(dataset: Dataset, velocity: Sequence[str] | None = None) -> CriticalPoints:
    """All points inside the domain where a velocity is zero; those on the outer boundary are left out.

    velocity  its components; None: what is customary in the data
    ElvisError for components that aren't zero where polynomials are, for surfaces in space and Fourier directions.
    """
    components = velocity_expressions(dataset, velocity)
    zeros = [_numerator(each) for each in components]
    slopes = [
        Expression(f"{each.text}_{AXES[axis]}", world_derivative(each.root, axis))
        for each in components
        for axis in range(len(components))
    ]
    evaluator = Evaluator(dataset, [*zeros, *slopes])
    outer = _Outer.of(dataset)
    found: list[CriticalPoint] = []
    undecided: list[int] = []
    beside: list[int] = []
    for patch in evaluator.patches:
        if patch.periods or patch.shape.dimension != len(components):
            raise ElvisError("expected 2D data in the plane or 3D data, without Fourier directions")
        search = _Search(dataset, evaluator, patch, zeros, outer)
        for rows in chunks(len(patch), _CHUNK):
            search.run(np.arange(len(patch))[rows])
        found += search.classified(slopes)
        undecided += patch.element_ids[sorted(search.undecided)].tolist()
        beside += patch.element_ids[sorted(search.beside - search.undecided)].tolist()
    return CriticalPoints(tuple(_distinct(found, _size(evaluator.patches))), tuple(undecided), tuple(beside))


def _numerator(component: Expression) -> Expression:
    """A polynomial that is zero where a component is; the component itself where none is known."""
    same = same_level(component.root, 0.0)
    if same is None or same.spurious is not None or same.value != 0:
        return component
    return Expression(component.text, same.root)


@dataclass(frozen=True, eq=False)
class _Outer:
    """The outer boundary of a mesh: sides that a single element has.

    vertices  (vertices,) whether vertices are on it
    pairs     sorted codes of the vertices of its edges
    sides     (sides,) which of the mesh's faces, or edges in 2D, are of it
    """

    vertices: Bools
    pairs: Ints
    sides: Bools

    @staticmethod
    def of(dataset: Dataset) -> _Outer:
        """That of a dataset's mesh."""
        mesh = dataset.mesh
        shapes = [shape for shape in mesh.elements if shape.dimension == mesh.dimension]
        owners = np.bincount(np.concatenate([mesh.of(shape).members.reshape(-1) for shape in shapes]))
        vertices, pairs = np.zeros(len(mesh.vertices), bool), [np.empty(0, np.int64)]
        for shape in shapes:
            own, members = local_vertices(mesh, shape), mesh.of(shape).members
            for number, local in enumerate(shape.edges if shape.dimension == 2 else shape.faces):
                around = own[owners[members[:, number]] == 1][:, list(local)]
                vertices[around] = True
                pairs.append(_codes(around, np.roll(around, 1, axis=1), len(vertices)).reshape(-1))
        return _Outer(vertices, np.unique(np.concatenate(pairs)), owners == 1)


def _codes(first: Ints, second: Ints, count: int) -> Ints:
    """One number for each pair of vertices, whatever their order."""
    return np.asarray(np.minimum(first, second) * count + np.maximum(first, second))


def _size(patches: Sequence[Patch]) -> float:
    """Of the data, about: the greatest coefficient of maps less the least."""
    ends = [(p.geometry_coefficients.min(), p.geometry_coefficients.max()) for p in patches]
    return float(max(high for _, high in ends) - min(low for low, _ in ends)) if ends else 1.0


@dataclass(frozen=True, eq=False)
class _Boxes:
    """Boxes in [0, 1]^d: rows (k,) of the patch, ends (k, d), nets (k, d, D, …) and rounding (k, d) of components."""

    rows: Ints
    low: Floats
    high: Floats
    nets: Floats
    rounding: Floats

    def part(self, chosen: Ints | Bools) -> _Boxes:
        """Some of them."""
        return _Boxes(self.rows[chosen], self.low[chosen], self.high[chosen], self.nets[chosen], self.rounding[chosen])

    def halved(self) -> _Boxes:
        """Both halves in every direction."""
        d = self.low.shape[1]
        low, high = all_half_boxes(self.low, self.high)
        nets = all_halves(self.nets.reshape(-1, *self.nets.shape[2:]))
        tiled = np.tile(self.rounding, (2**d, 1))
        return _Boxes(np.tile(self.rows, 2**d), low, high, nets.reshape(-1, *self.nets.shape[1:]), tiled)


class _Search:
    """The zeros of velocities in elements of a patch: ``rows`` and ``xi``, reference coordinates, of what was found."""

    def __init__(
        self, dataset: Dataset, evaluator: Evaluator, patch: Patch, zeros: Sequence[Expression], outer: _Outer
    ) -> None:
        self.evaluator, self.patch, self.zeros, self.outer = evaluator, patch, zeros, outer
        entities = dataset.mesh.of(patch.shape)
        own = entities.rows_of(patch.element_ids)
        self.vertices, self.members = local_vertices(dataset.mesh, patch.shape)[own], entities.members[own]
        self.degree = max(self._degree(each) for each in zeros)
        self.rows: list[int] = []
        self.xi: list[Floats] = []
        self.undecided: set[int] = set()
        self.beside: set[int] = set()

    def _degree(self, expression: Expression) -> int:
        """Of a component in each direction of eta, at least 1."""
        patch = self.patch

        def leaf(node: Node) -> int | None:
            if node.op not in ("coordinate", "field") or (node.axes and node.op == "field"):
                return None
            own = patch.geometry if node.op == "coordinate" else patch.fields[self.evaluator.names.index(node.name)]
            return None if own is None else max(box_degrees(bernstein_space(own)))

        degree = expression.degree(leaf)
        if degree is None:
            raise ElvisError(
                f"{expression.text}: expected a component that is zero where a polynomial of fields and coordinates is"
            )
        return max(degree, 1)

    def run(self, rows: Ints) -> None:
        """Search elements ``rows`` (n,): as a whole, then the parts of those that are left."""
        d = self.patch.shape.dimension
        whole = self._boxes(rows, lambda places: uncollapse(self.patch.shape, 2 * places - 1))
        rows = whole.rows[~has_no_zero(whole.nets, whole.rounding)]
        for cell in range(len(corners(self.patch.shape))):

            def reference(places: Floats, cell: int = cell) -> Floats:
                return subcell_map(self.patch.shape, np.full(len(places), cell), places.reshape(-1, d))[0]

            self._run_in(self._without_walls(self._boxes(rows, reference), reference), reference)

    def _run_in(self, boxes: _Boxes, reference: _Map) -> None:
        """Halve boxes until all are decided."""
        for depth in range(_DEPTH + 1):
            boxes = self._isolated(boxes, reference)
            if not len(boxes.rows):
                return
            if depth >= _DEPTH_BESIDE:
                near = self._is_beside(boxes, reference)
                self.beside.update(boxes.rows[near].tolist())
                boxes = boxes.part(~near)
                boxes = self._without_crowds(boxes)
            if depth < _DEPTH:
                boxes = boxes.halved()
        self.undecided.update(boxes.rows.tolist())

    def _without_crowds(self, boxes: _Boxes) -> _Boxes:
        """Only boxes of elements that have few; where they are many they follow a line or a surface of zeros."""
        rows, which, counts = np.unique(boxes.rows, return_inverse=True, return_counts=True)
        crowded = counts > _CROWD
        self.undecided.update(rows[crowded].tolist())
        return boxes.part(~crowded[which.reshape(-1)])

    def _boxes(self, rows: Ints, reference: _Map) -> _Boxes:
        """The boxes [0, 1]^d that a map takes into elements, but for those at rest or without numbers."""
        d, nodes = self.patch.shape.dimension, (1 + gauss(self.degree + 1)[0]) / 2
        lattice = np.stack(np.meshgrid(*[nodes] * d, indexing="ij"), axis=-1).reshape(-1, d)
        places = Lattice(self.patch, rows, reference(lattice))
        values = [np.broadcast_to(value, len(places)) for value in self.evaluator.values_at(self.zeros, places)]
        table = np.stack(values, axis=1).reshape(len(rows), len(lattice), d).transpose(0, 2, 1)
        nets = nets_through(table.reshape(-1, len(lattice)), nodes, d).reshape(len(rows), d, *(len(nodes),) * d)
        sizes = np.abs(nets).reshape(len(rows), d, len(lattice)).max(axis=2)
        moving = np.isfinite(sizes).all(axis=1) & (sizes.max(axis=1, initial=0.0) > 0)
        self.undecided.update(rows[~moving].tolist())
        low = np.zeros((len(rows), d))
        return _Boxes(rows, low, low + 1, nets, _ROUNDING * sizes).part(moving)

    def _without_walls(self, boxes: _Boxes, reference: _Map) -> _Boxes:
        """Divided by the heights over sides of the boxes where all components are zero.

        The upper side of a pyramid's box is its apex, noted as a zero unless a side that it belongs to is one.
        """
        d, degree = boxes.low.shape[1], self.degree
        nets, on_side = boxes.nets.copy(), np.zeros((len(boxes.rows), d, 2), bool)
        sizes = boxes.rounding.max(axis=1, initial=0.0) / _ROUNDING
        for axis in range(d):
            for end in (0, 1):
                moved = np.moveaxis(nets, 2 + axis, -1)
                moved = moved[..., ::-1] if end else moved
                rest = (
                    np.abs(moved[..., 0]).reshape(len(nets), d * (degree + 1) ** (d - 1)).max(axis=1) <= _ZERO * sizes
                )
                on_side[:, axis, end] = rest
                quotient = divided(moved[rest], degree)
                nets[rest] = np.moveaxis(quotient[..., ::-1] if end else quotient, -1, 2 + axis)
        if self.patch.shape is Shape.PYRAMID:
            alone = on_side[:, -1, 1] & ~on_side[:, :-1].any(axis=(1, 2))
            self._note(boxes.rows[alone], reference(np.tile([0.5, 0.5, 1.0], (int(alone.sum()), 1))))
        return _Boxes(boxes.rows, boxes.low, boxes.high, nets, boxes.rounding)

    def _isolated(self, boxes: _Boxes, reference: _Map) -> _Boxes:
        """The boxes that are left when those without a zero are excluded and single zeros are found."""
        boxes = boxes.part(~has_no_zero(boxes.nets, boxes.rounding))
        d = boxes.low.shape[1]
        centre = np.full((len(boxes.rows), d), 0.5)
        slopes = derivatives(boxes.nets, centre)
        inverse = inverses(slopes)
        unit = np.einsum("kij,kj...->ki...", inverse, boxes.nets)
        rounding = np.einsum("kij,kj->ki", np.abs(inverse), boxes.rounding)
        left = ~has_no_zero(unit, rounding)
        boxes, unit = boxes.part(left), unit[left]
        single = np.flatnonzero(is_injective(unit))
        places, sure = newton_zeros(boxes.nets[single])
        hit = single[sure]
        within = boxes.low[hit] + (boxes.high - boxes.low)[hit] * places[sure].clip(0, 1)
        self._note(boxes.rows[hit], reference(within))
        return boxes.part(np.setdiff1d(np.arange(len(boxes.rows)), hit))

    def _note(self, rows: Ints, xi: Floats) -> None:
        """Keep zeros that are not on the outer boundary."""
        inner = ~self._on_boundary(rows, heights(self.patch.shape, xi) <= BEYOND)
        self.rows += rows[inner].tolist()
        self.xi += list(xi[inner])

    def _is_beside(self, boxes: _Boxes, reference: _Map) -> Bools:
        """(k,) whether boxes touch the outer boundary."""
        d, ends = boxes.low.shape[1], (boxes.low, boxes.high)
        touched = []
        for bits in np.ndindex(*(2,) * d):
            places = np.stack([ends[bit][:, axis] for axis, bit in enumerate(bits)], axis=1)
            touched.append(heights(self.patch.shape, reference(places)) <= BEYOND)
        return np.any([self._on_boundary(boxes.rows, corner) for corner in touched], axis=0)

    def _on_boundary(self, rows: Ints, touched: Bools) -> Bools:
        """(k,) whether places that touch facets (k, f) of elements are on the outer boundary.

        They are on a vertex, an edge or a side, by the vertices that all these facets share.
        """
        shape, count = self.patch.shape, len(self.outer.vertices)
        on_facet = heights(shape, shape.vertices) == 0
        shared = ~(touched[:, None] & ~on_facet).any(axis=2) & touched.any(axis=1)[:, None]
        number, own = shared.sum(axis=1), self.vertices[rows]
        first = shared.argmax(axis=1)
        last = shared.shape[1] - 1 - shared[:, ::-1].argmax(axis=1)
        every = np.arange(len(rows))
        pairs = _codes(own[every, first], own[every, last], count)
        found = (number == 1) & self.outer.vertices[own[every, first]]
        found |= (number == 2) & np.isin(pairs, self.outer.pairs)
        for side, local in enumerate(shape.faces if shape.dimension == 3 else ()):
            same = (shared == np.isin(np.arange(shared.shape[1]), local)).all(axis=1)
            found |= same & self.outer.sides[self.members[rows, side]]
        return np.asarray(found)

    def classified(self, slopes: Sequence[Expression]) -> Iterator[CriticalPoint]:
        """What was found, with its kind."""
        if not self.rows:
            return
        rows, xi = np.array(self.rows), np.array(self.xi)
        places = ElementPoints(self.patch, rows, xi)
        d = self.patch.shape.dimension
        gradients = np.stack([np.broadcast_to(value, len(rows)) for value in self.evaluator.values_at(slopes, places)])
        for row, place, gradient in zip(rows, places.positions, gradients.T.reshape(-1, d, d), strict=True):
            yield _classified(gradient, place, int(self.patch.element_ids[row]))


def _classified(gradient: Floats, place: Floats, element: int) -> CriticalPoint:
    """A zero with its kind, from the velocity's gradient (d, d) there.

    By the signs of the eigenvalues' real parts, and whether some are complex (Chong, Perry and Cantwell, Physics of
    Fluids A 2, 1990).
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
        if len(kept) and np.abs(places - point.place).max(axis=1).min() <= BEYOND * size:
            continue
        kept.append(point)
        places = np.vstack([places, point.place])
    yield from kept
