"""Planes as charts for the squares of pixels: their places in elements, and bounds of derivatives of these."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, every_pair, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.tangents import duals
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values
from elvis.core.shapes import Shape
from elvis.plugins.native.bending import changes, derivative_sums, derived, net_of_xi
from elvis.plugins.runtime.volume import SlopeBounds, Slopes
from elvis.plugins.runtime.volume_checks import Samples
from elvis.renderer.passes.lines.contours.squares import ROUNDING, Derivatives, is_nearby
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.renderer.volume.element_samples import sample_elements
from elvis.scene.cameras.view import Pixels, View

if TYPE_CHECKING:
    from elvis.renderer.passes.lines.lines import Lines

#: elements whose derivatives are bounded at once
ELEMENTS = 64
#: how many times as large as a shape its neighbourhood is in which derivatives are bounded
_BEYOND = {Shape.HEXAHEDRON: 1.25, Shape.PRISM: 1.5, Shape.TETRAHEDRON: 1.5}


class CutChart:
    """A plane in a part's elements, in their reference coordinates (see `squares.Chart`)."""

    def __init__(
        self,
        loaded: DeviceVolume,
        number: int,
        quantity: str | None,
        lines: Lines,
        view: View,
        hits: HitBuffer,
        space: BernsteinSpace,
    ) -> None:
        self._loaded = loaded
        self._number = number
        self._quantity = quantity
        self._view = view
        self._hits = hits
        self._space = space
        self.facets = lines.facets(number)
        if loaded.dimension == 2:
            # facets that are not parallel to the plane z = 0 of 2D data
            self.facets = self.facets[np.abs(self.facets[:, :2]).max(axis=1) > 0.0]
        one = sample_elements(loaded, number, np.zeros(1, np.int64), np.zeros((1, 3)), quantity)
        self.center: Floats = one.center[0]

    def bounds(self, elements: Ints) -> Derivatives:
        """The derivatives of elements (n,), by index."""
        space = self._space
        nodes, fit = _nodes(space)
        found = []
        for some in chunks(len(elements), ELEMENTS):
            own = elements[some]
            count = len(own)
            samples = self.sample(*every_pair(own, nodes))
            middle = self.sample(own, np.tile(self.center, (count, 1)))

            # Bernstein nets of the field, and of the map less its value at the centre
            values = samples.value.reshape(count, -1) @ fit
            away = samples.position.reshape(count, -1, 3) - middle.position[:, None]
            places = np.einsum("nki,km->nim", away, fit)
            found.append(_derivatives(space, places, middle, self._slopes(own, values)))
        return Derivatives.joined(found)

    def _slopes(self, elements: Ints, values: Floats) -> Slopes:
        """Slopes of the field in elements (n,), by index, with nets (n, count) if it is a polynomial."""
        bounds = self.slope_bounds
        if bounds is None:
            return _slopes(self._space, values)
        return bounds.of(elements - self._loaded.first[self._number], _BEYOND[self._space.shape])

    @property
    def slope_bounds(self) -> SlopeBounds | None:
        """Bounds of the field if it is not a polynomial."""
        return self._loaded.quantity(self._number, self._quantity).slopes

    def localised(self, bounds: Derivatives, elements: Ints, centre: Floats) -> Derivatives:
        """The bounds, which hold of the neighbourhoods of whole elements."""
        return bounds

    def reaches(self, elements: Ints, centre: Floats, steps: Floats, slack: Floats) -> Bools:
        """(n,) whether derivatives are bounded within ``slack`` (n,) of places (n, 3) with all steps (k, n, 3)."""
        shape = self._space.shape
        return is_nearby(shape, self.facets, _BEYOND[shape], centre + steps, slack)

    def sample(self, elements: Ints, places: Floats) -> Samples:
        """Samples of elements (n,), by index, at reference points (n, 3)."""
        own = elements - self._loaded.first[self._number]
        return sample_elements(self._loaded, self._number, own, places - self.center, self._quantity)

    def targets(self, columns: Pixels, rows: Pixels) -> tuple[Floats, Floats]:
        """(n, 3) places of the plane under points of the picture, and how much nearer they make the plane seem."""
        assert self._hits.flat is not None
        origins, directions = self._view.rays(columns, rows)
        normal = self._hits.flat
        slant = directions @ normal
        depth = (self._hits.offset - origins @ normal) / slant
        return origins + depth[:, None] * directions, np.abs(slant)


def _derivatives(space: BernsteinSpace, places: Floats, middle: Samples, own: Slopes) -> Derivatives:
    """Bounds from nets of places less the centre (n, 3, count), samples at the centres, and slopes of the field."""
    inverse = np.swapaxes(duals(middle.jacobian), 1, 2)
    bend, turn = changes(space, inverse @ places, _BEYOND[space.shape])
    return Derivatives(bend, turn, own.gradient, own.curvature, own.noise, middle.position, inverse)


def _slopes(space: BernsteinSpace, values: Floats) -> Slopes:
    """Slopes of polynomials with nets (n, count)."""
    beyond = _BEYOND[space.shape]
    gradient, curvature = derivative_sums(space, values, beyond)
    size = np.abs(derived(space, values, (), beyond)).max(axis=1)
    return Slopes(gradient.max(axis=1), curvature.max(axis=1), ROUNDING * size)


@bounded_cache
def _nodes(space: BernsteinSpace) -> tuple[Floats, Floats]:
    """(count, 3) points of a shape, and the matrix (count, count) from values there to Bernstein coefficients."""
    nodes = net_of_xi(space)
    if space.shape is not Shape.HEXAHEDRON:
        return nodes, frozen_floats(np.linalg.inv(bernstein_values(space, nodes)).T)
    lines = []
    for degree in space.degrees[::-1]:
        line = BernsteinSpace(Shape.SEGMENT, (degree,))
        lines.append(np.linalg.inv(bernstein_values(line, net_of_xi(line))))
    return nodes, frozen_floats(np.kron(np.kron(lines[0], lines[1]), lines[2]).T)
