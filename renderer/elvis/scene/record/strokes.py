"""Lines over a picture as curves: contours and the borders of elements, from short lines to long ones.

Places are columns and rows of the picture; integer coordinates are pixel centres.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.scene import Vector

#: ends of short lines that are nearer than this are one, in pixels
SAME = 0.04
#: maximum distance of a curve from its short lines, in pixels
STRAIGHT = 0.005
#: how far from where borders meet the distances to them are those to single ones, in pixels
ROOM = 2.5
#: smallest change of a distance from pixel to pixel by which a border beyond is found
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


@dataclass(frozen=True, eq=False)
class Segments:
    """Short lines that look alike, in no order: starts and ends (n, 2), and depths (n, 2) of both."""

    starts: Floats
    ends: Floats
    depths: Floats
    width: float
    color: Vector
    opacity: float


def chain(starts: Floats, ends: Floats) -> tuple[Floats, ...]:
    """Polylines of short lines (n, 2) to (n, 2) that share ends; where more than two meet, they end."""
    nodes, places = _nodes(np.concatenate([starts, ends]))
    first = nodes[: len(starts)]
    second = nodes[len(starts) :]

    # distinct lines, and points where lines without a length are all there is
    is_line = first != second
    lines = np.stack([first[is_line], second[is_line]], axis=1)
    pairs = np.unique(np.sort(lines, axis=1), axis=0)
    dots = np.setdiff1d(first[~is_line], pairs)

    polylines = [simplify(places[along]) for along in _chains(pairs, len(places))]
    return (*polylines, *(places[[dot]] for dot in dots))


def _nodes(points: Floats) -> tuple[Ints, Floats]:
    """Numbers (n,) of nodes, and their places (m, 2): points in one square of a grid are one node, in four grids."""
    numbers = np.arange(len(points))
    places = points
    for shift in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5)):
        squares = np.floor(places / SAME + shift).astype(np.int64)
        _, first, inverse = np.unique(squares, axis=0, return_index=True, return_inverse=True)
        numbers = inverse.reshape(-1)[numbers]
        places = places[first]
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
            free[pair] = False
            chain = [tip, other]
            while len(around[chain[-1]]) == 2:
                onward = [link for link in around[chain[-1]] if free[link[0]]]
                if not onward:
                    break
                next_pair, node = onward[0]
                free[next_pair] = False
                chain.append(node)
            yield chain


def simplify(line: Floats) -> Floats:
    """A polyline (k, 2) without points that are within STRAIGHT of it all the same: every other one, over and over."""
    close = 0.5 * STRAIGHT
    while len(line) > 2:
        before = line[:-2:2]
        here = line[1:-1:2]
        after = line[2::2]

        # how far points are from the line between their neighbours, and along it
        along = after - before
        step = here - before
        length = np.maximum(np.linalg.norm(along, axis=1), 1e-300)
        aside = np.abs(along[:, 0] * step[:, 1] - along[:, 1] * step[:, 0]) / length
        forward = np.einsum("nk,nk->n", step, along)
        is_needless = (aside < close) & (forward > 0.0) & (forward < length**2)
        if not is_needless.any():
            break
        line = np.delete(line, 1 + 2 * np.flatnonzero(is_needless), axis=0)
        close = 0.5 * close
    return line


def meet_at_corners(lines: tuple[Floats, ...]) -> tuple[Floats, ...]:
    """Borders (k, 2) of elements with improved ends where three or more meet.

    Next to a vertex, distances to the nearest border give no information about the others.  There each line is extended
    straight from ROOM away, to the point that is nearest to all of them.
    """
    better = list(lines)
    for place, ends in _ends_by_place(lines).items():
        if len(ends) < 3:
            continue
        shorter = [_without_start(_from_end(better[number], is_last)) for number, is_last in ends]
        corner = _nearest_to([tail for tail in shorter if tail is not None])
        if corner is None or np.linalg.norm(corner - place) > ROOM:
            continue
        for (number, is_last), tail in zip(ends, shorter, strict=True):
            rest = _from_end(better[number], is_last)[1:] if tail is None else tail.line
            better[number] = _from_end(np.concatenate([corner[None], rest]), is_last)
    return tuple(better)


def _ends_by_place(lines: tuple[Floats, ...]) -> dict[tuple[float, ...], list[tuple[int, bool]]]:
    """For each place where lines end their numbers, and whether it is their last point."""
    ends: dict[tuple[float, ...], list[tuple[int, bool]]] = {}
    for number, line in enumerate(lines):
        if len(line) > 1:
            ends.setdefault(tuple(line[0]), []).append((number, False))
            ends.setdefault(tuple(line[-1]), []).append((number, True))
    return ends


def _from_end(line: Floats, is_last: bool) -> Floats:
    """A line reversed if it starts at its last point, else unchanged; applied twice, the line itself."""
    return line[::-1] if is_last else line


@dataclass(frozen=True, eq=False)
class _Tail:
    """A line (k, 2) without its start, and its direction (2,) where it begins."""

    line: Floats
    direction: Floats


def _without_start(line: Floats) -> _Tail | None:
    """A line from ROOM away from its first point on; None where it is too short for that."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    length = np.append(0.0, np.cumsum(steps))
    if length[-1] < 3.0 * ROOM:
        return None
    first = np.array([np.interp(ROOM, length, coordinate) for coordinate in line.T])
    further = np.array([np.interp(2.0 * ROOM, length, coordinate) for coordinate in line.T])
    return _Tail(np.concatenate([first[None], line[length > ROOM]]), further - first)


def _nearest_to(tails: list[_Tail]) -> Floats | None:
    """(2,) the point nearest to all lines, gone on with straight; None where they have one direction."""
    # least squares of the distances a . x - a . p, with a across the line and p on it
    directions = np.array([tail.direction / np.linalg.norm(tail.direction) for tail in tails]).reshape(-1, 2)
    across = np.stack([-directions[:, 1], directions[:, 0]], axis=1)
    matrix = across.T @ across
    if np.linalg.det(matrix) < 1e-2:
        return None
    offsets = np.array([normal @ tail.line[0] for normal, tail in zip(across, tails, strict=True)])
    return np.asarray(np.linalg.solve(matrix, across.T @ offsets))


def borders(owner: Ints, distance: Floats, depth: Floats, first: Ints) -> tuple[Floats, Floats, Ints]:
    """Short lines between pixels of different owners: starts and ends (n, 2), and the pixel (n,) each lies on.

    owner     (h, w) owners of the pixels, -1 for empty pixels
    distance  (h, w) pixels to the nearest border of the owner's element, infinite if unknown
    depth     (h, w) depths: of two surfaces the nearer one ends at the border
    first     (2,) column and row of the first pixel

    Between two centres the border follows from both distances; next to an empty side, or another surface behind, it is
    where the distance reaches zero.  If more than two owners meet, lines go to the middle.
    """
    wide, is_across = _crossings(owner, distance, depth)
    turned, is_turned = _crossings(owner.T, distance.T, depth.T)
    tall, is_down = turned.T, is_turned.T
    is_crossed = np.stack([is_across[:-1], is_across[1:], is_down[:, :-1], is_down[:, 1:]], axis=2)
    count = np.count_nonzero(is_crossed, axis=2)

    # two crossings of a square's sides are joined
    two = np.nonzero(count == 2)
    joined = _places(wide, tall, two, first)[is_crossed[two]].reshape(-1, 2, 2)

    # three and four with their middle
    more = np.nonzero(count > 2)
    many = _places(wide, tall, more, first)
    is_one = is_crossed[more]
    middle = (many * is_one[..., None]).sum(axis=1) / is_one.sum(axis=1)[:, None]
    square, side = np.nonzero(is_one)
    starts = np.concatenate([joined[:, 0], many[square, side]])
    ends = np.concatenate([joined[:, 1], middle[square]])
    return starts, ends, np.concatenate([_nearest(owner, depth, two), _nearest(owner, depth, more)[square]])


def _places(wide: Floats, tall: Floats, squares: tuple[Ints, Ints], first: Ints) -> Floats:
    """(n, 4, 2) crossings of borders with the upper, the lower, the left and the right side of squares between centres.

    wide, tall  see _crossings
    squares     rows (n,) and columns (n,)
    """
    row, column = squares
    x, y = column + first[0], row + first[1]
    upper = np.stack([x + wide[row, column], y], axis=-1)
    lower = np.stack([x + wide[row + 1, column], y + 1.0], axis=-1)
    left = np.stack([x, y + tall[row, column]], axis=-1)
    right = np.stack([x + 1.0, y + tall[row, column + 1]], axis=-1)
    return np.stack([upper, lower, left, right], axis=1)


def _crossings(owner: Ints, distance: Floats, depth: Floats) -> tuple[Floats, Bools]:
    """(h, w - 1) where borders cross from one column to the next, from 0 to 1; whether there are any."""
    is_border = owner[:, :-1] != owner[:, 1:]
    row, column = np.nonzero(is_border)
    left, right = distance[row, column], distance[row, column + 1]
    is_left, is_right = owner[row, column] >= 0, owner[row, column + 1] >= 0

    # two elements side by side: where the distances from both say
    sum_of_both = left + right
    is_between = is_left & is_right & (sum_of_both <= 1.1) & (sum_of_both > 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        between = left / sum_of_both

    # only one element ends at an empty pixel or at another surface: use the distance of the one present, or of the
    # nearer one
    start = _border_distance(owner, distance, row, column, -1)
    end = 1.0 - _border_distance(owner, distance, row, column + 1, 1)
    nearer = np.where(depth[row, column] <= depth[row, column + 1], start, end)
    alone = np.where(is_right, np.where(is_left, nearer, end), start)
    crossings = np.zeros(is_border.shape)
    crossings[row, column] = np.clip(np.where(is_between, between, alone), 0.0, 1.0)
    return crossings, is_border


def _border_distance(owner: Ints, distance: Floats, row: Ints, column: Ints, back: int) -> Floats:
    """(n,) how far from pixels (n,) their border is, half where unknown; ``back`` leads to the column before."""
    # how much the distance falls from the column before, in one element
    before = np.clip(column + back, 0, owner.shape[1] - 1)
    is_known = (before != column) & (owner[row, before] == owner[row, column])
    here = distance[row, column]
    with np.errstate(invalid="ignore", divide="ignore"):
        gradient = np.where(is_known, distance[row, before] - here, np.nan)
        far = here / gradient
    return np.where((gradient > SLOPE) & (far <= 1.0), far, 0.5)


def _nearest(owner: Ints, depth: Floats, squares: tuple[Ints, Ints]) -> Ints:
    """(n,) numbers of the nearest pixel at the corners of squares, given by rows (n,) and columns (n,)."""
    row, column = squares
    rows = np.stack([row, row, row + 1, row + 1])
    columns = np.stack([column, column + 1, column, column + 1])
    shown = np.where(owner[rows, columns] >= 0, depth[rows, columns], np.inf)
    chosen = np.argmin(shown, axis=0)
    return np.asarray((row + chosen // 2) * owner.shape[1] + column + chosen % 2)
