"""Isosurfaces of expressions on curved elements: what they call certain, against dense samples; errors of series."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import chebyshev

from elvis import Camera, Status
from elvis.core.chebyshev_models.series_boxes import SeriesBoxes
from elvis.core.data.dataset import Dataset
from elvis.core.numbers.sampling import sample
from elvis.core.shapes import Shape
from elvis.core.testing import VORTICES, approximated, curved, grid, swirled
from elvis.plugins.native import NativeVolume, elements
from elvis.plugins.native.level_models import ElementLevelSeries
from elvis.renderer.passes.isosurface.enclosing import AXES, BOXES, tails
from elvis.renderer.passes.isosurface.isosurface import IsosurfaceDrawer, Level
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View

CAMERA = Camera((1.7, -1.2, 1.4), (0.5, 0.5, 0.5), fov=45.0)
#: samples of a ray, between these depths
COUNT, DEPTHS = 150, (0.9, 3.4)


def flow(shape, cells=1, bent=True, modes=4):
    """Velocities on curved elements, each with random coefficients of its own around waves."""
    rng = np.random.default_rng(7)
    dataset = Dataset(curved(grid(shape, cells), swirled, 3) if bent else grid(shape, cells))
    fields = []
    for name, wave in VORTICES.items():
        field = approximated(dataset, name, wave, modes)
        blocks = [
            replace(b, coefficients=b.coefficients + 0.02 * rng.normal(size=b.coefficients.shape)) for b in field.blocks
        ]
        fields.append(replace(field, blocks=tuple(blocks)))
    return Dataset(dataset.mesh, tuple(fields))


@pytest.fixture(scope="module")
def iso(renderer):
    """The hits of an isosurface of a quantity."""

    def draw(dataset, view, quantity, value):
        drawer = IsosurfaceDrawer(DeviceVolume(renderer("vulkan").device, NativeVolume.of(dataset, quantity)))
        return drawer.draw(view, None, value)

    return draw


def off_level(dataset, quantity, value, points):
    """(n,) how far the quantity is from the value at each point, in the element where it is nearest to it."""
    found = sample(dataset, [quantity], points, all=True)
    away = np.full(len(points), np.inf)
    np.minimum.at(away, found.location.point, np.abs(found.values[:, 0] - value))
    return away


def first_crossings(dataset, quantity, value, view):
    """(n,) depths on rays where dense samples in one element have been on both sides of the value."""
    origins, ways = view.every_ray()
    depths = np.linspace(*DEPTHS, COUNT)
    dense = sample(dataset, [quantity], (origins[:, None] + depths[:, None] * ways[:, None]).reshape(-1, 3))
    values, element = np.full(view.count * COUNT, np.nan), np.full(view.count * COUNT, -1)
    values[dense.location.point], element[dense.location.point] = dense.values[:, 0] - value, dense.location.element_id
    values, element = values.reshape(-1, COUNT), element.reshape(-1, COUNT)
    crosses = (values[:, 1:] * values[:, :-1] < 0) & (element[:, 1:] == element[:, :-1]) & (element[:, 1:] >= 0)
    return np.where(crosses.any(axis=1), depths[1 + crosses.argmax(axis=1)], np.inf)


def refute(iso, dataset, quantity, value, size, share, camera=CAMERA):
    """Certain hits lie on the level, nothing lies before them nor on certain misses; ``share`` are certain."""
    view = View.through(camera, size)
    hits = iso(dataset, view, quantity, value)
    hit, sure = np.isfinite(hits.depth), hits.status != Status.AMBIGUOUS
    assert (hit & sure).mean() > 0.02
    assert sure.mean() > share
    origins, ways = view.every_ray()
    proved = hit & sure
    away = off_level(dataset, quantity, value, (origins + hits.depth[:, None] * ways)[proved])
    assert away.max() < 1e-9
    crossings = first_crossings(dataset, quantity, value, view)
    assert np.isfinite(crossings).any()
    assert (hits.depth[sure] <= crossings[sure]).all()


@pytest.mark.sampled(free=("shape",))
@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PYRAMID, Shape.PRISM, Shape.HEXAHEDRON])
def test_dense_samples_never_refute_certain_pixels_of_q(iso, shape):
    """The Q criterion on curved elements is a fraction."""
    refute(iso, flow(shape), "q_criterion", 1.0, (20, 16), 0.99)


@pytest.mark.sampled(free=("shape",))
@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PRISM, Shape.HEXAHEDRON])
def test_dense_samples_never_refute_certain_pixels_of_series_in_boxes(iso, shape):
    """Fields of order 5 and more are drawn by Chebyshev models, of which hits and misses are proved likewise."""
    dataset = flow(shape, modes=6)
    (part,) = NativeVolume.of(dataset, "q_criterion").parts
    assert part.level_boxes is not None
    refute(iso, dataset, "q_criterion", 1.0, (20, 16), 0.98)


def test_series_are_found_for_the_needed_elements_only():
    (part,) = NativeVolume.of(flow(Shape.HEXAHEDRON, cells=2, modes=6), "d(u,x)").parts
    whole, alone = part.level_boxes(0.5), part.level_boxes(0.5)
    every = whole.of(np.arange(len(part)))
    element = np.array([every.element.max()])
    found, again = alone.of(element), whole.of(element)
    assert 0 < alone.nbytes < whole.nbytes
    for own in (found, again):
        assert (own.element == element).all()
        assert own.centre == pytest.approx(every.centre[every.element == element])
        assert own.series == pytest.approx(every.series[every.element == element], abs=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("quantity", "value", "counts"),
    [("lambda2", -1.0, False), ("lambda2", -1.0, True), ("max(d(u,x),d(v,y))", 0.5, True)],
)
def test_only_genuine_zeros_of_products_count_in_boxes(iso, monkeypatch, quantity, value, counts):
    """Models stand for determinants and products; without conditions, pixels with other zeros are not certain."""
    found = ElementLevelSeries.of

    def without_condition(series, elements):
        boxes = found(series, elements)
        assert len(boxes)
        assert (boxes.condition[:, 0] >= 0).any()
        return boxes if counts else replace(boxes, condition=np.tile((-1.0, 0.0), (len(boxes), 1)))

    monkeypatch.setattr(ElementLevelSeries, "of", without_condition)
    with nullcontext() if counts else pytest.raises(AssertionError):
        refute(iso, flow(Shape.HEXAHEDRON, modes=6), quantity, value, (20, 16), 0.95)


@pytest.mark.parametrize("stated", [True, False])
def test_remainders_of_series_in_boxes_count(iso, monkeypatch, stated):
    """Series that are off by a constant refute nothing where their misfit says so, and something where it does not."""
    found = ElementLevelSeries.of

    def shifted(own, elements):
        own.level = 1.0 - SHIFT
        boxes = found(own, elements)
        series, misfit = boxes.series.copy(), boxes.misfit.copy()
        series[:, 0, 0, 0] += SHIFT
        misfit[:, 0] += SHIFT * stated
        return replace(boxes, series=series, misfit=misfit)

    monkeypatch.setattr(ElementLevelSeries, "of", shifted)
    with nullcontext() if stated else pytest.raises(AssertionError):
        refute(iso, flow(Shape.HEXAHEDRON, modes=6), "q_criterion", 1.0, (20, 16), 0.1)


def test_elements_without_a_model_are_drawn_by_discs(iso, monkeypatch):
    dataset, view = flow(Shape.HEXAHEDRON, modes=6), View.through(CAMERA, (8, 6))
    known = iso(dataset, view, "d(u,x)", 0.5)
    found = ElementLevelSeries.of

    def no_models(own, elements):
        none = np.zeros(0, np.int64)
        boxes = found(own, elements)
        fields = {name: getattr(boxes, name)[none] for name in vars(boxes) if name != "unmodelled"}
        return SeriesBoxes(**fields, unmodelled=np.unique(boxes.element))

    monkeypatch.setattr(ElementLevelSeries, "of", no_models)
    by_discs = iso(dataset, view, "d(u,x)", 0.5)
    hit = np.isfinite(known.depth)
    assert hit.any()
    assert (np.isfinite(by_discs.depth) == hit).all()
    assert by_discs.depth[hit] == pytest.approx(known.depth[hit], abs=1e-9)


#: what series are moved by in tests of their misfit
SHIFT = 1.0
KINKED = "sin(2 * u) + exp(v) * x * abs(w - 0.2)"


@pytest.mark.parametrize(("quantity", "value", "share"), [(KINKED, 0.4, 0.9), ("vorticity", 4.0, 0.98)])
def test_dense_samples_never_refute_certain_pixels_of_functions(iso, quantity, value, share):
    """Kinks alone are ambiguous; the size of the vorticity has its values where its square, without one, has theirs."""
    refute(iso, flow(Shape.HEXAHEDRON), quantity, value, (20, 16), share)


@pytest.mark.thorough
def test_zeros_of_products_are_shown_if_genuine(iso):
    """Levels of eigenvalues and of the greater of two are zeros of products, which have others.

    Edges, where both of two have the level, are ambiguous, and here pixels are large.
    """
    refute(iso, flow(Shape.TETRAHEDRON, modes=3), "lambda2", -1.0, (20, 16), 0.7)


def test_zeros_of_products_on_straight_tetrahedra_match_polynomials(iso):
    """They are expanded, and so is what says which of them count."""
    refute(iso, flow(Shape.TETRAHEDRON, bent=False), "lambda2", -1.0, (28, 22), 0.995)


def test_expressions_that_are_too_long_to_expand_have_the_same_hits(iso, monkeypatch):
    """On straight tetrahedra, by their formulas: of as many elements coefficients would take too much memory."""
    quantity = "q_criterion"
    dataset, view = flow(Shape.TETRAHEDRON, bent=False), View.through(CAMERA, (28, 22))
    expanded = iso(dataset, view, quantity, -1.0)
    monkeypatch.setattr(elements, "_MOST_NUMBERS", 0)
    monkeypatch.setattr(elements, "_MOST_TIMES", 0)
    found = iso(dataset, view, quantity, -1.0)
    sure = (found.status != Status.AMBIGUOUS) & (expanded.status != Status.AMBIGUOUS)
    assert sure.mean() > 0.8
    assert (np.isfinite(found.depth) == np.isfinite(expanded.depth))[sure].all()
    both = sure & np.isfinite(found.depth)
    assert both.sum() > 20
    assert np.abs(found.depth[both] - expanded.depth[both]).max() < 1e-10


def test_expressions_of_coordinates_are_proved(iso):
    """They have no field to be made of."""
    dataset, view = flow(Shape.PYRAMID), View.through(CAMERA, (40, 32))
    hits = iso(dataset, view, "sin(x)", 0.3)
    origins, ways = view.every_ray()
    hit = np.isfinite(hits.depth)
    assert hit.sum() > 50
    assert (hits.status != Status.AMBIGUOUS).mean() > 0.99
    places = (origins + hits.depth[:, None] * ways)[hit]
    assert np.abs(places[:, 0] - np.arcsin(0.3)).max() < 1e-12


@pytest.mark.sampled(least=2, free=("shape",))
@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PYRAMID, Shape.PRISM, Shape.HEXAHEDRON])
def test_values_at_nodes_match_the_quantity(renderer, shape):
    """Sums over series of elements, one direction after the other, are what samples are: on a random part of each."""
    dataset, rng = flow(shape), np.random.default_rng(3)
    device = renderer("vulkan").device
    drawer = IsosurfaceDrawer(DeviceVolume(device, NativeVolume.of(dataset, "q_criterion")))
    part = drawer.loaded.parts[0]
    view = View.through(CAMERA, (8, 8))
    level = Level(view, 0, None, 1.0, drawer.loaded.bindings(0, None), elements=np.arange(len(part)))
    portion, elements = next(drawer.portions(level))
    elements["centre"], elements["half"] = rng.uniform(-0.8, -0.5, (len(elements), 3)), 0.1
    drawer.find_points(portion, device.buffer(elements), len(elements))
    points = device.read(portion.buffers["grid"], np.float64).reshape(-1, 8**3, 4)[: len(elements)]
    for element, own in zip(elements["element"], points, strict=True):
        alone = sample(dataset, ["q_criterion"], own[:, :3], all=True)
        inside = alone.location.element_id == part.element_ids[element]
        off = np.abs(alone.values[inside, 0] - own[alone.location.point[inside], 3])
        assert inside.sum() > 20
        assert off.max() < 1e-10 * np.abs(own[:, 3]).max()


@pytest.mark.parametrize("degree", [3, 7])
def test_tails_bound_the_errors_of_series(degree):
    """1 / (a - x) along one direction, which is at most 1 / (a - c) on the ellipse through c; derivatives as well."""
    nodes = np.cos(np.pi * (2 * np.arange(degree + 1) + 1) / (2 * degree + 2))
    for pole in (1.2, 1.7, 3.0, 9.0):
        series = chebyshev.chebfit(nodes, 1 / (pole - nodes), degree)
        for e, axis in enumerate(AXES):
            for b, box in enumerate(BOXES):
                if not 1.0 < axis < pole or box >= axis:
                    continue
                x = np.linspace(-box, box, 501)
                greatest = 1 / (pole - axis)
                for order, row in enumerate((0, 1, 2)):
                    true = (1, 1, 2)[order] / (pole - x) ** (order + 1)
                    found = chebyshev.chebval(x, chebyshev.chebder(series, order) if order else series)
                    assert np.abs(found - true).max() <= tails(degree)[e, b, row] * greatest


def test_tails_are_as_small_as_possible():
    """The error of 1 / (a - x) is at least a hundredth of what one direction's part of the bound says."""
    degree, pole = 7, 2.0
    nodes = np.cos(np.pi * (2 * np.arange(degree + 1) + 1) / (2 * degree + 2))
    x = np.linspace(-1.0, 1.0, 501)
    off = np.abs(chebyshev.chebval(x, chebyshev.chebfit(nodes, 1 / (pole - nodes), degree)) - 1 / (pole - x)).max()
    best = min(tails(degree)[e, 0, 0] / (pole - axis) for e, axis in enumerate(AXES) if 1.0 < axis < pole)
    assert off > best / 3000
