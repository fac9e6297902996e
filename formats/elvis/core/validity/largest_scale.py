"""The smallest factor of a displacement at which an element folds, certified from below and from above.

The determinant of the map x + S d is a polynomial in S, of the degree of the elements' dimension n:

    det(a_1 + S b_1, …, a_n + S b_n) = sum_k S^k c_k(xi),

where a_i and b_i are the tangents of x and of d, and c_k is the sum of the determinants with k of the columns b.  In
Bernstein form in S on [0, T] it is one more direction of a box net: if the search for its minimum proves that it is
positive there, no element folds at any factor up to T.  From above one point of one element is enough: the smallest
root S of the determinant there.  The search names the point with the lowest value, whose root is the next bound from
above, like Newton's method; it ends when both bounds meet.

If several directions collapse at once, as in a swelling, the root is multiple, and the determinant is lost in rounding
near it.  The Jacobian itself is not: from below it is proved to be regular, and from above the roots at a point are
taken from the eigenvalues of the matrix -A^-1 B, where A and B are the Jacobians of x and of d.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import comb, inf

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.deformed.deforming import MovingMaps
from elvis.core.polynomials.bernstein import line_tables
from elvis.core.polynomials.boxnets import box_nets
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.evaluation import evaluate, evaluate_with_gradients
from elvis.core.shapes import Shape
from elvis.core.validity.descent import least
from elvis.core.validity.determinants import Polynomials, determinant_of, tangents
from elvis.core.validity.regularity import are_regular_between
from elvis.core.validity.squares import lower_bound

#: relative distance of the two bounds
TOLERANCE = 1e-6
#: share of it by which the bound from below lies below the root, and that from above above it
BELOW, ABOVE = 0.6, 0.1
#: largest factor that is examined, relative to the one at which displacements are as large as elements
FARTHEST = 1e6
#: the same of factors up to which proofs may take long though no root is known
USUAL = 100
#: candidates and bisections after which the bounds that are known are returned
MOST_STEPS = 60
#: relative distance within which roots of the determinant are multiple ones, of matrices of three rows
MULTIPLE = 1e-3
#: imaginary part of a root, relative to it, up to which it is a double root of rounded coefficients
IMAGINARY = 1e-6
#: numbers in the nets that are made at once
_NUMBERS = 1 << 22
_UNIT = np.finfo(np.float64).eps / 2


@dataclass(frozen=True)
class LargestScale:
    """Bounds of the smallest factor S > 0 at which the Jacobian of an element is not positive.

    valid    no element folds at any factor from 0 to this one: proved
    folded   factor at which one is not valid; inf if none was found up to ``valid``, the largest factor considered
    state    what is proved of the Jacobian there: "negative", "zero" within rounding, or "undecided"
    element  id of the element, -1 if there is none
    reference, before, after  its point in the coordinates xi, before the deformation, and at the factor ``folded``
    """

    valid: float
    folded: float
    state: str = "undecided"
    element: int = -1
    reference: tuple[float, ...] = ()
    before: tuple[float, ...] = ()
    after: tuple[float, ...] = ()

    @property
    def is_certified(self) -> bool:
        """Whether both bounds are proved and differ by at most the tolerance."""
        if self.folded == inf:
            return self.valid > 0
        return self.state != "undecided" and self.folded - self.valid <= TOLERANCE * self.folded


def largest_scale(maps: Iterable[MovingMaps], space: int) -> LargestScale:
    """The bounds for elements in a space of as many dimensions as they have.

    Raises ElvisError if space has more dimensions: areas in space have no sign.
    """
    every = list(maps)
    if any(own.expansion.shape.dimension != space for own in every):
        raise ElvisError("expected elements of the dimension of space, found others")
    pieces = [piece for own in every for piece in _pieces(own, space)]
    return _Search(pieces).result()


@dataclass(frozen=True, eq=False)
class _Piece:
    """Elements with their determinants as polynomials in S.

    rows    (n,) of the elements among those of ``maps``
    nets    (n, D1, …, Dd, n + 1)  box nets of c_0, c_1, …, each along the last axis
    errors  (n, n + 1)  what rounding may have done to their coefficients
    ratios  (n,)        how large tangents of x are compared to those of d
    """

    maps: MovingMaps
    rows: Ints
    nets: Floats
    errors: Floats
    ratios: Floats

    @property
    def sizes(self) -> Floats:
        """(n, n + 1) largest coefficients."""
        return np.asarray(np.abs(self.nets).max(axis=tuple(range(1, self.nets.ndim - 1))))

    def error_at(self, scale: float) -> Floats:
        """(n,) bound of the rounding errors of values at factors up to one."""
        powers = scale ** np.arange(self.nets.shape[-1])
        # Horner's rule and the change to Bernstein form round each term a few times
        return np.asarray((self.errors + 16 * _UNIT * self.sizes) @ powers)

    def boxes(self, low: float, high: float) -> Floats:
        """(n, D1, …, Dd, n + 1) box nets in xi and S on [low, high].

        S = low + width t, and t^j = sum_i C(i, j)/C(n, j) b_i^n(t).
        """
        degree = self.nets.shape[-1] - 1
        matrix = np.zeros((degree + 1, degree + 1))
        for k, j, i in product(range(degree + 1), repeat=3):
            if j <= k and j <= i:
                share = comb(i, j) / comb(degree, j) * comb(k, j)
                matrix[k, i] += share * low ** (k - j) * (high - low) ** j
        return np.asarray(self.nets @ matrix)

    def at(self, row: int, eta: Floats) -> Floats:
        """(n + 1,) the values of c_k at collapsed coordinates (d,) of an element."""
        net = self.nets[row]
        for coordinate in eta:
            table = line_tables(net.shape[0] - 1, np.array([(1 + coordinate) / 2]))[0, 0]
            net = np.tensordot(table, net, 1)
        return np.asarray(net)


def _pieces(maps: MovingMaps, space: int) -> Iterator[_Piece]:
    """The determinants of elements, some elements after another."""
    modes = maps.places.shape[-1]
    step = max(1, _NUMBERS // (modes * 3**space * (space + 1)))
    for first in range(0, len(maps.element_ids), step):
        rows = np.arange(first, min(first + step, len(maps.element_ids)))
        columns = [tangents(maps.expansion, own[rows]) for own in (maps.places, maps.moves)]
        terms: list[Polynomials | None] = [None] * (space + 1)
        for choice in product((0, 1), repeat=space):
            own = determinant_of([columns[which][axis] for axis, which in enumerate(choice)], space)
            known = terms[sum(choice)]
            terms[sum(choice)] = own if known is None else known + own
        found = [own for own in terms if own is not None]
        nets = np.stack([box_nets(own.space, np.ascontiguousarray(own.net.T)) for own in found], axis=-1)
        errors = np.stack([own.error for own in found], axis=1)
        if maps.expansion.shape is Shape.SEGMENT:
            # segments on a line may run either way
            nets *= np.sign(nets[..., 0].mean(axis=1))[:, None, None]
        still, moving = (np.max([own.magnitude for column in every for own in column], axis=0) for every in columns)
        with np.errstate(divide="ignore"):
            yield _Piece(maps, rows, nets, errors, still / moving)


@dataclass(frozen=True)
class _Candidate:
    """A point at which the determinant has a root in S: piece, row in it, collapsed coordinates."""

    scale: float
    piece: int
    row: int
    eta: tuple[float, ...]


class _Search:
    """The search for the smallest root, among all elements."""

    def __init__(self, pieces: Sequence[_Piece]) -> None:
        self._every = pieces
        self._known = _Candidate(inf, -1, -1, ())
        typical = min((float(piece.ratios.min(initial=inf)) for piece in pieces), default=inf)
        self._typical = typical if typical < inf else 1.0
        self._farthest = FARTHEST * self._typical
        for number, piece in enumerate(pieces):
            self._sample(number, piece)

    def _sample(self, number: int, piece: _Piece) -> None:
        """Take note of the smallest root at corners and middles of elements."""
        dimension = piece.nets.ndim - 2
        places = [*product((-1.0, 1.0), repeat=dimension), (0.0,) * dimension]
        for place in places:
            net = piece.nets
            for coordinate in place:
                table = line_tables(net.shape[1] - 1, np.array([(1 + coordinate) / 2]))[0, 0]
                net = np.tensordot(net, table, (1, 0))
            roots = _smallest_roots(net, piece.error_at(0.0))
            row = int(np.argmin(roots))
            if roots[row] < min(self._known.scale, self._farthest):
                self._known = _Candidate(float(roots[row]), number, row, place)

    def result(self) -> LargestScale:
        """The bounds."""
        low, suspects = 0.0, [(number, piece) for number, piece in enumerate(self._every)]
        aim = None
        for _ in range(MOST_STEPS):
            if self._known.scale == 0.0:
                break
            end = min(self._known.scale, self._farthest)
            goal = end * (1 - BELOW * TOLERANCE)
            # over wide ranges the powers of S differ by many orders of magnitude, and a small c_0 is lost among them
            octave = min(goal, max(2 * low, self._typical))
            top = octave if aim is None else aim
            before = self._known.scale
            remaining = self._doubtful(suspects, low, top)
            if self._known.scale < before:
                aim = None
                continue
            if not remaining:
                low, aim = top, None
                if top == goal:
                    break
                continue
            # neither a root nor a proof: a shorter range is proved, as long as that helps; without a root even doubtful
            # factors are beyond use
            aim = (low + top) / 2
            if top - low <= (TOLERANCE * end / 4 if self._known.scale < inf else low):
                break
        return self._told(self._regular_up_to(low))

    def _regular_up_to(self, low: float) -> float:
        """A factor up to which no element folds, given a smaller one, by proofs that the Jacobian is regular."""
        if self._known.piece >= 0 and self._known.scale > 0:
            self._known = replace(self._known, scale=self._eigenvalue())
        end = min(self._known.scale, self._farthest) * (1 - BELOW * TOLERANCE)
        for _ in range(MOST_STEPS):
            if low >= end:
                break
            # the Jacobian shrinks with the distance to the root: steps halve that
            high = min(end, (low + end / (1 - BELOW * TOLERANCE)) / 2)
            if not all(self._is_regular(piece, low, high) for piece in self._every):
                break
            low = high
        return low

    @staticmethod
    def _is_regular(piece: _Piece, low: float, high: float) -> bool:
        """Whether no element of a piece folds between two factors."""
        nets, error = piece.boxes(low, high), piece.error_at(high)
        rows = piece.rows[nets.reshape(len(nets), -1).min(axis=1) <= error]
        if not len(rows):
            return True
        maps = piece.maps
        first, last = (maps.places[rows] + scale * maps.moves[rows] for scale in (low, high))
        return bool(are_regular_between(maps.expansion, first, last).all())

    def _eigenvalue(self) -> float:
        """The root at the known point, by eigenvalues."""
        known = self._known
        piece = self._every[known.piece]
        maps, row = piece.maps, piece.rows[known.row]
        shape = maps.expansion.shape
        # on collapsed sides the derivatives of the map are those of a point next to them
        reference = uncollapse(shape, np.array([known.eta]))
        still, moving = (
            evaluate_with_gradients(maps.expansion, own[row : row + 1, : shape.dimension], reference)[1][0, :, 0]
            for own in (maps.places, maps.moves)
        )
        values = np.linalg.eigvals(-np.linalg.solve(still, moving))
        real = values.real[(np.abs(values.imag) <= IMAGINARY * np.abs(values)) & (values.real > 0)]
        found = 1 / float(real.max()) if len(real) else inf
        # another root is one of another point, or none
        return found if abs(found - known.scale) <= MULTIPLE * known.scale else known.scale

    def _doubtful(self, suspects: list[tuple[int, _Piece]], low: float, high: float) -> bool:
        """Whether some elements are not proved to be valid from one factor to another; roots found are noted."""
        is_doubtful = False
        is_quick = self._known.scale == inf and high > USUAL * self._typical
        for number, piece in suspects:
            error = piece.error_at(high)
            nets = piece.boxes(low, high)
            flat = nets.reshape(len(nets), -1)
            rows = np.flatnonzero(flat.min(axis=1) <= error)
            if not len(rows):
                continue
            found = least(nets[rows], error[rows], goal=2 * error[rows])
            bad = found.lower <= error[rows]
            for row, place, value in zip(rows[bad].tolist(), found.place[bad], found.value[bad], strict=True):
                is_open = value <= error[row] or is_doubtful or is_quick
                is_doubtful = is_open or not _is_positive(nets[row], float(error[row]))
                self._note(number, piece, row, place[:-1])
        return is_doubtful

    def _note(self, number: int, piece: _Piece, row: int, eta: Floats) -> None:
        """Take note of the root at a point."""
        values, error = piece.at(row, eta)[None], piece.error_at(0.0)[row : row + 1]
        root = float(_smallest_roots(values, error)[0])
        if root < min(self._known.scale, self._farthest):
            self._known = _Candidate(root, number, row, tuple(eta.tolist()))

    def _told(self, low: float) -> LargestScale:
        known = self._known
        if known.piece < 0:
            return LargestScale(low, inf)
        piece = self._every[known.piece]
        values = piece.at(known.row, np.array(known.eta))
        above = known.scale * (1 + ABOVE * TOLERANCE)
        error = float(piece.error_at(above)[known.row])
        beyond, there = np.polynomial.polynomial.polyval([above, known.scale], values).tolist()
        state = "negative" if beyond < -error else "zero" if min(abs(beyond), abs(there)) <= error else "undecided"
        shape, row = piece.maps.expansion.shape, piece.rows[known.row]
        reference = uncollapse(shape, np.array([known.eta]))
        places, moves = (
            evaluate(piece.maps.expansion, own[row : row + 1], reference)[0, :, 0]
            for own in (piece.maps.places, piece.maps.moves)
        )
        element = int(piece.maps.element_ids[row])
        after = places + above * moves
        return LargestScale(
            low, above, state, element, tuple(reference[0].tolist()), tuple(places.tolist()), tuple(after.tolist())
        )


def _is_positive(net: Floats, error: float) -> bool:
    """Whether a polynomial in xi and S is proved to be positive where it comes near zero along a line or a surface.

    So it is if all of its Bernstein coefficients in S are, which are polynomials in xi: squares are subtracted.
    """
    parts = (own for own in np.moveaxis(net, -1, 0) if own.min() <= error)
    return all(lower_bound(own, 2 * error) > error for own in parts)


def _smallest_roots(values: Floats, error: Floats) -> Floats:
    """(n,) smallest positive roots of polynomials with coefficients (n, d + 1), lowest first; inf without any.

    error  (n,) of the constant terms: those that are no larger count as zero, and so does their root

    With t = 1/S the polynomial is monic but for its constant term: eigenvalues of its companion matrix are all roots.
    """
    count, degree = len(values), values.shape[1] - 1
    found, good = np.zeros(count), values[:, 0] > error
    matrices = np.zeros((int(good.sum()), degree, degree))
    matrices[:, range(1, degree), range(degree - 1)] = 1.0
    matrices[:, 0] = -values[good, 1:] / values[good, :1]
    roots = np.linalg.eigvals(matrices)
    is_real = (np.abs(roots.imag) <= IMAGINARY * np.abs(roots)) & (roots.real > 0)
    largest = np.where(is_real, roots.real, 0.0).max(axis=1, initial=0.0)
    with np.errstate(divide="ignore"):
        found[good] = 1 / largest
    return found
