"""Bounds of the renderer's passes: values lie within them, and proofs are rejected next to where they fail."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from elvis import Camera
from elvis.core.polynomials.collapse import collapse
from elvis.core.shapes import Shape
from elvis.core.testing import grid, with_field
from elvis.plugins.native import NativeVolume
from elvis.renderer.parts.relevance import Relevance
from elvis.renderer.passes.lines.contours.cuts import CutChart
from elvis.renderer.passes.lines.contours.patches import _BEYOND_SLOPES, FACETS, PatchChart
from elvis.renderer.passes.lines.contours.squares import Derivatives, Items, Squares, facet_distances
from elvis.renderer.passes.volume.steepness import steepest, tolerance
from elvis.renderer.volume.traversal import Traversal
from elvis.scene import Isosurface, Transfer
from elvis.scene.cameras.view import View
from elvis.scene.record.conditioning import EPSILON, misplaced, uncertainties


@dataclass
class Samples:
    """One element at n places."""

    position: np.ndarray
    jacobian: np.ndarray
    value: np.ndarray
    gradient: np.ndarray


class BentChart:
    """Triangles or squares with the map x = r + k r1^2 along r0; pixels are places of the picture times a size."""

    def __init__(self, shape, bend=0.0, size=1.0):
        self.facets, self.center = FACETS[shape], shape.vertices.mean(axis=0)
        self._bend, self._size = bend, size

    def targets(self, columns, rows):
        return self._size * np.stack([columns, rows], axis=1), np.ones(len(columns))

    def sample(self, elements, places):
        position, jacobian = places.copy(), np.tile(np.eye(2), (len(places), 1, 1))
        position[:, 0] += self._bend * places[:, 1] ** 2
        jacobian[:, 0, 1] = 2 * self._bend * places[:, 1]
        return Samples(position, jacobian, places[:, 0], np.tile([1.0, 0.0], (len(places), 1)))

    def reaches(self, elements, centre, steps, slack):
        return np.ones(len(centre), bool)

    def localised(self, bounds, elements, centre):
        return bounds


def squares_at(chart, places, bend, turn, size):
    """Squares of some size whose middles are at places (n, 2) of the element's picture."""
    chart._size = size
    count = len(places)
    one = np.ones(count)
    inverse = np.tile(np.eye(2), (count, 1, 1))
    bounds = Derivatives(bend * one, turn * one, one, 0 * one, 0 * one, np.tile(chart.center, (count, 1)), inverse)
    items = Items(np.arange(count), np.zeros(count, int), np.full((count, 2), np.nan))
    return Squares(chart, *(places / size).T, items, bounds)


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL])
def test_no_image_of_a_point_inside_is_proved_outside(shape):
    """Jacobians that differ by b from the centre's move a corner by b times its distance from the centre."""
    chart, bend = BentChart(shape), 0.3
    for corner in shape.vertices:
        way = corner - chart.center
        for turn in np.eye(2):
            for sign in (-1, 1):
                change = bend * sign * np.outer([1.0, 1.0], turn)
                image = corner + change @ way
                assert not squares_at(chart, image[None], bend, 0.0, 1e-6).is_outside[0]

        # what is several times as far outside is proved to be there
        away = corner + 10 * bend * way
        assert squares_at(chart, away[None], bend, 0.0, 1e-6).is_outside[0]


def test_squares_are_inside_only_by_more_than_their_sides_bulge():
    """Sides of squares are parabolas: corners lie within the element by less than the bulge, or by more."""
    half, bend = 0.05, 0.4
    for part, is_inside in ((0.9, False), (2.6, True)):
        bulge = bend * half**2
        chart = BentChart(Shape.QUADRILATERAL, bend)
        place = np.array([[-1 + half + part * bulge, 0.0]])
        assert squares_at(chart, place, 0.0, 2 * bend, 2 * half).is_inside[0] == is_inside


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL])
def test_places_within_slack_of_the_end_of_a_neighbourhood_are_not_in_it(shape):
    facets, beyond = FACETS[shape], 1.0
    own = SimpleNamespace(_shape=shape, facets=facets, _beyond=np.full(1, beyond), _space=SimpleNamespace(shape=shape))
    centre = shape.vertices.mean(axis=0)[None]
    for direction in (*np.eye(2), *-np.eye(2), np.ones(2), -np.ones(2)):
        # the part of the way at which the first facet is met
        rate = facet_distances(facets, centre + direction)[0] - facet_distances(facets, centre)[0]
        way = (facet_distances(facets, centre)[0] / np.maximum(-rate, 1e-9)).min()
        for part, is_near in ((1.01, False), (0.99, True)):
            place = centre + 0.5 * way * direction
            slack = np.array([part * 0.5 * way]) * np.abs(direction).max()
            found = PatchChart.reaches(own, np.zeros(1, int), place, np.zeros((1, 1, 2)), slack)
            if not is_near:
                assert not found[0]
            elif shape is Shape.QUADRILATERAL:
                assert found[0]
    assert PatchChart.reaches(own, np.zeros(1, int), centre, np.zeros((1, 1, 2)), np.array([0.3]))[0]


def test_neighbourhoods_in_plane_cuts_have_slack():
    own = SimpleNamespace(_space=SimpleNamespace(shape=Shape.HEXAHEDRON), facets=None)
    place, steps = np.array([[0.5, 0.0, 0.0]]), np.zeros((1, 1, 3))
    found = [CutChart.reaches(own, None, place, steps, np.array([slack]))[0] for slack in (0.4, 1.0)]
    assert found == [True, False]


@pytest.mark.parametrize("cosine", 10.0 ** -np.arange(0, 9, 2))
@pytest.mark.parametrize("away", [0.0, 1e6])
def test_uncertainties_of_depths_include_rounding_of_the_eye(cosine, away):
    """At grazing angles and far off: at least that, and at most a thousand times that."""
    normal = np.array([0.0, np.sqrt(1 - cosine**2), cosine])
    eye = np.array([away, 0.0, away + 5.0])
    view = View.through(Camera(tuple(eye), (away, 0.0, away), (0.0, 1.0, 0.0), height=1.0), (3, 3))
    depth = np.full(1, 5.0)
    stated = uncertainties(view, np.array([4]), depth, normal[None], away + 1.0)
    changed = np.spacing(np.abs(eye).max()) / cosine
    assert changed <= stated[0] <= 1000 * changed
    assert stated[0] >= misplaced(view, away + 1.0) / cosine * (1 - 1e-9) + 0.9 * EPSILON * depth[0]


def test_steepness_of_transfer_functions_bounds_their_change():
    """Densities, and colours times densities, between two values near to one another, at random and at the steepest."""
    rng = np.random.default_rng(4)
    nearest = 0.0
    for _ in range(20):
        values, densities, colors = np.sort(rng.uniform(0, 1, 4)), rng.uniform(0.1, 9, 4), rng.uniform(0, 1, (4, 3))
        transfer = Transfer(values=tuple(values), colors=tuple(map(tuple, colors)), densities=tuple(densities))
        bound = steepest(transfer)
        at = rng.uniform(values[0], values[-1] - 1e-6, 400)
        density, other = (np.interp(x, values, densities) for x in (at, at + 1e-6))
        shown = [np.interp(at, values, own) * density for own in colors.T]
        moved = [np.interp(at + 1e-6, values, own) * other for own in colors.T]
        change = np.max([np.abs(a - b) for a, b in zip(shown, moved, strict=True)], axis=0) / 1e-6
        assert (np.abs(other - density) / 1e-6 <= bound * (1 + 1e-6)).all()
        assert (change <= bound * (1 + 1e-6)).all()
        nearest = max(nearest, change.max() / bound)
        assert tolerance(transfer, 0.1, 2.0) * bound * 2.0 <= 0.1 / 4 * (1 + 1e-12)
    assert nearest > 0.5


def parts_with(values):
    """A field on a hexahedron, and what the renderer knows of it."""
    dataset = with_field(grid(Shape.HEXAHEDRON, 1), values, 4)
    (part,) = NativeVolume.of(dataset, ["u"]).parts
    return part, part.quantities["u"]


def test_steepness_without_bounds_is_not_below_that_with_bounds():
    """What values are is known by their rounding alone."""
    _, own = parts_with(lambda p: np.sin(3 * p[:, 0]) + p[:, 1] * p[:, 2])
    found = []
    for bounds in (own.bounds(), (np.full(1, -np.inf), np.full(1, np.inf))):
        loaded = SimpleNamespace(device=None, quantity=lambda *_: own, bounds=lambda *_, ends=bounds: ends)
        found.append(Traversal(loaded).steepest(0, None, 0.5)[0])
    assert found[0] <= found[1] <= 1000 * found[0]


def test_elements_that_are_the_value_of_an_isosurface_to_rounding_are_counted():
    """Those that the renderer takes for flat (4 roundings), and some more."""
    rounding = np.array([1e-3, 1e-12, 1e-12, 1e-12])
    ends = np.array([1.0, 1.0 + 3.9e-12, 1.0 - 3.9e-12, 1.0 + 1e-9])
    own = SimpleNamespace(bounds=lambda: (ends, ends), rounding=lambda: rounding, degree=2, level=None)
    loaded = SimpleNamespace(device=None, quantity=lambda *_: own, bounds=lambda *_: (ends, ends))
    scene = SimpleNamespace(every_object=[Isosurface((1.0,))], field="u")
    relevance = SimpleNamespace(scene=scene, _quantity=lambda part, name: own, levels=lambda: iter(()))
    counted = Relevance._counted(relevance, np.zeros(4))
    assert Traversal(loaded).flat(0, None, 1.0)[1:].tolist() == [True, True, False]
    assert counted[1:].tolist() == [True, True, False]


def test_boxes_around_patches_of_pyramids_contain_their_neighbourhoods():
    """In collapsed coordinates: corners of what is larger than a patch attain the ends."""
    rng, count = np.random.default_rng(3), 40
    shape = Shape.TRIANGLE
    start, first, second = rng.uniform(-0.6, -0.1, (count, 3)), *rng.uniform(-0.2, 0.2, (2, count, 3))
    center = shape.vertices.mean(axis=0)
    records = {"start": start, "first": first, "second": second}
    middle, half = PatchChart._boxes(SimpleNamespace(_shape=shape, center=center, records=records))
    weights = np.concatenate([np.eye(3), rng.dirichlet(np.ones(3), 60)])
    places = center + _BEYOND_SLOPES[0] * (weights @ shape.vertices - center)
    world = start[:, None] + places[:, :1] * first[:, None] + places[:, 1:] * second[:, None]
    eta = collapse(Shape.PYRAMID, world.reshape(-1, 3)).reshape(world.shape)
    away = np.abs(eta - middle[:, None]) / half[:, None]
    assert away.max(axis=1) == pytest.approx(np.ones((count, 3)), abs=1e-9)
