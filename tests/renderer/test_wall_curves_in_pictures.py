"""Curves on walls in pictures: tubes about them are where closed forms have them, on every device."""

import numpy as np
import pytest
from warps import sector

from elvis import Camera, Dataset, SceneError, Shape, Streamlines, Style, render
from elvis.core.testing import approximated, curved, grid

RADIUS = 0.03


@pytest.fixture(scope="module")
def data():
    mesh = curved(grid(Shape.HEXAHEDRON, 1), sector, 7)
    return Dataset(mesh, (approximated(Dataset(mesh), "p", lambda p: p[:, 0], 7),))


@pytest.mark.parametrize("device", ["auto", "reference"])
def test_tubes_around_an_arc_of_a_sphere(data, device):
    """The plane z = 1/5 cuts the sphere of radius 2 in a circle; the data have no velocity."""
    line = Streamlines(along="section:all:plane:0,0,0.2:0,0,1", radius=RADIUS, style=Style(quantity="p"))
    camera = Camera((6.0, 1.0, 2.0), (1.8, 0.4, 0.2), height=1.2)
    frame = render(data, objects=[line], camera=camera, size=(48, 48), device=device)
    hits = frame.position[frame.status == 1]
    angle, distance = np.arctan2(hits[:, 1], hits[:, 0]), np.linalg.norm(hits[:, :2], axis=1)
    circle = np.sqrt(4 - 0.2**2)
    # away from the corners, where the curve goes on inwards
    inner = (np.abs(distance - circle) < 2 * RADIUS) & (angle > 0.05) & (angle < 0.45)
    assert inner.sum() > 20
    away = np.hypot(distance[inner] - circle, hits[inner, 2] - 0.2)
    assert away == pytest.approx(RADIUS, abs=1e-9)
    values = frame.field[frame.status == 1][inner]
    assert values == pytest.approx(circle * np.cos(angle[inner]), abs=1e-6)


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"along": "line:0,0,0:1,1,1"}, "along: expected boundary:NAME or section:NAME:plane:P:N"),
        ({"along": "section:all:plane:0,0,9:0,0,1"}, "the plane does not intersect all"),
        ({"along": "boundary:all"}, "expected 2D data, found 3D"),
        ({"along": "section:all:plane:0,0,0.2:0,0,1", "seeds": ("elements",)}, "no settings of lines from seeds"),
        ({"along": "section:all:plane:0,0,0.2:0,0,1", "velocity": "p,p,p"}, "expected no velocity"),
    ],
)
def test_invalid_curves_are_reported(data, settings, reason):
    with pytest.raises(SceneError, match=reason):
        render(data, objects=[Streamlines(**settings)], size=(8, 8), device="reference")
