"""Elements that fold, or nearly do: the sign of their Jacobian, and their faces.

With x = X + h(phi), y = Y, z = Z and a linear form phi that has X once, the determinant is 1 + h'(phi).
"""

from fractions import Fraction
from functools import partial

import numpy as np

from audit.cases import Case, camera, tolerance
from audit.polynomials import Polynomial, X, Y, Z
from audit.truths import Rays, Truth, joined, surface_roots
from audit.validating import counted_as, validate
from audit.worlds import BORDER, world
from elvis import Faces
from elvis.core.mapping.orientation import local_vertices
from elvis.core.validity.validity import ValidityStatus, validity
from elvis.scene.record.frame import Status

FORMS = {"x": X, "x + y": X + Y, "x - z": X - Z}


def determinant(rng):
    """Coefficients (constant, linear, quadratic) of a determinant that is nearly zero somewhere, or is, or less."""
    near = Fraction(int(rng.choice([-1, 0, 1])), 2 ** int(rng.integers(2, 40)))
    where = Fraction(int(rng.integers(-8, 17)), 8)
    if rng.random() < 0.4:
        # decreases to zero, or nearly, at the place
        sign = int(rng.choice([-1, 1]))
        return (near - sign * where, Fraction(sign), Fraction(0))
    factor = Fraction(3, 2 ** int(rng.integers(0, 6)))
    return (factor * (where**2 + near), -2 * factor * where, factor)


def validity_case(rng, size):
    """The signs of the Jacobians of one mesh."""
    own = world(rng, placements=("plain", "small", "sliver"), bends=("straight",))
    name, parts = str(rng.choice(list(FORMS))), determinant(rng)
    form = FORMS[name]
    # x is X and the integral of the determinant less one
    extra = form * (parts[0] - 1) + form**2 * (parts[1] / 2) + form**3 * (parts[2] / 3)
    data = own.dataset({}, 2, (X + extra, Y, Z), 4)
    told = f"{own.name}, determinant {' '.join(map(str, parts))} in {name}"
    return Case(told, data, {}, partial(count_elements, own, form, parts), False, lambda gallery, case: validity(data))


def count_elements(own, form, parts, case, found):
    """The count of elements: UNDECIDED ones are ambiguous."""
    least = np.full(len(found), np.inf)
    sign = np.sign(np.prod(own.scale))
    for shape, entities in own.mesh.elements.items():
        corners = own.mesh.vertices[local_vertices(own.mesh, shape)]
        values = form(corners.reshape(-1, 3)).reshape(len(corners), -1)
        least[entities.ids] = [_least(parts, low, high) for low, high in zip(values.min(1), values.max(1), strict=True)]
    truth = least[found.element_ids] * sign
    table = {
        ValidityStatus.POSITIVE: Status.CERTAIN,
        ValidityStatus.NOT_POSITIVE: Status.MISS,
        ValidityStatus.UNDECIDED: Status.AMBIGUOUS,
    }
    status = np.array([table[ValidityStatus(status)] for status in found.status], np.uint8)
    reasons = {
        "positive but not so": (status == Status.CERTAIN) & ~(truth > 0),
        "not positive but so": (status == Status.MISS) & (truth > 0),
    }

    def details(row):
        return f"element {found.element_ids[row]}: expected a least determinant of {truth[row]:.3g} times a factor"

    return counted_as(case, status, np.ones(len(found), bool), reasons, details)


def _least(parts, low, high):
    """Smallest value of a quadratic on an interval of dyadic numbers, in fractions, rounded last."""
    constant, linear, quadratic = parts
    places = [Fraction(low), Fraction(high)]
    if quadratic > 0 and places[0] < -linear / (2 * quadratic) < places[1]:
        places.append(-linear / (2 * quadratic))
    return float(min(constant + linear * place + quadratic * place**2 for place in places))


def faces_case(rng, size):
    """The outer faces of cubes that are folded along x: x = X + c X^2."""
    own = world(rng, placements=("plain", "off"), bends=("straight",))
    own = type(own)(own.name, own.mesh, shift=own.shift, scale=own.scale)
    fold = -Fraction(1, 2) - Fraction(1, 2 ** int(rng.integers(1, 24)))
    view = camera(rng, own, str(rng.choice(["oblique", "perspective", "along"])))
    field = Polynomial({(0, 1, 0): 2, (0, 0, 2): -3, (0, 1, 1): 1, (0, 0, 0): 1})
    data = own.dataset({"u": field}, 4, (X + fold * X**2, Y, Z), 3)
    scene = {"field": "u", "camera": view, "size": size, "objects": (Faces(),)}
    return Case(f"{own.name}, x = X + {fold} X^2, {view}", data, scene, partial(count_faces, own, fold, field), False)


def count_faces(own, fold, field, case, frame):
    """The count of a picture of folded faces: those along x reach as far as x does, the others where X is 0 or 1."""
    rays = Rays(own, frame.view)
    rays.sides = None
    ends = np.array([float(-1 / (4 * fold)), 1.0, 1.0])

    def inside(axes):
        def within(points):
            away = np.minimum(points, ends - points)[:, axes]
            slack = (BORDER + rays.rounding)[axes]
            return (away >= -slack).all(axis=1), (away >= slack).all(axis=1)

        return within

    parts = []
    for axis, sides in enumerate([(0.0, float(1 + fold)), (0.0, 1.0), (0.0, 1.0)]):
        axes = [other for other in range(3) if other != axis]
        for side in sides:
            q = rays.quadratics[:, axis] - [side, 0, 0]
            parts.append(surface_roots(rays, q, float(rays.rounding[axis]), inside(axes)))

    # the fold itself is a silhouette, seen or not
    q = rays.quadratics[:, 0] - [ends[0], 0, 0]
    depth, sure, slack, free = surface_roots(rays, q, float(rays.rounding[0]), inside([1, 2]))
    parts.append((depth, np.zeros_like(sure), slack, free))
    truth = Truth(rays.counted, *joined(parts), field, tolerance(field, own))
    return validate(case, frame, truth, rays)
