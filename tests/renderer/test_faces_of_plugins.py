"""Faces that runtime plugins give: exact cylinders, boxes, walls of quasi-3D data."""

from pathlib import Path

import numpy as np
import pytest

from elvis import Camera, Status
from elvis.core.base.errors import ElvisError
from elvis.formats.reading import read
from elvis.plugins.faces import faces_of, vertices_at
from elvis.plugins.fourier.box import FourierBox, series, write_box
from elvis.plugins.nurbs.nurbs import Nurbs
from elvis.plugins.runtime.serving import volume_of
from elvis.plugins.runtime.volume import PartsVolume
from elvis.renderer.passes.faces.faces import FaceDrawer
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View

MFEM = Path(__file__).resolve().parents[3] / "shared" / "data" / "solvers" / "mfem"


@pytest.fixture(scope="module")
def drawer(renderer):
    return lambda volume, dataset=None: FaceDrawer(
        DeviceVolume(renderer("vulkan").device, volume), faces_of(dataset, volume)
    )


def places(view, buffer):
    """Pixels that are hit, and where (n, 3)."""
    pixel = np.flatnonzero(np.isfinite(buffer.depth))
    origin, way = view.rays(pixel % view.width, pixel // view.width)
    return pixel, origin + buffer.depth[pixel, None] * way


@pytest.mark.skipif(not MFEM.is_dir(), reason="needs the shared data")
def test_a_pipe_is_round_to_the_last_bit(drawer):
    volume = Nurbs([MFEM / "pipe_nurbs.mesh", MFEM / "pipe_nurbs.u.gf"]).volume("u")
    drawn = drawer(volume)
    outer, named = (sum(map(len, drawn.faces.select(words))) for words in (["all"], list(drawn.faces.boundaries)))
    assert outer == named == 24

    # across the straight leg: an outer cylinder of radius 3 around the z axis
    view = View.through(Camera((0.0, -20.0, 2.0), (0.0, 0.0, 2.0), height=2.0), (140, 40))
    buffer, hits = drawn.draw(view), drawn.hits(view)
    pixel = np.arange(view.count)
    x = view.rays(pixel % 140, pixel // 140)[0][:, 0]
    assert np.array_equal(np.isfinite(buffer.depth), np.abs(x) <= 3)
    seen, place = places(view, buffer)
    assert np.abs(place[:, 1] + np.sqrt(9 - x[seen] ** 2)).max() < 1e-10
    radial = place * [1, 1, 0] / 3
    assert np.abs(buffer.normal[seen] - radial).max() < 1e-10
    counts = np.bincount(hits["pixel"], minlength=view.count)
    assert np.array_equal(counts, np.where(np.abs(x) <= 3, 2, 0) + np.where(np.abs(x) <= 2, 2, 0))

    # along the axis, from within: walls are seen edge-on or from next to the eye, nothing is lost
    for size in ({"height": 6.4}, {"fov": 80.0}):
        view = View.through(Camera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), (0, 1, 0), **size), (60, 60))
        buffer = drawn.draw(view)
        pixel, place = places(view, buffer)
        radius = np.hypot(place[:, 0], place[:, 1])
        off = np.min(np.abs([radius - 3, radius - 2, place[:, 2]]), axis=0)
        assert len(pixel) > 100
        assert off.max() < 1e-10
        assert (buffer.status != Status.FAILED).all()


def test_a_periodic_box_has_six_sides(drawer, tmp_path):
    rng, low, high = np.random.default_rng(3), np.array([0.0, -1.0, 2.0]), np.array([1.0, 1.5, 4.0])
    amplitudes, bases = rng.normal(size=(5, 3, 4)), ("fourier", "fourier", "legendre")
    write_box(tmp_path / "box.npz", low, high, bases, {"u": amplitudes})
    drawn = drawer(FourierBox([tmp_path / "box.npz"]).volume("u"))
    assert sum(map(len, drawn.faces.select(["all"]))) == 6
    view = View.through(Camera((3.0, -4.0, 6.0), (0.5, 0.2, 3.0), fov=45.0), (70, 60))
    buffer, hits = drawn.draw(view), drawn.hits(view)
    pixel, place = places(view, buffer)
    reference = 2 * (place - low) / (high - low) - 1
    assert np.abs(np.abs(reference).max(axis=1) - 1).max() < 1e-12
    assert np.abs(buffer.field[pixel] - series(bases, amplitudes, reference)).max() < 1e-11
    assert set(np.unique(np.bincount(hits["pixel"], minlength=view.count))) == {0, 2}


def test_quasi_3d_data_have_walls_and_lids(drawer, nektar):
    folder = nektar / "triquad_h1d"
    dataset = read(*sorted(path for path in folder.iterdir() if path.suffix in (".xml", ".fld"))[::-1])
    name = dataset.fields[0].name
    volume = volume_of(dataset, [name])
    assert volume.dimension == 3
    drawn = drawer(volume, dataset)
    boxes = np.concatenate([part.boxes for part in volume.parts]).astype(float)
    low, high = boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)
    middle, diagonal = (low + high) / 2, float(np.linalg.norm(high - low))
    view = View.through(
        Camera(tuple(middle + diagonal * np.array([1.1, -1.3, 0.9])), tuple(middle), fov=45.0), (70, 60)
    )
    buffer, hits = drawn.draw(view), drawn.hits(view)
    counts = np.bincount(hits["pixel"], minlength=view.count)
    sure = buffer.status != Status.AMBIGUOUS
    assert (counts[sure] % 2 == 0).all()
    assert counts.max() >= 2
    wall = drawn.draw(view, list(drawn.faces.boundaries)[:1])
    assert np.isfinite(wall.depth).any()


@pytest.mark.sampled(least=2, free=("name",))
@pytest.mark.parametrize("name", ["gen_allelem_n4", "gen_pipe_curved", "gen_tet_p8_nekg2", "sphere_manifold"])
def test_real_meshes_are_closed(drawer, shared, name):
    dataset = shared(name)
    volume = volume_of(dataset, [dataset.fields[0].name])
    drawn = drawer(volume, dataset)
    boxes = np.concatenate([part.boxes for part in volume.parts]).astype(float)
    low, high = boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)
    middle, diagonal = (low + high) / 2, float(np.linalg.norm(high - low))
    for way, size in (((0.51, -0.63, 0.612), {"fov": 60.0}), ((-0.4, 0.3, -0.8), {"height": diagonal})):
        view = View.through(Camera(tuple(middle + diagonal * np.array(way)), tuple(middle), **size), (60, 60))
        buffer, hits = drawn.draw(view), drawn.hits(view)
        counts = np.bincount(hits["pixel"], minlength=view.count)
        assert (counts[buffer.status == Status.CERTAIN] % 2 == 0).all()
        assert (buffer.status <= Status.AMBIGUOUS).all()
        assert (buffer.status == Status.AMBIGUOUS).sum() < 4
        assert counts.max() >= 2


def test_a_plugin_without_faces_is_reported():
    with pytest.raises(ElvisError, match="provides no element faces"):
        faces_of(None, PartsVolume([], Path()))


def test_corners_at_one_place_are_one_vertex():
    corners = np.random.default_rng(0).normal(size=(2, 8, 3))
    corners[1, 4] = corners[0, 2] + 1e-14
    found = vertices_at(corners)
    assert len(np.unique(found)) == 15
    assert found[1, 4] == found[0, 2]
