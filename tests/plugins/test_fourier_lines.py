"""Lines with Fourier directions: walls along z, blocks along y and z; against the formats' own evaluation."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, Faces, Field, Plane, Scene, SceneError, read, render
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Block, Homogeneous
from elvis.core.polynomials.bases import Basis
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid
from elvis.plugins.faces import faces_of
from elvis.plugins.runtime.serving import volume_of
from elvis.plugins.testing import check_volume
from elvis.renderer.asking.completing import completed

IDS = ((0, 0), (2, 1), (1, 2), (3, 3))


def lines(bases, lengths, ids=IDS):
    """Random fields u on three lines of the x axis, of degree 3, with modes along z or along y and z."""
    mesh, rng = grid(Shape.SEGMENT, 3), np.random.default_rng(5)
    (plain,) = approximated(Dataset(mesh), "u", lambda x: x[:, 0] ** 3, 4).blocks
    y, z = zip(*ids, strict=True)
    homogeneous = Homogeneous(bases, lengths, z, y if len(lengths) == 2 else ())
    values = rng.normal(size=(len(plain.element_ids), len(ids) * plain.coefficients.shape[1]))
    block = Block(replace(plain.expansion, homogeneous=homogeneous), plain.element_ids, values)
    return Dataset(mesh, (Field("u", (block,)),))


def same(dataset, frame, text):
    """Every pixel has the value that the formats give at its element and reference point."""
    expression, seen = Expression.of(dataset, text), frame.seen
    truth = Evaluator(dataset, [expression]).at(expression, frame.element[seen], frame.reference[seen])
    assert seen.sum() > 300
    assert np.abs(frame.field[seen] - truth).max() < 1e-11 * np.ptp(truth)


def test_fourier_blocks_are_cut_like_solids(renderer):
    dataset = lines((Basis.FOURIER, Basis.FOURIER), (1.5, 2.0))
    drawing = renderer("vulkan")
    for text in ("u", "u*y + d(u,z)"):
        volume = volume_of(dataset, [text])
        if text == "u":
            check_volume(volume, drawing)
        drawing.show(volume, dataset)
        frame = drawing.render(Scene(text, plane=Plane((0.5, 0.7, 0.9), (0.3, 1.0, 0.5)), size=(60, 45)))
        assert frame.counts()["failed"] == 0
        same(dataset, frame, text)
    points = np.random.default_rng(1).uniform(0, 1, (300, 3)) * [1.0, 1.5, 2.0]
    drawing.show(volume_of(dataset, ["u"]), dataset)
    expression = Expression.of(dataset, "u")
    found = drawing.probe(points)
    truth = Evaluator(dataset, [expression]).at(expression, found.element, found.reference)
    assert (found.status == 1).mean() > 0.99
    assert np.abs(found.reference[:, 1:] - (2 * points[:, 1:] / [1.5, 2.0] - 1)).max() < 1e-12
    assert np.abs(found.field - truth).max() < 1e-11 * np.ptp(truth)


def test_blocks_have_six_faces_each():
    dataset = lines((Basis.FOURIER, Basis.FOURIER), (1.5, 2.0))
    faces = faces_of(dataset, volume_of(dataset, ["u"]))
    assert [sum(map(len, faces.select([word]))) for word in ("all", "inner")] == [14, 4]


@pytest.mark.parametrize("basis", [Basis.FOURIER, Basis.FOURIER_HALF_MODE_RE])
def test_walls_show_themselves(renderer, basis):
    dataset = lines((basis,), (2.0,), IDS if basis is Basis.FOURIER else IDS[:1])
    scene = completed(dataset, Scene("u", camera="iso", size=(60, 45)))
    assert scene.objects == (Faces(),)
    drawing = renderer("vulkan")
    drawing.load(dataset, "u")
    same(dataset, drawing.render(scene), "u")
    with pytest.raises(SceneError, match="drawn as they are"):
        completed(dataset, Scene("u", plane=Plane((0, 0, 0), (0, 0, 1))))


def test_the_wall_of_a_wing_matches_the_solver(nektar, renderer):
    folder = nektar / "naca_h1d_line"
    dataset = read(*(path for path in folder.iterdir() if path.suffix in (".xml", ".fld")))
    drawing = renderer("vulkan")
    drawing.load(dataset, "p")
    frame = drawing.render(completed(dataset, Scene("p", camera="iso", size=(120, 60))))
    same(dataset, frame, "p")
    assert frame.counts()["failed"] == 0


def test_lines_have_no_volume():
    mesh = grid(Shape.SEGMENT, 2)
    dataset = Dataset(mesh, (approximated(Dataset(mesh), "u", lambda x: x[:, 0], 2),))
    with pytest.raises(ElvisError, match=r"2D or 3D data, or the same Fourier directions .*, found DIM=1 SPACE=1"):
        volume_of(dataset, ["u"])
    assert render(dataset, Scene("u", size=(40, 30))).seen.any()
