"""Contour lines and mesh lines, pixel by pixel, against curves in closed form."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from warps import bent_plane, bent_volume, cubic, straightened_volume

from elvis import Camera, Plane
from elvis.core.mapping.margins import margins
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, mixed_plane, mixed_volume, one_element, shuffled, with_field
from elvis.plugins.faces import faces_of
from elvis.plugins.native.buffers import NativeVolume
from elvis.plugins.runtime.serving import volume_of
from elvis.renderer.passes.faces.faces import FaceDrawer
from elvis.renderer.passes.lines.lines import Lines, line_coverage
from elvis.renderer.passes.plane.cut import Cutter
from elvis.renderer.passes.solids.solids import values_at_hits
from elvis.renderer.raster.gaps import beside
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import PlaneView, View
from elvis.scene.model.errors import SceneError
from elvis.scene.record.palette import levels

#: how far coverages may be from the truth: a line's middle is displaced by no more than this, in pixels
CLOSE = 0.02
SIZE = (130, 110)
REACH = 12.0  # pixels, farther than any line here is wide
FLAT = Plane((0.5, 0.5, 0.52), (0.0, 0.0, 1.0))
CAMERAS = {
    "straight on": Camera((0.5, 0.5, 3.0), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0), height=1.2),
    "oblique": Camera((2.5, -1.5, 3.0), (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), height=1.2),
    "perspective": Camera((1.1, -0.5, 2.0), (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), fov=40.0),
}


@pytest.fixture(scope="session")
def cut(renderer):
    """Lines of a dataset's field, a view of a plane and the hit buffer of the cut there."""

    def cut(dataset, plane=FLAT, camera=CAMERAS["straight on"], size=SIZE, device="vulkan"):
        loaded = DeviceVolume(renderer(device).device, NativeVolume.of(dataset, dataset.fields[0].name))
        view = PlaneView.on(View.through(camera, size), plane)
        return Lines(loaded), view, Cutter(loaded).draw(view)

    return cut


def distances(view, points):
    """(n,) pixels from each pixel's centre to the nearest of many points (m, 3) of a curve, infinite beyond REACH."""
    seen = np.column_stack([points, np.ones(len(points))]) @ view.to_pixel.T
    i, j = np.meshgrid(np.arange(view.width), np.arange(view.height))
    centres = np.column_stack([i.ravel(), j.ravel()])
    return cKDTree(seen[:, :2] / seen[:, 2:]).query(centres, distance_upper_bound=REACH)[0]


def curve(view, function):
    """World points (m, 3), a fiftieth of a pixel apart, where a function of world points is zero on the view's plane.

    Linear interpolation along the sides of squares of an eighth of a pixel.
    """
    x, y = (np.arange(-2.0, side + 2.0, 1 / 8) for side in (view.width, view.height))
    i, j = np.meshgrid(x, y)
    with np.errstate(all="ignore"):
        values = function(view.points_of(i.ravel(), j.ravel())).reshape(i.shape)
    ends = []
    for axis in (0, 1):
        near, far = (values[:-1], values[1:]) if axis == 0 else (values[:, :-1], values[:, 1:])
        row, column = np.nonzero((near > 0) != (far > 0))
        part = near[row, column] / (near[row, column] - far[row, column])
        ends.append(np.column_stack([column + part * (axis == 1), row + part * (axis == 0)]) / 8 - 2.0)
    places = np.concatenate(ends)
    pairs = cKDTree(places).query_pairs(0.18, output_type="ndarray")
    part = np.linspace(0, 1, 9)[:, None, None]
    dense = ((1 - part) * places[pairs[:, 0]] + part * places[pairs[:, 1]]).reshape(-1, 2)
    return view.points_of(*dense.T)


def check(hits, coverage, distance, width, close=CLOSE):
    """Coverage as the distances say wherever something is hit, and none elsewhere."""
    hit = hits.owner != NOBODY
    expected = line_coverage(distance, width)
    assert (expected[hit] > 0.2).any()
    assert np.abs(coverage - expected)[hit].max() < close
    assert (coverage[~hit] == 0.0).all()


def circle(center, radius):
    """(n, 3) points of a circle in the plane FLAT, as close together whatever its radius."""
    angle = np.linspace(0, 2 * np.pi, 100 + int(125_000 * radius))
    x, y = center[0] + radius * np.cos(angle), center[1] + radius * np.sin(angle)
    return np.column_stack([x, y, np.full_like(angle, 0.52)])


def square_distance(center):
    return lambda points: ((points[..., :2] - center) ** 2).sum(axis=-1) + 0.3 * (points[..., 2] - 0.52)


@pytest.mark.sampled
@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("shape", Shape.of_dimension(3), ids=lambda shape: shape.label)
def test_circles(cut, shape, camera):
    center = (0.47, 0.52)
    lines, view, hits = cut(with_field(grid(shape, 3), square_distance(center)), camera=CAMERAS[camera])
    radii = np.array([0.15, 0.3, 0.4])
    drawn = lines.contours(view, hits, radii**2, 1.5)
    apart = np.stack([distances(view, circle(center, radius)) for radius in radii])
    check(hits, drawn.coverage, apart.min(axis=0), 1.5)
    near = drawn.number >= 0
    assert np.array_equal(drawn.number[near], apart.argmin(axis=0)[near])


@pytest.mark.parametrize("shape", [*Shape.of_dimension(2), *Shape.of_dimension(3)], ids=lambda shape: shape.label)
def test_facets_of_reference_shapes(renderer, shape):
    """The smallest of the facets that are found is the margin, anywhere; here it is 2, not 1, at the far end."""
    dataset = with_field(one_element(shape), lambda p: p[..., 0])
    lines = Lines(DeviceVolume(renderer("vulkan").device, NativeVolume.of(dataset, "u")))
    facets = lines.facets(0)
    assert len(facets) == (len(shape.faces) if shape.dimension == 3 else len(shape.edges))
    points = np.random.default_rng(1).uniform(-1.5, 1.5, (500, 3))
    expected = 2 * margins(shape, points[:, : shape.dimension])
    assert np.abs((points @ facets[:, :3].T + facets[:, 3]).min(axis=1) - expected).max() < 1e-12


@pytest.mark.thorough
def test_both_devices_draw_the_same(cut):
    field = with_field(grid(Shape.HEXAHEDRON, 3), square_distance((0.47, 0.52)))
    found = [cut(field, size=(60, 50), device=device) for device in ("vulkan", "cpu")]
    drawn = [lines.contours(view, hits, np.array([0.02, 0.09]), 1.5) for lines, view, hits in found]
    assert np.abs(drawn[0].coverage - drawn[1].coverage).max() < 1e-4
    assert np.array_equal(drawn[0].number, drawn[1].number)
    assert np.abs(np.subtract(*(lines.mesh(view, hits, 1.5).coverage for lines, view, hits in found))).max() < 1e-9


def test_contours_of_an_expression(renderer):
    """Another quantity than the part's own, and no polynomial."""
    distance = "sqrt((x-0.47)^2+(y-0.52)^2)"
    volume = volume_of(with_field(grid(Shape.HEXAHEDRON, 3), lambda p: p[..., 0]), ["u", distance])
    loaded = DeviceVolume(renderer("vulkan").device, volume)
    view = PlaneView.on(View.through(CAMERAS["straight on"], SIZE), FLAT)
    hits = Cutter(loaded).draw(view)
    hits = hits.showing(values_at_hits(loaded, hits, distance))
    drawn = Lines(loaded).contours(view, hits, np.array([0.2, 0.3]), 1.5, distance)
    check(hits, drawn.coverage, np.min([distances(view, circle((0.47, 0.52), r)) for r in (0.2, 0.3)], axis=0), 1.5)


@pytest.mark.parametrize("width", [0.5, 1.0, 3.0, 7.5])
def test_widths(cut, width):
    lines, view, hits = cut(with_field(grid(Shape.PRISM, 2), square_distance((0.5, 0.5))))
    drawn = lines.contours(view, hits, np.array([0.09]), width)
    check(hits, drawn.coverage, distances(view, circle((0.5, 0.5), 0.3)), width)


def test_line_is_where_it_is_on_average(cut):
    """The centroid of what a line covers in each row of pixels, for a line at all offsets from the pixels' centres."""
    lines, view, hits = cut(with_field(grid(Shape.TETRAHEDRON, 2), lambda p: p[..., 0] + 0.013 * p[..., 1]))
    drawn = lines.contours(view, hits, np.array([0.52]), 2.0).coverage.reshape(view.height, view.width)
    inside = (drawn.sum(axis=1) > 1.0) & (hits.owner.reshape(drawn.shape) != NOBODY)[:, 64]
    centroid = (drawn @ np.arange(view.width))[inside] / drawn.sum(axis=1)[inside]
    rows = np.flatnonzero(inside)
    y = view.points()[rows, 64, 1]
    x = 0.52 - 0.013 * y
    expected = view.to_pixel[0] @ np.stack([x, y, np.full_like(y, 0.52), np.ones_like(y)])
    assert len(rows) > 80
    assert np.abs(centroid - expected).max() < CLOSE


@pytest.mark.parametrize("pixels", [0.3, 0.1, 1e-3])
@pytest.mark.parametrize("sign", [1, -1])
def test_loops_smaller_than_a_pixel(cut, pixels, sign):
    """Wherever in a pixel, and wherever in the elements, the loop is."""
    rng, size, center = np.random.default_rng(7), 1.2 / SIZE[1], np.array([0.34, 0.67])
    field = with_field(grid(Shape.HEXAHEDRON, 3), lambda p: sign * square_distance(center)(p))
    value = sign * np.array([(pixels * size) ** 2])
    for x, y in rng.uniform(0.4, 0.6, (5, 2)):
        camera = Camera((x, y, 3.0), (x, y, 0.5), (0.0, 1.0, 0.0), height=1.2)
        lines, view, hits = cut(field, camera=camera)
        drawn = lines.contours(view, hits, value, 1.0)
        check(hits, drawn.coverage, distances(view, circle(center, pixels * size)), 1.0, 0.05)
        assert not lines.contours(view, hits, -value, 1.0).coverage.any()


@pytest.mark.parametrize("depth", [0.05, 0.2, 0.45])
def test_lines_that_enter_and_leave_by_one_edge(cut, depth):
    """A parabola whose vertex only just reaches into a row of pixels."""
    field = with_field(grid(Shape.HEXAHEDRON, 3), lambda p: p[..., 1] - 12 * (p[..., 0] - 0.5) ** 2)
    lines, view, hits = cut(field)
    row = view.to_pixel[1] @ [0.5, 0.3, 0.52, 1.0]
    value = 0.3 + (row - (np.floor(row) + 0.5 - depth)) * 1.2 / SIZE[1]
    x = np.linspace(0.2, 0.8, 50_000)
    points = np.column_stack([x, value + 12 * (x - 0.5) ** 2, np.full_like(x, 0.52)])
    drawn = lines.contours(view, hits, np.array([value]), 1.0)
    check(hits, drawn.coverage, distances(view, points[points[:, 1] < 1.0]), 1.0)


@pytest.mark.parametrize("values", [(-0.97, 0.97), (-0.5, 0.1, 0.7)])
def test_waves_of_five_pixels(cut, values):
    """Fields of high order where contours are as small and as close as pixels."""

    def waves(points):
        return np.sin(40 * points[..., 0]) * np.sin(40 * points[..., 1] + 0.3)

    lines, view, hits = cut(with_field(grid(Shape.HEXAHEDRON, 6), waves, 10), size=(40, 40))
    apart = np.min([distances(view, curve(view, lambda p, v=v: waves(p) - v)) for v in values], axis=0)
    near = np.isfinite(hits.depth).reshape(view.height, view.width)
    inner = (near & ~grown(~near, 2)).ravel()
    difference = lines.contours(view, hits, np.array(values), 1.0).coverage - line_coverage(apart, 1.0)
    assert np.abs(difference)[inner].max() < 0.025


def test_jumps_leave_gaps(cut):
    """A field that steps from element to element: lines end at the steps, and no line is drawn along them."""
    step = lambda points: points[..., 1] + 0.25 * np.floor(2 * points[..., 0])  # noqa: E731
    lines, view, hits = cut(with_field(grid(Shape.HEXAHEDRON, 2), step))
    part = np.linspace(0, 0.5, 100_000)
    high = np.full_like(part, 0.52)
    points = np.concatenate([np.column_stack([part, np.full_like(part, 0.6), high]),
                             np.column_stack([part + 0.5, np.full_like(part, 0.35), high])])  # fmt: skip
    check(hits, lines.contours(view, hits, np.array([0.6]), 2.0).coverage, distances(view, points), 2.0)

    lines, view, hits = cut(
        with_field(grid(Shape.TETRAHEDRON, 2), lambda p: 1e-3 * p[..., 0] + np.floor(2 * p[..., 0]))
    )
    assert not lines.contours(view, hits, np.array([0.25, 0.5, 0.9]), 2.0).coverage.any()


@pytest.mark.parametrize("camera", ["straight on", "perspective"])
def test_contours_in_curved_elements(cut, camera):
    mesh = shuffled(mixed_volume(seed=5), seed=2)
    dataset = with_field(curved(mesh, bent_volume, 3), lambda points: cubic(straightened_volume(points)), 4)
    plane = Plane((1.4, 0.9, 0.6), (0.1, 0.2, 1.0))
    view_of = {
        "straight on": Camera((1.4, 0.6, 4.0), (1.4, 0.6, 0.6), (0.0, 1.0, 0.0), height=2.5),
        "perspective": Camera((2.0, -0.8, 3.0), (1.4, 0.6, 0.6), (0.0, 0.0, 1.0), fov=50.0),
    }
    lines, view, hits = cut(dataset, plane, view_of[camera], (90, 76))

    # far from the border of the domain, where the curve goes on and the line does not
    values = np.array([1.6, 2.5, 4.0])
    apart = np.min(
        [distances(view, curve(view, lambda p, v=v: cubic(straightened_volume(p)) - v)) for v in values], axis=0
    )
    near = np.isfinite(hits.depth).reshape(view.height, view.width)
    inner = near & ~grown(~near, 3)
    coverage = lines.contours(view, hits, values, 1.5).coverage
    assert inner.sum() > 500
    assert np.abs(coverage - line_coverage(apart, 1.5)).reshape(inner.shape)[inner].max() < CLOSE


def grown(mask, steps):
    """A mask (h, w) and all within some pixels of it."""
    for _ in range(steps):
        mask = mask | np.roll(mask, 1, 0) | np.roll(mask, -1, 0)
        mask = mask | np.roll(mask, 1, 1) | np.roll(mask, -1, 1)
    return mask


@pytest.mark.parametrize("camera", CAMERAS)
def test_mesh_lines_of_straight_elements(cut, camera):
    lines, view, hits = cut(with_field(grid(Shape.HEXAHEDRON, 4), lambda p: p[..., 0], 2), camera=CAMERAS[camera])
    part = np.linspace(0, 1, 20_000)
    rows = [np.column_stack([part, np.full_like(part, k / 4), np.full_like(part, 0.52)]) for k in range(5)]
    points = np.concatenate([*rows, *(row[:, [1, 0, 2]] for row in rows)])
    for width in (1.0, 3.5):
        check(hits, lines.mesh(view, hits, width).coverage, distances(view, points), width, 1e-3)


def test_mesh_lines_of_slivers_that_are_thinner_than_lines(cut):
    """Everything is covered where elements are half a pixel wide, and next to them only what is near them."""
    mesh = grid(Shape.HEXAHEDRON, 6)
    moved = mesh.vertices.copy()
    moved[:, 0] = np.interp(mesh.vertices[:, 0], np.arange(7) / 6, [0, 0.3, 0.302, 0.304, 0.306, 0.308, 1])
    dataset = with_field(type(mesh)(**{**vars(mesh), "vertices": moved}), lambda p: p[..., 0], 2)
    lines, view, hits = cut(dataset, size=(260, 220))
    coverage = lines.mesh(view, hits, 1.5).coverage.reshape(view.height, view.width)
    x = view.points()[110, :, 0]
    assert (coverage[110][(x > 0.2995) & (x < 0.3085)] == 1.0).all()


@pytest.mark.parametrize("size", [(140, 60), (300, 120)])
def test_mesh_lines_of_curved_elements(cut, size):
    mesh = shuffled(mixed_plane(seed=3), seed=1)
    plane, camera = Plane((0, 0, 0), (0, 0, 1)), Camera((1.5, 1.2, 5.0), (1.5, 1.2, 0.0), (0, 1, 0), height=3.2)
    lines, view, hits = cut(with_field(curved(mesh, bent_plane, 3), lambda p: p[..., 0], 2), plane, camera, size)
    part = np.linspace(0, 1, 10_000)[:, None]
    sides = [([x, 0, 0], [x, 1, 0]) for x in range(4)] + [([1, 0, 0], [2, 1, 0])]
    sides += [([x, y, 0], [x + 1, y, 0]) for x in range(3) for y in (0, 1)]
    points = np.concatenate([bent_plane((1 - part) * a + part * b) for a, b in np.array(sides, float)])
    check(hits, lines.mesh(view, hits, 1.5).coverage, distances(view, points), 1.5)


def test_mesh_lines_of_curved_volumes(cut):
    mesh = curved(grid(Shape.HEXAHEDRON, 3), bent_volume, 3)
    dataset = with_field(mesh, lambda p: p[..., 0], 2)
    camera = Camera((0.5, 0.6, 4.0), (0.5, 0.6, 0.6), (0.0, 1.0, 0.0), height=1.4)
    lines, view, hits = cut(dataset, Plane((0.5, 0.5, 0.5), (0.3, 0.2, 1.0)), camera, (90, 76))

    def nearest(axis, level):
        return distances(view, curve(view, lambda p: straightened_volume(p)[:, axis] - level))

    crossed = [(0, 1 / 3), (0, 2 / 3), (1, 1 / 3), (1, 2 / 3), (2, 1 / 3), (2, 2 / 3)]
    apart = np.min([nearest(axis, level) for axis, level in crossed], axis=0)
    near = np.isfinite(hits.depth).reshape(view.height, view.width)
    inner = near & ~grown(~near, 2)
    difference = np.abs(lines.mesh(view, hits, 1.5).coverage - line_coverage(apart, 1.5)).reshape(inner.shape)
    assert difference[inner].max() < CLOSE


@pytest.mark.sampled(least=2, free=("shape",))
@pytest.mark.parametrize("shape", Shape.of_dimension(3), ids=lambda shape: shape.label)
def test_lines_don_t_depend_on_the_elements_turns_and_orders(cut, shape):
    mesh = grid(shape, 2)
    first, second = (
        cut(with_field(some, square_distance((0.4, 0.45)), modes))
        for some, modes in ((mesh, 3), (curved(shuffled(mesh, seed=4), lambda points: points, 3), 4))
    )
    values = np.array([0.01, 0.05, 0.12])
    pairs = [
        (lines.contours(view, hits, values, 1.5).coverage, lines.mesh(view, hits, 1.0).coverage)
        for lines, view, hits in (first, second)
    ]
    same = (first[2].owner == NOBODY) == (second[2].owner == NOBODY)
    assert same.mean() > 0.999
    assert np.abs(pairs[0][0] - pairs[1][0])[same].max() < 1e-3
    assert np.abs(pairs[0][1] - pairs[1][1])[same].max() < 1e-6


def test_contours_on_faces_run_over_the_edges_of_a_cube(renderer):
    dataset = with_field(grid(Shape.HEXAHEDRON, 2), lambda p: p @ [1.0, 2.0, 3.0], 2)
    volume = NativeVolume.of(dataset, "u")
    loaded = DeviceVolume(renderer("vulkan").device, volume)
    view = View.through(Camera((4.0, 3.0, 2.5), (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), fov=30.0), SIZE)
    hits = FaceDrawer(loaded, faces_of(dataset, volume)).draw(view)

    # the three sides that are seen: segments where one coordinate is 1
    points, values = [], np.array([2.0, 3.1, 4.4])
    part = np.linspace(0, 1, 20_000)
    for fixed, weights in enumerate([(2.0, 3.0), (1.0, 3.0), (1.0, 2.0)]):
        for value in values - [1.0, 2.0, 3.0][fixed]:
            rest = (value - weights[0] * part) / weights[1]
            side = np.column_stack([part, rest])[(rest >= 0) & (rest <= 1)]
            points.append(np.insert(side, fixed, 1.0, axis=1))
    check(hits, Lines(loaded).contours(view, hits, values, 1.5).coverage, distances(view, np.concatenate(points)), 1.5)

    # the lines of the mesh on them
    sides = [np.insert(np.column_stack([part, np.full_like(part, k / 2)])[:, ::turn], fixed, 1.0, axis=1)
             for fixed in range(3) for k in range(3) for turn in (1, -1)]  # fmt: skip
    check(hits, Lines(loaded).mesh(view, hits, 1.5).coverage, distances(view, np.concatenate(sides)), 1.5)


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.HEXAHEDRON], ids=lambda shape: shape.label)
@pytest.mark.parametrize("camera", ["oblique", "perspective"])
def test_contours_on_curved_faces_match_the_face(renderer, shape, camera):
    # two fields with the same values on the curved upper face, of which one rises steeply towards it from below
    mesh, view = curved(grid(shape, 2), bent_volume, 3), View.through(CAMERAS[camera], SIZE)
    drawn = []
    for rise in (0.0, 100.0):

        def field(points, rise=rise):
            straight = straightened_volume(points)
            return straight[:, 0] + rise * (straight[:, 2] - 1)

        dataset = with_field(mesh, field, 4)
        volume = NativeVolume.of(dataset, "u")
        loaded = DeviceVolume(renderer("vulkan").device, volume)
        hits = FaceDrawer(loaded, faces_of(dataset, volume)).draw(view)
        above = hits.normal[:, 2] > 0.5
        drawn.append((above, Lines(loaded).contours(view, hits, np.array([0.2, 0.45, 0.8]), 1.5).coverage))
    inner = _inside(drawn[0][0].reshape(view.height, view.width), 2).ravel()
    assert inner.sum() > 1500
    assert (drawn[0][1][inner] > 0.5).sum() > 100
    assert np.abs(drawn[0][1] - drawn[1][1])[inner].max() < CLOSE


def _inside(mask, steps):
    """Pixels all around which, this many steps far, the mask holds."""
    for _ in range(steps):
        mask = mask & ~beside(~mask)
    return mask


def test_nan_values_have_no_lines(cut):
    lines, view, hits = cut(with_field(grid(Shape.HEXAHEDRON, 2), lambda p: p[..., 0]))
    hits.field = np.full_like(hits.field, np.nan)
    far = lines.contours(view, hits, np.array([7.0]), 1.0)
    assert not far.coverage.any()
    assert (far.number == -1).all()


def test_limits_are_reported(cut):
    lines, view, hits = cut(with_field(grid(Shape.HEXAHEDRON, 1), lambda p: p[..., 0]))
    with pytest.raises(SceneError, match="at most 1024 contour values are drawn at once, found 1025"):
        lines.contours(view, hits, np.linspace(0, 1, 1025), 1.0)
    with pytest.raises(SceneError, match="at most 100 pixels wide, found 101"):
        lines.mesh(view, hits, 101.0)
    assert np.allclose(levels(0.0, 1.0, 3), [0.25, 0.5, 0.75])
