"""Grids in NRRD files, read back by a reader of the format's rules and by VTK's own."""

import click
import numpy as np
import pytest
from click.testing import CliRunner

from elvis import Dataset, ElvisError, write
from elvis.core.files.nrrd import Grid, write_nrrd
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid
from elvis.plugins.command.command import elvis as group

GRID = Grid((-0.5, 0.0, 0.25), (1.0, 1.0, 0.75), (12, 3, 5))


def read(path):
    """Header fields, key/value pairs, and the numbers (z, y, x[, f])."""
    head, numbers = path.read_bytes().split(b"\n\n", 1)
    magic, *lines = head.decode().split("\n")
    assert magic == "NRRD0005"
    header = dict(line.split(": ", 1) for line in lines if ":=" not in line)
    keys = dict(line.split(":=", 1) for line in lines if ":=" in line)
    assert (header["type"], header["endian"], header["encoding"]) == ("double", "little", "raw")
    sizes = [int(size) for size in header["sizes"].split()]
    assert len(sizes) == int(header["dimension"]) == len(header["kinds"].split())
    return header, keys, np.frombuffer(numbers, "<f8").reshape(sizes[::-1])


def places(header, shape):
    """(z, y, x, 3) where the header says that the points are."""
    vectors = [part for part in header["space directions"].split() if part != "none"]
    steps = np.array([np.fromstring(vector.strip("()"), sep=",") for vector in vectors])
    origin = np.fromstring(header["space origin"].strip("()"), sep=",")
    index = np.stack(np.meshgrid(*(np.arange(n) for n in shape[:3]), indexing="ij"), axis=-1)[..., ::-1]
    return origin + index @ steps


def test_points_run_along_x_first_and_include_both_ends():
    points = GRID.planes(0, 5).reshape(5, 3, 12, 3)
    assert points[0, 0, 0].tolist() == [-0.5, 0.0, 0.25]
    assert points[-1, -1, -1].tolist() == [1.0, 1.0, 0.75]
    assert points[0, 0, 1, 0] == pytest.approx(-0.5 + 1.5 / 11)
    assert np.array_equal(GRID.planes(2, 4), points[2:4].reshape(-1, 3))
    flat = Grid((0.0, 0.0, 0.0), (2.0, 1.0, 0.0), (3, 1, 1))
    assert flat.planes(0, 1).tolist() == [[0.0, 0.5, 0.0], [1.0, 0.5, 0.0], [2.0, 0.5, 0.0]]
    assert [flat.spacing(axis) for axis in range(3)] == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("count", [1, 3])
def test_written_samples_match_the_header(tmp_path, count):
    weights = np.random.default_rng(0).random((3, count))
    parts = (GRID.planes(first, first + 2) @ weights for first in range(0, 5, 2))
    write_nrrd(tmp_path / "a.nrrd", GRID, [f"u{i}" for i in range(count)], parts)
    header, keys, found = read(tmp_path / "a.nrrd")
    assert keys["fields"] == " ".join(f"u{i}" for i in range(count))
    expected = places(header, found.shape) @ weights
    assert np.abs(found.reshape(expected.shape) - expected).max() < 1e-15


def test_vtk_reads_it(tmp_path):
    io = pytest.importorskip("vtkmodules.vtkIOImage")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    write_nrrd(tmp_path / "a.nrrd", GRID, ["u"], [GRID.planes(0, 5)[:, :1]])
    reader = io.vtkNrrdReader()
    reader.SetFileName(str(tmp_path / "a.nrrd"))
    reader.Update()
    image = reader.GetOutput()
    assert image.GetDimensions() == GRID.counts
    assert image.GetOrigin() == GRID.low
    assert image.GetSpacing() == tuple(GRID.spacing(axis) for axis in range(3))
    assert np.array_equal(vtk_to_numpy(image.GetPointData().GetScalars()), GRID.planes(0, 5)[:, 0])


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The unit cube with u = x + 2 y - z and v = x y."""
    data = Dataset(mesh := grid(Shape.TETRAHEDRON, 1))
    functions = {"u": lambda x: x @ [1.0, 2.0, -1.0], "v": lambda x: x[:, 0] * x[:, 1]}
    fields = tuple(approximated(data, name, function, modes=3) for name, function in functions.items())
    return write(Dataset(mesh, fields), tmp_path_factory.mktemp("cube") / "cube.xml")


def run(*arguments):
    outcome = CliRunner().invoke(group, ["probe", *map(str, arguments)], standalone_mode=False)
    if outcome.exception:
        raise outcome.exception
    return outcome.stdout


def test_a_grid_of_data_is_exact_inside_and_nan_outside(files, tmp_path, monkeypatch):
    monkeypatch.setattr("elvis.renderer.commands.probe.probe._TOGETHER", 50)
    assert run(*files, "--grid", "6,5,4", "--box", "0,0,0:1.25,1,1", "-o", tmp_path / "a.nrrd") == ""
    header, keys, found = read(tmp_path / "a.nrrd")
    assert keys["fields"] == "u v"
    x, y, z = np.moveaxis(places(header, found.shape), -1, 0)
    assert np.array_equal(np.isnan(found), np.broadcast_to((x > 1)[..., None], found.shape))
    inside = x <= 1
    assert np.abs(found - np.stack([x + 2 * y - z, x * y], axis=-1))[inside].max() < 4e-14

    # by default the box is that of the data; one quantity is a scalar
    run(*files, "--grid", "3,3,3", "--field", "u*v", "-o", tmp_path / "b.nrrd")
    header, keys, found = read(tmp_path / "b.nrrd")
    assert (header["dimension"], keys["fields"]) == ("3", "u*v")
    assert found[2, 2, 2] == pytest.approx(2.0, rel=1e-13)
    assert not np.isnan(found).any()


@pytest.mark.parametrize(
    ("arguments", "error", "sentence"),
    [
        (("--box", "0,0,0:1,1,1", "-o", "a.nrrd"), click.UsageError, "expected --box with --grid"),
        (("--grid", "3,3,3", "--line", "0,0,0:1,1,1", "-o", "a.nrrd"), click.UsageError, "without other points"),
        (("--grid", "3,3,3", "-o", "a.txt"), ElvisError, "expected a name that ends in .csv, .npz or .parquet"),
        (("--grid", "30000x30000x3"), ElvisError, "expected at most 50000000 points of a table"),
        (("--grid", "3,3", "-o", "a.nrrd"), click.BadParameter, "expected three numbers from 1 to 65536"),
        (("--grid", "0,3,3", "-o", "a.nrrd"), click.BadParameter, "expected three numbers from 1 to 65536"),
        (("--grid", "3,3,3", "--box", "0,0,0:1,0,1", "-o", "a.nrrd"), ElvisError, "expected one point along y"),
        (("--grid", "3,3,3", "-o", "no/a.nrrd"), ElvisError, "there is no folder"),
        (("--grid", "3,3,3", "--fields", "q", "-o", "a.nrrd"), ElvisError, "q"),
        (("--line", "0,0,0:1,1,1", "-o", "a.nrrd"), ElvisError, "expected a name that ends in .csv, .npz or .parquet"),
    ],
)
def test_bad_input_is_reported_and_nothing_is_written(files, tmp_path, monkeypatch, arguments, error, sentence):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=sentence):
        run(*files, *arguments)
    assert list(tmp_path.iterdir()) == []
