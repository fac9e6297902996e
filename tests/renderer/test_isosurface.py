"""Isosurfaces whose every point is known in closed form, on straight and curved elements of every shape."""

import numpy as np
import pytest

from elvis.formats.dataset import Dataset
from elvis.formats.shapes import Shape
from elvis.formats.testing import approximated, curved, grid
from elvis.plugins.native import NativeVolume
from elvis.renderer import Camera, Status
from elvis.renderer.isosurface import IsosurfaceDrawer
from elvis.renderer.loaded import Loaded
from elvis.renderer.pixels import NOBODY
from elvis.renderer.view import View

SOLIDS = [shape for shape in Shape if shape.dimension == 3]
SIZE = (60, 50)
PARALLEL = Camera((3.0, -4.0, 2.5), (0.5, 0.55, 0.55), height=1.9)
VIEWS = {"parallel": PARALLEL, "perspective": Camera((1.6, -1.1, 1.3), (0.5, 0.5, 0.5), fov=60.0)}


def bent(points):
    """A shear of second degree: elements of three nodes along an edge follow it exactly."""
    x, y, _ = points.T
    return points + np.outer(0.25 * x * y - 0.15 * y**2, [0, 0, 1]) + 0.2 * points[:, :1] ** 2 * [0, 1, 0]


def straightened(points):
    """The inverse of ``bent``."""
    level = points - 0.2 * points[:, :1] ** 2 * [0, 1, 0]
    x, y, _ = level.T
    return level - np.outer(0.25 * x * y - 0.15 * y**2, [0, 0, 1])


@pytest.fixture(scope="module")
def iso(renderer):
    """The layer of an isosurface of a dataset's first field."""

    def draw(dataset, view, value, beyond=None, device="vulkan"):
        volume = NativeVolume.of(dataset, dataset.fields[0].name)
        drawer = IsosurfaceDrawer(Loaded(renderer(device).device, volume))
        return drawer.draw(view, None, value, beyond), drawer

    return draw


def cube(shape, function, modes, cells=2, curved_mesh=True):
    """The unit cube, bent, with a field given in world coordinates."""
    mesh = grid(shape, cells)
    dataset = Dataset(curved(mesh, bent, 3) if curved_mesh else mesh)
    return Dataset(dataset.mesh, (approximated(dataset, "u", function, modes),))


def all_rays(view):
    rows, columns = np.divmod(np.arange(view.count), view.width)
    return view.rays(columns, rows)


def quadric_roots(view, centre, weights, level):
    """(n, 2) depths at which rays meet sum w (x - c)^2 = level, NaN where they don't."""
    origins, ways = all_rays(view)
    away = origins - centre
    a, b, c = (ways**2 @ weights), (away * ways) @ weights, away**2 @ weights - level
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b**2 - a * c)
    return np.stack([(-b - root) / a, (-b + root) / a], axis=1)


def nearest_inside(view, roots, beyond=0.0):
    """The least depth of each ray that lies in the bent cube, infinite where none does, and the pixels that are clear:
    where no root comes near the cube's border."""
    origins, ways = all_rays(view)
    points = origins[:, None] + roots[..., None] * ways[:, None]
    depth_in_cube = 0.5 - np.abs(straightened(points.reshape(-1, 3)) - 0.5).max(axis=1).reshape(roots.shape)
    clear = ~(np.abs(depth_in_cube) < 1e-9).any(axis=1)
    inside = (depth_in_cube > 0) & (roots > np.broadcast_to(beyond, len(roots))[:, None])
    return np.where(inside, roots, np.inf).min(axis=1), clear


CENTRE, WEIGHTS, LEVEL = np.array([0.55, 0.6, 0.6]), np.array([1.0, 1.4, 0.8]), 0.16


def quadric(points):
    return (points - CENTRE) ** 2 @ WEIGHTS


@pytest.mark.parametrize("camera", VIEWS)
@pytest.mark.parametrize("shape", SOLIDS)
def test_an_ellipsoid_on_curved_elements(iso, shape, camera):
    view = View.through(VIEWS[camera], SIZE)
    layer, _ = iso(cube(shape, quadric, 5), view, LEVEL)
    truth, clear = nearest_inside(view, quadric_roots(view, CENTRE, WEIGHTS, LEVEL))
    assert np.isfinite(truth).mean() > 0.1

    hit = layer.owner != NOBODY
    assert np.array_equal(hit[clear], np.isfinite(truth)[clear])
    assert (layer.status[clear & hit] != Status.FAILED).all()
    assert (layer.status[clear & ~hit] == Status.MISS).all()
    assert (layer.status[hit] == Status.CERTAIN).mean() > 0.95
    both = hit & np.isfinite(truth)
    assert np.abs(layer.depth - truth)[both].max() < 1e-10 * np.sqrt(3)

    origins, ways = all_rays(view)
    normal = WEIGHTS * (origins + layer.depth[:, None] * ways - CENTRE)[:]
    with np.errstate(invalid="ignore"):
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        normal *= -np.sign((normal * ways).sum(axis=1))[:, None]
    assert np.abs(layer.normal - normal)[both].max() < 1e-9
    assert np.abs(layer.field - LEVEL)[hit].max() < 1e-13
