"""The pictures of a report: what each device or mesh shows, and maps of where they differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from elvis.core.base.arrays import Bools, Floats
from elvis.reference.contours import crossings
from elvis.reference.metrics import STEPS, Place, not_narrow, value_errors
from elvis.reference.record import Record

Pixels = NDArray[np.uint8]

#: bands of errors: upper limit relative to the range (a colour step, four, sixteen, all), label, colour
BANDS = (
    (1 / STEPS, "within one colour step", (236, 236, 236)),
    (4 / STEPS, "1 to 4 steps", (254, 217, 118)),
    (16 / STEPS, "4 to 16 steps", (253, 141, 60)),
    (np.inf, "more than 16 steps", (189, 0, 38)),
)
#: classes of distances: up to this many pixels
DISTANCES = (
    (0.5, "within half a pixel", (236, 236, 236)),
    (1.0, "up to a pixel", (254, 217, 118)),
    (4.0, "1 to 4 pixels", (253, 141, 60)),
    (np.inf, "more than 4 pixels", (189, 0, 38)),
)
MISSING, SPURIOUS = (37, 52, 148), (129, 15, 124)
WHITE = (255, 255, 255)
#: side of the neighbourhood of the worst pixel, and how much larger it is shown
AROUND, ENLARGED = 40, 6


@dataclass(frozen=True)
class Legend:
    """A colour of a map with its meaning; and its number of pixels."""

    word: str
    color: tuple[int, int, int]
    pixels: int

    @property
    def css(self) -> str:
        """The colour as HTML has it."""
        return "#{:02x}{:02x}{:02x}".format(*self.color)


def image_of(record: Record) -> Pixels:
    """The picture itself."""
    return np.rint(255 * np.clip(record.color, 0, 1)).astype(np.uint8)


def error_map(exact: Record, other: Record, ends: tuple[float, float]) -> tuple[Pixels, list[Legend]]:
    """Differences of values, in bands; and the pixels where only one picture shows anything."""
    measure = value_errors(exact, other, not_narrow(ends))
    return _band(measure, BANDS, exact.seen & ~other.seen, other.seen & ~exact.seen)


def position_map(exact: Record, other: Record, pixel: float) -> tuple[Pixels, list[Legend]]:
    """Distances of the visible points, in pixels of the size ``pixel``."""
    measure = np.linalg.norm(other.position - exact.position, axis=2) / pixel
    return _band(measure, DISTANCES, exact.seen & ~other.seen, other.seen & ~exact.seen)


def distance_map(apart: Floats, pixel: float) -> tuple[Pixels, list[Legend]]:
    """Distances of visible points from linear surfaces, in pixels of the size ``pixel``."""
    nowhere = np.zeros(apart.shape, bool)
    picture, legend = _band(apart / pixel, DISTANCES, nowhere, nowhere)
    return picture, legend[: len(DISTANCES)]


def _band(measure: Floats, bands: Sequence[Any], missing: Bools, spurious: Bools) -> tuple[Pixels, list[Legend]]:
    """A map of a measure (h, w), NaN if it has no meaning."""
    picture, legend, low = np.full((*measure.shape, 3), 255, np.uint8), [], -1.0
    for high, word, color in bands:
        with np.errstate(invalid="ignore"):
            here = (measure > low) & (measure <= high)
        picture[here], low = color, high
        legend.append(Legend(word, color, int(here.sum())))
    for here, word, color in ((missing, "missing", MISSING), (spurious, "spurious", SPURIOUS)):
        picture[here] = color
        legend.append(Legend(word, color, int(here.sum())))
    return picture, legend


def contour_map(exact: Record, other: Record, values: Sequence[float]) -> Pixels:
    """The contours of both pictures at twice the size: black the exact ones, red the others, on the pale picture."""
    pale = (255 - 0.3 * (255 - image_of(exact).astype(np.float64))).astype(np.uint8)
    image = Image.fromarray(np.repeat(np.repeat(pale, 2, axis=0), 2, axis=1))
    draw = ImageDraw.Draw(image)
    for record, color, half in ((exact, (0, 0, 0), 1.0), (other, (214, 0, 30), 0.6)):
        for value in values:
            for row, column in 2 * crossings(record, value) + 0.5:
                draw.ellipse((column - half, row - half, column + half, row + half), fill=color)
    return np.asarray(image)


def around(record: Record, place: Place) -> Pixels:
    """The neighbourhood of a pixel, enlarged, with the pixel framed."""
    height, width = record.shape
    top = int(np.clip(place.row - AROUND // 2, 0, max(0, height - AROUND)))
    left = int(np.clip(place.column - AROUND // 2, 0, max(0, width - AROUND)))
    part = image_of(record)[top : top + AROUND, left : left + AROUND]
    image = Image.fromarray(np.repeat(np.repeat(part, ENLARGED, axis=0), ENLARGED, axis=1))
    row, column = (place.row - top) * ENLARGED, (place.column - left) * ENLARGED
    box = (column - 2, row - 2, column + ENLARGED + 1, row + ENLARGED + 1)
    ImageDraw.Draw(image).rectangle(box, outline=(255, 0, 255), width=2)
    return np.asarray(image)


def color_bar(palette: str, width: int = 512, height: int = 16) -> Pixels:
    """The colour map from left to right."""
    from elvis.scene.record.palette import Palette

    steps = Palette.of_name(palette, 0.0, 1.0).colors(np.linspace(0, 1, width))
    return np.tile(np.rint(255 * steps).astype(np.uint8), (height, 1, 1))
