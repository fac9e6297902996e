import csv
import json
from dataclasses import replace

import pytest
from archives import arrays_of
from click.testing import CliRunner

from elvis import Dataset, ElvisError, Shape, integrate, read, write
from elvis.core.base.rounded_up import rounded_up
from elvis.core.testing import grid, with_field
from elvis.plugins.command.command import elvis as group

KEYS = ["over", "integrand", "value", "error", "estimate", "measure", "exact", "kind", "finished"]


@pytest.fixture
def channel(nektar):
    """Six tetrahedra that fill the cube [-1, 1]^3, with u = 1 - z^2."""
    return nektar / "chan3d_tet" / "chan3D.xml", nektar / "chan3d_tet" / "chan3D.fld"


def test_the_contract_of_scripts(channel, elvis_json):
    found = elvis_json("integrate", *channel, "--field", "u", "--field", "volume")
    assert [list(row) for row in found] == [KEYS] * 2
    assert [row["value"] for row in found] == pytest.approx([16 / 3, 8], rel=1e-13)
    assert [row["exact"] for row in found] == [True, True]
    assert all(0 < row["error"] < 1e-12 for row in found)


def test_unbounded_errors_are_estimates(channel, elvis, elvis_json):
    """Rules that are compared along a curve don't prove an error."""
    asked = ["integrate", *channel, "--field", "exp(u)", "--over", "line:0,0,-1:0.1,0.2,1"]
    (row,) = elvis_json(*asked)
    assert (row["kind"], row["error"]) == ("estimate", None)
    assert row["estimate"] > 0
    assert "(estimate)" in elvis(*asked)


def test_a_row_for_each_boundary_and_a_total(channel, elvis):
    rows = elvis("integrate", *channel, "--field", "area", "--over", "all").splitlines()
    assert rows[0].split() == ["over", "integrand", "value", "error", "measure"]
    values = [float(row.split()[2]) for row in rows[1:]]
    assert rows[-1].startswith("total")
    assert values[-1] == pytest.approx(24, rel=1e-13)
    assert sum(values[:-1]) == pytest.approx(24, rel=1e-13)


def test_files_of_both_kinds(channel, elvis, tmp_path):
    for name in ("found.csv", "found.npz"):
        assert elvis("integrate", *channel, "--field", "min(u, v)", "-o", tmp_path / name) == ""
    with (tmp_path / "found.csv").open() as file:
        (row,) = csv.DictReader(file)
    archive = arrays_of(tmp_path / "found.npz")
    assert list(row) == list(archive) == KEYS
    assert (row["over"], row["integrand"], row["exact"]) == ("domain", "min(u, v)", "0")
    assert float(row["value"]) == archive["value"][0]


def test_python_gives_the_same_result(channel, elvis_json):
    found = integrate(read(*channel), "p*nx", over="all")
    assert found.value == elvis_json("integrate", *channel, "--field", "p*nx", "--over", "all")[-1]["value"]
    assert repr(found).splitlines()[0].split() == ["over", "integrand", "value", "error", "measure"]
    assert float(found) == found[-1].value == found.of("p*nx").value


def test_an_unreached_tolerance_is_reported(channel, elvis, capsys, monkeypatch):
    told = []
    monkeypatch.setattr("elvis.core.base.terminal.warn", told.append)
    monkeypatch.setattr("elvis.core.integrals.refinement._MOST", 1 << 14)
    elvis("integrate", *channel, "--field", "abs(x - 0.1*y)", "--error", "1e-12")
    assert len(told) == 1
    assert "1e-12 was requested" in told[0]


def test_unsupported_integrals_are_rejected(channel, elvis):
    with pytest.raises(ElvisError, match=r"there is no boundary 'roof'; there are domain, all, "):
        elvis("integrate", *channel, "--field", "u", "--over", "roof")
    with pytest.raises(Exception, match="expected --field"):
        elvis("integrate", *channel)


def test_integrals_over_a_series(elvis, elvis_json, tmp_path):
    """u = t on the unit square at times 0, 1 and 2."""
    mesh = grid(Shape.QUADRILATERAL, 1)
    write(Dataset(mesh), tmp_path / "m.xml")
    for step in range(3):
        state = replace(with_field(mesh, lambda p, step=step: 0 * p[:, 0] + step, 2), time=float(step))
        write(state, tmp_path / "other.xml", tmp_path / f"m_{step}.chk")
    files = (tmp_path / "m.xml", *(tmp_path / f"m_{step}.chk" for step in range(3)))
    found = elvis_json("integrate", *files, "--field", "u", "--field", "area", "--times", "0:2:5")
    assert [row["value"] for row in found if row["integrand"] == "u"] == pytest.approx([0, 0.5, 1, 1.5, 2])
    assert [row["time"] for row in found if row["integrand"] == "area"] == [0, 0.5, 1, 1.5, 2]
    outputs = ("-o", tmp_path / "u.csv", "--plot", tmp_path / "u.svg")
    assert elvis("integrate", *files, "--field", "u", "--times", "all", *outputs) == ""
    rows = list(csv.DictReader((tmp_path / "u.csv").read_text().splitlines()))
    assert [float(row["value"]) for row in rows] == pytest.approx([0, 1, 2])
    assert (tmp_path / "u.svg").read_text().startswith("<?xml")
    with pytest.raises(Exception, match="expected --plot with --times"):
        elvis("integrate", *files, "--field", "u", "--plot", tmp_path / "u.svg")


def test_a_histogram_by_volume(channel, elvis, elvis_json, tmp_path):
    """Of x and 1 + |x| in the cube [-1, 1]^3, in halves and in a table, a file and a plot."""
    found = elvis_json("integrate", *channel, "--field", "x", "--field", "1 + abs(x)", "--histogram", "2")
    assert [list(row) for row in found] == [["quantity", "low", "high", "share"]] * 4
    assert [row["share"] for row in found] == pytest.approx([0.5] * 4, abs=0.02)
    outputs = ("-o", tmp_path / "shares.csv", "--plot", tmp_path / "shares.svg")
    assert elvis("integrate", *channel, "--field", "x", "--histogram", "8", *outputs) == ""
    with (tmp_path / "shares.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8
    assert sum(float(row["share"]) for row in rows) == pytest.approx(1)
    assert (tmp_path / "shares.svg").read_text().startswith("<?xml")
    with pytest.raises(Exception, match="--histogram: expected --field"):
        elvis("integrate", *channel, "--field", "x", "--histogram", "8", "--over", "all")


def interrupted_round(monkeypatch, number):
    """Ctrl-C while boxes are refined, in a round."""
    from elvis.core.integrals.refinement import Summation

    refine, rounds = Summation._round, []

    def stopped(self, *arguments):
        rounds.append(None)
        if len(rounds) == number:
            raise KeyboardInterrupt
        return refine(self, *arguments)

    monkeypatch.setattr(Summation, "_round", stopped)


def test_an_interrupt_prints_partial_results_on_request(channel, monkeypatch):
    asked = ["integrate", *map(str, channel), "--field", "abs(x - 0.1*y)", "--error", "1e-9"]
    with monkeypatch.context() as patch:
        interrupted_round(patch, 3)
        outcome = CliRunner().invoke(group, [*asked, "--best-effort", "--json"], standalone_mode=False)
    assert outcome.exit_code == 130
    (row,) = json.loads(outcome.stdout)
    assert row["finished"] is False
    assert row["kind"] == "bound"
    (truth,) = integrate(read(*channel), "abs(x - 0.1*y)", error=1e-4)
    assert abs(row["value"] - truth.value) <= row["error"] + truth.error
    with monkeypatch.context() as patch:
        interrupted_round(patch, 3)
        with pytest.raises(KeyboardInterrupt):
            integrate(read(*channel), "abs(x - 0.1*y)", error=1e-9)


def test_progress_reports_the_error_reached(channel, monkeypatch):
    from elvis.renderer.commands import integrate as command

    lines, reached = [], []
    monkeypatch.setattr("elvis.core.base.terminal.announce", lines.append)
    integrate(read(*channel), "abs(x - 0.1*y)", error=1e-3, reached=reached.append)
    assert reached[-1] <= 1e-3 < reached[0]
    monkeypatch.setattr(command, "REPORT_AFTER", 0.0)
    report = command.reporter()
    for error in reached:
        report(error)
    assert lines[0] == f"error reached so far: {rounded_up(reached[0])} of the integral of the absolute value"
