"""Large pictures: made, compressed and written some rows at a time, the same as small ones."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from elvis import Camera, Contours, Faces, Plane, Scene, Style
from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.scene.cameras import fitting
from elvis.scene.figure import page, saving
from elvis.scene.figure.picture import picture
from elvis.scene.figure.png import write_png
from elvis.scene.record import frame as frames


@pytest.fixture(scope="module")
def frame(draw, linear):
    """A cube with axes, a bar, contours, and a title that is longer than the image."""
    title = "a title that is a good deal longer than the image is wide, and then some"
    faces = Faces(style=Style(contours=Contours(count=5)))
    camera = Camera((3.2, 2.9, 2.5), (0.7, 0.9, 1.0), height=2.2)
    cube = linear(grid(Shape.HEXAHEDRON, 2))
    return draw(cube, objects=(faces,), camera=camera, size=(240, 200), title=title)


def noisy(height, width):
    """Rows for which different filters are best."""
    random, x = np.random.default_rng(3), np.arange(width)
    rows = np.stack(
        [random.integers(0, 256, (height, width)), np.tile(3 * x, (height, 1)), np.full((height, width), 7)], 2
    )
    rows[::3] = random.integers(0, 256, (1, width, 3))
    rows[2::7] = 250
    return rows.astype(np.uint8)


@pytest.mark.parametrize("step", [1, 4, 100])
@pytest.mark.parametrize("width", [1, 50])
def test_png_files_have_the_pixels(tmp_path, step, width):
    pixels = noisy(61, width)
    with (tmp_path / "a.png").open("wb") as stream:
        write_png(stream, width, 61, (pixels[first : first + step] for first in range(0, 61, step)), "a test")
    with Image.open(tmp_path / "a.png") as image:
        image.load()
        assert (image.mode, image.size) == ("RGB", (width, 61))
        assert image.text == {"Software": "a test"}
        assert np.array_equal(np.asarray(image), pixels)


@pytest.mark.sampled
@pytest.mark.parametrize("plain", [False, True])
@pytest.mark.parametrize("pixels", [1, 1000, 1 << 20])
def test_large_pictures_have_the_pixels_of_small_ones(frame, tmp_path, monkeypatch, plain, pixels):
    monkeypatch.setattr(saving, "LARGE", 0)
    monkeypatch.setattr(page, "AT_ONCE", pixels)
    frame.save(tmp_path / "a.png", plain=plain)
    with Image.open(tmp_path / "a.png") as image:
        assert np.array_equal(np.asarray(image), np.asarray(picture(frame, plain=plain)))


def test_compression_is_as_good_as_that_of_small_ones(frame, tmp_path, monkeypatch):
    frame.save(tmp_path / "small.png")
    monkeypatch.setattr(saving, "LARGE", 0)
    frame.save(tmp_path / "large.png")
    assert (tmp_path / "large.png").stat().st_size < 1.5 * (tmp_path / "small.png").stat().st_size


def test_large_pictures_are_saved_in_little_memory(frame, tmp_path, monkeypatch):
    """Sixteen million pixels, of which the image alone is 48 MB."""
    monkeypatch.setattr(saving, "LARGE", 1 << 20)
    monkeypatch.setattr("elvis.scene.figure.picture.picture", None)
    color = np.broadcast_to(np.uint8(200), (4000, 4000, 3))
    status = np.broadcast_to(np.uint8(1), (4000, 4000))
    view = replace(frame.view, width=4000, height=4000)
    large = replace(frame, view=view, status=status, drawing=replace(frame.drawing, color=color))
    tracemalloc.start()
    try:
        large.save(tmp_path / "a.png", plain=True)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 40e6
    assert large.counts()["certain"] == 16_000_000


def test_positions_match_those_of_all_rows(frame, draw, linear, monkeypatch):
    cut = draw(linear(grid(Shape.HEXAHEDRON, 2)), plane=Plane((0.5, 0.5, 0.4), (0.1, 0.2, 1.0)), size=(30, 20))
    for one in (frame, cut):
        whole = one.position
        monkeypatch.setattr(frames, "_AT_ONCE", 100)
        again = replace(one).position
        assert np.array_equal(whole, again, equal_nan=True)
        assert np.isfinite(whole).any()


@pytest.mark.parametrize(
    ("size", "most"), [((20000, 20000), 1 << 21), ((900, 700), 225 * 175), ((32768, 200), 8192 * 160)]
)
def test_previews_are_small(size, most):
    """Of the same shape as the picture, so that it fits."""
    glances = []

    def glance(scene):
        glances.append(scene.size)
        return np.ones(scene.size[::-1], bool)

    boxes = [np.array([[0.0, 0.0, 0.0, 1.0, 1.0, 1.0]])]
    fitted = fitting.automatic(Scene("u", objects=(Faces(),), camera="iso", size=size), boxes, glance)
    assert fitted.size == size
    assert all(width * height <= 1.01 * most for width, height in glances)
