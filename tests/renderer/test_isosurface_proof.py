"""What isosurfaces call certain, against dense samples of random fields; odd elements, odd values."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Camera, Isosurface, SceneError, Status
from elvis.core.data.dataset import Dataset
from elvis.core.numbers.sampling import sample
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid
from elvis.plugins.native import NativeVolume
from elvis.renderer.passes.isosurface import isosurface
from elvis.renderer.passes.isosurface.isosurface import IsosurfaceDrawer
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View

SOLIDS = [shape for shape in Shape if shape.dimension == 3]
SIZE = (24, 20)
CAMERA = Camera((1.7, -1.2, 1.4), (0.5, 0.5, 0.5), fov=45.0)
#: samples of a ray, between these depths
COUNT, DEPTHS = 120, (0.9, 3.4)


@pytest.fixture(scope="module")
def iso(renderer):
    """The hit buffer of an isosurface of a dataset's first field."""

    def draw(dataset, view, value, beyond=None):
        drawer = IsosurfaceDrawer(
            DeviceVolume(renderer("vulkan").device, NativeVolume.of(dataset, dataset.fields[0].name))
        )
        return drawer.draw(view, None, value, beyond)

    return draw


def swirled(points):
    """Bends that no element of three nodes an edge follows: its own map is what counts."""
    x, y, z = points.T
    return points + 0.08 * np.stack([np.sin(4 * y), np.sin(5 * z), np.sin(3 * x + 2 * y)], axis=1)


def random_field(shape, seed):
    """Elements of the swirled cube, each with random coefficients of its own around a wave."""
    rng = np.random.default_rng(seed)
    dataset = Dataset(curved(grid(shape, 1 if shape in (Shape.PYRAMID, Shape.TETRAHEDRON) else 2), swirled, 3))
    field = approximated(dataset, "u", lambda p: np.sin(5 * p[:, 0] + 3 * p[:, 1]) * np.cos(4 * p[:, 2]), 5)
    blocks = tuple(
        replace(block, coefficients=block.coefficients + 0.1 * rng.normal(size=block.coefficients.shape))
        for block in field.blocks
    )
    return Dataset(dataset.mesh, (replace(field, blocks=blocks),))


@pytest.mark.sampled(least=2, free=("shape",))
@pytest.mark.parametrize("shape", SOLIDS)
def test_dense_samples_never_refute_certain_pixels(iso, shape):
    """Hits lie on the level; nowhere before them, nor on rays called misses, does an element's field cross it."""
    dataset, level = random_field(shape, 7), 0.15
    view = View.through(CAMERA, SIZE)
    hits = iso(dataset, view, level)
    hit, sure = np.isfinite(hits.depth), hits.status != Status.AMBIGUOUS
    assert hit.mean() > 0.08
    assert sure.mean() > 0.98
    origins, ways = view.every_ray()

    found = sample(dataset, ["u"], (origins + hits.depth[:, None] * ways)[hit], all=True)
    near = np.abs(found.values[:, 0] - level) < 1e-9
    assert set(found.location.point[near]) == set(range(hit.sum()))

    depths = np.linspace(*DEPTHS, COUNT)
    dense = sample(dataset, ["u"], (origins[:, None] + depths[:, None] * ways[:, None]).reshape(-1, 3))
    values, element = np.full(view.count * COUNT, np.nan), np.full(view.count * COUNT, -1)
    values[dense.location.point], element[dense.location.point] = dense.values[:, 0] - level, dense.location.element_id
    values, element = values.reshape(-1, COUNT), element.reshape(-1, COUNT)
    crosses = (values[:, 1:] * values[:, :-1] < 0) & (element[:, 1:] == element[:, :-1]) & (element[:, 1:] >= 0)
    assert crosses.any()
    first = np.where(crosses.any(axis=1), depths[1 + crosses.argmax(axis=1)], np.inf)
    assert (hits.depth[sure] <= first[sure]).all()


@pytest.mark.parametrize(
    ("shape", "off"), [(Shape.HEXAHEDRON, 1e-6), (Shape.PRISM, 1e-6), (Shape.HEXAHEDRON, 0.03), (Shape.HEXAHEDRON, 0.3)]
)
def test_two_blobs_behind_one_another_in_one_element_are_found(iso, shape, off, monkeypatch):
    # coarse models show whether proofs include the terms that models leave out
    monkeypatch.setattr(isosurface, "_MODELS_OFF", off)
    centres = np.array([[0.62, 0.3, 0.4], [0.72, 0.22, 0.3]])
    eye = centres[0] + 6 * (centres[0] - centres[1])
    radii = np.array([0.03, 0.04])

    def squares(points):
        return ((points[:, None] - centres) ** 2).sum(axis=2) - radii**2

    dataset = Dataset(grid(shape, 1))
    dataset = Dataset(dataset.mesh, (approximated(dataset, "u", lambda p: squares(p).prod(axis=1), 5),))
    view = View.through(Camera(tuple(eye), tuple(centres[0]), fov=8.0), (41, 41))
    origins, ways = view.every_ray()
    away = origins[:, None] - centres
    a, b, c = (ways**2).sum(axis=1)[:, None], (away * ways[:, None]).sum(axis=2), (away**2).sum(axis=2) - radii**2
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b**2 - a * c)
    depths = np.sort(np.concatenate([(-b - root) / a, (-b + root) / a], axis=1), axis=1)
    assert np.isfinite(depths).all(axis=1).any()
    beyond = np.zeros(view.count)
    for expected in depths.T:
        hits = iso(dataset, view, 0.0, beyond)
        assert np.array_equal(np.isfinite(hits.depth), np.isfinite(expected))
        both = np.isfinite(expected)
        assert np.abs(hits.depth - expected)[both].max(initial=0.0) < 1e-9
        beyond = hits.depth


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.HEXAHEDRON])
@pytest.mark.parametrize("bend", [0.0, 0.2])
def test_inverted_elements_are_drawn_like_others(iso, shape, bend):
    """The same surface in a mesh and in its mirror image's mirror image, whose elements all are turned inside out."""

    def turned(points):
        return points * [-1, 1, 1] + [1, 0, 0]

    def sheared(points):
        return points + bend * points[:, 1:2] ** 2 * [1, 0, 0]

    plain = grid(shape, 2)
    meshes = [curved(plain, sheared, 3), curved(plain, lambda p: sheared(turned(p)), 3)]
    both = []
    for mesh in meshes:
        field = approximated(Dataset(mesh), "u", lambda p: ((p - [0.5, 0.4, 0.6]) ** 2).sum(axis=1), 5)
        both.append(iso(Dataset(mesh, (field,)), View.through(CAMERA, SIZE), 0.1))
    one, other = both
    assert np.isfinite(one.depth).mean() > 0.05
    assert np.array_equal(np.isfinite(one.depth), np.isfinite(other.depth))
    hit = np.isfinite(one.depth)
    assert np.abs(one.depth[hit] - other.depth[hit]).max() < 1e-10
    assert np.abs(one.normal[hit] - other.normal[hit]).max() < 1e-8


def test_values_out_of_range_are_rejected_with_the_range(draw, linear):
    with pytest.raises(SceneError, match=r"lies between -3 and 3, found 3\.5"):
        draw(linear(grid(Shape.TETRAHEDRON, 2)), objects=(Isosurface((3.5,)),), size=(8, 8))


def test_values_outside_the_range_only_by_rounding_are_drawn(draw, linear):
    """Bounds hold to rounding: those of (x - 3/4)^2 may begin at 3.5e-18, and its isosurface at 0 is no mistake."""
    dataset = linear(grid(Shape.TETRAHEDRON, 2))
    for value in (np.nextafter(3.0, 4.0), np.nextafter(-3.0, -4.0)):
        assert draw(dataset, objects=(Isosurface((value, 1.0)),), camera=CAMERA, size=(16, 16)).counts()["certain"] > 0


def test_a_constant_field_has_no_surface_at_its_value(iso):
    dataset = Dataset(grid(Shape.PRISM, 2))
    field = approximated(dataset, "u", lambda p: np.ones(len(p)), 4)
    blocks = tuple(replace(block, coefficients=0.3 * np.rint(block.coefficients)) for block in field.blocks)
    dataset = Dataset(dataset.mesh, (replace(field, blocks=blocks),))
    hits = iso(dataset, View.through(CAMERA, SIZE), 0.3)
    assert not np.isfinite(hits.depth).any()
    assert (hits.status == Status.MISS).all()
