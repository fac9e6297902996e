"""Lines of the curve q = 0 in 2D data: boxes that may meet it, cut into triangles, with zeros on their edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints, starts_of
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.patch import check_not_homogeneous
from elvis.core.triangles.level_cells import cell_blocks
from elvis.core.triangles.surface_triangles import default_tolerance
from elvis.core.triangles.triangulation import cells_within, march, prepared, remarks
from elvis.core.wall_curves.chains import chains


@dataclass(frozen=True, eq=False)
class LevelLines:
    """A curve as polygonal lines, with larger values on their left.

    points    (n, 3) on the curve
    lines     (m, 2) rows of these
    values    (n,) of quantities, by their texts
    distance  maximum distance of lines and curve
    is_bound  whether that is a bound, not an estimate
    remarks   remarks about the computation
    """

    points: Floats
    lines: Ints
    values: dict[str, Floats]
    distance: float
    is_bound: bool
    remarks: tuple[str, ...] = ()

    @property
    def length(self) -> float:
        """Total length of the lines."""
        return float(np.linalg.norm(np.diff(self.points[self.lines], axis=1), axis=2).sum())

    def joined(self) -> tuple[Ints, Ints]:
        """Rows (k,) of points along lines that are as long as possible, and the offsets (lines + 1,) of these."""
        along = []
        for rows, is_reversed, _ in chains(self.lines):
            ends = np.where(is_reversed[:, None], self.lines[rows][:, ::-1], self.lines[rows])
            along.append(np.concatenate([ends[:1, 0], ends[:, 1]]))
        return np.concatenate(along), starts_of(along)


def level_lines(
    dataset: Dataset, curve: str, quantities: Sequence[str] = (), tolerance: float | None = None
) -> LevelLines:
    """The lines of a curve in 2D data.

    curve       ``QUANTITY=VALUE``, ``plane:P:N``, ``sphere:C:R`` or ``cylinder:P:A:R``
    quantities  whose values are requested at the points
    tolerance   distance from the exact curve, in units of the data; by default 1/1000 of the size of the data

    Raises ElvisError for other names, for data that are not in a plane, and for tolerances that need too many lines.

    >>> ds = elvis.read("wave.xml", "wave_1.chk")
    >>> circle = elvis.level_lines(ds, "sphere:0.5,0.5,0:0.3", ["u"])
    >>> bool(abs(circle.length - 0.6 * np.pi) < 1e-3)
    True
    """
    wanted = default_tolerance(dataset, tolerance)
    level, gradient, evaluator = prepared(dataset, curve, quantities, dimension=2)
    check_not_homogeneous(curve, evaluator.patches)
    if not all(patch.is_flat for patch in evaluator.patches):
        raise ElvisError(f"{curve}: expected 2D data in the plane, found a surface in space")
    blocks = list(cell_blocks(evaluator, level))
    cells = cells_within(evaluator, blocks, wanted)
    marched = march(cells, level, curve)
    values = cells.values(marched.nodes, evaluator.expressions[1 + len(gradient) :])
    named = dict(zip(quantities, values, strict=True))
    bounds = np.concatenate([own.leaves.bounds for own in cells.boxes])
    is_bound = all(block.is_exact for block in blocks)
    notes = remarks(bounds[bounds > wanted])
    return LevelLines(cells.positions(marched.nodes), marched.triangles, named, float(bounds.max()), is_bound, notes)
