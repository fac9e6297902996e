"""Whether two records can come from one camera, judged only by their positions."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, joined_columns
from elvis.reference.record import Record

#: pixels of each record that take part, at most
_SAMPLE = 4000
#: smallest singular value, relative to the largest, above which no camera fits
_MISFIT = 1e-9


def same_camera(first: Record, second: Record) -> bool:
    """Whether one projection maps the positions of both records to their pixels, and one direction gives their depths.

    A projection is a 3 x 4 matrix P with (i, j, 1) ~ P (x, y, z, 1), on a plane a 3 x 3 one.  The direct linear
    transformation (Hartley and Zisserman, Multiple View Geometry, 4.1) has a solution if its system is singular.
    """
    parts = [_sample(record) for record in (first, second)]
    pixels, points, depths = joined_columns(parts)
    if len(points) < 8:
        return True
    depths = (depths - depths.mean()) / (np.abs(points - points.mean(axis=0)).max() or 1.0)
    pixels, points = _normalise(pixels), np.column_stack([_span_coordinates(_normalise(points)), np.ones(len(points))])
    still = np.zeros_like(points)
    rows = [
        np.hstack([points, still, -pixels[:, :1] * points]),
        np.hstack([still, points, -pixels[:, 1:] * points]),
    ]
    return _singular(np.concatenate(rows)) and _singular(np.column_stack([points, depths]))


def _sample(record: Record) -> tuple[Floats, Floats, Floats]:
    """Pixels (n, 2), positions (n, 3) and depths (n,) of some visible pixels, spread evenly."""
    rows, columns = np.nonzero(record.seen & np.isfinite(record.position).all(axis=2) & np.isfinite(record.depth))
    step = max(1, len(rows) // _SAMPLE)
    rows, columns = rows[::step], columns[::step]
    pixels = np.column_stack([columns, rows]).astype(np.float64)
    return pixels, record.position[rows, columns], record.depth[rows, columns]


def _normalise(values: Floats) -> Floats:
    """The values (n, k) about their mean, of size one."""
    centred = values - values.mean(axis=0)
    return np.asarray(centred / (np.abs(centred).max() or 1.0))


def _span_coordinates(points: Floats) -> Floats:
    """The points (n, 3) by coordinates in the plane or line that they span: any camera fits coordinates off it."""
    _, extents, axes = np.linalg.svd(points, full_matrices=False)
    return np.asarray(points @ axes[extents > _MISFIT * extents[0]].T)


def _singular(matrix: Floats) -> bool:
    """Whether the columns of a matrix (n, k) depend on one another."""
    found = np.linalg.svd(matrix, compute_uv=False)
    return bool(len(matrix) < matrix.shape[1] or found[-1] <= _MISFIT * found[0])
