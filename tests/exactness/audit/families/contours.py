"""Contours of one straight coordinate on plane data and plane cuts: lines near one another or touching, and poles.

How far a line covers a pixel follows from its distance in pixels.
"""

from fractions import Fraction
from functools import partial

import numpy as np

from audit.cases import Case, exact
from audit.polynomials import Y
from audit.validating import counted_as
from audit.worlds import world
from elvis import Camera, Contours, CutSurface, Plane, Style
from elvis.core.shapes import Shape
from elvis.scene.record.frame import Status

#: how far coverages may be from the truth: the middle of a line is displaced by no more, in pixels
CLOSE = 0.02
#: expressions of y with a value, and where they have it in the unit interval
EXPRESSIONS = {
    ("tan(8*u)", 0.5): [(np.arctan(0.5) + k * np.pi) / 8 for k in range(3)],
    ("1/u", 4.0): [0.25],
    ("1/(u-0.3)", 0.0): [],
    ("1/(u-0.3)", 8.0): [0.425],
    ("sign(u-0.3)", 0.5): [],
    ("abs(u-0.3)", 0.125): [0.175, 0.425],
    ("sqrt(u)", 0.5): [0.25],
    ("u/(u-0.5)", 3.0): [0.75],
}
#: functions of u = y - c that grow with |u|, with kinks and without: lines at c - d and c + d
EVEN = {
    "abs(u)": abs,
    "max(u,-u)": abs,
    "cosh(u)": np.cosh,
    "1-exp(-u^2)": lambda d: -np.expm1(-d * d),
    "sqrt(u^2+0.01)": lambda d: np.sqrt(d * d + 0.01),
    "u*tanh(u)": lambda d: d * np.tanh(d),
}


def case(family, rng, size):
    """Contours on one picture, seen from above with any side up."""
    # each shape has kernels of its own for every expression
    dimension = 2 if quantities_differ(family) else int(rng.choice([2, 3]))
    flat = (Shape.QUADRILATERAL,) if quantities_differ(family) else None
    shapes = (Shape.HEXAHEDRON,) if dimension == 3 else flat
    own = world(rng, dimension, shapes, placements=("plain", "off", "mirrored"))
    quantity, level, roots, field = {"poles": _poles, "expressions": _even}.get(family, _pair)(rng)
    data, multiple, _ = exact(own, field, 4)
    if family == "expressions":
        level = float(EVEN[quantity](level * multiple))
    angle, width = float(rng.uniform(0, 2 * np.pi)), float(rng.choice([1.0, 1.5, 3.0]))
    middle = own.placed(own.bent(rng.uniform(0.2, 0.8, (1, 3)) * [1, 1, dimension == 3]))[0]
    x, y, z = map(float, middle)
    up, height = (float(np.sin(angle)), float(np.cos(angle)), 0.0), float(rng.choice([0.3, 1.0, 2.5]))
    view = Camera((x, y, z + 3.0), (x, y, z), up, height=height)
    values = (level if quantity else level * multiple,)
    style = Style(color=(1.0, 1.0, 1.0), lit=False, contours=Contours(values, width=width, quantity=quantity))
    item = CutSurface(Plane((0.0, 0.0, z), (0.0, 0.0, 1.0)), style)
    scene = {"field": "u", "camera": view, "size": size, "objects": (item,), "stats": "counts.json"}
    told = f"{quantity or 'u'} = {values[0]!r}, lines at y = {', '.join(map(str, roots)) or 'nothing'}"
    name = f"{own.name}, {told}, width {width}, {view}"
    ordinary = len(set(roots)) > 1 and abs(roots[1] - roots[0]) > 0.1 and family != "poles"
    return Case(name, data, scene, partial(count, own, [float(root) for root in roots], width), ordinary)


def quantities_differ(family):
    """Whether a family is of expressions, each of which has kernels of its own."""
    return family in ("poles", "expressions")


def _poles(rng):
    """A quantity of u = y, a value, the places that have it, and the field."""
    names = list(EXPRESSIONS)
    quantity, level = names[rng.integers(len(names))]
    return quantity, level, EXPRESSIONS[quantity, level], Y


def _even(rng):
    """As _poles: two lines as near to one another as d is small; the value is that of u."""
    names, middle = list(EVEN), Fraction(int(rng.integers(8, 56)), 64)
    half = Fraction(1, 2 ** int(rng.integers(4, 13)))
    return names[rng.integers(len(names))], float(half), [middle - half, middle + half], Y - middle


def _pair(rng):
    """Two lines of u = 0, one that touches, or none; as _poles."""
    first = Fraction(int(rng.integers(1, 63)), 64)
    apart = Fraction(1, 2 ** int(rng.integers(1, 30)))
    if rng.random() < 0.25:
        return None, 0.0, [], (Y - first) ** 2 + Fraction(1, 2 ** int(rng.integers(4, 36)))
    other = first if rng.random() < 0.2 else first + apart
    return None, 0.0, [first, other], (Y - first) * (Y - other)


def count(own, roots, width, case, frame):
    """The count of what lines cover of the pixels where something is hit."""
    height = frame.scene.objects[0].surface.point[2] if frame.scene.objects else 0.0
    rows, columns = np.divmod(np.arange(frame.view.count), frame.view.width)
    distance = np.full(frame.view.count, np.inf)
    for root in roots:
        ends = segment(own, root, height)
        if ends is not None:
            distance = np.minimum(distance, _to_segment(frame.view, ends, columns, rows))
    expected = np.clip(0.5 * width + 0.5 - distance, 0.0, min(1.0, width))
    found, hit = 1.0 - frame.color.reshape(-1, 3).mean(axis=1), frame.element.reshape(-1) >= 0
    status = frame.line_status.reshape(-1)
    wrong = hit & (status == Status.CERTAIN) & ~(np.abs(found - expected) <= CLOSE)

    def details(pixel):
        row, column = divmod(pixel, frame.view.width)
        return f"pixel ({column}, {row}): expected coverage {expected[pixel]:.4f}, found {found[pixel]:.4f}"

    return counted_as(case, status, hit, {"the wrong coverage": wrong}, details)


def segment(own, root, height):
    """(2, 3) world ends of the line Y = root at a height; None where it is not in the domain."""
    (a, b), (e, f) = own.bend, own.shear
    local = (height - own.shift[2]) / own.scale[2]
    if not 0.0 <= root <= 1.0 or (own.dimension == 3 and not 0.0 <= local - b * root**2 - f * root <= 1.0):
        return None
    first = a * root**2 + e * root
    return own.placed(np.array([[first, root, local], [first + 1.0, root, local]]))


def _to_segment(view, ends, columns, rows):
    """(n,) distances of pixels from a segment with world ends (2, 3), seen in parallel."""
    first, last = np.column_stack([ends, np.ones(2)]) @ view.to_pixel[:2].T
    along = last - first
    place = np.column_stack([columns, rows]) - first
    part = np.clip(place @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(place - part[:, None] * along, axis=1)


FAMILIES = {f"contours: {name}": partial(case, name) for name in ("near pairs", "poles", "expressions")}
