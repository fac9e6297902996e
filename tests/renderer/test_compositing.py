"""Light, lines and transparency in closed form."""

import numpy as np
import pytest

from elvis.renderer import Camera
from elvis.renderer.compositing import Coat, composite, lit
from elvis.renderer.layer import Layer
from elvis.renderer.palette import NOT_A_NUMBER, Palette
from elvis.renderer.scene import Light
from elvis.renderer.view import View

RED, GREEN, BLUE, WHITE = np.vstack([np.eye(3), np.ones(3)])


def layer_at(depths, normal=(0.0, 0.0, 1.0)):
    """A layer with these depths; infinite ones are misses."""
    layer = Layer.empty(len(depths))
    hit = np.isfinite(depths)
    layer.depth, layer.owner = np.asarray(depths, float), np.where(hit, 0, layer.owner)
    layer.normal = np.where(hit[:, None], normal, np.nan)
    return layer


def colored(layer, color):
    return np.tile(color, (len(layer.depth), 1))


def coat(depths, color, opacity=1.0, lines=()):
    layer = layer_at(depths)
    return Coat.of(layer, colored(layer, color), opacity, lines)


def test_the_nearest_hides_what_lies_behind_pixel_by_pixel():
    result = composite([coat([1, 3, np.inf, np.inf], RED), coat([2, 2, 2, np.inf], GREEN)], WHITE)
    assert np.array_equal(result, [RED, GREEN, GREEN, WHITE])


def test_opacity_in_depth_order_whatever_the_order_given():
    coats = [coat([3.0], RED), coat([1.0], BLUE, 0.25), coat([2.0], GREEN, 0.5)]
    expected = 0.25 * BLUE + 0.75 * (0.5 * GREEN + 0.5 * RED)
    for order in ([0, 1, 2], [2, 1, 0], [1, 2, 0]):
        assert np.allclose(composite([coats[k] for k in order], WHITE), expected, rtol=0, atol=1e-15)


def test_equal_depths_keep_the_order_given():
    assert np.array_equal(composite([coat([1.0], RED), coat([1.0], GREEN)], WHITE), [RED])


def test_background_of_each_pixel_shines_through():
    background = np.array([RED, GREEN])
    result = composite([coat([1.0, np.inf], BLUE, 0.5)], background)
    assert np.array_equal(result, [0.5 * BLUE + 0.5 * RED, GREEN])


def test_lines_are_opaque_over_the_surface_and_later_ones_on_top():
    coverage = np.array([0.0, 0.5, 1.0, 1.0])
    depths = [1.0, 1.0, 1.0, np.inf]
    result = composite([coat(depths, GREEN, 0.5, [(coverage, RED), (np.array([0, 0, 0.25, 1]), BLUE)])], WHITE)
    surface = 0.5 * GREEN + 0.5 * WHITE
    assert np.allclose(result, [surface, 0.5 * RED + 0.5 * surface, 0.25 * BLUE + 0.75 * RED, WHITE])


def test_what_is_not_a_number_has_its_own_colour():
    colors = Palette.named("viridis", 0.0, 1.0).colors(np.array([np.nan, 0.0]))
    result = composite([Coat.of(layer_at([1.0, 1.0]), colors)], WHITE)
    assert np.array_equal(result[0], NOT_A_NUMBER)
    assert np.array_equal(result[1], colors[1])


@pytest.mark.parametrize("degrees", [0.0, 30.0, 75.0])
def test_lambert_s_law(degrees):
    angle = np.deg2rad(degrees)
    view = View.through(Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), height=1.0), (1, 1))
    layer = layer_at([5.0], (np.sin(angle), 0.0, np.cos(angle)))

    def shade(*lights, ambient=0.2):
        return lit(view, layer, colored(layer, WHITE), lights, ambient)[0, 0]

    assert shade(Light(None, 0.5)) == pytest.approx(0.2 + 0.5 * np.cos(angle))
    assert shade(Light((3.0, 0.0, 0.0), 0.5)) == pytest.approx(0.2 + 0.5 * np.sin(angle))
    assert shade(Light((0.0, 0.0, -1.0), 0.5)) == pytest.approx(0.2)
    assert shade(Light(None, 0.1), Light((0.0, 0.0, 1.0), 0.2)) == pytest.approx(0.2 + 0.3 * np.cos(angle))
    assert shade(Light(None, 9.0), ambient=0.9) == 1.0


def test_headlight_shines_along_each_ray():
    view = View.through(Camera((0, 0, 2), (0, 0, 0), (0, 1, 0), fov=90.0), (3, 1))
    layer = layer_at([2.0, 2.0, 2.0])
    towards = view.rays(np.arange(3), np.zeros(3))[1]
    expected = 0.5 * 2.0 / np.linalg.norm(2.0 * towards, axis=1)
    assert np.allclose(lit(view, layer, colored(layer, WHITE), [Light(None, 0.5)], 0.0)[:, 0], expected)
