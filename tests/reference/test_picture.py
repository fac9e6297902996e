"""The picture in NumPy: what it says of pixels, and of what it can't draw."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from elvis import Camera, Plane, Scene, SceneError, Status
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Block, Dataset, Field
from elvis.core.mapping.geometry import geometry
from elvis.core.mapping.locate import Locator
from elvis.core.mapping.margins import TOLERANCE
from elvis.core.mapping.patch import patches
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, one_element, ripple
from elvis.formats.reading import read
from elvis.plugins.command.registry import load
from elvis.reference import places
from elvis.reference.picture import render
from elvis.reference.places import owners

SHAPES = [*Shape.of_dimension(2), *Shape.of_dimension(3)]
OBLIQUE = Plane((0.5, 0.5, 0.5), (0.1, 0.2, 1.0))
FLAT = Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def name_of(shape):
    return shape.label


def linear(mesh):
    """The field x + 2 y - 3 z, of the coefficients of the map itself."""
    blocks = [
        Block(block.expansion, block.element_ids, np.einsum("nik,i->nk", block.coefficients, [1.0, 2.0, -3.0]))
        for block in geometry(Dataset(mesh))
    ]
    return Dataset(mesh, (Field("u", tuple(blocks)),))


def test_it_is_the_device_reference():
    assert load("elvis.devices", "reference") is render


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_every_pixel_shows_the_field_at_its_point(shape):
    dataset = linear(curved(grid(shape, 2), ripple(0.12, seed=3), 4))
    frame = render(dataset, Scene("u", OBLIQUE if shape.dimension == 3 else FLAT, size=(36, 30)))
    expected = frame.position @ [1.0, 2.0, -3.0]
    assert frame.seen.sum() > 360
    assert np.abs(frame.field - expected)[frame.seen].max() < 1e-13
    assert frame.counts()["failed"] == 0
    assert (frame.reference[frame.seen][:, shape.dimension :] == 0).all()


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_reference_coordinates_match_those_of_the_reference_element(shape):
    """An element that is its own reference shape shows positions as reference coordinates."""
    mesh = one_element(shape, shape.dimension)
    plane = Plane((-0.4, -0.4, -0.4), (0.1, 0.2, 1.0)) if shape.dimension == 3 else FLAT
    frame = render(linear(mesh), Scene("u", plane, size=(24, 24)))
    d = shape.dimension
    assert np.abs(frame.reference - frame.position)[frame.seen][:, :d].max() < 1e-14


def test_borders_are_ambiguous_and_belong_to_the_lowest_id():
    mesh = grid(Shape.HEXAHEDRON, 2)
    camera = Camera((0.5, 0.5, 2.0), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0), height=7 / 6)
    plane = Plane((0.0, 0.0, 0.25), (0.0, 0.0, 1.0))
    frame = render(linear(mesh), Scene("u", plane, camera, size=(7, 7)))
    assert frame.status.tolist() == [[2, 2, 2, 2, 2, 2, 2]] + 2 * [[2, 1, 1, 2, 1, 1, 2]] + [[2] * 7] + 2 * [
        [2, 1, 1, 2, 1, 1, 2]
    ] + [[2] * 7]

    # ids grow with x, then y; rows run downwards
    columns, rows = np.meshgrid(np.arange(7) > 3, np.arange(7) < 3)
    assert np.array_equal(frame.element, columns + 2 * rows)


@pytest.mark.parametrize("distance", [0.5, 2.0])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_border_is_as_wide_as_the_tolerance(distance, side):
    """Two elements of width 1/2 meet at x = 1/2; margins are heights in parts of the width."""
    dataset = linear(grid(Shape.HEXAHEDRON, 2))
    point = np.array([[0.5 + side * distance * TOLERANCE / 2, 0.3, 0.3]])
    found = owners(Locator(patches(dataset, ["u"])), point)
    assert found.element_id[0] == (0 if side < 0 or distance < 1 else 1)
    assert (found.margin[0] > TOLERANCE) == (distance > 1)


def test_each_point_has_one_answer_for_any_number_of_elements():
    dataset = linear(grid(Shape.TETRAHEDRON, 2))
    corners = dataset.mesh.vertices
    locator = Locator(patches(dataset, ["u"]))
    points = np.concatenate([corners, np.random.default_rng(0).uniform(-0.1, 1.1, (200, 3))])
    found = owners(locator, points)
    assert np.array_equal(found.point, np.arange(len(points)))
    every = locator.locate(corners, all=True)
    lowest = [every.element_id[every.point == number].min() for number in range(len(corners))]
    assert len(every) > 2 * len(corners)
    assert found.element_id[: len(corners)].tolist() == lowest


def test_rays_that_miss_the_plane_show_nothing():
    camera = Camera((0.5, -1.0, 1.0), (0.5, 0.5, 1.0), (0.0, 0.0, 1.0), fov=90.0)
    plane = Plane((0.5, 0.5, 0.5), (0.0, 0.0, 1.0))
    frame = render(linear(grid(Shape.PRISM, 1)), Scene("u", plane, camera, size=(40, 40)))
    assert (frame.status[:20] == Status.MISS).all()
    assert frame.seen[20:].any()
    assert np.isnan(frame.field[~frame.seen]).all()
    assert (frame.element[~frame.seen] == -1).all()


@pytest.mark.parametrize(
    ("case", "sentence"),
    [
        ("line_1d", "1D data are drawn on the host from points a quarter of a pixel apart"),
        ("sphere_manifold", "expected 2D data in the plane or 3D data, found DIM=2 SPACE=3"),
        ("naca_h1d_line", "expected 2D data in the plane or 3D data, found DIM=1 SPACE=2"),
    ],
)
def test_data_without_a_plane_picture_are_rejected(nektar, case, sentence):
    files = [path for path in (nektar / case).iterdir() if path.suffix in (".xml", ".fld") and "Var" not in path.name]
    with pytest.raises(ElvisError, match=sentence):
        render(read(*files), Scene("u", FLAT, size=(8, 8)))


def test_an_empty_picture_is_rejected():
    dataset = linear(grid(Shape.PYRAMID, 1))
    away = Camera((5.0, 5.0, 5.0), (6.0, 6.0, 6.0), (0.0, 0.0, 1.0), fov=10.0)
    for plane, camera in ((Plane((0, 0, 3), (0, 0, 1)), "fit"), (OBLIQUE, away)):
        with pytest.raises(SceneError, match=r"the picture is empty: .* the domain lies between"):
            render(dataset, Scene("u", plane, camera, size=(8, 8)))


def test_statistics_of_a_frame():
    frame = render(linear(grid(Shape.HEXAHEDRON, 2)), Scene("u", OBLIQUE, size=(30, 20)))
    assert frame.stats["elements"] == 8
    assert frame.stats["device"] == {"name": "reference", "label": "NumPy"}
    assert sum(frame.stats["pixels"].values()) == 600
    assert 0 < frame.stats["seconds"]["locate"] <= frame.stats["seconds"]["frame"]


def test_the_box_is_that_of_the_domain():
    frame = render(linear(grid(Shape.HEXAHEDRON, 2)), Scene("u", OBLIQUE, size=(30, 20), box=True))
    np.testing.assert_allclose(frame.box, [[0, 0, 0], [1, 1, 1]], rtol=0, atol=1e-12)


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_last_steps_at_many_points_are_taken_in_parts(monkeypatch, shape):
    """No place depends on the number of points together; memory beyond the points' own doesn't grow with them."""
    dataset = linear(curved(grid(shape, 2), ripple(0.05), 3))
    own = patches(dataset, ["u"])
    points = np.random.default_rng(2).random((4000, 3))
    points[:, shape.dimension :] = 0
    found = owners(Locator(own), points)
    found.reference[:] += 1e-9
    places_found, peaks = [], []
    for together in (1 << 12, 100):
        again = replace(found, reference=found.reference.copy())
        monkeypatch.setattr(places, "_AT_ONCE", together)
        tracemalloc.start()
        places.polish(own, again, points)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        places_found.append(again.reference)
    assert np.array_equal(*places_found, equal_nan=True)
    assert peaks[1] < 0.3 * peaks[0]
