"""Lines over a picture as curves: contours and the borders of elements, from short lines to long ones.

Places are columns and rows of the picture; integer coordinates are pixel centres.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.scene import Vector

#: ends of short lines that are nearer than this are one, in pixels
SAME = 0.04
#: how far a curve may be from the short lines that it is made of, in pixels
STRAIGHT = 0.005
#: how far from where borders meet the distances to them are those to single ones, in pixels
ROOM = 2.5
#: least change of a distance from pixel to pixel by which a border beyond is found
SLOPE = 0.05


@dataclass(frozen=True, eq=False)
class Stroke:
    """Curves that look alike: polylines (k, 2), of one point where a curve has no size.

    value  of contours; None: borders of elements, outlines
    """

    lines: tuple[Floats, ...]
    width: float
    color: Vector
    opacity: float = 1.0
    value: float | None = None
    labels: bool = False


def chained(starts: Floats, ends: Floats) -> tuple[Floats, ...]:
    """Polylines of short lines (n, 2) to (n, 2) that share ends; where more than two meet, they end."""
    nodes, places = _nodes(np.concatenate([starts, ends]))
    first, second = nodes[: len(starts)], nodes[len(starts) :]
    degree = np.bincount(nodes, minlength=len(places))
    real = np.flatnonzero(first != second)
    pairs = np.unique(np.sort(np.stack([first[real], second[real]], axis=1), axis=1), axis=0)
    dots = np.setdiff1d(first[first == second], pairs)
    chains = [straightened(places[chain]) for chain in _chains(pairs, len(degree))]
    return (*chains, *(places[[dot]] for dot in dots))


def _nodes(points: Floats) -> tuple[Ints, Floats]:
    """Numbers (n,) of nodes, and their places (m, 2): points in one square of a grid are one node, in four grids."""
    numbers, places = np.arange(len(points)), points
    for shift in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5)):
        squares = np.floor(places / SAME + shift).astype(np.int64)
        _, first, inverse = np.unique(squares, axis=0, return_index=True, return_inverse=True)
        numbers, places = inverse.reshape(-1)[numbers], places[first]
    return numbers, places


def _chains(pairs: Ints, count: int) -> Iterator[list[int]]:
    """Nodes one after another, each pair (n, 2) of nodes once: first from ends and branches, then around loops."""
    around: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for number, (one, other) in enumerate(pairs.tolist()):
        around[one].append((number, other))
        around[other].append((number, one))
    free = [True] * len(pairs)
    tips = [node for node in range(count) if len(around[node]) not in (0, 2)]
    for tip in (*tips, *range(count)):
        for pair, other in around[tip]:
            if not free[pair]:
                continue
            free[pair], chain = False, [tip, other]
            while len(around[chain[-1]]) == 2:
                onward = [(pair, node) for pair, node in around[chain[-1]] if free[pair]]
                if not onward:
                    break
                free[onward[0][0]] = False
                chain.append(onward[0][1])
            yield chain


def straightened(line: Floats) -> Floats:
    """A polyline (k, 2) without points that are within STRAIGHT of it all the same: every other one, over and over."""
    close = 0.5 * STRAIGHT
    while len(line) > 2:
        before, here, after = line[:-2:2], line[1:-1:2], line[2::2]
        along = after - before
        length = np.maximum(np.linalg.norm(along, axis=1), 1e-300)
        aside = np.abs(along[:, 0] * (here - before)[:, 1] - along[:, 1] * (here - before)[:, 0]) / length
        forward = np.einsum("nk,nk->n", here - before, along)
        left_out = 1 + 2 * np.flatnonzero((aside < close) & (forward > 0.0) & (forward < length**2))
        if not len(left_out):
            break
        line, close = np.delete(line, left_out, axis=0), 0.5 * close
    return line


def meet_at_corners(lines: tuple[Floats, ...]) -> tuple[Floats, ...]:
    """Borders (k, 2) of elements with better ends where three or more meet.

    Distances to the nearest border say nothing of the other ones beside a vertex: there lines go on as they do ROOM
    away, to the point that is nearest to all of them.
    """
    around: dict[tuple[float, ...], list[tuple[int, bool]]] = {}
    for number, line in enumerate(lines):
        for is_last in (False, True) if len(line) > 1 else ():
            around.setdefault(tuple(line[-is_last]), []).append((number, is_last))
    better = list(lines)
    for place, ends in around.items():
        if len(ends) < 3:
            continue
        shorter = [_without(better[number][:: -1 if is_last else 1]) for number, is_last in ends]
        found = _nearest_to([line for line in shorter if line is not None])
        if found is None or np.linalg.norm(found - place) > ROOM:
            continue
        for (number, is_last), cut in zip(ends, shorter, strict=True):
            whole = better[number][:: -1 if is_last else 1]
            moved = np.concatenate([found[None], whole[1:] if cut is None else cut[0]])
            better[number] = moved[:: -1 if is_last else 1]
    return tuple(better)


def _without(line: Floats) -> tuple[Floats, Floats] | None:
    """A line from ROOM away from its first point on, and its way there; None where it is too short for that."""
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    if length[-1] < 3.0 * ROOM:
        return None
    first, further = (np.array([np.interp(far, length, part) for part in line.T]) for far in (ROOM, 2.0 * ROOM))
    return np.concatenate([first[None], line[length > ROOM]]), further - first


def _nearest_to(lines: list[tuple[Floats, Floats]]) -> Floats | None:
    """(2,) the point nearest to all lines, gone on with straight; None where they have one direction."""
    ways = np.array([way / np.linalg.norm(way) for _, way in lines]).reshape(-1, 2)
    across = np.stack([-ways[:, 1], ways[:, 0]], axis=1)
    matrix = across.T @ across
    if np.linalg.det(matrix) < 1e-2:
        return None
    offsets = np.array([own @ line[0] for own, (line, _) in zip(across, lines, strict=True)])
    return np.asarray(np.linalg.solve(matrix, across.T @ offsets))


def borders(owner: Ints, distance: Floats, depth: Floats) -> tuple[Floats, Floats, Ints]:
    """Short lines between pixels of different owners: starts and ends (n, 2), and the pixel (n,) each lies on.

    owner     (h, w) whose the pixels are, -1 where nothing is
    distance  (h, w) pixels to the nearest border of the owner's element, infinite where that is not known
    depth     (h, w) of two surfaces the nearer one ends here
    Between two centres the border is where the distances from both say; where one side is empty, or another surface
    behind, where the distance goes to zero.  Where more than two owners meet, lines go to the middle.
    """
    wide, across = _crossings(owner, distance, depth)
    tall, down = (found.T for found in _crossings(owner.T, distance.T, depth.T))
    rows, columns = np.indices((owner.shape[0] - 1, owner.shape[1] - 1))
    places = np.stack(
        [
            np.stack([columns + wide[:-1], rows], -1),
            np.stack([columns + wide[1:], rows + 1.0], -1),
            np.stack([columns, rows + tall[:, :-1]], -1),
            np.stack([columns + 1.0, rows + tall[:, 1:]], -1),
        ],
        axis=2,
    )
    crossed = np.stack([across[:-1], across[1:], down[:, :-1], down[:, 1:]], axis=2)
    count = np.count_nonzero(crossed, axis=2)
    nearest = _nearest(owner, depth)

    # two crossings of a square's sides are joined, three and four with their middle
    two, more = np.nonzero(count == 2), np.nonzero(count > 2)
    joined = places[two][crossed[two]].reshape(-1, 2, 2)
    many, which = places[more], crossed[more]
    middle = (many * which[..., None]).sum(axis=1) / which.sum(axis=1)[:, None]
    square, side = np.nonzero(which)
    starts = np.concatenate([joined[:, 0], many[square, side]])
    ends = np.concatenate([joined[:, 1], middle[square]])
    return starts, ends, np.concatenate([nearest[two], nearest[more][square]])


def _crossings(owner: Ints, distance: Floats, depth: Floats) -> tuple[Floats, Bools]:
    """(h, w - 1) where borders cross from one column to the next, from 0 to 1; whether there are any."""
    is_border = owner[:, :-1] != owner[:, 1:]
    left, right = distance[:, :-1], distance[:, 1:]
    start, end = _border_distance(owner, distance), 1.0 - _border_distance(owner[:, ::-1], distance[:, ::-1])[:, ::-1]
    with np.errstate(invalid="ignore", divide="ignore"):
        between = left / (left + right)
        nearer = np.where(depth[:, :-1] <= depth[:, 1:], start, end)
    alone = np.where(owner[:, 1:] < 0, start, np.where(owner[:, :-1] < 0, end, nearer))
    together = (owner[:, :-1] >= 0) & (owner[:, 1:] >= 0) & (left + right <= 1.1) & (left + right > 0.0)
    return np.clip(np.where(together, between, alone), 0.0, 1.0), is_border


def _border_distance(owner: Ints, distance: Floats) -> Floats:
    """(h, w - 1) how far from each column but the last its border is, towards the next; half where unknown."""
    here, slope = distance[:, :-1], np.full(distance[:, :-1].shape, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope[:, 1:] = distance[:, :-2] - distance[:, 1:-1]
        slope[:, 1:][owner[:, :-2] != owner[:, 1:-1]] = np.nan
        far = here / slope
    return np.where((slope > SLOPE) & (far <= 1.0), far, 0.5)


def _nearest(owner: Ints, depth: Floats) -> Ints:
    """(h - 1, w - 1) numbers of the nearest pixel at the corners of each square."""
    height, width = owner.shape
    shown = np.where(owner >= 0, depth, np.inf)
    corners = np.stack([shown[:-1, :-1], shown[:-1, 1:], shown[1:, :-1], shown[1:, 1:]])
    chosen = np.argmin(corners, axis=0)
    rows, columns = np.indices((height - 1, width - 1))
    return np.asarray((rows + chosen // 2) * width + columns + chosen % 2)
