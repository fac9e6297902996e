"""Curves on walls for pictures: polynomials of one parameter in the world and in the elements."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.locate import Locator
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.streamlines.course import diagonal
from elvis.core.streamlines.lines.pieces import DEVIATION, NODES, Curves, Pieces, check_count, series_through
from elvis.core.wall_curves.curve import WallCurve, curves_with, is_wall_curve

#: maximum number of bisections of a part of a segment
_HALVINGS = 8


def drawn_curves(dataset: Dataset, name: str) -> Curves:
    """The curves of a name, each element's part as polynomials of degree 7; their parameter of time is the length.

    Parameters
    ----------
    dataset : Dataset
        The data; fields are not used.
    name : str
        ``boundary:NAME`` or ``section:NAME:plane:P:N`` (see `wall_curves`).

    Raises
    ------
    ElvisError
        If the name is not a curve on a wall, or the curve does not exist.
    """
    if not is_wall_curve(name):
        raise ElvisError(f"along: expected boundary:NAME or section:NAME:plane:P:N, found {name!r}")
    evaluator = Evaluator(dataset, [])
    curves = curves_with(dataset, name, evaluator)
    size = diagonal(Locator(evaluator.patches))
    parts = [part for line, own in enumerate(curves) for part in _parts(own, line, DEVIATION * size)]
    pieces = Pieces.joined(parts)
    check_count(len(pieces))
    return Curves(pieces, len(curves), {}, size)


def _parts(curve: WallCurve, line: int, most: float) -> Iterator[Pieces]:
    """A curve's segments, bisected until polynomials deviate by ``most`` at most."""
    low = np.arange(len(curve.row), dtype=np.float64)
    high = low + 1
    for halving in range(_HALVINGS + 1):
        if not len(low):
            return
        made = _fitted(curve, line, low, high)
        is_done = (made.deviation <= most) | (halving == _HALVINGS)
        yield made.part(np.flatnonzero(is_done))
        low, high = low[~is_done], high[~is_done]
        middle = (low + high) / 2
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])


def _fitted(curve: WallCurve, line: int, low: Floats, high: Floats) -> Pieces:
    """Polynomials through points of the curve between parameters (n,) and (n,) of the same segments."""
    count = len(low)
    # the last node is below 1, so that no point belongs to the next segment
    t = (low[:, None] + (high - low)[:, None] * NODES).reshape(-1)
    reference, element = curve.references(t)
    points, deviation = series_through(curve.curve.at(t)[0].reshape(count, len(NODES), 3))
    places, _ = series_through(reference.reshape(count, len(NODES), 3))
    ends = curve.curve.lengths_at(np.stack([low, high]))
    lengths = np.zeros((count, points.shape[1]))
    lengths[:, 0], lengths[:, 1] = ends.mean(axis=0), (ends[1] - ends[0]) / 2
    numbers = np.full(count, line)
    return Pieces(points, places, element.reshape(count, -1)[:, 0], deviation, numbers, ends.T, lengths)
