"""Isosurfaces of expressions with poles, jumps, kinks; the field u is a linear form of straight coordinates."""

from functools import partial

import numpy as np

from audit.cases import CAMERAS, Case, camera, exact
from audit.families.isosurfaces import FORMS, count, extent
from audit.worlds import world
from elvis import Isosurface
from elvis.core.shapes import Shape

#: expressions of u with a value, and where they have it between 0 and 1
EXPRESSIONS = {
    ("1/(u-0.5)", 8.0): [0.625],
    ("1/(u-0.5)", 0.0): [],
    ("u/(u-0.5)", 3.0): [0.75],
    ("1/u^2", 16.0): [0.25],
    ("tan(8*u)", 0.5): [(np.arctan(0.5) + k * np.pi) / 8 for k in range(3)],
    ("sign(u-0.5)", 0.5): [],
    ("abs(u-0.5)", 0.25): [0.25, 0.75],
    ("abs(u-0.5)", 0.0): [0.5],
    ("sqrt(u)", 0.5): [0.25],
    ("sqrt(u*u+1)", 1.25): [0.75],
    ("min(u,0.5)", 0.25): [0.25],
    ("exp(u)", 1.5): [float(np.log(1.5))],
}


def case(rng, size):
    """One isosurface of an expression."""
    kind = str(rng.choice(CAMERAS[:4]))
    # each expression has kernels of its own for every shape
    shapes, places = (Shape.HEXAHEDRON, Shape.TETRAHEDRON), ("plain", "off", "mirrored", "far", "small")
    own = world(rng, shapes=shapes, placements=places, bends=("straight",))
    form = str(rng.choice(list(FORMS)))
    low, high = extent(FORMS[form])

    # the form between 0 and 1; some factors are no powers of two, so only a few forms remain
    field = (FORMS[form] - low) * (1 / (high - low)) if high - low in (1, 2, 4) else FORMS["z"]
    names = list(EXPRESSIONS)
    quantity, level = names[rng.integers(len(names))]
    data, _, _ = exact(own, field, 4)
    view = camera(rng, own, kind)
    scene = {"field": "u", "camera": view, "size": size, "objects": (Isosurface((level,), quantity=quantity),)}
    name = f"{own.name}, u = {form} from 0 to 1, {quantity} = {level}, {view}"
    return Case(name, data, scene, partial(count, own, field, EXPRESSIONS[quantity, level]), False)


FAMILIES = {"isosurfaces: poles": case}
