"""PNG pictures: the image, a title, colour bars with ticks, the values of contours, the axes."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence, Set
from itertools import combinations
from typing import Any, TypeAlias

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from elvis.core.base.arrays import Floats
from elvis.scene import Vector, VolumeRendering
from elvis.scene.figure.page import BarPlace, Page, Part, Rgb
from elvis.scene.model.quantities import velocities
from elvis.scene.record.frame import Arrow, Frame, Legend
from elvis.scene.record.palette import text_color_on, ticks

Font: TypeAlias = ImageFont.FreeTypeFont | ImageFont.ImageFont

#: lines of a title and of each note; what does not fit ends with an ellipsis
MAX_TITLE_LINES, MAX_NOTE_LINES = 3, 3
#: characters of a text that are measured: more fit into no line
MAX_MEASURED = 2_000
#: width of the name above a colour bar, in units of the page
MAX_BAR_NAME = 16


def in_bytes(color: Vector) -> Rgb:
    """A colour of parts in [0, 1] in [0, 255]."""
    red, green, blue = (round(255 * part) for part in color)
    return red, green, blue


def picture(frame: Frame, *, plain: bool = False) -> Image.Image:
    """The frame as an RGB image of the scene's size; with all that explains it unless ``plain``."""
    whole = page(frame, plain=plain)
    return Image.fromarray(whole.rows(0, whole.height), "RGB")


def page(frame: Frame, *, plain: bool = False) -> Page:
    """The page of a picture, which provides rows on request."""
    if not plain:
        return _add_frame(frame)
    height, width = frame.rgb.shape[:2]
    return Page(frame.rgb, (0, 0), (width, height))


def labels(values: list[float]) -> list[str]:
    """Labels that distinguish neighbouring ticks, with as few digits as possible."""
    if len(values) < 2:
        return [f"{value:.6g}" for value in values]
    step = max(values[1] - values[0], 5e-324)
    step_power = np.floor(np.log10(step) + 1e-9)

    largest = max(abs(value) for value in values)
    if 1e-4 <= largest < 1e6:
        decimals = max(0, -int(step_power))
        return [f"{value:.{decimals}f}" for value in values]
    digits = max(0, int(np.floor(np.log10(largest)) - step_power))
    return [f"{value:.{digits}e}" if value else "0" for value in values]


def _add_frame(frame: Frame) -> Page:
    """The image on its background with its axes; title above, colour bars on the right, notes below."""
    image_height, image_width = frame.rgb.shape[:2]
    unit = unit_of(image_width, image_height)
    font = ImageFont.load_default(1.4 * unit)
    small = ImageFont.load_default(1.15 * unit)
    text_color = in_bytes(text_color_on(frame.scene.backdrop))
    paper = in_bytes(frame.scene.backdrop)

    mapped = [legend for legend in frame.legends if legend.palette and legend.constant is None]
    title = frame.title
    bar_height = max(image_height, 6 * unit if mapped else 0)  # what numbers of a bar need
    bars = [_Bar(legend, len(mapped) > 1, unit, bar_height, small, text_color) for legend in mapped]

    # the page: a unit of margin, and the parts above, to the right of and below the image
    width_of_image = image_width + 2 * unit + sum(bar.width for bar in bars)
    keys = [_Key(legend.arrow, unit, image_width, small) for legend in frame.legends if legend.arrow]
    width = max([width_of_image, *(key.width + 2 * unit for key in keys)])
    titles = wrapped(title.split(), width - 2 * unit, font, MAX_TITLE_LINES)
    lines = notes(frame, width - 2 * unit, small)
    line_height = round(1.6 * unit)
    lines_above = max(len(titles), int(any(bar.name for bar in bars)))
    top = unit + 2 * unit * lines_above
    right = unit + image_width
    bottom = top + bar_height
    height = bottom + unit + sum(key.height for key in keys) + line_height * len(lines)

    # title and notes may reach from their own parts into the one to the right of the image
    page = Page(frame.rgb, (unit, top), (width, height), paper)
    above = Part.blank((0, 0, right, top), paper)
    beside = Part.blank((right, 0, width, height), paper)
    below = Part.blank((0, bottom, right, height), paper)
    for part in (above, beside):
        _write_lines(part, (unit, 3 * unit / 2), titles, 2 * unit, fill=text_color, font=font, anchor="lm")
    page.bars = _draw_bars(bars, beside, (image_width + 5 * unit // 2, top))
    for part in (below, beside):
        row = _draw_keys(keys, part, (unit, bottom + unit), text_color)
        _write_lines(part, (unit, row), lines, line_height, fill=text_color, font=small, anchor="lt")
    page.parts += [above, beside, below]
    if min(image_width, image_height) >= 16 * unit and not frame.view.faces_ground:
        _axes(frame, page, unit, small)
    return page


def unit_of(width: int, height: int) -> int:
    """Pixels by which things are set apart on the page of an image."""
    return max(10, round(min(width, height) / 45))


def _draw_bars(bars: Sequence[_Bar], part: Part, corner: tuple[int, int]) -> tuple[BarPlace, ...]:
    """Bars next to one another, the first one at a corner; where they lie."""
    x, y = corner
    places = []
    for bar in bars:
        bar.draw(part, (x, y))
        places.append(BarPlace(bar.legend, (x, y, bar.thickness, bar.height)))
        x += bar.width
    return tuple(places)


def _draw_keys(keys: Sequence[_Key], part: Part, corner: tuple[int, int], fill: Rgb) -> int:
    """Keys below one another, the first one at a corner; the row below them."""
    x, y = corner
    for key in keys:
        key.draw(part, (x, y), fill)
        y += key.height
    return y


def _write_lines(part: Part, place: tuple[float, float], lines: list[str], step: int, **style: Any) -> None:
    """Lines of text, one below the other."""
    x, y = place
    for number, line in enumerate(lines):
        part.text((x, y + step * number), line, **style)


class _Bar:
    """A colour map from low (below) to high (above), this many pixels high, under its name where it has one."""

    def __init__(self, legend: Legend, has_name: bool, unit: int, height: int, font: Font, text_color: Rgb) -> None:
        assert legend.palette is not None
        self.legend = legend
        self.palette = legend.palette
        self.marks = legend.marks
        self.name = fitted(legend.title, MAX_BAR_NAME * unit, font) if has_name else ""
        self.unit = unit
        self.thickness = 3 * unit // 2
        self.height = height
        self.font = font
        self.text_color = text_color
        values = ticks(self.palette.low, self.palette.high, max(3, height // (4 * unit)), legend.is_whole)
        texts = labels(values)
        self.scale = list(zip(values, texts, strict=True))

        # numbers stand to the right of the colours, the name above both
        numbers = max(font.getlength(text) for text in (*texts, "0.00"))
        self.width = round(5 * unit + max(numbers, font.getlength(self.name) - 3 * unit))

    def draw(self, part: Part, corner: tuple[int, int]) -> None:
        """The bar with a thin border, contours across it and numbers next to it."""
        palette = self.palette
        x, y = corner
        width = self.thickness
        thin = max(1, self.unit // 12)
        text_style: dict[str, Any] = {"fill": self.text_color, "font": self.font, "anchor": "lm"}
        column = palette.colors(np.linspace(palette.high, palette.low, self.height))[:, None, :]
        pixels = np.rint(column * 255).astype(np.uint8).repeat(width, axis=1)
        part.paste(Image.fromarray(pixels, "RGB"), corner)
        part.text((x, y - 1.2 * self.unit), self.name, **text_style)

        for value, color in self.marks:
            if palette.low <= value <= palette.high:
                level = self._level(value, y)
                in_255 = tuple(round(255 * share) for share in color)
                part.line((x, level), (x + width - 1, level), fill=in_255, width=thin)
        part.rectangle((x, y), (x + width - 1, y + self.height - 1), outline=self.text_color)

        right = x + width
        for value, text in self.scale:
            level = self._level(value, y)
            part.line((right, level), (right + self.unit // 3, level), fill=self.text_color, width=thin)
            part.text((right + self.unit // 2, level), text, **text_style)

    def _level(self, value: float, top: int) -> float:
        """The row of a value, where the bar begins at the row ``top``."""
        low, high = self.palette.low, self.palette.high
        return top + (high - value) / (high - low) * (self.height - 1)


class _Key:
    """A glyph of a round magnitude with its text, in a row of its own."""

    def __init__(self, arrow: Arrow, unit: int, image_width: int, font: Font) -> None:
        self.arrow, self.unit, self.font = arrow, unit, font
        self.right, self.above = (math.ceil(end) for end in arrow.outline.max(axis=0))
        self.height = max(round(1.6 * unit), 2 * self.above + unit // 2)
        self.text = fitted(arrow.text, max(image_width, MAX_BAR_NAME * unit), font)
        #: pixels of the row
        self.width: int = self.right + unit + math.ceil(font.getlength(self.text))

    def draw(self, part: Part, corner: tuple[int, int], fill: Rgb) -> None:
        """The row, below and to the right of a corner."""
        x, y = corner
        height = 2 * self.above + 2
        mask = Image.new("L", ((self.right + 1) * _FINER, height * _FINER))
        outline = _FINER * (self.arrow.outline * [1.0, -1.0] + [0.0, height / 2])
        ImageDraw.Draw(mask).polygon([tuple(place) for place in outline], fill=255)
        small = mask.resize((self.right + 1, height), Image.Resampling.LANCZOS)
        part.paste(fill, (x, y + (self.height - height) // 2), small)
        place = (x + self.right + self.unit, y + self.height / 2)
        part.text(place, self.text, fill=fill, font=self.font, anchor="lm")


def shortest(value: float) -> str:
    """The text of fewest digits that is a value and no other."""
    text = f"{value:.6g}"
    return text if float(text) == value else repr(float(value)).removesuffix(".0")


def notes(frame: Frame, width: float, font: Font) -> list[str]:
    """The sentences in lines no wider than ``width`` pixels."""
    return [line for words in _notes(frame, contours=True) for line in wrapped(words, width, font, MAX_NOTE_LINES)]


def sentences(frame: Frame, *, contours: bool) -> list[str]:
    """Notes on values without a bar: single visible values and, if requested, the values of contours.

    Values given in the scene are printed exactly, others with enough digits to distinguish them clearly from their
    neighbours.
    """
    return [" ".join(words) for words in _notes(frame, contours=contours)]


def _notes(frame: Frame, *, contours: bool) -> list[list[str]]:
    """All notes, word by word: first what streaks and recovered fields are, then constants, then contours."""
    found = [
        f"streaks along {', '.join(own)}: line integral convolution, a texture of the picture".split()
        for own in velocities(frame.scene)
    ]
    found += [[text, "is", "recovered,", "not", "the", "data"] for text in frame.undeclared]
    for legend in frame.legends:
        if legend.constant is not None:
            found.append([f"{legend.title}", f"= {shortest(legend.constant)}", "wherever", "it", "is", "seen"])
    if not contours:
        return found
    typed = typed_values(frame)
    return found + [_contour_note(legend, typed) for legend in frame.legends if legend.marks]


def typed_values(frame: Frame) -> set[float]:
    """The values of contours that the scene has."""
    values: set[float] = set()
    for item in frame.scene.every_object:
        if isinstance(item, VolumeRendering):
            continue
        contours = item.style.contours
        if contours:
            values.update(contours.values)
    return values


def _contour_note(legend: Legend, typed: set[float]) -> list[str]:
    """Quantity and values of contours, word by word."""
    words = [f"{text}," for text in mark_texts(legend, typed)]
    if len(words) > 16:
        words = [*words[:3], "…", words[-1]]
    words[-1] = words[-1].rstrip(",")
    return ["contours", "of", legend.title, "at", *words]


def mark_texts(legend: Legend, typed: set[float]) -> list[str]:
    """Values of contours: given ones exactly, others with enough digits to distinguish them clearly."""
    return value_labels([value for value, _ in legend.marks], typed)


def value_labels(values: Sequence[float], typed: Set[float] = frozenset()) -> list[str]:
    """Texts of values with enough digits to distinguish neighbours clearly; all digits for ``typed`` values."""
    gaps = np.diff(np.unique(values))
    narrowest = gaps.min() if len(gaps) else 1e-4 * abs(values[0])
    decimals = 1 - int(np.floor(np.log10(max(narrowest, 1e-300))))
    return [shortest(value if value in typed else round(value, decimals)) for value in values]


def wrapped(words: Sequence[str], width: float, font: Font, most: int) -> list[str]:
    """Words in at most ``most`` lines no wider than ``width`` pixels; an ellipsis ends what does not fit."""
    lines: list[str] = []
    for word in words:
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and _length(longer, font) <= width:
            lines[-1] = longer
        elif len(lines) < most:
            lines.append(fitted(word, width, font))
        else:
            lines[-1] = fitted(f"{lines[-1]} …", width, font)
            break
    return lines


def fitted(text: str, width: float, font: Font) -> str:
    """The text, or as much of its beginning as ``width`` pixels hold with an ellipsis behind it."""
    if _length(text, font) <= width:
        return text
    kept = bisect_right(range(min(len(text), MAX_MEASURED)), width, key=lambda count: _length(f"{text[:count]}…", font))
    return f"{text[: max(kept - 1, 0)]}…"


def _length(text: str, font: Font) -> float:
    """Width of a text in pixels; for a long text the width of its beginning."""
    return font.getlength(text[:MAX_MEASURED])


def emptiest_corner(frame: Frame, side: int) -> tuple[int, int, bool]:
    """Column and row of a corner's square, with the disc where least is seen, lower left if possible; if nothing is."""
    centers = np.arange(side) + 0.5 - side / 2
    disc = np.hypot(centers, centers[:, None]) < side / 2
    right = frame.view.width - side
    bottom = frame.view.height - side
    corners = [(0, bottom), (right, bottom), (0, 0), (right, 0)]

    seen = []
    for x, y in corners:
        square = frame.status[y : y + side, x : x + side]
        seen.append(int((square != 0)[disc].sum()))
    best = int(np.argmin(seen))
    return *corners[best], seen[best] == 0


def square_of_arrows(frame: Frame) -> tuple[int, int, int] | None:
    """First column and row and size of the square with the arrows along the axes, None for a picture without them."""
    height, width = frame.element.shape
    unit = unit_of(width, height)
    if frame.scene.axes or frame.view.faces_ground or min(width, height) < 16 * unit:
        return None
    column, row, _ = emptiest_corner(frame, 7 * unit)
    return column, row, 7 * unit


#: colours of the arrows along x, y and z
AXES = ((200, 40, 40), (30, 140, 30), (40, 70, 200))
#: pixels of the masks of arrows for each pixel of the page, along x and y
_FINER = 4


def _axes(frame: Frame, page: Page, unit: int, font: Font) -> None:
    """Arrows along x, y and z in a corner of the image; those pointing away from the viewer are first.

    If all corners show data, a pale disc keeps the arrows legible.
    """
    side = 7 * unit
    column, row, is_free = emptiest_corner(frame, side)
    x = page.corner[0] + column
    y = page.corner[1] + row
    part = page.part((x - unit, y - unit, x + side + unit, y + side + unit))
    if not is_free:
        size = side * _FINER
        disc = Image.new("L", (size, size))
        ImageDraw.Draw(disc).ellipse((0, 0, size - 1, size - 1), fill=110)
        part.paste(in_bytes(frame.scene.backdrop), (x, y), _smaller(disc, side))

    right, up, forward = frame.view.camera.basis()
    tips = 2.4 * np.column_stack([right, up])
    letters = letters_of_axes(tips)
    middle = np.array([x, y]) + 0.5 * side
    down = unit * np.array([1.0, -1.0])
    for axis in np.argsort(-forward):
        if _arrow(part, (x, y), axis, tips[axis] * down, unit):
            place = tuple(middle + letters[axis] * down)
            part.text(place, "xyz"[axis], fill=AXES[axis], font=font, anchor="mm")


def letters_of_axes(tips: Floats) -> Floats:
    """(3, 2) places of the letters beyond the tips (3, 2) of arrows, in units of the page; they don't overlap."""
    places = 1.32 * tips
    for one, other in combinations(range(3), 2):
        between = places[other] - places[one]
        if np.linalg.norm(between) >= 1.0:
            continue
        middle = places[one] + between / 2
        aside = np.array([-middle[1], middle[0]]) / (2.0 * np.linalg.norm(middle))
        aside = aside if aside @ between >= 0.0 else -aside
        places[one], places[other] = middle - aside, middle + aside
    return places


def _arrow(part: Part, corner: tuple[int, int], axis: int, tip: Floats, unit: int) -> bool:
    """The arrow along one axis, from the middle of a square of 7 units that begins at a corner; whether it has a head.

    tip  (2,) from its start, in pixels, down; short ones are lines without head and letter
    """
    fine_unit = unit * _FINER
    size = 7 * fine_unit
    middle = np.array([0.5, 0.5]) * (size, size)
    tip = middle + _FINER * tip
    along = tip - middle
    length = float(np.linalg.norm(along))
    has_head = length > fine_unit // 3

    mask = Image.new("L", (size, size))
    pen = ImageDraw.Draw(mask)
    pen.line([*middle, *tip], fill=255, width=max(_FINER, fine_unit // 6))
    if has_head:
        head = along / length * unit * _FINER * 0.55
        across = 0.4 * np.array([-head[1], head[0]])
        pen.polygon([*(tip + 0.4 * head), *(tip - head + across), *(tip - head - across)], fill=255)
    part.paste(AXES[axis], corner, _smaller(mask, 7 * unit))
    return has_head


def _smaller(mask: Image.Image, side: int) -> Image.Image:
    """A square mask of this many pixels."""
    return mask.resize((side, side), Image.Resampling.LANCZOS)
