"""Functions of MFEM at quadrature points: values of each element at the points of a rule.

The function is undefined between these points.  It becomes the polynomial of the lowest order that has its values; if
there are several, the one with minimum norm.  Layout: mfem/mfem, `QuadratureSpace::Save` and `QuadratureFunction`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from elvis.converters.shared.unit import UNIT
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import NodalValues, ShapeFunctions, native_points, space_values
from elvis.plugins.conversion.plugin import PyramidSpace

#: beginning of such files
QUADRATURE = "QuadratureSpace"

_HEAD = re.compile(rf"{QUADRATURE}\s+Type: default_quadrature\s+Order: (\d{{1,3}})\s+VDim: (\d{{1,3}})\s")

#: maximum order of a rule that is requested from the library, and of polynomials through its points
_HIGHEST_RULE, _HIGHEST = 60, 30

#: the library's points in an element like one, of the rule of an order
Rule = Callable[[int, int], Floats]


class QuadratureFunction:
    """A function at quadrature points.

    orders  (m,) of the polynomial through the points of each element
    count   of components
    """

    is_nurbs = False
    is_nodal = True
    is_continuous = False

    def __init__(self, path: Path, text: str, shapes: Mapping[int, Shape], corners: Ints, rule: Rule) -> None:
        match = _HEAD.match(text)
        if match is None or int(match[1]) > _HIGHEST_RULE or not int(match[2]):
            expected = f"the default rules of an order up to {_HIGHEST_RULE} and a number of components"
            raise FormatError(f"expected {expected}, found others", file=path, place=QUADRATURE)
        self.count = int(match[2])
        self._functions = {
            corners_of: PointFunctions(shape, rule(int(np.flatnonzero(corners == corners_of)[0]), int(match[1])))
            for corners_of, shape in shapes.items()
        }
        sizes = np.zeros(len(corners), np.int64)
        self.orders = np.zeros(len(corners), np.int64)
        for corners_of, own in self._functions.items():
            sizes[corners == corners_of] = own.count
            self.orders[corners == corners_of] = own.order
        self._starts, self._corners = np.cumsum(sizes) - sizes, corners
        self._data = _numbers(path, text[match.end() :], int(sizes.sum()), self.count)

    def on(self, elements: Ints) -> NodalValues:
        """Its values on elements of one shape."""
        own = self._functions[int(self._corners[elements[0]])]
        return NodalValues(self._data, own, self._starts[elements][:, None] + np.arange(own.count))


class PointFunctions(ShapeFunctions):
    """Functions of points of a unit element: polynomials that are 1 at one of them and 0 at the others.

    count  number of points (n, d)
    """

    def __init__(self, shape: Shape, points: Floats) -> None:
        self._shape, self.count = shape, len(points)
        for order in range(_HIGHEST + 1):
            table = self._space(order, points)
            if table.shape[1] >= len(points) and np.linalg.matrix_rank(table) == len(points):
                self.order = order
                # among all combinations with these values, the one with the smallest sum of squares
                self._inverse = np.linalg.pinv(table)
                return
        raise FormatError(f"expected points that determine a polynomial of order up to {_HIGHEST}, found {len(points)}")

    def tabulate(self, points: Floats) -> Floats:
        """The polynomials, combined."""
        return np.asarray(self._space(self.order, points) @ self._inverse)

    def _space(self, order: int, points: Floats) -> Floats:
        own = native_points(self._shape, UNIT[self._shape].frame, points)
        return space_values(self._shape, order, own, PyramidSpace.TENSOR)


def _numbers(path: Path, text: str, points: int, count: int) -> Floats:
    """(points, count) values."""
    words = text.split()
    if len(words) != points * count:
        raise FormatError(f"expected {points * count} numbers, found {len(words)}", file=path, place="values")
    try:
        return np.array(words, np.float64).reshape(points, count)
    except ValueError:
        raise FormatError("expected numbers, found something else", file=path, place="values") from None
