"""Pictures of expressions that name data on another mesh, against closed forms: values, what is undefined, statuses."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import (
    Clip,
    Contours,
    CutSurface,
    Faces,
    Implicit,
    Isosurface,
    Plane,
    Sphere,
    Status,
    Style,
    Transfer,
    VolumeRendering,
    render,
    write,
)
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, ripple, with_field
from elvis.scene.model.errors import SceneError
from elvis.scene.model.files import read_scene, write_scene
from elvis.scene.model.tables import input_files

CUT = CutSurface(Plane((0.5, 0.5, 0.41), (0.1, 0.2, 1.0)))
#: -z, where both have cubic
ZERO = "2 * u - ref:(u + z) - u + d(u, x) - ref:d(u, x)"
SURFACES = {
    "plane": (CUT,),
    "faces": (Faces(),),
    "sphere": (CutSurface(Sphere((0.5, 0.5, 0.5), 0.4)),),
    "isosurface": (Isosurface((0.3,), quantity="x*y", style=Style(quantity=ZERO)),),
}


def cubic(p):
    return p[:, 0] ** 2 + p[:, 1] ** 2 * p[:, 2] - p[:, 0] * p[:, 1]


def half(mesh):
    """The mesh, pressed into x < 0.5."""
    return replace(mesh, vertices=mesh.vertices * [0.5, 1.0, 1.0])


@pytest.fixture(scope="module")
def own():
    return with_field(grid(Shape.TETRAHEDRON, 2), cubic, 4)


@pytest.fixture(scope="module")
def jumping():
    """0 where x < 1/4, 1 beyond, on two times one elements that fill x < 1/2."""
    return with_field(half(grid(Shape.HEXAHEDRON, 2)), lambda p: (p[:, 0] > 0.25) * 1.0, 4)


@pytest.mark.parametrize("name", SURFACES)
def test_one_function_on_two_meshes_has_zero_difference(draw, own, name):
    """Nor does its derivative; outer faces of both meshes are one, and yet certain."""
    both = own.with_others(ref=with_field(grid(Shape.HEXAHEDRON, 3), cubic, 4))
    assert not both.shared
    frame = draw(both, field=ZERO, objects=SURFACES[name], camera="iso", size=(60, 40), domain_outline=False)
    assert np.abs(frame.field + frame.position[..., 2])[frame.seen].max() <= 1e-11
    counts = frame.counts()
    assert counts["certain"] > 300
    assert counts["ambiguous"] <= 0.02 * counts["certain"]


@pytest.mark.parametrize("name", ["plane", "sphere"])
def test_points_outside_the_other_mesh_have_no_value(draw, own, jumping, name):
    frame = draw(
        own.with_others(ref=jumping), field="ref:u + 0 * u", objects=SURFACES[name], camera="iso", size=(60, 40)
    )
    x = frame.position[..., 0]
    beyond, within = frame.seen & (x > 0.5 + 1e-9), frame.seen & (x < 0.5 - 1e-9)
    assert np.isnan(frame.field[beyond]).all()
    assert frame.counts()["not_a_number"] == beyond.sum() > 100
    certain = within & (frame.status == Status.CERTAIN)
    assert np.abs(frame.field - (x > 0.25))[certain].max() < 1e-12
    assert certain.sum() > 0.9 * within.sum()


@pytest.mark.parametrize("kind", ["plane", "faces"])
def test_borders_of_the_other_mesh_are_ambiguous(draw, own, jumping, kind):
    """Every third column of pixels lies on the border at x = 1/4, where the other field jumps."""
    cut = (CutSurface(Plane((0.5, 0.5, 0.4), (0.0, 0.0, 1.0))),) if kind == "plane" else (Faces(),)
    frame = draw(own.with_others(ref=jumping), field="u - ref:u", objects=cut, camera="-z", size=(61, 61), zoom=1.0)
    x = frame.position[..., 0]
    border = frame.seen & (np.abs(x - 0.25) < 1e-11)
    if border.any():
        assert (frame.status[border] == Status.AMBIGUOUS).all()
    clear = frame.seen & (np.abs(x - 0.25) > 1e-6) & (x < 0.499) & (frame.status == Status.CERTAIN)
    truth = cubic(frame.position.reshape(-1, 3)).reshape(x.shape) - (x > 0.25)
    assert np.abs(frame.field - truth)[clear].max() < 1e-11


def test_on_one_mesh_differences_are_drawn_by_coefficients(draw, own):
    """So they have isosurfaces and contours: u - ref:u = x - 0.4 is 0 there."""
    shifted = with_field(own.mesh, lambda p: cubic(p) - p[:, 0] + 0.4, 4)
    both = own.with_others(ref=shifted)
    assert list(both.shared) == ["ref"]
    assert list(both) == ["u"]
    level = Isosurface((0.0,), style=Style(contours=Contours(count=3, quantity="y - ref:u + u")))
    frame = draw(both, field="u - ref:u", objects=(level,), camera="iso", size=(60, 40))
    assert np.abs(frame.position[..., 0] - 0.4)[frame.seen].max() < 1e-10
    assert frame.counts()["certain"] > 300


def test_unsupported_drawing_is_rejected(draw, own, jumping):
    both, text = own.with_others(ref=jumping), "u - ref:u"
    scenes = {
        "a quantity of one mesh for an isosurface, which this one colours": {"objects": (Isosurface((0.1,)),)},
        "a quantity of one mesh for a volume, or planes": {
            "objects": (VolumeRendering(Transfer((0.0, 1.0), (0.0, 1.0))),)
        },
        "contours of a quantity of one mesh, or steps of colour, --bar bands=10": {
            "objects": (Faces(style=Style(contours=Contours(count=3))),)
        },
        "a surface of one mesh": {"objects": (Faces(),), "clip": (Clip(Implicit(text)),)},
    }
    for instead, scene in scenes.items():
        words = rf"'u - ref:u' names data on another mesh \(ref\).*: expected {instead}"
        with pytest.raises(SceneError, match=words):
            draw(both, field=text, size=(8, 8), **scene)


@pytest.mark.sampled
@pytest.mark.parametrize("first", [Shape.TRIANGLE, Shape.QUADRILATERAL])
@pytest.mark.parametrize("second", [Shape.TRIANGLE, Shape.QUADRILATERAL])
def test_curved_plane_elements_of_both_meshes_are_located(draw, first, second):
    """x - x^2 on other shapes and orders; beyond the border of the second, curved otherwise, there is no value."""
    own = with_field(curved(grid(first, 2), ripple(0.05), 3), lambda p: p[:, 0], 4)
    theirs = with_field(curved(grid(second, 3), ripple(-0.03), 4), lambda p: p[:, 0], 7)
    frame = draw(own.with_others(ref=theirs), field="u - ref:u^2", objects=(Faces(),), size=(90, 70))
    held = frame.seen & np.isfinite(frame.field)
    x = frame.position[..., 0]
    assert np.abs(frame.field - x + x**2)[held].max() < 1e-11
    assert held.sum() > 2000
    assert 20 < frame.counts()["not_a_number"] == (frame.seen & ~held).sum() < 500
    assert frame.counts()["ambiguous"] <= 0.02 * held.sum()


@pytest.mark.parametrize("name", ["plane", "faces", "isosurface"])
def test_inverted_elements_of_the_other_have_values(draw, own, name):
    """A mirrored mesh has negative Jacobians everywhere."""
    mesh = grid(Shape.PRISM, 2)
    mirrored = replace(mesh, vertices=mesh.vertices * [-1.0, 1.0, 1.0] + [1.0, 0.0, 0.0])
    both = own.with_others(ref=with_field(mirrored, cubic, 5))
    frame = draw(both, field=ZERO, objects=SURFACES[name], camera="iso", size=(40, 30))
    assert np.abs(frame.field + frame.position[..., 2])[frame.seen].max() <= 1e-11
    assert frame.counts()["failed"] == 0


def test_files_of_other_data_in_scenes_and_keywords(own, jumping, tmp_path):
    """Names of files in scenes are relative to them."""
    ours, theirs = ([tmp_path / f"{name}.xml", tmp_path / f"{name}.fld"] for name in ("own", "other"))
    write(own, *ours)
    write(jumping, *theirs)
    frame = render(*ours, field="ref:u", other={"ref": theirs}, faces="all", size=(20, 20), camera="iso")
    assert frame.counts()["not_a_number"] > 0
    assert frame.scene.others == (f"ref={','.join(map(str, theirs))}",)
    write_scene(frame.scene, tmp_path / "s.toml")
    assert f'others = ["ref={",".join(path.name for path in theirs)}"]' in (tmp_path / "s.toml").read_text()
    assert set(theirs) <= set(input_files(read_scene(tmp_path / "s.toml")))
    with pytest.raises(Exception, match="--other: expected NAME=FILE,FILE, such as"):
        render(*ours, field="u", other="b.fld", faces="all")
