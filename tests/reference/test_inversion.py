"""The reference's own inverse map: round trips over every shape, and proofs that points are outside."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elvis.core.data.dataset import Dataset
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Locator as CoreLocator
from elvis.core.mapping.margins import margins
from elvis.core.mapping.patch import patches
from elvis.core.mapping.pointwise import positions
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, mixed_plane, mixed_volume, one_element, ripple, scattered
from elvis.reference import inversion, locating
from elvis.reference.inversion import Inverter
from elvis.reference.locating import Locator

SHAPES = [shape for shape in Shape if shape.dimension > 1]


def bent(shape, amplitude=0.15, modes=3):
    """One curved element."""
    (patch,) = patches(Dataset(curved(one_element(shape), ripple(amplitude, seed=3), modes)))
    return patch


@pytest.mark.parametrize("shape", SHAPES)
def test_points_are_recovered(shape):
    patch = bent(shape)
    inner = scattered(shape, 300, 1)
    rows = np.zeros(len(inner), np.int64)
    reference, status = Inverter(patch).invert(rows, positions(patch, rows, inner))
    assert (status == Status.INSIDE).all()
    assert np.abs(reference - inner).max() < 1e-11


@pytest.mark.parametrize("shape", SHAPES)
def test_points_beyond_the_border_are_proved_to_be_outside(shape):
    """Images of reference points beyond the border, by the map continued, as near as 1e-9 to it."""
    patch = bent(shape, 0.05)
    inner = scattered(shape, 60, 2)
    centre = shape.vertices.mean(axis=0)
    beyond = []
    for distance in (1e-9, 1e-6, 1e-3, 0.05):
        # along the ray from the centre through a point, to where the margin is minus the distance
        way = inner - centre
        low, high = np.zeros(len(way)), np.full(len(way), 100.0)
        for _ in range(80):
            middle = 0.5 * (low + high)
            is_inside = margins(shape, centre + middle[:, None] * way) > -distance
            low, high = np.where(is_inside, middle, low), np.where(is_inside, high, middle)
        beyond.append(centre + high[:, None] * way)
    points = np.concatenate(beyond)
    rows = np.zeros(len(points), np.int64)
    world = positions(patch, rows, points)
    _, status = Inverter(patch).invert(rows, world)
    left = np.flatnonzero(status != Status.OUTSIDE)
    _, searched = Inverter(patch).search(rows[left], world[left])
    assert (searched == Status.OUTSIDE).all()


def test_a_root_missed_by_newton_is_found_by_subdivision(monkeypatch):
    """From one bad start the method ends elsewhere; the search still finds the point."""
    patch = bent(Shape.HEXAHEDRON)
    monkeypatch.setattr(inversion, "_STEPS", 1)
    inner = scattered(Shape.HEXAHEDRON, 50, 4)
    rows = np.zeros(len(inner), np.int64)
    world = positions(patch, rows, inner)
    _, status = Inverter(patch).invert(rows, world)
    assert (status == Status.UNCERTAIN).any()
    monkeypatch.setattr(inversion, "_STEPS", 40)
    reference, status = Inverter(patch).search(rows, world)
    assert (status == Status.INSIDE).all()
    assert np.abs(reference - inner).max() < 1e-11


@pytest.mark.parametrize(
    "mesh",
    [
        curved(mixed_volume(seed=1), ripple(0.02), n=3),
        curved(mixed_plane(seed=2), ripple(0.05), n=4),
        grid(Shape.TETRAHEDRON, 2),
    ],
    ids=["volume", "plane", "straight"],
)
def test_two_searches_by_different_means_agree(mesh):
    """The core's answers and these: the same elements, the same places."""
    own = patches(Dataset(mesh), [])
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    points = low - 0.1 + (high - low + 0.2) * np.random.default_rng(5).random((1500, 3))
    points[:, mesh.dimension :] = 0.0
    core, found = CoreLocator(own).locate(points), Locator(own).locate(points)
    assert np.array_equal(core.status, found.status)
    assert np.array_equal(core.element_id, found.element_id)
    assert np.nanmax(np.abs(core.reference - found.reference)) < 1e-11
    every, all_found = CoreLocator(own).locate(points[:300], all=True), Locator(own).locate(points[:300], all=True)
    assert np.array_equal(every.element_id, all_found.element_id)


@pytest.mark.parametrize("shift", [2.0**20, 2.0**30])
@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL])
def test_points_between_elements_far_away_are_in_one_of_them(shape, shift):
    mesh = grid(shape, 3)
    offset = np.array([shift, shift, 0.0])
    far = replace(mesh, vertices=mesh.vertices + offset)
    inner = np.random.default_rng(6).random((500, 3))
    inner[:, 2] = 0.0
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    points = low + inner * (high - low) + offset
    found = Locator(patches(Dataset(far), [])).locate(points)
    assert (found.status == Status.INSIDE).all()


def test_the_reference_does_not_use_the_core_inversion():
    """Its records, patches, definition of a margin and trees of boxes are used, none of its solvers."""
    allowed = {
        "elvis.core.mapping.boxes",
        "elvis.core.mapping.inverse",
        "elvis.core.mapping.locate",
        "elvis.core.mapping.margins",
        "elvis.core.mapping.patch",
        "elvis.core.mapping.tangents",
    }
    for module in (inversion, locating):
        tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
        froms = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        mapping = {node.module for node in froms if node.module.startswith("elvis.core.mapping")}
        assert mapping <= allowed
        taken = {alias.name for node in froms if node.module in mapping for alias in node.names}
        assert not taken & {"invert", "decide", "locate", "Locator", "newton", "search", "element_boxes"}
