"""Texts with arrows at points of a figure, and images in its corner."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from elvis.core.base.terminal import visible
from elvis.core.files.plain import check_plain
from elvis.scene.figure.broken_lines import broken_lines
from elvis.scene.figure.rulers import seen_of
from elvis.scene.model.errors import SceneError

if TYPE_CHECKING:
    from elvis.scene.figure.panel import Panel
    from elvis.scene.model.whole import Caption

#: above all that a panel draws
ABOVE = 5


def draw_caption(panel: Panel, caption: Caption) -> None:
    """A text at a world point, or with an arrow to it; nothing if the point lies outside the picture."""
    from matplotlib import patheffects

    at = caption.at if len(caption.at) == 3 else (*caption.at, 0.0)
    column, row = seen_of(panel.frame.view, np.array([at]))[0]
    if not (-0.5 <= column <= panel.width - 0.5 and -0.5 <= row <= panel.height - 0.5):
        return
    side = min(panel.width, panel.height)
    x, y = column + caption.shift[0] * side, row - caption.shift[1] * side
    how = {"color": panel.page.text_color, "fontsize": panel.page.points, "zorder": ABOVE, "va": "center"}
    how["ha"] = "center" if any(caption.shift) else "left"
    style = {"arrowstyle": "-|>,head_length=0.6,head_width=0.22", "lw": panel.page.thin, "shrinkA": 0, "shrinkB": 0}
    style |= {"mutation_scale": panel.page.to_points(panel.unit), "color": panel.page.text_color}
    arrow = {"arrowprops": style} if any(caption.shift) else {}
    # a pale outline keeps letters legible on the data
    outline = [patheffects.withStroke(linewidth=3 * panel.page.thin, foreground=panel.frame.scene.backdrop)]
    words = broken_lines(visible(caption.text), panel.width, panel.page.measure(), panel.page.points)
    text = panel.axes.annotate(words, (column, row), (x, y), annotation_clip=False, **how, **arrow)
    text.set_path_effects(outline)


def draw_image(panel: Panel, name: str) -> None:
    """An image in the upper right corner of the picture, an eighth of its height."""
    image = read_image(name)
    height = max(1, round(panel.height / 8))
    width = max(1, round(image.width * height / image.height))
    right, top = panel.width - 0.5 * panel.unit, 0.5 * panel.unit
    extent = (right - width, right, top + height, top)
    panel.axes.imshow(np.asarray(image.resize((width, height))), extent=extent, aspect="auto", zorder=ABOVE)
    panel.axes.set(xlim=(-0.5, panel.width - 0.5), ylim=(panel.height - 0.5, -0.5))


def read_image(name: str) -> Any:
    """An image with transparency; SceneError if the file is none."""
    from PIL import Image

    check_plain(Path(name))
    try:
        return Image.open(name).convert("RGBA")
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        raise SceneError(f"image: expected an image file, such as .png, found {name!r}") from error
