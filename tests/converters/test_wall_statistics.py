"""Wall shear averaged over a series, against closed forms."""

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import Dataset, Shape, from_arrays, read, write
from elvis.core.testing import approximated, grid
from elvis.plugins.command.command import elvis

#: of u = c (1 + x) y at each step; the viscosity
FACTORS, MU = (1.0, -0.5, 2.0, -1.0), 0.25
TIMES = (0.0, 1.0, 3.0, 4.0)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Shear flows in a square that change their sense; on the bottom y = 0 the shear is mu c (1 + x) along x."""
    monkeypatch.chdir(tmp_path)
    bare = Dataset(grid(Shape.QUADRILATERAL, 1))
    for number, (factor, time) in enumerate(zip(FACTORS, TIMES, strict=True)):
        flow = {"u": lambda p, c=factor: c * (1 + p[:, 0]) * p[:, 1], "v": lambda p: 0 * p[:, 0]}
        fields = tuple(approximated(bare, name, function, 3) for name, function in flow.items())
        write(Dataset(bare.mesh, fields, time=time), f"run_{number}.xml")
    (tmp_path / "run_0.xml").rename("mesh.xml")
    return tmp_path


def run(*words):
    found = CliRunner().invoke(elvis, [*words])
    return found.exit_code, f"{found.output}{found.exception or ''}"


@pytest.mark.parametrize("over", ["steps", "time"])
def test_means_of_shear_that_changes_sign(folder, over):
    words = ("--over", over, "--set", f"mu={MU}", "-o", "shear.xml")
    status, text = run("average", "mesh.xml", "run_*.fld", "--wall", "all", *words)
    assert status == 0, text
    wall = read("shear.xml", "shear.fld")
    weights = np.array([1, 1, 1, 1]) / 4 if over == "steps" else np.array([0.5, 1.5, 1.5, 0.5]) / 4
    size, mean = weights @ np.abs(FACTORS), abs(weights @ np.array(FACTORS))
    for x in (0.2, 0.7):
        assert wall["TAWSS"](x, 0.0) == pytest.approx(MU * size * (1 + x), rel=1e-10)
        assert abs(wall["shear_x"](x, 0.0)) == pytest.approx(MU * mean * (1 + x), rel=1e-10)
        assert wall["OSI"](x, 0.0) == pytest.approx((1 - mean / size) / 2, rel=1e-9)
        assert wall["TAAFI"](x, 0.0) == pytest.approx(abs(weights @ np.sign(FACTORS)), rel=1e-10)
        assert wall["RRT"](x, 0.0) == pytest.approx(1 / (MU * mean * (1 + x)), rel=1e-9)
        assert wall["WSSG"](x, 0.0) == pytest.approx(MU * mean, rel=1e-8)


@pytest.mark.parametrize(
    ("shear", "gradient"),
    [
        (lambda x, y: (x, y), lambda x, y: np.sqrt(2)),
        (lambda x, y: (x**2, 0 * x), lambda x, y: 2 * x),
        (lambda x, y: (0 * x, 1 + x + y), lambda x, y: 1.0),
    ],
)
def test_gradients_of_the_mean_shear_along_and_across_it(shear, gradient):
    """The growth of a radial shear in both directions; of parallel ones only along them."""
    lattice = np.array([[x, y] for y in (-1, 0, 1) for x in (-1, 0, 1)], float)
    places = np.column_stack([lattice / 2 + 1, 0 * lattice[:, 0]])
    values = dict(zip(("shear_x", "shear_y"), shear(*places[:, :2].T), strict=True))
    fields = {name: own[None] for name, own in {**values, "shear_z": 0 * places[:, 2]}.items()}
    wall = from_arrays({"quadrilateral": places[None]}, fields, reference={"quadrilateral": lattice})
    for x, y in ((0.7, 0.6), (1.2, 1.1)):
        assert wall["WSSG"](x, y, 0.0) == pytest.approx(gradient(x, y), rel=1e-10)


def shear_over(z_shears):
    """Statistics of flows u = (3, s) z, or others, over the bottom z = 0 of a cube, and the printed text."""
    bare = Dataset(grid(Shape.HEXAHEDRON, 1))
    for number, (along, across) in enumerate(z_shears):
        flow = {"u": lambda p, s=along: s * p[:, 2], "v": lambda p, s=across: s * p[:, 2], "w": lambda p: 0 * p[:, 0]}
        fields = tuple(approximated(bare, name, function, 2) for name, function in flow.items())
        write(Dataset(bare.mesh, fields, time=number), f"run_{number}.xml")
    status, text = run("average", "run_0.xml", "run_*.fld", "--wall", "all", "--set", f"mu={MU}", "-o", "shear.xml")
    assert status == 0, text
    return read("shear.xml", "shear.fld"), text


def test_shear_across_its_mean(tmp_path, monkeypatch):
    # on the bottom z = 0 the shear is mu (3, s) with s = 1, -1: its mean is mu (3, 0), across it mu
    monkeypatch.chdir(tmp_path)
    wall, _ = shear_over([(3.0, 1.0), (3.0, -1.0)])
    assert wall["transWSS"](0.3, 0.6, 0.0) == pytest.approx(MU, rel=1e-10)
    assert wall["TAWSS"](0.3, 0.6, 0.0) == pytest.approx(MU * np.sqrt(10), rel=1e-10)
    assert wall["TAAFI"](0.3, 0.6, 0.0) == pytest.approx(3 / np.sqrt(10), rel=1e-10)
    assert wall["TACFI"](0.3, 0.6, 0.0) == pytest.approx(1 / np.sqrt(10), rel=1e-10)


def test_rounding_of_the_mean_has_no_direction(tmp_path, monkeypatch):
    """A shear that turns by a third of a circle at each step: its mean is zero but for rounding."""
    monkeypatch.chdir(tmp_path)
    angles = 2 * np.pi * np.arange(3) / 3
    wall, text = shear_over(zip(np.cos(angles), np.sin(angles), strict=True))
    assert "exact to the rounding" in text
    assert wall["transWSS"](0.3, 0.6, 0.0) == pytest.approx(MU, rel=1e-10)
    assert wall["OSI"](0.3, 0.6, 0.0) == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--wall", "all", "-o", "a.xml"), "needs mu (dynamic viscosity)"),
        (("--wall", "al", "--set", "mu=1", "-o", "a.xml"), "there is no boundary 'al'"),
        (("--wall", "all", "--set", "mu=1", "-o", "a.fld"), "expected --wall with -o NAME.xml"),
        (("--wall", "all", "--covariances", "--set", "mu=1", "-o", "a.xml"), "without --covariances"),
    ],
)
def test_bad_input_gives_one_line_errors(folder, words, reason):
    status, text = run("average", "mesh.xml", "run_*.fld", *words)
    assert status != 0
    assert reason in " ".join(text.split())
    assert not (folder / "a.xml").exists()
