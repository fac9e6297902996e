"""Elements that a displacement with jumps takes apart: both sides of a gap are outer ones for every command."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, Shape, boundary_data, deform, integrate, sample, trace
from elvis.core.data.dataset import Field
from elvis.core.data.mesh import Composite
from elvis.core.deformed.deforming import undeformed
from elvis.core.interfaces.interface_composites import with_interfaces
from elvis.core.mapping.connectivity import connected
from elvis.core.testing import approximated, grid, mixed_volume
from elvis.plugins.faces import faces_of
from elvis.plugins.runtime.serving import volume_of

SOLIDS = [shape for shape in Shape if shape.dimension == 3]
GAP = 0.5


def halves_apart(mesh, gap=GAP, step=lambda x: np.where(x[:, 0] > 0.5, 1.0, 0.0)):
    """A mesh whose half x > 0.5 moves along x, with a velocity (u, v, w) = (1, 0, 0)."""
    bare, axes = Dataset(mesh), "uvw"[: mesh.dimension]
    one = {name: approximated(bare, name, lambda p, name=name: np.full(len(p), float(name == "u")), 2) for name in axes}
    data = replace(bare, fields=(approximated(bare, "d", step, 3), *one.values()))
    return data, deform(data, ",".join(("d", "0", "0")[: mesh.dimension]), gap)


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1])
def test_both_sides_of_a_gap_are_boundary(shape):
    """Two boxes of 0.5 x 1 (x 1): their area and their flux, which is the dimension times the volume."""
    dimension = shape.dimension
    data, bent = halves_apart(grid(shape, 2))
    closed = deform(data, ",".join("d00"[:dimension]), 0.0)
    normal_flux = " + ".join(f"{axis}*n{axis}" for axis in "xyz"[:dimension])
    for each, area in ((closed, 2 * dimension), (bent, 2 * dimension + 2)):
        assert integrate(each, "1", over="all").value == pytest.approx(area, rel=1e-12)
        assert integrate(each, normal_flux, over="all").value == pytest.approx(dimension, rel=1e-12)
        assert integrate(boundary_data(each, "all"), "1").value == pytest.approx(area, rel=1e-12)

    # the gap is outside, and a line that starts on its left ends there
    inside, outside = sample(bent, "u", np.array([[0.3, 0.3, 0.2], [0.75, 0.3, 0.2]])[:, :dimension])["u"]
    assert (inside, np.isnan(outside)) == (pytest.approx(1.0), True)
    seed = np.array([[0.2, 0.31, 0.17 * (dimension > 2)]])
    line = trace(bent, seed, "u,v,w"[: 2 * dimension - 1])
    assert line.points[:, 0].max() == pytest.approx(0.5, abs=1e-12)
    assert undeformed(bent).mesh is data.mesh
    assert deform(bent, ",".join("d00"[:dimension]), 0.0).mesh is data.mesh


@pytest.mark.parametrize("shape", SOLIDS)
def test_faces_of_a_gap_are_drawn(shape):
    _, bent = halves_apart(grid(shape, 2))
    faces = faces_of(bent, volume_of(bent, ["d"]))
    chosen = zip(faces.blocks, faces.select(("all",)), strict=True)
    planes = [block.nets(rows)[..., 0] for block, rows in chosen if len(rows)]
    middles = np.concatenate([own.mean(axis=1) for own in planes])
    is_flat = np.concatenate([np.ptp(own, axis=1) < 1e-12 for own in planes])
    # sides at both ends of each half, as many each
    counts = [np.count_nonzero(is_flat & (np.abs(middles - end) < 1e-9)) for end in (0.0, 0.5, 1.0, 1.5)]
    assert len(set(counts)) == 1
    assert counts[0] > 0


def test_continuous_displacements_and_tiny_jumps_leave_the_mesh():
    mesh = mixed_volume(3)
    data, bent = halves_apart(mesh, step=lambda x: x[:, 0] ** 2 - x[:, 1])
    assert bent.mesh is data.mesh
    data, bent = halves_apart(mesh, gap=1e-13)
    assert bent.mesh is data.mesh


def test_fields_in_single_precision_have_jumps_of_their_rounding():
    data, _ = halves_apart(grid(Shape.HEXAHEDRON, 2))
    (block,) = data.field("d").blocks
    noise = np.random.default_rng(1).standard_normal(block.coefficients.shape)
    for size, is_split in ((1e-7, False), (1e-4, True)):
        coefficients = (1 + size * noise).astype(np.float32).astype(float)
        field = Field("d", (replace(block, coefficients=coefficients),))
        own = replace(data, fields=(field,))
        assert (deform(own, "d,d,d").mesh is not data.mesh) == is_split


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.HEXAHEDRON])
def test_boundaries_that_hold_a_side_hold_both(shape):
    mesh = grid(shape, 2)
    kind = Shape.SEGMENT if shape.dimension == 2 else Shape.QUADRILATERAL
    every = Composite(7, (("E" if shape.dimension == 2 else "F", mesh.of(kind).ids),), "wall")
    data, bent = halves_apart(replace(mesh, composites=(*mesh.composites, every)))
    assert integrate(bent, "1", over="wall").value == pytest.approx(integrate(data, "1", over="wall").value + 1)


def test_non_conforming_sides_that_come_apart_are_boundary():
    """A square next to two of half its height: a gap, and a displacement that keeps them together."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [2, 0.5], [1, 0.5], [2, 1]])
    squares = np.array([[0, 1, 2, 3], [1, 4, 5, 6], [6, 5, 7, 2]])
    mesh = connected(np.pad(corners, ((0, 0), (0, 1))), {Shape.QUADRILATERAL: squares}, 2)
    joined = with_interfaces(Dataset(mesh), None, 1e-16).dataset
    assert integrate(joined, "1", over="all").value == pytest.approx(6)
    for step, length in ((lambda p: np.where(p[:, 0] > 1, 1.0, 0.0), 8.0), (lambda p: 0.5 * p[:, 0], 7.0)):
        own = replace(joined, fields=(approximated(joined, "d", step, 3),))
        assert integrate(deform(own, "d,0", GAP), "1", over="all").value == pytest.approx(length)
