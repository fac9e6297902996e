"""Random level sets with closed forms: measures, fluxes and clipped volumes of balls, cylinders, slabs and half-spaces.

The domain is that of `integrals`.  Coordinates are fields of the mesh or its own, factors change the quantity's sign
and size but not its level set, so that normals and the kept part follow the sign.
"""

from __future__ import annotations

from itertools import combinations
from math import factorial, pi, prod

import numpy as np

from audit.integrals import SHAPES, dataset_of
from elvis.core.integrals import integrate

#: radii of balls and cylinders, and half the thickness of slabs, at least and at most
LEAST, MOST = 0.02, 0.35
THIN = 1e-5


def ball(rng, names):
    """(c - x)^2 = r^2: the quantity, its level, the measures of the set and of what is below, a flux and its value."""
    r = float(rng.uniform(LEAST, MOST))
    centre = rng.uniform(MOST, 1 - MOST, len(names)).tolist()
    text = "+".join(f"({name}-{c!r})^2" for name, c in zip(names, centre, strict=True))
    surface = {1: 2.0, 2: 2 * pi * r, 3: 4 * pi * r**2}[len(names)]
    inside = {1: 2 * r, 2: pi * r**2, 3: 4 / 3 * pi * r**3}[len(names)]
    flux = "+".join(f"{name}*n{axis}" for name, axis in zip(names, "xyz", strict=False))
    return text, r * r, surface, inside, flux, len(names) * inside


def cylinder(rng, names):
    """A ball in all coordinates but the last."""
    return ball(rng, names[: max(1, len(names) - 1)])


def slab(rng, names):
    """Two planes, which may be near one another."""
    w = float(np.exp(rng.uniform(np.log(THIN), np.log(MOST))))
    c = float(rng.uniform(MOST, 1 - MOST))
    return f"({names[0]}-{c!r})^2", w * w, 2.0, 2 * w, f"{names[0]}*nx", 2 * w


def half(rng, names):
    """A plane across the unit cube.

    With a . x <= v the volume is sum over sets S of corners of (-1)^|S| max(v - sum a_S, 0)^d / (d! prod a); the area
    is |a| times its derivative in v.
    """
    a = rng.uniform(0.2, 1.0, len(names)).tolist()
    level = float(rng.uniform(0.1, 0.9)) * sum(a)
    terms = [((-1) ** n, level - sum(own)) for n in range(len(a) + 1) for own in combinations(a, n)]

    def total(power):
        return sum(sign * max(rest, 0.0) ** power for sign, rest in terms if rest > 0)

    inside = total(len(a)) / (factorial(len(a)) * prod(a))
    area = float(np.linalg.norm(a)) * total(len(a) - 1) / (factorial(len(a) - 1) * prod(a))
    text = "+".join(f"{own!r}*{name}" for own, name in zip(a, names, strict=True))
    return text, level, area, inside, "nx", area * a[0] / float(np.linalg.norm(a))


KINDS = (ball, cylinder, slab, half)
#: what is made of a quantity q and its level; whether it grows with q
FORMS = {
    "{q}": (lambda v: v, True),
    "-({q})": (lambda v: -v, False),
    "3-2*({q})": (lambda v: 3 - 2 * v, False),
    "1/({q}+1)": (lambda v: 1 / (v + 1), False),
    "-1/({q}+1)": (lambda v: -1 / (v + 1), True),
    "exp({q})": (lambda v: float(np.exp(v)), True),
}


def refutation(seed):
    """A sentence if the stated error of a case is less than the true one; None else."""
    rng = np.random.default_rng([8, seed])
    shape = SHAPES[rng.integers(1, len(SHAPES))]
    dataset, first = dataset_of(rng, shape)
    names = [first, "y", "z"][: shape.dimension]
    text, level, measure, inside, flux, through = KINDS[rng.integers(len(KINDS))](rng, names)
    form = str(rng.choice(list(FORMS)))
    of_level, is_growing = FORMS[form]
    surface = f"{form.format(q=text)}={of_level(level)!r}"
    error = 10.0 ** rng.uniform(-5, -2)
    what = rng.integers(3)
    if what == 0:
        found, truth = integrate(dataset, "1", surface, error)[0], measure
    elif what == 1:
        # the divergence theorem: x . n over a closed surface is d times the volume inside; planes have a constant n
        found, truth = integrate(dataset, flux, surface, error)[0], through if is_growing else -through
    else:
        found = integrate(dataset, "1", "domain", error, clip=surface)[0]
        truth = 1 - inside if is_growing else inside
    off = abs(found.value - truth)
    if off <= found.error + 1e-13 * max(1.0, abs(truth)):
        return None
    return f"{surface} ({('measure', 'flux', 'clip')[what]}, case {seed}): off by {off:.3g}, stated {found.error:.3g}"
