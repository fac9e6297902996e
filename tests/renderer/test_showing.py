"""What a frame shows of itself to people and programs."""

from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from elvis import Dataset, Shape, render
from elvis.core.testing import approximated, grid


@pytest.fixture(scope="module")
def dataset():
    bare = Dataset(grid(Shape.QUADRILATERAL, 2))
    return Dataset(bare.mesh, (approximated(bare, "u", lambda x: x[:, 0], modes=3),), remarks=("made up",))


def test_the_image_is_that_of_a_plain_picture(dataset, tmp_path):
    frame = render(dataset, size=(40, 30))
    assert frame.image.dtype == np.uint8
    assert frame.image.shape == (30, 40, 3)
    frame.save(tmp_path / "plain.png", plain=True)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "plain.png").convert("RGB")), frame.image)


def test_a_clear_background_is_a_fourth_number(dataset):
    frame = render(dataset, size=(40, 20), background=(1.0, 1.0, 1.0, 0.0))
    assert frame.image.shape == (20, 40, 4)
    assert set(np.unique(frame.image[..., 3])) == {0, 255}


def test_a_notebook_shows_a_picture_and_a_line(dataset):
    frame = render(dataset, size=(40, 30))
    assert Image.open(BytesIO(frame._repr_png_())).width > 40
    assert repr(frame).startswith("<Frame 40 x 30 of u: pixels ")
    assert frame.remarks[0] == "made up"


def test_showing_opens_the_page_in_a_viewer(dataset, monkeypatch):
    shown = []
    monkeypatch.setattr(Image.Image, "show", lambda image, title=None: shown.append((image.width, title)))
    render(dataset, size=(40, 30)).show()
    assert shown[0][0] > 40
    assert shown[0][1] == "u"
