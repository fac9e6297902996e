"""Points located on the device and on the host: on borders of elements, next to them, and anywhere."""

from functools import partial

import numpy as np

from audit.cases import Case, exact, random_polynomial, tolerance
from audit.validating import counted_as
from audit.worlds import BORDER, margins, world
from elvis.core.mapping.inverse import Status as InverseStatus
from elvis.core.numbers.sampling import sample
from elvis.scene.record.frame import Status

#: exponents of two of the distances from borders; 0 is on them
BESIDE = (0, 0, -48, -40, -30, -20, -10)


def case(rng, size):
    """As many points as a picture of the size has pixels."""
    dimension = int(rng.choice([2, 3, 3]))
    own = world(rng, dimension, joins=("joined", "doubled", "apart"))
    data, _, field = exact(own, random_polynomial(rng, 3, dimension), 4)
    count = size[0] * size[1]
    straight = rng.integers(-1, 18, (count, 3)) / 16
    powers = rng.choice(BESIDE, (count, 3))
    straight += np.where(powers == 0, 0.0, rng.choice([-1.0, 1.0], (count, 3)) * 2.0**powers)
    anywhere = rng.random(count) < 0.2
    straight[anywhere] = rng.uniform(-0.05, 1.05, (int(anywhere.sum()), 3))
    straight[:, dimension:] = 0.0
    points = own.placed(own.bent(straight))
    return Case(own.name, data, {"size": size}, partial(count_points, own, field, points), False, partial(ask, points))


def ask(points, gallery, case):
    """Status, element and value of points: on the device, or on the host where there is none."""
    if gallery.renderer is not None:
        gallery.renderer.load(case.data, "u")
        places = gallery.renderer.probe(points)
        return places.status, places.element, places.field
    found = sample(case.data, ["u"], points)
    table = {
        InverseStatus.INSIDE: Status.CERTAIN,
        InverseStatus.OUTSIDE: Status.MISS,
        InverseStatus.FAILED: Status.FAILED,
    }
    status = np.array([table[InverseStatus(value)] for value in found.location.status], np.uint8)
    return status, found.location.element_id, found.values[:, 0]


def count_points(own, field, points, case, found):
    """The count of points."""
    status, element, value = found
    straight = own.straightened(points)
    if own.dimension == 2:
        straight[:, 2] = 0
    rounding = own.rounding(float(np.abs(points).max()))
    axes = list(range(own.dimension))
    away = np.minimum(straight, 1 - straight)[:, axes]
    room = (BORDER + rounding)[axes]
    hit = status == Status.CERTAIN
    sides = own.sides()
    legal = (element >= 0) & (element < len(sides))
    elsewhere = ~legal | (margins(sides, np.where(legal, element, 0), straight) < -room.max())
    wanted = field(straight.astype(float))
    allowed = tolerance(field, own) + field.greatest_derivative() * rounding.max()
    reasons = {
        "outside but inside": (status == Status.MISS) & (away > room).all(axis=1),
        "inside but outside": hit & (away < -room).any(axis=1),
        "the wrong element": hit & elsewhere,
        "the wrong value": hit & ~(np.abs(value - wanted) <= allowed),
    }

    def details(row):
        place = ", ".join(f"{float(x):.17g}" for x in points[row])
        return f"point ({place}): expected {wanted[row]:.15g}, found {value[row]:.15g} in element {element[row]}"

    return counted_as(case, status, np.ones(len(points), bool), reasons, details)
