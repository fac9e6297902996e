"""Linear pictures next to exact ones, against what linear fields on straight elements are, and against comparisons."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, Shape
from elvis.core.base.errors import ElvisError
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.reference.baseline import linear_drawing
from elvis.reference.composing import record
from elvis.reference.linear_pictures import LinearPictures
from elvis.reference.picture import render
from elvis.reference.study import compare_scene
from elvis.scene import (
    Clip,
    Contours,
    CutSurface,
    Faces,
    MeshLines,
    Plane,
    Scene,
    Sphere,
    Style,
    Transfer,
    VolumeRendering,
)
from elvis.scene.record.frame import whole

OBJECTS = (Faces(("all",)), CutSurface(Plane((0.5, 0.5, 0.4), (0.1, 0.2, 1.0))))
SCENE = Scene("u", objects=OBJECTS[1:], camera="iso", size=(40, 30))


def of(mesh, function, order):
    return Dataset(mesh, (approximated(Dataset(mesh), "u", function, order),))


def test_linear_fields_on_straight_elements_are_exact():
    dataset = of(grid(Shape.TETRAHEDRON, 2), lambda x: x @ np.array([1.0, 2.0, -0.5]), 2)
    frame = render(dataset, SCENE)
    image, simplices = LinearPictures(dataset).draw(frame, 0)
    assert simplices == 2 * 2 * 2 * 6
    difference = np.abs(image.astype(int) - frame.rgb).max(axis=2)
    assert (difference > 1).sum() <= 2


def test_it_is_the_picture_of_comparisons():
    dataset = of(curved(grid(Shape.HEXAHEDRON, 2), ripple(0.05), n=3), lambda x: np.sin(4 * x[:, 0]) + x[:, 1] ** 2, 4)
    frame = render(dataset, SCENE)
    study = compare_scene(dataset, SCENE, [1], draw=lambda *_, **__: frame, validation_size=0)
    image, simplices = LinearPictures(dataset).draw(frame, 1)
    record = study.rivals[0].record
    assert np.array_equal(image, whole(record.color))
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


def test_pictures_in_strips_are_those_in_one_piece(monkeypatch):
    """Lines, surfaces one behind the other, volumes and clips."""
    dataset = of(grid(Shape.HEXAHEDRON, 2), lambda x: x[:, 0] + x[:, 1] * x[:, 2], 2)
    style = Style(opacity=0.5, contours=Contours(count=5, width=3.0), mesh_lines=MeshLines(2.0))
    volume = VolumeRendering(Transfer((0.2, 1.5), (0.5, 2.0)))
    clips = Clip(Plane((0.8, 0, 0), (-1, 0, 0))), Clip(Sphere((0, 0, 1), 0.4))
    objects = Faces(("all",), style), *OBJECTS[1:], volume
    scene = replace(SCENE, objects=objects, clip=clips, size=(30, 41))
    frame = render(dataset, scene)
    image, _ = LinearPictures(dataset).draw(frame, 1)
    sizes = []
    monkeypatch.setattr(linear_drawing, "_HITS_AT_ONCE", 1 << 12)
    monkeypatch.setattr(linear_drawing, "record", lambda *given: sizes.append(given[2].height) or record(*given))
    strips, _ = LinearPictures(dataset).draw(frame, 1)
    assert len(sizes) > 4
    assert max(sizes) < 9
    assert np.array_equal(strips, image)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 200
