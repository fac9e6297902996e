"""Meshes without fields: their elements in one colour, with their borders; and pictures that nobody has named."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import CutSurface, Faces, Isosurface, Plane, SceneError, Style, render, write
from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.testing import grid, one_element
from elvis.plugins.command.command import main
from elvis.scene.model.bare_mesh import COLOR, REMARK

SMALL = {"device": "vulkan", "size": (60, 45)}


@pytest.mark.sampled(least=2, free=("shape",))
@pytest.mark.parametrize(
    "shape", [Shape.TRIANGLE, Shape.QUADRILATERAL, Shape.TETRAHEDRON, Shape.PRISM, Shape.HEXAHEDRON]
)
def test_elements_have_one_colour_and_their_borders(renderer, shape):
    renderer("vulkan")
    frame = render(Dataset(grid(shape, 2)), **SMALL)
    assert frame.stats["remarks"] == [REMARK]
    assert frame.status.any()
    assert frame.legends == ()
    (item,) = frame.scene.every_object
    assert isinstance(item, Faces if shape.dimension == 3 else CutSurface)
    assert item.style.color == COLOR
    assert item.style.mesh_lines is not None
    seen = frame.color[frame.status > 0]
    assert len(np.unique(np.round(seen, 3), axis=0)) > 3
    plain = render(
        Dataset(grid(shape, 2)), objects=(replace(item, style=replace(item.style, mesh_lines=None)),), **SMALL
    )
    assert not np.array_equal(plain.color, frame.color)


def test_surfaces_in_space_and_lines(renderer):
    renderer("vulkan")
    for mesh in (one_element(Shape.QUADRILATERAL, 3), one_element(Shape.SEGMENT, 1)):
        frame = render(Dataset(mesh), **SMALL)
        assert frame.status.any()
        assert REMARK in frame.stats["remarks"]


def test_the_scene_takes_precedence(renderer):
    renderer("vulkan")
    dataset, cut = Dataset(grid(Shape.HEXAHEDRON, 2)), Plane((0.5, 0.5, 0.4), (0.1, 0.2, 1.0))
    red = Style(color=(1.0, 0.0, 0.0))
    frame = render(dataset, objects=(CutSurface(cut, red), Faces(style=Style("x"))), camera="iso", **SMALL)
    styles = [item.style for item in frame.scene.every_object]
    assert styles == [red, Style("x")]
    assert render(dataset, field="x", plane=cut, **SMALL).stats["remarks"] == []
    with pytest.raises(
        SceneError, match="--isosurface: the data contain a mesh but no field: also pass the field file"
    ):
        render(dataset, objects=(Isosurface((0.5,)),), **SMALL)
    levels = render(dataset, objects=(Isosurface((0.5,), "x"),), camera="iso", **SMALL)
    assert levels.status.any()


def test_an_unnamed_picture(tmp_path, monkeypatch, capsys):
    """It takes a free name in the current folder, and says which."""
    folder = tmp_path / "case"
    folder.mkdir()
    write(Dataset(grid(Shape.TRIANGLE, 2)), folder / "mesh.xml")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mesh-2.png").write_text("mine")
    arguments = ["render", str(folder / "mesh.xml"), "--device", "reference", "--size", "40x30"]
    told = []
    for more in ((), (), ("--overwrite",)):
        with pytest.raises(SystemExit) as ended:
            main([*arguments, *more])
        assert not ended.value.code
        out, err = capsys.readouterr()
        assert REMARK in err
        told.append(out)
    assert told == ["wrote mesh.png\n", "wrote mesh-3.png\n", "wrote mesh.png\n"]
    assert (tmp_path / "mesh-2.png").read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["case", "mesh-2.png", "mesh-3.png", "mesh.png"]
