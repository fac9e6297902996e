"""Seams of triangles on faces that two elements cut along different lines: a triangle of a pyramid and its neighbour.

Both sides approximate one curve on the face by lines between points of the curve.  Each line takes up the points of the
other side that lie between its ends, so the sides have the same lines: the triangle behind a line becomes a fan.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.integrals.subcells import subcell_points
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.shapes import Shape
from elvis.core.triangles.cell_places import CellPlaces, Cells, Marched
from elvis.core.triangles.outlines import open_sides
from elvis.core.wall_curves.chains import places_by_number

#: height over a face, in reference coordinates, up to which points are on it
_ON_FACE = 1e-9
#: distance of two points, as a part of the length of the curve, below which they are one
_SAME = 1e-9


@dataclass(frozen=True)
class _Line:
    """A line with a triangle on one side only: side ``slot`` of triangle ``row``, from a node to another one.

    element  number of the patch and row in it
    """

    row: int
    slot: int
    start: int
    stop: int
    element: tuple[int, int]


#: lines by the places of the vertices of a face, then by the element
_Faces: TypeAlias = dict[tuple[int, ...], dict[tuple[int, int], list[_Line]]]


@dataclass(eq=False)
class _Seams:
    """Changes of triangles.

    inserted  nodes to insert on sides of triangles, by row and slot, in the direction of the side
    welded    nodes that are replaced by others at their places
    offset    maximum distance of inserted nodes from their lines
    """

    inserted: dict[tuple[int, int], list[int]] = field(default_factory=dict)
    welded: dict[int, int] = field(default_factory=dict)
    offset: float = 0.0


def stitched(cells: Cells, marched: Marched, positions: Floats) -> tuple[Marched, float]:
    """The triangles without gaps between pyramids and other elements.

    Also by how much triangles have moved at most.

    positions  (n, 3) of the nodes
    """
    seams = _Seams()
    for sides in _faces(cells, marched).values():
        if len(sides) == 2:
            first, second = (_chains(own) for own in sides.values())
            _join(first, second, positions, seams)
    triangles = marched.triangles
    rows = sorted({row for row, _ in seams.inserted})
    fans = [_fan(triangles[row].tolist(), [seams.inserted.get((row, slot), []) for slot in range(3)]) for row in rows]
    whole = np.delete(np.arange(len(triangles)), rows)
    owner = np.concatenate([whole, np.repeat(np.array(rows, np.int64), [len(own) for own in fans])])
    found = np.concatenate([triangles[whole], *(np.array(own) for own in fans)])
    names = np.arange(len(positions))
    names[list(seams.welded)] = list(seams.welded.values())
    chosen = _without_folds(names[found])
    found, owner = found[chosen], owner[chosen]
    places = _places(cells, marched, positions, owner, found, names[found])
    return Marched(marched.nodes, names[found], marched.group[owner], marched.row[owner], places), seams.offset


def _without_folds(triangles: Ints) -> Ints:
    """Rows (k,) of triangles (m, 3) with three different corners, without pairs of two sides of one triangle."""
    is_whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    _, which, count = np.unique(np.sort(triangles, axis=1), axis=0, return_inverse=True, return_counts=True)
    return np.flatnonzero(is_whole & (count[which.reshape(-1)] == 1))


def _places(cells: Cells, marched: Marched, positions: Floats, owner: Ints, found: Ints, renamed: Ints) -> Floats:
    """(m, 3, 3) corners of parts of triangles ``owner`` (m,) in the cells of these.

    found, renamed  (m, 3) corners before and after nodes have been replaced by others
    """
    is_corner = found[:, :, None] == marched.triangles[owner][:, None, :]
    places = marched.places[owner[:, None], is_corner.argmax(axis=2)]
    row, slot = np.nonzero(~is_corner.any(axis=2) | (found != renamed))

    # new corners are near their feet on the flat triangle
    own = owner[row]
    start, *others = np.moveaxis(positions[marched.triangles[own]], 1, 0)
    sides = np.stack([other - start for other in others], axis=2)
    goals = positions[renamed[row, slot]]
    weights = (np.linalg.pinv(sides) @ (goals - start)[..., None])[..., 0]
    first = marched.places[own, 0]
    guess = first + np.einsum("nk,nkx->nx", weights, marched.places[own, 1:] - first[:, None])
    places[row, slot] = cells.located(CellPlaces(marched.group[own], marched.row[own], guess), goals).place
    return np.asarray(places)


def _faces(cells: Cells, marched: Marched) -> _Faces:
    """Lines with one triangle on triangular faces, by the face and then by the element."""
    row, slot = open_sides(marched.triangles)
    ends = np.stack([slot, (slot + 1) % 3], axis=1)
    nodes = marched.triangles[row[:, None], ends]
    owners = CellPlaces(marched.group[row], marched.row[row], marched.places[row, 0])
    places = marched.places[row[:, None], ends]
    numbers, elements, faces = list[int](), list[tuple[int, int]](), [np.empty((0, 3, 3))]
    for group, cell in enumerate(cells.boxes):
        here = np.flatnonzero(owners.group == group)
        points = subcell_points(cell.shape, cell.cell, places[here].reshape(-1, 3)).reshape(-1, 2, 3)
        patch = cells.evaluator.patches[cell.patch]
        for vertices in _triangular_faces(cell.shape):
            chosen = here[_are_on(points, vertices)]
            rows = owners.row[chosen]
            faces.append(np.swapaxes(evaluate(patch.geometry, patch.geometry_coefficients[rows], vertices), 1, 2))
            numbers += chosen.tolist()
            elements += [(cell.patch, own) for own in rows.tolist()]

    lines = []
    for number, element in zip(numbers, elements, strict=True):
        start, stop = nodes[number].tolist()
        lines.append(_Line(int(row[number]), int(slot[number]), start, stop, element))
    return _by_face(lines, np.concatenate(faces))


def _by_face(lines: Sequence[_Line], faces: Floats) -> _Faces:
    """Lines by the face, with vertices (3, 3) for each line, and then by the element.

    Elements share a face if the vertices of their faces are at the same places.
    """
    found: _Faces = defaultdict(lambda: defaultdict(list))
    keys = np.sort(places_by_number(faces.reshape(-1, 3)).reshape(-1, 3), axis=1)
    for line, key in zip(lines, keys.tolist(), strict=True):
        found[tuple(key)][line.element].append(line)
    return found


def _triangular_faces(shape: Shape) -> list[Floats]:
    """The vertices (3, 3) of each triangular face of a shape, in reference coordinates."""
    return [shape.vertices[list(face)] for face in shape.faces if len(face) == 3]


def _are_on(points: Floats, vertices: Floats) -> Bools:
    """(n,) whether both points of each pair (n, 2, 3) are on a face."""
    normal = np.cross(vertices[1] - vertices[0], vertices[2] - vertices[0])
    return np.asarray((np.abs((points - vertices[0]) @ normal) <= _ON_FACE).all(axis=1))


def _chains(lines: Sequence[_Line]) -> list[list[_Line]]:
    """Lines in the order in which they follow each other; closed chains begin anywhere."""
    after = {line.start: line for line in lines}
    stops = {line.stop for line in lines}
    starts = [line.start for line in lines if line.start not in stops]
    found = []
    while after:
        start = starts.pop() if starts else next(iter(after))
        chain = []
        while start in after:
            chain.append(after.pop(start))
            start = chain[-1].stop
        if chain:
            found.append(chain)
    return found


def _join(first: list[list[_Line]], second: list[list[_Line]], positions: Floats, seams: _Seams) -> None:
    """Let the chains of both sides that follow one curve have the same nodes."""
    for chain in first:
        for other in second:
            turned = _aligned(chain, other, positions)
            if turned is not None:
                second.remove(other)
                _insert(chain, turned, positions, seams)
                break


def _aligned(chain: list[_Line], other: list[_Line], positions: Floats) -> list[_Line] | None:
    """The lines of the other side in the order of a chain that follows the same curve; None if it follows another."""
    ends = chain[0].start, chain[-1].stop
    turned = other[::-1]
    if ends[0] != ends[1]:
        return turned if (other[-1].stop, other[0].start) == ends else None
    if other[0].start != other[-1].stop:
        return None
    # closed curves: begin at the node nearest to the start of the chain
    away = np.linalg.norm(positions[[line.stop for line in turned]] - positions[ends[0]], axis=1)
    longest = max(float(np.linalg.norm(positions[line.stop] - positions[line.start])) for line in (*chain, *other))
    first = int(away.argmin())
    return turned[first:] + turned[:first] if away[first] <= longest else None


def _insert(chain: list[_Line], turned: list[_Line], positions: Floats, seams: _Seams) -> None:
    """Insert the inner nodes of each of two chains between those of the other, by their shares of the length.

    turned  the other chain, whose lines go from their stop to their start
    """
    own = [chain[0].start, *(line.stop for line in chain)]
    its = [turned[0].stop, *(line.start for line in turned)]
    length = _lengths(positions[own])
    shares = length / length[-1], _lengths(positions[its]) / _lengths(positions[its])[-1]
    if own[0] == own[-1] and its[0] != own[0]:
        # closed curves have no common node yet
        seams.welded[its[0]] = own[0]
        seams.offset = max(seams.offset, float(np.linalg.norm(positions[its[0]] - positions[own[0]])))
    for number, node in enumerate(its[1:-1], 1):
        away = np.linalg.norm(positions[own] - positions[node], axis=1)
        near = int(away.argmin())
        if away[near] <= _SAME * length[-1] and 0 < near < len(own) - 1:
            seams.welded[node] = own[near]
            shares[1][number] = shares[0][near]
    _between(chain, shares[0], its, shares[1], positions, seams, is_turned=False)
    _between(turned, shares[1], own, shares[0], positions, seams, is_turned=True)


def _between(
    lines: list[_Line],
    shares: Floats,
    nodes: list[int],
    where: Floats,
    positions: Floats,
    seams: _Seams,
    is_turned: bool,
) -> None:
    """Insert nodes at shares ``where`` on lines between ``shares``; nodes at the same share count as one."""
    inner = np.arange(1, len(nodes) - 1)
    for number, line in enumerate(lines):
        chosen = inner[(where[inner] > shares[number]) & (where[inner] < shares[number + 1])]
        if not len(chosen):
            continue
        inserted = [nodes[k] for k in chosen]
        ends = positions[[line.start, line.stop]]
        seams.offset = max(seams.offset, _offset(positions[inserted], ends))
        seams.inserted[line.row, line.slot] = inserted[::-1] if is_turned else inserted


def _offset(points: Floats, ends: Floats) -> float:
    """The maximum distance of points (n, 3) from the line between two ends (2, 3)."""
    way = ends[1] - ends[0]
    share = np.clip((points - ends[0]) @ way / max(float(way @ way), 1e-300), 0, 1)
    return float(np.linalg.norm(points - ends[0] - share[:, None] * way, axis=1).max())


def _lengths(points: Floats) -> Floats:
    """(n,) lengths of the way along points (n, 3) up to each of them."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _fan(corners: list[int], inserted: Sequence[list[int]]) -> list[list[int]]:
    """The triangles (k, 3) that replace one with nodes inserted on its sides: each side's fan from a node opposite."""
    while not inserted[0]:
        corners, inserted = [*corners[1:], corners[0]], [*inserted[1:], inserted[0]]
    a, b, c = corners
    found = _fan_from(c, [a, *inserted[0], b])
    if inserted[1]:
        # the last triangle has the side from b to c
        last = found.pop()[1]
        found += _fan_from(last, [b, *inserted[1], c])
    if inserted[2]:
        # the first one has the side from c to a
        first = found.pop(0)[2]
        found += _fan_from(first, [c, *inserted[2], a])
    return found


def _fan_from(apex: int, nodes: Sequence[int]) -> list[list[int]]:
    """Triangles between an apex and lines along nodes."""
    return [[apex, start, stop] for start, stop in pairwise(nodes)]
