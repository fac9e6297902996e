"""Runtime plugins that describe their elements in NumPy: the reference draws them too, and their faces are made."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from elvis import CutSurface, Faces, Isosurface, Plane, Scene, Sphere, Status
from elvis.core.base.errors import ElvisError
from elvis.core.mapping.inverse import Status as Inversion
from elvis.core.mapping.margins import drawn_in
from elvis.core.quantities import Expression
from elvis.core.shapes import Shape
from elvis.core.testing import scattered
from elvis.plugins.faces import faces_of
from elvis.plugins.fourier import FourierBox, write_box
from elvis.plugins.nurbs import Nurbs
from elvis.plugins.runtime.host.evaluation import (
    HostEvaluation,
    evaluate_expression,
    host_evaluations,
    numerical_derivatives,
)
from elvis.plugins.runtime.host.patch import HostPatch
from elvis.plugins.runtime.host.quality import host_quality
from elvis.plugins.runtime.opening import PluginData
from elvis.plugins.runtime.serving import names_of, volume_of
from elvis.plugins.runtime.volume import Part, PartsVolume
from elvis.reference.locating import Locator
from elvis.reference.picture import render as render_reference
from elvis.scene.model.quantities import quantities

MFEM = Path(__file__).resolve().parents[3] / "shared" / "data" / "solvers" / "mfem"
FIELD, PLACE = 1e-11, 1e-10
SOLIDS = Shape.of_dimension(3)


def bent(shape, unit=False):
    """A curved element with a field that is not a polynomial; NumPy alone."""

    def evaluate(elements, points):
        r = 2 * points - 1 if unit else points
        x, y, z = r.T
        turned = np.column_stack([x + 0.1 * np.sin(y / 2), y + 0.1 * np.cos(z / 2), z * np.exp(0.1 * x)])
        return turned, np.exp(x) * np.sin(y) + z

    boxes = np.array([[-4, -4, -4, 4, 4, 4]], np.float32)
    return Part("none", shape.name, np.arange(1), boxes, {}, shape=shape, unit=unit, evaluate=evaluate)


def test_derivatives_match_those_of_smooth_functions():
    points = np.concatenate([scattered(Shape.HEXAHEDRON, 50), Shape.HEXAHEDRON.vertices])
    found = numerical_derivatives(
        lambda rows, r: np.stack([np.sin(2 * r[:, 0]) * r[:, 1], np.exp(r[:, 2])], axis=1), None, points
    )
    x, y, z = points.T
    zero = 0 * x
    wanted = np.stack(
        [np.stack([2 * np.cos(2 * x) * y, np.sin(2 * x), zero], 1), np.stack([zero, zero, np.exp(z)], 1)], 1
    )
    assert np.abs(found - wanted).max() < 1e-9


@pytest.mark.parametrize("unit", [False, True])
@pytest.mark.parametrize("shape", SOLIDS)
def test_faces_of_every_shape_are_made(shape, unit):
    """Each face's net is the map there; corners at one place make faces that two elements share one."""
    part = bent(shape, unit)
    (host,) = host_evaluations(PartsVolume([part], Path()))
    faces = faces_of(None, PartsVolume([part], Path()))
    assert sum(map(len, faces.blocks)) == len(shape.faces)
    assert all((own == -1).all() for own in faces.neighbours)
    for block in faces.blocks:
        points = block.space.points
        for row in range(len(block)):
            frame = block.frames[block.local[row]]
            own = frame[0] + points @ frame[1:]
            places = host.part.evaluate(np.zeros(len(points), int), own)[0]
            homogeneous = np.linalg.pinv(block.space.fit) @ block.nets(np.array([row]))[0]
            assert np.abs(homogeneous[:, :3] - places).max() < 1e-9


def test_elements_side_by_side_share_a_face():
    def evaluate(elements, points):
        return points + 2.0 * elements[:, None] * [1, 0, 0], points[:, 0]

    boxes = np.array([[-1, -1, -1, 1, 1, 1], [1, -1, -1, 3, 1, 1]], np.float32)
    part = Part("none", "Cube", np.array([5, 7]), boxes, {}, shape=Shape.HEXAHEDRON, evaluate=evaluate)
    faces = faces_of(None, PartsVolume([part], Path()))
    assert [len(rows) for rows in faces.select(["all"])] == [10]
    assert [len(rows) for rows in faces.select(["inner"])] == [2]
    assert faces.blocks[0].space.degree == 1


def test_faces_far_from_polynomials_are_rejected():
    def evaluate(elements, points):
        return points + 0.1 * np.abs(points), points[:, 0]

    boxes = np.array([[-2, -2, -2, 2, 2, 2]], np.float32)
    part = Part("none", "Kinked", np.array([0]), boxes, {}, shape=Shape.HEXAHEDRON, evaluate=evaluate)
    with pytest.raises(ElvisError, match="Kinked: expected faces near to polynomials of degree 12, or a plugin"):
        faces_of(None, PartsVolume([part], Path()))


# the reference


@pytest.mark.parametrize("shape", SOLIDS)
def test_the_reference_finds_points_of_every_shape(shape):
    host = HostEvaluation(bent(shape), shape)
    inner = drawn_in(shape, scattered(shape, 60), -0.02)
    places = host.evaluate(np.zeros(60, int), inner)[0]
    far = places + np.array([0.0, 5.0, 0.0])
    found = Locator([HostPatch(host)]).locate(np.concatenate([places, far]))
    assert np.array_equal(found.status, np.repeat([1, 0], 60))
    assert np.abs(found.reference[:60] - inner).max() < 1e-12
    every = Locator([HostPatch(host), HostPatch(host)]).locate(places, all=True)
    assert np.array_equal(every.point, np.repeat(np.arange(60), 2))


def test_points_within_rounding_of_a_border_are_inside_at_every_distance():
    """A twisted hexahedron at 2^20, where numbers are 2.3e-10 apart: more than the tolerance of margins."""

    def evaluate(elements, points):
        x, y, z = points.T
        return np.column_stack([2.0**20 + x + 0.25 * y * z, y, z]), x

    boxes = np.array([[2.0**20 - 4, -4, -4, 2.0**20 + 4, 4, 4]], np.float32)
    part = Part("none", "Twisted", np.arange(1), boxes, {}, shape=Shape.HEXAHEDRON, evaluate=evaluate)
    border = np.column_stack([np.ones(50), scattered(Shape.QUADRILATERAL, 50)])
    places = evaluate(None, border)[0]
    beside, off = (places + np.array([count * 2.0**-32, 0.0, 0.0]) for count in (1, 200))
    locator = Locator([HostPatch(HostEvaluation(part, Shape.HEXAHEDRON))])
    assert (locator.locate(np.concatenate([places, beside])).status == Inversion.INSIDE).all()
    assert (locator.locate(off).status == Inversion.OUTSIDE).all()


@pytest.fixture(scope="module")
def pipe():
    if not MFEM.is_dir():
        pytest.skip(f"there is no {MFEM}")
    return PluginData("nurbs", Nurbs([MFEM / "pipe_nurbs.mesh", MFEM / "pipe_nurbs.u.gf"]))


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    path = tmp_path_factory.mktemp("box") / "box.npz"
    rng = np.random.default_rng(4)
    corners = np.array([0.0, -1.0, 2.0]), np.array([1.0, 2.0, 5.0])
    write_box(path, *corners, ("fourier", "legendre", "fourier"), {"u": rng.normal(size=(5, 3, 4))}, time=0.5)
    return PluginData("fourier", FourierBox([path]))


@pytest.fixture
def agree(renderer):
    """Drawn by kernels and by the reference: covered alike, equal elements, fields and places."""
    drawing = renderer("vulkan")

    def agree(opened, sure=0.98, lost=0, **options):
        scene = Scene(**{"field": "u", "size": (60, 44), **options})
        drawing.show(volume_of(opened, quantities(scene)))
        drawn = drawing.render(scene)
        wanted = render_reference(opened, replace(scene, camera=drawn.view.camera))
        assert drawn.counts()["failed"] == wanted.counts()["failed"] == 0
        certain = (drawn.status != Status.AMBIGUOUS) & (wanted.status != Status.AMBIGUOUS)
        assert certain.mean() >= sure
        assert (drawn.element != wanted.element)[certain].sum() <= lost
        same = drawn.seen & (drawn.element == wanted.element)
        assert same.sum() > 200
        values = drawn.field[same]
        assert np.abs(values - wanted.field[same]).max() <= FIELD * max(np.ptp(values), 1.0)
        assert np.abs(drawn.reference - wanted.reference)[same].max() <= 1e-9
        return drawn, wanted

    return agree


CUT = Plane((0, 0, 10), (1, 1, 0.2))


def test_rational_volumes_match_the_reference(agree, pipe):
    agree(pipe, plane=CUT)


@pytest.mark.thorough
def test_faces_of_rational_volumes_match_the_reference(agree, pipe):
    agree(pipe, objects=(Faces(),), camera="iso")
    agree(pipe, objects=(Faces(("element:2",)),), camera="iso")


@pytest.mark.thorough
def test_expressions_of_several_fields_match_the_reference(agree, tmp_path):
    if not MFEM.is_dir():
        pytest.skip(f"there is no {MFEM}")
    files = [MFEM / f"pipe_nurbs.{name}" for name in ("mesh", "u.gf", "w.gf")]
    agree(PluginData("nurbs", Nurbs(files)), field="sqrt(u^2 + w^2) + d(w,z)*quality + shape", plane=CUT)


def test_facts_about_elements_agree_in_every_form(renderer, pipe):
    drawing, texts = renderer("vulkan"), ["element", "jacobian", "scaled_jacobian", "quality", "shape"]
    volume = volume_of(pipe, ["u", *texts])
    drawing.show(volume)
    (host,) = host_evaluations(volume)
    points = np.random.default_rng(3).uniform(-1, 1, (50, 3))
    rows = np.arange(50) % len(host)
    for text in texts:
        found = drawing.sample_elements(0, rows, points / 2, text).value
        wanted = evaluate_expression(Expression.parse(text, names_of(pipe)), {"u": host}, rows, points)
        assert np.abs(found - wanted).max() <= 1e-9 * np.abs(wanted).max(), text


@pytest.mark.parametrize("unit", [False, True])
def test_quality_of_a_stretched_cube_is_its_closed_form(unit, tmp_path):
    """Edges 4, 2 and 2: the mean ratio is 3 det^(2/3)/|T|^2 = 3 2^(2/3)/6, the size is the cube root of 16."""

    def evaluate(elements, points):
        r = 2 * points - 1 if unit else points
        return r * [2, 1, 1] + 5.0 * elements[:, None], r[:, 0]

    (tmp_path / "none.slang").touch()
    boxes = np.tile(np.array([-9, -9, -9, 9, 9, 9], np.float32), (2, 1))
    part = Part("none", "Cube", np.array([4, 7]), boxes, {}, shape=Shape.HEXAHEDRON, unit=unit, evaluate=evaluate)
    source = SimpleNamespace(fields=("u",), volume=lambda field: PartsVolume([part], tmp_path))
    found = host_quality(PluginData("cube", source))
    wanted = {
        "quality": 2 ** (2 / 3) / 2,
        "scaled_jacobian": 1,
        "jacobian_ratio": 1,
        "edge_ratio": 2,
        "h": 16 ** (1 / 3),
    }
    assert {name: pytest.approx([value] * 2, rel=1e-9) for name, value in wanted.items()} == found.measures
    assert found.element_ids.tolist() == [4, 7]
    assert np.abs(found.places - [[0, 0, 0], [5, 5, 5]]).max() < 1e-12
    source.volume = lambda field: PartsVolume([replace(part, evaluate=None)], tmp_path)
    with pytest.raises(ElvisError, match="the plugin cube does not describe its elements in NumPy"):
        host_quality(PluginData("cube", source))


def test_expressions_of_a_plugin_match_the_reference(agree, box):
    agree(box, field="sin(u)*x + d(u,y)", objects=(CutSurface(Sphere((0.5, 0.5, 3.5), 1.2)),), camera="iso")


def test_isosurfaces_of_waves_match_the_reference(agree, box):
    """Polynomials stand in for waves: the kernels call their pixels ambiguous, and may lose one at a silhouette."""
    drawn, wanted = agree(box, objects=(Isosurface((0.5,)),), camera="iso", sure=0.0, lost=2)
    same = drawn.seen & wanted.seen
    assert np.abs(drawn.drawing.depth[same] - wanted.drawing.depth[same]).max() < PLACE


def test_the_reference_names_missing_inputs(pipe, monkeypatch):
    bare = Part("rational", "Bare", np.array([0]), np.array([[0, 0, 0, 1, 1, 1]], np.float32), {})
    with pytest.raises(ElvisError, match="no second derivative of u, which a plugin describes"):
        render_reference(pipe, Scene("d(d(u,x),x)", plane=CUT, size=(10, 10)))
    monkeypatch.setattr(PluginData, "volume", lambda self, field: PartsVolume([bare], Path()))
    with pytest.raises(ElvisError, match="plugin nurbs can't be drawn in NumPy: expected parts with a shape"):
        render_reference(pipe, Scene("u", plane=CUT, size=(10, 10)))
