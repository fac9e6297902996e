"""Rays against isosurfaces, and against implicit surfaces in general.

Pairs of an element and a ray are examined unless bounds exclude the value (`bounding`).  The function depends only on
the depth along the ray's segment in the element (`segments`, `segment_curves`), and all its zeros are found (`zeros`),
for any distance between them.  Newton's method on the exact map and function finishes each.  Its uncertainty is
measured on the function nearby: deviations from a straight line are rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.mapping.margins import TOLERANCE
from elvis.core.mapping.patch import Patch
from elvis.reference.quantities import Quantities
from elvis.reference.scenes.bounding import candidates, degree_along
from elvis.reference.scenes.crossings import Crossings
from elvis.reference.scenes.newton import Constraint, inverses, solve
from elvis.reference.scenes.segment_curves import followed_through
from elvis.reference.scenes.segments import Segments, segments_through
from elvis.reference.scenes.zeros import Zeros, zeros
from elvis.reference.solids import map_points, margins_of
from elvis.scene.cameras.view import View
from elvis.scene.record.frame import Status

#: relative tolerance of values for the requested one, and maximum steps of Newton's method, whose starts are near
_ROUNDING, _STEPS = 4e-15, 12
#: half the stretch on which the function is measured about a zero, relative to the depth, and at most relative to the
#: segment; number of places there; factor for larger rounding elsewhere
_WINDOW, _NARROW, _PLACES, _SAFETY = 1e-8, 1e-6, 9, 4.0
#: units in the last place that coordinates may be wrong by
_UNITS = 8
#: maximum distance of Newton's result from a zero's place, relative to the segment, and to the scene's size
_NEAR, _NEARER = 1e-2, 1e-9
#: segments that are treated together
_AT_ONCE = 1 << 15


def iso_crossings(
    number: int,
    patch: Patch,
    quantities: Quantities,
    name: str,
    value: float,
    view: View,
    size: float,
    begun: Crossings,
) -> Crossings:
    """All hits of rays with the surface in a patch on which a quantity has a value; ``begun``: `segments_through`."""
    wanted = candidates(patch, quantities, name, value, view)
    segments = segments_through(number, patch, view, size, begun, wanted)
    search = _Search(number, patch, quantities, name, value, view, size)
    parts = np.array_split(np.arange(len(segments)), -(-len(segments) // _AT_ONCE) or 1)
    return Crossings.concatenate([search.hits(segments.part(rows)) for rows in parts]).distinct(size)


@dataclass(frozen=True, eq=False)
class _Search:
    """Parameters of the search in the elements of a patch; ``size`` is the scene's size in world units."""

    number: int
    patch: Patch
    quantities: Quantities
    name: str
    value: float
    view: View
    size: float

    def hits(self, segments: Segments) -> Crossings:
        """The hits along some segments."""
        curves = followed_through(segments, self.patch, self.view, self.size)

        def along(which: Ints, shares: Floats) -> Floats:
            reference, rows = curves.at(which, shares), np.repeat(curves.segments.row[which], shares.shape[1])
            values = self.quantities.values(self.name, self.patch, rows, reference)
            return np.asarray(values.reshape(shares.shape)) - self.value

        degree = degree_along(self.patch, self.quantities, self.name)
        rounding = self.quantities.rounding(self.name, self.patch, curves.segments.row)
        found = zeros(along, degree, curves.accuracy, rounding + _ROUNDING * abs(self.value))
        if not len(found.which):
            return Crossings.none()
        own, place = curves.segments.part(found.which), found.place[:, None]
        return self._finish(found, own, curves.at(found.which, place), own.at(place)[:, 0])

    def _finish(self, found: Zeros, segments: Segments, start: Floats, depth: Floats) -> Crossings:
        """The zeros as hits: certain ones improved by Newton's method, double ones unchanged."""
        origins, directions = self.view.rays_of(segments.pixel)
        constraint = level_of(self.quantities, self.name, self.patch, self.value)
        roots = solve(self.patch, segments.row, start, origins, directions, constraint, self.size, 0.5, _STEPS)
        near = np.where(found.rough, np.inf, _NEAR * (segments.far - segments.near) + _NEARER * self.size)
        converged = roots.found & (np.abs(roots.depth - depth) <= near)
        reference = np.where(converged[:, None], roots.reference, start)
        depth = np.where(converged, roots.depth, depth)
        width = np.minimum(_WINDOW * depth, _NARROW * (segments.far - segments.near))
        uncertainty, along, inverse = self._uncertain(segments.row, reference, directions, width)
        uncertainty[found.double | ~converged] = np.inf

        # an uncertain hit may lie on either side of a border, along the ray or in any direction of rounding
        greatest = np.maximum(np.abs(origins), np.abs(origins + depth[:, None] * directions)).max(axis=1)
        rounded = _UNITS * np.spacing(greatest) * np.linalg.norm(inverse, axis=2).max(axis=1)
        shift = np.where(converged, 2 * np.minimum(uncertainty, width) * np.abs(along).max(axis=1) + rounded, 0.0)
        margin = margins_of(self.patch, reference)
        here = np.flatnonzero((margin >= -TOLERANCE - shift) & (depth > 0) & (converged | ~found.rough | found.double))
        doubt: Bools = (margin <= TOLERANCE + shift) | ~np.isfinite(uncertainty)
        status = np.where(doubt, Status.AMBIGUOUS, Status.CERTAIN).astype(np.uint8)
        number = np.full(len(depth), self.number)
        every = Crossings(segments.pixel, depth, number, segments.row, reference, roots.normal, status, uncertainty)
        return every.part(here)

    def _uncertain(
        self, rows: Ints, reference: Floats, directions: Floats, width: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Maximum errors of depths (n,) of zeros, and steps of r per unit of depth (n, 3), and per unit of position.

        The function is measured at places along the ray, up to ``width`` (n,) from the zero.  A line through the values
        has the function's derivative, and the deviations from it are rounding.
        """
        _, jacobians = map_points(self.patch, rows, reference)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            inverse = inverses(jacobians)
            along = np.einsum("nij,nj->ni", inverse, directions)
        shares = np.linspace(-1.0, 1.0, _PLACES)
        steps = width[:, None, None] * shares[:, None] * along[:, None]
        places, every = reference[:, None] + steps, np.repeat(rows, _PLACES)
        values = self.quantities.values(self.name, self.patch, every, places.reshape(-1, places.shape[2]))
        values = values.reshape(-1, _PLACES)
        derivative = (values - values.mean(axis=1, keepdims=True)) @ shares / (shares @ shares)
        line = values.mean(axis=1, keepdims=True) + derivative[:, None] * shares
        deviation = np.abs(values - line).max(axis=1) + np.spacing(np.abs(values).max(axis=1))
        # if rounding steps happen to increase evenly, the deviation is zero
        rounding = np.maximum(_SAFETY * deviation, self.quantities.rounding(self.name, self.patch, rows))
        with np.errstate(invalid="ignore", divide="ignore"):
            uncertainty = width * rounding / np.abs(derivative)
        return np.where(np.isnan(uncertainty), np.inf, uncertainty), along, inverse


def level_of(quantities: Quantities, name: str, patch: Patch, value: float) -> Constraint:
    """The function whose zeros are the surface."""

    def constraint(rows: Ints, points: Floats) -> tuple[Floats, Floats]:
        values, gradients = quantities.values_and_gradients(name, patch, rows, points)
        return values - value, gradients

    return constraint
