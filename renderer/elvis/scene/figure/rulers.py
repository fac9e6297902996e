"""World coordinates in a picture: ticks next to it or along the domain's box, edges of the box, scale bars.

Positions are columns and rows of the picture, as in elvis.scene.record.strokes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.scene import Camera
from elvis.scene.cameras.view import View
from elvis.scene.figure.picture import labels
from elvis.scene.record.frame import Frame, Ordinate
from elvis.scene.record.palette import ticks

#: how near to 1 a component of a direction along an axis is
ALONG = 1e-12
#: most ticks along the edge of a box
MOST = 5


@dataclass(frozen=True, eq=False)
class Ruler:
    """A line with ticks: at places (k, 2), with texts, that point in a direction (2,) away from the picture."""

    name: str
    line: Floats
    places: Floats
    texts: tuple[str, ...]
    away: Floats


def aligned(camera: Camera) -> tuple[int, int] | None:
    """The axes along columns and rows, where the camera is parallel and looks along the third."""
    right, up, _ = camera.basis()
    across, upward = int(np.argmax(np.abs(right))), int(np.argmax(np.abs(up)))
    straight = min(abs(right[across]), abs(up[upward])) > 1.0 - ALONG
    return (across, upward) if straight and camera.fov is None else None


def sides(view: View, most: tuple[int, int], ordinate: Ordinate | None = None) -> tuple[Ruler, Ruler]:
    """The rulers below and to the left of an aligned view, with n ticks at most."""
    axes = aligned(view.camera)
    assert axes is not None
    origin = np.asarray(view.camera.eye) + view.corner
    width, height = view.width, view.height
    corner, right, top = np.array([-0.5, height - 0.5]), np.array([width - 0.5, height - 0.5]), np.array([-0.5, -0.5])
    found = []
    for number, (axis, end) in enumerate(zip(axes, (right, top), strict=True)):
        step = (view.column, view.row)[number][axis]
        start, name = float(origin[axis]), "xyz"[axis]
        if ordinate is not None and number == 1:
            start, step, name = ordinate.base + start / ordinate.scale, step / ordinate.scale, ordinate.name
        low, high = sorted(float(start + step * place[number]) for place in (corner, end))
        marked = ticks(low, high, most[number])
        places = np.repeat(corner[None], len(marked), axis=0)
        places[:, number] = (np.array(marked) - start) / step
        away = np.array([0.0, 1.0]) if number == 0 else np.array([-1.0, 0.0])
        found.append(Ruler(name, np.array([corner, end]), places, tuple(labels(marked)), away))
    return found[0], found[1]


def edges_of(box: Floats) -> Iterator[tuple[int, Floats]]:
    """The axis and ends (2, 3) of each edge of a box (2, 3); flat boxes have fewer."""
    axes = [axis for axis in range(3) if box[1, axis] > box[0, axis]]
    for axis in axes:
        others = [other for other in axes if other != axis]
        for chosen in range(1 << len(others)):
            ends = box[[0, 0]].copy()
            ends[1, axis] = box[1, axis]
            for k, other in enumerate(others):
                ends[:, other] = box[chosen >> k & 1, other]
            yield axis, ends


def seen_of(view: View, points: Floats) -> Floats:
    """(n, 2) columns and rows of world points (n, 3), NaN behind the eye."""
    rows = view.projected(points)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(rows[:, 2:] > 0.0, rows[:, :2] / rows[:, 2:], np.nan)


def box_edges(frame: Frame) -> list[Floats]:
    """Visible parts of the edges of the domain's box: polylines (k, 2)."""
    assert frame.box is not None
    found = []
    for _, ends in edges_of(frame.box):
        length = np.linalg.norm(np.diff(seen_of(frame.view, ends), axis=0))
        count = int(np.clip(np.nan_to_num(length, nan=1e3), 2, 1e4)) + 1
        points = ends[0] + np.linspace(0.0, 1.0, count)[:, None] * (ends[1] - ends[0])
        free = np.flatnonzero(~is_hidden(frame.view, frame.depth, points))
        places = seen_of(frame.view, points)
        runs = np.split(free, np.flatnonzero(np.diff(free) > 1) + 1)
        found += [places[[run[0], run[-1]]] for run in runs if len(run) > 1]
    return found


def is_hidden(view: View, depths: Floats, points: Floats) -> Bools:
    """(n,) whether something is seen before world points (n, 3), by more than pixels are wide.

    depths  (h, w) of the picture
    """
    places, depth = seen_of(view, points), view.depth_of(points)
    within = np.abs(places - [0.5 * (view.width - 1), 0.5 * (view.height - 1)]) < [0.5 * view.width, 0.5 * view.height]
    inside = within.all(axis=1)
    pixel = np.rint(places[inside]).astype(int)
    wide = np.linalg.norm(view.column) * (depth if view.perspective else np.ones_like(depth))
    hidden = np.asarray(np.isnan(places).any(axis=1))
    hidden[inside] = depths[pixel[:, 1], pixel[:, 0]] < (depth - 4.0 * wide)[inside]
    return hidden


def box_rulers(frame: Frame) -> list[Ruler]:
    """A ruler for each axis along an edge of the box that is a silhouette: the lowest one, or the leftmost."""
    assert frame.box is not None
    view, box = frame.view, frame.box
    middle = seen_of(view, box.mean(axis=0, keepdims=True))[0]
    best: dict[int, tuple[float, Floats, Floats]] = {}
    for axis, ends in edges_of(box):
        line = seen_of(view, ends)
        along = line[1] - line[0]
        if not np.isfinite(line).all() or np.linalg.norm(along) < 20.0 or not _is_silhouette(view, box, axis, ends):
            continue
        centre = line.mean(axis=0)
        rank = centre[1] if abs(along[0]) > abs(along[1]) else -centre[0]
        if axis not in best or rank > best[axis][0]:
            best[axis] = rank, ends, line
    return [_ruler(view, axis, ends, line, middle) for axis, (_, ends, line) in sorted(best.items())]


def _ruler(view: View, axis: int, ends: Floats, line: Floats, middle: Floats) -> Ruler:
    """The ruler along an edge."""
    along = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
    away = np.array([along[1], -along[0]])
    away = away if away @ (line.mean(axis=0) - middle) > 0.0 else -away
    marked = ticks(ends[0, axis], ends[1, axis], MOST)
    points = np.repeat(ends[:1], len(marked), axis=0)
    points[:, axis] = marked
    return Ruler("xyz"[axis], line, seen_of(view, points), tuple(labels(marked)), away)


def _is_silhouette(view: View, box: Floats, axis: int, ends: Floats) -> bool:
    """Whether one of the two sides of a box at an edge faces the eye and the other does not."""
    middle = box.mean(axis=0)
    towards = view.camera.basis()[2]
    if view.perspective:
        towards = ends.mean(axis=0) - np.asarray(view.camera.eye)
    faced = [towards[other] * (ends[0, other] - middle[other]) < 0.0 for other in range(3) if other != axis]
    return len(set(faced)) == 2 or bool(np.any(box[0] == box[1]))


def scale_bar(view: View, most: float) -> tuple[float, str]:
    """Pixels and text of a round length, in a parallel view: at most n pixels."""
    pixel = float(np.linalg.norm(view.column))
    power = 10.0 ** np.floor(np.log10(most * pixel))
    length = max(factor * power for factor in (1.0, 2.0, 5.0) if factor * power <= most * pixel * (1 + 1e-12))
    return length / pixel, f"{length:.6g}"
