"""Strongly curved elements, whose maps have roots next to the element: no pixel is missed."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from elvis import Camera, Plane, Scene
from elvis.core.base.arrays import frozen_floats
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.locate import locate
from elvis.core.mapping.patch import Patch, patches
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.expansion import values, values_and_gradients
from elvis.core.polynomials.interpolation import modified
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, ripple
from elvis.plugins.native.bending import bends
from elvis.plugins.nurbs.bezier import evaluated
from elvis.plugins.nurbs.inversion import Solver
from elvis.plugins.runtime.volume import Solution
from elvis.renderer.device.drafts import drafted
from elvis.renderer.raster import gaps
from elvis.renderer.raster.gaps import Gaps
from elvis.renderer.raster.pixels import NOBODY, Pixels
from elvis.scene.cameras.view import view_of

#: shape, nodes along an edge, amplitude, seed, plane and camera of pictures in which Newton's method alone leaves holes
BENT = (
    (
        (Shape.PYRAMID, 5, 0.41, 291956588),
        Plane((0.30819, 0.69289, 0.40214), (0.68941, -0.34046, 0.95693)),
        Camera((1.9688, -0.1969, 2.7678), (0.3511, 0.6020, 0.5222), (-0.6990, 0.3452, 0.6264), height=1.426),
    ),
    (
        (Shape.PYRAMID, 4, 0.43, 639644865),
        Plane((0.78953, 0.44905, 0.79625), (0.45481, -1.21926, -2.06943)),
        Camera((1.1819, -1.2122, -2.6656), (0.5340, 0.5247, 0.2823), (0.2959, -0.7932, 0.5323), height=1.613),
    ),
    (
        (Shape.PRISM, 4, 0.43, 789739130),
        Plane((0.22131, 0.60116, 0.39508), (0.44306, -0.08201, 0.08475)),
        Camera((3.1675, -0.0425, 1.2515), (0.5038, 0.4505, 0.7420), (-0.1818, 0.0336, 0.9828), height=1.237),
    ),
    (
        (Shape.PRISM, 5, 0.37, 1011604407),
        Plane((0.54156, 0.24546, 0.75025), (-0.29271, 1.43181, 0.59563)),
        Camera((-0.1303, 3.0212, 1.4912), (0.3838, 0.5068, 0.4452), (0.0756, -0.3698, 0.9260), height=1.340),
    ),
)


def picture(linear, element, plane, camera, size=(60, 51)):
    shape, nodes, amplitude, seed = element
    dataset = linear(curved(grid(shape, 1), ripple(amplitude, seed=seed), nodes))
    return dataset, {"plane": plane, "camera": camera, "size": size}


@pytest.mark.sampled(least=2, free=("case_number",))
@pytest.mark.parametrize("case_number", range(len(BENT)))
def test_no_element_is_missed(same_on, linear, case_number):
    dataset, scene = picture(linear, *BENT[case_number])
    frame, _ = same_on(dataset, **scene)
    expected = frame.position[frame.seen] @ [1.0, 2.0, -3.0]
    assert frame.seen.sum() > 360
    assert np.abs(frame.field[frame.seen] - expected).max() < 1e-11


@pytest.mark.sampled(least=2, free=("case_number",))
@pytest.mark.parametrize("case_number", range(len(BENT)))
def test_probes_also_miss_no_element(renderer, linear, case_number):
    dataset, _ = picture(linear, *BENT[case_number])
    device = renderer("vulkan")
    device.load(dataset, "u")
    low, high = dataset.mesh.vertices.min(axis=0), dataset.mesh.vertices.max(axis=0)
    points = np.random.default_rng(0).uniform(low, high, (2000, 3))
    places, truth = device.probe(points), locate(dataset, points)
    assert np.array_equal(places.element, truth.element_id)
    seen = places.element >= 0
    assert np.abs(places.field - points @ [1.0, 2.0, -3.0])[seen].max() < 1e-11


@pytest.mark.thorough
def test_drafts_miss_elements_found_only_by_proofs(renderer, linear):
    """And pictures after them are what they would have been."""
    dataset, scene = picture(linear, *BENT[0])
    device = renderer("vulkan")
    device.load(dataset, "u")
    frame = device.render(Scene("u", **scene))
    with drafted():
        draft = device.render(Scene("u", **scene))
    after = device.render(Scene("u", **scene))
    assert np.array_equal(after.rgb, frame.rgb)
    assert draft.seen.sum() < frame.seen.sum()
    assert not (draft.seen & ~frame.seen).any()
    assert np.array_equal(draft.field[draft.seen], frame.field[draft.seen])


def moved(shape, cells, amplitude, seed):
    """A grid of straight elements whose vertices stand anywhere near their places."""
    mesh = grid(shape, cells)
    shifts = np.random.default_rng(seed).uniform(-amplitude, amplitude, mesh.vertices.shape)
    return replace(mesh, vertices=frozen_floats(mesh.vertices + shifts))


@pytest.mark.sampled
@pytest.mark.parametrize("shape", [Shape.PYRAMID, Shape.PRISM, Shape.HEXAHEDRON], ids=lambda shape: shape.label)
@pytest.mark.parametrize("seed", range(4))
def test_no_element_is_missed_along_a_plane(same_on, linear, shape, seed):
    """Seen at grazing angles from within the mesh, sections are long and their bounds wide."""
    dataset = linear(moved(shape, 2, 0.07, seed))
    eye, at = (-0.3, 0.45 + 0.1 * seed, 0.6), (0.3, 0.5, 0.5)
    camera = Camera(eye, at, (0.9, -1.7, 0.3), fov=40.0 + 20 * seed)
    same_on(dataset, plane=Plane((0.5, 0.4, 0.45), (0.0, 0.1, 1.0)), camera=camera, size=(140, 120))


def test_these_are_hard_cases(draw, linear, monkeypatch):
    """Without the second search there are holes; else they would prove nothing."""
    dataset, scene = picture(linear, *BENT[2], size=(100, 85))
    whole = draw(dataset, **scene)
    monkeypatch.setattr(Gaps, "close", lambda *_: None)
    assert whole.seen.sum() > draw(dataset, **scene).seen.sum() + 40


@pytest.mark.parametrize("shape", [*Shape.of_dimension(2), *Shape.of_dimension(3)], ids=lambda shape: shape.label)
def test_curved_borders_are_recognised(shape):
    """Straight and slightly curved elements don't, strongly curved ones and all curved pyramids do."""
    answers = []
    for amplitude in (0.0, 0.01, 0.6):
        mesh = curved(grid(shape, 3), ripple(amplitude, seed=1), 4)
        (patch,) = patches(Dataset(mesh))
        strong = bends(patch, np.arange(len(patch)))
        assert np.array_equal(bends(patch, np.array([2, 0, 2])), strong[[2, 0, 2]])
        answers.append(strong)
    assert not answers[0].any()
    assert answers[1].all() if shape is Shape.PYRAMID else not answers[1].any()
    assert answers[2].any()
    assert len(bends(patch, np.empty(0, int))) == 0


def flat_where_measured(shape, strength):
    """One element with x = xi1 + strength f(xi1) and f' = 0 at vertices, middles and centre when it is made larger."""
    parts = [shape.vertices[list(part)].mean(axis=0) for part in (*shape.edges, *shape.faces)]
    centre = shape.vertices.mean(axis=0)
    places = centre + 1.25 * (np.concatenate([shape.vertices, parts, centre[None]]) - centre)
    slope = np.polynomial.Polynomial.fromroots(np.repeat(np.unique(places[:, 0].round(12)), 2))
    bump = (strength / slope(np.linspace(-1, 1, 201)).max() * slope).integ()
    degree = bump.degree()

    # the smallest number of modes that holds it, and points that determine these
    modes = (degree + 1,) * shape.dimension if len(shape.vertices) == shape.dimension + 1 else (degree + 1, 2, 2)
    modes = (degree + 1, 2, degree + 1) if shape is Shape.PRISM else modes[: shape.dimension]
    expansion = modified(shape, modes)
    lines = [np.cos(np.pi * (np.arange(n) + 0.5) / n) for n in modes]
    xi = uncollapse(shape, np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, shape.dimension))
    world = np.pad(xi, ((0, 0), (0, 3 - shape.dimension)))
    world[:, 0] += bump(xi[:, 0])
    coefficients = np.linalg.lstsq(values(expansion, xi), world)[0].T[None]
    return Patch(shape, np.zeros(1, int), expansion, coefficients, (), ())


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1 and shape is not Shape.PYRAMID])
def test_curvature_is_bounded_not_sampled(shape):
    assert bends(flat_where_measured(shape, 2.0), np.zeros(1, int)).all()
    assert not bends(flat_where_measured(shape, 1e-3), np.zeros(1, int)).any()


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1], ids=lambda shape: shape.label)
def test_straight_borders_are_nearly_linear_everywhere(shape):
    """b + m / 2 <= 1, as sampled beyond the border; pyramids, whose map would have to be affine, within it."""
    random = np.random.default_rng(3)
    larger = 1.0 if shape is Shape.PYRAMID else 1.25
    amplitude = 1e-12 if shape is Shape.PYRAMID else 0.1
    (patch,) = patches(Dataset(curved(grid(shape, 2), ripple(amplitude, seed=2), 4)))
    chosen = np.flatnonzero(~bends(patch, np.arange(len(patch))))
    centre = shape.vertices.mean(axis=0)
    points = centre + larger * (uncollapse(shape, random.uniform(-1, 1, (60, shape.dimension))) - centre)
    gradients = values_and_gradients(patch.geometry, np.vstack([centre, points]))[1]
    jacobians = np.einsum("ncm,sdm->nscd", patch.geometry_coefficients[chosen, : shape.dimension], gradients)
    parts = np.linalg.solve(jacobians[:, :1], jacobians)
    change = np.abs(parts - np.eye(shape.dimension)).sum(axis=3).max(axis=(1, 2))
    first, second = np.triu_indices(len(points), 1)
    steps = np.abs(points[first] - points[second]).max(axis=1)
    slope = (np.abs(parts[:, 1 + first] - parts[:, 1 + second]).sum(axis=3).max(axis=2) / steps).max(axis=1)
    assert len(chosen)
    assert (change + slope / 2 <= 1 + 1e-9).all()


@pytest.mark.parametrize(("amount", "expected"), [(0.002, False), (0.5, True)])
def test_weights_of_rational_maps_curve_them(amount, expected):
    """Jacobians in [0, 1]^3 by finite differences, on an element that is a little larger."""
    random = np.random.default_rng(5)
    lattice = np.stack(np.meshgrid(*3 * [np.linspace(0, 1, 3)], indexing="ij"), axis=-1)
    weights = 1 + amount * random.uniform(-1, 1, (3, 3, 3, 1))
    nets = np.concatenate([weights * lattice, weights], axis=-1)[None]
    assert Solver(nets, None).bends(np.zeros(1, int)).tolist() == [expected]

    def jacobians_at(points):
        step = 1e-5 * np.eye(3)[:, None]
        ends = [
            evaluated(np.repeat(nets, 3 * len(points), 0), (points + sign * step).reshape(-1, 3)) for sign in (1, -1)
        ]
        places = [(end[:, :3] / end[:, 3:]).reshape(3, -1, 3) for end in ends]
        return np.moveaxis(places[0] - places[1], 0, 2) / 2e-5

    points = np.vstack([[[0.5] * 3], random.uniform(-0.125, 1.125, (40, 3))])
    jacobians = jacobians_at(points)
    parts = np.linalg.solve(jacobians[:1], jacobians)
    change = np.abs(parts - np.eye(3)).sum(axis=2).max()
    steps = np.abs(points[:, None] - points).max(axis=2) + np.eye(len(points))
    slope = (np.abs(parts[:, None] - parts).sum(axis=3).max(axis=2) / steps).max()
    assert expected or change + slope / 2 <= 1


class Disc:
    """Elements that are one disc of radius 0.3, which a kernel has missed altogether."""

    def __init__(self, count):
        self.count = count

    def __len__(self):
        return self.count

    def bends(self, elements):
        return np.ones(len(elements), bool)

    def solve(self, elements, points):
        margin = 0.3 - np.hypot(*points[:, :2].T)
        inside = margin >= 0
        reference = np.zeros((len(points), 3))
        return Solution(inside.astype(int), np.where(inside, margin, 0.0), reference, points[:, 0])


CANDIDATE = [
    *(("pixel", np.uint32), ("element", np.uint32), ("status", np.int32)),
    *(("field", np.float64), ("margin", np.float64), ("reference", np.float64, 3)),
]


def closed(size, count):
    """The pixels of a picture of coincident discs, and its view."""
    scene = Scene(
        plane=Plane((0, 0, 0), (0, 0, 1)),
        camera=Camera((0, 0, 3), (0, 0, 0), (0, 1, 0), height=1.0),
        size=(size, size),
    )
    view = view_of(scene)
    sections = np.zeros(count, [("element", np.uint32), ("least", np.int32, 4), ("most", np.int32, 4)])
    sections["element"] = np.arange(count)
    sections["least"] = (0, 0, 0, -size)
    sections["most"] = (size - 1, size - 1, 2 * size, size)
    pixels = Pixels(np.full(size * size, NOBODY, np.uint32), np.zeros(size * size, np.uint8))
    Gaps([Disc(count)], lambda n: np.zeros(n, CANDIDATE)).close(view, pixels, [sections])
    return pixels, view


def test_memory_of_the_search_does_not_grow_with_the_picture():
    tracemalloc.start()
    try:
        pixels, view = closed(400, 4)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    away = np.hypot(view.points()[..., 0], view.points()[..., 1]).reshape(-1)
    assert np.array_equal(pixels.owner == 0, away <= 0.3)
    assert (pixels.owner[pixels.owner != NOBODY] == 0).all()
    assert peak < 75e6


def test_the_search_by_bands_matches_the_whole_search(monkeypatch):
    whole, _ = closed(120, 3)
    monkeypatch.setattr(gaps, "_MOST", 500)
    bands, _ = closed(120, 3)
    assert np.array_equal(whole.owner, bands.owner)
    assert np.array_equal(whole.status, bands.status)
    assert len(bands.committed) > len(whole.committed)
