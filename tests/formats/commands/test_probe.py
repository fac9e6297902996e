import csv
import io
import json
import re

import click
import numpy as np
import pytest
from truth_files import truth_values

from elvis import Dataset, ElvisError, Shape, write
from elvis.core.testing import approximated, grid


@pytest.fixture
def channel(nektar):
    """Six tetrahedra that fill the cube [-1, 1]^3, with u = 1 - z^2."""
    return nektar / "chan3d_tet" / "chan3D.xml", nektar / "chan3d_tet" / "chan3D.fld"


def table(text):
    rows = list(csv.DictReader(io.StringIO(text)))
    return {name: np.array([row[name] for row in rows], float) for name in rows[0]}


def test_a_line_through_the_channel(channel, elvis):
    found = table(elvis("probe", *channel, "--line", "0,0,0:0,0,2", "-n", 5))
    assert list(found) == ["point", "x", "y", "z", "element", "status", "u", "v", "w", "p"]
    np.testing.assert_array_equal(found["point"], np.arange(5))
    np.testing.assert_array_equal(found["z"], [0, 0.5, 1, 1.5, 2])
    np.testing.assert_array_equal(found["status"], [1, 1, 1, 0, 0])
    np.testing.assert_allclose(found["u"], [1, 0.75, 0, np.nan, np.nan], atol=1e-12)
    np.testing.assert_array_equal(found["element"][3:], [-1, -1])


def test_rows_as_json(channel, elvis):
    """With all digits, and null for what has no value."""
    where = [*channel, "--line", "0,0,0:0,0,2", "-n", 5]
    rows, columns = json.loads(elvis("probe", "--json", *where)), table(elvis("probe", *where))
    assert [list(row) for row in rows] == [list(columns)] * 5
    assert rows[4]["u"] is None
    for name, column in columns.items():
        np.testing.assert_array_equal([np.nan if row[name] is None else row[name] for row in rows], column)


def test_the_first_direction_of_a_plane_varies_fastest(channel, elvis):
    found = table(elvis("probe", *channel, "--plane", "0,0,0:0,0,1:0,1,0", "-n", "3x2", "--fields", "u"))
    np.testing.assert_array_equal(found["z"], [0, 0.5, 1, 0, 0.5, 1])
    np.testing.assert_array_equal(found["y"], [0, 0, 0, 1, 1, 1])
    np.testing.assert_allclose(found["u"], [1, 0.75, 0, 1, 0.75, 0], atol=1e-12)
    assert "p" not in found


@pytest.mark.parametrize(
    ("case", "mesh", "field"),
    [
        ("gen_allelem_n4", "CubeAllElements.xml", "gen_allelem_n4.fld"),
        ("gen_tet_p8_nekg2", "Movement_fixed_3D_stacked_cylinders_curved_hdf5.xml", "gen_tet_p8_nekg2.fld"),
    ],
)
def test_true_values_at_true_points(nektar, tmp_path, elvis, case, mesh, field):
    points, values, names = truth_values(nektar / case / f"{case}.truth.txt")
    np.savetxt(tmp_path / "points.csv", points, fmt="%.17g", delimiter=",", header="x,y,z", comments="")
    where = ["--points", tmp_path / "points.csv", "--all", "-o", tmp_path / "out.npz"]
    elvis("probe", nektar / case / mesh, nektar / case / field, *where)
    with np.load(tmp_path / "out.npz") as found:
        held = np.unique(found["point"][found["status"] == 1])
        np.testing.assert_array_equal(held, np.arange(len(points)))
        for name, column in zip(names, values.T, strict=True):
            # a point on a face has a value for each element that holds it; one of them is the true one
            error = np.abs(found[name] - column[found["point"]])
            nearest = np.full(len(points), np.inf)
            np.minimum.at(nearest, found["point"], error)
            assert nearest.max() <= 1e-11 * np.ptp(column)


def test_clipped_points_are_outside(nektar, elvis):
    """A line through the cube [0, 1]^3 in 9 points, of which the ball holds 3; its outside is the rest."""
    case = nektar / "gen_allelem_n4"
    files = case / "CubeAllElements.xml", case / "gen_allelem_n4.fld"
    line = ("probe", *files, "--line", "0,0.4,0.4:1,0.4,0.4", "-n", 9, "--fields", "u")
    whole = table(elvis(*line))
    for clip, is_left in (
        ("sphere:0.5,0.4,0.4:0.2", [0, 1, 2, 6, 7, 8]),
        ("outside:sphere:0.5,0.4,0.4:0.2", [3, 4, 5]),
    ):
        found = table(elvis(*line, "--clip", clip))
        assert np.flatnonzero(found["status"] == 1).tolist() == is_left
        assert np.flatnonzero(found["element"] >= 0).tolist() == is_left
        np.testing.assert_array_equal(found["u"][is_left], whole["u"][is_left])
        assert np.isnan(np.delete(found["u"], is_left)).all()


def test_both_sides_of_a_jump(nektar, elvis):
    case = nektar / "gen_allelem_n4"
    files = case / "CubeAllElements.xml", case / "gen_allelem_n4.fld"
    one = table(elvis("probe", *files, "--line", "0,0,0:1,1,1", "-n", 2, "--fields", "u"))
    every = table(elvis("probe", *files, "--line", "0,0,0:1,1,1", "-n", 2, "--fields", "u", "--all"))
    assert len(one["point"]) == 2
    assert len(every["point"]) > 2
    assert len(set(zip(every["point"], every["element"], strict=True))) == len(every["point"])
    assert set(one["element"]) <= set(every["element"])


def test_tables_and_archives_agree(channel, tmp_path, elvis):
    line = ["--line", "-1,-1,0:1,1,2", "-n", 30]
    printed = elvis("probe", *channel, *line)
    assert elvis("probe", *channel, *line, "-o", tmp_path / "line.csv") == ""
    elvis("probe", *channel, *line, "-o", tmp_path / "line.npz")
    assert (tmp_path / "line.csv").read_text() == printed
    with np.load(tmp_path / "line.npz") as archive:
        for name, column in table(printed).items():
            np.testing.assert_array_equal(archive[name], column)
        assert archive["element"].dtype == archive["point"].dtype == archive["status"].dtype == np.int64


def test_printed_points_can_be_probed_again(channel, tmp_path, elvis):
    elvis("probe", *channel, "--line", "-1,-1,0:1,1,2", "-o", tmp_path / "first.csv")
    assert elvis("probe", *channel, "--points", tmp_path / "first.csv") == (tmp_path / "first.csv").read_text()


def test_no_points_give_a_header(channel, tmp_path, elvis):
    (tmp_path / "none.csv").write_text("x,y,z\n")
    assert elvis("probe", *channel, "--points", tmp_path / "none.csv") == "point,x,y,z,element,status,u,v,w,p\n"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "expected one of --points, --point, --line, --plane and --grid"),
        (
            ["--line", "0,0:1,1", "--plane", "0,0:1,0:0,1"],
            "expected one of --points, --point, --line, --plane and --grid",
        ),
        (["--line", "0,0,0"], "expected 2 points with colons"),
        (["--line", "0,0,0:1,a,0"], "expected 2 or 3 numbers"),
        (["--line", "0,0,0:1,nan,0"], "expected 2 or 3 numbers"),
        (["--line", "0,0:1,1", "-n", "1"], "each at least 2"),
        (["--line", "0,0:1,1", "-n", "many"], "each at least 2"),
        (["--line", "0,0:1,1", "-n", "3x4"], "one number of points along a line"),
        (["--points", "p.csv", "-n", "3"], "no -n with points"),
    ],
)
def test_usage(channel, elvis, arguments, sentence):
    with pytest.raises(click.UsageError) as failure:
        elvis("probe", *channel, *arguments)
    assert sentence in failure.value.format_message()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--fields", "u,rho"], "there is no field 'rho'; the fields are u, v, w, p"),
        (["--field", "rho"], "there is no 'rho'; the fields are u, v, w, p; there are also x, y, z"),
        (["-o", "/no/such/out.csv"], "/no/such/out.csv: cannot be written: there is no folder /no/such"),
        (["-o", "out.txt"], "out.txt: expected a name that ends in .csv, .npz or .parquet, found .txt"),
    ],
)
def test_failures(channel, elvis, arguments, sentence):
    with pytest.raises(ElvisError) as failure:
        elvis("probe", *channel, "--line", "0,0:1,1", *arguments)
    assert sentence in str(failure.value)


def test_a_failure_leaves_no_file(channel, elvis, tmp_path):
    with pytest.raises(ElvisError):
        elvis("probe", *channel, "--line", "0,0:1,1", "--fields", "rho", "-o", tmp_path / "out.csv")
    assert not list(tmp_path.iterdir())


def test_a_field_with_the_name_of_a_column_is_skipped(elvis, tmp_path, monkeypatch):
    """Exports for other programs have a field of elements' numbers."""
    mesh = Dataset(grid(Shape.QUADRILATERAL, 1))
    fields = [approximated(mesh, name, lambda x: x[:, 0], 1) for name in ("element", "u")]
    files = write(Dataset(mesh.mesh, tuple(fields)), tmp_path / "both.xml")
    told = []
    monkeypatch.setattr("elvis.core.base.terminal.warn", told.append)
    found = table(elvis("probe", *files, "--point", "0.5,0.5"))
    assert list(found) == ["point", "x", "y", "z", "element", "status", "u"]
    assert [text.split(";")[0] for text in told] == ["the field 'element' has the name of a column"]
    with pytest.raises(ElvisError, match=r"an expression, such as 1\*element$"):
        elvis("probe", *files, "--point", "0.5,0.5", "--field", "u", "--field", "element")
    assert table(elvis("probe", *files, "--point", "0.5,0.5", "--field", "1*element"))["1*element"] == found["u"]


def test_expressions_are_probed_like_fields(channel, elvis):
    """u = 1 - z^2, so du/dz = -2z."""
    found = table(
        elvis(
            "probe",
            *channel,
            "--line",
            "0,0,0:0,0,0.9",
            "-n",
            4,
            "--field",
            "d(u,z)",
            "--field",
            "atan2(u,1)",
            "--field",
            "speed",
        )
    )
    assert list(found)[6:] == ["d(u,z)", "atan2(u,1)", "speed"]
    z = found["z"]
    np.testing.assert_allclose(found["d(u,z)"], -2 * z, atol=1e-11)
    np.testing.assert_allclose(found["atan2(u,1)"], np.arctan(1 - z**2), atol=1e-12)
    np.testing.assert_allclose(found["speed"], 1 - z**2, atol=1e-12)


@pytest.mark.parametrize("link", ["", "soft", "hard"])
def test_the_input_points_are_not_overwritten(channel, elvis, tmp_path, link):
    points = tmp_path / "p.csv"
    points.write_text("x,y,z\n0.5,0.5,0\n")
    output = tmp_path / f"{link}.csv" if link else points
    if link == "soft":
        output.symlink_to(points)
    elif link == "hard":
        output.hardlink_to(points)
    with pytest.raises(ElvisError, match=r"not written: it is (an|the) input.*--overwrite"):
        elvis("probe", *channel, "--points", points, "-o", output)
    assert points.read_text() == "x,y,z\n0.5,0.5,0\n"
    elvis("probe", *channel, "--points", points, "-o", output, "--overwrite")
    assert output.read_text().startswith("point,")


def test_a_grid_does_not_replace_its_data(elvis, tmp_path):
    (tmp_path / "m.xml").write_text("<NEKTAR/>")
    (tmp_path / "m.nrrd").symlink_to("m.xml")
    with pytest.raises(ElvisError, match=r"m\.nrrd: not written: it is the input"):
        elvis("probe", tmp_path / "m.xml", "--grid", "2,2,1", "-o", tmp_path / "m.nrrd")


def test_another_solution_in_an_expression(channel, elvis, monkeypatch):
    """The same files twice; beyond the domain there is nothing to be told."""
    told = []
    monkeypatch.setattr("elvis.core.base.terminal.warn", told.append)
    other = f"--other=ref={channel[0]},{channel[1]}"
    found = table(elvis("probe", *channel, other, "--line", "0,0,0:0,0,2", "-n", 5, "--field", "u - ref:u"))
    np.testing.assert_allclose(found["u - ref:u"], [0, 0, 0, np.nan, np.nan], atol=1e-12)
    assert not told
    with pytest.raises(ElvisError, match="--other: expected NAME=FILE,FILE"):
        elvis("probe", *channel, "--other", "ref", "--point", "0,0,0")


def test_even_steps_of_a_curve(channel, elvis, tmp_path):
    """u = 1 - z^2 along the normal of a wall at z = -1, and round a circle about z."""
    along = ["--along", "normal:1:0,0,-0.5:1", "-n", 5, "--fields", "u"]
    found = table(elvis("probe", *channel, *along))
    assert next(iter(found)) == "length"
    np.testing.assert_allclose(np.abs(found["z"]), 1 - found["length"], atol=1e-12)
    np.testing.assert_allclose(found["u"], 2 * found["length"] - found["length"] ** 2, atol=1e-12)
    assert elvis("probe", *channel, *along, "--plot", tmp_path / "u.svg") == ""
    assert "length" in (tmp_path / "u.svg").read_text()
    round_z = table(elvis("probe", *channel, "--along", "circle:0,0,0.5:0,0,1:0.5", "-n", 4))
    np.testing.assert_allclose(round_z["u"], 0.75, atol=1e-12)
    alone = tmp_path / "alone.svg"
    elvis("probe", *channel, "--along", "line:0,0,1:0,0,9", "-n", 300, "--fields", "u", "--plot", alone)
    assert len(re.findall("<use[^>]*#440154", alone.read_text())) == 1, "a value with none beside it is a dot"
    for wrong, sentence in (("arc:0,0", "expected a curve, one of line"), ("line:0,0", "expected line:P:Q")):
        with pytest.raises(ElvisError, match=sentence):
            elvis("probe", *channel, "--along", wrong)
