"""Rays against arrows and cones: by the minimum of a convex function along each ray, and bisection on both sides of it.

A solid between two discs is convex.  For a place at height s and distance rho from its axis, the maximum of -s, s - L
and rho - R(s) is positive only outside the solid.  It is convex along a ray.  No quadratic is solved, and no bound is
used.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, joined_columns
from elvis.core.base.rows import Rows
from elvis.reference.quantities import Quantities
from elvis.reference.scenes.crossings import Crossings
from elvis.reference.scenes.unions import INTERVAL, union
from elvis.scene import Glyphs
from elvis.scene.cameras.view import View
from elvis.scene.flow.frusta import Frusta, frusta_in
from elvis.scene.model.time_limit import check_time

#: factor by which each step towards the minimum shortens the part of a ray, such steps, halvings, pairs treated
#: together
_GOLDEN, _STEPS, _HALVINGS, _AT_ONCE = 0.5 * (np.sqrt(5.0) - 1.0), 80, 60, 1 << 17


@dataclass(frozen=True, eq=False)
class _Pairs(Rows):
    """Rays and solids that they may meet.

    solid, pixel  (n,)    numbers
    base, axis    (n, 3)  of the solid: middle of the first disc, unit vector to the second
    length        (n,)
    radii         (n, 2)
    origin, unit  (n, 3)  of the ray
    """

    solid: Ints
    pixel: Ints
    base: Floats
    axis: Floats
    length: Floats
    radii: Floats
    origin: Floats
    unit: Floats

    def _aside(self, place: Floats) -> tuple[Floats, Floats]:
        """Heights (n,) of places (n,) along the rays, and vectors (n, 3) from the axis."""
        away = self.origin + place[:, None] * self.unit - self.base
        height = np.einsum("ni,ni->n", away, self.axis)
        return height, away - height[:, None] * self.axis

    def heights(self, place: Floats) -> Floats:
        """(3, n) the three functions whose maximum is positive outside."""
        height, across = self._aside(place)
        part = height / self.length
        radius = (1.0 - part) * self.radii[:, 0] + part * self.radii[:, 1]
        return np.stack([-height, height - self.length, np.linalg.norm(across, axis=1) - radius])

    def normals(self, place: Floats) -> Floats:
        """(n, 3) the gradient of the largest function."""
        _, across = self._aside(place)
        wide = np.linalg.norm(across, axis=1, keepdims=True)
        slope = (self.radii[:, 1] - self.radii[:, 0]) / self.length
        side = across / np.where(wide > 0.0, wide, 1.0) - slope[:, None] * self.axis
        every = np.stack([-self.axis, self.axis, side])
        return np.asarray(every[self.heights(place).argmax(axis=0), np.arange(len(place))])

    def intervals(self) -> tuple[Bools, Floats, Floats]:
        """(n,) whether rays meet solids, and where along them they enter and leave these."""
        # all hits lie in the ball around the solid
        middle, radius = self.base + 0.5 * self.length[:, None] * self.axis, 0.5 * self.length + self.radii.max(axis=1)
        centre = np.einsum("ni,ni->n", middle - self.origin, self.unit)
        least = self._least(centre - radius, centre + radius)
        met: Bools = self.heights(least).max(axis=0) < 0.0
        return met, self._border(least, centre - radius), self._border(least, centre + radius)

    def _least(self, low: Floats, high: Floats) -> Floats:
        """Minimum of the largest function between two places: golden section (Kiefer, Proc.  AMS 4, 1953)."""
        for _ in range(_STEPS):
            one, other = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
            is_left = self.heights(one).max(axis=0) < self.heights(other).max(axis=0)
            low, high = np.where(is_left, low, one), np.where(is_left, other, high)
        return np.asarray(0.5 * (low + high))

    def _border(self, inside: Floats, outside: Floats) -> Floats:
        """Positions where rays leave solids, between places inside and outside."""
        for _ in range(_HALVINGS):
            between = 0.5 * (inside + outside)
            is_inside = self.heights(between).max(axis=0) < 0.0
            inside, outside = np.where(is_inside, between, inside), np.where(is_inside, outside, between)
        return np.asarray(0.5 * (inside + outside))


def glyph_crossings(quantities: Quantities, shown: Glyphs, view: View) -> Crossings:
    """All places at which rays enter or leave arrows or cones."""
    return solid_crossings(quantities, frusta_in(quantities.flow, shown), view)


def solid_crossings(quantities: Quantities, solids: Frusta, view: View) -> Crossings:
    """All places at which rays enter or leave solids; connected solids count as one."""
    if not len(solids.element):
        return Crossings.none()
    lengths = np.linalg.norm(view.every_ray()[1], axis=1)
    columns = [np.zeros(0, INTERVAL)]
    for every in _pairs(solids, view):
        check_time()
        met, enters, leaves = every.intervals()
        pairs, ends = every.part(met), (enters[met], leaves[met])
        rows = np.zeros(len(pairs.pixel), INTERVAL)
        rows["pixel"], rows["element"] = pairs.pixel, solids.element[pairs.solid]
        rows["first"] = rows["last"] = solids.reference[pairs.solid]
        rows["enters"], rows["leaves"] = (own / lengths[pairs.pixel] for own in ends)
        rows["entrance"], rows["exit"] = (pairs.normals(own) for own in ends)
        columns.append(rows)
    return union(np.concatenate(columns), quantities)


def _pairs(solids: Frusta, view: View) -> Iterator[_Pairs]:
    """Rays in the balls around solids, some at a time."""
    origins, directions = view.every_ray()
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    middle = solids.base + 0.5 * solids.length[:, None] * solids.axis
    radius = 0.5 * solids.length + solids.radii.max(axis=1)
    found: list[tuple[Ints, Ints]] = []
    count = 0
    for number in range(len(radius)):
        away = middle[number] - origins
        across = away - np.einsum("ni,ni->n", away, unit)[:, None] * unit
        pixel = np.flatnonzero(np.linalg.norm(across, axis=1) < radius[number])
        found.append((np.full(len(pixel), number), pixel))
        count += len(pixel)
        if count < _AT_ONCE and number < len(radius) - 1:
            continue
        solid, pixel = joined_columns(found)
        base, axis, length, radii = (getattr(solids, name)[solid] for name in ("base", "axis", "length", "radii"))
        yield _Pairs(solid, pixel, base, axis, length, radii, origins[pixel], unit[pixel])
        found, count = [], 0
