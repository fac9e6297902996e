"""No zero along a ray is lost: functions and scenes whose zeros are known, close pairs among them."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import chebyshev

from elvis import Camera, Scene, Status
from elvis.core.mapping.locate import Locator
from elvis.core.mapping.patch import patches
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, ripple, with_field
from elvis.reference.picture import render
from elvis.reference.quantities import Quantities
from elvis.reference.scenes import isosurfaces
from elvis.reference.scenes.bounding import candidates
from elvis.reference.scenes.rasters import on_screen
from elvis.reference.scenes.zeros import zeros
from elvis.reference.solids import map_points, margins_of
from elvis.scene import Isosurface, Style
from elvis.scene.cameras.view import View

DIGITS = 1e-14
NEAR = Camera((2.2, -1.7, 1.9), (0.5, 0.5, 0.5), fov=28.0)


def wave(x):
    return np.sin(9 * x @ np.array([0.5, 0.7, -0.4])) * np.cos(5 * x[:, 2])


def products(roots, scales):
    """Functions scale * product (x - root), of rows of roots (k, n)."""

    def along(which, shares):
        return scales[which, None] * np.prod(shares[:, :, None] - roots[which][:, None], axis=2)

    return along


def test_gradients_of_expressions_follow_from_those_of_their_fields():
    data = with_field(curved(grid(Shape.PRISM, 1), ripple(0.05), 3), wave)
    of = Quantities(data, ["u", "u^2"])
    (patch,) = of.patches
    rows, points = np.array([0, 1, 1]), np.array([[-0.5, -0.5, 0.1], [-0.2, -0.7, 0.4], [0.1, -0.4, -0.3]])
    value, gradient = of.values_and_gradients("u", patch, rows, points)
    square, rise = of.values_and_gradients("u^2", patch, rows, points)
    assert square == pytest.approx(value**2, rel=1e-12, abs=0)
    assert rise == pytest.approx(2 * value[:, None] * gradient, rel=1e-5, abs=1e-8)


@pytest.mark.parametrize("apart", [1e-1, 1e-3, 1e-5])
def test_close_pairs_are_found(apart):
    rng = np.random.default_rng(3)
    first = rng.uniform(0.05, 0.85, (200, 1))
    roots = np.hstack([first, first + apart, rng.uniform(1.1, 2.0, (200, 4)), rng.uniform(-1.0, -0.1, (200, 3))])
    found = zeros(products(roots, rng.normal(size=200)), 9, np.full(200, DIGITS))
    assert not found.double.any()
    assert not found.rough.any()
    assert np.array_equal(np.bincount(found.which, minlength=200), np.full(200, 2))
    place = found.place[np.lexsort([found.place, found.which])].reshape(200, 2)
    assert np.abs(place - np.sort(roots[:, :2], axis=1)).max() < 1e-3 * apart


def test_inseparable_pairs_are_reported():
    """Apart by less than rounding, or missing by as little: double; where values keep off further: none."""
    for shift, double in ((0.0, True), (1e-17, True), (1e-9, False)):
        found = zeros(lambda which, x, shift=shift: (x - 0.3) ** 2 + shift, 2, np.full(1, DIGITS))
        assert found.double.any() == double
        assert len(found.which) == 0 or np.abs(found.place - 0.3).max() < 1e-6
        assert double or not len(found.which)


@pytest.mark.parametrize("degree", [1, 4, 9, 16])
def test_zeros_of_random_polynomials_match_those_of_their_matrices(degree):
    """Against the real eigenvalues in [0, 1] of the colleague matrix (Good 1961)."""
    rng = np.random.default_rng(degree)
    series = rng.normal(size=(300, degree + 1))

    def along(which, x):
        return np.einsum("kmd,kd->km", chebyshev.chebvander(2 * x - 1, degree), series[which])

    found = zeros(along, degree, np.full(300, DIGITS))
    assert not found.double.any()
    count = 0
    for number, own in enumerate(series):
        roots = chebyshev.chebroots(own)
        expected = np.sort(roots.real[(np.abs(roots.imag) < 1e-10) & (np.abs(roots.real) <= 1)])
        places = np.sort(2 * found.place[found.which == number] - 1)
        assert len(places) == len(expected)
        assert np.abs(places - expected).max(initial=0.0) < 1e-9
        count += len(expected)
    assert count > 150


def test_functions_that_are_not_polynomials():
    """Resolved in parts: sin has its zeros, a kink its place as a guess, and what has no value no zero."""
    found = zeros(lambda which, x: np.sin(20 * np.pi * x - 1), 6, np.full(1, DIGITS))
    assert len(found.which) == 20
    assert np.abs(np.sort(found.place) - (np.arange(20) + 1 / np.pi) / 20).max() < 1e-10
    kink = zeros(lambda which, x: np.abs(x - 0.37) - 0.1, 6, np.full(1, DIGITS))
    assert np.abs(np.sort(kink.place[~kink.rough]) - [0.27, 0.47]).max() < 1e-12
    touched = zeros(lambda which, x: np.abs(x - 0.37), 6, np.full(1, DIGITS))
    assert touched.double.all()
    assert len(touched.which) > 0
    assert np.abs(touched.place - 0.37).max() < 1e-4
    pole = zeros(lambda which, x: 1 / (x - 0.37) ** 2 - 4, 6, np.full(1, DIGITS))
    assert not pole.double.any()
    with np.errstate(invalid="ignore"):
        none = zeros(lambda which, x: np.sqrt(x - 0.5) + 1, 6, np.full(1, DIGITS))
    assert not len(none.which)


@pytest.mark.parametrize("shape", Shape.of_dimension(3), ids=lambda shape: shape.label)
def test_every_pair_of_an_element_and_a_ray_is_examined(shape):
    """Wherever a random field on curved elements takes a value, the pixel next to the place is a candidate."""
    rng, mesh = np.random.default_rng(5), curved(grid(shape, 1), ripple(0.1, seed=1), 4)
    data = with_field(mesh, lambda x: np.sin(7 * x @ np.array([0.9, -0.5, 0.7])), 6)
    quantities, view = Quantities(data, ["u"]), View.through(NEAR, (50, 40))
    (patch,), start = quantities.patches, rng.uniform(-1, 1, (20000, 3))
    points = start[margins_of(patch, start) > 0][:1500]
    rows = rng.integers(len(patch), size=len(points))
    values = quantities.values("u", patch, rows, points)
    (place, _), missed = on_screen(view, map_points(patch, rows, points)[0]), 0
    for value in np.linspace(values.min(), values.max(), 5)[1:-1]:
        # pixels next to places whose values are next to the one that is searched for
        near = np.flatnonzero(np.abs(values - value) < 0.02)
        pairs = candidates(patch, quantities, "u", value, view)
        pixels = np.rint(place[near]).astype(int)
        around = [
            np.isin(rows[near] * view.count + (pixels[:, 1] + j) * view.width + pixels[:, 0] + i, pairs)
            for i in (-1, 0, 1)
            for j in (-1, 0, 1)
        ]
        missed += (~np.any(around, axis=0)).sum()
        assert len(near) > 10
    assert missed == 0


@pytest.mark.parametrize("shape", Shape.of_dimension(3), ids=lambda shape: shape.label)
def test_two_close_surfaces_are_both_visible(shape):
    """The planes s = 0.4 and s = 0.4 + GAP where (s - 0.4)(s - 0.4 - GAP)(s^2 + 1) is zero: the nearer one is seen."""
    gap, normal = 3e-4, np.array([0.6, -0.48, 0.64])

    def sheets(x):
        s = x @ normal
        return (s - 0.4) * (s - 0.4 - gap) * (s**2 + 1)

    data = with_field(grid(shape, 1), sheets, 5)
    frame = render(data, Scene("u", camera=NEAR, size=(40, 32), objects=(Isosurface((0.0,)),)))
    seen = frame.seen & (frame.status == Status.CERTAIN)
    s, eye = frame.position @ normal, np.array(NEAR.eye) @ normal
    nearer = 0.4 if eye < 0.4 else 0.4 + gap
    assert seen.sum() > 200
    assert np.abs(s[seen] - nearer).max() < 1e-9


def test_close_pairs_in_curved_elements_of_high_order_are_found():
    """Every change of sign between 2000 steps along rays is met, in hexahedra of degree 8 whose edges bend."""
    data = with_field(curved(grid(Shape.HEXAHEDRON, 1), ripple(0.12, seed=2), 4), wave, 9)
    style = Style(opacity=0.5, color=(0.0, 0.0, 0.0), lit=False)
    scene = Scene("u", camera=NEAR, size=(16, 12), objects=(Isosurface((0.3,), style=style),))
    shown = render(data, scene)
    view = shown.view
    origins, directions = view.every_ray()
    steps = np.linspace(1.0, 6.0, 2000)
    locator, evaluator = Locator(patches(data, ["u"])), Quantities(data, ["u"])
    for pixel in np.flatnonzero(shown.status.ravel() == Status.CERTAIN)[::5]:
        points = origins[pixel] + steps[:, None] * directions[pixel]
        found = locator.locate(points)
        inside = found.element_id >= 0
        values = evaluator.values("u", evaluator.patches[0], found.row[inside], found.reference[inside]) - 0.3
        changes = (values[1:] * values[:-1] < 0).sum()
        hidden = np.log(shown.color.reshape(-1, 3)[pixel, 0]) / np.log(0.5)
        assert round(hidden) >= changes
        assert (round(hidden) - changes) % 2 == 0


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PRISM, Shape.HEXAHEDRON], ids=lambda shape: shape.label)
def test_double_zeros_under_cancellation_are_not_missed(shape):
    """(x - 3/8)^2, of modes a million times as large as what rounding leaves of them, seen closely."""
    data = with_field(grid(shape, 2), lambda x: (x[:, 0] - 0.375) ** 2, 4)
    middle = np.array([0.375, 0.4656, 0.4067])
    camera = Camera(tuple(middle - [-0.1319, 0.1136, 2.0294]), tuple(middle), height=0.0029)
    frame = render(data, Scene("u", camera=camera, size=(24, 18), objects=(Isosurface((0.0,)),)))
    assert (frame.status == Status.AMBIGUOUS).all()


@pytest.mark.parametrize("accuracy", [DIGITS, 1e-8, 1e-7])
def test_kinks_at_zero_are_not_missed(accuracy):
    """|x - a| at thousands of places: now and then the last coefficients vanish although a kink is in between."""
    at = np.random.default_rng(1).uniform(0.1, 0.9, 8000)
    found = zeros(lambda which, x: np.abs(x - at[which, None]), 7, np.full(len(at), accuracy))
    nearest = np.full(len(at), np.inf)
    np.minimum.at(nearest, found.which, np.abs(found.place - at[found.which]))
    assert nearest.max() < 1e-4


@pytest.mark.parametrize("distance", [1e-3, 0.1])
def test_isosurfaces_between_elements_far_from_the_origin(distance):
    """x = 1/2 a million lengths away, where rounding puts a hit outside of either of the elements next to it."""
    far = 2.0**20
    mesh = grid(Shape.HEXAHEDRON, 2)
    data = with_field(replace(mesh, vertices=mesh.vertices + far), lambda x: x[:, 0] - far - 0.5, 2)
    eye = np.array([0.5 - distance, 0.5, 0.43]) + far
    camera = Camera(tuple(eye), tuple(eye + np.array([1.1, -0.1, 0.2])), fov=20.0)
    frame = render(data, Scene("u", camera=camera, size=(20, 20), objects=(Isosurface((0.0,)),)))
    assert (frame.status == Status.AMBIGUOUS).all()


def test_double_zeros_are_not_certain():
    """u = (z - 0.5)^2 touches 0 in a plane; moved by as little as rounding it doesn't."""
    dataset = with_field(grid(Shape.HEXAHEDRON, 1), lambda p: (p[:, 2] - 0.5) ** 2, 3)
    camera = Camera((0.4, 0.6, 3.0), (0.5, 0.5, 0.5), up=(0, 1, 0), height=0.6)
    frame = render(dataset, Scene(field="u", objects=(Isosurface((0.0,)),), camera=camera, size=(6, 5)))
    assert np.isfinite(frame.depth).any()
    assert not (frame.status == Status.CERTAIN).any()


@pytest.mark.parametrize("changed", ["double", "place", None])
def test_hits_are_certain_only_if_newton_finds_a_simple_zero(monkeypatch, changed):
    """Zeros of a plane that are said to be double, or at places that Newton's method leaves for others."""

    def found(*options):
        own = zeros(*options)
        changes = {"double": {"double": np.ones(len(own.which), bool)}, "place": {"place": own.place + 0.05}}
        return replace(own, **changes.get(changed, {}))

    monkeypatch.setattr(isosurfaces, "zeros", found)
    data = with_field(grid(Shape.HEXAHEDRON, 1), lambda x: x[:, 2], 2)
    frame = render(data, Scene("u", camera=NEAR, size=(12, 9), objects=(Isosurface((0.4,)),)))
    inner = frame.seen & (np.abs(frame.position[..., :2] - 0.5).max(axis=-1) < 0.4)
    assert inner.sum() > 5
    is_certain = changed is None
    assert ((frame.status == Status.CERTAIN)[inner] == is_certain).all()
    assert (np.isfinite(frame.uncertainty)[inner] == is_certain).all()
