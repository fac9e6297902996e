"""Streamlines of known flows through curved elements of every shape: closed forms, and SciPy's DOP853.

Velocities are expressions of the coordinates, so nothing is lost by bringing them to elements.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.streamlines.streamlines import trace
from elvis.core.testing import curved, grid, ripple

#: about the middle of the unit cube
X, Y, Z = "(x-0.5)", "(y-0.5)", "(z-0.5)"
#: squared distance from the axis, in parts of a core of 0.2
CORE = f"(25*({X}^2+{Y}^2))"
SWIRL = f"(1-exp(-{CORE}))/{CORE}"


def lamb_oseen(p, t):
    """The circle, at the angular speed of its radius."""
    x, y, z = p - 0.5
    core = 25 * (x * x + y * y)
    angle = (1 - np.exp(-core)) / core * t
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * x - s * y, s * x + c * y, z]) + 0.5


def stagnation(p, t):
    """Each coordinate by its own exponential."""
    return (p - 0.5) * np.exp(np.array([1.0, -0.5, -0.5]) * t) + 0.5


def by_dop853(velocity):
    def end(p, t):
        return solve_ivp(lambda _, q: velocity(*q), (0, t), p, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]

    return end


def swirling(x, y, z):
    """The Burgers vortex: strain along z, a core of 0.2."""
    x, y, z = x - 0.5, y - 0.5, z - 0.5
    core = 25 * (x * x + y * y)
    around = (1 - np.exp(-core)) / core
    return np.array([-0.1 * x - around * y, -0.1 * y + around * x, 0.2 * z])


def vortices(x, y, z):
    """Taylor and Green's."""
    return np.array([np.sin(6 * x) * np.cos(6 * y), -np.cos(6 * x) * np.sin(6 * y), 0.1 + 0 * z])


def abc(x, y, z):
    """Arnold, Beltrami and Childress's, with three waves in the cube."""
    x, y, z = 6 * x, 6 * y, 6 * z
    return 0.1 * np.array([np.sin(z) + np.cos(y), np.sin(x) + np.cos(z), np.sin(y) + np.cos(x)])


def hill(x, y, z):
    """The inside of Hill's vortex, of radius 0.45."""
    x, y, z = x - 0.5, y - 0.5, z - 0.5
    return np.array([x * z, y * z, 0.2025 - 2 * (x * x + y * y) - z * z])


#: components, where lines begin, how long they last, and where they then are
FLOWS = {
    "Lamb-Oseen": ((f"-{Y}*{SWIRL}", f"{X}*{SWIRL}", "0*x"), (0.7, 0.55, 0.4), 15.0, lamb_oseen),
    "stagnation": ((X, f"-0.5*{Y}", f"-0.5*{Z}"), (0.55, 0.9, 0.2), 1.8, stagnation),
    "Burgers": (
        (f"-0.1*{X}-{Y}*{SWIRL}", f"-0.1*{Y}+{X}*{SWIRL}", f"0.2*{Z}"),
        (0.8, 0.5, 0.52),
        10.0,
        by_dop853(swirling),
    ),
    "Taylor-Green": (
        ("sin(6*x)*cos(6*y)", "-cos(6*x)*sin(6*y)", "0.1+0*z"),
        (0.3, 0.35, 0.2),
        4.0,
        by_dop853(vortices),
    ),
    "ABC": (
        ("0.1*(sin(6*z)+cos(6*y))", "0.1*(sin(6*x)+cos(6*z))", "0.1*(sin(6*y)+cos(6*x))"),
        (0.4, 0.5, 0.6),
        1.5,
        by_dop853(abc),
    ),
    "Hill": (
        (f"{X}*{Z}", f"{Y}*{Z}", f"0.2025-2*({X}^2+{Y}^2)-{Z}^2"),
        (0.65, 0.55, 0.5),
        12.0,
        by_dop853(hill),
    ),
}


@pytest.mark.parametrize("modes", [2, 3, 5])
@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension == 3])
@pytest.mark.parametrize("flow", FLOWS)
@pytest.mark.sampled(free=("shape", "modes"))
def test_lines_end_at_the_right_places(flow, shape, modes):
    velocity, seed, time, end = FLOWS[flow]
    mesh = grid(shape, 1)
    dataset = Dataset(mesh if modes == 2 else curved(mesh, ripple(0.03), modes))
    found = trace(dataset, [seed], velocity, duration=time)
    assert found.counts() == {"duration": 1}
    assert np.abs(found[0][-1] - end(np.array(seed), time)).max() < 1e-9
