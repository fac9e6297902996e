"""Rays through straight tetrahedra: what of a part each tile of a picture may see (ray*.slang)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from elvis.core.arrays import Bools, Floats, frozen_floats
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values
from elvis.core.shapes import Shape
from elvis.renderer.camera import record_of
from elvis.renderer.device import Buffer, Kernel
from elvis.renderer.device_volume import DeviceVolume
from elvis.renderer.tiles import Sections
from elvis.scene.conditioning import misplaced
from elvis.scene.view import View

#: hits, and ends of segments, are one where they lie nearer than this part of the greatest coordinate
APART = 1e-11
#: part of values that is rounding where a plugin says nothing of it
ROUNDING = 1e-13


class Traversal:
    """The parts of a loaded volume that are straight tetrahedra with polynomial fields."""

    def __init__(self, loaded: DeviceVolume) -> None:
        self.loaded, self.device = loaded, loaded.device
        self._corners: dict[int, Floats] = {}

    def degree(self, number: int, quantity: str | None) -> int:
        """See Part.degree."""
        return self.loaded.quantity(number, quantity).degree

    def is_straight(self, number: int, quantity: str | None) -> bool:
        """Whether rays are lines, and the quantity a polynomial along them."""
        return self.loaded.parts[number].affine and self.degree(number, quantity) > 0

    def rounding(self, number: int, quantity: str | None, value: float) -> Floats:
        """(n,) how far computed values in each element of a part may be from the true ones; by default in parts of the
        greatest value, or of ``value`` where no bounds are known."""
        own = self.loaded.quantity(number, quantity)
        if own.rounding is not None:
            return own.rounding()
        greatest = np.abs(np.stack(self.loaded.bounds(number, quantity))).max(axis=0)
        return np.asarray(ROUNDING * np.where(np.isfinite(greatest), greatest, abs(value)))

    def steepest(self, number: int, quantity: str | None, value: float) -> Floats:
        """(n,) how much a polynomial field may change at most in each element for a unit in reference coordinates.

        Coefficients of derivatives are differences, times the degree n and half for each of three directions.  Where
        bounds aren't known, values are no greater than what n products for each direction make of their rounding.
        """
        low, high = self.loaded.bounds(number, quantity)
        degree = self.degree(number, quantity)
        rounding = self.rounding(number, quantity, value)
        range_of = np.where(np.isfinite(high - low), high - low, 2.0**53 * rounding / degree)
        return np.asarray(1.5 * degree * range_of)

    def flat(self, number: int, quantity: str | None, value: float) -> Bools:
        """(n,) elements of a part whose field can't be told from the value anywhere, by its bounds."""
        low, high = self.loaded.bounds(number, quantity)
        return np.maximum(np.abs(high - value), np.abs(value - low)) <= 4.0 * self.rounding(number, quantity, value)

    def corners(self, number: int) -> Floats:
        """(n, 4, 3) the corners of a part's straight tetrahedra; asked of the device once."""
        if number not in self._corners:
            kernel, count = self.device.kernel("ray_corner", self.loaded.parts[number]), len(self.loaded.parts[number])
            record = np.zeros(1, kernel.dtype("rays"))
            record["count"] = count
            buffers = {**self.loaded.bindings(number), "rays": self.device.buffer(record)}
            buffers["corners"] = self.device.empty(np.float64, 12 * count)
            kernel(count, buffers)
            self._corners[number] = self.device.read(buffers["corners"], np.float64)[: 12 * count].reshape(count, 4, 3)
        return self._corners[number]

    def rays(self, kernel: Kernel, view: View, number: int, count: int, level: float = 0.0) -> Buffer:
        """The Rays record of the stages (ray.slang)."""
        place = {"first": self.loaded.first[number], "count": count}
        errors = {"apart": APART * self.loaded.extent, "misplaced": misplaced(view, self.loaded.extent)}
        record = record_of(kernel, "rays", view, level=level, **place, **errors)
        return self.device.buffer(record)

    def lines(self, degree: int) -> dict[str, Buffer]:
        """Places on a line, and the way from values there to Bernstein coefficients: exact, and with an error."""
        names = ("nodes", "net", "places", "fit", "net_size")
        return {name: self.device.buffer(data) for name, data in zip(names, _line(degree), strict=True)}


def visible_sections(view: View, corners: Floats, chosen: Bools) -> Sections:
    """Sections of the chosen tetrahedra with corners (n, 4, 3), those of near ones first."""
    elements = np.flatnonzero(chosen)
    points = corners[elements]
    with np.errstate(divide="ignore", invalid="ignore"):
        homogeneous = view.projected(points)
        pixel = homogeneous[..., :2] / homogeneous[..., 2:]
    behind = (homogeneous[..., 2] <= 0).any(axis=1)
    x, y = pixel[..., 0], pixel[..., 1]
    diagonal = np.stack([x, y, x + y, x - y], axis=2)
    diagonal[behind] = np.nan
    size = np.array([view.width, view.height])
    wide = np.append(size, [4 * size.max()] * 2).astype(float)
    least = np.nan_to_num(diagonal.min(axis=1), nan=-np.inf) - 1e-3
    most = np.nan_to_num(diagonal.max(axis=1), nan=np.inf) + 1e-3
    first = np.ceil(np.clip(least, [0, 0, *-wide[2:]], wide)).astype(np.int32)
    last = np.floor(np.clip(most, [-1, -1, *-wide[2:]], [*size - 1, *wide[2:]])).astype(np.int32)

    near = view.depth_of(points)
    kept = (first <= last).all(axis=1) & (near.max(axis=1) > 0)
    order = np.argsort(near.min(axis=1)[kept], kind="stable")
    return Sections(elements.astype(np.uint32), first, last)[kept][order]


@lru_cache(maxsize=16)
def _line(degree: int) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Chebyshev points of [0, 1], degree + 1 of them, and the matrix from values there to Bernstein coefficients; two
    points more, and the matrix to those of a Chebyshev series, then to the two terms that it lacks; the greatest sum of
    magnitudes in a row of the first matrix.
    """
    nodes, places = (-np.cos(np.pi * np.arange(d + 1) / max(d, 1)) for d in (degree, degree + 2))
    net = np.linalg.inv(bernstein_values(BernsteinSpace(Shape.SEGMENT, (degree,)), nodes[:, None]))
    series = np.linalg.inv(chebvander(places, degree + 2))
    fit = np.vstack([net @ chebvander(nodes, degree) @ series[:-2], series[-2:]])
    size = np.abs(net).sum(axis=-1).max(keepdims=True)
    nodes, places = (nodes + 1) / 2, (places + 1) / 2
    return frozen_floats(nodes), frozen_floats(net), frozen_floats(places), frozen_floats(fit), frozen_floats(size)
