"""Lines on walls: stream functions on curved faces, closed forms of flows at rest on a wall, distances to the wall."""

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.distances import nearest, surface_of
from elvis.core.distances.boundaries import ALL
from elvis.core.mapping import pointwise
from elvis.core.shapes import Shape
from elvis.core.streamlines.course import Course, Flow
from elvis.core.streamlines.lines.pieces import curves
from elvis.core.streamlines.streamlines import trace
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple

SOLIDS = Shape.of_dimension(3)
#: the gradient of x^2/2 + y^2 + x z/3, and its turn by a right angle about the normal of the wall
GRADIENT = ("(x + z/3)", "2*y", "(x/3)")
AROUND = tuple(f"n{'xyz'[k - 2]}*{GRADIENT[k - 1]} - n{'xyz'[k - 1]}*{GRADIENT[k - 2]}" for k in range(3))


def level(points):
    x, y, z = points.T
    return x * x / 2 + y * y + x * z / 3


def bent(shape, bend):
    return Dataset(curved(grid(shape, 2), ripple(bend), 3) if bend else grid(shape, 2))


@pytest.mark.thorough
@pytest.mark.parametrize("shape", SOLIDS)
@pytest.mark.parametrize("bend", [0.0, 0.04])
@pytest.mark.sampled(least=2, free=("shape", "bend"))
def test_lines_preserve_a_stream_function_of_the_whole_wall(shape, bend):
    dataset = bent(shape, bend)
    seeds = trace(dataset, "boundary:all:1", AROUND, wall=ALL, length=1e-3).points[[0, -1]]
    found = trace(dataset, seeds, AROUND, wall=ALL, length=0.8)
    assert found.counts() == {"length": 2}
    assert len(set(found.element.tolist())) > 2
    for line in range(2):
        assert np.ptp(level(found[line])) < 1e-10
    walls = surface_of(dataset, ALL)
    assert np.abs(nearest(walls, found.points).distance).max() < 1e-12


@pytest.mark.parametrize("shape", SOLIDS)
@pytest.mark.sampled(least=2, free=("shape",))
def test_the_shear_of_a_turning_flow_is_followed(shape):
    """A fluid that turns about an axis the faster the higher: next to the floor it moves by height times shear."""
    parts = {
        "u": lambda p: p[:, 2] * (0.5 - p[:, 1]),
        "v": lambda p: p[:, 2] * (p[:, 0] - 0.5),
        "w": lambda p: np.zeros(len(p)),
    }
    mesh = grid(shape, 2)
    dataset = Dataset(mesh, tuple(approximated(Dataset(mesh), name, own, 3) for name, own in parts.items()))
    found = trace(dataset, [[0.8, 0.5, 0.0]], wall=ALL, duration=2.0, fields=["z + x"])
    assert found.counts() == {"duration": 1}
    assert found[0][-1] == pytest.approx([0.5 + 0.3 * np.cos(2), 0.5 + 0.3 * np.sin(2), 0], abs=1e-10)
    assert found.velocity[0] == pytest.approx([0, 0.3, 0], abs=1e-12)
    assert found.values["z + x"] == pytest.approx(found.points[:, 0], abs=1e-12)


def test_curves_on_walls_match_their_elements():
    dataset = Dataset(curved(mixed_volume(1), ripple(0.02), 3))
    flow = Flow.of(dataset, Course("boundary:all:1", AROUND, wall=ALL))
    pieces = curves(dataset, Course("boundary:all:1", AROUND, length=0.15, wall=ALL)).pieces
    places = pieces.reference.sum(axis=1)
    checked = 0
    for patch in flow.velocity.evaluator.patches:
        order = {int(id): row for row, id in enumerate(patch.element_ids)}
        here = np.flatnonzero(np.isin(pieces.element, patch.element_ids))
        rows = np.array([order[int(id)] for id in pieces.element[here]], np.int64)
        world = pointwise.positions(patch, rows, places[here])
        assert np.abs(world - pieces.points[here].sum(axis=1)).max(initial=0) < 1e-12
        checked += len(here)
    assert checked == len(pieces) > 20


def test_walls_are_of_3d_data_and_have_names():
    with pytest.raises(ElvisError, match="expected 3D data"):
        trace(Dataset(grid(Shape.TRIANGLE, 1)), [[0.5, 0]], ["x", "y"], wall=ALL)
    plane = Dataset(grid(Shape.TRIANGLE, 1))
    fields = tuple(approximated(plane, name, lambda p: p[:, 0], 2) for name in "uv")
    with pytest.raises(ElvisError, match="lines on the wall all: expected 3D data"):
        trace(Dataset(plane.mesh, fields), [[0.5, 0]], wall=ALL)
    with pytest.raises(ElvisError, match="there is no boundary 'wing'"):
        trace(bent(Shape.PRISM, 0), [[0.5, 0.5, 0]], AROUND, wall="wing")
