"""NURBS meshes in all forms that are read: with one list of control points, with patches of their own, as JSON."""

import json
from pathlib import Path

import numpy as np
import pytest
from archives import arrays_of

from elvis.core.base.errors import FormatError
from elvis.plugins.faces import faces_of
from elvis.plugins.nurbs import Nurbs
from elvis.plugins.nurbs.inversion import Solver

MFEM = Path(__file__).resolve().parents[3] / "shared" / "data" / "solvers" / "mfem"
ARC = np.sqrt(0.5)


@pytest.fixture(scope="module")
def pipe():
    if not MFEM.is_dir():
        pytest.skip(f"there is no {MFEM}")
    return Nurbs([MFEM / "pipe_nurbs.mesh", MFEM / "pipe_nurbs.u.gf"])


def patches_of(mesh):
    """Degrees, knots, points and weights of each patch, x fastest."""
    for vectors, grid in zip(mesh.knots, mesh.controls(), strict=True):
        numbers = grid.transpose().reshape(-1)
        yield vectors, mesh.points[numbers], mesh.weights[numbers]


def written(mesh, path, heading="controlpoints"):
    """The file of a mesh whose patches bring their own control points."""
    text = (MFEM / "pipe_nurbs.mesh").read_text()
    lines = [text[: text.index("knotvectors")], "patches\n"]
    for number, (vectors, points, weights) in enumerate(patches_of(mesh)):
        lines += [f"# Patch {number}\n", "knotvectors", "3"]
        lines += [" ".join(map(repr, [v.degree, v.count, *v.knots.tolist()])) for v in vectors]
        scaled = points if heading.endswith("cartesian") else points * weights[:, None]
        lines += ["\ndimension", "3\n", heading]
        lines += [" ".join(map(repr, row)) for row in np.column_stack([scaled, weights]).tolist()] + [""]
    path.write_text("\n".join(lines))
    return path


def as_json(mesh, **changes):
    """The table of a mesh; the field x has the places of the control points for values."""
    patches = [
        {
            "degrees": [v.degree for v in vectors],
            "knots": [v.knots.tolist() for v in vectors],
            "points": points.tolist(),
            "weights": weights.tolist(),
            "fields": {"x": points[:, 0].tolist(), "one": np.ones(len(points)).tolist()},
        }
        for vectors, points, weights in patches_of(mesh)
    ]
    return {"format": "elvis-nurbs", "version": 1, "time": 0.5, "patches": patches, **changes}


def same_places(source, field, truth, ids=True):
    """The elements map the solver's reference points to its places."""
    for part in source.volume(field).parts:
        here = np.isin(truth["elem"], part.element_ids)
        rows = np.searchsorted(part.element_ids, truth["elem"][here])
        places, values = part.evaluate(rows, truth["ref"][here])
        assert np.abs(places - truth["xyz"][here]).max() < 1e-12 * 23
        yield truth["xyz"][here], values


@pytest.mark.parametrize("heading", ["controlpoints", "controlpoints_homogeneous", "controlpoints_cartesian"])
def test_patches_with_separate_control_points_form_the_same_mesh(pipe, tmp_path, heading):
    path, truth = written(pipe.mesh, tmp_path / "own.mesh", heading), arrays_of(MFEM / "pipe_nurbs.truth.npz")
    source = Nurbs([path, MFEM / "pipe_nurbs.u.gf"])
    ((_, values),) = same_places(source, "u", truth)
    assert np.abs(values - truth["f_u"][:, 0]).max() < 1e-11 * np.ptp(values)


def test_the_solver_reads_these_patches_likewise(pipe, tmp_path):
    mfem = pytest.importorskip("mfem.ser")
    path = written(pipe.mesh, tmp_path / "own.mesh")
    mesh, truth = mfem.Mesh(str(path), 1, 1), arrays_of(MFEM / "pipe_nurbs.truth.npz")
    point = mfem.IntegrationPoint()
    for element, reference, xyz in zip(truth["elem"][:40], truth["ref"], truth["xyz"], strict=False):
        point.Set3(*reference.tolist())
        place = mesh.GetElementTransformation(int(element)).Transform(point)
        assert np.abs(np.array(place) - xyz).max() < 1e-11


def test_json_is_the_same_mesh(pipe, tmp_path):
    path, truth = tmp_path / "pipe.json", arrays_of(MFEM / "pipe_nurbs.truth.npz")
    sides = {"ends": [[patch, side] for patch in range(4) for side in ("z-", "z+")]}
    path.write_text(json.dumps(as_json(pipe.mesh, boundaries=sides)))
    assert Nurbs.opens([path])
    source = Nurbs([path])
    assert (source.time, source.fields) == (0.5, ("x", "one"))
    ((places, values),) = same_places(source, "x", truth)
    assert np.abs(values - places[:, 0]).max() < 1e-12 * 23
    ((_, ones),) = same_places(source, "one", truth)
    assert np.abs(ones - 1).max() < 1e-14

    # adjacency follows from the places of corners
    own, other = (faces_of(None, one.volume(one.fields[0])) for one in (source, pipe))
    for words in (["all"], ["inner"]):
        assert sum(map(len, own.select(words))) == sum(map(len, other.select(words)))
    assert sum(map(len, own.select(["ends"]))) == 8


def quarter(**changes):
    """A quarter of a ring, thick along z: one patch of degrees 2, 1, 1."""
    arc = [[1, 0, 0], [1, 1, 0], [0, 1, 0]]
    points = [[s * x, s * y, z] for z in (0.0, 1.0) for s in (1.0, 2.0) for x, y, _ in arc]
    patch = {"degrees": [2, 1, 1], "knots": [[0, 0, 0, 1, 1, 1], [0, 0, 1, 1], [0, 0, 1, 1]], "points": points}
    patch |= {"weights": [1.0, ARC, 1.0] * 4, "fields": {"z": [p[2] for p in points]}}
    table = {"format": "elvis-nurbs", "version": 1, "patches": [patch | changes.pop("patch", {})]}
    return table | changes


def opened(table, path):
    path.write_text(json.dumps(table))
    return Nurbs([path])


def test_a_circle_is_one(tmp_path):
    (part,) = opened(quarter(), tmp_path / "ring.json").volume("z").parts
    points = np.random.default_rng(1).uniform(0, 1, (300, 3))
    places, values = part.evaluate(np.zeros(300, int), points)
    assert np.abs(np.hypot(places[:, 0], places[:, 1]) - (1 + points[:, 1])).max() < 1e-14
    assert np.abs(values - points[:, 2]).max() < 1e-15
    low, high = part.bounds()
    assert low <= 0
    assert 0 <= high - 1 < 1e-12


def test_points_next_to_patches_are_proved_to_be_outside(tmp_path):
    (part,) = opened(quarter(), tmp_path / "ring.json").volume("z").parts
    assert isinstance(part.solve, Solver)
    points = np.random.default_rng(2).uniform([0, 0, 0], [2, 2, 1], (500, 3))
    radius = np.hypot(points[:, 0], points[:, 1])
    found = part.solve(np.zeros(500, int), points)
    assert np.array_equal(found.status, ((radius >= 1) & (radius <= 2)).astype(int))
    inside = found.status == 1
    assert np.abs(part.evaluate(np.zeros(500, int), found.reference)[0] - points)[inside].max() < 1e-12
    assert np.abs(found.field - points[:, 2])[inside].max() < 1e-12
    assert not np.isnan(found.field[inside]).any()
    assert part.bends(np.zeros(1, int)).all()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"version": 2}, "expected the format elvis-nurbs in version 1, found 'elvis-nurbs' 2"),
        ({"patches": []}, "patches: expected a list of patches, found none"),
        ({"patch": {"degrees": [2, 1]}}, r"patch 0, degrees: expected a list of three, found \[2, 1\]"),
        ({"patch": {"degrees": [13, 1, 1]}}, "patch 0, knots x: expected a degree from 1 to 12, found 13"),
        (
            {"patch": {"knots": [[0, 0, 1, 0, 1, 1], [0, 0, 1, 1], [0, 0, 1, 1]]}},
            "knots x: expected 6 or more",
        ),
        ({"patch": {"knots": [[0, 0, 0, 1, 1, "a"]] * 3}}, r"patch 0, knots x: expected an array \(6,\) of numbers"),
        (
            {"patch": {"points": [[0, 0, 0]]}},
            r"points: expected an array \(12, 3\) of numbers, found \(1, 3\)",
        ),
        ({"patch": {"weights": [-1.0] * 12}}, "patch 0, weights: expected positive weights, found -1"),
        ({"patch": {"fields": {"p": [1]}}}, r"patch 0, field p: expected an array \(12,\) of numbers, found \(1,\)"),
        ({"boundaries": {"wall": [[1, "x-"]]}}, "boundary wall: expected a patch from 0 to 0 and one of z-, "),
        ({"boundaries": {"wall": [[0, "up"]]}}, r"boundary wall: expected a patch .*, found \[0, 'up'\]"),
        ({"time": "late"}, "time: expected a number, found 'late'"),
    ],
)
def test_damaged_json_gives_a_one_line_error(tmp_path, changes, sentence):
    with pytest.raises(FormatError, match=rf"spoilt\.json: .*{sentence}"):
        opened(quarter(**changes), tmp_path / "spoilt.json")


def test_text_that_is_not_json_is_rejected(tmp_path):
    path = tmp_path / "spoilt.json"
    path.write_text('{"format": "elvis-nurbs", ')
    with pytest.raises(FormatError, match=r"spoilt\.json: expected JSON"):
        Nurbs([path])


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("controlpoints\n", "controls\n", "patches: expected one of controlpoints, "),
        ("# Patch 0\n\nknotvectors\n3\n", "# Patch 0\n\nknotvectors\n3\n1 2 0 0 1 1\n", "expected three of 4 patches"),
        (
            "\n3.0 0.0 0.0 1.0\n",
            "\n3.5 0.0 0.0 1.0\n",
            "expected equal control points on shared sides of patches",
        ),
    ],
)
def test_damaged_patches_give_a_one_line_error(pipe, tmp_path, old, new, sentence):
    path = written(pipe.mesh, tmp_path / "own.mesh")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 4 if "controls" in new else 1))
    with pytest.raises(FormatError, match=sentence):
        Nurbs([path])


def test_surfaces_and_meshes_alone_are_left_to_the_converter(pipe, tmp_path):
    mesh, function = MFEM / "pipe_nurbs.mesh", MFEM / "pipe_nurbs.u.gf"
    plane = tmp_path / "plane.mesh"
    plane.write_text(mesh.read_text().replace("dimension\n3", "dimension\n2"))
    assert Nurbs.opens([mesh, function])
    assert not Nurbs.opens([mesh])
    assert not Nurbs.opens([plane, function])


def test_a_mesh_may_lack_boundary_elements(pipe, tmp_path):
    text = (MFEM / "pipe_nurbs.mesh").read_text()
    path = tmp_path / "bare.mesh"
    start, end = text.index("\nboundary") + 1, text.index("\nedges") + 1
    path.write_text(f"{text[:start]}boundary\n0\n\n{text[end:]}")
    assert Nurbs([path]).mesh.boundary.shape == (0, 5)
