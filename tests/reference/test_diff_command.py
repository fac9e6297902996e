"""`elvis diff`: tables, files, reports, gates."""

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from elvis import write
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid
from elvis.plugins.command.command import elvis as group


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Names of data that hold sin(2 x + y) on meshes of squares, order 2, and of triangles, order 6."""
    folder, found = tmp_path_factory.mktemp("diff"), {}
    for name, shape, count, modes in (
        ("a", Shape.QUADRILATERAL, 2, 3),
        ("b", Shape.QUADRILATERAL, 4, 3),
        ("same", Shape.QUADRILATERAL, 4, 4),
        ("t", Shape.TRIANGLE, 2, 7),
    ):
        mesh = grid(shape, count)
        field = approximated(Dataset(mesh), "p", lambda p: np.sin(2 * p[:, 0] + p[:, 1]), modes)
        write(Dataset(mesh, (field,)), folder / f"{name}.xml", folder / f"{name}.fld")
        found[name] = f"{folder / name}.xml,{folder / name}.fld"
    return found


def run(*arguments):
    outcome = CliRunner().invoke(group, ["diff", "--error=0.5", *map(str, arguments)], standalone_mode=False)
    if outcome.exception:
        raise outcome.exception
    return outcome.stdout


def test_the_contract_of_scripts(files):
    found = json.loads(run(files["b"], files["same"], "--json"))
    assert list(found) == ["p"]
    names = ["L1", "L2", "H1", "Linf", "Linf_bound", "where", "element", "relative", "covered"]
    assert list(found["p"]) == [*names, "L1_error", "L2_error", "H1_error", "covered_error"]
    assert found["p"]["Linf"] <= found["p"]["Linf_bound"] <= found["p"]["Linf"] * (1 + 1e-6)
    elsewhere = json.loads(run(files["b"], files["t"], "--json"))["p"]
    assert elsewhere["Linf"] <= elsewhere["Linf_bound"] <= elsewhere["Linf"] * 1.1


def test_a_gate(files):
    assert "p" in run(files["b"], files["b"], "--max", "1e-12")
    with pytest.raises(ElvisError, match=r"--max 1e-08: p differs by up to 0\.00\d+, at "):
        run(files["b"], files["same"], "--max", "1e-8")


@pytest.mark.thorough
def test_a_report_of_a_family(files, tmp_path):
    report = tmp_path / "report"
    table = run(files["a"], files["b"], files["t"], "-o", report, "--no-maps").splitlines()
    assert table[0].split()[-3:] == ["order", "of", "L2"]
    assert float(table[-1].split()[-1]) == pytest.approx(3, abs=0.1)
    assert {path.name for path in report.rglob("*.*")} == {"index.html", "summary.json", "report.json", "order.svg"}
    numbers = json.loads((report / "summary.json").read_text())
    assert numbers["orders"]["p"][0] is None
    assert "Order of convergence" in (report / "index.html").read_text()
    (tmp_path / "small.toml").write_text("size = [60, 40]\n")
    run(files["b"], files["same"], "-o", report, "--scene", tmp_path / "small.toml")
    assert not (report / "plots").exists()
    images = [np.asarray(Image.open(report / "pictures" / f"0-{number}.png")) for number in range(3)]
    assert [image.shape[:2] for image in images] == [(40, 60)] * 3
    assert np.abs(images[0].astype(int) - images[1]).max() < 32 < np.abs(images[0].astype(int) - images[2]).max()
    page = (report / "index.html").read_text()
    assert page.count("<h2>Maps of p</h2>") == 1
    greatest = json.loads((report / "summary.json").read_text())["members"][0]["fields"]["p"]["Linf"]
    low, high = re.search(r"less same.xml,same.fld</b>: (\S+) to ([\d.e-]+)", page).groups()
    assert -float(low) == float(high) == pytest.approx(greatest, rel=0.2)
    run(files["a"], files["b"], files["t"], "-o", tmp_path / "table.csv")
    assert (tmp_path / "table.csv").read_text().startswith("data,field,elements,size,L1,L1_order")


def test_moments_of_series(files, tmp_path):
    """A series that grows with time, next to itself at its last step; a single state has no moments."""
    mesh = grid(Shape.QUADRILATERAL, 2)
    for step in range(3):
        field = approximated(Dataset(mesh), "p", lambda p, step=step: (1 + step) * p[:, 0], 3)
        write(Dataset(mesh, (field,), float(step)), tmp_path / "s.xml", tmp_path / f"s_{step}.chk")
    series, last = f"{tmp_path}/s.xml,{tmp_path}/s_*.chk", f"{tmp_path}/s.xml,{tmp_path}/s_2.chk"
    for how, off in ((["--step", "1"], 1.0), (["--time", "0.5"], 1.5), ([], 0.0)):
        assert json.loads(run(series, last, *how, "--json"))["p"]["Linf"] == pytest.approx(off, abs=1e-12)
    with pytest.raises(ElvisError, match="--step, --time: expected a series among the solutions, found none"):
        run(last, files["b"], "--time", "0.5")


def test_wrong_use(files, tmp_path):
    with pytest.raises(Exception, match="expected at least two datasets"):
        run(files["a"])
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes").write_text("mine")
    with pytest.raises(ElvisError, match="a folder of other things"):
        run(files["a"], files["b"], "-o", tmp_path / "other")
    with pytest.raises(Exception, match="--scene: expected with the maps of a report"):
        run(files["a"], files["b"], "--scene", tmp_path / "scene.toml")
    with pytest.raises(ElvisError, match=r"scene\.toml: there is no such file"):
        run(files["a"], files["b"], "--scene", tmp_path / "scene.toml", "-o", tmp_path / "report")
    with pytest.raises(Exception, match=r"-1\.0 is not in the range x>=0"):
        run(files["a"], files["b"], "--max=-1")
