"""Means over planes against integrals in closed form, also on the borders of elements and across Fourier directions."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from elvis.converters.commands.average import average
from elvis.core.data.dataset import Block, Dataset, Field, Homogeneous
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid, with_field
from elvis.formats.writing import write
from elvis.plugins.means.plane_means import plane_means


@pytest.mark.parametrize("axis", "xyz")
def test_means_over_planes_of_a_cube(axis):
    """Of x^2 + y z^2 over a plane of the unit cube: 1/3 for a square, 1/2 for a coordinate that varies in the plane."""
    bare = Dataset(grid(Shape.TETRAHEDRON, 2))
    data = replace(bare, fields=(approximated(bare, "u", lambda p: p[:, 0] ** 2 + p[:, 1] * p[:, 2] ** 2, 4),))
    places = np.array([0.0, 0.3, 0.5, 1.0])
    found = plane_means(data, axis, places.tolist())
    truth = {"x": places**2 + 1 / 6, "y": (1 + places) / 3, "z": 1 / 3 + places**2 / 2}[axis]
    assert np.abs(np.array(found.means["u"]) - truth).max() < 1e-12
    assert np.abs(np.array(found.sizes) - 1).max() < 1e-12
    assert found.errors["u"] < 1e-5


def test_places_may_be_numpy_numbers_at_rounded_ends():
    mesh = grid(Shape.HEXAHEDRON, 2)
    noise = 2e-15 * np.random.default_rng(2).normal(size=mesh.vertices.shape)
    bare = Dataset(replace(mesh, vertices=mesh.vertices + noise))
    data = replace(bare, fields=(approximated(bare, "u", lambda p: p[:, 0] + p[:, 2], 2),))
    low, high = (corner[2] for corner in bare.mesh.corners)
    found = plane_means(data, "z", np.array([low, 0.5, high]))
    assert found.sizes == pytest.approx([1, 1, 1], abs=1e-12)
    assert found.means["u"] == pytest.approx([0.5, 1.0, 1.5], abs=1e-12)


def waves():
    """The field y + cos(2 pi z / 3) on a square times the period 3."""
    bare = Dataset(grid(Shape.QUADRILATERAL, 2))
    parts = [approximated(bare, "u", own, 2).blocks[0] for own in (lambda p: p[:, 1], lambda p: 1 + 0 * p[:, 0])]
    zero = np.zeros_like(parts[0].coefficients)
    coefficients = np.concatenate([parts[0].coefficients, zero, parts[1].coefficients, zero], axis=1)
    expansion = replace(parts[0].expansion, homogeneous=Homogeneous((Basis.FOURIER,), (3.0,), (0, 1, 2, 3)))
    return replace(bare, fields=(Field("u", (Block(expansion, parts[0].element_ids, coefficients),)),))


def test_means_over_planes_of_a_fourier_expansion():
    across, along = plane_means(waves(), "z", [0.0, 0.75, 1.0]), plane_means(waves(), "y", [0.25, 0.5])
    assert across.means["u"] == pytest.approx([1.5, 0.5, 0.0], abs=1e-12)
    assert along.means["u"] == pytest.approx([0.25, 0.5], abs=1e-12)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--planes", "0:1:3"], "expected --direction with --planes"),
        (["--direction", "z", "--planes", "0:1:3"], "expected 2D or 3D data with the axis z, found 2D data"),
        (["--direction", "x", "--planes", "0:2:3"], "expected places from 0 to 1 along x, found 2"),
    ],
)
def test_planes_that_miss_give_one_line_errors(tmp_path, options, sentence):
    write(with_field(grid(Shape.QUADRILATERAL, 1), lambda p: p[:, 0]), tmp_path / "a.xml")
    files = [str(tmp_path / name) for name in ("a.xml", "a.fld")]
    outcome = CliRunner().invoke(average, [*files, *options, "-o", str(tmp_path / "p.csv")], standalone_mode=False)
    assert sentence in str(outcome.exception)
    assert not (tmp_path / "p.csv").exists()
