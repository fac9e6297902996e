"""Contours and mesh lines on hits: from differences between neighbouring pixels where nothing else is known."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.reference.hits import Hits
from elvis.scene import Style, Vector
from elvis.scene.cameras.view import View
from elvis.scene.record.palette import levels


def contour_values(style: Style, ends: tuple[float, float]) -> tuple[float, ...]:
    """The values of a style's contours; a count of them lies within the colour range, evenly or at round values."""
    contours = style.contours
    if contours is None:
        return ()
    low, high = style.range or ends
    return contours.values or tuple(levels(low, high, contours.count or 0, is_round=contours.round).tolist())


def lines(
    hits: Hits, style: Style, quantity: str, view: View, ends: tuple[float, float], contours: Floats | None = None
) -> tuple[tuple[Floats, Vector], ...]:
    """Coverage (n,) and colour of mesh lines, then of contours.

    contours  (n,) coverage by these where it is known otherwise
    """
    found: list[tuple[Floats, Vector]] = []
    if style.mesh_lines:
        found.append((_borders(hits, style.mesh_lines.width, view), style.mesh_lines.color))
    if style.contours and contours is not None:
        found.append((np.where(hits.seen, contours, 0.0), style.contours.color))
    elif style.contours:
        values = hits.values[style.contours.quantity or quantity].reshape(view.height, view.width)
        chosen = contour_values(style, ends)
        found.append((_near(values, chosen, style.contours.width).reshape(-1), style.contours.color))
    return tuple(found)


def _near(values: Floats, chosen: tuple[float, ...], width: float) -> Floats:
    """(h, w) coverage of lines ``width`` pixels wide where values (h, w) are one of those chosen."""
    if min(values.shape) < 2:
        return np.zeros_like(values)
    steep = np.hypot(*np.gradient(values))
    coverage = np.zeros_like(values)
    with np.errstate(invalid="ignore", divide="ignore"):
        for value in chosen:
            coverage = np.fmax(coverage, np.clip(0.5 * width + 0.5 - np.abs(values - value) / steep, 0, 1))
    return coverage


def _borders(hits: Hits, width: float, view: View) -> Floats:
    """(n,) coverage of pixels whose right or lower neighbour is another element."""
    element = hits.element.reshape(view.height, view.width)
    other = np.zeros(element.shape, bool)
    other[:, :-1] |= element[:, :-1] != element[:, 1:]
    other[:-1] |= element[:-1] != element[1:]
    return np.where(other.reshape(-1) & hits.seen, min(1.0, width), 0.0)


def next_to_unseen(hits: Hits, style: Style, view: View) -> Bools:
    """(n,) pixels within the width of contours of others where nothing is met."""
    steps = int(np.ceil(0.5 * style.contours.width + 0.5)) if style.contours else 0
    near = np.pad(~hits.seen.reshape(view.height, view.width), steps, mode="edge")
    for axis, size in ((0, view.height), (1, view.width)):
        near = np.any([near.take(range(k, k + size), axis=axis) for k in range(2 * steps + 1)], axis=0)
    return np.asarray(near.reshape(-1))
