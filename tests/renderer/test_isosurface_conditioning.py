"""Isosurfaces where fields are flat, touch their level or hardly rise: nothing certain is wrong, nothing is lost."""

import numpy as np
import pytest
from conditioning import exact

from elvis import Camera, CutSurface, Isosurface, Plane, Status
from elvis.core.data.dataset import Block, Dataset, Field
from elvis.core.polynomials.chebyshev_nodes import series
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, with_field
from elvis.plugins.runtime.serving import volume_of
from elvis.renderer.passes.isosurface.isosurface import IsosurfaceDrawer
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View

SOLIDS = [shape for shape in Shape if shape.dimension == 3]
CAMERA, SIZE = Camera((2.6, -1.9, 1.9), (0.5, 0.5, 0.25), fov=32.0), (30, 30)
#: part of a depth up to which a certain one may be wrong
MOST = 1e-8


def height(points):
    """From -1 to 1 over the unit cube; exact."""
    return 2 * points[:, 2] - 1


#: name to a function, its scale, what is added to both field and level, and the place of a coordinate where it is zero
FLAT = {
    "inflection": (lambda p: height(p) ** 3, 1.0, 1.0, 2, 0.5),
    "inflection of a small field": (lambda p: height(p) ** 3, 1.0, 2.0**-10, 2, 0.5),
    "inflection at zero": (lambda p: height(p) ** 3, 1.0, 0.0, 2, 0.5),
    "inflection elsewhere": (lambda p: (p[:, 0] - 0.46875) ** 3, 1.0, 1.0, 0, 0.46875),
    "inflection within rounding": (lambda p: (p[:, 0] - 0.8125) ** 3, 2.0**-34, 1.0, 0, 0.8125),
    "small slope": (height, 2.0**-17, 2.0**20, 2, 0.5),
    "smallest slope": (height, 2.0**-52, 1.0, 2, 0.5),
    "touching at zero": (lambda p: (p[:, 2] - 0.25) ** 2, 1.0, 0.0, 2, 0.25),
    "touching": (lambda p: (p[:, 2] - 0.25) ** 2, 1.0, 3.0, 2, 0.25),
    "touching, scaled": (lambda p: (p[:, 2] - 0.25) ** 2, 2.0**-90, 2.0**-90, 2, 0.25),
}
#: name to a field, times a scale, that takes its value at one place of a coordinate steeply
STEEP = {
    "plain": (lambda x: x + x**2, 1.0, 2, 0.375),
    "great": (lambda x: x + x**3, 2.0**100, 0, 0.46875),
    "small": (lambda x: x + x**2, 2.0**-100, 1, 0.3125),
}


@pytest.fixture(scope="module")
def iso(renderer):
    """The hit buffer of an isosurface of a dataset's first field, or of an expression."""

    def draw(dataset, view, value, text="u"):
        return IsosurfaceDrawer(DeviceVolume(renderer("vulkan").device, volume_of(dataset, [text]))).draw(
            view, None, value
        )

    return draw


def places(view, axis, place):
    """Depths of rays where a coordinate has a value; how far inside the unit cube that is, in the other coordinates."""
    origins, ways = view.every_ray()
    depth = (place - origins[:, axis]) / ways[:, axis]
    inside = 0.5 - np.abs(origins + depth[:, None] * ways - 0.5)
    inside[:, axis] = 0.5
    return depth, inside.min(axis=1)


def meets_cube(view):
    """(n,) rays that meet the unit cube, or nearly."""
    origins, ways = view.every_ray()
    ends = np.sort([(-1e-3 - origins) / ways, (1.001 - origins) / ways], axis=0)
    return ends[0].max(axis=1) <= ends[1].min(axis=1)


def check(hits, depth, inside):
    """Whatever is certain is right; pixels of the surface are hits or ambiguous, all others are misses or ambiguous."""
    hit, sure = hits.owner != NOBODY, hits.status != Status.AMBIGUOUS
    clear = sure & (np.abs(inside) > 1e-9)
    assert np.array_equal(hit[clear], (inside > 0)[clear])
    right = np.abs(hits.depth - depth) <= MOST * depth
    assert right[sure & hit].all()
    assert (np.abs(hits.depth - depth) <= hits.uncertainty)[sure & hit].all()
    assert np.array_equal(np.isnan(hits.uncertainty), ~hit)


@pytest.mark.sampled
@pytest.mark.parametrize("name", FLAT)
@pytest.mark.parametrize("shape", SOLIDS)
def test_flat_and_touching_surfaces_are_ambiguous(iso, shape, name):
    function, scale, level, axis, place = FLAT[name]
    view = View.through(CAMERA, SIZE)
    hits = iso(exact(shape, function, scale, level), view, level)
    depth, inside = places(view, axis, place)
    check(hits, depth, inside)
    assert (inside > 0).sum() > 80
    assert (hits.status[inside > 0] == Status.AMBIGUOUS).all()
    assert (hits.status[~meets_cube(view)] == Status.MISS).all()


@pytest.mark.parametrize("name", STEEP)
@pytest.mark.parametrize("shape", SOLIDS)
def test_steep_surfaces_are_certain_and_their_uncertainty_bounds_the_error(iso, shape, name):
    function, scale, axis, place = STEEP[name]
    view = View.through(CAMERA, SIZE)
    hits = iso(exact(shape, lambda p: function(p[:, axis]), scale), view, scale * function(place))
    depth, inside = places(view, axis, place)
    check(hits, depth, inside)
    well = inside > 1e-9
    assert (hits.status[well] == Status.CERTAIN).mean() > 0.98
    assert np.nanmax(hits.uncertainty[well & (hits.status == Status.CERTAIN)]) < 1e-11


def test_a_flat_surface_costs_few_sub_elements(renderer):
    """Where the field can't be told from its level, halving shows nothing new."""
    data = exact(Shape.HEXAHEDRON, lambda p: (p[:, 2] - 0.46875) ** 3, 1.0, 1.0)
    drawer = IsosurfaceDrawer(DeviceVolume(renderer("vulkan").device, volume_of(data, ["u"])))
    drawer.draw(View.through(CAMERA, (120, 120)), None, 1.0)
    assert drawer.counts["sub_elements"] < 200


@pytest.mark.parametrize("shape", SOLIDS)
def test_elements_within_rounding_cost_few_sub_elements(renderer, shape):
    """1 + 2^-52 (z - 15/32) can't be told from 1: nothing is shown, and bisection next to apexes ends."""
    data = exact(shape, lambda p: p[:, 2] - 0.46875, 2.0**-52, 1.0)
    view = View.through(CAMERA, SIZE)
    drawer = IsosurfaceDrawer(DeviceVolume(renderer("vulkan").device, volume_of(data, ["u"])))
    hits = drawer.draw(view, None, 1.0)
    assert drawer.counts["sub_elements"] < 600
    assert (hits.owner == NOBODY).all()
    assert (hits.status[places(view, 2, 0.46875)[1] > 1e-9] == Status.AMBIGUOUS).all()
    assert (hits.status[~meets_cube(view)] == Status.MISS).all()


def test_chebyshev_series_are_exact_under_symmetry():
    """Cosines are right to a few roundings, zeros too: that of pi / 2 as rounded is 6e-17."""
    for degree in range(1, 21):
        points, transform = series(degree)
        assert np.array_equal(points, -points[::-1])
        assert np.array_equal(transform[:, ::-1], transform * (-1.0) ** np.arange(degree + 1)[:, None])
        assert np.allclose(
            transform @ np.polynomial.chebyshev.chebvander(points, degree), np.eye(degree + 1), atol=1e-15 * degree
        )


def test_values_with_errors_do_not_degrade_truncated_series():
    """How much greater than errors at n nodes what they make of T_0 to T_b is, at most, on [-1, 1]: see `amplified`."""
    angles = np.linspace(0, np.pi, 1000)
    for n in range(2, 36):
        own, most = (2 * np.arange(n) + 1) * np.pi / (2 * n), 1 + 0.637 * np.log(n)
        for b in range(1, n):
            terms = np.arange(b + 1)
            weights = np.where(terms == 0, 1, 2) / n
            kernel = (np.cos(np.outer(angles, terms)) * weights) @ np.cos(np.outer(terms, own))
            assert np.abs(kernel).sum(axis=1).max() < most


@pytest.mark.thorough
def test_pyramids_of_high_order_need_few_sub_elements(renderer):
    """A sine, which is the same to five digits from order 4 on; errors of the terms that it hasn't are not followed."""
    counts = []
    for order in (4, 7):
        data = with_field(grid(Shape.PYRAMID, 1), lambda p: np.sin(2 * p[:, 0]) + p[:, 1] * p[:, 2], order + 1)
        drawer = IsosurfaceDrawer(DeviceVolume(renderer("vulkan").device, volume_of(data, ["u"])))
        hits = drawer.draw(View.through(CAMERA, (24, 20)), None, 0.8)
        assert (hits.status[hits.owner != NOBODY] == Status.CERTAIN).mean() > 0.95
        counts.append(drawer.counts["sub_elements"])
    assert counts[1] < 1.5 * counts[0]


@pytest.mark.thorough
def test_sub_elements_of_high_order_are_not_subdivided_for_errors_of_positions(renderer, monkeypatch):
    """These count for more the smaller a sub-element is, where straight rays leave less room for them."""
    halved, keep = [], IsosurfaceDrawer._keep
    monkeypatch.setattr(IsosurfaceDrawer, "_keep", lambda own, *of: halved.append(len(of[1])) or keep(own, *of))
    mesh = curved(grid(Shape.PRISM, 1), lambda p: p + 0.03 * np.sin(3 * p[..., [1, 2, 0]]), 8)
    data = with_field(mesh, lambda p: np.sin(3 * p[:, 0]) * np.cos(2 * p[:, 1]) + p[:, 2] ** 2, 9)
    drawer = IsosurfaceDrawer(DeviceVolume(renderer("vulkan").device, volume_of(data, ["d(u,x)"])))
    hits = drawer.draw(View.through(CAMERA, (12, 10)), None, 0.5)
    assert (hits.owner != NOBODY).sum() > 10
    assert sum(halved) < 320


@pytest.mark.parametrize("shape", [Shape.HEXAHEDRON, Shape.PYRAMID])
def test_a_pair_of_surfaces_seen_from_within_costs_few_sub_elements(renderer, shape):
    """Two planes 2^-8 apart: sub-elements next to the eye's plane, next to the picture, are not bisected to the end."""
    data = exact(shape, lambda p: (p[:, 2] - 0.375) * (p[:, 2] - 0.375 - 2.0**-8))
    camera = Camera((0.5, 0.6, 0.45), (0.45, 1.3, 0.2), (1.0, 0.0, 0.0), fov=90.0)
    view = View.through(camera, (24, 20))
    drawer = IsosurfaceDrawer(DeviceVolume(renderer("vulkan").device, volume_of(data, ["u"])))
    hits = drawer.draw(view, None, 0.0)
    assert drawer.counts["sub_elements"] < 400
    depth, inside = places(view, 2, 0.375 + 2.0**-8)
    seen = (inside > 1e-9) & (depth > 0)
    assert seen.sum() > 100
    assert (hits.status[seen] == Status.CERTAIN).mean() > 0.95
    right = np.abs(hits.depth - depth) <= hits.uncertainty
    assert right[seen & (hits.status == Status.CERTAIN)].all()


def test_pixels_behind_a_doubtful_surface_are_not_certain(draw):
    """The surface z = 1/2, flat, hides a plane below it."""
    data = exact(Shape.HEXAHEDRON, lambda p: height(p) ** 3, 1.0, 1.0)
    low = CutSurface(Plane((0.0, 0.0, 0.1), (0.0, 0.0, 1.0)))
    frame = draw(data, objects=(Isosurface((1.0,)), low), camera=CAMERA, size=SIZE)
    _, inside = places(frame.view, 2, 0.5)
    assert (frame.status.ravel()[inside > 0] == Status.AMBIGUOUS).all()
    assert (frame.status.ravel()[inside < -0.1] == Status.CERTAIN).sum() > 10

    # before it, the plane is certain
    high = CutSurface(Plane((0.0, 0.0, 0.9), (0.0, 0.0, 1.0)))
    frame = draw(data, objects=(Isosurface((1.0,)), high), camera=CAMERA, size=SIZE)
    above = places(frame.view, 2, 0.9)[1] > 1e-9
    assert (frame.status.ravel()[above] == Status.CERTAIN).all()


def constant(shape, value, other=0.0):
    """A field that is a value on all elements; other modes than those of vertices have the value ``other``."""
    data = with_field(grid(shape, 1), lambda p: np.ones(len(p)), 4)
    block = data.fields[0].blocks[0]
    modes = np.where(np.abs(block.coefficients) > 0.5, value, other)
    return Dataset(data.mesh, (Field("u", (Block(block.expansion, block.element_ids, modes),)),))


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.HEXAHEDRON])
def test_only_nearly_constant_elements_are_ambiguous(iso, shape):
    view = View.through(CAMERA, SIZE)
    for other, status in ((0.0, Status.MISS), (2.0**-55, Status.AMBIGUOUS)):
        hits = iso(constant(shape, 0.25, other), view, 0.25)
        assert (hits.owner == NOBODY).all()
        assert (hits.status[places(view, 2, 0.5)[1] > 1e-9] == status).all()


def test_rounding_of_expressions_counts(iso):
    """(u + 2^40) - 2^40 at 1/3: values are rounded to 2^-12, so that no place is certain."""
    view = View.through(CAMERA, SIZE)
    hits = iso(exact(Shape.HEXAHEDRON, lambda p: p[:, 2]), view, 0.33, "(u+1099511627776)-1099511627776")
    depth, inside = places(view, 2, 0.33)
    check(hits, depth, inside)
    assert (hits.status[inside > 0] == Status.AMBIGUOUS).all()
    assert (hits.owner[inside > 1e-2] != NOBODY).all()


def test_a_surface_within_a_shared_face_is_found(iso):
    """u = z over two layers of elements, at the height of the face between them: there is no gap."""
    view = View.through(CAMERA, SIZE)
    for shape in (Shape.TETRAHEDRON, Shape.HEXAHEDRON):
        hits = iso(exact(shape, lambda p: p[:, 2], cells=2), view, 0.5)
        depth, inside = places(view, 2, 0.5)
        check(hits, depth, inside)
        assert (hits.owner[inside > 1e-9] != NOBODY).all()
        assert (hits.status[inside > 1e-9] == Status.AMBIGUOUS).all()


def test_remarks_report_constant_elements(draw):
    data = constant(Shape.HEXAHEDRON, 0.25)
    frame = draw(data, objects=(Isosurface((0.25,)), CutSurface(Plane((0.5, 0.5, 0.5), (0.0, 0.0, 1.0)))), size=(8, 8))
    assert any("u is 0.25 everywhere: 1" in remark for remark in frame.stats["remarks"])
