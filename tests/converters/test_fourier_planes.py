"""Means along Fourier directions, against integrals over the whole period; planes across them, against values there."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import Dataset, ElvisError, Shape, integrate, read, write
from elvis.core.dataset import Field, Homogeneous
from elvis.core.polynomials.bases import Basis
from elvis.core.quantities import Expression
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.core.wall_curves import at_walls
from elvis.plugins.command import elvis

PERIOD = 2.5


def spanwise(planes):
    """Plane data whose field u has another function on each plane of Fourier coefficients."""
    mesh = curved(grid(Shape.QUADRILATERAL, 2), ripple(0.04), 3)
    waves = Homogeneous((Basis.FOURIER,), (PERIOD,), tuple(range(planes)))
    blocks = []
    functions = [lambda p, k=k: (k + 1) * p[:, 0] - k * p[:, 1] ** 2 + 1 for k in range(planes)]
    of_planes = [approximated(Dataset(mesh), "u", function, 4) for function in functions]
    for block in of_planes[0].blocks:
        number = of_planes[0].blocks.index(block)
        coefficients = np.hstack([own.blocks[number].coefficients for own in of_planes])
        expansion = replace(block.expansion, homogeneous=waves)
        blocks.append(replace(block, expansion=expansion, coefficients=coefficients))
    return Dataset(mesh, (Field("u", tuple(blocks)),)), of_planes[0]


@pytest.mark.parametrize("planes", [2, 4])
def test_the_mean_is_the_integral_by_the_period(tmp_path, monkeypatch, planes):
    monkeypatch.chdir(tmp_path)
    data, constant = spanwise(planes)
    write(data, "a.xml")
    found = CliRunner().invoke(elvis, ["average", "a.xml", "a.fld", "--direction", "z", "-o", "mean.xml"])
    assert found.exit_code == 0, found.output
    mean = read("mean.xml", "mean.fld")
    for text in ("u", "u*x"):
        whole = integrate(data, text, error=1e-9).value
        assert integrate(mean, text).value == pytest.approx(whole / PERIOD, rel=1e-10)
    assert mean["u"](0.4, 0.3) == pytest.approx(Dataset(mean.mesh, (constant,))["u"](0.4, 0.3), abs=1e-13)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--direction", "x", "-o", "b.xml"), "with a Fourier direction along x, found one along z"),
        (("--direction", "z", "-o", "b.fld"), "expected --direction with -o NAME.xml"),
        (("--direction", "z", "--covariances", "-o", "b.xml"), "without --covariances"),
    ],
)
def test_bad_input_gives_one_line_errors(tmp_path, monkeypatch, words, reason):
    monkeypatch.chdir(tmp_path)
    write(spanwise(2)[0], "a.xml")
    found = CliRunner().invoke(elvis, ["average", "a.xml", "a.fld", *words])
    assert found.exit_code != 0
    assert reason in f"{found.output}{found.exception}"
    assert not (tmp_path / "b.xml").exists()


def test_plane_data_have_no_fourier_planes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mesh = grid(Shape.QUADRILATERAL, 1)
    write(Dataset(mesh, (approximated(Dataset(mesh), "u", lambda p: p[:, 0], 2),)), "a.xml")
    found = CliRunner().invoke(elvis, ["average", "a.xml", "a.fld", "--direction", "z", "-o", "b.xml"])
    assert found.exit_code == 1
    assert "with a Fourier direction, found none" in str(found.exception)


def test_points_do_not_snap_to_walls_along_fourier_directions():
    data, _ = spanwise(2)
    with pytest.raises(ElvisError, match="all: expected data without Fourier directions"):
        at_walls(data, "all", np.array([[0.5, 0.0, 0.3]]), [Expression.of(data, "u")])


@pytest.mark.parametrize("plane", ["0,0,0.7:0,0,2", "z=3.2"])
def test_planes_have_the_values_of_their_position(tmp_path, monkeypatch, plane):
    """The second plane is one period further."""
    monkeypatch.chdir(tmp_path)
    data, _ = spanwise(4)
    write(data, "a.xml")
    found = CliRunner().invoke(elvis, ["extract", "a.xml", "a.fld", "--plane", plane, "-o", "plane.xml"])
    assert found.exit_code == 0, found.output
    cut = read("plane.xml", "plane.fld")
    for x, y in ((0.4, 0.3), (0.8, 0.6)):
        assert cut["u"](x, y) == pytest.approx(data["u"](x, y, 0.7), abs=1e-12)
    for wrong, reason in [
        ("0,0,0:1,0,1", "expected a plane across an axis"),
        ("0.5,0,0:1,0,0", "with a Fourier direction along x, found one along z"),
        ("z=a", "expected P:N or z=0.5"),
    ]:
        words = ["extract", "a.xml", "a.fld", "--plane", wrong, "-o", "none.xml"]
        done = CliRunner().invoke(elvis, words)
        assert done.exit_code != 0
        assert reason in f"{done.output}{done.exception}"
        assert not (tmp_path / "none.xml").exists()
