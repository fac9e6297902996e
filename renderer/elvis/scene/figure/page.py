"""Pages: an image with small drawings next to and over it, made some rows at a time, as whole ones may be large."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from elvis.core.base.terminal import visible

if TYPE_CHECKING:
    from elvis.scene.record.frame import Legend

Pixels: TypeAlias = NDArray[np.uint8]
Place: TypeAlias = tuple[float, float]
#: red, green and blue in [0, 255]
Rgb: TypeAlias = tuple[int, int, int]
WHITE: Rgb = (255, 255, 255)
#: pixels of the rows that are made at once
AT_ONCE = 1 << 20


class Part:
    """A small drawing on a page, in positions of the page, cropped to its size.

    corner  column and row of the page at which it begins
    """

    def __init__(self, corner: tuple[int, int], image: Image.Image) -> None:
        self.corner, self.image = corner, image
        self._draw = ImageDraw.Draw(image)

    @staticmethod
    def blank(box: tuple[int, int, int, int], paper: Rgb = WHITE) -> Part:
        """One of one colour, from a box: first column and row, and those after the last."""
        left, top, right, bottom = box
        return Part((left, top), Image.new("RGB", (right - left, bottom - top), paper))

    def _own(self, place: Place) -> Place:
        return place[0] - self.corner[0], place[1] - self.corner[1]

    def text(self, place: Place, text: str, **how: Any) -> None:
        """Draw text as ImageDraw.text does, without control characters."""
        self._draw.text(self._own(place), visible(text), **how)

    def line(self, one: Place, other: Place, **how: Any) -> None:
        """Draw a line between two positions, as ImageDraw.line does."""
        self._draw.line([self._own(one), self._own(other)], **how)

    def rectangle(self, one: Place, other: Place, **how: Any) -> None:
        """As ImageDraw.rectangle."""
        self._draw.rectangle([self._own(one), self._own(other)], **how)

    def paste(
        self, what: Image.Image | tuple[int, ...], corner: tuple[int, int], mask: Image.Image | None = None
    ) -> None:
        """As Image.paste."""
        place = corner[0] - self.corner[0], corner[1] - self.corner[1]
        self.image.paste(what, place, mask)

    def rows(self, first: int, last: int) -> Pixels:
        """Its own rows from the first one up to the last."""
        return np.asarray(self.image.crop((0, first, self.image.width, last)))


@dataclass(frozen=True)
class BarPlace:
    """Position of a colour bar.

    legend   legend that it shows
    box      left, top, width and height in pixels of the page
    upright  low values are at the bottom; else on the left
    """

    legend: Legend
    box: tuple[float, float, float, float]
    upright: bool = True


@dataclass(frozen=True)
class Layout:
    """Positions on a picture with all its annotations, in pixels from the upper left corner.

    size    width and height
    corner  column and row at which the image begins
    """

    size: tuple[int, int]
    corner: tuple[int, int]
    bars: tuple[BarPlace, ...] = ()


class Page:
    """An image, and parts that lie on top of it and of one another.

    image   (h, w, 3) in [0, 255]
    corner  column and row of the page where the image begins
    size    width and height
    paper   the colour of what nothing covers
    """

    def __init__(self, image: Pixels, corner: tuple[int, int], size: tuple[int, int], paper: Rgb = WHITE) -> None:
        self.image, self.corner, self.paper, self.parts = image, corner, paper, list[Part]()
        self.width, self.height = size
        self.bars: tuple[BarPlace, ...] = ()

    @property
    def layout(self) -> Layout:
        """Positions of the image and its colour bars."""
        return Layout((self.width, self.height), self.corner, self.bars)

    def rows(self, first: int, last: int) -> Pixels:
        """(last - first, width, 3) some of the page's rows."""
        # rows are copied whole: that is many times faster than colour by colour
        page = np.empty((last - first, self.width, 3), np.uint8)
        page[:] = np.full((self.width, 3), self.paper, np.uint8)
        own = slice(*np.clip((first - self.corner[1], last - self.corner[1]), 0, len(self.image)))
        _put(page, self.image[own], (self.corner[0], self.corner[1] + own.start - first))
        for part in self.parts:
            ends = np.clip((first - part.corner[1], last - part.corner[1]), 0, part.image.height)
            _put(page, part.rows(*ends), (part.corner[0], part.corner[1] + int(ends[0]) - first))
        return page

    def strips(self) -> Iterator[Pixels]:
        """All rows, some at a time."""
        step = max(1, AT_ONCE // self.width)
        for first in range(0, self.height, step):
            yield self.rows(first, min(first + step, self.height))

    def part(self, box: tuple[int, int, int, int]) -> Part:
        """The contents of the page in a box, cropped at its border, as a part of the page for drawing."""
        left, right = np.clip((box[0], box[2]), 0, self.width)
        top, bottom = np.clip((box[1], box[3]), 0, self.height)
        shown = np.ascontiguousarray(self.rows(int(top), int(bottom))[:, left:right])
        self.parts.append(Part((int(left), int(top)), Image.fromarray(shown, "RGB")))
        return self.parts[-1]


def _put(page: Pixels, what: Pixels, corner: tuple[int, int]) -> None:
    """Set pixels of a page from a corner on."""
    height, width = what.shape[:2]
    place = page[corner[1] : corner[1] + height, corner[0] : corner[0] + width]
    if what.strides[1] == what.shape[2]:
        place[...] = what
        return
    # arrays with gaps between their pixels are copied colour by colour, many times faster than pixel by pixel
    for color in range(what.shape[2]):
        place[..., color] = what[..., color]
