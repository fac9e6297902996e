"""Curved triangles of the surface q = 0: polynomials of some order, with all of their nodes on the surface.

The nodes of a flat triangle move along the normal of the surface, in the element that holds the triangle.  A side that
two triangles share has one set of nodes, which move in the element of one of them.  Sides at which the surface ends
stay in the face of the element that they lie on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.tree import negative
from elvis.core.triangles.cell_places import CellPlaces, Cells, Marched
from elvis.core.triangles.level_cells import cell_blocks
from elvis.core.triangles.outlines import outer_faces
from elvis.core.triangles.surface_triangles import default_tolerance
from elvis.core.triangles.triangulation import NothingFoundError, cells_within, march, prepared, without_gaps

#: orders of triangles
ORDERS = (2, 10)
#: steps of the secant method; the first step, and the change at which it ends, relative to a box
_STEPS, _FIRST, _STILL = 40, 1e-3, 1e-15
#: refinements at most, and by how much the tolerance of flat triangles falls with each
_REFINEMENTS, _FINER = 6, 4.0
#: Gauss-Newton steps to a point of a face
_STEPS_ON_FACE = 3
#: step of differences of q in a cell
_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class CurvedTriangles:
    """A surface as curved triangles.

    points    (m, k, 3) nodes
    values    (m, k) of quantities there, by their texts
    weights   (k, 3) barycentric coordinates of the nodes
    distance  from the surface, and of outlines from those of the surface, an estimate from points between the nodes
    """

    points: Floats
    values: dict[str, Floats]
    weights: Floats
    distance: float


def curved_triangles(
    dataset: Dataset, surface: str, order: int, quantities: Sequence[str] = (), tolerance: float | None = None
) -> CurvedTriangles:
    """The curved triangles of a surface in 3D data; arguments and errors as in `level_triangles`.

    order  of the polynomials, 2 to 10
    """
    low, high = ORDERS
    if not low <= order <= high:
        raise ElvisError(f"--order: expected an order from {low} to {high}, found {order}")
    wanted = default_tolerance(dataset, tolerance)
    level, _, evaluator = prepared(dataset, surface, quantities)
    try:
        nodes, distance = _refined(dataset, evaluator, level, order, wanted)
        own = nodes.own
    except NothingFoundError:
        # zeros count as larger values: a surface at the border of the domain may have only those inside
        opposite = Expression(surface, negative(level.root))
        nodes, distance = _refined(dataset, evaluator, opposite, order, wanted)
        own = nodes.own[:, _reversed(nodes.weights)]
    values = nodes.cells.values(nodes.places, evaluator.expressions[-len(quantities) :] if quantities else [])
    named = {text: each[own] for text, each in zip(quantities, values, strict=True)}
    return CurvedTriangles(nodes.positions[own], named, nodes.weights, distance)


def _refined(
    dataset: Dataset, evaluator: Evaluator, level: Expression, order: int, wanted: float
) -> tuple[_Nodes, float]:
    """The nodes of triangles that are small enough, and their distance from the surface."""
    blocks = list(cell_blocks(evaluator, level, outer_faces(dataset, evaluator.patches)))
    size = float(np.ptp(dataset.mesh.vertices, axis=0).max())
    # a polynomial of order p deviates in the power p + 1 of its size, a flat triangle in the square
    flat = size * min(0.1, (wanted / size) ** (2 / (order + 1)))
    for _ in range(_REFINEMENTS):
        cells = cells_within(evaluator, blocks, flat)
        marched = march(cells, level, level.text)
        marched, _ = without_gaps(cells, marched, cells.positions(marched.nodes))
        nodes = _Nodes(cells, level, marched, order)
        distance = nodes.distance()
        if distance <= wanted:
            break
        flat /= _FINER
    return nodes, distance


def _reversed(weights: Floats) -> Ints:
    """(k,) the nodes with weights (k, 3) of a triangle in the order of those of its other side."""
    away = np.abs(weights[:, None, [0, 2, 1]] - weights[None]).sum(axis=2)
    return np.asarray(away.argmin(axis=1))


def lattice_weights(order: int) -> Floats:
    """(k, 3) barycentric coordinates of nodes: corners, then those along sides 01, 12 and 20, then the others."""
    corners = np.eye(3)
    along = np.arange(1, order)[:, None] / order
    sides = [(1 - along) * corners[k] + along * corners[(k + 1) % 3] for k in range(3)]
    pairs = [(i, j) for i in range(1, order) for j in range(1, order - i)]
    inner = [[order - i - j, i, j] for i, j in pairs]
    return np.concatenate([corners, *sides, np.array(inner, np.float64).reshape(-1, 3) / order])


class _Nodes:
    """The nodes of triangles, each once.

    weights    (k, 3) of the nodes of a triangle
    places     (n,) of nodes in cells
    positions  (n, 3)
    own        (m, k) the nodes of triangles
    """

    def __init__(self, cells: Cells, level: Expression, marched: Marched, order: int) -> None:
        self.cells, self.level, self.marched = cells, level, marched
        self.weights = lattice_weights(order)
        count = len(marched.triangles)
        on_side = order - 1
        inner = len(self.weights) - 3 - 3 * on_side

        # the first triangle at each side has its nodes, in the order of its own corners
        sides = np.stack([marched.triangles, np.roll(marched.triangles, -1, axis=1)], axis=2).reshape(-1, 2)
        _, first, side, uses = np.unique(
            np.sort(sides, axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
        )
        is_turned = sides[:, 0] != sides[first[side], 0]
        start = len(marched.nodes)
        row = start + side[:, None] * on_side + np.arange(on_side)
        row[is_turned] = row[is_turned][:, ::-1]
        start += len(first) * on_side
        inside = start + np.arange(count * inner).reshape(count, inner)
        self.own: Ints = np.concatenate([marched.triangles, row.reshape(count, -1), inside], axis=1)

        # sides at which the surface ends
        self._ends = first[uses == 1]
        own_sides = self._side_nodes(first // 3, first % 3, on_side, uses == 1)
        own_inner = self._inner_nodes(self.weights[len(self.weights) - inner :])
        parts = [marched.nodes, own_sides, own_inner]
        self.places = CellPlaces(*(np.concatenate([getattr(p, n) for p in parts]) for n in ("group", "row", "place")))
        self.positions = cells.positions(self.places)

    def _corners(self, rows: Ints) -> tuple[CellPlaces, Floats]:
        """The cells of triangles, and places (k, 3, 3) of their corners in these."""
        own = self.marched
        return CellPlaces(own.group[rows], own.row[rows], own.places[rows, 0]), own.places[rows]

    def _side_nodes(self, rows: Ints, side: Ints, count: int, is_border: Bools) -> CellPlaces:
        """Nodes along sides of triangles ``rows``; those of borders move within faces of cells."""
        weights = np.arange(1, count + 1) / (count + 1)
        cells, places, is_on_face = self._along(rows, side, weights)
        return self._moved(cells, places, is_border[:, None] & is_on_face)

    def _along(self, rows: Ints, side: Ints, weights: Floats) -> tuple[CellPlaces, Floats, Bools]:
        """The cells of triangles ``rows`` (n,), and places (n, k, 3) along their sides with weights (k,) of the end.

        Also which coordinates (n, 3) of cells are 0 or 1 along these, as the sides lie on faces of cells.
        """
        cells, corners = self._corners(rows)
        ends = corners[np.arange(len(rows))[:, None], np.stack([side, (side + 1) % 3], axis=1)]
        places = ends[:, :1] + weights[:, None] * (ends[:, 1:] - ends[:, :1])
        return cells, places, (ends == 0).all(axis=1) | (ends == 1).all(axis=1)

    def _inner_nodes(self, weights: Floats) -> CellPlaces:
        """Nodes inside all triangles."""
        rows = np.arange(len(self.marched.triangles))
        cells, corners = self._corners(rows)
        places = np.einsum("kc,ncx->nkx", weights, corners)
        return self._moved(cells, places, np.zeros((len(rows), 3), bool))

    def _moved(self, cells: CellPlaces, places: Floats, is_fixed: Bools) -> CellPlaces:
        """Places (n, k, 3) in cells (n,) moved onto the surface along its normal, by the secant method.

        is_fixed  (n, 3) which coordinates of cells don't change
        """
        count = places.shape[1]
        start = CellPlaces(np.repeat(cells.group, count), np.repeat(cells.row, count), places.reshape(-1, 3))
        along = np.where(np.repeat(is_fixed, count, axis=0), 0.0, self._normals(start))

        def at(rows: Ints, t: Floats) -> Floats:
            here = CellPlaces(start.group[rows], start.row[rows], start.place[rows] + t[:, None] * along[rows])
            return np.asarray(self.cells.values(here, [self.level])[0])

        moving = np.arange(len(start))
        last, t = np.zeros(len(start)), np.full(len(start), _FIRST)
        last_value = at(moving, last)
        for _ in range(_STEPS):
            if not len(moving):
                break
            value = at(moving, t[moving])
            with np.errstate(all="ignore"):
                step = -value * (t[moving] - last[moving]) / (value - last_value[moving])
            step = np.where(np.isfinite(step), step, 0.0)
            last[moving], last_value[moving] = t[moving], value
            t[moving] += step
            moving = moving[np.abs(step) > _STILL]
        # a node that would leave its box stays on the flat triangle
        t[~(np.abs(t) <= 1)] = 0.0
        return CellPlaces(start.group, start.row, start.place + t[:, None] * along)

    def _normals(self, places: CellPlaces) -> Floats:
        """(n, 3) vectors in cells that the map takes to normals of the surface, of about the length of the cell."""
        jacobians, gradients = self._gradients(places)
        found = np.linalg.solve(jacobians, gradients[..., None])[..., 0]
        return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-300))

    def _gradients(self, places: CellPlaces) -> tuple[Floats, Floats]:
        """Derivatives (n, 3, 3) of the map of cells to the world, and the gradients (n, 3) of q in the world."""
        jacobians = np.empty((len(places), 3, 3))
        for here, points, columns in self.cells.points(places):
            jacobians[here] = points.jacobians @ columns
        steps = _STEP * np.eye(3)
        ends = [(self._at(places, places.place + step), self._at(places, places.place - step)) for step in steps]
        slopes = np.stack([(after - before) / (2 * _STEP) for after, before in ends], axis=1)
        return jacobians, np.linalg.solve(np.swapaxes(jacobians, 1, 2), slopes[..., None])[..., 0]

    def distance(self) -> float:
        """The largest distance of triangles and outlines from the exact ones, between nodes, to first order."""
        order = round(1 / self.weights[self.weights > 0].min())
        points = lattice_weights(order + 1)
        basis = _lagrange(self.weights, points)
        goals = np.einsum("qk,mkx->mqx", basis, self.positions[self.own]).reshape(-1, 3)
        cells, corners = self._corners(np.arange(len(self.own)))
        guess = np.einsum("qc,mcx->mqx", points, corners).reshape(-1, 3)
        count = len(points)
        places = CellPlaces(np.repeat(cells.group, count), np.repeat(cells.row, count), guess)
        return max(self._largest(places, goals), self._outline_distance(order))

    def _outline_distance(self, order: int) -> float:
        """The largest distance of sides at which the surface ends from its curves on faces of cells."""
        weights = np.arange(1, 2 * order + 2) / (2 * order + 2)
        rows, side = self._ends // 3, self._ends % 3
        cells, guess, is_fixed = self._along(rows, side, weights)
        goals = np.empty_like(guess)
        for slot in range(3):
            here = side == slot
            start, stop = np.eye(3)[[slot, (slot + 1) % 3]]
            basis = _lagrange(self.weights, start + weights[:, None] * (stop - start))
            goals[here] = np.einsum("qk,mkx->mqx", basis, self.positions[self.own[rows[here]]])

        is_on_face = is_fixed.any(axis=1)
        if not is_on_face.any():
            return 0.0
        count = len(weights)
        group, row = (np.repeat(own[is_on_face], count) for own in (cells.group, cells.row))
        places = CellPlaces(group, row, guess[is_on_face].reshape(-1, 3))
        return self._off_curve(places, goals[is_on_face].reshape(-1, 3), np.repeat(is_fixed[is_on_face], count, axis=0))

    def _off_curve(self, places: CellPlaces, goals: Floats, is_fixed: Bools) -> float:
        """The largest distance of positions (n, 3) from the curves q = 0 on faces of cells, near places on these.

        Gauss-Newton steps lead to the nearest points of the faces; from there it is |q| / |gradient| along the face.
        """
        for _ in range(_STEPS_ON_FACE):
            away, tangents, _ = self._at_face(places, goals, is_fixed)
            step = (np.linalg.pinv(tangents) @ away[..., None])[..., 0]
            places = replace(places, place=places.place + step)
        away, tangents, gradient = self._at_face(places, goals, is_fixed)
        along = tangents @ np.linalg.pinv(tangents) @ gradient[..., None]
        with np.errstate(all="ignore"):
            far = np.abs(self._at(places, places.place)) / np.linalg.norm(along[..., 0], axis=1)
        return float(np.nanmax(np.hypot(np.linalg.norm(away, axis=1), far), initial=0.0))

    def _at_face(self, places: CellPlaces, goals: Floats, is_fixed: Bools) -> tuple[Floats, Floats, Floats]:
        """The ways (n, 3) to positions, the tangents of faces as columns (n, 3, 3), and gradients (n, 3) of q."""
        jacobians, gradients = self._gradients(places)
        tangents = np.where(is_fixed[:, None, :], 0.0, jacobians)
        return goals - self.cells.positions(places), tangents, gradients

    def _largest(self, places: CellPlaces, goals: Floats) -> float:
        """The largest |q| / |grad q| at positions (n, 3) near places in cells."""
        found = self.cells.located(places, goals)
        values = self._at(found, found.place)
        with np.errstate(all="ignore"):
            far = np.abs(values) / np.linalg.norm(self._gradients(found)[1], axis=1)
        return float(np.nanmax(far, initial=0.0))

    def _at(self, places: CellPlaces, where: Floats) -> Floats:
        """(n,) values of q at places (n, 3) in the cells of others."""
        return np.asarray(self.cells.values(CellPlaces(places.group, places.row, where), [self.level])[0])


def _lagrange(nodes: Floats, points: Floats) -> Floats:
    """(q, k) polynomials that are 1 at one of the nodes (k, 3) and 0 at the others, at points (q, 3)."""
    order = round(1 / nodes[nodes > 0].min())
    powers = [(i, j) for i in range(order + 1) for j in range(order + 1 - i)]

    def monomials(weights: Floats) -> Floats:
        return np.stack([weights[:, 1] ** i * weights[:, 2] ** j for i, j in powers], axis=1)

    return np.asarray(np.linalg.solve(monomials(nodes).T, monomials(points).T).T)
