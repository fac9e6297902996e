"""Faces inside gaps of a discontinuous displacement are outer faces; those of a continuous one are none."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, Shape, deform
from elvis.core.testing import approximated, grid
from elvis.plugins.faces import faces_of
from elvis.plugins.faces.faces import FaceBlock
from elvis.plugins.faces.gaps import gap_faces
from elvis.plugins.faces.nets import face_space, symmetries
from elvis.plugins.serving import volume_of

SOLIDS = [shape for shape in Shape if shape.dimension == 3]


def faces_after(shape, function):
    data = Dataset(grid(shape, 2))
    bent = deform(replace(data, fields=(approximated(data, "d", function, 3),)), "d,0,0", 0.5)
    return faces_of(bent, volume_of(bent, ["d"]))


@pytest.mark.parametrize("shape", SOLIDS)
def test_both_sides_of_a_gap_are_outer_faces(shape):
    # one half of the cube moves away from the other
    faces = faces_after(shape, lambda x: np.where(x[:, 0] > 0.5, 1.0, 0.0))
    in_plane = np.unique(faces.gaps)
    assert len(faces.gaps) == len(in_plane) > 0
    closed = faces_after(shape, lambda x: x[:, 0] ** 2)
    assert len(closed.gaps) == 0
    more = sum(map(len, faces.select(("all",)))) - sum(map(len, closed.select(("all",))))
    assert more == 2 * len(in_plane)
    places = [block.nets(rows)[..., :3] for block, rows in zip(faces.blocks, faces.select(("all",)), strict=True)]
    coordinates = [own[..., 0] for own in places if len(own)]
    level = np.concatenate([own.mean(axis=1) for own in coordinates])
    is_flat = np.concatenate([np.ptp(own, axis=1) < 1e-12 for own in coordinates])
    # sides at x = 0, at both ends of the gap, and at x = 1.5, as many each
    counts = [np.count_nonzero(is_flat & (np.abs(level - end) < 1e-9)) for end in (0.0, 0.5, 1.0, 1.5)]
    assert counts[1] == counts[2] == len(in_plane)
    assert counts[0] == counts[3] == counts[1]


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL])
def test_sides_of_different_degrees_and_orientations_are_one(shape):
    def block(degree, turn, shift):
        space = face_space(shape, degree)
        points = turn[0] + space.points @ turn[1:]
        places = np.column_stack([points, np.full(len(points), shift), np.ones(len(points))])
        net = (space.fit @ places)[None]
        zero = np.zeros(1, np.int64)
        return FaceBlock(0, "", space, zero, zero, zero, np.zeros((1, 3, 3)), lambda rows: net[rows])

    for turn in symmetries(shape):
        straight = block(1, symmetries(shape)[0], 0.0)
        assert len(gap_faces([straight, block(3, turn, 0.0)])) == 0
        assert len(gap_faces([straight, block(3, turn, 1e-6)])) == 1
