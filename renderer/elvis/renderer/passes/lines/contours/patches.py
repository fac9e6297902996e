"""Patches of faces as charts for the squares of pixels: a patch's map goes from its own coordinates into the picture.

The map p = (X, Y) / W is rational in perspective.  Bernstein nets of X, Y, W and of the field over the patch, fitted to
samples of the element, bound its derivatives on a neighbourhood of the patch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.mapping.orientation import chunks
from elvis.core.polynomials.collapse import collapse
from elvis.core.shapes import Shape
from elvis.plugins.faces.nets import FaceSpace, face_space
from elvis.plugins.native.bending import derivative_sums, derived, rational_changes
from elvis.plugins.runtime.volume import Slopes
from elvis.renderer.passes.faces.faces import SquarePatches
from elvis.renderer.passes.lines.contours.squares import ROUNDING, Derivatives, Squares, is_nearby
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.renderer.volume.element_samples import sample_elements
from elvis.scene.cameras.view import View

#: facets of the shapes of patches: the margin is the minimum of a s + b t + c
FACETS = {
    Shape.TRIANGLE: np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [-1.0, -1.0, 0.0]]),
    Shape.QUADRILATERAL: np.array([[1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, -1.0, 1.0]]),
}
#: sizes, relative to a patch, of the neighbourhood in which derivatives are bounded: the first in which the map is
#: curved at most this much, or the last; large ones are not used for slopes of elements
_BEYOND, _BEYOND_SLOPES = (8.0, 4.0, 2.0, 1.5, 1.2), (1.5, 1.2)
_TAME = 0.5
#: elements that hold such neighbourhoods of their faces are as large: barycentric coordinates there are -1/6 at least
_ELEMENT_BEYOND = 5 / 3
#: elements whose slopes are bounded together
_ELEMENTS = 64


@dataclass(frozen=True, eq=False)
class PatchSamples:
    """Samples of patches at n positions: as `squares.ChartSamples`, and their depth (n,).

    point  (n, 3) in the world
    """

    position: Floats
    jacobian: Floats
    value: Floats
    gradient: Floats
    depth: Floats
    point: Floats


@dataclass(frozen=True, eq=False)
class PatchBounds:
    """Bounds of n patches.

    derivatives  of the map into the picture and of the field, in coordinates of the patch
    values       (2, n) the field's minimum and maximum value on the patch
    deepening    (n,) sum of the depth's absolute first derivatives
    """

    derivatives: Derivatives
    values: Floats
    deepening: Floats


class PatchChart:
    """Patches of faces of one part and shape, in coordinates (s, t) of each (see `squares.Chart`)."""

    def __init__(self, loaded: DeviceVolume, quantity: str | None, view: View, patches: SquarePatches) -> None:
        self._loaded = loaded
        self._quantity = quantity
        self._view = view
        self._number = patches.number
        self._shape = patches.shape
        self.records = patches.records
        self.facets: Floats = FACETS[patches.shape]
        self.center: Floats = patches.shape.centre
        one = sample_elements(loaded, self._number, np.zeros(1, np.int64), np.zeros((1, 3)), quantity)
        self._middle = one.center[0]
        self._own = loaded.quantity(self._number, quantity)
        self._beyond = np.ones(len(patches.records))
        #: (n,) elements by index
        self.element = patches.records["element"].astype(np.int64) + loaded.first[patches.number]

    def targets(self, columns: Floats, rows: Floats) -> tuple[Floats, Floats]:
        """(n, 2) points of the picture themselves, all seen alike."""
        return np.stack([columns, rows], axis=1), np.ones(len(columns))

    def sample(self, elements: Ints, places: Floats) -> PatchSamples:
        """Samples of patches (n,), by number, at positions (n, 2) in their coordinates."""
        records = self.records[elements]
        axes = np.stack([records["first"], records["second"]], axis=2)
        reference = records["start"] + np.einsum("nij,nj->ni", axes, places)
        offsets = reference - self._middle
        found = sample_elements(self._loaded, self._number, records["element"], offsets, self._quantity)

        # columns and rows of the picture, and their derivatives, by the quotient rule
        projected = self._view.projected(found.position)
        weight = projected[:, 2:]
        pixel = projected[:, :2] / weight
        change = self._view.to_pixel[:, :3] @ (found.jacobian @ axes)
        jacobian = (change[:, :2] - pixel[..., None] * change[:, 2:]) / weight[..., None]
        gradient = np.einsum("ni,nij->nj", found.gradient, axes)
        depth = self._view.depth_of(found.position)
        return PatchSamples(pixel, jacobian, found.value, gradient, depth, found.position)

    def reaches(self, elements: Ints, centre: Floats, steps: Floats, slack: Floats) -> Bools:
        """(n,) whether derivatives are bounded within ``slack`` (n,) of places (n, 2) with all steps (k, n, 2)."""
        return is_nearby(self._shape, self.facets, self._beyond[elements], centre + steps, slack)

    def localised(self, bounds: Derivatives, elements: Ints, centre: Floats) -> Derivatives:
        """The bounds, which hold of the neighbourhoods of whole patches."""
        return bounds

    def depth(self, squares: Squares) -> Floats:
        """(n,) depths of the centres of squares."""
        found = squares.at_centre
        assert isinstance(found, PatchSamples)
        return found.depth

    def bounds(self) -> PatchBounds:
        """Bounds of all patches; infinite where nothing is known of the part's quantity."""
        own = self._own
        degree = own.degree if own.slopes is None else own.slopes.map_degree
        if not degree:
            return self._unbounded()
        space = face_space(self._shape, degree)
        count = len(self.records)
        places = np.tile(space.points, (count, 1))
        found = self.sample(np.repeat(np.arange(count), len(space.points)), places)
        middle = self.sample(np.arange(count), np.tile(self.center, (count, 1)))

        # nets of X - x W, Y - y W and W for the pixel (x, y) in the middle, relative to the Jacobian there
        projected = _nets(space, self._view.projected(found.point), count)
        with np.errstate(all="ignore"):
            inverse = _inverses(middle.jacobian)
            weights = projected[:, 2]
            away = projected[:, :2] - middle.position[..., None] * weights[:, None]
            parts = inverse @ away

        values = _nets(space, found.value, count)
        depths = _nets(space, found.depth, count)
        bend, turn, deepening = self._in_neighbourhoods(space, parts, weights, depths)
        slopes, ends = self._field(space, values)
        noise = slopes.noise + slopes.gradient * self.records["noise"]
        derivatives = Derivatives(bend, turn, slopes.gradient, slopes.curvature, noise, middle.position, inverse)
        return PatchBounds(derivatives, ends, deepening)

    def _in_neighbourhoods(
        self, space: FaceSpace, parts: Floats, weights: Floats, depths: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """(n,) bend and turn of maps by their nets (see `rational_changes`), and sums of the depths' derivatives.

        Sets how large the neighbourhoods are.
        """
        found = np.full((3, len(parts)), np.nan)
        scales = _BEYOND if self._own.slopes is None else _BEYOND_SLOPES
        left = np.arange(len(parts))
        for beyond in scales:
            with np.errstate(all="ignore"):
                bend, turn = rational_changes(space.space, parts[left], weights[left], beyond)
            is_done = (bend < _TAME) | (beyond == scales[-1])
            done = left[is_done]
            deepening = derivative_sums(space.space, depths[done], beyond)[0].max(axis=1)
            found[:, done] = bend[is_done], turn[is_done], deepening
            self._beyond[done] = beyond
            left = left[~is_done]
        return found[0], found[1], found[2]

    def _field(self, space: FaceSpace, values: Floats) -> tuple[Slopes, Floats]:
        """Slopes of the field in coordinates of each patch, and its minimum and maximum (2, n).

        They come from its nets (n, count), or from the slopes of the elements.
        """
        if self._own.slopes is not None:
            return self._slopes_of_elements(), self._element_ends()
        found = np.empty((3, len(values)))
        for beyond in np.unique(self._beyond):
            here = np.flatnonzero(self._beyond == beyond)
            gradient, curvature = derivative_sums(space.space, values[here], beyond)
            size = np.abs(derived(space.space, values[here], (), beyond)).max(axis=1)
            found[:, here] = gradient.max(axis=1), curvature.max(axis=1), ROUNDING * size
        noise = found[2]
        ends = np.stack([values.min(axis=1) - noise, values.max(axis=1) + noise])
        return Slopes(*found), _endless(ends)

    def _slopes_of_elements(self) -> Slopes:
        """Slopes in coordinates of each patch: a slope of the element changes at most by the sum of a patch's axes."""
        bounds = self._own.slopes
        assert bounds is not None
        own = self.records["element"].astype(np.int64)
        if self._loaded.parts[self._number].collapsed:
            # in pyramids, in the box of each patch with its neighbourhood
            row = np.arange(len(own))
            middle, half = self._boxes()
            every = [bounds.in_boxes(own[some], middle[some], half[some]) for some in chunks(len(own), _ELEMENTS)]
        else:
            elements, row = np.unique(own, return_inverse=True)
            every = [bounds.of(elements[some], _ELEMENT_BEYOND) for some in chunks(len(elements), _ELEMENTS)]
        axes = np.abs(self.records["first"]) + np.abs(self.records["second"])
        size = axes.max(axis=1)
        gradient = np.concatenate([some.gradient for some in every])[row] * size
        curvature = np.concatenate([some.curvature for some in every])[row] * size**2
        return Slopes(gradient, curvature, np.concatenate([some.noise for some in every])[row])

    def _boxes(self) -> tuple[Floats, Floats]:
        """Middles and half sides (n, 3) of boxes of collapsed coordinates that hold the neighbourhoods of patches.

        Collapsed coordinates are quotients of linear functions: extreme at corners.
        """
        corners = self._shape.vertices
        larger = self.center + _BEYOND_SLOPES[0] * (corners - self.center)
        axes = np.stack([self.records["first"], self.records["second"]], axis=2)
        places = self.records["start"][:, None] + np.einsum("nij,kj->nki", axes, larger)
        eta = collapse(Shape.PYRAMID, places.reshape(-1, 3)).reshape(places.shape)
        is_regular = places[:, :, 2].max(axis=1) < 1.0
        low, high = eta.min(axis=1), eta.max(axis=1)
        low[~is_regular], high[~is_regular] = -1.0, 1.0
        return (low + high) / 2, (high - low) / 2 + 1e-12

    def _element_ends(self) -> Floats:
        """(2, n) bounds of the patches' elements."""
        ends, _ = self._loaded.every(self._quantity)
        return _endless(ends[self.element].astype(np.float64).T)

    def _unbounded(self) -> PatchBounds:
        """Bounds of a quantity with a known range only."""
        count = len(self.records)
        endless = np.full(count, np.inf)
        inverse = np.tile(np.eye(2), (count, 1, 1))
        derivatives = Derivatives(endless, endless, endless, endless, endless, np.zeros((count, 2)), inverse)
        return PatchBounds(derivatives, self._element_ends(), endless)


def _nets(space: FaceSpace, values: Floats, count: int) -> Floats:
    """Nets (n, ..., count') from samples (n k, ...) at the points of a space on each of n patches."""
    own = values.reshape(count, len(space.points), -1)
    nets = np.einsum("ck,nki->nic", space.fit, own)
    return np.asarray(nets if values.ndim > 1 else nets[:, 0])


def _inverses(jacobians: Floats) -> Floats:
    """(n, 2, 2) inverse matrices, infinite where there are none."""
    (a, b), (c, d) = np.moveaxis(jacobians, 0, 2)
    adjugate = np.moveaxis(np.array([[d, -b], [-c, a]]), 2, 0)
    return np.asarray(adjugate / (a * d - b * c)[:, None, None])


def _endless(ends: Floats) -> Floats:
    """Ranges (2, n), endless where they are not known."""
    return np.where(np.isnan(ends), [[-np.inf], [np.inf]], ends)
