"""Comparison of two records of one picture, in numbers meaningful to an engineer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.core.base.errors import ElvisError
from elvis.reference.cameras import same_camera
from elvis.reference.contours import Displacement, displacement
from elvis.reference.record import Record

#: steps of the colour map
STEPS = 256
#: part of full red, green or blue by which a colour may be off
COLOR = 0.01
#: ranges narrower than this part of their ends are none
_NARROW = 1e-9


@dataclass(frozen=True)
class Place:
    """A pixel, and what both records say of it."""

    row: int
    column: int
    position: tuple[float, float, float]
    element: int
    exact: float
    other: float


@dataclass(frozen=True)
class Errors:
    """Errors of a picture relative to the exact one, over the pixels visible in both.

    range           minimum and maximum value, to which errors are relative
    pixels          number of visible pixels of the exact picture
    value_max, value_mean, value_rms  maximum, mean and root mean square of |other - exact|, relative to the range
    off             percent of these pixels with an error above one step of the colour map (1/256 of the range), or
                    missing
    missing         pixels visible only in the exact picture
    spurious        pixels visible only in the other picture
    position_max, position_mean       distance of the two positions, relative to the diagonal of the visible part
    pixel           size of a pixel in world units, None if unknown
    pixel_max       largest distance of the two positions in pixels, None if unknown
    normal_max      largest angle between the normals, in degrees
    elements        number of pixels with another element
    colors_off      percent of all pixels with an error of more than 1 % in red, green or blue
    contours        displacement of each
    worst           the pixel with the largest error of the value, None if no pixel has an error
    """

    range: tuple[float, float]
    pixels: int
    value_max: float
    value_mean: float
    value_rms: float
    off: float
    missing: int
    spurious: int
    position_max: float
    position_mean: float
    pixel: float | None
    pixel_max: float | None
    normal_max: float
    elements: int
    colors_off: float
    contours: tuple[Displacement, ...]
    worst: Place | None

    @property
    def contour_max(self) -> float | None:
        """Largest displacement of a contour that both have, in pixels; None without contours."""
        return max((own.maximum for own in self.contours if own.maximum is not None), default=None)

    @property
    def lost(self) -> int:
        """Contours that one of the pictures lacks."""
        return sum(own.maximum is None for own in self.contours)


def check_comparable(exact: Record, other: Record) -> None:
    """Raise ElvisError unless both records have one size and can have one camera, and something is visible."""
    if exact.shape != other.shape:
        sizes = " and ".join(f"{record.shape[1]} x {record.shape[0]}" for record in (exact, other))
        raise ElvisError(f"expected records of one size, found {sizes} pixels")
    if not exact.seen.any():
        raise ElvisError("expected an exact record that shows something, found an empty picture")
    if not same_camera(exact, other):
        raise ElvisError("expected records of one camera, found positions that no single camera sees at these pixels")


def errors(
    exact: Record,
    other: Record,
    ends: tuple[float, float] | None = None,
    contours: Sequence[float] = (),
    pixel: float | None = None,
) -> Errors:
    """The errors of ``other``.

    ends   of the colour range; by default smallest and largest value of the exact picture
    pixel  size of a pixel in world units
    """
    low, high = value_range(exact) if ends is None else not_narrow(ends)
    both = exact.seen & other.seen
    off = value_errors(exact, other, (low, high))
    away, missing = off[both], exact.seen & ~other.seen
    moved = np.linalg.norm(other.position - exact.position, axis=2)[both]
    diagonal = extent(exact)
    wrong = int((away > 1 / STEPS).sum() + missing.sum())
    return Errors(
        (low, high),
        int(exact.seen.sum()),
        *_summary(away),
        float(np.sqrt(np.mean(away**2))) if len(away) else 0.0,
        100.0 * wrong / max(1, int(exact.seen.sum())),
        int(missing.sum()),
        int((other.seen & ~exact.seen).sum()),
        *_summary(moved / diagonal),
        pixel,
        None if pixel is None else _summary(moved / pixel)[0],
        _summary(_angles(exact.normal[both], other.normal[both]))[0],
        int((exact.element != other.element)[both].sum()),
        100.0 * float((np.abs(exact.color - other.color).max(axis=2) > COLOR).mean()),
        tuple(displacement(exact, other, value) for value in contours),
        worst(exact, other, off),
    )


def extent(record: Record) -> float:
    """Diagonal of the box around the visible part; 1 if that is a point, or empty."""
    points = record.position[record.seen]
    return (float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0) or 1.0


def value_range(record: Record) -> tuple[float, float]:
    """Minimum and maximum of the finite visible values, to which errors are relative.

    If all values agree to nine digits, as on an isosurface, their size replaces the range.
    """
    finite = record.field[record.seen & np.isfinite(record.field)]
    return not_narrow((float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0))


def not_narrow(ends: tuple[float, float]) -> tuple[float, float]:
    """The ends of a range; if they nearly coincide, the ends of a range around them that is as wide as their size."""
    low, high = ends
    largest = max(abs(low), abs(high))
    if high - low > _NARROW * largest:
        return ends
    return (low - 0.5 * largest, high + 0.5 * largest) if largest else (-0.5, 0.5)


def value_errors(exact: Record, other: Record, ends: tuple[float, float]) -> Floats:
    """(h, w) |other - exact| relative to the range; NaN unless both are visible, infinite if one is NaN."""
    away = np.abs(other.field - exact.field) / (ends[1] - ends[0])
    known = np.isfinite(exact.field), np.isfinite(other.field)
    away = np.where(known[0] & known[1], away, np.where(known[0] | known[1], np.inf, 0.0))
    return np.where(exact.seen & other.seen, away, np.nan)


def worst(exact: Record, other: Record, measure: Floats, among: Bools | None = None) -> Place | None:
    """The pixel at which a measure (h, w) is largest, and positive; the first of several."""
    shown = np.nan_to_num(measure if among is None else np.where(among, measure, 0.0), nan=0.0, posinf=np.inf)
    row, column = (int(i) for i in np.unravel_index(shown.argmax(), shown.shape))
    if not shown[row, column] > 0:
        return None
    source = exact if exact.seen[row, column] else other
    x, y, z = (float(part) for part in source.position[row, column])
    values = float(exact.field[row, column]), float(other.field[row, column])
    return Place(row, column, (x, y, z), int(source.element[row, column]), *values)


def _summary(values: Floats) -> tuple[float, float]:
    """Largest and mean; zero if there are none."""
    return (float(values.max()), float(values.mean())) if len(values) else (0.0, 0.0)


def _angles(first: Floats, second: Floats) -> Floats:
    """(n,) degrees between unit vectors (n, 3); zero if one isn't known."""
    across, along = np.linalg.norm(np.cross(first, second), axis=1), np.einsum("ni,ni->n", first, second)
    return np.asarray(np.nan_to_num(np.degrees(np.arctan2(across, along))))
