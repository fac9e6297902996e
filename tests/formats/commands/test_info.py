import json
from dataclasses import replace

import click
import numpy as np
import pytest
from click.testing import CliRunner
from truth_files import truth_values

from elvis import Dataset, ElvisError, read, write
from elvis.core.shapes import Shape
from elvis.core.summary.summary import summary
from elvis.core.testing import curved, grid, one_element, with_field
from elvis.plugins.command.command import elvis as group
from elvis.renderer.commands.info.tables import _size, shortened


@pytest.fixture
def pipe(nektar):
    return sorted((nektar / "gen_pipe_curved").glob("*.xml")), nektar / "gen_pipe_curved" / "gen_pipe_curved.fld"


def test_facts_of_a_curved_pipe(elvis_json, pipe):
    facts = elvis_json("info", *pipe[0], pipe[1])
    assert (facts["dimension"], facts["space"]) == (3, 3)
    assert facts["mesh"]["elements"] == {"tetrahedron": 428, "prism": 136}
    assert facts["mesh"]["elements_in_domain"] == 564
    assert facts["mesh"]["curved_edges"] == 221
    assert facts["geometry"]["jacobian"]["minimum"] > 0
    assert facts["geometry"]["jacobian"]["elements_not_positive"] == []
    assert [field["name"] for field in facts["fields"]] == ["u", "v"]
    assert {expansion["shape"] for expansion in facts["fields"][0]["expansions"]} == {"tetrahedron", "prism"}
    assert facts["bytes"] > 100_000


@pytest.mark.parametrize(
    "case",
    ["chan3d_tet", "gen_allelem_n4", "gen_allelem_ortho", "gen_allelem_var_h5", "gen_pyr_curved", "helmholtz_tq"],
)
def test_ranges_and_box_contain_every_true_value(nektar, case):
    files = [path for path in (nektar / case).iterdir() if path.suffix in (".xml", ".fld")]
    facts = summary(read(*files))
    points, values, names = truth_values(nektar / case / f"{case}.truth.txt")
    assert len(points)
    box = facts["geometry"]["box"]
    assert (points >= np.array(box["lower"])[: points.shape[1]] - 1e-12).all()
    assert (points <= np.array(box["upper"])[: points.shape[1]] + 1e-12).all()
    for name, column in zip(names, values.T, strict=True):
        found = next(field["range"] for field in facts["fields"] if field["name"] == name)
        slack = 1e-11 * (1 + abs(column).max())
        assert found["lower"] - slack <= column.min()
        assert column.max() <= found["upper"] + slack


def test_fourier_directions_span_their_length(nektar, elvis_json):
    facts = elvis_json("info", nektar / "chan3dh1d" / "chan3DH1D.xml", nektar / "chan3dh1d" / "chan3DH1D.fld")
    assert facts["geometry"]["box"] == {"lower": [0, 0, 0], "upper": [1, 1, 1]}
    assert facts["fields"][0]["expansions"][0]["fourier"] == {"lengths": [1.0], "planes": 8}
    assert facts["time"] == pytest.approx(1)


def test_a_mesh_without_fields(nektar, elvis, elvis_json):
    (mesh,) = (nektar / "scale_compressed").glob("*.xml")
    assert elvis_json("info", mesh)["fields"] == []
    assert "triangle" in elvis("info", mesh)


def test_numbers_that_are_not_finite_are_counted(nektar):
    from dataclasses import replace

    dataset = read(nektar / "helmholtz_tq" / "Helmholtz.xml", nektar / "helmholtz_tq" / "Helmholtz.fld")
    block, *others = dataset.fields[0].blocks
    spoiled = block.coefficients.copy()
    spoiled[0, :2], spoiled[1, 0] = np.nan, np.inf
    field = replace(dataset.fields[0], blocks=(replace(block, coefficients=spoiled), *others))
    facts = summary(replace(dataset, fields=(field,)))["fields"][0]
    assert (facts["nan"], facts["infinite"], facts["elements_not_finite"]) == (2, 1, 2)
    assert facts["range"]["upper"] >= 0.9


def test_tables_list_names(elvis, pipe):
    text = elvis("info", *pipe[0], pipe[1])
    for word in ("428 tetrahedron", "136 prism", "positive at all quadrature points", "Modified_C", "221 edges"):
        assert word in text
    assert "│" not in text
    assert all(line == line.rstrip() for line in text.splitlines())


def test_predefined_quantities_are_listed_with_missing_inputs(nektar, elvis, elvis_json):
    files = nektar / "tet_small" / "smallmesh.xml", nektar / "tet_small" / "smallmesh.fld"
    found = {each["name"]: each for each in elvis_json("info", "--quantities", *files)["quantities"]}
    assert found["q_criterion"]["missing"] is None
    assert found["q_criterion"]["source"].startswith("Hunt, Wray and Moin 1988")
    assert found["y_plus"]["missing"] is None  # Kinvis is among the metadata
    assert (
        found["skin_friction"]["missing"]
        == "skin_friction needs u_ref (reference speed): pass --set u_ref=…, or write skin_friction(u_ref=…)"
    )
    assert "the data lack a density: rho" in found["mach"]["missing"]
    assert elvis("info", "--quantities", *files).splitlines()[0].split() == ["quantity", "meaning", "missing"]
    with pytest.raises(click.UsageError, match="found several"):
        elvis("info", "--quantities", "--strict", *files)
    y_plus = elvis_json("info", "--field", "y_plus", *files)["quantities"]["y_plus"]
    assert 0 < y_plus["minimum"] < y_plus["maximum"]
    assert y_plus["upper"] is None


def test_long_tables_are_truncated_with_a_note(nektar, elvis):
    case = nektar / "gen_allelem_var_h5"
    files = case / "CubeAllElements.xml", case / "gen_allelem_var_h5.fld"
    assert "shown by --all" in elvis("info", *files)
    assert "shown by --all" not in elvis("info", *files, "--all")


def test_a_field_without_its_mesh(nektar, elvis):
    with pytest.raises(ElvisError, match="also give the mesh file"):
        elvis("info", nektar / "helmholtz_tq" / "Helmholtz.fld")


def tetrahedron_that_intersects_itself(folder):
    def move(points):
        z = points[:, 2] + 0.6 * (1 + points[:, 0]) * (-1 - points.sum(axis=1))
        return np.column_stack([points[:, :2], z])

    write(Dataset(curved(one_element(Shape.TETRAHEDRON), move, 3)), folder / "bad.xml")
    return folder / "bad.xml"


def test_positive_jacobians_are_proved(elvis, elvis_json, pipe):
    assert elvis("info", "--jacobian", *pipe[0]).startswith("564 of 564 elements have a positive Jacobian everywhere")
    facts = elvis_json("info", "--jacobian", *pipe[0])
    assert (facts["positive"], facts["not_positive"], facts["undecided"], facts["listed"]) == (564, 0, 0, [])
    assert 0 < facts["range"]["lower"] <= facts["range"]["minimum"]


def test_elements_with_negative_jacobian_are_listed_with_a_point(tmp_path):
    path = str(tetrahedron_that_intersects_itself(tmp_path))
    shown = CliRunner().invoke(group, ["info", "--jacobian", path], standalone_mode=False)
    assert str(shown.exception).startswith(
        "expected a positive Jacobian everywhere in every element, found 1 where it is not"
    )
    assert isinstance(shown.exception, ElvisError)
    assert "not positive" in shown.stdout
    facts = json.loads(CliRunner().invoke(group, ["info", "--jacobian", "--json", path]).stdout)
    (row,) = facts["listed"]
    assert (row["element"], row["shape"], row["status"]) == (0, "tetrahedron", "not positive")
    assert row["lower"] <= row["minimum"] < 0
    assert len(row["reference"]) == len(row["world"]) == 3


def test_two_checks_at_once_are_a_usage_error(elvis, pipe):
    with pytest.raises(click.UsageError, match="found several"):
        elvis("info", "--jacobian", "--strict", *pipe[0])


def test_the_range_of_a_quantity(nektar, elvis):
    """u = 1 - z^2 on [-1, 1]^3: its derivative runs from -2 to 2."""
    channel = nektar / "chan3d_tet" / "chan3D.xml", nektar / "chan3d_tet" / "chan3D.fld"
    found = json.loads(elvis("info", "--json", *channel, "--field", "d(u,z)"))["quantities"]["d(u,z)"]
    assert found["lower"] <= -1.99
    assert found["upper"] == pytest.approx(2, abs=0.05)
    assert "d(u,z)" in elvis("info", *channel, "--field", "d(u,z)")


def test_escapes_in_names_are_not_printed(elvis, elvis_json, tmp_path):
    """HDF5 holds any text; tables show it harmless, JSON whole."""
    from dataclasses import replace

    from elvis import Dataset, Shape, write
    from elvis.core.testing import approximated, grid

    name = "u\x1b]0;title\x07\x1b[2J\x9b\u202e\u2066"
    bare = Dataset(grid(Shape.QUADRILATERAL, 2))
    data = replace(bare, fields=(approximated(bare, name, lambda x: x[:, 0], 3),), metadata={"Note": name})
    files = write(data, tmp_path / "m.xml", field_format="hdf5")
    shown = elvis("info", *files) + elvis("norms", *files)
    assert "u?]0;title??[2J" in shown
    assert all(character.isprintable() or character == "\n" for character in shown)
    assert elvis_json("info", *files)["fields"][0]["name"] == name
    table = elvis("probe", *files, "--line", "0,0:1,1", "-n", "2")
    assert "u?]0;title??[2J" in table
    assert all(character.isprintable() or character == "\n" for character in table)


def test_a_map_given_by_fields_is_listed_only_as_map(elvis, elvis_json, tmp_path):
    from elvis.core.testing import approximated, grid

    bare = Dataset(grid(Shape.QUADRILATERAL, 2))
    names = ("map_x", "map_y", "u")
    fields = tuple(approximated(bare, name, lambda x, i=i: x[:, i % 2], 3) for i, name in enumerate(names))
    metadata = {"GeometryMap": "map_x,map_y", "Solver": "ours"}
    files = write(Dataset(bare.mesh, fields, metadata=metadata), tmp_path / "m.xml")
    table = elvis("info", *files)
    assert "map of" in table
    assert "Solver" in table
    assert "map_x" not in table
    assert "GeometryMap" not in table
    assert elvis_json("info", *files)["metadata"]["GeometryMap"] == "map_x,map_y"


def test_extrema_have_positions(nektar, elvis, elvis_json):
    """u = 1 - z^2 on [-1, 1]^3."""
    channel = nektar / "chan3d_tet" / "chan3D.xml", nektar / "chan3d_tet" / "chan3D.fld"
    found = elvis_json("info", *channel, "--extrema", "--field", "u")
    assert list(found) == ["u"]
    assert found["u"]["maximum"]["value"] == pytest.approx(1, abs=1e-12)
    assert found["u"]["maximum"]["position"][2] == pytest.approx(0, abs=1e-5)
    assert abs(found["u"]["minimum"]["position"][2]) == pytest.approx(1)
    assert elvis("info", *channel, "--extrema", "--field", "p").splitlines()[0].split()[:2] == ["quantity", "value"]
    (found,) = elvis_json("info", *channel, "--extrema", "--field", "u^2 + 0.1*z").values()
    turns = np.roots([4, 0, -4, 0.1])  # of (1 - z^2)^2 + z/10
    assert found["maximum"]["value"] == pytest.approx(max((1 - z**2) ** 2 + 0.1 * z for z in turns[1:]), rel=1e-12)


def test_points_on_walls_are_classified(tmp_path, elvis, elvis_json):
    """A fluid that flows to (0.4, 0.6, 0.3) and is at rest on all walls: shear meets on each of them."""
    from elvis.core.testing import approximated, grid

    bare = Dataset(grid(Shape.HEXAHEDRON, 1))
    fields = [
        approximated(bare, name, lambda p, k=k, c=c: (p * (1 - p)).prod(axis=1) * (c - p[:, k]), 4)
        for k, (name, c) in enumerate(zip("uvw", (0.4, 0.6, 0.3), strict=True))
    ]
    files = tmp_path / "box.xml", tmp_path / "box.fld"
    write(Dataset(bare.mesh, tuple(fields)), *files)
    found = elvis_json("info", *files, "--critical", "--wall", "all")
    assert [point["kind"] for point in found["points"]] == ["separation node"] * 6
    places = sorted(point["position"] for point in found["points"])
    assert places[0] == pytest.approx([0, 0.6, 0.3], abs=1e-10)
    assert places[-1] == pytest.approx([1, 0.6, 0.3], abs=1e-10)
    assert found["undecided"] == []
    assert "separation node" in elvis("info", *files, "--critical", "--wall", "all")
    (point,) = elvis_json("info", *files, "--critical")["points"]
    assert (point["kind"], point["index"]) == ("node in", -1)


def test_resolution_of_fields_is_reported(elvis_json, pipe):
    mesh, field = pipe
    facts = elvis_json("info", *mesh, field, "--resolution", "--field", "u")
    assert [own["name"] for own in facts["fields"]] == ["u"]
    assert len(facts["worst"]) == 10
    assert facts["fields"][0]["removed"]["bound"] >= facts["fields"][0]["removed"]["attained"] > 0

    text = CliRunner().invoke(group, ["info", *map(str, mesh), str(field), "--resolution"]).output
    assert "u: resolved: the estimated error is" in text
    row = next(line for line in text.splitlines() if line.startswith("u "))
    assert float(row.split()[-4]) >= facts["fields"][0]["removed"]["bound"]
    assert row.split()[-4].startswith("0.004")
    wrong = CliRunner().invoke(group, ["info", *map(str, mesh), str(field), "--resolution", "--field", "u*v"])
    assert str(wrong.exception) == "--resolution: expected a field of the data (u, v), found u*v"
    bare = CliRunner().invoke(group, ["info", *map(str, mesh), "--resolution"])
    assert str(bare.exception) == "--resolution: the data contain no fields"


def test_resolution_of_a_series_is_reported_for_each_step(elvis, elvis_json, tmp_path):
    """sin(k x) for k = 1 and 4: the error of the second step is larger."""
    mesh = grid(Shape.QUADRILATERAL, 2)
    write(Dataset(mesh), tmp_path / "m.xml")
    for step, wave in enumerate((1, 4)):
        state = replace(with_field(mesh, lambda p, k=wave: np.sin(k * p[:, 0]), 4), time=float(step))
        write(state, tmp_path / "other.xml", tmp_path / f"m_{step}.chk")
    files = (tmp_path / "m.xml", *(tmp_path / f"m_{step}.chk" for step in range(2)))
    steps = elvis_json("info", *files, "--resolution")["steps"]
    assert [step["time"] for step in steps] == [0, 1]
    first, second = (step["fields"][0]["error"]["L2"] for step in steps)
    assert second > 10 * first > 0
    rows = elvis("info", *files, "--resolution").splitlines()[1:3]
    assert [row.split()[:2] for row in rows] == [["0", "u"], ["1", "u"]]
    assert "worst element" in elvis("info", *files, "--resolution", "--step", "0")


@pytest.mark.parametrize(("count", "many", "shown"), [(4, None, 4), (4, 4, 4), (5, 4, 4), (9, 4, 4), (0, 4, 0)])
def test_long_tables_end_with_the_number_of_missing_rows(count, many, shown):
    rows = [(k, f"row {k}", "x", "y") for k in range(count)]
    found = shortened(rows, many)
    assert len(found) == shown
    if count > shown:
        assert found[:-1] == rows[: shown - 1]
        assert found[-1] == ("...", f"{count - shown + 1} more, shown by --all", "", "")
    else:
        assert found == rows


def test_sizes_have_three_digits_and_a_unit():
    sizes = {
        0: "0 bytes",
        999: "999 bytes",
        1000: "1 kB",
        12345: "12.3 kB",
        10**6: "1 MB",
        10**12: "1 TB",
        2 * 10**15: "2e+03 TB",
    }
    assert {size: _size(size) for size in sizes} == sizes
