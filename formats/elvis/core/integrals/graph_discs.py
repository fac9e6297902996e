"""Complex neighbourhoods of parts of boxes that a graph g = 0 cuts: discs of their three coordinates.

A part between breaks (see `graphs`) is the image of a cube [-1, 1]^3,

    i = i_0 + h v_1,   j = (s + e)/2 + v_2 (e - s)/2,   k = (l + u)/2 + v_3 (u - l)/2

Here s and e are 0, 1 or roots of g on a face across k, as functions of i.  The ends l and u are 0, 1 or the root of g,
as functions of i and j.  With a = i - i_0 and b = j - j_0, a root is k = k_0 + P(a, b) + t, where P has the root's
first and second derivatives at the centre.  Then h(a, b, t) = (1 + p a + q b) g has the same zeros; p and q are chosen
such that h_t is stationary at the centre.  If |h - c t| < |c| w for |a| <= r, |b| <= s and |t| = w, then h has one zero
t in the disc |t| < w for all a and b (Rouché).  It is simple and an analytic function of a and b (implicit function
theorem).  On the surface, the derivatives of g in a, b and t have the same ratios as the derivatives of h.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import EPS, Bools, Floats, Ints
from elvis.core.base.rows import Rows
from elvis.core.integrals.cut_expansions import Expansion
from elvis.core.integrals.graphs import between, roots
from elvis.core.integrals.taylor import taylor
from elvis.core.polynomials.bernstein import line_tables
from elvis.core.quantities import discs
from elvis.core.quantities.discs import Disc

#: parameters of Bernstein ellipses; the best one is used
RHOS = np.array([1.6, 2.2, 3.0, 4.0, 5.5, 8.0])
#: steps in which the disc of a root is enlarged, and by how much each
_STEPS, _ENLARGED = 8, 1.05
#: the last columns are for surfaces that are moved along k: by a part of their own height, which is limited from below
#: and above, and by a small part of the height of the box, for which more is proved
MOVED = 2
_SHIFT, _LEAST_HEIGHT, _GREATEST_HEIGHT = 0.1, 0.1, 1.0
_SMALL_SHIFT = 1e-4
#: rounding of a place in a box
_ROUNDING = 64 * EPS
#: kind of an end of a part in direction j: a face of the box, or the root on one of the faces across k
_FIXED, _BELOW, _ABOVE = -1, 0, 1


@dataclass(frozen=True, eq=False)
class GraphParts(Rows):
    """Parts of boxes between breaks.

    box         (n,)    number of the box
    low, high   (n,)    ends in i
    ends        (n, 2)  ends in j in the middle of these
    kinds       (n, 2) kinds of these ends
    root        (n,) k of the surface in the middle of both; 1 without a surface
    has_root    (n,) whether there is a surface
    is_below    (n,)    whether g is negative at k = 0
    """

    box: Ints
    low: Floats
    high: Floats
    ends: Floats
    kinds: Ints
    root: Floats
    has_root: Bools
    is_below: Bools


def graph_parts(nets: Floats) -> GraphParts:
    """The parts of boxes with nets (n, Di, Dj, Dk), in which g = 0 is a graph k(i, j) with ends j(i)."""
    if nets.shape[1] > 1:
        corners = [roots(nets[:, :, j, k]) for j in (0, -1) for k in (0, -1)]
        box, low, high = between(np.stack(corners, axis=1))
    else:
        box, low, high = np.arange(len(nets)), np.zeros(len(nets)), np.ones(len(nets))
    middle = (low + high) / 2
    slices = np.einsum("na,nabc->nbc", line_tables(nets.shape[1] - 1, middle)[0], nets[box])

    # the ends in j: 0, roots on both faces across k, 1
    faces = [slices[:, :, k] for k in (0, -1)]
    is_met = np.stack([(face[:, 0] >= 0) != (face[:, -1] >= 0) for face in faces], axis=1)
    row, start, end = between(np.stack([roots(face) for face in faces], axis=1))
    kinds = np.stack([_kind_of(place, faces, is_met, row) for place in (start, end)], axis=1)
    lines = np.einsum("nb,nbc->nc", line_tables(nets.shape[2] - 1, (start + end) / 2)[0], slices[row])
    has_root = (lines[:, 0] >= 0) != (lines[:, -1] >= 0)
    ends = np.stack([start, end], axis=1)
    return GraphParts(box[row], low[row], high[row], ends, kinds, roots(lines), has_root, lines[:, 0] < 0)


def _kind_of(place: Floats, faces: list[Floats], is_met: Bools, row: Ints) -> Ints:
    """(n,) what ends in j at places (n,) are."""
    found = np.full(len(place), _FIXED)
    for kind, face in zip((_BELOW, _ABOVE), faces, strict=True):
        here = is_met[row, kind] & (roots(face)[row] == place)
        found[here] = kind
    return found


def root_radii(level: Expansion, first: Floats, second: Floats) -> Floats:
    """(n, columns) radii w of discs that hold one root t of h(a, b, t) for |a| <= r, |b| <= s; inf if unproved.

    level          the expansion of h
    first, second  (n, columns) radii r and s
    """
    by_power = level.by_power(first, second)
    steep = np.abs(level.steepness)[:, None]
    by_power[..., 0] += _ROUNDING * np.abs(level.coefficients).sum(axis=(1, 2, 3))[:, None]
    by_power[..., 1] -= steep * (1 - _ROUNDING)
    orders = np.arange(by_power.shape[2])

    def rest(radius: Floats) -> Floats:
        """Upper bounds of |h - c t|."""
        return np.asarray((by_power * radius[..., None] ** orders).sum(axis=2))

    radius = by_power[..., 0] / steep
    for _ in range(_STEPS):
        radius = _ENLARGED * rest(radius) / steep
    return np.where(rest(radius) < steep * radius, radius, np.inf)


@dataclass(frozen=True, eq=False)
class PartDiscs:
    """Discs of i, j and k on neighbourhoods of parts (n,).

    Columns are the real part, the ellipses of each direction of integration, and twice the real part moved along k.
    centres    (n, 3)
    radii      radii of i, j and k, (n, columns) each; on surfaces, of t instead of k
    bends      (n, 5) coefficients of P on surfaces, the difference of k and t
    tilts      discs of g_a/g_t and g_b/g_t on surfaces, derivatives in a, b and t
    shifts     (n, MOVED) by how much of the height of the box a surface is moved in the last columns
    is_rising  (n,) whether g increases along k
    stretches  discs of (e - s)/2 and (u - l)/2, factors of the measure
    is_proved  (n, columns) whether all roots are analytic there
    """

    centres: Floats
    radii: tuple[Floats, Floats, Floats]
    bends: Floats | None
    tilts: tuple[Disc, Disc] | None
    is_rising: Bools
    stretches: tuple[Disc, Disc]
    is_proved: Bools
    shifts: Floats

    @staticmethod
    def of(nets: Floats, parts: GraphParts, directions: tuple[int, ...], is_filled: bool) -> PartDiscs:
        """The discs of parts of boxes, each with its net (n, Di, Dj, Dk)."""
        factors = _factors(directions)
        middle = (parts.low + parts.high) / 2
        first = ((parts.high - parts.low) / 2)[:, None] * factors[0]
        width = np.maximum(*(_end_radii(nets, parts, column, middle, first) for column in (0, 1)))
        half = (parts.ends[:, 1:] - parts.ends[:, :1]) / 2
        second = factors[1] * (half + width)

        # the root along k, from the middle of the part
        has_root = parts.has_root[:, None]
        centres = np.stack([middle, parts.ends.mean(axis=1), np.where(parts.has_root, parts.root, 0.5)], axis=1)
        with np.errstate(all="ignore"):
            level, bends = _straight(nets, centres, parts.has_root, (_known(first), _known(second)))
            rest = root_radii(level, _known(first), _known(second))
        is_proved = np.isfinite(width) & (np.isfinite(rest) | ~has_root)
        rest = np.where(has_root, rest, 0.0)
        stretch = half, _known(width)
        if is_filled:
            height = _height(bends, first, second) + rest
            return _below(parts, centres, (first, second, factors[2]), height, stretch, is_proved)
        moved, moves = _moved(rest, _height(bends, first, second))
        nothing = np.zeros_like(half)
        radii = _where(is_proved, first, second, moved)
        tilts = _tilts(level, radii)
        is_rising = level.steepness > 0
        return PartDiscs(centres, radii, bends, tilts, is_rising, (stretch, (nothing, nothing)), is_proved, moves)

    @staticmethod
    def whole(count: int) -> PartDiscs:
        """The real points of whole boxes, in one column."""
        half, every = np.full((count, 1), 0.5), np.ones((count, 1), bool)
        disc = half, np.zeros((count, 1))
        return PartDiscs(
            np.full((count, 3), 0.5), (half, half, half), None, None, every[:, 0], (disc, disc), every, np.zeros(count)
        )


def _moved(rest: Floats, height: Floats) -> tuple[Floats, Floats]:
    """Radii (n, columns) of t with the surface moved in the last columns, and (n, MOVED) by how much.

    rest    (n, columns) radii of t
    height  (n, columns) of the surface
    """
    own = _SHIFT * np.clip(height[:, 0], _LEAST_HEIGHT, _GREATEST_HEIGHT)
    moves = np.stack([own, np.full_like(own, _SMALL_SHIFT)], axis=1)
    moved = rest.copy()
    moved[:, -MOVED:] += moves
    return moved, moves


def _below(
    parts: GraphParts,
    centres: Floats,
    radii: tuple[Floats, Floats, Floats],
    height: Floats,
    stretch: Disc,
    is_proved: Bools,
) -> PartDiscs:
    """Discs of the parts of boxes between a face and the root, of whose discs ``height`` are the radii."""
    low = np.where(parts.has_root & ~parts.is_below, parts.root, 0.0)
    high = np.where(parts.has_root & parts.is_below, parts.root, 1.0)
    half = (high - low)[:, None] / 2
    moved = np.column_stack([centres[:, :2], (low + high) / 2])
    every = _where(is_proved, radii[0], radii[1], radii[2] * (half + height))
    stretches = stretch, (half, _known(height))
    return PartDiscs(moved, every, None, None, parts.is_below, stretches, is_proved, np.zeros((len(parts), MOVED)))


def _end_radii(nets: Floats, parts: GraphParts, column: int, middle: Floats, first: Floats) -> Floats:
    """(n, columns) radii of discs of the ends in j of parts; inf if unproved."""
    found = np.zeros(first.shape)
    for kind, face in ((_BELOW, 0), (_ABOVE, -1)):
        here = np.flatnonzero(parts.kinds[:, column] == kind)
        if not len(here):
            continue
        own = nets[here][:, None, :, :, face]
        places = np.stack([np.zeros(len(here)), middle[here], parts.ends[here, column]], axis=1)
        nothing = np.zeros_like(first[here])
        with np.errstate(all="ignore"):
            face_level, bends = _straight(own, places, np.ones(len(here), bool), (nothing, first[here]))
            rest = root_radii(face_level, nothing, first[here])
        found[here] = _height(bends, nothing, first[here]) + rest
    return found


def _straight(nets: Floats, centres: Floats, has_root: Bools, radii: tuple[Floats, Floats]) -> tuple[Expansion, Floats]:
    """The expansion of h in t about centres (n, 3), and the coefficients of P (n, 5), which is 0 without a surface.

    radii  (n, columns) of the discs of a and b
    """
    coefficients = taylor(nets, centres, np.ones_like(centres))
    bends = _bends(coefficients)
    bends = np.where(has_root[:, None] & np.isfinite(bends), bends, 0.0)
    level = Expansion.curved(coefficients, bends, radii)
    return level.multiplied(-_mixed(level.coefficients) / level.steepness[:, None], radii), bends


def _bends(coefficients: Floats) -> Floats:
    """(n, 5) first and second Taylor coefficients of the root k of g about the centre, where g is 0.

    g(a, b, P) = 0 to second order in a and b, with coefficients c of g:

        P_a = -c_100 / c_001,   P_aa = -(c_200 + c_101 P_a + c_002 P_a^2) / c_001
        P_ab = -(c_110 + c_101 P_b + c_011 P_a + 2 c_002 P_a P_b) / c_001
    """

    def own(i: int, j: int, k: int) -> Floats:
        is_there = all(power < size for power, size in zip((i, j, k), coefficients.shape[1:], strict=True))
        return coefficients[:, i, j, k] if is_there else np.zeros(len(coefficients))

    steep, bent = own(0, 0, 1), own(0, 0, 2)
    p, q = -own(1, 0, 0) / steep, -own(0, 1, 0) / steep
    along_i = own(2, 0, 0) + own(1, 0, 1) * p + bent * p * p
    along_j = own(0, 2, 0) + own(0, 1, 1) * q + bent * q * q
    mixed = own(1, 1, 0) + own(1, 0, 1) * q + own(0, 1, 1) * p + 2 * bent * p * q
    return np.stack([p, q, -along_i / steep, -mixed / steep, -along_j / steep], axis=1)


def _mixed(coefficients: Floats) -> Floats:
    """(n, 2) coefficients of s u and t u."""
    has_first = coefficients.shape[1] > 1
    first = coefficients[:, 1, 0, 1] if has_first else np.zeros(len(coefficients))
    return np.stack([first, coefficients[:, 0, 1, 1]], axis=1)


def _height(bends: Floats, first: Floats, second: Floats) -> Floats:
    """(n, columns) the maximum of |P| on discs of a and b."""
    p, q, along_i, mixed, along_j = np.abs(bends).T[:, :, None]
    return np.asarray(p * first + q * second + along_i * first**2 + mixed * first * second + along_j * second**2)


def _tilts(level: Expansion, radii: tuple[Floats, Floats, Floats]) -> tuple[Disc, Disc]:
    """Discs of h_a/h_t and h_b/h_t on discs of a, b and t."""
    along_a, along_b, along_t = (level.slope(axis, radii) for axis in range(3))
    return discs.over(along_a, along_t), discs.over(along_b, along_t)


def _factors(directions: tuple[int, ...]) -> Floats:
    """(3, columns) factors by which the coordinates v exceed [-1, 1] on the ellipse of each direction."""
    found = np.ones((3, 1 + len(directions) * len(RHOS) + MOVED))
    for number, axis in enumerate(directions):
        first = 1 + number * len(RHOS)
        found[axis, first : first + len(RHOS)] = (RHOS + 1 / RHOS) / 2
    return found


def _known(radius: Floats) -> Floats:
    return np.where(np.isfinite(radius), radius, 0.0)


def _where(is_proved: Bools, *radii: Floats) -> tuple[Floats, Floats, Floats]:
    """Three radii, 0 if nothing is proved."""
    first, second, third = (np.where(is_proved, radius, 0.0) for radius in radii)
    return first, second, third
