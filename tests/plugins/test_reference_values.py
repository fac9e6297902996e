"""Reference values of a flow: from the command line, a scene, a file next to the data, or the solver."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import Dataset, ElvisError, Reference, Scene, Shape, integrate, read, render, with_quantity, write
from elvis.core.quantities import Expression, Names
from elvis.core.testing import approximated, grid
from elvis.plugins.command.command import elvis

CONDITIONS = "<CONDITIONS><PARAMETERS><P> Re = 50 </P><P> Kinvis = 1/Re </P></PARAMETERS></CONDITIONS>"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Shear flow u = y above the wall y = 0 of a square, with a pressure of 3."""
    monkeypatch.chdir(tmp_path)
    bare = Dataset(grid(Shape.QUADRILATERAL, 1))
    functions = {"u": lambda p: p[:, 1], "v": lambda p: 0 * p[:, 0], "p": lambda p: 3 + 0 * p[:, 0]}
    fields = tuple(approximated(bare, name, function, 3) for name, function in functions.items())
    write(Dataset(bare.mesh, fields, session={"CONDITIONS": CONDITIONS}), "a.xml")
    return tmp_path


def run(*words):
    found = CliRunner().invoke(elvis, [str(word) for word in words])
    text = found.stdout if found.exit_code == 0 else f"{found.output}{found.exception}"
    return found.exit_code, text


def values(field, *words):
    status, text = run("probe", "a.xml", "a.fld", "--point", "0.5,0.5", "--field", field, "--json", *words)
    assert status == 0, text
    return json.loads(text)[0][field]


def test_each_way_outdoes_the_next(folder):
    assert read("a.xml", "a.fld").reference == {"nu": 0.02}
    assert values("nu") == pytest.approx(0.02)
    (folder / "a.elvis.toml").write_text("[reference]\nmu = 0.5\nu_ref = 2\np_ref = 1\n")
    assert values("mu") == 0.5
    assert values("pressure_coefficient") == pytest.approx(1)
    assert values("mu", "--set", "mu=0.25") == 0.25
    assert values("pressure_coefficient", "--set", "p_ref=-1 u_ref=1") == pytest.approx(8)
    assert values("pressure_coefficient", "--set", "p_ref=-1", "u_ref=1", "--all") == pytest.approx(8)
    # an expression's own parameters come first
    assert values("pressure_coefficient(u_ref=4)") == pytest.approx(0.25)
    assert read("a.xml", "a.fld", reference={"mu": 7.0}).reference == {"mu": 7, "u_ref": 2, "p_ref": 1}


def test_every_command_uses_them(folder):
    wall = ("--over", "all", "--json")
    status, text = run("integrate", "a.xml", "a.fld", "--field", "viscous_force", *wall, "--set", "mu=4")
    assert status == 0, text
    # the stress mu du/dy = 4 along x: on the bottom along the flow, on the top against it
    assert [row["value"] for row in json.loads(text)] == pytest.approx([0, 0], abs=1e-12)
    settings = ("--set", "rho_ref=2,u_ref=3", "--set", "area=0.5")
    words = ("integrate", "a.xml", "a.fld", "--coefficients", "x", *wall)
    status, text = run(*words, *settings)
    assert status == 0, text
    status, same = run("integrate", "a.xml", "a.fld", "--coefficients", "2,3,0.5,x", *wall)
    assert json.loads(text) == json.loads(same)
    status, text = run("convert", "a.xml", "a.fld", "--add", "q=mu*u", "--set", "mu=3", "-o", "b.fld")
    assert status == 0, text
    assert read("a.xml", "b.fld")["q"](0.5, 0.5) == pytest.approx(1.5)


def test_data_without_a_density_need_no_reference_density(folder):
    """Coefficients as with rho_ref = 1, and a remark; data with a density are asked for one."""
    data = read("a.xml", "a.fld", reference={"mu": 4.0, "u_ref": 3.0, "area": 0.5})
    found, same = (integrate(data, [], over="all", coefficients=text) for text in ("x", "1,3,0.5,x"))
    assert [row.value for row in found] == [row.value for row in same]
    assert any(remark.startswith("rho_ref is taken to be 1") for remark in found.remarks)
    assert not same.remarks
    with pytest.raises(ElvisError, match="expected rho_ref"):
        integrate(with_quantity(data, "rho=2+x", order=1), [], over="all", coefficients="x")


def test_scenes_have_them(folder):
    scene = Scene(data=("a.xml", "a.fld"), field="mu*y", reference=Reference(mu=8.0), size=(12, 12))
    frame = render(scene, device="reference")
    assert np.nanmax(frame.field) == pytest.approx(8, rel=0.1)
    in_memory = render(read("a.xml", "a.fld"), scene=replace(scene, data=()), device="reference")
    assert np.array_equal(in_memory.field, frame.field, equal_nan=True)
    (folder / "s.toml").write_text('data = ["a.xml", "a.fld"]\nfield = "mu"\n[reference]\nmu = 8.0\n')
    size = ("--size", "12x12", "--device", "reference", "--range", "0:9")
    for words, value in ((("s.toml",), 8), (("s.toml", "--set", "mu=5"), 5)):
        status, text = run("render", *words, *size, "-o", "s.npz")
        assert status == 0, text
        assert np.nanmax(np.load("s.npz")["field"]) == value
    status, text = run("render", "s.toml", *size, "--set", "mu=-1", "-o", "t.npz")
    assert status == 1
    assert "mu of the reference values: expected a positive number, found -1.0" in text
    assert not (folder / "t.npz").exists()


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--set", "muu=1"), "there is no reference value 'muu' (perhaps mu); there are gamma, R, mu"),
        (("--set", "mu"), "expected NAME=VALUE, such as mu=2e-4, found 'mu'"),
        (("--set", "mu=-1"), "mu (dynamic viscosity): expected a positive number, found '-1'"),
        (("--set", "gamma=1"), "gamma (ratio of specific heats): expected a number above 1, found '1'"),
        (("--field", "skin_friction"), "u_ref (reference speed): pass --set u_ref=…, or write skin_friction(u_ref=…)"),
        (("--field", "2*u_ref"), "the data don't contain u_ref (reference speed): pass --set u_ref=…"),
    ],
)
def test_bad_values_give_a_one_line_error(folder, words, reason):
    status, text = run("probe", "a.xml", "a.fld", "--point", "0.5,0.5", *words)
    assert status != 0
    assert reason in " ".join(text.split())


def test_bad_files_and_coefficients_give_a_one_line_error(folder):
    status, text = run("integrate", "a.xml", "a.fld", "--coefficients", "x", "--over", "all", "--set", "area=1")
    assert status == 1
    assert "expected u_ref (reference speed), which the data don't contain: pass --set u_ref=…" in text
    for content, reason in [
        ("mu = 1\n", "a.elvis.toml: expected only the table [reference], found mu"),
        ("[reference]\nmu = 'x'\n", "a.elvis.toml: mu (dynamic viscosity): expected a positive number, found 'x'"),
        ("[reference\n", "a.elvis.toml: expected TOML"),
    ]:
        (folder / "a.elvis.toml").write_text(content)
        with pytest.raises(ElvisError) as error:
            read("a.xml", "a.fld")
        assert reason in str(error.value)


def test_fields_come_before_values():
    data = Dataset(grid(Shape.QUADRILATERAL, 1))
    data = with_quantity(data, "mu=x", order=1)
    assert Expression.parse("mu", Names.of(data)).is_field
