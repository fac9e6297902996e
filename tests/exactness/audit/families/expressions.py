"""Isosurfaces of expressions made at random, on curved elements of all shapes, against dense samples of the rays.

u, v and w are cubic polynomials of straight coordinates. The map x = X + a Y^2, y = Y + c Y^2, z = Z + d X Z + b Y^2
has an inverse in closed form, and a Jacobian that is not constant; so have values and derivatives in the world.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from audit.cases import Case, camera, random_polynomial
from audit.polynomials import Polynomial, X, Y, Z
from audit.truths import EPS, POSITION, Truth
from audit.validating import Count, validate
from audit.worlds import BORDER, PLACEMENTS, World
from elvis import Isosurface
from elvis.core.bounds.bounding import quantity_range
from elvis.core.quantities import Expression as Parsed
from elvis.core.shapes import Shape
from elvis.core.testing import grid

CAMERAS = ("oblique", "perspective", "along", "inside", "close")
#: samples of a ray, and of what is between three of them where values come near to the level
SAMPLES, CLOSER = 400, 48
#: rays that are sampled at once
_CHUNK = 1 << 10
#: how far values may be off, in parts of the largest number that they are made of
NOISE = 1e-12

#: quantities with names, of the velocity gradient G (n, 3, 3), rows being those of u, v, w
NAMED = {
    "q_criterion": lambda g: -0.5 * (g * g.transpose(0, 2, 1)).sum(axis=(1, 2)),
    "vorticity": lambda g: np.linalg.norm(
        np.stack([g[:, 2, 1] - g[:, 1, 2], g[:, 0, 2] - g[:, 2, 0], g[:, 1, 0] - g[:, 0, 1]], axis=1), axis=1
    ),
    "lambda2": lambda g: np.linalg.eigvalsh(np.nan_to_num(_squares(g)))[:, 1],
}

#: operators and functions by name: how many operands, text, values, and whether they are analytic everywhere
PARTS = {
    "+": (2, "({} + {})", np.add, True),
    "-": (2, "({} - {})", np.subtract, True),
    "*": (2, "({} * {})", np.multiply, True),
    "square": (1, "{}^2", np.square, True),
    "sin": (1, "sin({})", np.sin, True),
    "exp": (1, "exp({} / 4)", lambda a: np.exp(a / 4), True),
    "over": (2, "({} / (1 + {}^2))", lambda a, b: a / (1 + b * b), True),
    "pole": (2, "({} / {})", np.divide, False),
    "length": (2, "sqrt({}^2 + {}^2)", np.hypot, False),
    "sqrt": (1, "sqrt({})", np.sqrt, False),
    "abs": (1, "abs({})", np.abs, False),
    "min": (2, "min({}, {})", np.minimum, False),
    "max": (2, "max({}, {})", np.maximum, False),
}


def _squares(g):
    """S^2 + O^2 of velocity gradients, whose second eigenvalue is lambda2 (Jeong and Hussain 1995)."""
    turned = g.transpose(0, 2, 1)
    strain, spin = (g + turned) / 2, (g - turned) / 2
    return strain @ strain + spin @ spin


@dataclass(frozen=True, eq=False)
class Bent(World):
    """A world whose map is curved in all three directions; ``more`` are c and d, ``bend`` a and b."""

    more: tuple[float, float] = (0.0, 0.0)

    def bent(self, straight):
        """Local points (n, 3) of straight ones."""
        (a, b), (c, d) = self.bend, self.more
        x, y, z = np.asarray(straight).T
        return np.stack([x + a * y * y, y + c * y * y, z + d * x * z + b * y * y], axis=1)

    def straightened(self, points):
        """Straight points (n, 3) of world points."""
        (a, b), (c, d) = self.bend, self.more
        x, y, z = ((points - np.asarray(self.shift)) / np.asarray(self.scale)).T
        with np.errstate(invalid="ignore"):
            own_y = 2 * y / (1 + np.sqrt(1 + 4 * c * y))
            own_x = x - a * own_y**2
            return np.stack([own_x, own_y, (z - b * own_y**2) / (1 + d * own_x)], axis=1)

    def local(self):
        """The local coordinates, as polynomials of the straight ones."""
        (a, b), (c, d) = self.bend, self.more
        return X + a * Y**2, Y + c * Y**2, Z + d * X * Z + b * Y**2

    def turned(self, straight, slopes):
        """Gradients (n, 3) in the world of what has these in straight coordinates."""
        (a, b), (c, d) = self.bend, self.more
        x, y, z = straight.T
        along_z = slopes[:, 2] / (1 + d * x)
        along_x = slopes[:, 0] - d * z * along_z
        along_y = (slopes[:, 1] - 2 * a * y * along_x - 2 * b * y * along_z) / (1 + 2 * c * y)
        return np.stack([along_x, along_y, along_z], axis=1) / self.scale


@dataclass(frozen=True)
class Expression:
    """An expression: its text, and its values as a function of what its leaves are by name.

    size  of the same, the largest number on the way to the values
    """

    text: str
    value: object
    size: object


def leaf(name):
    """A leaf, or a number."""
    return Expression(name, lambda values: values(name), lambda values: np.abs(values(name)))


def combined(part, *operands):
    """An operator or function of expressions."""
    _, text, function, _ = PARTS[part]

    def value(values):
        with np.errstate(all="ignore"):
            return function(*(one.value(values) for one in operands))

    def size(values):
        return np.fmax.reduce([np.abs(value(values)), *(one.size(values) for one in operands)])

    return Expression(text.format(*(one.text for one in operands)), value, size)


def made(rng, depth, smooth):
    """An expression at random, ``depth`` operators deep at most; ``smooth`` but for the outermost operator."""
    if depth == 0 or rng.random() < 0.1:
        names = ["u", "v", "w"] if rng.random() < 0.5 else [f"d({f},{x})" for f in "uvw" for x in "xyz"]
        name = rng.choice(["x", "y", "z", "0.5", "2"]) if rng.random() < 0.15 else rng.choice(names)
        return leaf(str(name))
    part = str(rng.choice([name for name, about in PARTS.items() if about[3] or not smooth]))
    return combined(part, *(made(rng, depth - 1, smooth) for _ in range(PARTS[part][0])))


class Values:
    """What leaves are at straight points (n, 3)."""

    def __init__(self, own, fields, straight):
        self.own, self.fields, self.straight, self.known = own, fields, straight, {}

    def __call__(self, name):
        if name not in self.known:
            self.known[name] = self._found(name)
        return self.known[name]

    def _found(self, name):
        if name in self.fields:
            return self.fields[name][0](self.straight)
        if name in "xyz":
            return self.own.placed(self.own.bent(self.straight))[:, "xyz".index(name)]
        if name in NAMED:
            return NAMED[name](np.stack([self.gradient(field) for field in self.fields], axis=1))
        if name.startswith("d("):
            return self.gradient(name[2])[:, "xyz".index(name[4])]
        return np.full(len(self.straight), float(name))

    def gradient(self, field):
        """(n, 3) in the world."""
        if ("gradient", field) not in self.known:
            slopes = np.stack([slope(self.straight) for slope in self.fields[field][1]], axis=1)
            self.known["gradient", field] = self.own.turned(self.straight, slopes)
        return self.known["gradient", field]


def differentiated(polynomial, axis):
    """The partial derivative of a polynomial."""
    lower = {key: tuple(k - (i == axis) for i, k in enumerate(key)) for key in polynomial.terms}
    return Polynomial({lower[key]: value * key[axis] for key, value in polynomial.terms.items() if key[axis]})


def placed_world(rng):
    """A curved world at random."""
    shapes = Shape.of_dimension(3)
    shape, cells = shapes[rng.integers(len(shapes))], int(rng.choice([1, 1, 2]))
    place = str(rng.choice(["plain", "plain", "off", "mirrored"]))
    shift, scale = PLACEMENTS[place]
    bend, more = (tuple(float(n) / 8 for n in rng.integers(low, 4, 2)) for low in (-3, 0))
    name = f"{shape.label.lower()} {cells} {place}, bends {bend} {more}"
    return Bent(name, grid(shape, cells), bend, (0.0, 0.0), shift, scale, more)


def case(kind, rng, size):
    """One isosurface of an expression."""
    own = placed_world(rng)
    polynomials = {name: random_polynomial(rng, int(rng.integers(1, 4)), 3) for name in "uvw"}
    fields = {name: (one, [differentiated(one, axis) for axis in range(3)]) for name, one in polynomials.items()}
    values = Values(own, fields, np.random.default_rng(0).random((4000, 3)))
    found = np.zeros(0)
    while len(found) < 400 or np.ptp(found) == 0:
        expression = chosen(kind, rng)
        found = expression.value(values)
        found = found[np.isfinite(found)]
    level = float(f"{np.quantile(found, rng.uniform(0.1, 0.9)):.3g}")
    data = own.dataset(polynomials, 4, own.local(), 3)
    view = camera(rng, own, str(rng.choice(CAMERAS)))
    scene = {"field": "u", "camera": view, "size": size, "objects": (Isosurface((level,), quantity=expression.text),)}
    terms = {name: len(one.terms) for name, one in polynomials.items()}
    name = f"{own.name}, {terms} terms, {expression.text} = {level}, {view}"
    return Case(name, data, scene, partial(count, own, fields, expression, level), False)


def range_case(rng, size):
    """The certified range of an expression, for which no pixels are drawn."""
    own = placed_world(rng)
    polynomials = {name: random_polynomial(rng, int(rng.integers(1, 4)), 3) for name in "uvw"}
    fields = {name: (one, [differentiated(one, axis) for axis in range(3)]) for name, one in polynomials.items()}
    expression = chosen(str(rng.choice(["proved", "any", "named"])), rng)
    data = own.dataset(polynomials, 4, own.local(), 3)
    values = Values(own, fields, np.random.default_rng(0).random((4000, 3)))

    def found(gallery, case):
        return quantity_range(data, Parsed.of(data, expression.text))

    name = f"{own.name}, range of {expression.text}"
    return Case(name, data, {}, partial(count_range, expression, values), False, found)


def count_range(expression, values, case, found):
    """One pixel: wrong where a value lies beyond the range, ambiguous where an end is infinite."""
    some, size = expression.value(values), np.nanmax(expression.size(values))
    some = some[np.isfinite(some)]
    if found is None or not len(some):
        wrong, ambiguous = found is None and len(some) > 0, False
    else:
        slack = NOISE * size
        wrong = some.min() < found.lower - slack or some.max() > found.upper + slack
        ambiguous = not np.isfinite(found.upper - found.lower)
    first = [f"{case.name}: {found}, found {some.min()} to {some.max()}"] if wrong else []
    return Count(1, 1, wrong=int(wrong), ambiguous=int(ambiguous), first=first)


def chosen(kind, rng):
    """An expression of one of the families."""
    if kind == "named":
        return leaf(str(rng.choice(list(NAMED))))
    depth = int(rng.integers(1, 4))
    if kind == "any":
        return made(rng, depth, False)
    # what is proved: analytic, perhaps with a root, a quotient or a corner outermost
    outer = str(rng.choice(list(PARTS)))
    return combined(outer, *(made(rng, depth - 1, True) for _ in range(PARTS[outer][0])))


class Rays:
    """The rays of a view, and an expression less its level along them; see `audit.truths.Rays`."""

    def __init__(self, own, fields, expression, level, view):
        self.own, self.fields, self.expression, self.level = own, fields, expression, level
        self.origins, self.ways = view.every_ray()
        corners = own.corners()
        self.diagonal = float(np.linalg.norm(np.ptp(corners, axis=0)))
        self.extent = float(max(np.abs(corners).max(), np.abs(view.camera.eye).max()))
        self.rounding, self.sides = 4 * own.rounding(self.extent), own.sides()
        # a ball around the domain
        away = corners.mean(axis=0) - self.origins
        nearest = (away * self.ways).sum(axis=1)
        room = 0.36 * self.diagonal**2 - ((away - nearest[:, None] * self.ways) ** 2).sum(axis=1)
        half = np.sqrt(np.maximum(room, 0.0))
        self.counted = (room > 0) & (nearest + half > 0)
        self.enter, self.leave = np.maximum(nearest - half, 0.0), nearest + half

    def at(self, pixels, depth):
        """(m, 3) straight coordinates at one depth (m,) of some pixels."""
        depth = np.asarray(depth, float)[:, None]
        return self.own.straightened(self.origins[pixels] + depth * self.ways[pixels])

    def inside(self, straight):
        """(m,) how far points are within the unit cube."""
        return np.minimum(straight, 1 - straight).min(axis=1)

    def away(self, pixels, depth):
        """(m,) the expression less its level, and how far the points are within the domain."""
        straight = self.at(pixels, depth)
        with np.errstate(invalid="ignore"):
            inside = self.inside(straight)
        return self.expression.value(Values(self.own, self.fields, straight)) - self.level, inside

    def noise(self, pixels, depth):
        """(m,) how far its values may be off."""
        sizes = self.expression.size(Values(self.own, self.fields, self.at(pixels, depth)))
        return NOISE * (abs(self.level) + sizes)

    def slack(self, pixels, depth):
        """(m,) how far depths of zeros may be off: the tolerance, and the noise over the slope along the ray."""
        step = 1e-6 * self.diagonal
        (high, _), (low, _) = self.away(pixels, depth + step), self.away(pixels, depth - step)
        slope = np.abs(high - low) / (2 * step)
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = np.where(slope > 0, self.noise(pixels, depth) / slope, np.inf)
        return POSITION * self.diagonal + 4 * EPS * np.abs(depth) + np.where(np.isfinite(moved), moved, self.diagonal)


def brackets(rays, pixels, depth):
    """Pixels (m,) and ends (m, 2) between samples at depths (n, k) with values of both signs, both in the domain.

    And those between whose neighbours the values come nearer to zero, (l,) and (l, 2).
    """
    values, inside = rays.away(np.repeat(pixels, depth.shape[1]), depth.reshape(-1))
    values = np.where(inside > 0, values, np.nan).reshape(depth.shape)
    with np.errstate(invalid="ignore"):
        signs, sizes = np.sign(values), np.abs(values)
        row, column = np.nonzero(signs[:, 1:] * signs[:, :-1] < 0)
        alike = (signs[:, 2:] == signs[:, 1:-1]) & (signs[:, :-2] == signs[:, 1:-1])
        nearer = (sizes[:, 1:-1] <= sizes[:, 2:]) & (sizes[:, 1:-1] <= sizes[:, :-2])
        rest = sizes[:, 2:] + sizes[:, :-2] - 2 * sizes[:, 1:-1]
    near, middle = np.nonzero(alike & nearer & (sizes[:, 1:-1] < rest))
    crossing = np.stack([depth[row, column], depth[row, column + 1]], axis=1)
    return (pixels[row], crossing), (pixels[near], np.stack([depth[near, middle], depth[near, middle + 2]], axis=1))


def crossings(rays):
    """Pixels (m,) and depths (m,) of all zeros that dense samples show; poles and jumps are none."""
    seen = np.flatnonzero(rays.counted)
    parts = []
    for some in np.array_split(seen, -(-len(seen) // _CHUNK)) if len(seen) else []:
        line = np.linspace(0.0, 1.0, SAMPLES)
        depth = rays.enter[some, None] + line * (rays.leave - rays.enter)[some, None]
        crossing, near = brackets(rays, some, depth)
        parts.append(crossing)
        closer = near[1][:, :1] + np.linspace(0.0, 1.0, CLOSER) * (near[1][:, 1:] - near[1][:, :1])
        parts.append(brackets(rays, near[0], closer)[0])
    if not parts:
        return np.zeros(0, int), np.zeros(0)
    pixels, ends = (np.concatenate(some) for some in zip(*parts, strict=True))
    low, high = ends.T
    first = rays.away(pixels, low)[0]
    last = np.abs(rays.away(pixels, high)[0])
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = np.sign(rays.away(pixels, middle)[0]) == np.sign(first)
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    value = np.abs(rays.away(pixels, high)[0])
    zero = value <= np.maximum(1e-6 * np.minimum(np.abs(first), last), rays.noise(pixels, high))
    return pixels[zero], high[zero]


def count(own, fields, expression, level, case, frame):
    """The count of an isosurface of an expression."""
    rays = Rays(own, fields, expression, level, frame.view)
    return validate(case, frame, truth_of(rays, frame), rays)


def truth_of(rays, frame):
    """What samples show; a hit that the frame has is one where values on both sides of it have both signs."""
    pixels, depth = crossings(rays)
    slack, inside = rays.slack(pixels, depth), rays.inside(rays.at(pixels, depth))
    border = BORDER + float(rays.rounding.max())
    place = np.zeros(len(pixels), int)
    order = np.lexsort([depth, pixels])
    starts = np.flatnonzero(np.r_[True, np.diff(pixels[order]) > 0]) if len(pixels) else np.zeros(0, int)
    place[order] = np.arange(len(pixels)) - np.repeat(starts, np.diff(np.r_[starts, len(pixels)]))
    width = 1 + (place.max(initial=-1) + 1)
    depths, slacks = np.full((len(rays.ways), width), np.inf), np.zeros((len(rays.ways), width))
    sure = np.zeros(depths.shape, bool)
    depths[pixels, place], slacks[pixels, place] = depth, slack
    # where the slope is nothing it touches
    sure[pixels, place] = (inside > border) & (depth > slack) & (slack < 1e-6 * rays.diagonal)
    depths[:, -1], slacks[:, -1] = confirmed(rays, frame)
    return Truth(rays.counted, depths, sure, slacks, np.zeros(len(rays.ways), bool))


def confirmed(rays, frame):
    """(n,) depths of the frame's hits at which, or on both sides of which, the values are or change; their slack."""
    found = frame.depth.reshape(-1)
    pixels = np.flatnonzero(np.isfinite(found))
    depth = found[pixels]
    own = np.nan_to_num(frame.uncertainty.reshape(-1)[pixels], nan=0.0, posinf=0.0)
    room = POSITION * rays.diagonal + 4 * EPS * depth + np.minimum(own, 1e-8 * depth)
    (before, _), (here, _), (behind, _) = (rays.away(pixels, depth + s * room) for s in (-1, 0, 1))
    with np.errstate(invalid="ignore"):
        there = (before * behind <= 0) | (np.abs(here) <= rays.noise(pixels, depth))
        there &= np.abs(here) <= np.abs(before) + np.abs(behind) + rays.noise(pixels, depth)
        there &= rays.inside(rays.at(pixels, depth)) >= -BORDER - rays.rounding.max()
    depths, slack = np.full(found.shape, np.inf), np.zeros(found.shape)
    depths[pixels[there]], slack[pixels[there]] = depth[there], room[there]
    return depths, slack


FAMILIES = {f"expressions: {kind}": partial(case, kind) for kind in ("proved", "any", "named")}
