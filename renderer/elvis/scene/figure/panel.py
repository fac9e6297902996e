"""One picture of a figure, with all that stands around it, as artists of matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.terminal import visible
from elvis.scene.figure.bar import Bar
from elvis.scene.figure.broken_lines import broken_lines, literal
from elvis.scene.figure.captions import draw_caption, draw_image
from elvis.scene.figure.picture import (
    AXES,
    MAX_NOTE_LINES,
    emptiest_corner,
    letters_of_axes,
    mark_texts,
    sentences,
    typed_values,
)
from elvis.scene.figure.rulers import Ruler, aligned, box_edges, box_rulers, scale_bar, sides
from elvis.scene.model.errors import SceneError
from elvis.scene.record.frame import Arrow, Frame, Legend

if TYPE_CHECKING:
    from elvis.scene.figure.figure import Page

#: above the pixels, in order: lines on them, the box, texts
LINES, BOX, TEXTS = 2, 3, 4


class Panel:
    """Axes whose data coordinates are columns and rows of the picture; all else hangs on them."""

    def __init__(self, page: Page, frame: Frame, number: int, *, has_bars: bool) -> None:
        self.page, self.frame, self.unit = page, frame, page.unit
        self.height, self.width = frame.element.shape
        self.corner = np.zeros(2)
        self.bars: list[Bar] = []
        self.axes: Any = page.figure.add_axes((0, 0, 1, 1), label=str(number))
        self.move(0.0, 0.0)
        self.axes.set(xlim=(-0.5, self.width - 0.5), ylim=(self.height - 0.5, -0.5), xticks=[], yticks=[])
        self.axes.patch.set_visible(False)
        self.axes.spines[:].set_visible(False)
        pixels = frame.rgba if frame.scene.is_clear else frame.rgb
        self.axes.imshow(pixels, interpolation="none", aspect="auto", resample=False, zorder=0)
        self._draw_strokes()
        if not page.plain:
            self._draw_around(has_bars)

    def move(self, x: float, y: float) -> None:
        """Put the lower left corner of the picture to a place of the page, in whole pixels."""
        self.corner = np.round([x, y])
        place = (*(self.corner / self.page.size), *(np.array([self.width, self.height]) / self.page.size))
        self.axes.set_position(place)

    def edges(self) -> Floats:
        """(2, 2) lower left and upper right corner of all that there is, in pixels from the corner of the picture."""
        box = self.axes.get_tightbbox(self.page.measure())
        return np.array([[box.x0, box.y0], [box.x1, box.y1]]) - self.corner

    def _text(self, x: float, y: float, text: str, **how: Any) -> Any:
        """A text x and y pixels to the right and above the corner of the picture; XML takes no control characters."""
        usual = {"color": self.page.text_color, "fontsize": self.page.points, "va": "center", "zorder": TEXTS}
        place = (x / self.width, y / self.height)
        return self.axes.text(*place, visible(text), transform=self.axes.transAxes, clip_on=False, **{**usual, **how})

    def _line(self, line: Floats, **how: Any) -> None:
        """A thin polyline (k, 2) in columns and rows, also beyond the picture."""
        usual = {"color": self.page.text_color, "lw": self.page.thin, "zorder": BOX, "clip_on": False}
        self.axes.plot(*line.T, **{**usual, **how})

    def _draw_strokes(self) -> None:
        """Contours, with labels where these are wanted, and borders of elements."""
        from matplotlib.contour import ContourSet

        strokes = () if self.frame.drawing is None else self.frame.drawing.strokes
        typed, texts = typed_values(self.frame), dict[float, str]()
        for legend in self.frame.legends:
            values = (value for value, _ in legend.marks)
            texts |= dict(zip(values, mark_texts(legend, typed) if legend.marks else (), strict=True))
        for stroke in strokes:
            width = self.page.to_points(stroke.width)
            curves = [line for line in stroke.lines if len(line) > 1]
            dots = np.array([line[0] for line in stroke.lines if len(line) == 1]).reshape(-1, 2)
            self.axes.scatter(*dots.T, s=width**2, color=stroke.color, lw=0, alpha=stroke.opacity, zorder=LINES)
            # a value that the field has only where it is greatest has dots alone
            if not curves:
                continue
            look: dict[str, Any] = {"colors": [stroke.color], "linewidths": width, "alpha": stroke.opacity}
            made = ContourSet(self.axes, [stroke.value or 0.0], [curves], linestyles="solid", zorder=LINES, **look)
            made.set_capstyle("round")
            if stroke.labels and stroke.value is not None:
                size, text = 0.8 * self.page.points, {stroke.value: texts[stroke.value]}
                for label in made.clabel(fontsize=size, fmt=text, inline=True, inline_spacing=2):
                    label.set_zorder(TEXTS)
        self.axes.set(xlim=(-0.5, self.width - 0.5), ylim=(self.height - 0.5, -0.5))

    def _draw_around(self, has_bars: bool) -> None:
        scene = self.frame.scene
        legends = [legend for legend in self.frame.legends if legend.palette and legend.constant is None]
        if scene.box:
            for line in box_edges(self.frame):
                self._line(line, clip_on=True)
        if self.frame.has_rulers:
            self._draw_rulers()
        elif not self.frame.view.faces_ground and min(self.width, self.height) >= 16 * self.unit:
            self._draw_arrows()
        if scene.scale_bar:
            self._draw_scale_bar()
        if scene.image:
            draw_image(self, scene.image)
        for caption in scene.texts:
            draw_caption(self, caption)
        for legend in legends if has_bars else []:
            box = self.edges()
            self._add_bar(Bar(self, legend, box, np.array([[0, 0], [self.width, self.height]])))
        for legend in self.frame.legends:
            if legend.arrow:
                self._draw_key(legend.arrow)
        self._draw_notes()
        title = ", ".join(filter(None, (scene.title or "", str(self.frame.instant or ""))))
        if title:
            right, top = self.edges()[1]
            size = 1.2 * self.page.points
            title = broken_lines(visible(title), max(self.width, right), self.page.measure(), size)
            self._text(0, top + 0.6 * self.unit, title, fontsize=size, va="bottom")

    def common_bar(self, legend: Legend, span: Floats) -> None:
        """A bar along all panels, next to their annotations, with the corners (2, 2) of the pictures."""
        every = np.concatenate([panel.edges() + panel.corner for panel in self.page.panels])
        box = np.array([every.min(axis=0), every.max(axis=0)])
        self._add_bar(Bar(self, legend, box - self.corner, span - self.corner))

    def _add_bar(self, bar: Bar) -> None:
        """Draw a bar, unless its scene wants none."""
        if bar.own.position != "none":
            bar.draw()
            self.bars.append(bar)

    def _draw_rulers(self) -> None:
        """Ticks below and to the left of the picture, or along edges of the box."""
        straight = aligned(self.frame.view.camera) is not None
        if straight:
            most = max(3, self.width // (6 * self.unit)), max(3, self.height // (4 * self.unit))
            self._line(np.array([[0, 0], [self.width, 0], [self.width, self.height], [0, self.height], [0, 0]]) - 0.5)
        frame = self.frame
        for ruler in sides(frame.view, most, frame.ordinate) if straight else box_rulers(frame):
            self._draw_ruler(ruler)

    def _draw_ruler(self, ruler: Ruler) -> None:
        self._line(ruler.line)
        align = {"ha": "center" if abs(ruler.away[0]) < 0.5 else "right" if ruler.away[0] < 0 else "left"}
        align["va"] = "center" if abs(ruler.away[1]) < 0.5 else "top" if ruler.away[1] > 0 else "bottom"
        extent = 0.0
        for place, text in zip(ruler.places, ruler.texts, strict=True):
            self._line(np.array([place, place + 0.35 * self.unit * ruler.away]))
            x, y = place + 0.6 * self.unit * ruler.away
            box = self._text(x + 0.5, self.height - 0.5 - y, text, **align)
            size = box.get_window_extent(self.page.measure())
            extent = max(extent, abs(ruler.away) @ [size.width, size.height])
        x, y = ruler.line.mean(axis=0) + (1.1 * self.unit + extent) * ruler.away
        self._text(x + 0.5, self.height - 0.5 - y, ruler.name, style="italic", **align)

    def _draw_arrows(self) -> None:
        """Arrows along x, y and z in the corner where least is seen; those pointing away from the viewer are first."""
        side = 7 * self.unit
        column, row, is_free = emptiest_corner(self.frame, side)
        middle = np.array([column + side / 2, self.height - row - side / 2])
        size = np.array([self.width, self.height])
        if not is_free:
            self._draw_disc(middle, side / 2)
        right, up, forward = self.frame.view.camera.basis()
        tips = 2.4 * np.column_stack([right, up])
        letters = letters_of_axes(tips)
        for axis in np.argsort(-forward):
            along = self.unit * tips[axis]
            if np.linalg.norm(along) < 0.3 * self.unit:
                continue
            color = tuple(part / 255 for part in AXES[axis])
            # sizes of the head are multiples of the unit, whatever the size of texts
            how = {"arrowstyle": "-|>,head_length=0.7,head_width=0.24", "shrinkA": 0, "shrinkB": 0}
            how |= {"mutation_scale": self.page.to_points(self.unit), "color": color, "lw": 1.5 * self.page.thin}
            places = {"xycoords": "axes fraction", "textcoords": "axes fraction"}
            start, tip = tuple(middle / size), tuple((middle + along) / size)
            self.axes.annotate("", tip, start, arrowprops=how, zorder=BOX, **places)
            x, y = middle + self.unit * letters[axis]
            self._text(x, y, "xyz"[axis], color=color, ha="center")

    def _draw_disc(self, middle: Floats, radius: float) -> None:
        """A pale disc, so that arrows stay legible on the data."""
        from matplotlib.patches import Circle

        place = (middle[0] - 0.5, self.height - 0.5 - middle[1])
        self.axes.add_patch(Circle(place, radius, color=self.frame.scene.backdrop, alpha=110 / 255, lw=0, zorder=BOX))

    def _draw_scale_bar(self) -> None:
        """A length below the right end of the picture."""
        view = self.frame.view
        if view.perspective:
            raise SceneError("scale_bar: expected a parallel view, found one in perspective, where lengths differ")
        length, text = scale_bar(view, 0.3 * self.width)
        y, right = self.edges()[0, 1] - 0.9 * self.unit, self.width
        ends = np.array([[right - length, y], [right, y]])
        line = np.array([[x - 0.5, self.height - 0.5 - y] for x, y in ends])
        self._line(line, lw=3 * self.page.thin, solid_capstyle="butt")
        self._text(right - 0.5 * length, y - 0.5 * self.unit, text, ha="center", va="top")

    def _draw_key(self, arrow: Arrow) -> None:
        """A glyph of a round magnitude, with its text, below the picture."""
        right, above = arrow.outline.max(axis=0)
        y = self.edges()[0, 1] - 0.5 * self.unit - max(0.8 * self.unit, above)
        line = np.array([-0.5, self.height - 0.5 - y]) + arrow.outline * [1.0, -1.0]
        self.axes.fill(*line.T, color=self.page.text_color, lw=0, zorder=BOX, clip_on=False)
        self.axes.set(xlim=(-0.5, self.width - 0.5), ylim=(self.height - 0.5, -0.5))
        size = 0.9 * self.page.points
        text = broken_lines(literal(visible(arrow.text)), self.width, self.page.measure(), size, 1)
        self._text(right + self.unit, y, text, fontsize=size)

    def _draw_notes(self) -> None:
        """Notes below the picture with information that no legend shows."""
        size = 0.9 * self.page.points
        room = max(self.width, 20 * self.unit)
        labelled = any(stroke.labels for stroke in (self.frame.drawing.strokes if self.frame.drawing else ()))
        notes = [literal(visible(text)) for text in sentences(self.frame, contours=not labelled)]
        lines = [broken_lines(text, room, self.page.measure(), size, MAX_NOTE_LINES) for text in notes]
        if lines:
            y = self.edges()[0, 1] - 0.6 * self.unit
            self._text(0, y, "\n".join(lines), va="top", fontsize=size)
