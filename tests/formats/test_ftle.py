"""Finite-time Lyapunov exponents: a saddle in closed form, the steady double gyre against another integrator."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.streamlines.streamlines import trace
from elvis.core.testing import curved, grid, ripple

PI = repr(float(np.pi))
#: the double gyre at rest on [0, 1]^2 in place of [0, 2] x [0, 1]
GYRE = (f"-sin(2*{PI}*x)*cos({PI}*y)", f"2*cos(2*{PI}*x)*sin({PI}*y)")


def bent(shape):
    return Dataset(curved(grid(shape, 2), ripple(0.03), 3))


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1])
@pytest.mark.sampled(least=3, free=("shape",))
def test_a_saddle_stretches_by_its_rate(shape):
    velocity = ("0.7*(x - 0.5) + 0.2*(y - 0.5)", "-0.7*(y - 0.5)", "0*z")[: shape.dimension]
    middle = np.full((1, shape.dimension), 0.5)
    found = trace(bent(shape), middle + 0.03, velocity, direction="both", duration=1.5, ftle=True)
    assert found.counts() == {"duration": 2}
    for sign, exponent in zip((1, -1), found.ftle, strict=True):
        growth, decay = np.exp(0.7 * sign * 1.5), np.exp(-0.7 * sign * 1.5)
        shear = 0.2 * (growth - decay) / 1.4
        matrix = np.array([[growth, shear], [0, decay]])
        assert exponent == pytest.approx(np.log(max(np.linalg.norm(matrix, 2), 1)) / 1.5, abs=1e-11)


@pytest.mark.thorough
@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL])
@pytest.mark.parametrize("seed", [(0.2, 0.3), (0.45, 0.8), (0.7, 0.55)])
@pytest.mark.sampled(least=2, free=("shape", "seed"))
def test_the_double_gyre_against_another_integrator(shape, seed):
    def right(t, state):
        (x, y), gradient = state[:2], state[2:].reshape(2, 2)
        s, c = np.sin(2 * np.pi * x), np.cos(2 * np.pi * x)
        sy, cy = np.sin(np.pi * y), np.cos(np.pi * y)
        slope = np.pi * np.array([[-2 * c * cy, s * sy], [-4 * s * sy, 2 * c * cy]])
        return np.concatenate([[-s * cy, 2 * c * sy], (slope @ gradient).reshape(-1)])

    found = trace(bent(shape), [seed], GYRE, duration=2.0, ftle=True)
    truth = solve_ivp(right, (0, 2), [*seed, 1, 0, 0, 1], "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    assert found.counts() == {"duration": 1}
    assert found[0][-1, :2] == pytest.approx(truth[:2], abs=1e-9)
    assert found.ftle[0] == pytest.approx(np.log(np.linalg.norm(truth[2:].reshape(2, 2), 2)) / 2, abs=1e-8)
    assert found.columns()["ftle"] == pytest.approx(found.ftle[0])
    assert found.arrays()["ftle"].shape == (1,)


def test_undefined_exponents():
    with pytest.raises(ElvisError, match="FTLE: expected 2D data in the plane or 3D data"):
        trace(bent(Shape.PRISM), [[0.5, 0.5, 0]], ["x", "y", "z"], wall="all", ftle=True)
    outside = trace(bent(Shape.TRIANGLE), [[3.0, 3.0]], ["x", "y"], ftle=True)
    assert np.isnan(outside.ftle).all()
    assert trace(bent(Shape.TRIANGLE), [[0.5, 0.5]], ["x", "y"], length=0.01).ftle is None
