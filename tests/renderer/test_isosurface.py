"""Isosurfaces whose every point is known in closed form, on straight and curved elements of every shape."""

from dataclasses import replace
from time import process_time

import numpy as np
import pytest

from elvis import Camera, SceneError, Status
from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, with_field
from elvis.plugins.native import NativeVolume
from elvis.renderer.passes.isosurface.isosurface import IsosurfaceDrawer
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene import unit
from elvis.scene.cameras.view import View

SOLIDS = [shape for shape in Shape if shape.dimension == 3]
SIZE = (36, 30)
#: of eight pictures, with seventy thousand pixels in all
WIDE = (100, 86)
PARALLEL = Camera((3.0, -4.0, 2.5), (0.5, 0.55, 0.55), height=1.9)
VIEWS = {"parallel": PARALLEL, "perspective": Camera((1.6, -1.1, 1.3), (0.5, 0.5, 0.5), fov=40.0)}


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
    """The hit buffer of an isosurface of a dataset's first field."""

    def draw(dataset, view, value, beyond=None, device="vulkan"):
        volume = NativeVolume.of(dataset, dataset.fields[0].name)
        drawer = IsosurfaceDrawer(DeviceVolume(renderer(device).device, volume))
        return drawer.draw(view, None, value, beyond), drawer

    return draw


def cube(shape, function, modes=None, cells=None, curved_mesh=True):
    """The unit cube, curved, with a field given in world coordinates: of the orders that hold a quadric exactly.

    Of two cells a side; of curved pyramids, six of which fill one and each of which takes much work, of one.
    """
    modes = modes or (5 if curved_mesh else 4)
    cells = cells or (1 if curved_mesh and shape is Shape.PYRAMID else 2)
    mesh = grid(shape, cells)
    return with_field(curved(mesh, bent, 3) if curved_mesh else mesh, function, modes)


def quadric_roots(view, centre, weights, level):
    """(n, 2) depths at which rays meet sum w (x - c)^2 = level, NaN where they don't."""
    origins, ways = view.every_ray()
    away = origins - centre
    a, b, c = (ways**2 @ weights), (away * ways) @ weights, away**2 @ weights - level
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b**2 - a * c)
    return np.stack([(-b - root) / a, (-b + root) / a], axis=1)


def nearest_inside(view, roots, beyond=0.0):
    """Smallest depth of each ray that lies in the curved cube, infinite without one, and the pixels that are clear:
    where no root comes near the cube's border."""
    origins, ways = view.every_ray()
    points = origins[:, None] + roots[..., None] * ways[:, None]
    depth_in_cube = 0.5 - np.abs(straightened(points.reshape(-1, 3)) - 0.5).max(axis=1).reshape(roots.shape)
    clear = ~(np.abs(depth_in_cube) < 1e-9).any(axis=1)
    inside = (depth_in_cube > 0) & (roots > np.broadcast_to(beyond, len(roots))[:, None])
    return np.where(inside, roots, np.inf).min(axis=1), clear


CENTRE, WEIGHTS, LEVEL = np.array([0.55, 0.6, 0.6]), np.array([1.0, 1.4, 0.8]), 0.16


def quadric(points):
    return (points - CENTRE) ** 2 @ WEIGHTS


@pytest.mark.sampled
@pytest.mark.parametrize("camera", VIEWS)
@pytest.mark.parametrize("shape", SOLIDS)
def test_an_ellipsoid_on_curved_elements(iso, shape, camera):
    view = View.through(VIEWS[camera], WIDE)
    hits, _ = iso(cube(shape, quadric), view, LEVEL)
    truth, clear = nearest_inside(view, quadric_roots(view, CENTRE, WEIGHTS, LEVEL))
    assert np.isfinite(truth).mean() > 0.1

    hit = hits.owner != NOBODY
    assert np.array_equal(hit[clear], np.isfinite(truth)[clear])
    assert (hits.status[clear & hit] != Status.FAILED).all()
    assert (hits.status[clear & ~hit] == Status.MISS).all()
    assert (hits.status[hit] == Status.CERTAIN).mean() > 0.95
    both = hit & np.isfinite(truth)
    assert np.abs(hits.depth[both] - truth[both]).max() < 1e-10 * np.sqrt(3)

    origins, ways = view.every_ray()
    normal = WEIGHTS * (origins + hits.depth[:, None] * ways - CENTRE)[:]
    with np.errstate(invalid="ignore"):
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        normal *= -np.sign((normal * ways).sum(axis=1))[:, None]
    assert np.abs(hits.normal - normal)[both].max() < 1e-9
    assert np.abs(hits.field - LEVEL)[hit].max() < 1e-13


def check(hits, truth, clear):
    """Coverage and places against depths in closed form; all but a few pixels certain."""
    hit = hits.owner != NOBODY
    assert np.array_equal(hit[clear], np.isfinite(truth)[clear])
    both = hit & np.isfinite(truth) & clear
    assert np.abs(hits.depth[both] - truth[both]).max(initial=0.0) < 1e-10 * np.sqrt(3)
    assert (hits.status[~hit & clear] != Status.FAILED).all()
    assert (hits.status[both] == Status.CERTAIN).sum() >= 0.9 * both.sum()


@pytest.mark.sampled
@pytest.mark.parametrize("camera", VIEWS)
@pytest.mark.parametrize("shape", SOLIDS)
def test_an_ellipsoid_on_straight_elements(iso, shape, camera, monkeypatch):
    monkeypatch.setitem(globals(), "straightened", lambda points: points)
    view = View.through(VIEWS[camera], SIZE)
    hits, _ = iso(cube(shape, quadric, curved_mesh=False), view, LEVEL)
    check(hits, *nearest_inside(view, quadric_roots(view, CENTRE, WEIGHTS, LEVEL)))


def test_both_algorithms_for_straight_tetrahedra_agree(iso, renderer, monkeypatch):
    dataset = cube(Shape.TETRAHEDRON, lambda p: np.sin(2 * p[:, 0]) * np.cos(3 * p[:, 1]) + p[:, 2], curved_mesh=False)
    view = View.through(PARALLEL, SIZE)
    hits, drawer = iso(dataset, view, 0.4)
    monkeypatch.setattr(type(drawer.traversal), "is_straight", lambda *_: False)
    other, _ = iso(dataset, view, 0.4)
    sure = (hits.status == Status.CERTAIN) & (other.status == Status.CERTAIN)
    assert sure.mean() > 0.2
    assert np.array_equal(hits.owner[sure], other.owner[sure])
    assert np.abs(hits.depth[sure] - other.depth[sure]).max() < 1e-11
    assert np.abs(hits.normal[sure] - other.normal[sure]).max() < 1e-8


def torus(points):
    """Zero on a torus of radii 0.27 and 0.12 around the vertical through (0.5, 0.6)."""
    x, y, z = (points - [0.5, 0.6, 0.55]).T
    around = x**2 + y**2 + z**2 + 0.27**2 - 0.12**2
    return around**2 - 4 * 0.27**2 * (x**2 + y**2)


def quartic_roots(view, function):
    """(n, 4) depths at which a polynomial of fourth degree vanishes along rays, by five values each; NaN for others."""
    origins, ways = view.every_ray()
    near = view.depth_of(np.array([0.5, 0.6, 0.55]))
    places = near + np.linspace(-1, 1, 5)
    values = np.stack([function(origins + depth * ways) for depth in places], axis=1)
    quartics = np.linalg.solve(np.vander(places - near), values.T).T
    roots = np.full((len(quartics), 4), np.nan)
    for row, quartic in enumerate(quartics):
        found = np.roots(quartic)
        real = np.abs(found.imag) < 1e-9
        roots[row, : real.sum()] = found.real[real] + near
    return roots


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.HEXAHEDRON])
def test_a_torus_has_its_hole_and_its_silhouettes(iso, shape, monkeypatch):
    monkeypatch.setitem(globals(), "straightened", lambda points: points)
    view = View.through(PARALLEL, SIZE)
    hits, _ = iso(cube(shape, torus, 5, curved_mesh=False), view, 0.0)
    check(hits, *nearest_inside(view, quartic_roots(view, torus)))


def ring(center, axes):
    """A torus around a centre, in the plane of the first two axes."""

    def function(points):
        x, y, z = (points - center).T[list(axes)]
        return (x**2 + y**2 + z**2 + 0.22**2 - 0.06**2) ** 2 - 4 * 0.22**2 * (x**2 + y**2)

    return function


def test_linked_rings_occlude_one_another(iso, monkeypatch):
    monkeypatch.setitem(globals(), "straightened", lambda points: points)
    rings = ring([0.39, 0.5, 0.5], (0, 1, 2)), ring([0.61, 0.5, 0.5], (0, 2, 1))
    view = View.through(PARALLEL, (60, 50))

    def both_rings(points):
        return rings[0](points) * rings[1](points)

    hits, _ = iso(cube(Shape.TETRAHEDRON, both_rings, 9, cells=1, curved_mesh=False), view, 0.0)
    roots = [quartic_roots(view, each) for each in rings]
    truth, clear = nearest_inside(view, np.hstack(roots))
    hit = hits.owner != NOBODY
    assert np.array_equal(hit[clear], np.isfinite(truth)[clear])
    assert np.abs(hits.depth[hit] - truth[hit]).max() < 1e-6

    # of eighth degree and steep elsewhere: the field vanishes at the hits to rounding of its range
    origins, ways = view.every_ray()
    corners = grid(Shape.HEXAHEDRON, 1).vertices
    missed = both_rings(origins[hit] + hits.depth[hit, None] * ways[hit])
    assert np.abs(missed).max() < 1e-12 * np.abs(both_rings(corners)).max()

    # where both are met, now one is nearer, now the other: they are linked
    depths = [nearest_inside(view, own)[0] for own in roots]
    both = np.isfinite(depths[0]) & np.isfinite(depths[1])
    assert (depths[0] < depths[1])[both].sum() > 10
    assert (depths[1] < depths[0])[both].sum() > 10


def test_a_blob_within_one_element_is_found(iso):
    centre = np.array([0.43, 0.61, 0.37])
    dataset = cube(Shape.HEXAHEDRON, lambda p: ((p - centre) ** 2).sum(axis=1), cells=1)
    view = View.through(PARALLEL, (200, 200))
    for radius in (0.04, 0.012, 0.004):
        hits, _ = iso(dataset, view, radius**2)
        truth, clear = nearest_inside(view, quadric_roots(view, centre, np.ones(3), radius**2))
        check(hits, truth, clear)
        assert np.isfinite(truth).any() or radius < 0.01


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PRISM])
def test_the_next_surface_lies_beyond_the_last(iso, shape, monkeypatch):
    """In straight tetrahedra and in curved prisms."""
    if shape is Shape.TETRAHEDRON:
        monkeypatch.setitem(globals(), "straightened", lambda points: points)
    view = View.through(PARALLEL, SIZE)
    dataset = cube(shape, quadric, curved_mesh=shape is Shape.PRISM)
    roots, beyond = quadric_roots(view, CENTRE, WEIGHTS, LEVEL), 0.0
    for _ in range(3):
        hits, _ = iso(dataset, view, LEVEL, np.broadcast_to(beyond, view.count).copy())
        truth, clear = nearest_inside(view, roots, np.nan_to_num(beyond, posinf=1e300) + 1e-9)
        check(hits, truth, clear)
        beyond = hits.depth
    assert not (hits.owner != NOBODY).any()


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PYRAMID])
def test_rays_that_touch_a_sphere_are_never_called_certain_wrongly(iso, shape):
    """The sphere's outline passes exactly through the centres of pixels."""
    camera = Camera((0.5, 0.5, 5.0), (0.5, 0.5, 0.0), (0.0, 1.0, 0.0), height=1.0)
    view = View.through(camera, (51, 51))
    radius, centre = 15 / 51, np.array([0.5, 0.5, 0.5])
    mesh = cube(shape, lambda p: ((p - centre) ** 2).sum(axis=1), curved_mesh=False)
    hits, _ = iso(mesh, view, radius**2)
    y, x = np.divmod(np.arange(view.count), 51)
    squared = (x - 25) ** 2 + (y - 25) ** 2
    hit, sure = hits.owner != NOBODY, hits.status != Status.AMBIGUOUS
    assert hit[squared < 225].all()
    assert not hit[squared > 225].any()
    assert not (sure & (squared > 225) & hit).any()
    assert (hits.status[(squared != 225) & ~hit] == Status.MISS).all()
    touched = hit & (squared == 225)
    assert np.abs(hits.depth[touched] - 4.5).max(initial=0.0) < 1e-6


def offset(dataset, rows, amount):
    """The first field, with constants added in some elements: a jump between elements."""
    block = dataset.fields[0].blocks[0]
    values = np.array(block.coefficients)
    ones = approximated(dataset, "one", lambda p: np.ones(len(p)), block.expansion.modes[0]).blocks[0].coefficients
    values[rows] += np.asarray(amount) * ones[rows]
    return Dataset(dataset.mesh, (replace(dataset.fields[0], blocks=(replace(block, coefficients=values),)),))


def test_cracks_between_discontinuous_elements_stay_open(iso, monkeypatch):
    """Planes z = 0.5 and z = 0.4 on the two sides of x = 1/2: seen from above and the lower side, the step is a gap."""
    plain = cube(Shape.HEXAHEDRON, lambda p: p[:, 2], curved_mesh=False)
    right = np.flatnonzero(np.arange(8) % 2 == 1)
    dataset = offset(plain, right, 0.1)
    view = View.through(Camera((4.0, 0.5, 2.5), (0.5, 0.5, 0.45), height=0.6), (60, 60))
    hits, _ = iso(dataset, view, 0.5)
    origins, ways = view.every_ray()
    expected = np.full(view.count, np.inf)
    for side, level in ((0, 0.5), (1, 0.4)):
        depth = (level - origins[:, 2]) / ways[:, 2]
        points = origins + depth[:, None] * ways
        inside = ((points[:, :2] > 0) & (points[:, :2] < 1)).all(axis=1) & ((points[:, 0] > 0.5) == side)
        expected = np.where(inside, np.minimum(depth, expected), expected)
    assert np.isinf(expected.reshape(60, 60)[:, 30][10:50]).any()
    assert np.array_equal(np.isfinite(expected), hits.owner != NOBODY)
    both = np.isfinite(expected)
    assert np.abs(expected[both] - hits.depth[both]).max() < 1e-10


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.HEXAHEDRON])
def test_constant_and_nan_elements_are_skipped_and_counted(iso, shape):
    plain = cube(shape, lambda p: p[:, 2], curved_mesh=False)
    count = len(plain.fields[0].blocks[0].coefficients)
    block = plain.fields[0].blocks[0]
    values = np.array(block.coefficients)
    values[0] = np.nan
    values[1] = 0.25 * np.rint(approximated(plain, "one", lambda p: np.ones(len(p)), 4).blocks[0].coefficients[1])
    dataset = Dataset(plain.mesh, (replace(plain.fields[0], blocks=(replace(block, coefficients=values),)),))
    view = View.through(PARALLEL, SIZE)
    hits, drawer = iso(dataset, view, 0.25)
    assert drawer.counts["undefined"] == 1
    assert drawer.counts["flat"] == 1
    assert not np.isin(hits.owner, (0, 1)).any()
    assert (hits.owner != NOBODY).sum() > 20
    assert count > 2


@pytest.mark.parametrize("seed", range(6))
def test_random_quadrics_on_curved_elements(iso, seed):
    """Ellipsoids, hyperboloids and all between: nothing that is called certain is wrong."""
    rng = np.random.default_rng(seed)
    shape, centre, weights = SOLIDS[seed % len(SOLIDS)], rng.uniform(0.2, 0.8, 3), rng.normal(size=3)
    level = float(weights @ rng.uniform(0, 0.1, 3))
    eye = 0.5 + 2.2 * unit(rng.normal(size=3), "eye")
    view = View.through(Camera(tuple(eye), (0.5, 0.5, 0.5), fov=40.0 + 20 * (seed % 2)), SIZE)
    hits, _ = iso(cube(shape, lambda p: (p - centre) ** 2 @ weights), view, level)
    check(hits, *nearest_inside(view, quadric_roots(view, centre, weights, level)))


def test_2d_data_have_no_isosurface(iso):
    with pytest.raises(SceneError, match="use contours"):
        iso(cube_of_plane(), View.through(PARALLEL, SIZE), 0.5)


def cube_of_plane():
    return with_field(grid(Shape.TRIANGLE, 2), lambda p: p[:, 0], 2)


@pytest.mark.thorough
def test_high_orders_cost_few_processor_seconds(iso, slowness):
    """Sums that points of a sub-element share are found once: found for each of them, they took 2.5 seconds."""
    mesh = curved(grid(Shape.HEXAHEDRON, 1), bent, 12)
    dataset = with_field(mesh, lambda p: np.sin(6 * p).prod(axis=-1), 12)
    view = View.through(PARALLEL, SIZE)
    iso(dataset, view, 0.2)
    start = process_time()
    iso(dataset, view, 0.2)
    assert process_time() - start < slowness
