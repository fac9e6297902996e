"""Boxes on which a flow turns less than the limit everywhere: bounds on the discriminant of its gradient.

With A the gradient minus a third of its trace, y = tr A^2 / 2 and r = det A, its characteristic polynomial is t^3 - y t
- r.  Complex eigenvalues with an imaginary part v satisfy r^2 = 4/27 (v^2 + y) (4 v^2 + y)^2, which increases with v;
if r^2 is smaller, all imaginary parts are below v (as in `levels`).

y and r are polynomials.  Bounds on the entries of A are of no use in a shear layer, where A is large and its
eigenvalues are small.  The right side minus r^2 has six times the degree of A, so y and r are first approximated by
cubics, and the errors of these are subtracted.
"""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.core.cores.boxes import Boxes, at_nodes, through
from elvis.core.polynomials.boxnets import difference

#: degree of the approximation of y and r; rounding, relative to powers of A and to terms of both
_DEGREE, _ROUNDING = 3, 1e-13


def turns_less(boxes: Boxes) -> Bools:
    """(k,) whether complex eigenvalues have imaginary parts below what counts, or there are none, all over boxes."""
    y, y_off = _reduced(boxes.square)
    r, r_off = _reduced(boxes.cubic)
    y_off += _ROUNDING * boxes.scale**2
    r_off += _ROUNDING * boxes.scale**3

    # where this is positive, y - y_off exceeds -v^2, and the right side increases with y
    degree = max(3 * (y.shape[2] - 1), 2 * (r.shape[2] - 1))
    least = at_nodes(y, degree) - _over(y_off)
    square = _over(boxes.least**2)
    right = 4 / 27 * (square + least) * (4 * square + least) ** 2
    values = at_nodes(r, degree)
    left = values**2 + _over(2 * np.abs(values).max(axis=(1, 2, 3, 4), initial=0.0) * r_off + r_off**2)
    size = (np.abs(right) + left).max(axis=(1, 2, 3, 4), initial=0.0)
    return np.asarray(through(right - left, degree).min(axis=(1, 2, 3, 4), initial=np.inf) > _ROUNDING * size)


def _reduced(nets: Floats) -> tuple[Floats, Floats]:
    """Nets (k, 1, …) of a low degree, and their maximum errors (k,)."""
    degree = nets.shape[2] - 1
    if degree <= _DEGREE:
        return nets, np.zeros(len(nets))
    found = through(at_nodes(nets, _DEGREE), _DEGREE)
    return found, np.abs(difference(found[:, 0], nets[:, 0])).max(axis=(1, 2, 3), initial=0.0)


def _over(numbers: Floats) -> Floats:
    return numbers[:, None, None, None, None]
