"""Texts of a figure in lines that its pictures have room for: a text from a file never widens the page."""

from __future__ import annotations

import re
from typing import Any

from elvis.scene.figure.picture import wrapped
from elvis.scene.record.frame import Legend

#: lines of a title or a text; an ellipsis ends what does not fit
MAX_LINES = 8
#: characters of a line that may be left as it is
MAX_WHOLE = 1_000
#: what stands between spaces; mathematics, between dollar signs, may contain spaces
WORD = re.compile(r"(?:\$[^$]*\$|\S)+")


class _Measure:
    """Widths of texts in pixels, where `wrapped` expects a font of Pillow.

    Text that is cut within mathematics has an odd number of dollar signs, and matplotlib draws it as it is.
    """

    def __init__(self, renderer: Any, points: float) -> None:
        from matplotlib.font_manager import FontProperties

        self._renderer = renderer
        self._font = FontProperties(size=points)

    def getlength(self, text: str) -> float:
        """Width of a text on one line."""
        from matplotlib.cbook import is_math_text

        width, _, _ = self._renderer.get_text_width_height_descent(text, self._font, bool(is_math_text(text)))
        return float(width)


def literal(text: str) -> str:
    """The text as matplotlib draws it without taking what stands between dollar signs for mathematics."""
    return text.replace("$", r"\$")


def broken_lines(text: str, width: float, renderer: Any, points: float, most: int = MAX_LINES) -> str:
    """The text in at most ``most`` lines no wider than ``width`` pixels.

    Given line breaks remain, also where all fits; an ellipsis ends what does not fit.

    renderer  of matplotlib
    points    size of the font
    """
    measure: Any = _Measure(renderer, points)
    lines: list[str] = []
    for line in text.split("\n"):
        left = most - len(lines)
        if left <= 0:
            lines[-1] = wrapped([lines[-1], "…"], width, measure, 1)[0]
            break
        fits = len(line) <= MAX_WHOLE and measure.getlength(line) <= width
        lines += [line] if fits else wrapped(WORD.findall(line), width, measure, left)
    return "\n".join(lines)


def bar_title(legend: Legend) -> str:
    """The title and unit of a colour bar; only given ones may contain mathematics, names of fields do not."""
    bar = legend.bar
    title = literal(legend.title) if bar is None or bar.title is None else bar.title
    return f"{title} [{bar.unit}]" if bar is not None and bar.unit else title
