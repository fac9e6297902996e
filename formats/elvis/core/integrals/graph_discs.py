"""Complex neighbourhoods of parts of boxes that a graph g = 0 cuts: discs of their three coordinates.

Between breaks (see `graphs`) a part is the image of a cube [-1, 1]^3,

    i = i_0 + h v_1,   j = (s + e)/2 + v_2 (e - s)/2,   k = (l + u)/2 + v_3 (u - l)/2

Here s and e are 0, 1 or roots of g on a face across k, functions of i.  And l and u are 0, 1 or the root of g, a
function of i and j.  A root k = k_0 + p (i - i_0) + q (j - j_0) + t is sought in t, with its slopes p and q at the
centre.  Newton's method proves that it is analytic.  Let |a| <= r, |b| <= s and |g_t| >= m for |t| <= w.  The map
t -> -g(a, b, 0)/G, with G a mean of g_t, takes the disc |t| <= w into itself if |g(a, b, 0)| <= m w.  So it has a fixed
point there (Brouwer), which is unique as g_t has no zero, and an analytic function of a and b (implicit function
theorem).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.integrals.graphs import between, roots
from elvis.core.integrals.taylor import majorants, sheared, taylor
from elvis.core.polynomials.bernstein import line_tables
from elvis.core.quantities.discs import Disc

#: parameters of Bernstein ellipses of which the best is taken
RHOS = np.array([1.5, 2.2, 3.5, 7.0])
#: steps in which the disc of a root is enlarged, and by how much each
_STEPS, _ENLARGED = 6, 1.1
#: by how much of the height of a box a surface is moved in the last column
SHIFT = 0.1
#: rounding of a place in a box
_ROUNDING = 64 * float(np.finfo(np.float64).eps)
#: what an end of a part in direction j is: a face of the box, or the root on one of the faces across k
_FIXED, _BELOW, _ABOVE = -1, 0, 1


@dataclass(frozen=True, eq=False)
class GraphParts:
    """Parts of boxes between breaks.

    box         (n,)    number of the box
    low, high   (n,)    ends in i
    ends        (n, 2)  ends in j in the middle of these
    kinds       (n, 2)  what they are
    root        (n,)    k of the surface in the middle of both; 1 where there is none
    has_root    (n,)    whether the surface is there
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

    def part(self, chosen: Bools) -> GraphParts:
        """Some of the parts."""
        return GraphParts(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    def __len__(self) -> int:
        return len(self.box)


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


def root_radii(coefficients: Floats, first: Floats, second: Floats) -> Floats:
    """(n, columns) radii of discs around 0 that hold one root t of g(a, b, t) for |a| <= r, |b| <= s; inf if unproved.

    coefficients   (n, A, B, C) of the expansion of g
    first, second  (n, columns) radii r and s
    """
    by_power = majorants(coefficients, first, second)
    steep = np.abs(coefficients[:, 0, 0, 1])[:, None]
    residual = by_power[..., 0] + _ROUNDING * np.abs(coefficients).sum(axis=(1, 2, 3))[:, None]
    orders = np.arange(1, by_power.shape[2])
    rises = by_power[..., 1:] * orders

    def slopes(radius: Floats) -> Floats:
        """Lower bounds of |dg/dt|: all terms but the first are taken from it."""
        return 2 * steep - (rises * radius[..., None] ** (orders - 1)).sum(axis=2)

    radius = _ENLARGED * residual / steep
    for _ in range(_STEPS):
        least = slopes(radius)
        radius = np.where(least > 0, _ENLARGED * residual / least, np.inf)
    is_proved = residual <= slopes(radius) * radius
    return np.where(is_proved, radius, np.inf)


@dataclass(frozen=True, eq=False)
class PartDiscs:
    """Discs of i, j and k on neighbourhoods of parts (n,).

    Columns are the real part, the ellipses of each direction that is integrated over, and the real part moved along k.
    centres    (n, 3)
    radii      of i, j and k, (n, columns) each; of surfaces of t in place of k
    slopes     (n, 2) of surfaces p and q, by which k exceeds t
    stretches  discs of (e - s)/2 and (u - l)/2, by which the measure is multiplied
    is_proved  (n, columns) whether all roots are analytic there
    """

    centres: Floats
    radii: tuple[Floats, Floats, Floats]
    slopes: Floats | None
    stretches: tuple[Disc, Disc]
    is_proved: Bools

    @staticmethod
    def of(nets: Floats, parts: GraphParts, directions: tuple[int, ...], is_filled: bool) -> PartDiscs:
        """Those of parts of boxes, each with its net (n, Di, Dj, Dk)."""
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
            expansion, slopes = _straightened(taylor(nets, centres, np.ones_like(centres)), parts.has_root)
            rest = root_radii(expansion, _known(first), _known(second))
        is_proved = np.isfinite(width) & (np.isfinite(rest) | ~has_root)
        rest = np.where(has_root, rest, 0.0)
        stretch = half, _known(width)
        if is_filled:
            height = np.abs(slopes[:, :1]) * first + np.abs(slopes[:, 1:]) * second + rest
            return _below(parts, centres, (first, second, factors[2]), height, stretch, is_proved)
        moved = rest.copy()
        moved[:, -1] += SHIFT
        nothing = np.zeros_like(half)
        radii = _where(is_proved, first, second, moved)
        return PartDiscs(centres, radii, slopes, (stretch, (nothing, nothing)), is_proved)

    @staticmethod
    def whole(count: int) -> PartDiscs:
        """The real points of whole boxes, in one column."""
        half = np.full((count, 1), 0.5)
        disc = half, np.zeros((count, 1))
        return PartDiscs(np.full((count, 3), 0.5), (half, half, half), None, (disc, disc), np.ones((count, 1), bool))


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
    return PartDiscs(moved, every, None, (stretch, (half, _known(height))), is_proved)


def _end_radii(nets: Floats, parts: GraphParts, column: int, middle: Floats, first: Floats) -> Floats:
    """(n, columns) radii of discs of the ends in j of parts; inf if unproved."""
    found = np.zeros(first.shape)
    for kind, face in ((_BELOW, 0), (_ABOVE, -1)):
        here = np.flatnonzero(parts.kinds[:, column] == kind)
        if not len(here):
            continue
        own = nets[here][:, None, :, :, face]
        places = np.stack([np.zeros(len(here)), middle[here], parts.ends[here, column]], axis=1)
        with np.errstate(all="ignore"):
            every = np.ones(len(here), bool)
            expansion, slopes = _straightened(taylor(own, places, np.ones((len(here), 3))), every)
            rest = root_radii(expansion, np.zeros_like(first[here]), first[here])
        found[here] = np.abs(slopes[:, 1:]) * first[here] + rest
    return found


def _straightened(coefficients: Floats, has_root: Bools) -> tuple[Floats, Floats]:
    """Coefficients of g in t, and the slopes (n, 2) of the surface at the centre, where there is one."""
    linear = [np.zeros(len(coefficients)), np.zeros(len(coefficients))]
    if coefficients.shape[1] > 1:
        linear[0] = coefficients[:, 1, 0, 0]
    if coefficients.shape[2] > 1:
        linear[1] = coefficients[:, 0, 1, 0]
    slopes = -np.stack(linear, axis=1) / coefficients[:, 0, 0, 1][:, None]
    slopes = np.where(has_root[:, None] & np.isfinite(slopes), slopes, 0.0)
    return sheared(coefficients, slopes), slopes


def _factors(directions: tuple[int, ...]) -> Floats:
    """(3, columns) by which the coordinates v exceed [-1, 1]: those of a direction on its ellipses."""
    found = np.ones((3, 2 + len(directions) * len(RHOS)))
    for number, axis in enumerate(directions):
        first = 1 + number * len(RHOS)
        found[axis, first : first + len(RHOS)] = (RHOS + 1 / RHOS) / 2
    return found


def _known(radius: Floats) -> Floats:
    return np.where(np.isfinite(radius), radius, 0.0)


def _where(is_proved: Bools, *radii: Floats) -> tuple[Floats, Floats, Floats]:
    """Three radii, 0 where nothing is proved."""
    first, second, third = (np.where(is_proved, radius, 0.0) for radius in radii)
    return first, second, third
