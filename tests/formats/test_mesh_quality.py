"""Measures of elements against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.core.data.dataset import Block, Dataset, Field, Homogeneous
from elvis.core.numbers.mesh_quality import mesh_quality
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid

WIDTH, HEIGHT, SPEED, ORDER = 0.5, 0.1, 3.0, 4


@pytest.mark.parametrize("shape", [Shape.QUADRILATERAL, Shape.HEXAHEDRON])
def test_boxes_have_closed_forms(shape):
    d = shape.dimension
    sides = np.array([WIDTH, HEIGHT, 1.0])[:d]
    mesh = curved(grid(shape, 1), lambda p: p * [WIDTH, HEIGHT, 1.0], 2)
    flow = {"u": SPEED, "v": SPEED / 10, "w": 0.0}
    fields = [approximated(Dataset(mesh), name, lambda p, c=c: c + 0 * p[:, 0], ORDER + 1) for name, c in flow.items()]
    found = mesh_quality(Dataset(mesh, tuple(fields[:d])))
    expected = {
        "quality": d * sides.prod() ** (2 / d) / (sides**2).sum(),
        "scaled_jacobian": 1.0,
        "jacobian_ratio": 1.0,
        "edge_ratio": sides.max() / sides.min(),
        "h": sides.prod() ** (1 / d),
        # grad xi is 2 / side; the y direction limits: 0.3/0.1 against 3/0.5 is 3 against 6
        "time_step": 1 / (0.2 * ORDER**2 * 2 * SPEED / WIDTH),
    }
    assert {name: float(own[0]) for name, own in found.measures.items()} == pytest.approx(expected, rel=1e-12)


def test_time_steps_count_all_planes_of_fourier_directions():
    """The velocity 3 + 2 cos(2 pi z) along x: at most 5."""
    mesh = curved(grid(Shape.QUADRILATERAL, 1), lambda p: p * [WIDTH, HEIGHT, 1.0], 2)
    waves = Homogeneous((Basis.FOURIER,), (1.0,), (0, 1, 2, 3))
    one = approximated(Dataset(mesh), "u", lambda p: 1 + 0 * p[:, 0], ORDER + 1).blocks[0]
    fields = []
    for name, factors in (("u", (3, 0, 2, 0)), ("v", (0, 0, 0, 0)), ("w", (1, 0, 0, 0))):
        expansion = replace(one.expansion, homogeneous=waves)
        fields.append(Field(name, (Block(expansion, one.element_ids, np.kron(factors, one.coefficients)),)))
    found = mesh_quality(Dataset(mesh, tuple(fields)))
    assert found.measures["time_step"] == pytest.approx(1 / (0.2 * ORDER**2 * 2 * 5 / WIDTH), rel=1e-12)
    assert found.measures["h"] == pytest.approx(np.sqrt(WIDTH * HEIGHT), rel=1e-12)


def test_the_worst_element_comes_first():
    # x = s + 0.4 s^2 has the derivative 1 + 0.8 s: its ratio over an element from s to s + 1/3 is worst at s = 0
    mesh = curved(grid(Shape.QUADRILATERAL, 3), lambda p: p + np.array([0.4, 0, 0]) * p[:, [0]] ** 2, 3)
    found = mesh_quality(Dataset(mesh))
    facts = found.facts()
    assert "time_step" not in facts["measures"]
    ratios = found.measures["jacobian_ratio"]
    exact = [(1 + 0.8 * k / 3) / (1 + 0.8 * (k + 1) / 3) for k in range(3)]
    np.testing.assert_allclose(np.sort(ratios), np.sort(np.repeat(exact, 3)), atol=0.02)
    qualities = [row["quality"] for row in facts["worst"]]
    assert qualities == sorted(qualities)
    assert facts["worst"][0]["element"] == facts["measures"]["quality"]["worst_element"]
