"""Light, lines and transparency in closed form."""

import numpy as np
import pytest

from elvis import Camera
from elvis.renderer.frame.painting import FragmentShader, Material
from elvis.renderer.passes.lines.lines import UNITS, Marks
from elvis.renderer.raster.compositing import FragmentLists
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.scene import Light
from elvis.scene.cameras.view import View
from elvis.scene.record.palette import NOT_A_NUMBER, Palette

RED, GREEN, BLUE, WHITE = np.vstack([np.eye(3), np.ones(3)])


def hits_at(depths, normal=(0.0, 0.0, 1.0)):
    """A hit buffer with these depths; infinite ones are misses."""
    hits = HitBuffer.empty(len(depths))
    hit = np.isfinite(depths)
    hits.depth, hits.owner = np.asarray(depths, float), np.where(hit, 0, hits.owner)
    hits.normal = np.where(hit[:, None], normal, np.nan)
    return hits


def fragment(depths, color, opacity=1.0):
    """A fragment of one colour."""
    alpha = np.where(np.isfinite(depths), opacity, 0.0)
    return np.asarray(depths, float), alpha[:, None] * color, alpha


@pytest.fixture(params=["vulkan", "cpu"], scope="module")
def shader(request, renderer):
    return FragmentShader(renderer(request.param).device)


@pytest.fixture
def composite(shader):
    """(n, 3) colours of fragments over a background."""
    return lambda fragments, behind: (
        FragmentLists.of(shader._device, len(fragments[0][0]), fragments, tuple(behind)).compose().colors()
    )


@pytest.fixture
def fragments_of(shader):
    """(n, 3) colours times alpha, and (n,) alphas, of a hit buffer that is painted as the last fragment of two."""

    def paint(view, hits, material):
        fragments = FragmentLists(shader._device, view.count, 2, tuple(WHITE))
        shader.add(view, hits, material, fragments, 1)
        made = shader._device.read(fragments.buffers["fragment_colors"], np.float64).reshape(2, view.count, 4)[1]
        depths = shader._device.read(fragments.buffers["fragment_depths"], np.float64).reshape(2, view.count)[1]
        assert np.array_equal(depths, hits.depth)
        return made[:, :3], made[:, 3]

    return paint


def test_the_nearest_surface_hides_others_at_each_pixel(composite):
    result = composite([fragment([1, 3, np.inf, np.inf], RED), fragment([2, 2, 2, np.inf], GREEN)], WHITE)
    assert np.array_equal(result, [RED, GREEN, GREEN, WHITE])


def test_opacity_is_composited_in_depth_order(composite):
    fragments = [fragment([3.0], RED), fragment([1.0], BLUE, 0.25), fragment([2.0], GREEN, 0.5)]
    expected = 0.25 * BLUE + 0.75 * (0.5 * GREEN + 0.5 * RED)
    for order in ([0, 1, 2], [2, 1, 0], [1, 2, 0]):
        assert np.allclose(composite([fragments[k] for k in order], WHITE), expected, rtol=0, atol=1e-15)


def test_equal_depths_keep_the_order_given(composite):
    assert np.array_equal(composite([fragment([1.0], RED), fragment([1.0], GREEN)], WHITE), [RED])


def test_random_fragments_are_composited_like_a_direct_computation(composite):
    """Twelve fragments of 500 pixels, some of them not there, some at one depth, some opaque."""
    rng = np.random.default_rng(5)
    depths = rng.choice([1.0, 2.0, 3.5, 7.0, np.inf], size=(12, 500))
    alphas = np.where(np.isfinite(depths), rng.choice([0.2, 0.7, 1.0], size=depths.shape), 0.0)
    colors = rng.random((12, 500, 3)) * alphas[..., None]
    expected, through = np.zeros((500, 3)), np.ones(500)
    order = np.argsort(depths, axis=0, kind="stable")
    for rank in order:
        own = rank, np.arange(500)
        expected += through[:, None] * colors[own]
        through *= 1 - alphas[own]
    result = composite(list(zip(depths, colors, alphas, strict=True)), BLUE)
    assert np.abs(result - expected - through[:, None] * BLUE).max() < 1e-14


def sight(count, **camera):
    """A row of pixels, seen from above."""
    return View.through(Camera((0, 0, 2), (0, 0, 0), (0, 1, 0), **(camera or {"height": 1.0})), (count, 1))


def marks(shader, distances, width):
    """Lines as far from pixels as that."""
    held = shader._device.buffer((np.asarray(distances) * UNITS).astype(np.uint32))
    return Marks(shader._device, held, width, np.zeros(len(distances), np.uint32))


def test_lines_are_opaque_over_the_surface_and_later_ones_on_top(shader, fragments_of):
    """Lines of a pixel's width cover 1 - their distance of it."""
    hits = hits_at([1.0, 1.0, 1.0, np.inf])
    mesh, contours = marks(shader, [1.0, 0.5, 0.0, 0.0], 1.0), marks(shader, [1.0, 1.0, 0.75, 0.0], 1.0)
    assert np.array_equal(mesh.coverage, [0.0, 0.5, 1.0, 1.0])
    material = Material(tuple(GREEN), 0.5, mesh=(mesh, tuple(RED)), contours=(contours, tuple(BLUE)))
    surface = 0.5 * GREEN + 0.5 * WHITE
    expected = [surface, 0.5 * RED + 0.5 * surface, 0.25 * BLUE + 0.75 * RED, WHITE]
    assert np.allclose(shader.over(sight(4), hits, material, WHITE, whole=False), expected)
    color, alpha = fragments_of(sight(4), hits, material)
    assert np.allclose(color + (1 - alpha)[:, None] * WHITE, expected)
    assert np.array_equal(
        shader.over(sight(4), hits, material, WHITE, whole=True), np.floor(255 * np.array(expected) + 0.5)
    )


def test_colours_match_the_colour_map(shader):
    """To the last bit; what is not a finite number has its own."""
    palette = Palette.of_name("viridis", -1.0, 2.0)
    values = np.concatenate([np.linspace(-1.5, 2.5, 40), [np.nan, np.inf, -np.inf]])
    hits = hits_at(np.ones(len(values))).showing(values)
    painted = shader.over(sight(len(values)), hits, Material(palette), WHITE, whole=False)
    assert np.array_equal(painted, palette.colors(values))
    assert np.array_equal(painted[-3:], np.tile(NOT_A_NUMBER, (3, 1)))


@pytest.mark.parametrize("degrees", [0.0, 30.0, 75.0])
def test_lambert_s_law(fragments_of, degrees):
    angle = np.deg2rad(degrees)
    hits = hits_at([5.0], (np.sin(angle), 0.0, np.cos(angle)))

    def shade(*lights, ambient=0.2):
        return fragments_of(sight(1), hits, Material(tuple(WHITE), 1.0, lights, ambient))[0][0, 0]

    assert shade(Light(None, 0.5)) == pytest.approx(0.2 + 0.5 * np.cos(angle))
    assert shade(Light((3.0, 0.0, 0.0), 0.5)) == pytest.approx(0.2 + 0.5 * np.sin(angle))
    assert shade(Light((0.0, 0.0, -1.0), 0.5)) == pytest.approx(0.2)
    assert shade(Light(None, 0.1), Light((0.0, 0.0, 1.0), 0.2)) == pytest.approx(0.2 + 0.3 * np.cos(angle))
    assert shade(Light(None, 9.0), ambient=0.9) == 1.0
    assert shade(ambient=1.0) == 1.0


def test_headlight_shines_along_each_ray(fragments_of):
    view, hits = sight(3, fov=90.0), hits_at([2.0, 2.0, 2.0])
    towards = view.rays(np.arange(3), np.zeros(3))[1]
    expected = 0.5 * 2.0 / np.linalg.norm(2.0 * towards, axis=1)
    material = Material(tuple(WHITE), 1.0, [Light(None, 0.5)], 0.0)
    assert np.allclose(fragments_of(view, hits, material)[0][:, 0], expected)
