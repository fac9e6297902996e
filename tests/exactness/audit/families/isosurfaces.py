"""Isosurfaces whose field is flat, touches, nearly touches or lies in borders.

It is made of powers of one linear form phi of straight coordinates:
u = c + s (phi - r1)^m1 (phi - r2)^m2 … has the value c where phi is one of the roots; all numbers are dyadic.
"""

from fractions import Fraction
from functools import partial

import numpy as np

from audit.cases import CAMERAS, ORDINARY, Case, camera, exact
from audit.polynomials import Polynomial, X, Y, Z
from audit.truths import Rays, Truth, in_domain, joined, surface_roots
from audit.validating import validate
from audit.worlds import world
from elvis import Isosurface
from elvis.core.shapes import Shape

#: forms phi by name, and the sum of their gradient's components
FORMS = {"z": Z, "x": X, "y": Y, "x + y": X + Y, "x + 2 y - z": X + 2 * Y - Z, "z - x": Z - X}
CONSTANTS = (0, 0, 1, -3, Fraction(1, 1024), 2**20)
#: highest degree of the field on straight elements: each shape and order has kernels of its own, long to compile
HIGHEST = {Shape.TETRAHEDRON: 5, Shape.HEXAHEDRON: 7}
FACTORS = (1, 1, -1, Fraction(1, 2**17), 1024)


def roots_of(rng, family, highest):
    """Offsets of roots from the first, with their multiplicities; and what is added to the product.

    Where that is not 0 there is no root at all; ``highest`` is the largest degree that the product may have.
    """
    if family == "multiplicity":
        return [(0, int(rng.choice([times for times in (1, 1, 3, 3, 5, 7) if times <= highest])))], 0
    if family == "touching":
        rest = Fraction(int(rng.choice([0, 0, 1])), 2 ** int(rng.integers(4, 40)))
        return [(0, int(rng.choice([2, 2, 4] if highest > 3 else [2])))], rest
    if family == "near pairs":
        return [(0, 1), (Fraction(1, 2 ** int(rng.integers(2, 22))), int(rng.choice([1, 1, 2])))], 0
    return [(0, int(rng.choice([1, 1, 2, 3])))], 0


def case(family, rng, size):
    """One isosurface."""
    kind = str(rng.choice(CAMERAS))
    own, form = world(rng), str(rng.choice(list(FORMS)))
    low, high = extent(FORMS[form])
    cells = int(own.name.split()[1])
    if family == "sheets":
        # in borders of elements, or a rounding error or so next to them
        first = low + (high - low) * Fraction(int(rng.integers(0, 2 * cells + 1)), 2 * cells)
    else:
        first = low + (high - low) * Fraction(int(rng.integers(1, 16)), 16)
    roots, rest = roots_of(rng, family, 3 if own.bend != (0.0, 0.0) else HIGHEST.get(own.shapes[0], 3))
    polynomial = Polynomial({(0, 0, 0): 1})
    for offset, times in roots:
        polynomial = polynomial * (FORMS[form] - first - offset) ** times
    constant, factor = (some[rng.integers(len(some))] for some in (CONSTANTS, FACTORS))
    degree = sum(times for _, times in roots)
    modes = 4 if degree <= 3 else 6 if degree <= 5 else 8
    try:
        data, multiple, _ = exact(own, constant + (polynomial + rest) * factor, modes)
    except AssertionError:
        # too many bits for doubles: the plain product
        constant, factor = 1, 1
        data, multiple, _ = exact(own, constant + (polynomial + rest) * factor, modes)
    view = camera(rng, own, kind)
    level = float(constant * multiple)
    surface = Isosurface((level,))
    scene = {"field": "u", "camera": view, "size": size, "objects": (surface,)}
    powers = " ".join(f"({form} - {first + offset})^{times}" for offset, times in roots)
    name = f"{own.name} modes {modes}, {multiple} [{constant} + {factor} ({powers} + {rest})] = {level!r}, {view}"
    ordinary = kind in ("oblique", "perspective") and own.name.split()[-1] in ORDINARY and roots == [(0, 1)]
    ordinary &= family == "multiplicity" and factor in (1, -1) and abs(constant) <= 3
    values = [] if rest else [first + offset for offset, _ in roots]
    return Case(name, data, scene, partial(count, own, FORMS[form], values), ordinary)


def extent(form):
    """Minimum and maximum value of a linear form on the unit cube."""
    parts = list(form.terms.values())
    return sum(min(part, 0) for part in parts), sum(max(part, 0) for part in parts)


def count(own, form, values, case, frame):
    """The count of an isosurface at values of a linear form of straight coordinates."""
    rays = Rays(own, frame.view)
    constant = float(form.terms.get((0, 0, 0), 0))
    weights = [float(form.terms.get(tuple(int(i == j) for j in range(3)), 0)) for i in range(3)]
    along, noise = np.einsum("i,nij->nj", weights, rays.quadratics), float(np.abs(weights) @ rays.rounding)
    along[:, 0] += constant
    nowhere = np.full((len(along), 1), np.inf)
    nothing = (nowhere, np.zeros_like(nowhere, bool), np.zeros_like(nowhere), np.zeros(len(along), bool))
    parts = [surface_roots(rays, along - [float(value), 0, 0], noise, in_domain(rays)) for value in values]
    truth = Truth(rays.counted, *joined([nothing, *parts]))
    return validate(case, frame, truth, rays)


FAMILIES = {
    f"isosurfaces: {name}": partial(case, name) for name in ("multiplicity", "touching", "near pairs", "sheets")
}
