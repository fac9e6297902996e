"""Pairs of an element and a pixel where a quantity may have a value; no relevant pair is missing.

Elements are divided into boxes of the collapsed coordinates, in which maps and fields are polynomials of known degrees
in each direction, bounded by their values at Chebyshev points (`chebyshev`).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise, product

import numpy as np

from elvis.core.base.arrays import Floats, Ints, joined_columns
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.shapes import Shape
from elvis.reference.chebyshev import SAMPLES, bounds_of, degrees_of, lattice, map_degrees
from elvis.reference.quantities import Corners, Quantities
from elvis.reference.scenes.rasters import pixels_between
from elvis.reference.solids import map_lattice
from elvis.scene.cameras.view import View
from elvis.scene.model.time_limit import check_time

#: numbers of bisections of a box of few and of many elements along each direction; number of few; maximum of samples
#: along a direction
_HALVINGS, _FEW, _MOST = (1, 2), 256, 128
#: values that are evaluated together
_AT_ONCE = 1 << 23


def candidates(patch: Patch, quantities: Quantities, name: str, value: float, view: View) -> Ints:
    """(n,) sorted numbers row * pixels + pixel of elements and pixels whose ray may meet the value in the element."""
    function, degrees = quantities.corners()[name], field_degrees(patch, quantities, name)
    found, halvings = [np.empty(0, np.int64)], _halvings(patch, degrees)
    for whole in _wholes(patch):
        for own, box in _holding(patch, np.arange(len(patch)), function, degrees, value, whole, halvings):
            low, high = _rectangles(patch, own, box, view)
            pairs = [own[which] * view.count + pixel for which, pixel in pixels_between(view, low, high)]
            found += [np.unique(pair) for pair in pairs]
    return np.unique(np.concatenate(found))


def field_degrees(patch: Patch, quantities: Quantities, name: str) -> tuple[int, ...]:
    """Degrees of a quantity in each collapsed coordinate."""
    expansion = quantities.expansion(name, patch)
    if expansion is None:
        return (quantities.guessed_degree(name, patch),) * patch.dimension
    return degrees_of(patch, expansion)


def degree_along(patch: Patch, quantities: Quantities, name: str) -> int:
    """Degree of a quantity along straight lines through the reference element."""
    own = field_degrees(patch, quantities, name)
    if quantities.expansion(name, patch) is None or patch.shape not in (Shape.TETRAHEDRON, Shape.PRISM, Shape.TRIANGLE):
        return sum(own)
    return sum(own[1:]) if patch.shape is not Shape.TETRAHEDRON else own[2]


def _wholes(patch: Patch) -> list[Floats]:
    """Boxes (2, d) of collapsed coordinates that make up an element: in Fourier directions two for each plane."""
    layers = 2 * len(patch.homogeneous.z_ids) if patch.homogeneous else 1
    sides = [np.linspace(-1.0, 1.0, layers + 1)] * len(patch.periods)
    ends = [[(-1.0, 1.0)]] * patch.shape.dimension + [list(pairwise(side)) for side in sides]
    return [np.array(box).T for box in product(*ends)]


def _halvings(patch: Patch, degrees: tuple[int, ...]) -> int:
    """Number of bisections that pays off: tables for them serve all elements."""
    most = _HALVINGS[len(patch) >= _FEW]
    return next(n for n in range(most, -1, -1) if n == 0 or SAMPLES * max(degrees) << n <= _MOST)


def _holding(
    patch: Patch, rows: Ints, function: Corners, degrees: tuple[int, ...], value: float, box: Floats, halvings: int
) -> Iterator[tuple[Ints, Floats]]:
    """The elements in whose box (2, d) the function may have the value.

    The same for its parts after some bisections, with these parts.
    """
    check_time()
    points, divisor = _sample(patch.shape, box, degrees)
    parts = np.array_split(rows, -(-len(rows) * len(points) // _AT_ONCE) or 1)
    bounds = [bounds_of(function(patch, part, points), divisor) for part in parts]
    low, high = joined_columns(bounds)
    rows = rows[~((low > value) | (high < value))]
    if not halvings or not len(rows):
        yield rows, box
        return
    sides = [((low, 0.5 * (low + high)), (0.5 * (low + high), high)) for low, high in box.T]
    for part in product(*sides):
        yield from _holding(patch, rows, function, degrees, value, np.array(part).T, halvings - 1)


def _sample(shape: Shape, box: Floats, degrees: tuple[int, ...]) -> tuple[Floats, float]:
    """Reference points (k, d) of a box of collapsed coordinates, and how much greater than there values may be."""
    unit, divisor = lattice(degrees)
    eta = box[0] + 0.5 * (1 + unit) * (box[1] - box[0])
    spatial = shape.dimension
    return np.column_stack([uncollapse(shape, eta[:, :spatial]), eta[:, spatial:]]), divisor


def _rectangles(patch: Patch, rows: Ints, box: Floats, view: View) -> tuple[Floats, Floats]:
    """Smallest and largest columns and rows (e, 2) of a box of some elements on the screen.

    All if it isn't before the eye.
    """
    points, divisor = _sample(patch.shape, box, map_degrees(patch))
    parts = np.array_split(rows, -(-len(rows) * 3 * len(points) // _AT_ONCE) or 1)
    ends: list[Floats] = []
    for part in parts:
        placed = view.projected(map_lattice(patch, part, points))
        low, high = bounds_of(placed.transpose(0, 2, 1).reshape(-1, len(points)), divisor)
        ends.append(np.stack([low, high]).reshape(2, len(part), 3))
    low, high = np.concatenate(ends, axis=1)

    # a quotient is extreme at extreme weights
    with np.errstate(divide="ignore", invalid="ignore"):
        every = np.stack([own[:, :2] / weight[:, 2:] for own in (low, high) for weight in (low, high)])
    behind, crosses = high[:, 2] <= 0, low[:, 2] <= 0
    first, last = every.min(axis=0), every.max(axis=0)
    first[crosses], last[crosses] = -np.inf, np.inf
    last[behind] = -np.inf
    return first, last
