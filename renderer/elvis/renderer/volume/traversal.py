"""Rays through straight tetrahedra: what of a part each tile of a picture may see (ray*.slang)."""

from __future__ import annotations

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from elvis.core.base.arrays import Bools, Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values
from elvis.core.shapes import Shape
from elvis.renderer.device.device import Kernel
from elvis.renderer.device.memory import Buffer
from elvis.renderer.raster.camera import record_of
from elvis.renderer.raster.tiles import Sections
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View
from elvis.scene.record.conditioning import misplaced

#: hits, and ends of segments, are one where they lie nearer than this part of the largest coordinate
APART = 1e-11
#: part of values that is rounding where a plugin says nothing of it
ROUNDING = 1e-13
#: values along a part of a ray beyond the number for a polynomial, as in volume_trace.slang
MORE = 4


class Traversal:
    """The parts of a loaded volume that are straight tetrahedra with polynomial fields."""

    def __init__(self, loaded: DeviceVolume) -> None:
        self.loaded, self.device = loaded, loaded.device
        self._lines: dict[int, dict[str, Buffer]] = {}

    def degree(self, number: int, quantity: str | None) -> int:
        """See Part.degree."""
        return self.loaded.quantity(number, quantity).degree

    def is_straight(self, number: int, quantity: str | None) -> bool:
        """Whether rays are lines, and the quantity a polynomial along them."""
        return self.loaded.parts[number].affine and self.degree(number, quantity) > 0

    def rounding(self, number: int, quantity: str | None, value: float) -> Floats:
        """Error bounds (n,) of computed values in each element of a part.

        By default they are relative to the maximum value, or to ``value`` if no bounds are known.
        """
        own = self.loaded.quantity(number, quantity)
        if own.rounding is not None:
            return own.rounding()
        low, high = self.loaded.bounds(number, quantity)
        greatest = np.maximum(np.abs(low), np.abs(high))
        size = np.where(np.isfinite(greatest), greatest, abs(value))
        return np.asarray(ROUNDING * size)

    def steepest(self, number: int, quantity: str | None, value: float) -> Floats:
        """Maximum change (n,) of a polynomial field in each element per unit of reference coordinates.

        Coefficients of derivatives are differences, times the degree n and half for each of three directions.  If no
        bounds are known, values are bounded through their rounding by n products for each direction.
        """
        low, high = self.loaded.bounds(number, quantity)
        degree = self.degree(number, quantity)
        by_rounding = 2.0**53 * self.rounding(number, quantity, value) / degree
        extent = np.where(np.isfinite(high - low), high - low, by_rounding)
        return np.asarray(1.5 * degree * extent)

    def flat(self, number: int, quantity: str | None, value: float) -> Bools:
        """Elements (n,) of a part whose field can't be distinguished from the value anywhere, by its bounds."""
        low, high = self.loaded.bounds(number, quantity)
        farthest = np.maximum(np.abs(high - value), np.abs(value - low))
        return farthest <= 4.0 * self.rounding(number, quantity, value)

    def holding(self, number: int, quantity: str | None, value: float) -> Bools:
        """(n,) elements of a part that may have the value, but not all over."""
        low, high = self.loaded.bounds(number, quantity)
        exactly = (low == value) & (high == value) & (self.rounding(number, quantity, value) == 0.0)
        return np.asarray(~((low > value) | (high < value) | exactly))

    def corners(self, number: int) -> Floats:
        """(n, 4, 3) the corners of a part's straight tetrahedra; asked of the device once."""
        return self.loaded.once(("corners", number), lambda: self._read_corners(number))

    def _read_corners(self, number: int) -> Floats:
        part = self.loaded.parts[number]
        kernel = self.device.kernel("ray_corner", part)
        count = len(part)
        record = np.zeros(1, kernel.dtype("rays"))
        record["count"] = count
        output = self.device.empty(np.float64, 12 * count)
        kernel(count, {**self.loaded.bindings(number), "rays": self.device.buffer(record), "corners": output})
        corners = self.device.read(output, np.float64)
        return corners[: 12 * count].reshape(count, 4, 3)

    def rays(self, kernel: Kernel, view: View, number: int, count: int, level: float = 0.0) -> Buffer:
        """The Rays record of the stages (ray.slang)."""
        place = {"first": self.loaded.first[number], "count": count}
        errors = {"apart": APART * self.loaded.extent, "misplaced": misplaced(view, self.loaded.extent)}
        record = record_of(kernel, "rays", view, level=level, **place, **errors)
        return self.device.buffer(record)

    def lines(self, degree: int) -> dict[str, Buffer]:
        """Places on a line, and the way from values there to Bernstein coefficients: exact, and with an error."""
        if degree not in self._lines:
            self._lines[degree] = {name: self.device.buffer(data) for name, data in _line(degree).items()}
        return self._lines[degree]


def visible_sections(view: View, corners: Floats, chosen: Bools) -> Sections:
    """Sections of the chosen tetrahedra with corners (n, 4, 3), nearest first."""
    elements = np.flatnonzero(chosen)
    points = corners[elements]
    with np.errstate(divide="ignore", invalid="ignore"):
        homogeneous = view.projected(points)
        weight = homogeneous[..., 2]
        x = homogeneous[..., 0] / weight
        y = homogeneous[..., 1] / weight

    # x, y, x + y and x - y: unbounded where a corner is behind the eye
    places = np.stack([x, y, x + y, x - y], axis=2)
    places[(weight <= 0).any(axis=1)] = np.nan
    least = np.nan_to_num(places.min(axis=1), nan=-np.inf) - 1e-3
    most = np.nan_to_num(places.max(axis=1), nan=np.inf) + 1e-3

    # within the picture; sections beyond it end before they begin
    diagonal = 4 * (int(np.abs([view.first, view.last]).max()) + 1) * np.ones(2, np.int64)
    start, end = np.append(view.first, -diagonal), np.append(view.last, diagonal)
    before_start, after_end = np.append(view.first - 1, -diagonal), np.append(view.last + 1, diagonal)
    first = np.ceil(np.clip(least, start, after_end)).astype(np.int32)
    last = np.floor(np.clip(most, before_start, end)).astype(np.int32)

    depth = view.depth_of(points)
    is_seen = (first <= last).all(axis=1) & (depth.max(axis=1) > 0)
    order = np.argsort(depth.min(axis=1)[is_seen], kind="stable")
    return Sections(elements.astype(np.uint32), first, last)[is_seen][order]


@bounded_cache
def _line(degree: int) -> dict[str, Floats]:
    """Places on the line [0, 1], and the way from values there to Bernstein coefficients, as the shaders name them.

    nodes     (degree + 1,) Chebyshev points
    net       matrix from values there to Bernstein coefficients
    places    (degree + 1 + MORE,) more
    fit       matrix from values there to the Bernstein coefficients of a Chebyshev series, then to the terms that
              it lacks
    guesses   (degree + 1 + MORE, 6) weights of Hermite's polynomial through the first, the middle and the last place
    net_size  (1,) the largest sum of magnitudes in a row of ``net``
    """
    nodes = _extrema(degree)
    net = np.linalg.inv(bernstein_values(BernsteinSpace(Shape.SEGMENT, (degree,)), nodes[:, None]))

    # the series through all places, without its last terms, by its values at the nodes
    places = _extrema(degree + MORE)
    series = np.linalg.inv(chebvander(places, degree + MORE))
    fit = np.vstack([net @ chebvander(nodes, degree) @ series[:-MORE], series[-MORE:]])
    size = np.abs(net).sum(axis=-1).max(keepdims=True)
    arrays = {"nodes": (nodes + 1) / 2, "net": net, "places": (places + 1) / 2, "fit": fit, "net_size": size}
    arrays["guesses"] = hermite_weights((places + 1) / 2)
    return {name: frozen_floats(array) for name, array in arrays.items()}


def hermite_weights(places: Floats) -> Floats:
    """(n, 6) values at places (n,) of the polynomials of degree 5 that have one value or derivative, and no others.

    These are values at the first, the middle and the last place, then derivatives there.
    """
    stations = places[[0, (len(places) - 1) // 2, -1]]
    powers = np.arange(6)
    slopes = powers * stations[:, None] ** np.maximum(powers - 1, 0)
    conditions = np.vstack([stations[:, None] ** powers, slopes])
    return np.asarray(places[:, None] ** powers @ np.linalg.inv(conditions))


def _extrema(degree: int) -> Floats:
    """(degree + 1,) where the Chebyshev polynomial of a degree is 1 or -1, ascending."""
    return -np.cos(np.pi * np.arange(degree + 1) / max(degree, 1))
