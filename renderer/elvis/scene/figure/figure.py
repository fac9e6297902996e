"""Figures for papers, by matplotlib: exact pixels with curves, axes, bars and texts around them, as vectors or as PNG.

All is laid out in pixels of the picture; a page has `Scene.dpi` of them in an inch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from elvis.scene import Scene
from elvis.scene.figure.page import BarPlace, Layout
from elvis.scene.model.errors import SceneError
from elvis.scene.model.ownership import SOFTWARE
from elvis.scene.model.whole import VECTORS
from elvis.scene.record.frame import Frame, Legend
from elvis.scene.record.palette import text_color_on

#: seeds the names that matplotlib gives to parts of SVG files, so that the same figure is the same file
SALT = "elvis"
#: characters of a text with mathematics, each of which takes matplotlib a third of a millisecond
MAX_MATHEMATICS = 1_000
#: which program wrote a file; no dates, which differ from run to run
METADATA = {
    ".svg": {"Date": None, "Creator": SOFTWARE},
    ".pdf": {"CreationDate": None, "Creator": SOFTWARE},
    ".png": {"Software": SOFTWARE},
}


def needs_figure(frame: Frame, suffix: str) -> bool:
    """Whether what a scene asks for takes a figure; else a picture (see picture.py) has it all."""
    scene = frame.scene
    if suffix in VECTORS or (frame.drawing is not None and frame.drawing.strokes):
        return True
    asked = frame.has_rulers or scene.scale_bar or scene.box or scene.is_clear or scene.font or scene.font_size
    has_more = bool(scene.texts or scene.image)
    has_bar = any(legend.bar is not None for legend in frame.legends)
    return not scene.plain and bool(asked or has_more or has_bar or (scene.title or "").count("$") > 1)


def save_figure(frames: Sequence[Frame], path: Path | BinaryIO, suffix: str, *, plain: bool = False) -> Layout:
    """Write a figure of one picture, or of several in panels, as the scene of the first says.

    Returns where the first picture and its bars lie.
    """
    scene = frames[0].scene
    with settings(scene):
        _check_mathematics(frames)
        page = Page(frames, plain=plain)
        how = {"bbox_inches": page.bounds(), "pad_inches": 0, "metadata": METADATA[suffix]}
        page.figure.savefig(path, format=suffix[1:], dpi=scene.dpi, **how)
        return page.layout(how["bbox_inches"])


def settings(scene: Scene) -> AbstractContextManager[Any]:
    """matplotlib's settings: texts stay texts.  SceneError where it is missing, or the font."""
    try:
        import matplotlib
        from matplotlib import font_manager
    except ImportError as error:
        raise SceneError(
            "figures with axes, labels, separate colour bars or vector graphics need matplotlib: "
            "pip install 'elvis-viz[figures]'"
        ) from error
    own: dict[str, Any] = {"svg.fonttype": "none", "svg.hashsalt": SALT, "pdf.fonttype": 42}
    if scene.font is not None:
        known = sorted({font.name for font in font_manager.fontManager.ttflist})
        if scene.font not in known:
            raise SceneError(f"no font {scene.font!r} is installed: expected one of {', '.join(known)}")
        is_roman = any(word in scene.font.lower() for word in ("serif", "times", "roman", "stix"))
        own |= {"font.family": [scene.font, "DejaVu Sans"], "mathtext.fontset": "stix" if is_roman else "dejavusans"}
    context: Callable[[Any], AbstractContextManager[Any]] = matplotlib.rc_context
    return context(own)


def _check_mathematics(frames: Sequence[Frame]) -> None:
    """SceneError if text between dollar signs in a title or a text is not valid mathematics."""
    from matplotlib.mathtext import MathTextParser

    from elvis.scene.figure.broken_lines import bar_title

    titles = [frame.scene.title or "" for frame in frames]
    titles += [caption.text for frame in frames for caption in frame.scene.texts]
    titles += [bar_title(legend) for frame in frames for legend in frame.legends]
    for title in titles:
        if title.count("$") - title.count(r"\$") < 2:
            continue
        if len(title) > MAX_MATHEMATICS:
            expected = f"at most {MAX_MATHEMATICS} characters of text with mathematics"
            raise SceneError(f"title: expected {expected}, found {len(title)}")
        try:
            MathTextParser("path").parse(title)
        except ValueError as error:
            reason = " ".join(str(error).split("ParseException: ")[-1].split())
            raise SceneError(f"title: expected mathematics between dollars, found {title!r}: {reason}") from error


class Page:
    """The page with its panels.

    unit    pixels by which things are set apart
    points  size of texts
    thin    width of thin lines in points
    """

    def __init__(self, frames: Sequence[Frame], *, plain: bool) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        from elvis.scene.figure.panel import Panel

        self.scene, self.plain = frames[0].scene, plain
        heights, widths = zip(*(frame.element.shape for frame in frames), strict=True)
        self.unit = max(10, round(min(max(widths), max(heights)) / 45))
        self.size = np.array([max(widths), max(heights)], float)
        self.text_color = text_color_on(self.scene.backdrop)
        face = (*self.scene.backdrop, self.scene.background[3] if self.scene.is_clear else 1.0)
        self.figure = Figure(figsize=tuple(self.size / self.scene.dpi), dpi=self.scene.dpi, facecolor=face)
        self.canvas: Any = FigureCanvasAgg(self.figure)
        self.points = self.scene.font_size or self.to_points(1.15 * self.unit)
        self.thin = max(0.4, self.to_points(0.08 * self.unit))
        common = _common(frames) if len(frames) > 1 else None
        self.panels = [Panel(self, frame, number, has_bars=common is None) for number, frame in enumerate(frames)]
        if not plain:
            self._arrange(common)

    def measure(self) -> Any:
        """The renderer that measures the size of texts."""
        renderer: Callable[[], Any] = self.canvas.get_renderer
        return renderer()

    def to_points(self, pixels: float) -> float:
        """A length in points."""
        return pixels * 72 / self.scene.dpi

    def _arrange(self, common: Legend | None) -> None:
        """Panels in rows and columns, as wide and high as what stands around them takes; then a bar that all share."""
        rows, columns = self.scene.panels or (1, len(self.panels))
        grid = [self.panels[k * columns : (k + 1) * columns] for k in range(rows)]
        gap, edges = 1.5 * self.unit, [panel.edges() for panel in self.panels]
        lefts = [max(-box[0, 0] for box in edges[k::columns]) for k in range(min(columns, len(edges)))]
        rights = [max(box[1, 0] for box in edges[k::columns]) for k in range(min(columns, len(edges)))]
        y, corners = 0.0, []
        for number, row in enumerate(grid):
            own = edges[number * columns : (number + 1) * columns]
            if not row:
                continue
            y -= max(box[1, 1] for box in own)
            x = 0.0
            for panel, left, right in zip(row, lefts, rights, strict=False):
                panel.move(x + left, y)
                corners.append((x + left, y, x + left + panel.width, y + panel.height))
                x += left + right + gap
            y -= max(-box[0, 1] for box in own) + gap
        if common is not None:
            ends = np.array(corners)
            self.panels[0].common_bar(common, np.array([ends[:, :2].min(axis=0), ends[:, 2:].max(axis=0)]))

    def bounds(self) -> Any:
        """The page in inches, in whole pixels, so that the pixels of the pictures remain unchanged."""
        from matplotlib.transforms import Bbox

        if self.plain:
            return Bbox.from_bounds(0, 0, *self.size / self.scene.dpi)
        every = np.concatenate([panel.edges() + panel.corner for panel in self.panels])
        margin = 0.8 * self.unit
        low, high = np.floor(every.min(axis=0) - margin), np.ceil(every.max(axis=0) + margin)
        return Bbox(np.array([low, high]) / self.scene.dpi)

    def layout(self, bounds: Any) -> Layout:
        """The layout of the first picture and its bars within bounds in inches; rows are counted from the top."""
        low, high = np.asarray(bounds.get_points()) * self.scene.dpi
        panel = self.panels[0]
        left, lower = panel.corner - low
        width, height = np.rint(high - low).astype(int).tolist()
        bars = []
        for bar in panel.bars:
            x, y, wide, tall = bar.place().tolist()
            box = (left + x, height - (lower + y + tall), wide, tall)
            bars.append(BarPlace(bar.legend, box, bar.is_upright))
        return Layout((width, height), (round(left), round(height - lower - panel.height)), tuple(bars))


def _common(frames: Sequence[Frame]) -> Legend | None:
    """The bar that all pictures share: of one quantity, in the same colours and range."""
    every = [[legend for legend in frame.legends if legend.palette and legend.constant is None] for frame in frames]
    if any(len(own) != 1 for own in every):
        return None
    first = every[0][0]
    return first if all(_is_same(first, own[0]) for own in every) else None


def _is_same(one: Legend, other: Legend) -> bool:
    """Whether two colour bars are equal."""
    assert one.palette is not None
    assert other.palette is not None
    ends = one.palette.low, one.palette.high, one.title, one.bar
    same = ends == (other.palette.low, other.palette.high, other.title, other.bar)
    return same and np.array_equal(one.palette.table, other.palette.table)
