import csv

import numpy as np
import pytest
from archives import arrays_of
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

from elvis import ElvisError, trace, write
from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid, mixed_plane


@pytest.fixture
def shear(tmp_path):
    """Two quadrilaterals and two triangles that fill [0, 3] x [0, 1], with u = 1 + y, v = 0, p = x."""
    bare = Dataset(mixed_plane(1))
    functions = {"u": lambda p: 1 + p[:, 1], "v": lambda p: 0 * p[:, 0], "p": lambda p: p[:, 0]}
    dataset = Dataset(bare.mesh, tuple(approximated(bare, name, own, 3) for name, own in functions.items()))
    write(dataset, tmp_path / "shear.xml", tmp_path / "shear.fld")
    return dataset, (tmp_path / "shear.xml", tmp_path / "shear.fld")


SEEDS = ("--seeds", "line:1,0.25:1,0.75:2", "--seeds", "point:7,7")


def test_files_of_all_kinds_contain_the_same_lines(shear, elvis, tmp_path):
    dataset, files = shear
    found = trace(dataset, SEEDS[1::2], direction="both", fields=["2*p"])
    for suffix in ("csv", "npz", "vtp"):
        elvis("trace", *files, *SEEDS, "--direction", "both", "--field", "2*p", "-o", tmp_path / f"lines.{suffix}")
    archive = arrays_of(tmp_path / "lines.npz")
    assert list(archive) == ["offsets", "seed", "end", "points", "time", "length", "element", "velocity", "2*p", "ends"]
    assert (archive["points"] == found.points).all()
    assert [archive["ends"][end] for end in archive["end"]] == ["boundary", "boundary", "outside"] * 2
    assert archive["seed"].tolist() == [0, 1, 2] * 2
    with (tmp_path / "lines.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["2*p"]) for row in rows] == found.values["2*p"].tolist()
    assert [int(row["line"]) for row in rows] == np.repeat(np.arange(6), np.diff(found.offsets)).tolist()

    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(tmp_path / "lines.vtp"))
    reader.Update()
    drawn = reader.GetOutput()
    assert (drawn.GetNumberOfLines(), drawn.GetNumberOfPoints()) == (6, len(found.points))
    assert [drawn.GetPoint(k) for k in (0, 7)] == [tuple(found.points[k]) for k in (0, 7)]
    assert drawn.GetPointData().GetArray("velocity").GetTuple3(0) == pytest.approx((1.25, 0, 0))
    assert drawn.GetCell(1).GetNumberOfPoints() == len(found[1])


def test_printed_output(shear, elvis, elvis_json, monkeypatch):
    told = []
    monkeypatch.setattr("elvis.core.base.terminal.warn", told.append)
    rows = elvis("trace", *shear[1], *SEEDS, "--velocity", "u,0.1", "--duration", "1e-3").splitlines()
    assert [row.split()[0] for row in rows] == ["end", "duration", "outside"]
    assert told == ["1 of 3 seeds lie outside the mesh"]
    found = elvis_json("trace", *shear[1], "--seeds", "random:5")
    assert (found["lines"], found["ends"]) == (5, {"boundary": 5})
    assert np.shape(found["lengths"]) == (5,)
    stretched = "trace", *shear[1], "--seeds", "point:0.2,0.25", "--seeds", "point:7,7", "--duration", "0.5", "--ftle"
    found = elvis_json(*stretched)
    exponent = np.log(np.linalg.norm([[1, 0.5], [0, 1]], 2)) / 0.5
    assert found["lengths"] == [pytest.approx(0.625), None]
    assert found["ftle"] == [pytest.approx(exponent), None]
    said = f"finite-time Lyapunov exponents from {exponent:.6g} to {exponent:.6g}, of 1 lines"
    assert elvis(*stretched).splitlines()[-1] == said


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (("--seeds", "point:7,7"), "all 1 seeds lie outside the mesh"),
        (("--seeds", "point:1,0.5", "--velocity", "u"), "expected a velocity of 2 components"),
        (("--seeds", "point:1,0.5", "-o", "lines.vtk"), "expected a name that ends in .csv, .npz or .vtp, found .vtk"),
        (("--seeds", "point:1,0.5", "--field", "time"), "there is no 'time'"),
        ((), "expected --seeds, where lines begin, or --cores"),
    ],
)
def test_invalid_input_is_rejected(shear, elvis, arguments, match):
    with pytest.raises(Exception, match=match) as caught:
        elvis("trace", *shear[1], *arguments)
    assert isinstance(caught.value, ElvisError) or match.startswith("expected --seeds")


@pytest.fixture
def eddy(tmp_path):
    """A vortex along z in a hexahedron, at rest on its axis x = 0.4, y = 0.7."""
    bare = Dataset(grid(Shape.HEXAHEDRON, 1))
    functions = {"u": lambda p: 0.7 - p[:, 1], "v": lambda p: p[:, 0] - 0.4, "w": lambda p: 0 * p[:, 0]}
    dataset = Dataset(bare.mesh, tuple(approximated(bare, name, own, 2) for name, own in functions.items()))
    write(dataset, tmp_path / "eddy.xml", tmp_path / "eddy.fld")
    return tmp_path / "eddy.xml", tmp_path / "eddy.fld"


@pytest.mark.thorough
def test_cores(eddy, elvis, elvis_json, tmp_path):
    for suffix in ("csv", "npz", "vtp"):
        elvis("trace", *eddy, "--cores", "--field", "2*u", "--spacing", "0.5", "-o", tmp_path / f"cores.{suffix}")
    archive = arrays_of(tmp_path / "cores.npz")
    assert archive["points"][:, :2] == pytest.approx(np.tile([0.4, 0.7], (len(archive["points"]), 1)), abs=1e-12)
    assert archive["swirl"] == pytest.approx(1.0)
    assert archive["ends"][archive["last"]] == ["boundary"]
    with (tmp_path / "cores.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["z"]) for row in rows] == archive["points"][:, 2].tolist()
    assert (tmp_path / "cores.vtp").stat().st_size > 0
    found = elvis_json("trace", *eddy, "--cores", "--criterion", "vorticity")
    assert (found["lines"], found["ends"], found["undecided"]) == (1, {"boundary": 2}, [])
    assert found["lengths"] == pytest.approx([1.0])
    assert elvis("trace", *eddy, "--cores", "--min-swirl", "1.1").strip() == "no vortex cores"


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (("--cores", "--seeds", "random:5"), "--seeds: expected without --cores"),
        (("--cores", "--ftle"), "expected no --ftle, --kind or --releases"),
        (("--only-q", "--seeds", "random:5"), "--only-q: expected --cores"),
        (("--cores", "-o", "cores.txt"), "expected a name that ends in .csv, .npz or .vtp"),
    ],
)
def test_invalid_input_for_cores_is_rejected(eddy, elvis, arguments, match):
    with pytest.raises(Exception, match=match):
        elvis("trace", *eddy, *arguments)
