"""PNG pictures: the image, a colour bar with ticks, a title."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from elvis.renderer.frame import Frame

Font: TypeAlias = ImageFont.FreeTypeFont | ImageFont.ImageFont
INK = (30, 30, 30)


def picture(frame: Frame, *, plain: bool = False) -> Image.Image:
    """The frame as an RGB image of the scene's size; with a bar and a title beside it unless ``plain``."""
    image = Image.fromarray(frame.rgb, "RGB")
    return image if plain else _framed(frame, image)


def ticks(low: float, high: float, most: int) -> list[float]:
    """Round values in [low, high], at most ``most``: steps of 1, 2 or 5 times a power of ten.

    The two ends where the range is too narrow for such steps.
    """
    low, high = float(low), float(high)
    span = high - low
    if not max(1e-12 * max(abs(low), abs(high)), 1e-300) < span < 1e301:
        return [low, high]
    power = 10.0 ** np.floor(np.log10(span / max(most - 1, 1)))
    step = next(power * f for f in (1.0, 2.0, 5.0, 10.0, 20.0) if span / (power * f) <= max(most - 1, 1))
    first = int(np.ceil(low / step - 1e-9))
    last = int(np.floor(high / step + 1e-9))
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


def _framed(frame: Frame, image: Image.Image) -> Image.Image:
    """The image on white, the colour bar to its right, the title above."""
    unit = max(10, round(min(image.size) / 45))
    font, small = ImageFont.load_default(1.4 * unit), ImageFont.load_default(1.15 * unit)
    low, high = frame.range
    values = ticks(low, high, max(3, image.height // (4 * unit)))
    texts = labels(values)
    probe = ImageDraw.Draw(image)
    room = max([probe.textlength(text, font=small) for text in [*texts, "0.00"]])

    # title, image, bar and its numbers
    top = 3 * unit
    title = frame.scene.field
    width = max(image.width + round(6 * unit + room), round(probe.textlength(title, font=font)) + 3 * unit)
    sheet = Image.new("RGB", (width, image.height + top + unit), "white")
    sheet.paste(image, (unit, top))
    draw = ImageDraw.Draw(sheet)
    draw.text((unit, top / 2), title, fill=INK, font=font, anchor="lm")
    _bar(frame, draw, sheet, (image.width + 2 * unit + unit // 2, top), unit, image.height)
    for value, text in zip(values, texts, strict=True):
        y = top + (high - value) / (high - low) * (image.height - 1)
        x = image.width + 4 * unit
        draw.line([(x, y), (x + unit // 3, y)], fill=INK, width=max(1, unit // 12))
        draw.text((x + unit // 2, y), text, fill=INK, font=small, anchor="lm")
    return sheet


def _bar(
    frame: Frame, draw: ImageDraw.ImageDraw, sheet: Image.Image, corner: tuple[int, int], unit: int, height: int
) -> None:
    """The colour map from low (below) to high (above), with a thin border."""
    low, high = frame.range
    values = np.linspace(high, low, height)
    column = np.rint(frame.palette.colors(values)[:, None, :] * 255).astype(np.uint8)
    x, y = corner
    width = 3 * unit // 2
    sheet.paste(Image.fromarray(np.repeat(column, width, axis=1), "RGB"), corner)
    draw.rectangle([x, y, x + width - 1, y + height - 1], outline=INK)
