"""Linear cells instead of elements, for programs that support no others, with their error.

Every element is cut uniformly; corners of cells have the exact positions and values, and belong to one element, so
jumps are preserved.  The interpolation within cells is compared with the data inside every cell.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from elvis.core.base.arrays import Floats, Ints, every_pair, joined_floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping import pointwise
from elvis.core.mapping.cutting import Template, template
from elvis.core.mapping.patch import Patch
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.shapes import Shape
from elvis.plugins.conversion.exporting import Loss

#: places in every cell at which it is compared with the data
_CHECKS = 3
#: points that are evaluated together
_AT_ONCE = 1 << 18
#: cells along a Fourier direction, at least, before they are cut
_FEWEST = 4
#: for each shape, the shape of its cells along one more coordinate; for each of their vertices, its original vertex,
#: and whether it lies above
_EXTRUDED = {
    Shape.SEGMENT: (Shape.QUADRILATERAL, (0, 1, 1, 0), (0, 0, 1, 1)),
    Shape.TRIANGLE: (Shape.PRISM, (0, 1, 1, 0, 2, 2), (1, 1, 0, 0, 1, 0)),
    Shape.QUADRILATERAL: (Shape.HEXAHEDRON, (0, 1, 2, 3, 0, 1, 2, 3), (0, 0, 0, 0, 1, 1, 1, 1)),
}
#: most times that elements are bisected
HIGHEST = 8


@dataclass(eq=False)
class LinearCells:
    """Cells by shape, their corners in the order of `Shape.vertices`.

    points   (n, 3)   world coordinates
    values   (n,)     of each quantity at the points
    cells    (m, v)   points of the cells of each shape
    element  (m,) id of the element that contains each of these
    losses   for the coordinates, then for each quantity
    """

    points: Floats
    values: Mapping[str, Floats]
    cells: Mapping[Shape, Ints]
    element: Mapping[Shape, Ints]
    losses: Sequence[Loss]


@dataclass(eq=False)
class _Parts:
    """The results for patches, one after another."""

    count: int = 0
    points: list[Floats] = field(default_factory=list)
    values: list[list[Floats]] = field(default_factory=list)
    cells: dict[Shape, list[Ints]] = field(default_factory=dict)
    element: dict[Shape, list[Ints]] = field(default_factory=dict)


def linear_cells(dataset: Dataset, quantities: str | Sequence[str] | None, refinement: int) -> LinearCells:
    """The dataset as linear cells, with every element cut into 2^refinement cells along an edge.

    quantities  as in `sample`
    A period along a Fourier direction has as many cells as planes, or _FEWEST, each cut in the same way.  Raises
    ElvisError for unknown quantities.
    """
    if not 0 <= refinement <= HIGHEST:
        raise ElvisError(f"expected a refinement from 0 to {HIGHEST}, found {refinement}")
    names = Names.of(dataset)
    texts = names.fields if quantities is None else [quantities] if isinstance(quantities, str) else list(quantities)
    evaluator = Evaluator(dataset, [Expression.parse(text, names) for text in texts])
    parts, losses = _Parts(values=[[] for _ in texts]), [Loss("coordinates", 1), *(Loss(text, 1) for text in texts)]
    for patch in evaluator.patches:
        _add(parts, losses, evaluator, patch, _cut(patch, refinement))
    return LinearCells(
        np.concatenate([np.empty((0, 3)), *parts.points]),
        {text: joined_floats(own) for text, own in zip(texts, parts.values, strict=True)},
        {shape: np.concatenate(own) for shape, own in parts.cells.items()},
        {shape: np.concatenate(own) for shape, own in parts.element.items()},
        losses,
    )


def _cut(patch: Patch, refinement: int) -> Template:
    """The cells of a patch's elements, also along Fourier directions."""
    cut, homogeneous = template(patch.shape, refinement), patch.homogeneous
    ids = () if homogeneous is None else (homogeneous.y_ids, homogeneous.z_ids)[-len(patch.periods) :]
    for own in ids:
        cut = _extruded(cut, max(_FEWEST, len(set(own))) << refinement)
    return cut


def _extruded(cut: Template, layers: int) -> Template:
    """Cells between copies of the points at ``layers`` + 1 places of one more coordinate, from -1 to 1."""
    count = len(cut.points)
    zeta = np.repeat(np.linspace(-1.0, 1.0, layers + 1), count)
    cells = {}
    for shape, rows in cut.cells.items():
        made, corners, above = _EXTRUDED[shape]
        ends = rows[:, corners] + count * np.array(above)
        cells[made] = (count * np.arange(layers)[:, None, None] + ends).reshape(-1, len(corners))
    return Template(np.column_stack([np.tile(cut.points, (layers + 1, 1)), zeta]), cells)


def _add(parts: _Parts, losses: Sequence[Loss], evaluator: Evaluator, patch: Patch, cut: Template) -> None:
    """The elements of a patch as cells, some at a time, and their errors."""
    for rows in _batches(len(patch), max(len(cut.points), _CHECKS * sum(map(len, cut.cells.values())))):
        own = _evaluated(evaluator, patch, rows, cut.points)
        for shape, cells in cut.cells.items():
            starts = parts.count + np.arange(len(rows))[:, None, None] * len(cut.points)
            parts.cells.setdefault(shape, []).append((starts + cells).reshape(-1, cells.shape[1]))
            ids = np.repeat(patch.element_ids[rows], len(cells))
            parts.element.setdefault(shape, []).append(ids)
            weights = _weights(shape)
            inside = np.einsum("sv,cvd->csd", weights, cut.points[cells]).reshape(-1, patch.dimension)
            exact = _evaluated(evaluator, patch, rows, inside)
            for loss, table, true in zip(losses, own, exact, strict=True):
                found = np.einsum("sv,ncvk->ncsk", weights, table[:, cells])
                loss.note(patch.element_ids[rows], true.reshape(len(rows), -1), found.reshape(len(rows), -1))
        parts.count += len(rows) * len(cut.points)
        parts.points.append(own[0].reshape(-1, 3))
        for column, table in zip(parts.values, own[1:], strict=True):
            column.append(table.reshape(-1))


def _evaluated(evaluator: Evaluator, patch: Patch, rows: Ints, points: Floats) -> list[Floats]:
    """Places (n, m, 3), and values (n, m, 1) of each quantity, at reference points (m, d) of elements (n,)."""
    every, where = every_pair(rows, points)
    shape = (len(rows), len(points), -1)
    values = [evaluator.values(each, patch, every, where).reshape(shape) for each in evaluator.expressions]
    return [pointwise.positions(patch, every, where).reshape(shape), *values]


def _weights(shape: Shape) -> Floats:
    """(_CHECKS, v) values of the functions of a cell's corners at places inside of it."""
    rng = np.random.default_rng(0)
    if len(shape.vertices) == shape.dimension + 1:
        return rng.dirichlet(np.ones(shape.dimension + 1), _CHECKS)
    x = rng.uniform(-0.9, 0.9, (_CHECKS, shape.dimension))
    if shape is Shape.PYRAMID:
        base = np.prod((1 + x[:, None, :2] * shape.vertices[:4, :2]) / 2, axis=2)
        low = (1 - x[:, 2:]) / 2
        return np.column_stack([low * base, 1 - low])
    if shape is Shape.PRISM:
        # a triangle in the first and third coordinate, along the second
        corners = rng.dirichlet(np.ones(3), _CHECKS)
        which = 1 * (shape.vertices[:, 0] > 0) + 2 * (shape.vertices[:, 2] > 0)
        return np.asarray(corners[:, which] * (1 + x[:, 1:2] * shape.vertices[:, 1]) / 2)
    return np.asarray(np.prod((1 + x[:, None] * shape.vertices) / 2, axis=2))


def _batches(count: int, points: int) -> Iterator[Ints]:
    step = max(1, _AT_ONCE // points)
    for first in range(0, count, step):
        yield np.arange(first, min(first + step, count))
