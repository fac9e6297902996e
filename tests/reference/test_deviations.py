"""Distances between exact and linear surfaces against closed forms, and what is said where open3d is missing."""

import importlib.util
import sys

import numpy as np
import pytest

from elvis.core.data.dataset import Dataset
from elvis.core.mapping.patch import patches
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid
from elvis.reference.baseline.deviations import (
    Sampled,
    border_distances,
    deviation,
    face_points,
    picture_distances,
    why_not,
)
from elvis.reference.baseline.mesh import LinearMesh
from elvis.scene import Faces

needs_open3d = pytest.mark.skipif(importlib.util.find_spec("open3d") is None or bool(why_not()), reason="no open3d")


def bulged(points):
    """The cube, whose upper side is the parabola z = 1 + 0.1 (1 - (2 x - 1)^2)."""
    lift = 0.1 * points[:, 2] * (1 - (2 * points[:, 0] - 1) ** 2)
    return points + np.outer(lift, [0, 0, 1])


def test_points_of_faces_lie_on_their_exact_maps():
    dataset = Dataset(curved(grid(Shape.HEXAHEDRON, 1), bulged, 3))
    found = face_points(dataset, patches(dataset), ("all",))
    x, y, z = found.T
    top = 1 + 0.1 * (1 - (2 * x - 1) ** 2)
    distances = np.abs([x, 1 - x, y, 1 - y, z, top - z])
    assert distances.min(axis=0).max() < 1e-14
    assert len(found) == 6 * 16**2
    assert np.abs(border_distances(dataset, "all")(found)).max() < 1e-12


def square(height):
    """Two triangles over the unit square."""
    points = np.array([[0, 0, height], [1, 0, height], [0, 1, height], [1, 1, height]], float)
    simplices = np.array([[0, 1, 2], [1, 3, 2]], np.int32)
    return LinearMesh(points, {}, points, simplices, np.zeros(2, np.int64))


@needs_open3d
def test_distances_match_those_of_a_parabola_from_a_plane():
    """Over the points 0.1 (1 - s^2) has the mean 1/15, and 95 % lie below 0.1 (1 - 0.05^2)."""
    s = np.linspace(-1, 1, 2001)
    points = np.stack([(s + 1) / 2, np.full(2001, 0.4), 1 + 0.1 * (1 - s**2)], axis=1)
    found = deviation(Sampled(Faces(), points, lambda middles: np.abs(middles[:, 2] - 0.75)), square(1.0))
    assert found.away.mean == pytest.approx(1 / 15, rel=1e-3)
    assert found.away.most == pytest.approx(0.1 * (1 - 0.05**2), rel=1e-3)
    assert found.away.maximum == pytest.approx(0.1, rel=1e-6)
    assert found.back.mean == found.back.maximum == found.hausdorff == pytest.approx(0.25)
    assert (found.points, found.density) == (2001, pytest.approx(2001))
    assert sum(found.shares) == pytest.approx(1)
    pixels = np.array([[[0.5, 0.5, 3.0], [0.5, 0.5, 1.25], [np.nan] * 3]])
    apart = picture_distances(pixels, [square(1.0), square(2.5)])
    assert apart[0, :2] == pytest.approx([0.5, 0.25], rel=1e-6)
    assert np.isnan(apart[0, 2])
    assert deviation(Sampled(Faces(), points[:0]), square(1.0)) is None


def test_a_missing_open3d_is_reported(monkeypatch):
    monkeypatch.setitem(sys.modules, "open3d", None)
    words = "needs open3d, which is not installed; pip install 'elvis-viz[open3d]' installs it."
    assert why_not().startswith("Distances of surfaces are skipped: ")
    assert why_not().endswith(words)
