"""PNG pictures: the image, a title, colour bars with ticks, the values of contours, the axes."""

from __future__ import annotations

from collections.abc import Sequence, Set
from typing import TypeAlias

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from elvis.scene import Vector, VolumeRendering
from elvis.scene.frame import Frame, Legend
from elvis.scene.page import Page, Part, Rgb
from elvis.scene.palette import text_color_on

Font: TypeAlias = ImageFont.FreeTypeFont | ImageFont.ImageFont


def in_bytes(color: Vector) -> Rgb:
    """A colour of parts in [0, 1] in [0, 255]."""
    red, green, blue = (round(255 * part) for part in color)
    return red, green, blue


def picture(frame: Frame, *, plain: bool = False) -> Image.Image:
    """The frame as an RGB image of the scene's size; with all that explains it unless ``plain``."""
    whole = page(frame, plain=plain)
    return Image.fromarray(whole.rows(0, whole.height), "RGB")


def page(frame: Frame, *, plain: bool = False) -> Page:
    """The same, of which some rows can be had at a time."""
    height, width = frame.rgb.shape[:2]
    return Page(frame.rgb, (0, 0), (width, height)) if plain else _add_frame(frame)


def ticks(low: float, high: float, most: int) -> list[float]:
    """Round values in [low, high], at most ``most``: steps of 1, 2 or 5 times a power of ten.

    The two ends where the range is too narrow for such steps.
    """
    low, high = float(low), float(high)
    span = high - low
    if not max(1e-12 * max(abs(low), abs(high)), 1e-300) < span < 1e301:
        return [low, high]
    power = 10.0 ** np.floor(np.log10(span / max(most, 1)))
    for step in (power * factor for factor in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)):
        first, last = int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9))
        if last - first < most:
            break
    return [number * step for number in range(first, last + 1)]


def labels(values: list[float]) -> list[str]:
    """Texts that tell neighbouring ticks apart, in as few digits as that takes."""
    if len(values) < 2:
        return [f"{value:.6g}" for value in values]
    step = max(values[1] - values[0], 5e-324)
    largest = max(abs(value) for value in values)
    if not 1e-4 <= largest < 1e6:
        digits = max(0, int(np.floor(np.log10(largest)) - np.floor(np.log10(step) + 1e-9)))
        return [f"{value:.{digits}e}" if value else "0" for value in values]
    decimals = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    return [f"{value:.{decimals}f}" for value in values]


def _add_frame(frame: Frame) -> Page:
    """The image on its background with its axes; the title above, a bar for each colour map beside it, notes below."""
    high, wide = frame.rgb.shape[:2]
    unit = max(10, round(min(wide, high) / 45))
    font, small = ImageFont.load_default(1.4 * unit), ImageFont.load_default(1.15 * unit)
    text_color, paper = in_bytes(text_color_on(frame.scene.backdrop)), in_bytes(frame.scene.backdrop)
    mapped = [legend for legend in frame.legends if legend.palette and legend.constant is None]
    tall = max(high, 6 * unit if mapped else 0)  # what numbers of a bar need
    bars = [_Bar(legend, legend.title if len(mapped) > 1 else "", unit, tall, small, text_color) for legend in mapped]
    title = frame.scene.title if frame.scene.title is not None else mapped[0].title if len(mapped) == 1 else ""
    width = max(wide + 2 * unit + sum(bar.width for bar in bars), round(font.getlength(title)) + 3 * unit)
    below = notes(frame, width - 2 * unit, small)

    # what stands above, to the right of, and below the image; the first and last may reach over the second
    top, foot = 3 * unit if title or any(bar.name for bar in bars) else unit, round(1.6 * unit)
    height, right, bottom = tall + top + unit + foot * len(below), unit + wide, top + tall
    made = Page(frame.rgb, (unit, top), (width, height), paper)
    above, right_of = Part.blank((0, 0, right, top), paper), Part.blank((right, 0, width, height), paper)
    under = Part.blank((0, bottom, right, height), paper)
    for part in (above, right_of):
        part.text((unit, top / 2), title, fill=text_color, font=font, anchor="lm")
    x = wide + 5 * unit // 2
    for bar in bars:
        bar.draw(right_of, (x, top))
        x += bar.width
    for number, line in enumerate(below):
        for part in (under, right_of):
            part.text((unit, bottom + unit + foot * number), line, fill=text_color, font=small, anchor="lt")
    made.parts += [above, right_of, under]
    if min(wide, high) >= 16 * unit and not frame.view.faces_ground:
        _axes(frame, made, unit, small)
    return made


class _Bar:
    """A colour map from low (below) to high (above), this many pixels high, under its name where it has one."""

    def __init__(self, legend: Legend, name: str, unit: int, height: int, font: Font, text_color: Rgb) -> None:
        assert legend.palette is not None
        self.palette, self.marks, self.name = legend.palette, legend.marks, name
        self.unit, self.height, self.font, self.text_color = unit, height, font, text_color
        values = ticks(self.palette.low, self.palette.high, max(3, height // (4 * unit)))
        self.scale = list(zip(values, labels(values), strict=True))
        room = max(font.getlength(text) for text in (*labels(values), "0.00"))
        self.width = round(5 * unit + max(room, font.getlength(name) - 3 * unit))

    def draw(self, part: Part, corner: tuple[int, int]) -> None:
        """The bar with a thin border, contours across it and numbers next to it."""
        palette, unit = self.palette, self.unit
        column = palette.colors(np.linspace(palette.high, palette.low, self.height))[:, None, :]
        (x, y), width, thin = corner, 3 * unit // 2, max(1, unit // 12)
        part.paste(Image.fromarray(np.rint(column * 255).astype(np.uint8).repeat(width, axis=1), "RGB"), corner)
        part.text((x, y - 1.2 * unit), self.name, fill=self.text_color, font=self.font, anchor="lm")

        def line(value: float, left: int, right: int, color: tuple[int, ...]) -> float:
            level = y + (palette.high - value) / (palette.high - palette.low) * (self.height - 1)
            part.line((x + left, level), (x + right, level), fill=color, width=thin)
            return level

        for value, color in self.marks:
            if palette.low <= value <= palette.high:
                line(value, 0, width - 1, tuple(round(255 * share) for share in color))
        part.rectangle((x, y), (x + width - 1, y + self.height - 1), outline=self.text_color)
        for value, text in self.scale:
            level = line(value, width, width + unit // 3, self.text_color)
            part.text((x + width + unit // 2, level), text, fill=self.text_color, font=self.font, anchor="lm")


def shortest(value: float) -> str:
    """The text of fewest digits that is a value and no other."""
    text = f"{value:.6g}"
    return text if float(text) == value else repr(float(value)).removesuffix(".0")


def notes(frame: Frame, width: float, font: Font) -> list[str]:
    """The sentences in lines no wider than ``width`` pixels."""
    return [line for words in _notes(frame, contours=True) for line in _lines(words, width, font)]


def sentences(frame: Frame, *, contours: bool) -> list[str]:
    """What bars don't tell: the only value of what has no bar and, where wanted, the values of contours.

    Values of the scene are printed exactly, others with the digits that tell them well apart from their neighbours.
    """
    return [" ".join(words) for words in _notes(frame, contours=contours)]


def _notes(frame: Frame, *, contours: bool) -> list[list[str]]:
    typed = typed_values(frame)
    found = [
        [f"{legend.title}", f"= {shortest(legend.constant)}", "wherever", "it", "is", "seen"]
        for legend in frame.legends
        if legend.constant is not None
    ]
    return found + [_note(legend, typed) for legend in frame.legends if legend.marks and contours]


def typed_values(frame: Frame) -> set[float]:
    """The values of contours that the scene has."""
    styles = [item.style for item in frame.scene.every_object if not isinstance(item, VolumeRendering)]
    return {value for style in styles if style.contours for value in style.contours.values}


def _note(legend: Legend, typed: set[float]) -> list[str]:
    """What contours are of, word by word."""
    words = [f"{text}," for text in mark_texts(legend, typed)]
    if len(words) > 16:
        words = [*words[:3], "…", words[-1]]
    return ["contours", "of", legend.title, "at", *words[:-1], words[-1].rstrip(",")]


def mark_texts(legend: Legend, typed: set[float]) -> list[str]:
    """The values of contours: those that the scene has exactly, others as far as it takes to tell them well apart."""
    return value_labels([value for value, _ in legend.marks], typed)


def value_labels(values: Sequence[float], typed: Set[float] = frozenset()) -> list[str]:
    """Texts of values in as many digits as tell them well apart from their neighbours; of ``typed`` ones in all."""
    gaps = np.diff(np.unique(values))
    step = max(gaps.min() if len(gaps) else 1e-4 * abs(values[0]), 1e-300)
    decimals = 1 - int(np.floor(np.log10(step)))
    return [shortest(value if value in typed else round(value, decimals)) for value in values]


def _lines(words: list[str], width: float, font: Font) -> list[str]:
    """Words in lines no wider than n pixels."""
    lines = [words[0]]
    for word in words[1:]:
        longer = f"{lines[-1]} {word}"
        if font.getlength(longer) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


def _emptiest(frame: Frame, side: int) -> tuple[int, int, bool]:
    """Column and row of a corner's square, with the disc where least is seen, lower left if possible; if nothing is."""
    x, y = np.meshgrid(*2 * [np.arange(side) + 0.5 - side / 2])
    disc = np.hypot(x, y) < side / 2
    columns, rows = (0, frame.view.width - side), (frame.view.height - side, 0)
    places = [(x, y) for y in rows for x in columns]
    seen = [int((frame.status[y : y + side, x : x + side] != 0)[disc].sum()) for x, y in places]
    return *places[int(np.argmin(seen))], min(seen) == 0


#: colours of the arrows along x, y and z
AXES = ((200, 40, 40), (30, 140, 30), (40, 70, 200))


def _axes(frame: Frame, page: Page, unit: int, font: Font) -> None:
    """Arrows along x, y and z in a corner of the image, those that point away from the viewer first.

    Where all corners show data, a pale disc keeps them legible.
    """
    right, up, forward = frame.view.camera.basis()
    side, finer = 7 * unit, 4
    shape = (side * finer, side * finer)
    arrows, middle = Image.new("L", shape), np.array([0.5, 0.5]) * shape
    column, row, free = _emptiest(frame, side)
    place = (page.corner[0] + column, page.corner[1] + row)
    part = page.part((place[0] - unit, place[1] - unit, place[0] + side + unit, place[1] + side + unit))
    if not free:
        disc = Image.new("L", shape)
        ImageDraw.Draw(disc).ellipse((0, 0, shape[0] - 1, shape[1] - 1), fill=110)
        part.paste(in_bytes(frame.scene.backdrop), place, disc.resize((side, side), Image.Resampling.LANCZOS))
    for axis in np.argsort(-forward):
        tip = middle + 2.4 * unit * finer * np.array([right[axis], -up[axis]])
        along = tip - middle
        length = float(np.linalg.norm(along))
        arrows.paste(0, (0, 0, *shape))
        pen = ImageDraw.Draw(arrows)
        pen.line([*middle, *tip], fill=255, width=max(finer, unit * finer // 6))
        if length > unit * finer // 3:
            along = along / length * unit * finer * 0.55
            across = 0.4 * np.array([-along[1], along[0]])
            pen.polygon([*(tip + 0.4 * along), *(tip - along + across), *(tip - along - across)], fill=255)
        part.paste(AXES[axis], place, arrows.resize((side, side), Image.Resampling.LANCZOS))
        if length > unit * finer // 3:
            x, y = place + (middle + (tip - middle) * 1.32) / finer
            part.text((x, y), "xyz"[axis], fill=AXES[axis], font=font, anchor="mm")
