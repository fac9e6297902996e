"""Light of layers, however thin, coloured, opaque or nearly touched: against sums over many small steps within them."""

import numpy as np
import pytest

from elvis import Camera, Dataset, Scene, Status
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.reference.picture import render
from elvis.scene import Transfer, VolumeRendering

SOLIDS = Shape.of_dimension(3)
WHITE = ((1.0, 1.0, 1.0),) * 3
RAINBOW = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
STEPS = 200_000


def cube(shape, function, modes, bend=0.0, shift=0.0):
    """The cube from ``shift`` to ``shift`` + 1 in one or several elements, curved inside, with a field."""
    mesh = grid(shape, 2 if bend else 1)
    inner = ripple(bend, seed=4)
    if bend:
        mesh = curved(mesh, lambda x: x + (inner(x) - x) * np.prod(4 * x * (1 - x), axis=1, keepdims=True), 4)
    if shift:
        mesh = curved(mesh, lambda x: x + shift, 2)
    return Dataset(mesh, (approximated(Dataset(mesh), "u", function, modes=modes),))


def picture(data, transfer, shift=0.0):
    """A picture along x, in a parallel projection: rays through the cube at some places (y, z)."""
    camera = Camera((shift - 1.0, shift + 0.47, shift + 0.52), (shift + 2.0, shift + 0.47, shift + 0.52), height=0.7)
    scene = Scene("u", camera=camera, size=(5, 4), objects=(VolumeRendering(transfer),), background=(0.0, 0.0, 0.0))
    return render(data, scene)


def light(function, transfer, ranges):
    """The light along x from 0 to 1 of a field of x alone, which sends out none beyond some ranges of x."""
    color, passing = np.zeros(3), 1.0
    for low, high in ranges:
        x = low + (np.arange(STEPS) + 0.5) / STEPS * (high - low)
        values = function(x)
        depth = np.interp(values, transfer.values, transfer.densities) * (high - low) / STEPS
        before = np.cumsum(depth) - depth
        hue = np.column_stack([np.interp(values, transfer.values, np.array(transfer.colors)[:, i]) for i in range(3)])
        color += passing * ((np.exp(-before) * -np.expm1(-depth))[:, None] * hue).sum(axis=0)
        passing *= np.exp(-depth.sum())
    return color


@pytest.mark.parametrize("shape", SOLIDS, ids=lambda shape: shape.label)
@pytest.mark.parametrize("width", [2.0**-4, 2.0**-17])
def test_kinks_at_round_values_are_found(shape, width):
    """A field that is exactly a kink's value at round parts of a ray, as dyadic data have it."""
    transfer = Transfer((0.5 - 1.3 * width, 0.5, 0.5 + width), (0.0, 3.0 / width, 0.0), WHITE)
    frame = picture(cube(shape, lambda x: x[:, 0], 2), transfer)
    assert (frame.status == Status.CERTAIN).all()
    assert np.abs(frame.color + np.expm1(-0.5 * 2.3 * 3.0)).max() < 1e-8


@pytest.mark.sampled
@pytest.mark.parametrize("bend", [0.0, 0.05])
@pytest.mark.parametrize("shape", SOLIDS, ids=lambda shape: shape.label)
def test_colours_of_thin_layers(shape, bend):
    width = 2.0**-9
    transfer = Transfer((0.4 - width, 0.4, 0.4 + 2 * width), (0.0, 4.0 / width, 0.0), RAINBOW)
    frame = picture(cube(shape, lambda x: x[:, 0], 5, bend), transfer)
    expected = light(lambda x: x, transfer, [(0.4 - width, 0.4 + 2 * width)])
    assert np.abs(frame.color - expected).max() < 1e-6


def test_colour_changes_inside_opaque_volumes():
    """Density 5000 and the colour x: only the first few thousandths are seen."""
    transfer = Transfer((0.0, 1.0), (5000.0, 5000.0), ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)))
    frame = picture(cube(Shape.TETRAHEDRON, lambda x: 1000 * x[:, 0] - x[:, 0] ** 2, 3), transfer)
    expected = light(lambda x: 1000 * x - x**2, transfer, [(0.0, 0.001), (0.001, 0.02)])
    assert 0.1 < expected[0] < 0.9
    assert np.abs(frame.color - expected).max() < 1e-5


@pytest.mark.parametrize("shape", SOLIDS, ids=lambda shape: shape.label)
def test_layers_that_a_field_hardly_touches(shape):
    """A field with two narrow minima, which alone are within a transfer function's support."""

    def field(x):
        return (x - 0.31) ** 2 * (x - 0.69) ** 2

    width = 1e-4 / 0.38
    transfer = Transfer((-1.0, 0.0, 1e-8), (0.0, 0.5 / width, 0.0), RAINBOW)
    frame = picture(cube(shape, lambda x: field(x[:, 0]), 5), transfer)
    expected = light(field, transfer, [(at - 2 * width, at + 2 * width) for at in (0.31, 0.69)])
    assert expected.max() > 0.3
    assert np.abs(frame.color - expected).max() < 1e-4


def test_pixels_within_rounding_are_not_certain():
    """A layer as thin as the distance of numbers at such places."""
    for width, status in ((2.0**-6, Status.CERTAIN), (2.0**-30, Status.AMBIGUOUS)):
        transfer = Transfer((0.4 - width, 0.4, 0.4 + width), (0.0, 1.0 / width, 0.0), WHITE)
        data = cube(Shape.HEXAHEDRON, lambda x: x[:, 0] - 2.0**20, 3, shift=2.0**20)
        assert (picture(data, transfer, shift=2.0**20).status == status).all()
