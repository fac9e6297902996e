"""Light along parts of rays: emission and absorption of a volume with smooth densities and colours.

The colour along a ray is the integral of T s c, T = exp(-tau), tau the integral of the density s (Max, Optical Models
for Direct Volume Rendering, 1995, section 4); for several volumes, s and s c are sums.  With m, the mean of c weighted
by s, it is m (1 - T) plus the integral of T s (c - m), which vanishes for constant colour and any opacity.  The
functions s and s c are known at Gauss points: tau between them is the integral of the polynomial through them.  A part
is accepted if its halves agree with it, otherwise it is bisected.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import EPS, Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.rows import Rows
from elvis.core.polynomials.quadrature import gauss
from elvis.scene import Transfer
from elvis.scene.model.time_limit import check_time

#: smallest number of Gauss's points in a part
LEAST = 8
#: negligible error of a part's light, maximum number of bisections of a part, and maximum number of open parts of a ray
_ENOUGH, _HALVINGS, _OPEN = 1e-8, 24, 64
#: roundings of a part's colour, which is at most 1, besides one for each point
_ROUNDINGS = 8

#: values of each volume's quantity, (k, n) each, on rays ``which`` (k,) at shares (k, n)
Values = Callable[[Ints, Floats], Sequence[Floats]]


@dataclass(frozen=True, eq=False)
class Light(Rows):
    """Emission and absorption of k stretches of rays.

    color  (k, 3) of the light at their beginnings
    depth  (k,)    optical depths
    error  (k,) maximum errors of colours and alphas
    """

    color: Floats
    depth: Floats
    error: Floats

    @property
    def alpha(self) -> Floats:
        """(k,) absorbed shares of the light from behind."""
        return np.asarray(-np.expm1(-self.depth))

    def before(self, other: Light) -> Light:
        """These stretches, each with another one behind it."""
        passing = np.exp(-self.depth)
        color = self.color + passing[:, None] * other.color
        return Light(color, self.depth + other.depth, self.error + passing * other.error)


@dataclass(frozen=True, eq=False)
class _Parts(Rows):
    """Parts of rays: number of the stretch (k,), shares of its ends (k,), and transmittance to its beginning."""

    which: Ints
    low: Floats
    high: Floats
    weight: Floats

    def halves(self) -> _Parts:
        """The first halves of all, then the second ones."""
        middle = 0.5 * (self.low + self.high)
        ends = np.concatenate([self.low, middle]), np.concatenate([middle, self.high])
        return _Parts(np.tile(self.which, 2), *ends, np.tile(self.weight, 2))


@dataclass(frozen=True, eq=False)
class RayIntegral:
    """The integrands along k stretches of rays.

    values     see `Values`
    transfers  of each volume, with colours; beyond its ends a transfer function is constant, and NaN emits and absorbs
               nothing
    lengths    (k,) of the stretches, in world units
    rounding   (k, volumes) maximum errors of values
    degree     degree of the quantities if they are polynomials along the rays: all points together are then exact
    """

    values: Values
    transfers: Sequence[Transfer]
    lengths: Floats
    rounding: Floats
    degree: int = 0

    def light(self) -> Light:
        """The light of each stretch."""
        count = len(self.lengths)
        parts = _Parts(np.arange(count), np.zeros(count), np.ones(count), np.ones(count))
        known, done, found = self._light_of(parts), [], []
        for halving in range(_HALVINGS + 1):
            check_time()
            halves = parts.halves()
            each, size = self._light_of(halves), len(parts.which)
            first, second = each.part(np.arange(size)), each.part(np.arange(size, 2 * size))
            both = first.before(second)

            # the change by bisection, as visible from the beginning of the ray
            change = np.maximum(np.abs(both.color - known.color).max(axis=1), np.abs(both.alpha - known.alpha))
            right = parts.weight * change <= _ENOUGH + parts.weight * both.error
            open_ = np.bincount(parts.which[~right], minlength=count)
            right |= (open_[parts.which] > _OPEN) | (halving == _HALVINGS)
            done.append(parts.part(right))
            found.append(Light(both.color, both.depth, both.error + change).part(right))
            if right.all():
                break
            halves.weight[size:] *= np.exp(-first.depth)
            left = np.tile(~right, 2)
            parts, known = halves.part(left), each.part(left)
        return _compose(done, Light.joined(found), count)

    def _light_of(self, parts: _Parts) -> Light:
        """The light of parts by Gauss's rule, with only the error of rounding."""
        nodes, weights, integrals = _rule(max(LEAST, self.degree // 2 + 1))
        lengths = self.lengths[parts.which] * (parts.high - parts.low)
        shares = parts.low[:, None] + nodes * (parts.high - parts.low)[:, None]
        density, emission, slack = self._sources(parts.which, self.values(parts.which, shares))

        # optical depths from the beginning to each point, and to the end
        depth = lengths * (density @ weights)
        until = lengths[:, None] * (density @ integrals)
        taken = lengths[:, None] * weights * density
        mean = np.einsum("kg,kgc->kc", lengths[:, None] * weights, emission)
        mean /= np.where(depth > 0, depth, 1.0)[:, None]
        sent = np.exp(-np.maximum(until, 0.0))
        changing = lengths[:, None, None] * weights[:, None] * emission - taken[..., None] * mean[:, None]
        color = mean * -np.expm1(-depth)[:, None] + np.einsum("kg,kgc->kc", sent, changing)
        rounding = (len(nodes) + _ROUNDINGS) * EPS
        return Light(color, depth, np.minimum(1.0, lengths * slack + rounding))

    def _sources(self, which: Ints, values: Sequence[Floats]) -> tuple[Floats, Floats, Floats]:
        """Densities (k, n), these times colours (k, n, 3), and how far densities may be off (k,)."""
        density, slack = np.zeros(values[0].shape), np.zeros(len(which))
        emission = np.zeros((*density.shape, 3))
        for number, (own, transfer) in enumerate(zip(values, self.transfers, strict=True)):
            known = np.isfinite(own)
            part = np.where(known, np.interp(own, transfer.values, transfer.densities), 0.0)
            tables = np.asarray(transfer.colors, np.float64)
            hue = np.stack([np.interp(own, transfer.values, tables[:, axis]) for axis in range(3)], axis=-1)
            density += part
            emission += part[..., None] * np.where(known[..., None], hue, 0.0)
            slack += self.rounding[which, number] * _slopes(own[:, own.shape[1] // 2], transfer)
        return density, emission, slack


def _slopes(values: Floats, transfer: Transfer) -> Floats:
    """(k,) magnitudes of the density's derivative at values (k,): zero beyond the ends, and for undefined values."""
    steps = np.diff(np.asarray(transfer.densities)) / np.diff(np.asarray(transfer.values))
    slopes = np.concatenate([[0.0], np.abs(steps), [0.0]])
    return np.where(np.isfinite(values), slopes[np.searchsorted(transfer.values, values)], 0.0)


def _compose(done: Sequence[_Parts], light: Light, count: int) -> Light:
    """The light of stretches, composed of all their parts, each attenuated by the parts before it."""
    which, low = (np.concatenate([getattr(own, name) for own in done]) for name in ("which", "low"))
    order = np.lexsort([low, which])
    which, light = which[order], light.part(order)
    begins = np.searchsorted(which, np.arange(count))
    before = np.cumsum(light.depth) - light.depth
    through = np.exp(np.minimum(before[begins][which] - before, 0.0))
    color, depth, error = np.zeros((count, 3)), np.zeros(count), np.zeros(count)
    np.add.at(color, which, through[:, None] * light.color)
    np.add.at(depth, which, light.depth)
    np.add.at(error, which, through * light.error)
    return Light(color, depth, error)


@bounded_cache
def _rule(points: int) -> tuple[Floats, Floats, Floats]:
    """Gauss's points and weights (n,) on [0, 1]; (n, n) integrals up to each point, of what goes through values."""
    nodes, weights = gauss(points)
    modes = np.polynomial.legendre.legvander(nodes, points - 1)
    upto = np.polynomial.legendre.legint(np.eye(points), lbnd=-1, axis=1)
    values = np.polynomial.legendre.legval(nodes, upto.T)
    integrals = np.linalg.solve(modes.T, values) / 2
    return frozen_floats((1 + nodes) / 2), frozen_floats(weights / 2), frozen_floats(integrals)
