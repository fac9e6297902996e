"""Random integrals with closed forms: kinks, jumps, bumps, near poles, small supports and singularities.

An integrand is a product of functions of one coordinate each, or a paraboloid over a small disc or ball.  The domain is
the unit cube of a random shape and order; curved meshes keep its border, so that the closed form holds.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan, erf, pi, sqrt

import numpy as np

from elvis.core.data.dataset import Dataset
from elvis.core.integrals import integrate
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, with_field

SHAPES = [
    Shape.SEGMENT,
    Shape.TRIANGLE,
    Shape.QUADRILATERAL,
    Shape.TETRAHEDRON,
    Shape.PYRAMID,
    Shape.PRISM,
    Shape.HEXAHEDRON,
]
#: functions of t with parameters c and w, and their integrals over [0, 1]
LINES = {
    "abs({t}-{c!r})": lambda c, w: (c * c + (1 - c) ** 2) / 2,
    "max({t}-{c!r},0)": lambda c, w: (1 - c) ** 2 / 2,
    "min({t},{c!r})": lambda c, w: c - c * c / 2,
    "sign({t}-{c!r})": lambda c, w: 1 - 2 * c,
    "max({w!r}^2-({t}-{c!r})^2,0)": lambda c, w: 4 / 3 * w**3,
    "exp(-(({t}-{c!r})/{w!r})^2)": lambda c, w: w * sqrt(pi) / 2 * (erf((1 - c) / w) + erf(c / w)),
    "1/(({t}-{c!r})^2+{w!r}^2)": lambda c, w: (atan((1 - c) / w) + atan(c / w)) / w,
    "sqrt({t}+{w!r})": lambda c, w: 2 / 3 * ((1 + w) ** 1.5 - w**1.5),
    "1/({t}+{w!r})": lambda c, w: float(np.log1p(1 / w)),
    "sin({t}/{w!r})": lambda c, w: w * (1 - np.cos(1 / w)),
    "tanh(({t}-{c!r})/{w!r})": lambda c, w: w * float(np.log(np.cosh((1 - c) / w) / np.cosh(c / w))),
    "1/sqrt({t})": lambda c, w: 2.0,
    "{t}^2": lambda c, w: 1 / 3,
    "1": lambda c, w: 1.0,
}
#: kinds that are the second and third factor, so that not all of a product is hard
EASY = ["{t}^2", "1", "sqrt({t}+{w!r})"]
#: half of a bump's support at least and at most
LEAST, MOST = 0.008, 0.12


@dataclass(frozen=True, eq=False)
class Integral:
    """An integrand on a dataset, its integral, and the relative error to request."""

    dataset: Dataset
    text: str
    truth: float
    error: float


def bubble(amplitude, seed):
    """A warp of the unit cube that keeps its border."""
    rng = np.random.default_rng(seed)
    direction = amplitude * rng.uniform(-1, 1, 3)

    def warp(points):
        inner = np.prod(np.where(points.any(axis=0), 4 * points * (1 - points), 1.0), axis=1)
        return points + np.where(points.any(axis=0), direction * inner[:, None], 0.0)

    return warp


def width(rng):
    return round(float(np.exp(rng.uniform(*np.log([LEAST, MOST])))), 6)


def dataset_of(rng, shape):
    mesh = grid(shape, int(rng.integers(1, 4 if shape.dimension < 3 else 3)))
    order = int(rng.integers(1, 5))
    if shape.dimension > 1 and rng.random() < 0.3:
        mesh = curved(mesh, bubble(0.15, int(rng.integers(1 << 30))), 3)
        return Dataset(mesh), "x"
    return with_field(mesh, lambda points: points[:, 0], order + 1), "u"


def integral(seed):
    """The case of a number."""
    rng = np.random.default_rng([7, seed])
    shape = SHAPES[rng.integers(len(SHAPES))]
    dataset, first = dataset_of(rng, shape)
    error = 10.0 ** rng.uniform(-5, -2)
    if shape.dimension > 1 and rng.random() < 0.2:
        return Integral(dataset, *paraboloid(rng, shape.dimension), error)
    parts, truth = [], 1.0
    for axis, name in enumerate((first, "y", "z")[: shape.dimension]):
        kind = rng.choice(list(LINES) if axis == 0 else EASY)
        c, w = (
            float(round(own, 6)) for own in (rng.uniform(MOST, 1 - MOST), np.exp(rng.uniform(*np.log([LEAST, MOST]))))
        )
        parts.append(kind.format(t=name, c=c, w=w))
        truth *= LINES[kind](c, w)
    return Integral(dataset, "*".join(parts), truth, error)


def paraboloid(rng, dimension):
    """(w^2 - r^2) over a disc or ball of radius w inside, and its integral."""
    w = width(rng)
    centre = [round(own, 6) for own in rng.uniform(MOST, 1 - MOST, dimension).tolist()]
    squares = "-".join(f"({name}-{own!r})^2" for name, own in zip("xyz", centre, strict=False))
    return f"max({w!r}^2-{squares},0)", (pi / 2 * w**4 if dimension == 2 else 8 / 15 * pi * w**5)


def refutation(seed):
    """A sentence if the stated error of a case is less than the true one; None else."""
    case = integral(seed)
    found = integrate(case.dataset, case.text, error=case.error)[0]
    off = abs(found.value - case.truth)
    if off <= found.error + 4e-16 * abs(case.truth):
        return None
    return f"{case.text} (case {seed}): off by {off:.3g}, stated {found.error:.3g} ({found.kind})"
