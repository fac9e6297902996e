"""The paper's cases: small ones are made in one run, checked against what they promise, and made again."""

import hashlib
import importlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from elvis import read
from elvis.core.distances import nearest, surface_of
from elvis.core.mapping.geometry import geometry
from elvis.core.mapping.patch import patches
from elvis.core.mapping.pointwise import determinants, positions, values
from elvis.core.testing.meshes import scattered
from elvis.core.validity.validity import ValidityStatus, validity

pytest.importorskip("gmsh")

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SCENES = EXAMPLES / "scenes"
NAMES = ("delta", "wing", "hemisphere", "folded", "twist")


def make(*arguments):
    return subprocess.run(
        [sys.executable, EXAMPLES / "cases.py", *arguments], capture_output=True, text=True, timeout=600
    )


@pytest.fixture(scope="session")
def cases(tmp_path_factory):
    """The folder of the small cases, and what was printed."""
    folder = tmp_path_factory.mktemp("cases")
    process = make("--quick", folder)
    assert process.returncode == 0, process.stderr
    return folder, process.stdout


@pytest.fixture
def module(monkeypatch):
    """A module of examples/ by its name."""
    monkeypatch.syspath_prepend(EXAMPLES)
    return importlib.import_module


def dataset(cases, name):
    return read(cases[0] / f"{name}.xml", cases[0] / f"{name}.fld")


def sides(found):
    return {composite.name for composite in found.mesh.composites}


def test_every_case_is_written_and_counted(cases):
    lines = cases[1].splitlines()
    assert [line.split()[0] for line in lines] == list(NAMES)
    assert all("tetrahedra" in line for line in lines)
    assert all((cases[0] / f"{name}.fld").is_file() for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_all_elements_except_the_invalid_one_are_valid(cases, name):
    found = validity(dataset(cases, name))
    assert found.count(ValidityStatus.POSITIVE) == len(found) - (name == "folded")


@pytest.mark.parametrize(("name", "degree", "order"), [
    ("delta", 1, 3), ("wing", 2, 3), ("hemisphere", 2, 3), ("twist", 4, 7)
])  # fmt: skip
def test_orders_are_as_documented(cases, name, degree, order):
    found = dataset(cases, name)
    assert max(max(block.expansion.modes) for block in geometry(found)) == degree + 1
    assert {block.expansion.modes for field in found.fields for block in field.blocks} == {(order + 1,) * 3}


def test_boundaries_have_names(cases):
    assert {"wing", "symmetry", "far"} <= sides(dataset(cases, "delta"))
    assert {"wing", "symmetry", "far"} <= sides(dataset(cases, "wing"))
    assert {"base", "dome"} <= sides(dataset(cases, "hemisphere"))


@pytest.mark.thorough
def test_output_is_reproducible_byte_by_byte(cases, tmp_path):
    assert make("--quick", tmp_path).returncode == 0
    for path in sorted(tmp_path.iterdir()):
        assert digest(path) == digest(cases[0] / path.name), path.name


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_the_folded_element_shows_its_own_jacobian(cases):
    """Its field is 8 det J, for the straight element has det J = 1/8."""
    (patch,) = patches(dataset(cases, "folded"), ["jacobian"])
    points = scattered(patch.shape, 200)
    rows = np.zeros(len(points), int)
    assert values(patch, 0, rows, points) == pytest.approx(8 * determinants(patch, rows, points), abs=1e-13)
    assert values(patch, 0, rows, points) == pytest.approx(1 - 1.2 * (1 + points[:, 0]), abs=1e-13)


def test_fields_match_their_analytic_expression_on_fine_meshes(cases, module):
    delta = module("delta")
    (patch,) = patches(dataset(cases, "delta"), ["p"])
    points = scattered(patch.shape, len(patch))
    rows = np.arange(len(patch))
    error = values(patch, 0, rows, points) - delta.flow(positions(patch, rows, points))["p"]
    assert np.median(np.abs(error)) < 2e-3


def test_the_swept_wing_is_thin_at_the_wall(cases, module):
    """Elements at the wing are much longer along it than across."""
    found = dataset(cases, "wing")
    (block,) = [block for block in geometry(found) if max(block.expansion.modes) == 3]
    assert validity(found).range.minimum > 0
    spans = np.ptp(block.coefficients[:, :, :4], axis=2)
    assert len(block) > 500
    assert (spans[:, 1] > 5 * spans[:, 2]).sum() > 100


@pytest.mark.thorough
def test_distances_are_right_except_for_the_planted_bug(module):
    delta = module("delta")
    points = np.random.default_rng(0).uniform([-0.5, 0, -0.4], [1.5, 0.6, 0.4], (150, 3))
    weights = np.random.default_rng(1).dirichlet(np.ones(3), 4000)
    surface = np.concatenate([weights @ triangle for triangle in delta.TRIANGLES])
    sampled = np.linalg.norm(points[:, None] - surface, axis=2).min(axis=1)
    exact = delta.distance(points)
    careless = nearest(surface_of(None, str(SCENES / "endless_edges.obj")), points).distance
    assert (exact <= sampled + 1e-12).all()
    assert sampled == pytest.approx(exact, abs=0.012)
    assert (careless <= exact + 1e-12).all()
    assert (careless < exact - 0.05).any()
    above = (points[:, 2] > 0) & (points[:, 0] < 1) & (points[:, 0] > 0) & (points[:, 1] < delta.SLOPE * points[:, 0])
    assert exact[above] == pytest.approx(points[above, 2], abs=1e-12)


def test_unknown_names_are_a_usage_error(tmp_path):
    process = make(tmp_path, "concorde")
    assert process.returncode == 2
    assert "there is no case concorde" in process.stderr
    assert not list(tmp_path.iterdir())
