"""Faces between elements that a discontinuous map takes apart: each side is an outer face of the picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.polynomials.bernstein import bernstein_values
from elvis.plugins.faces.faces import FaceBlock
from elvis.plugins.faces.nets import FaceSpace, face_space, symmetries

#: share of the largest coordinate within which two sides are one
CLOSE = 1e-10
#: pairs of faces that are compared together
_AT_ONCE = 1 << 12


def gap_faces(blocks: Sequence[FaceBlock]) -> Ints:
    """Numbers of inner faces whose two sides do not lie on each other, ascending."""
    entity = np.concatenate([block.entity for block in blocks])
    block_of = np.repeat(np.arange(len(blocks)), [len(block) for block in blocks])
    row = np.concatenate([np.arange(len(block)) for block in blocks])
    order = np.argsort(entity, kind="stable")
    at = np.flatnonzero(np.diff(entity[order]) == 0)
    first, other = order[at], order[at + 1]
    found = [np.empty(0, np.int64)]
    for one, another in np.unique(np.stack([block_of[first], block_of[other]], axis=1), axis=0).tolist():
        here = np.flatnonzero((block_of[first] == one) & (block_of[other] == another))
        for start in range(0, len(here), _AT_ONCE):
            some = here[start : start + _AT_ONCE]
            pair = blocks[one], blocks[another]
            apart = _are_apart(*pair, row[first[some]], row[other[some]])
            found.append(entity[first[some[apart]]])
    return np.sort(np.concatenate(found))


def _are_apart(one: FaceBlock, another: FaceBlock, rows: Ints, others: Ints) -> Bools:
    """Whether the faces in rows (n,) of a block differ from those in rows (n,) of another, in every orientation.

    Two maps agree if they do so at points that determine functions of the higher degree.
    """
    points = face_space(one.space.shape, max(one.space.degree, another.space.degree)).points
    places, nets = _images(one.space, one.nets(rows), points), another.nets(others)
    room = CLOSE * np.abs(places).max(initial=0.0)
    apart = np.ones(len(rows), bool)
    for turn in symmetries(one.space.shape):
        turned = _images(another.space, nets, turn[0] + points @ turn[1:])
        apart &= np.abs(turned - places).max(axis=(1, 2), initial=0.0) > room
    return apart


def _images(space: FaceSpace, nets: Floats, points: Floats) -> Floats:
    """World points (n, k, 3) of faces with nets (n, count, 4) at points (k, 2)."""
    found = bernstein_values(space.space, points) @ nets
    return np.asarray(found[..., :3] / found[..., 3:])
