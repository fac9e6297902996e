"""The sample wing: its flow is that of the closed form, and its files come whole or not at all."""

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import integrate, read
from elvis.core.base.errors import ElvisError
from elvis.core.wall_curves import wall_curves
from elvis.plugins.samples.further_samples import CIRCULATION, cylinder
from elvis.plugins.samples.sample import NAMES, sample, write_sample
from elvis.plugins.samples.sample_data import ANGLE, SPAN, SQUARE, SWEEP, TIP, wing


@pytest.fixture(scope="module")
def dataset():
    return wing()


def test_no_fluid_flows_through_the_wing(dataset):
    """At the wall the velocity lies along the section, an ellipse with the half axes 1 + c² and 1 - c²."""
    rng = np.random.default_rng(0)
    angle, height = rng.uniform(0, 2 * np.pi, 60), rng.uniform(0.1, SPAN - 0.1, 60)
    scale = 1 - (1 - TIP) * height / SPAN
    x = (1 + 1e-9) * (1 + SQUARE) * np.cos(angle) * scale + SWEEP * height
    y = (1 + 1e-9) * (1 - SQUARE) * np.sin(angle) * scale
    normal = np.stack([(1 - SQUARE) * np.cos(angle), (1 + SQUARE) * np.sin(angle)])
    normal /= np.linalg.norm(normal, axis=0)
    velocity = np.stack([dataset["u"](x, y, height), dataset["v"](x, y, height)])
    inside = np.isfinite(velocity).all(axis=0)
    assert inside.sum() > 20
    assert np.abs((velocity * normal).sum(axis=0)[inside]).max() < 0.05


def test_the_flow_is_that_of_bernoulli_and_of_the_free_stream(dataset):
    rng = np.random.default_rng(0)
    angle, height = rng.uniform(0, 2 * np.pi, 40), rng.uniform(0.1, SPAN - 0.1, 40)
    x, y = 3.5 * np.cos(angle) + 0.5 * height, 3.5 * np.sin(angle)
    u, v, p = (dataset[name](x, y, height) for name in "uvp")
    assert p == pytest.approx(0.5 * (1 - u**2 - v**2), abs=2e-4)
    # far away the lift alone changes the stream
    assert np.hypot(u - np.cos(ANGLE), v - np.sin(ANGLE)).max() < 0.1
    assert dataset["w"].range == (0.0, 0.0)


def test_boundaries_have_names(dataset):
    assert dataset.boundaries == ("wing", "far", "symmetry")
    assert dataset.order == 4


def test_the_ring_around_the_cylinder_is_closed():
    """Its boundaries are two circles, also where names of boundaries begin forms of surfaces, such as cylinder."""
    data = cylinder()
    assert data.boundaries == ("cylinder", "far")
    lengths = [integrate(data, "length", over=name).value for name in data.boundaries]
    assert lengths == pytest.approx([2 * np.pi, 10 * np.pi], rel=1e-4)
    ((curve,), _) = wall_curves(data, "boundary:cylinder")
    assert curve.is_closed
    # the wall bears the force of the pressure per span, -rho U circulation (Kutta and Joukowski)
    lift = integrate(data, "0.5*Cp*ny", over="cylinder").value
    assert abs(lift) == pytest.approx(CIRCULATION, rel=1e-3)


def test_files_are_written_once(tmp_path):
    run = CliRunner()
    outcome = run.invoke(sample, ["wing", "-o", str(tmp_path)], standalone_mode=False)
    assert outcome.exception is None
    assert list(read(tmp_path / "wing.xml", tmp_path / "wing.fld")) == ["u", "v", "w", "p"]
    (tmp_path / "wing.xml").unlink()
    outcome = run.invoke(sample, ["-o", str(tmp_path)], standalone_mode=False)
    assert isinstance(outcome.exception, ElvisError)
    assert "wing.fld already exists; choose another folder with -o, or pass --overwrite" in str(outcome.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["wing.fld"]


@pytest.mark.parametrize("name", NAMES)
def test_every_sample_opens_with_a_field(name, tmp_path):
    mesh, *fields = write_sample(name, tmp_path)
    found = read(mesh, fields[-1])
    assert found.mesh.count
    assert all(np.isfinite(found[field].range).all() for field in found)
    assert len(fields) == (9 if name == "wave" else 1)
