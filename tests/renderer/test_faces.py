"""Faces of elements: every hit against analytic expressions and against brute force, from every side, folded or not."""

import numpy as np
import pytest

from elvis import Camera, Status
from elvis.core.data.dataset import Dataset, Field
from elvis.core.polynomials.bernstein import bernstein_values
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, one_element, shuffled
from elvis.plugins.faces import faces_of
from elvis.plugins.native import NativeVolume
from elvis.renderer.device.drafts import drafted
from elvis.renderer.passes.faces.faces import CLOSE_IN_DRAFTS, FaceDrawer
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View

DEVICES = ("vulkan", "cpu")


def cameras(at, distance, height):
    """Cameras of both kinds from all sides, some along axes, looking at a place."""
    ways = [(1, 0, 0), (0, 0, 1), (0.3, -0.5, 0.8), (-0.7, 0.7, 0.1), (-1, -1, -1)]
    for k, way in enumerate(np.array(ways, float)):
        eye = tuple(np.array(at) + distance * way / np.linalg.norm(way))
        up = (0.0, 1.0, 0.0) if k == 1 else (0.1, 0.2, 1.0)
        size = {"height": height} if k % 2 else {"fov": float(2 * np.degrees(np.arctan(0.5 * height / distance)))}
        yield Camera(eye, at, up, **size)


def mapped(mesh, function, modes, field=lambda p: p[:, 0] - 2 * p[:, 1] * p[:, 2]):
    """A mesh carried away by a polynomial function of its straight points, with a field of these of order 3."""
    plain = Dataset(mesh)
    maps = {f"map_{axis}": lambda p, i=i: function(p)[:, i] for i, axis in enumerate("xyz")}
    fields = [approximated(plain, name, f, modes) for name, f in maps.items()]
    fields = tuple(Field(each.name, tuple(each.blocks)) for each in (*fields, approximated(plain, "u", field, 4)))
    return Dataset(mesh, fields, metadata={"GeometryMap": "map_x,map_y,map_z"})


def test_drafts_show_the_same_faces_a_little_off(drawer):
    own = drawer(mapped(grid(Shape.HEXAHEDRON, 2), lambda p: p + 0.1 * np.sin(2 * p[:, [1, 2, 0]]), 5))
    (camera, *_) = cameras((0.5, 0.5, 0.5), 3.0, 1.8)
    view = View.through(camera, (90, 80))
    exact = own.draw(view)
    with drafted():
        draft = own.draw(view)
    after = own.draw(view)
    assert np.array_equal(draft.owner, exact.owner)
    seen = exact.owner != NOBODY
    off = np.abs(draft.depth[seen] - exact.depth[seen]).max()
    # Newton's method ends earlier: the rest is of the order of its last step squared
    assert 1e-16 < off < CLOSE_IN_DRAFTS**1.5
    assert np.array_equal(after.depth, exact.depth)


@pytest.fixture(scope="module")
def drawer(renderer):
    """The faces of a dataset on a device."""

    def make(dataset, device="vulkan"):
        volume = NativeVolume.of(dataset, "u")
        return FaceDrawer(DeviceVolume(renderer(device).device, volume), faces_of(dataset, volume))

    return make


def paraboloid(points):
    """The top of the cube [-1, 1]^3 becomes z = 1 - x^2 - y^2 / 2, the sides stay upright, the bottom flat."""
    x, y, z = points.T
    return np.stack([x, y, (1 + z) / 2 * (1 - x**2 - y**2 / 2) - (1 - z)], axis=1)


def roots_on_paraboloid(view):
    """(pixels, 2) depths of a view's rays on the paraboloid over [-1, 1]^2, infinite where there are none."""
    pixels = np.arange(view.count)
    origin, way = view.rays(pixels % view.width, pixels // view.width)
    scale = np.array([1.0, 0.5, 0.0])
    a, b = (way**2) @ scale, 2 * (origin * way) @ scale + way[:, 2]
    c = (origin**2) @ scale + origin[:, 2] - 1
    with np.errstate(invalid="ignore"):
        q = -0.5 * (b + np.where(b < 0, -1.0, 1.0) * np.sqrt(b**2 - 4 * a * c))
        depths = np.stack([np.divide(q, a, out=np.full_like(q, np.inf), where=a != 0), c / q], axis=1)
        places = origin[:, None] + depths[..., None] * way[:, None]
        held = (np.abs(places[..., :2]) <= 1).all(axis=2) & (depths > 0)
    return np.sort(np.where(held, depths, np.inf), axis=1)


@pytest.mark.parametrize("device", DEVICES)
def test_hits_of_a_paraboloid_satisfy_its_equation(drawer, device):
    mesh = one_element(Shape.HEXAHEDRON)
    dataset = mapped(mesh, paraboloid, 3)
    drawn = drawer(dataset, device)
    top = [k for k in range(6) if abs(mesh.vertices[[*Shape.HEXAHEDRON.faces[k]]][:, 2] - 1).max() == 0]
    for block in drawn.faces.blocks:
        drawn.faces.boundaries["top"] = block.entity[np.isin(block.local, top)]
    folded = 0
    for camera in cameras((0.0, 0.1, 0.2), 6.0, 3.0):
        view = View.through(camera, (74, 60))
        truth = roots_on_paraboloid(view)
        first = drawn.draw(view, ["top"])
        second = drawn.draw(view, ["top"], beyond=first.depth)
        hits = drawn.hits(view, ["top"])
        certain = first.status != Status.AMBIGUOUS
        assert (~certain).sum() < 4
        for buffer, depths in ((first, truth[:, 0]), (second, truth[:, 1])):
            found = buffer.owner != NOBODY
            assert np.array_equal(found[certain], np.isfinite(depths[certain]))
            both = found & np.isfinite(depths)
            assert np.abs(buffer.depth[both] - depths[both]).max(initial=0) < 1e-10
            check_buffer(view, buffer, found)
        assert np.array_equal(
            np.bincount(hits["pixel"], minlength=view.count)[certain], np.isfinite(truth[certain]).sum(1)
        )
        folded += np.isfinite(truth[:, 1]).sum()
    assert folded > 250


def check_buffer(view, buffer, found):
    """Positions on the paraboloid, normals along its gradient and towards the viewer, fields of the straight places."""
    pixels = np.flatnonzero(found)
    origin, way = view.rays(pixels % view.width, pixels // view.width)
    place = origin + buffer.depth[pixels, None] * way
    assert np.abs(place[:, 2] - 1 + place[:, 0] ** 2 + place[:, 1] ** 2 / 2).max(initial=0) < 1e-10
    gradient = np.column_stack([2 * place[:, 0], place[:, 1], np.ones(len(place))])
    gradient /= -np.linalg.norm(gradient, axis=1, keepdims=True) * np.sign((gradient * way).sum(1, keepdims=True))
    assert np.abs(buffer.normal[pixels] - gradient).max(initial=0) < 1e-9
    assert np.abs(buffer.reference[pixels, :2] - place[:, :2]).max(initial=0) < 1e-10
    assert np.abs(buffer.field[pixels] - place[:, 0] + 2 * place[:, 1]).max(initial=0) < 1e-10
    assert np.isnan(buffer.field[~found]).all()
    assert np.isinf(buffer.depth[~found]).all()


def crossings(net, space, view, steps=320):
    """(pixels,) how often rays meet a face, counted on a fine grid of plane triangles."""
    line = np.linspace(-1, 1, steps + 1)
    s, t = (part.reshape(-1) for part in np.meshgrid(line, line, indexing="ij"))
    values = np.concatenate([bernstein_values(space.space, p) for p in np.array_split(np.column_stack([s, t]), 20)])
    screen = values @ (net @ view.to_pixel.T)
    corners = (screen[:, :2] / screen[:, 2:]).reshape(steps + 1, steps + 1, 2)
    lower = np.stack([corners[:-1, :-1], corners[1:, :-1], corners[:-1, 1:]], axis=2)
    upper = np.stack([corners[1:, 1:], corners[1:, :-1], corners[:-1, 1:]], axis=2)
    if space.shape is Shape.TRIANGLE:
        i, j = np.indices((steps, steps))
        lower, upper = lower[i + j < steps], upper[i + j < steps - 1]
    triangles = np.concatenate([lower.reshape(-1, 3, 2), upper.reshape(-1, 3, 2)])

    # those that are small hold one centre of a pixel at most
    centre = np.rint(triangles.mean(axis=1))
    assert np.abs(triangles - triangles.mean(axis=1, keepdims=True)).max() < 0.45
    a, b, c = (triangles - centre[:, None]).transpose(1, 0, 2)
    turns = np.stack([x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0] for x, y in ((a, b), (b, c), (c, a))])
    inside = (turns > 0).all(axis=0) | (turns < 0).all(axis=0)
    inside &= (centre >= 0).all(axis=1) & (centre < [view.width, view.height]).all(axis=1)
    pixel = (centre[:, 1] * view.width + centre[:, 0])[inside].astype(np.int64)
    return np.bincount(pixel, minlength=view.count)


def wild(seed, shape):
    """An element whose faces fold and cross one another."""
    mesh = one_element(shape)
    rng = np.random.default_rng(seed)
    powers = rng.normal(size=(3, 3, 3, 3)) * (np.indices((3, 3, 3)).sum(axis=0) <= 3)

    def function(p):
        x, y, z = (part[:, None] ** np.arange(3) for part in p.T)
        return p + 0.5 * np.einsum("ni,nj,nk,dijk->nd", x, y, z, powers)

    return mapped(mesh, function, 4)


@pytest.mark.sampled
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("shape", Shape.of_dimension(3))
def test_brute_force_counts_the_same_hits(drawer, shape, seed):
    drawn = drawer(wild(seed, shape))
    nets = [(block.space, net) for block in drawn.faces.blocks for net in block.nets(np.arange(len(block)))]
    points = np.concatenate([net[:, :3] for _, net in nets])
    middle, radius = points.mean(axis=0), np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    camera = list(cameras(tuple(middle), 3 * radius, 1.5 * radius))[2 + seed]
    view = View.through(camera, (32, 28))
    hits = drawn.hits(view)
    counted = sum(crossings(net, space, view) for space, net in nets)
    found = np.bincount(hits["pixel"], minlength=view.count)
    assert counted.max() >= 2
    assert (found != counted).sum() <= 2  # the grid's triangles are not the faces
    assert (hits["status"] == 1).all()
    assert (found % 2 == 0).mean() > 0.999
    buffer = drawn.draw(view)
    assert (buffer.status[found != counted] == Status.AMBIGUOUS).all() or (found != counted).sum() <= 2


@pytest.fixture(scope="module")
def mixed():
    """Elements of all shapes, curved, with a field; entered any way round, and with any number of nodes."""

    def make(seed=1, nodes=4):
        mesh = curved(shuffled(mixed_volume(3), seed), lambda p: p + 0.2 * np.sin(1) * p[:, [1, 2, 0]] ** 2, nodes)
        plain = Dataset(mesh)
        field = approximated(plain, "u", lambda p: p[:, 0] - 2 * p[:, 1] * p[:, 2], 4)
        return Dataset(mesh, (Field("u", field.blocks),))

    return make


PLACES = {
    "outside": Camera((4, -3, 3), (1.4, 0.9, 0.6), height=4.0),
    "along an axis": Camera((1.4, 0.9, 9.0), (1.4, 0.9, 0.6), (0, 1, 0), height=4.0),
    "near": Camera((2.6, -0.6, 1.5), (1.4, 0.9, 0.6), fov=80.0),
    "inside": Camera((0.4, 0.45, 0.5), (1.4, 0.9, 0.6), fov=100.0),
}


@pytest.mark.parametrize("place", PLACES)
def test_closed_hulls_have_no_gaps_or_duplicate_hits(drawer, mixed, place):
    drawn, view = drawer(mixed()), View.through(PLACES[place], (120, 90))
    hits, buffer = drawn.hits(view), drawn.draw(view)
    counts = np.bincount(hits["pixel"], minlength=view.count)
    sure = buffer.status != Status.AMBIGUOUS
    assert (~sure).sum() < 5
    sure[hits["pixel"][hits["margin"] < 1e-6]] = False  # rays along edges and flat walls
    assert (~sure).sum() < 9
    assert counts[sure].max() >= 2 - (place == "inside")
    assert (counts[sure] % 2 == (place == "inside")).all()

    # rays go in and out by turns, and hit buffers have the hits one after another
    turn = np.arange(len(hits)) - np.searchsorted(hits["pixel"], hits["pixel"]) + (place == "inside")
    certain = sure[hits["pixel"]]
    assert np.array_equal(hits["entering"][certain], 1 - turn[certain] % 2)
    for number in range(2):
        here = np.flatnonzero(np.isfinite(buffer.depth) & sure)
        own = hits[np.searchsorted(hits["pixel"], here) + number]
        assert np.array_equal(buffer.depth[here], own["depth"])
        assert np.array_equal(buffer.owner[here], own["element"])
        buffer = drawn.draw(view, beyond=buffer.depth) if number == 0 else buffer
        sure &= buffer.status != Status.AMBIGUOUS
        sure &= counts >= 2


def test_bands_of_rows_match_the_whole_picture(drawer, mixed):
    drawn, view = drawer(mixed()), View.through(PLACES["near"], (120, 90))
    hits = drawn.hits(view)
    rows = (hits["pixel"] >= 30 * 120) & (hits["pixel"] < 51 * 120)
    assert np.array_equal(drawn.hits(view, rows=(30, 51)), hits[rows])


@pytest.mark.parametrize("place", ["outside", "near"])
def test_pictures_are_independent_of_the_mesh_description(drawer, mixed, place):
    view = View.through(PLACES[place], (120, 90))
    first = drawer(mixed()).draw(view)
    for other in (mixed(seed=5), mixed(nodes=3)):
        buffer = drawer(other).draw(view)
        sure = (first.status != Status.AMBIGUOUS) & (buffer.status != Status.AMBIGUOUS)
        assert (~sure).sum() < 5
        hit = sure & np.isfinite(first.depth)
        assert np.array_equal(np.isfinite(buffer.depth[sure]), np.isfinite(first.depth[sure]))
        assert np.abs(buffer.depth[hit] - first.depth[hit]).max() < 1e-10
        assert np.abs(buffer.normal[hit] - first.normal[hit]).max() < 1e-8
        assert np.abs(buffer.field[hit] - first.field[hit]).max() < 1e-10


def test_walls_seen_edge_on_hide_nothing(drawer):
    straight = grid(Shape.TETRAHEDRON, 2)
    low, high = straight.vertices.min(axis=0), straight.vertices.max(axis=0)
    mesh = curved(straight, lambda p: p + 0.2 * np.column_stack([p[:, 1] ** 2, p[:, 0], 0 * p[:, 0]]), 3)
    field = approximated(Dataset(mesh), "u", lambda p: p[:, 2], 4)
    drawn = drawer(Dataset(mesh, (Field("u", field.blocks),)))
    middle = (low + high) / 2 + [0.1, 0.1, 0]
    camera = Camera((*middle[:2], high[2] + 2), tuple(middle), (0, 1, 0), height=1.5 * float(high[1] - low[1]))
    view = View.through(camera, (151, 151))
    buffer = drawn.draw(view)

    # the shear undone, step by step
    pixel = np.arange(view.count)
    x, y = view.rays(pixel % 151, pixel // 151)[0][:, :2].T
    own_x, own_y = x, y
    for _ in range(200):
        own_x, own_y = x - 0.2 * own_y**2, y - 0.2 * own_x
    inside = np.min([own_x - low[0], high[0] - own_x, own_y - low[1], high[1] - own_y], axis=0)
    sure = np.abs(inside) > 1e-8
    found = np.isfinite(buffer.depth)
    assert np.array_equal(found[sure], inside[sure] > 0)
    assert 0.2 < found.mean() < 0.9
    assert (buffer.status[sure & (np.abs(inside) > 1e-3)] != Status.FAILED).all()
    assert np.abs(buffer.depth[found] - 2).max() < 1e-12
    assert np.abs(buffer.field[found] - high[2]).max() < 1e-12


def test_a_self_intersecting_tetrahedron(drawer):
    corners = one_element(Shape.TETRAHEDRON)

    def moved(points):
        """The middle of the edge from (0, 0, 0) to (1, 0, 0) goes up by 0.6."""
        l = (points + 1) / 2  # noqa: E741
        return l + 2.4 * (l[:, :1] * (1 - l.sum(axis=1, keepdims=True))) * [0, 0, 1]

    drawn = drawer(mapped(corners, moved, 3))
    view = View.through(Camera((3, -4, 2.5), (0.3, 0.3, 0.3), height=1.6), (60, 60))
    hits = drawn.hits(view)
    nets = [(block.space, net) for block in drawn.faces.blocks for net in block.nets(np.arange(len(block)))]
    counted = sum(crossings(net, space, view) for space, net in nets)
    found = np.bincount(hits["pixel"], minlength=view.count)
    assert set(np.unique(found)) == {0, 2, 4}
    assert (found != counted).sum() <= 2


def test_plane_data_are_seen_from_above(drawer):
    mesh = curved(mixed_plane(), lambda p: p + 0.1 * p[:, [1, 0, 2]] ** 2 * [1, 1, 0], 3)
    field = approximated(Dataset(mesh), "u", lambda p: p[:, 0], 4)
    drawn = drawer(Dataset(mesh, (Field("u", field.blocks),)))
    view = View.through(Camera((1.2, 0.7, 5.0), (1.2, 0.7, 0.0), (0, 1, 0), height=4.0), (80, 80))
    buffer = drawn.draw(view)
    found = np.isfinite(buffer.depth)
    pixel = np.flatnonzero(found)
    origin, way = view.rays(pixel % 80, pixel // 80)
    assert found.sum() > 300
    assert np.abs(buffer.depth[found] - 5).max() < 1e-12
    assert np.abs(buffer.field[found] - (origin + 5 * way)[:, 0]).max() < 1e-12


def test_faces_may_end_in_a_point(drawer):
    """A hexahedron whose top is a point: four faces with an edge of no length, and one of no size at all."""
    dataset = mapped(one_element(Shape.HEXAHEDRON), lambda p: p * [1, 1, 1] - 0.5 * (1 + p[:, 2:]) * p * [1, 1, 0], 4)
    drawn = drawer(dataset)
    for camera in (Camera((3, -4, 2.5), (0, 0, 0), height=3.0), Camera((0, 0, 5.0), (0, 0, 0), (0, 1, 0), height=3.0)):
        view = View.through(camera, (81, 61))
        hits, buffer = drawn.hits(view), drawn.draw(view)
        pixel = np.flatnonzero(np.isfinite(buffer.depth))
        origin, way = view.rays(pixel % 81, pixel // 81)
        x, y, z = (origin + buffer.depth[pixel, None] * way).T
        off = np.minimum(np.abs(np.maximum(np.abs(x), np.abs(y)) - (1 - z) / 2), np.abs(z + 1))
        assert len(pixel) > 800
        assert off.max() < 1e-10
        sure = np.flatnonzero(buffer.status == Status.CERTAIN)
        doubtful = np.unique(hits["pixel"][hits["margin"] < 1e-6])
        counts = np.bincount(hits["pixel"], minlength=view.count)
        assert (counts[np.setdiff1d(sure, doubtful)] == 2).all()
        assert (buffer.status != Status.FAILED).all()
