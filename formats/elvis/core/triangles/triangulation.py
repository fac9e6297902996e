"""Triangles of the surface q = 0: boxes that may meet it, cut into tetrahedra, with zeros on their edges.

Each box is bisected until bounds show that its triangles are within the tolerance.  Corners that elements share have
one number, so boxes cut their common faces alike and share the edges of these; on an edge whose ends differ in sign the
zero is found to rounding.  Triangles then meet along common edges wherever q is continuous.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals.levels.of_elements import Level
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.tree import Node, call, negative, number, world_derivative
from elvis.core.shapes import Shape
from elvis.core.triangles.box_nodes import BoxNodes
from elvis.core.triangles.cell_boxes import refined
from elvis.core.triangles.cell_places import CellPlaces, Cells, Marched
from elvis.core.triangles.conforming_boxes import conforming_simplices
from elvis.core.triangles.level_cells import CellBlock, cell_blocks
from elvis.core.triangles.outlines import outer_faces, with_ends
from elvis.core.triangles.stitching import stitched
from elvis.core.triangles.surface_triangles import SurfaceTriangles, default_tolerance
from elvis.core.triangles.tetrahedra import parts_between

#: triangulations until all outlines at jumps are known
_MOST_ROUNDS = 4
#: steps of the search for a zero on an edge
_STEPS = 80
#: shares of the edge at which it ends: the last change, and the next one
_STILL, _STEP = 2e-16, 1e-15


def level_triangles(
    dataset: Dataset, surface: str, quantities: Sequence[str] = (), tolerance: float | None = None
) -> SurfaceTriangles:
    """The triangles of a surface in 3D data.

    surface     ``QUANTITY=VALUE``, ``plane:P:N``, ``sphere:C:R`` or ``cylinder:P:A:R``
    quantities  whose values are requested at the corners
    tolerance   distance from the exact surface, and of outlines from its curves on faces, in units of the data; by
                default 1/1000 of the size of the data

    Raises ElvisError for other names, for data of other dimensions, and for tolerances that need too many triangles.

    >>> ds = elvis.read("wing.xml", "wing.fld")
    >>> cut = elvis.level_triangles(ds, "plane:0,0,0.5:0,0,1", ["p"], tolerance=0.1)
    >>> bool(np.allclose(cut.points[:, 2], 0.5))
    True
    """
    wanted = default_tolerance(dataset, tolerance)
    level, gradient, evaluator = prepared(dataset, surface, quantities)
    outer = outer_faces(dataset, evaluator.patches)
    try:
        found = _with_outlines(evaluator, level, outer, surface, wanted)
        triangles = found.marched.triangles
    except NothingFoundError:
        # zeros count as larger values: a surface at the border of the domain may have only those inside
        opposite = Expression(surface, negative(level.root))
        found = _with_outlines(evaluator, opposite, outer, surface, wanted)
        triangles = found.marched.triangles[:, ::-1]

    values = found.cells.values(found.marched.nodes, evaluator.expressions[1:])
    own = values[len(gradient) :]
    named = dict(zip(quantities, own, strict=True))
    none = np.zeros_like(found.positions)
    made = SurfaceTriangles(found.positions, triangles, none, named, found.distance, found.is_bound)
    normals = _units(values[: len(gradient)].T) if gradient else _means(made)
    made = replace(made, normals=normals, remarks=remarks(found.bounds[found.bounds > wanted]))
    return made.compacted() if found.is_stitched else made


class NothingFoundError(ElvisError):
    """A surface that is not within the data."""


@dataclass(frozen=True, eq=False)
class _Within:
    """Triangles within a tolerance, wherever bounds show that.

    bounds       (n,) of boxes
    is_bound     whether they are bounds, not estimates
    is_stitched  whether some nodes may be unused
    """

    cells: Cells
    marched: Marched
    positions: Floats
    bounds: Floats
    distance: float
    is_bound: bool
    is_stitched: bool


def _with_outlines(
    evaluator: Evaluator, level: Expression, outer: Sequence[Bools], surface: str, wanted: float
) -> _Within:
    """The triangles of a surface, whose outlines at outer faces and at jumps are within the tolerance as well."""
    outlines = outer
    for _ in range(_MOST_ROUNDS):
        blocks = list(cell_blocks(evaluator, level, outlines))
        found = _within(evaluator, level, blocks, surface, wanted)
        known, outlines = outlines, with_ends(outlines, found.cells, found.marched)
        if all(np.array_equal(*pair) for pair in zip(known, outlines, strict=True)):
            break
    return found


def _within(
    evaluator: Evaluator, level: Expression, blocks: Sequence[CellBlock], surface: str, wanted: float
) -> _Within:
    """The triangles of a surface; smaller ones where those next to pyramids move too far."""
    is_bound = all(block.is_exact for block in blocks)
    for within in (wanted, wanted / 2):
        cells = cells_within(evaluator, blocks, within)
        marched = march(cells, level, surface)
        positions = cells.positions(marched.nodes)
        bounds = np.concatenate([own.leaves.bounds for own in cells.boxes])
        marched, moved = without_gaps(cells, marched, positions)
        if moved + float(bounds[bounds <= within].max(initial=0.0)) <= wanted:
            break
    return _Within(cells, marched, positions, bounds, float(bounds.max()) + moved, is_bound, moved > 0)


def without_gaps(cells: Cells, marched: Marched, positions: Floats) -> tuple[Marched, float]:
    """The triangles without gaps next to pyramids, and by how much they have moved at most."""
    if not has_seams({own.shape for own in cells.boxes}):
        return marched, 0.0
    return stitched(cells, marched, positions)


def prepared(
    dataset: Dataset, surface: str, quantities: Sequence[str], dimension: int = 3
) -> tuple[Expression, list[Expression], Evaluator]:
    """The expression that is zero on the surface, its gradient if it has one, and the evaluator for all quantities."""
    if dataset.mesh.dimension != dimension:
        raise ElvisError(f"{surface}: expected {dimension}D data, found {dataset.mesh.dimension}D data")
    known = Level.parse(dataset, surface)
    if known is None:
        forms = "QUANTITY=VALUE, plane:P:N, sphere:C:R or cylinder:P:A:R"
        raise ElvisError(f"expected a surface {forms}, found {surface!r}")
    level = Expression(surface, _without_root(known.expression.root))
    try:
        gradient = [Expression(surface, world_derivative(level.root, axis)) for axis in range(3)]
    except ElvisError:
        gradient = []
    wanted = [Expression.of(dataset, text) for text in quantities]
    return level, gradient, Evaluator(dataset, [level, *gradient, *wanted])


def _without_root(root: Node) -> Node:
    """The root of ``sqrt(f) - c`` with c > 0 as f - c^2: it has the same zeros, but no kink where f is zero."""
    if root.op == "-" and root.operands[0].op == "sqrt" and root.operands[1].value > 0:
        (square,) = root.operands[0].operands
        return call("-", square, number(root.operands[1].value ** 2))
    return root


def cells_within(evaluator: Evaluator, blocks: Sequence[CellBlock], tolerance: float) -> Cells:
    """The boxes whose triangles or lines are within the tolerance, wherever bounds show that."""
    noise = max((block.noise for block in blocks), default=0.0)
    return Cells(evaluator, refined(blocks, tolerance), noise)


def march(cells: Cells, level: Expression, surface: str) -> Marched:
    """Points on the surface, and triangles of these; raises ElvisError if there are none."""
    found = _marched(cells, level) if cells.boxes else None
    if found is None or not len(found.triangles):
        raise NothingFoundError(f"{surface}: expected a surface within the data, found none")
    return found


def _marched(cells: Cells, level: Expression) -> Marched:
    """Points on the surface, and triangles of these."""
    nodes = BoxNodes(cells, level)
    box, simplices = conforming_simplices(nodes)
    places = nodes.places(nodes.keys)
    row, edges = parts_between(nodes.values[nodes.numbers[simplices]] >= 0)

    # triangles by the nodes of boxes, turned where the map from the box is left-handed
    _, first, which = np.unique(box, return_index=True, return_inverse=True)
    is_left = cells.orientations(places.part(simplices[first, 0])) < 0
    numbers = simplices[row[:, None, None], edges]
    turned = is_left[which[row]]
    numbers[turned] = numbers[turned][:, ::-1]

    own = nodes.numbers[numbers]
    kept, triangles, chosen = _nodes(own, nodes.values == 0)
    ends = numbers.reshape(-1, 2)[chosen]
    start, stop = (places.part(ends[:, k]) for k in (0, 1))
    points, t = _on_edges(cells, level, start, stop, nodes.values[nodes.numbers[ends]])

    starts = nodes.numbers[ends[:, 0]]
    shares = _own_shares(own[kept], nodes.values, starts[triangles], t[triangles])
    between = places.place[numbers[kept]]
    corners = between[:, :, 0] + shares[..., None] * (between[:, :, 1] - between[:, :, 0])
    owners = places.part(numbers[kept, 0, 0])
    return Marched(points, triangles, owners.group, owners.row, corners)


def _own_shares(edges: Ints, values: Floats, starts: Ints, shares: Floats) -> Floats:
    """(m, 3) shares of corners of triangles on their own edges (m, 3, 2), between corners with these values.

    starts, shares  (m, 3) the ends at which the edges begin from which the corners were found, and shares on these
    """
    found = np.where(starts != edges[..., 0], 1 - shares, shares)
    is_zero = values[edges] == 0
    return np.where(is_zero[..., 0], 0.0, np.where(is_zero[..., 1], 1.0, found))


def _nodes(edges: Ints, is_zero: Ints) -> tuple[Ints, Ints, Ints]:
    """Triangles of nodes from the edges (k, d, 2) that their corners are on: rows (m,), nodes (m, d).

    Also an edge (n,) of each node.  Edges with a common end on the surface have one node there, and triangles with
    fewer than three nodes vanish.
    """
    keys = np.sort(edges.reshape(-1, 2), axis=1)
    for end in (0, 1):
        here = is_zero[keys[:, end]]
        keys[here, 1 - end] = keys[here, end]
    _, first, flat = np.unique(keys @ [len(is_zero), 1], return_index=True, return_inverse=True)
    triangles = flat.reshape(edges.shape[:2])
    kept = np.flatnonzero((triangles != np.roll(triangles, 1, axis=1)).all(axis=1))
    used, flat = np.unique(triangles[kept], return_inverse=True)
    return kept, flat.reshape(-1, edges.shape[1]), first[used]


def _on_edges(
    cells: Cells, level: Expression, start: CellPlaces, stop: CellPlaces, values: Floats
) -> tuple[CellPlaces, Floats]:
    """The zero between two places in a cell with values (n, 2) of different signs, and its share (n,) of the way."""
    way = stop.place - start.place

    def at(rows: Ints, t: Floats) -> Floats:
        places = CellPlaces(start.group[rows], start.row[rows], start.place[rows] + t[:, None] * way[rows])
        return np.asarray(cells.values(places, [level])[0])

    t = _zeros(at, values[:, 0], values[:, 1])
    return replace(start, place=start.place + t[:, None] * way), t


def _zeros(function: Callable[[Ints, Floats], Floats], first: Floats, last: Floats) -> Floats:
    """(n,) zeros in [0, 1] of functions with values (n,) of different signs at the ends.

    False position that halves the value of an end which stays twice: Dowell and Jarratt 1971, A modified regula falsi.
    """
    brackets = _Brackets(first, last)
    found = np.where(first == 0, 0.0, 1.0)
    open_rows = np.flatnonzero((first != 0) & (last != 0))
    for _ in range(_STEPS):
        guess = brackets.guess(open_rows)
        value = function(open_rows, guess)
        last_step = np.abs(guess - found[open_rows])
        found[open_rows] = guess
        next_step, width = brackets.narrow(open_rows, guess, value)
        open_rows = open_rows[(next_step > _STEP) & (last_step > _STILL) & (width > _STILL)]
        if not len(open_rows):
            break
    return found


class _Brackets:
    """Ends (n,) of intervals in [0, 1], with values of different signs there."""

    def __init__(self, first: Floats, last: Floats) -> None:
        self._low, self._high = np.zeros_like(first), np.ones_like(last)
        self._f_low, self._f_high = first.copy(), last.copy()
        self._stayed = np.zeros(len(first), np.int64)

    def guess(self, rows: Ints) -> Floats:
        """The zeros (k,) of the chords, or the middles of intervals where rounding puts those outside."""
        a, b, fa, fb = self._ends(rows)
        guess = (a * fb - b * fa) / (fb - fa)
        return np.where((guess > a) & (guess < b), guess, (a + b) / 2)

    def narrow(self, rows: Ints, guess: Floats, value: Floats) -> tuple[Floats, Floats]:
        """Take new ends (k,); the steps from these along the chords, and the lengths of the intervals before."""
        a, b, fa, fb = self._ends(rows)
        is_low = (value < 0) == (fa < 0)
        side = np.where(is_low, 1, -1)
        has_stayed = self._stayed[rows] == side
        self._low[rows], self._high[rows] = np.where(is_low, guess, a), np.where(is_low, b, guess)
        self._f_low[rows] = np.where(is_low, value, np.where(has_stayed, fa / 2, fa))
        self._f_high[rows] = np.where(is_low, np.where(has_stayed, fb / 2, fb), value)
        self._stayed[rows] = side
        return np.abs(value) * (b - a) / np.abs(fb - fa), b - a

    def _ends(self, rows: Ints) -> tuple[Floats, Floats, Floats, Floats]:
        return self._low[rows], self._high[rows], self._f_low[rows], self._f_high[rows]


def _units(vectors: Floats) -> Floats:
    """Vectors (n, 3) of unit length; zero vectors are unchanged."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0, length, 1.0))


def _means(found: SurfaceTriangles) -> Floats:
    """(n, 3) unit normals from the normals of the triangles around a point, weighted by area."""
    total = np.zeros_like(found.points)
    np.add.at(total, found.triangles.reshape(-1), np.repeat(found.crosses, 3, axis=0))
    return _units(total)


def has_seams(shapes: set[Shape]) -> bool:
    """Whether elements of these shapes may cut a common face along different lines."""
    return Shape.PYRAMID in shapes and bool(shapes & {Shape.TETRAHEDRON, Shape.PRISM})


def remarks(beyond: Floats) -> tuple[str, ...]:
    """Sentences on places (n,) beyond the tolerance."""
    if not len(beyond):
        return ()
    boxes = f"{len(beyond)} box{'es' if len(beyond) > 1 else ''}"
    return (
        f"in {boxes}, as at tips of pyramids or where the gradient vanishes, the surface is only known to "
        f"{float(beyond.max()):.2g}, the size of the box",
    )
