"""All zeros of many functions on [0, 1] at once, including close pairs.

Each function is interpolated at Chebyshev points: exactly for polynomials up to the degree, otherwise on parts so short
that its last coefficients vanish.  The sum of its coefficients shows that a part has no zero; the sum of its
derivative's coefficients shows that it has at most one.  All others are bisected (Boyd, Solving Transcendental
Equations, 2014, part I).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.rows import Rows
from elvis.scene.model.time_limit import check_time

#: functions ``which`` (k,) at places (k, m) of [0, 1]: (k, m) values, NaN if there are none
Along = Callable[[Ints, Floats], Floats]

#: minimum degree of interpolation; last coefficients of a resolved series, relative to their sum
_LEAST, _RESOLVED = 6, 1e-10
#: functions farther from their series than this part of the coefficients' sum are not resolved; factor from the
#: distance measured between the nodes to its bound
_CHECKED, _SURE = 1e-6, 2.0
#: maximum number of bisections of a part until it is resolved, and after that until its zeros are separated
_PARTED, _HALVED = 14, 40
#: steps of bisection
_BISECTIONS = 50


@dataclass(frozen=True, eq=False)
class Zeros(Rows):
    """Zeros, in no order.

    which   (k,)  of the functions
    place   (k,)  in [0, 1]
    double  (k,) whether there may be two zeros or none: the function is zero within rounding
    rough   (k,) whether the function is too irregular there, or undefined: only a guess
    """

    which: Ints
    place: Floats
    double: Bools
    rough: Bools

    @classmethod
    def joined(cls, several: Sequence[Zeros]) -> Zeros:
        """Several as one; there may be none."""
        none = Zeros(np.empty(0, np.int64), np.empty(0), np.empty(0, bool), np.empty(0, bool))
        return super().joined([none, *several])


@dataclass(frozen=True, eq=False)
class _Parts(Rows):
    """Parts of [0, 1]: numbers of functions (k,), and their ends (k,)."""

    which: Ints
    low: Floats
    high: Floats

    def halves(self) -> _Parts:
        """The first halves of all, then the second ones."""
        middle = 0.5 * (self.low + self.high)
        return _Parts(np.tile(self.which, 2), np.concatenate([self.low, middle]), np.concatenate([middle, self.high]))

    def zeros(self, place: Floats, double: bool = False, rough: bool = False) -> Zeros:
        """One zero each, at places (k,) of [-1, 1] in them."""
        size = len(self.which)
        where = self.low + 0.5 * (1 + place) * (self.high - self.low)
        return Zeros(self.which, where, np.full(size, double), np.full(size, rough))


def zeros(along: Along, degree: int, accuracy: Floats, noise: Floats | float = 0.0) -> Zeros:
    """All zeros of some functions.

    degree    degree of the polynomials among them; others are approximated by polynomials of this degree
    accuracy  (n,) of each function, relative to its coefficients' sum
    noise     (n,) or for all: values this small may be zero
    """
    count, errors, usual = len(accuracy), accuracy, accuracy
    degree, found = max(degree + 2, _LEAST), []
    parts = _Parts(np.arange(count), np.zeros(count), np.ones(count))
    for depth in range(_PARTED + 1):
        check_time()
        if not len(parts.which):
            break
        shares = parts.low[:, None] + 0.5 * (1 + _nodes(degree)) * (parts.high - parts.low)[:, None]
        values = along(parts.which, shares)
        coefficients = values @ transform(degree)
        rest = np.abs(coefficients[:, -2:]).sum(axis=1)
        size = np.abs(coefficients).sum(axis=1)
        if depth == 0:
            errors, usual = accuracy * size + noise, np.median(np.abs(values), axis=1)
        inexact = errors[parts.which]
        ready = rest <= np.maximum(_RESOLVED * size, inexact)
        # a part with a series far from zero has none; other resolved parts are also checked between the nodes
        near = ~(np.abs(coefficients[:, 0]) > 3 * np.abs(coefficients[:, 1:]).sum(axis=1))
        asked = np.flatnonzero(ready & near)
        off_by = np.zeros(len(ready))
        off_by[asked] = _between_nodes(along, parts.part(asked), coefficients[asked])
        ready &= off_by <= np.maximum(_CHECKED * size, inexact)

        # the error in the last coefficients, including rounding, is in all others as well
        error = np.maximum(np.maximum((degree + 2) * rest, _SURE * off_by), inexact)
        found += _separate(parts.part(ready), coefficients[ready], error[ready])

        open_ = ~ready & near
        if depth == _PARTED:
            found += _unresolved(parts, values, usual, open_)
        parts = parts.part(open_).halves()
    return Zeros.joined(found)


def _unresolved(parts: _Parts, values: Floats, usual: Floats, is_open: Bools) -> list[Zeros]:
    """Possible zeros of the unresolved last parts: one zero if they change their sign, or are small.

    values   (k, n) of the parts' functions at places of them
    usual    (n,) size of each function
    is_open  (k,) which of the parts aren't resolved
    """
    with np.errstate(invalid="ignore"):
        same = (values > 0).all(axis=1) | (values < 0).all(axis=1)
        small = np.abs(values).max(axis=1) <= usual[parts.which]
    left = parts.part(is_open & ~same & ~np.isnan(values).all(axis=1))

    # a kink may touch zero, where a pole is far from it
    touched = parts.part(is_open & same & small)
    return [
        left.zeros(np.zeros(len(left.which)), rough=True),
        touched.zeros(np.zeros(len(touched.which)), double=True, rough=True),
    ]


def _between_nodes(along: Along, parts: _Parts, coefficients: Floats) -> Floats:
    """(k,) how far functions are from their series (k, n) where these differ most, half way between the nodes."""
    places = chebyshev.chebpts2(coefficients.shape[1] + 1)
    values = along(parts.which, parts.low[:, None] + 0.5 * (1 + places) * (parts.high - parts.low)[:, None])
    series = coefficients @ chebyshev.chebvander(places, coefficients.shape[1] - 1).T
    return np.asarray(np.nan_to_num(np.abs(values - series), nan=np.inf).max(axis=1))


def _separate(parts: _Parts, coefficients: Floats, error: Floats) -> list[Zeros]:
    """The zeros of series (k, n) on parts, with errors (k,).

    A derivative is reliable if it exceeds n^2 times the error, which the error may add (Markov 1889); a zero at an end,
    within the error, is put there; the next part may also have it.
    """
    found: list[Zeros] = []
    halve, signs = _halving(coefficients.shape[1] - 1), (-1.0) ** np.arange(coefficients.shape[1])
    for depth in range(_HALVED + 1):
        check_time()
        sizes = np.abs(coefficients)
        kept = ~(sizes[:, 0] - sizes[:, 1:].sum(axis=1) > error)
        parts, coefficients, error = parts.part(kept), coefficients[kept], error[kept]
        derivatives = np.abs(coefficients @ _derivatives(coefficients.shape[1] - 1))
        single = 2 * derivatives[:, 0] - derivatives.sum(axis=1) > (len(signs) - 1) ** 2 * error
        flat = (np.abs(coefficients).sum(axis=1) <= error) | (depth == _HALVED)
        first, last = coefficients @ signs, coefficients.sum(axis=1)
        crossed = ((first > 0) != (last > 0)) & single & ~flat
        found.append(parts.part(crossed).zeros(_bisect(coefficients[crossed])))
        ended = ~crossed & single & ~flat & (np.minimum(np.abs(first), np.abs(last)) <= error)
        found.append(parts.part(ended).zeros(np.where(np.abs(first) <= np.abs(last), -1.0, 1.0)[ended]))
        found.append(parts.part(flat).zeros(np.zeros(int(flat.sum())), double=True))
        more = ~single & ~flat
        if not more.any():
            break
        parts, error = parts.part(more).halves(), np.tile(error[more], 2)
        coefficients = np.concatenate([coefficients[more] @ own for own in halve])
    return found


def _bisect(coefficients: Floats) -> Floats:
    """(k,) the zeros in [-1, 1] of series (k, n) that change their sign once."""
    low, high = np.full(len(coefficients), -1.0), np.ones(len(coefficients))
    series = np.ascontiguousarray(coefficients.T)
    positive = chebyshev.chebval(low, series, tensor=False) > 0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        same = (chebyshev.chebval(middle, series, tensor=False) > 0) == positive
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return 0.5 * (low + high)


@bounded_cache
def _nodes(degree: int) -> Floats:
    """(n,) zeros of the Chebyshev polynomial of the next degree."""
    return np.asarray(chebyshev.chebpts1(degree + 1))


@bounded_cache
def transform(degree: int) -> Floats:
    """(n, n) from values at the nodes to coefficients, as rows."""
    modes = chebyshev.chebvander(_nodes(degree), degree)
    modes[:, 0] *= 0.5
    return np.asarray(modes * 2 / (degree + 1))


@bounded_cache
def _derivatives(degree: int) -> Floats:
    """(n, n - 1) matrix from coefficients to coefficients of the derivative, as rows."""
    return np.asarray(chebyshev.chebder(np.eye(degree + 1), axis=1))


@bounded_cache
def _halving(degree: int) -> tuple[Floats, Floats]:
    """(n, n) from coefficients to those on the first half and on the second one, as rows."""
    nodes = _nodes(degree)
    first, second = (chebyshev.chebvander((nodes + end) / 2, degree).T @ transform(degree) for end in (-1, 1))
    return np.asarray(first), np.asarray(second)
