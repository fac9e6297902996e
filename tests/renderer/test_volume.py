"""Volumes whose light along every ray is known: chords, integrals in closed form, and what happens at borders.

Bent elements have maps of order 2 and fields of order 3 (three and four modes), so that few kernels are compiled.
"""

from dataclasses import replace

import numpy as np
import pytest
from boxes_of_rays import EVEN, SIZE, VIEWS, WHITE, chord
from warps import sheared

from elvis import Camera, Plane, SceneError
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import Composite
from elvis.core.mapping.connectivity import connected
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, with_field
from elvis.scene import Clip, Transfer
from elvis.scene.cameras.view import View

SOLIDS = [shape for shape in Shape if shape.dimension == 3]


@pytest.mark.sampled
@pytest.mark.parametrize("camera", VIEWS)
@pytest.mark.parametrize("shape", SOLIDS)
def test_segments_add_up_to_the_chord(integrate, shape, camera):
    view = View.through(VIEWS[camera], SIZE)
    light = integrate(with_field(grid(shape, 2), lambda p: p[:, 0], 3), view, EVEN)
    assert np.abs(light.length - chord(view)).max() < 1e-9
    assert np.abs(light.alpha - (1 - np.exp(-chord(view)))).max() < 1e-9
    assert np.abs(light.color - light.alpha[:, None]).max() < 1e-12
    assert not light.lost.any()


@pytest.mark.sampled(least=2, free=("shape",))
@pytest.mark.parametrize("shape", SOLIDS)
def test_chords_of_curved_elements(integrate, shape):
    view = View.through(Camera((0.47, 0.53, 5.0), (0.47, 0.53, 0.0), (0.0, 1.0, 0.0), height=0.9), SIZE)
    light = integrate(with_field(curved(grid(shape, 2), sheared, 3), lambda p: p[:, 0], 4), view, EVEN)
    inside = chord(view, low=(0, 0, -9), high=(1, 1, 9)) > 0
    assert np.abs(light.length - inside).max() < 1e-9
    assert not light.lost.any()


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.HEXAHEDRON])
def test_rays_through_vertices_of_curved_elements(integrate, shape):
    """Elements that a ray only touches at a vertex have one hit, an entry or an exit, and no chord."""
    data = with_field(curved(grid(shape, 2), layered, 3), lambda p: p[:, 0], 4)
    vertex = layered(np.full((1, 3), 0.5))[0]
    for away in ((2.1, -2.4, 1.6), (-1.3, 2.2, 2.9), (0.7, 2.6, -2.2), (2.8, 0.4, 0.9)):
        view = View.through(Camera(tuple(vertex + away), tuple(vertex)), (1, 1))
        light = integrate(data, view, EVEN)
        assert np.abs(light.length - chord(view)).max() < 1e-9
        assert not light.lost.any()


def layered(points):
    """Layers over z = 0 that swell and slide where they are not on the cube's border, which stays."""
    x, y, z = points.T
    hill = x * (1 - x) * y * (1 - y)
    return points + np.stack([0.4 * hill, -0.4 * hill, 0.8 * hill * z * (1 - z)], axis=1)


def jostled(points):
    """Each cell of a grid of 3 x 3 x 3 is moved within itself, so that it remains the same cube."""
    inner = 3 * points - np.floor(3 * points + 1e-9)
    return points + 0.1 * inner * (1 - inner) * (1 + np.roll(points, 1, axis=1))


@pytest.mark.sampled
@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.HEXAHEDRON])
def test_boundary_layers_of_aspect_a_hundred_thousand(integrate, shape, bent):
    """Cells that shrink to 1e-5 of their width towards z = 0."""

    def squeezed(points):
        return points * [1, 1, 0] + np.outer(10.0 ** (-5 * (1 - points[:, 2])) * (points[:, 2] > 0), [0, 0, 1])

    mesh = grid(shape, 3)
    mesh = replace(mesh, vertices=squeezed(mesh.vertices))
    mesh = curved(mesh, layered, 3) if bent else mesh
    for camera in (*VIEWS.values(), Camera((3.0, 0.37, 0.1), (0.5, 0.5, 0.003), height=0.02)):
        view = View.through(camera, SIZE)
        light = integrate(with_field(mesh, lambda p: p[:, 0], 4 if bent else 3), view, EVEN)
        assert np.abs(light.length - chord(view)).max() < 1e-9
        assert not light.lost.any()


@pytest.mark.sampled
@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.HEXAHEDRON])
def test_holes_and_separate_parts(integrate, shape, bent):
    """Of 3 x 3 x 3 cells, those with an even sum of their numbers are left: they touch at edges alone."""
    mesh, side = grid(shape, 3), np.arange(27)
    mesh = curved(mesh, jostled, 3) if bent else mesh
    cells = np.flatnonzero((side % 3 + side // 3 % 3 + side // 9) % 2 == 0)
    per = 6 if shape is Shape.TETRAHEDRON else 1
    chosen = (cells[:, None] * per + np.arange(per)).reshape(-1)
    mesh = replace(mesh, composites=(Composite(0, ((shape.tag, chosen),)),), domains={0: (0,)})
    view = View.through(VIEWS["parallel"], SIZE)
    light = integrate(with_field(mesh, lambda p: p[:, 0], 4 if bent else 3), view, EVEN)
    expected = np.zeros(view.count)
    for cell in cells:
        low = np.array([cell % 3, cell // 3 % 3, cell // 9]) / 3
        expected += chord(view, low=low, high=low + 1 / 3)
    assert np.abs(light.length - expected).max() < 1e-9


def test_inverted_elements_are_drawn(integrate):
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    view = View.through(VIEWS["perspective"], SIZE)
    lengths = []
    for order in ([0, 1, 2, 3], [1, 0, 2, 3]):
        mesh = connected(corners, {Shape.TETRAHEDRON: np.array([order])})
        lengths.append(integrate(with_field(mesh, lambda p: p[:, 0], 2), view, EVEN).length)
    assert lengths[0].max() > 0.3
    assert np.abs(lengths[0] - lengths[1]).max() < 1e-12


@pytest.mark.sampled(least=2, free=("shape",))
@pytest.mark.parametrize("shape", SOLIDS)
def test_inverted_curved_elements_have_the_same_chords(integrate, shape):
    """The mirror image of a curved mesh, seen in the mirror: all its Jacobians are negative."""
    mesh, mirrored = (curved(grid(shape, 2), lambda p, k=k: sheared(p) * [1, 1, k], 3) for k in (1, -1))
    lengths = []
    for data, side in ((mesh, 1), (mirrored, -1)):
        view = View.through(Camera((0.47, 0.53, side * 5.0), (0.47, 0.53, 0.0), (0.0, 1.0, 0.0), height=0.9), SIZE)
        light = integrate(with_field(data, lambda p: p[:, 0], 4), view, EVEN)
        assert not light.lost.any()
        lengths.append(light.length.reshape(SIZE[::-1])[:, ::side])
    assert np.abs(lengths[0] - lengths[1]).max() < 1e-9
    assert lengths[0].max() > 0.99


def test_curved_elements_outside_the_picture_emit_no_light(integrate):
    """No tile of the picture has an element in it."""
    view = View.through(Camera((9.0, 9.0, 5.0), (9.0, 9.0, 0.0), (0.0, 1.0, 0.0), height=0.9), SIZE)
    light = integrate(with_field(curved(grid(Shape.HEXAHEDRON, 2), sheared, 3), lambda p: p[:, 0], 3), view, EVEN)
    assert not light.alpha.any()
    assert not light.lost.any()


@pytest.mark.sampled(least=2, free=("shape",))
@pytest.mark.parametrize("shape", SOLIDS)
def test_integrals_in_curved_elements_converge_with_the_requested_error(integrate, shape):
    """Heights s become z = 1.3 s - 0.3 s^2, so that s bends along the ray; density and red are 3 s, seen from above."""
    mesh = curved(grid(shape, 2), lambda p: p + np.outer(0.3 * p[:, 2] * (1 - p[:, 2]), [0, 0, 1]), 3)
    data = with_field(mesh, lambda p: (1.3 - np.sqrt(1.69 - 1.2 * np.clip(p[:, 2], 0, 1))) / 0.6, 4)
    ramp = Transfer((0.0, 1.0), (0.0, 3.0), ((0, 0, 0), (1, 0, 0)))
    view = View.through(Camera((0.47, 0.53, 5.0), (0.47, 0.53, 0.0), (0.0, 1.0, 0.0), height=0.9), (3, 3))
    nodes, weights = np.polynomial.legendre.leggauss(40)
    s = (nodes + 1) / 2
    passed = 3 * (0.65 * (1 - s**2) - 0.2 * (1 - s**3))
    exact = 0.5 * weights @ (3 * s**2 * np.exp(-passed) * (1.3 - 0.6 * s))
    errors, counts = [], []
    for asked in (1e-2, 1e-4, 1e-6, 1e-8):
        light = integrate(data, view, ramp, error=asked)
        errors.append(np.abs(light.color[:, 0] - exact).max())
        counts.append(int(light.segments.sum()))
        assert errors[-1] <= asked
        assert not light.lost.any()
    assert errors[-1] < 1e-3 * max(errors[0], 1e-6)
    assert counts[-1] > counts[0]


def test_light_of_a_ramp_in_closed_form(integrate):
    """Density z, colour from black to red with z, seen from above: D = (1 - z^2) / 2, C the integral of z^2 exp(-D).

    Many of these rays run along faces and edges.
    """
    view = View.through(Camera((0.5, 0.5, 5.0), (0.5, 0.5, 0.0), (0.0, 1.0, 0.0), height=0.9), (5, 5))
    ramp = Transfer((0.0, 1.0), (0.0, 1.0), ((0, 0, 0), (1, 0, 0)))
    data = with_field(grid(Shape.TETRAHEDRON, 2), lambda p: p[:, 2], 2)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    v = (nodes + 1) / 2
    exact = 0.5 * weights @ (v**2 * np.exp((v**2 - 1) / 2))
    for error in (1e-3, 1e-6, 1e-9):
        light = integrate(data, view, ramp, error=error)
        assert np.abs(light.color[:, 0] - exact).max() < error
        assert (light.error <= error).all()
    assert np.abs(light.alpha - (1 - np.exp(-0.5))).max() < 1e-12


@pytest.mark.parametrize("shape", SOLIDS)
def test_the_requested_error_is_reached_across_breakpoints(integrate, shape):
    """A thin bright shell in a wavy field, against the same with an error a hundred times smaller."""
    data = with_field(curved(grid(shape, 2), sheared, 3), lambda p: ((p - 0.5) ** 2).sum(axis=1), 4)
    shell = Transfer((0.08, 0.1, 0.11, 0.14), (0.0, 60.0, 5.0, 0.0), ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)))
    view = View.through(VIEWS["perspective"], (11, 9))
    fine = integrate(data, view, shell, error=1e-6)
    assert fine.alpha.max() > 0.5
    for error in (1e-2, 1e-4):
        light = integrate(data, view, shell, error=error)
        assert np.abs(light.color - fine.color).max() < error
        assert np.abs(light.alpha - fine.alpha).max() < error


def fragment(view, depth, color=(0.0, 0.0, 0.0), alpha=1.0):
    """A surface at one depth, in all pixels."""
    return np.full(view.count, depth), np.tile(np.multiply(color, alpha), (view.count, 1)), np.full(view.count, alpha)


def plane_at(view, depth, away):
    """A clip that takes away what lies before ("inside") or behind a depth."""
    forward = view.camera.basis()[2]
    return Clip(Plane(tuple(np.asarray(view.camera.eye) + depth * forward), tuple(forward)), away)


def test_surfaces_end_the_march(integrate):
    """What lies before a surface, the surface and what lies behind it make up the whole, in one go."""
    view = View.through(VIEWS["perspective"], SIZE)
    data = with_field(grid(Shape.TETRAHEDRON, 2), lambda p: p[:, 2], 2)
    transfer = Transfer((0.0, 0.5, 1.0), (3.0, 0.0, 4.0), ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    whole = integrate(data, view, transfer, error=1e-9)
    before = integrate(data, view, transfer, error=1e-9, fragments=[fragment(view, 1.6)])
    behind = integrate(data, view, transfer, error=1e-9, clips=[plane_at(view, 1.6, "inside")])
    assert 0.1 < before.length.max() < whole.length.max()
    assert np.abs(before.length + behind.length - whole.length).max() < 1e-12
    mixed = before.color + (1 - before.coverage)[:, None] * behind.color
    assert np.abs(mixed - whole.color).max() < 1e-8
    assert (before.alpha[before.segments > 0] == 1).all()

    # two surfaces, given in the wrong order; colour and light of both
    glass = [fragment(view, 1.9, (0, 1, 0), 0.3), fragment(view, 1.6, (1, 0, 0), 0.5)]
    both = integrate(data, view, transfer, error=1e-9, fragments=glass)
    between, last = (
        integrate(
            data, view, transfer, error=1e-9, clips=[plane_at(view, low, "inside"), plane_at(view, high, "outside")]
        )
        for low, high in ((1.6, 1.9), (1.9, 99.0))
    )
    color, through = np.array(before.color), 1 - before.coverage
    for (hue, alpha), light in (((glass[1][1][0], 0.5), between), ((glass[0][1][0], 0.3), last)):
        color += through[:, None] * hue
        through = through * (1 - alpha)
        color += through[:, None] * light.color
        through = through * (1 - light.coverage)
    here = both.segments > 0
    assert np.abs(both.color - color)[here].max() < 1e-8
    assert np.abs(1 - both.alpha - through)[here].max() < 1e-8


def test_nan_elements_are_skipped_and_counted(integrate):
    data = with_field(grid(Shape.TETRAHEDRON, 2), lambda p: p[:, 2], 2)
    block = data.fields[0].blocks[0]
    values = np.array(block.coefficients)
    values[:6] = np.nan
    data = Dataset(data.mesh, (replace(data.fields[0], blocks=(replace(block, coefficients=values),)),))
    view = View.through(VIEWS["parallel"], SIZE)
    light = integrate(data, view, EVEN)
    hole = chord(view, high=(0.5, 0.5, 0.5))
    assert ((light.undefined > 0) == (hole > 1e-12)).all()
    assert np.abs(light.alpha - (1 - np.exp(hole - chord(view)))).max() < 1e-9


def test_undrawable_volumes_are_rejected(integrate):
    data, view = with_field(grid(Shape.TETRAHEDRON, 1), lambda p: p[:, 2], 2), View.through(VIEWS["parallel"], (4, 4))
    with pytest.raises(SceneError, match=r"1e\+308 overflows"):
        integrate(data, view, Transfer((0.0,), (1e308,), (WHITE,)))
    with pytest.raises(SceneError, match="colors of a volume"):
        integrate(data, view, Transfer((0.0, 1.0), (1.0, 1.0)))
    with pytest.raises(SceneError, match="ascending"):
        Transfer((1.0, 0.0), (1.0, 1.0))
    with pytest.raises(SceneError, match="ascending"):
        Transfer((), ())
    plane = with_field(grid(Shape.TRIANGLE, 1), lambda p: p[:, 0], 2)
    with pytest.raises(SceneError, match="3D"):
        integrate(plane, view, EVEN)


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.HEXAHEDRON])
def test_reversed_rays_have_the_same_segments(integrate, shape):
    """Seen from behind, columns run backwards."""
    data, lights = with_field(curved(grid(shape, 2), sheared, 3), lambda p: p[:, 0], 4), []
    for side in (1, -1):
        eye = (0.5 + side * 1.7, 0.5 + side * 2.3, 0.5 + side * 0.9)
        view = View.through(Camera(eye, (0.5, 0.5, 0.5), height=1.8), SIZE)
        lights.append(integrate(data, view, EVEN).length.reshape(SIZE[::-1])[:, ::side])
    assert lights[0].max() > 0.5
    assert np.abs(lights[0] - lights[1]).max() < 1e-9
