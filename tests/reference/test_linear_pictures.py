"""Linear pictures next to exact ones, against what linear fields on straight elements are, and against comparisons."""

import sys

import numpy as np
import pytest

from elvis import Dataset, Shape
from elvis.core.errors import ElvisError
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.reference.linear_pictures import LinearPictures
from elvis.reference.picture import render
from elvis.reference.study import compare_scene
from elvis.scene import CutSurface, Faces, Plane, Scene

OBJECTS = (Faces(("all",)), CutSurface(Plane((0.5, 0.5, 0.4), (0.1, 0.2, 1.0))))
SCENE = Scene("u", objects=OBJECTS[1:], camera="iso", size=(40, 30))


def of(mesh, function, order):
    return Dataset(mesh, (approximated(Dataset(mesh), "u", function, order),))


def test_linear_fields_on_straight_elements_are_exact():
    dataset = of(grid(Shape.TETRAHEDRON, 2), lambda x: x @ np.array([1.0, 2.0, -0.5]), 2)
    frame = render(dataset, SCENE)
    record, simplices = LinearPictures(dataset).draw(frame, 0)
    assert simplices == 2 * 2 * 2 * 6
    both = frame.seen & record.seen
    assert (frame.seen != record.seen).sum() <= 2
    assert np.abs(record.color - frame.rgb / 255)[both].max() < 1 / 255


def test_it_is_the_picture_of_comparisons():
    dataset = of(curved(grid(Shape.HEXAHEDRON, 2), ripple(0.05), n=3), lambda x: np.sin(4 * x[:, 0]) + x[:, 1] ** 2, 4)
    frame = render(dataset, SCENE)
    study = compare_scene(dataset, SCENE, [1], draw=lambda *_, **__: frame, validation_size=0)
    record, simplices = LinearPictures(dataset).draw(frame, 1)
    assert np.array_equal(record.color, study.rivals[0].record.color)
    assert simplices == study.rivals[0].counts["simplices"]
    assert np.abs(record.field - study.exact.field)[record.seen & study.exact.seen].max() > 0.02


def test_missing_or_mismatched_data_are_reported(monkeypatch):
    dataset = of(grid(Shape.TETRAHEDRON, 1), lambda x: x[:, 0], 2)
    frame = render(dataset, SCENE)
    with pytest.raises(ElvisError, match=r"need .* GB, more than there are"):
        LinearPictures(dataset).draw(frame, 3, limit=1000)
    monkeypatch.setitem(sys.modules, "embreex", None)
    monkeypatch.setitem(sys.modules, "embreex.rtcore_scene", None)
    with pytest.raises(ElvisError, match=r"a comparison needs embreex, .*elvis-viz\[compare\]"):
        LinearPictures(dataset).draw(frame, 0)
