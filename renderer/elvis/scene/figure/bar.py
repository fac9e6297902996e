"""The colour bar of a panel, as artists of matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.terminal import visible
from elvis.scene.figure.broken_lines import bar_title, broken_lines
from elvis.scene.figure.picture import (
    MAX_BAR_NAME,
    labels,
    value_labels,
)
from elvis.scene.record.frame import Legend
from elvis.scene.record.palette import Palette, linear_part, ticks

if TYPE_CHECKING:
    from elvis.scene.figure.panel import Panel
    from elvis.scene.model.style import ColorBar

#: bands of a bar up to which all their ends are marked
FEW_BANDS = 12


class Bar:
    """A colour bar next to a box (2, 2) of pixels, along the span (2, 2) of the pictures, from a panel's corner."""

    def __init__(self, panel: Panel, legend: Legend, box: Floats, span: Floats) -> None:
        from elvis.scene.model.style import ColorBar

        assert legend.palette is not None
        self.panel, self.legend, self.palette, self.box, self.span = panel, legend, legend.palette, box, span
        self.own: ColorBar = legend.bar or ColorBar()

    def draw(self) -> None:
        """The bar with ticks, title and the contours across it."""
        panel, page, upright = self.panel, self.panel.page, self.is_upright
        norm, cmap = value_norm(self.palette, self.own)
        from matplotlib.cm import ScalarMappable

        axes = panel.axes.inset_axes(self.place() / np.tile([panel.width, panel.height], 2))
        marked = self._ticks(max(3, int(self._length() // ((4 if upright else 6) * panel.unit))))
        bar: Any = page.figure.colorbar(
            ScalarMappable(norm, cmap),
            cax=axes,
            orientation="vertical" if upright else "horizontal",
            ticklocation=self.own.position,
            spacing="proportional",
        )
        if marked is not None:
            bar.set_ticks(marked[0], labels=marked[1])
        bar.minorticks_off()
        bar.solids.set(edgecolor="face", rasterized=False)
        bar.outline.set(color=page.text_color, linewidth=page.thin)
        axes.tick_params(
            colors=page.text_color, labelsize=page.points, width=page.thin, length=page.to_points(0.35 * panel.unit)
        )
        rule = axes.axhline if upright else axes.axvline
        for value, color in self.legend.marks:
            if self.palette.low <= value <= self.palette.high:
                rule(value, color=color, lw=page.thin)
        self._title(axes, upright)

    def _length(self) -> float:
        return float((self.span[1] - self.span[0])[1 if self.is_upright else 0])

    @property
    def is_upright(self) -> bool:
        """Whether values go upwards, else to the right."""
        return self.own.position in ("right", "left")

    def place(self) -> Floats:
        """(4,) left, lower edge, width, height in pixels from the panel's corner."""
        unit, (low, high), (left, right) = self.panel.unit, self.box, self.span
        thick, gap = 1.2 * unit, 1.2 * unit
        match self.own.position:
            case "right":
                return np.array([high[0] + gap, left[1], thick, right[1] - left[1]])
            case "left":
                return np.array([low[0] - gap - thick, left[1], thick, right[1] - left[1]])
            case "top":
                return np.array([left[0], high[1] + gap, right[0] - left[0], thick])
            case _:
                return np.array([left[0], low[1] - gap - thick, right[0] - left[0], thick])

    def _ticks(self, most: int) -> tuple[list[float], list[str]] | None:
        """Values to be marked, n at most, and their texts; None where matplotlib finds better ones."""
        if self.own.ticks:
            return list(self.own.ticks), value_labels(self.own.ticks, set(self.own.ticks))
        edges = self.palette.edges
        if self.own.bands is not None and self.own.bands <= FEW_BANDS and edges is not None:
            ends = [self.palette.low, *edges.tolist(), self.palette.high]
            every = -(-len(ends) // most)
            return ends[::every], value_labels(ends)[::every]
        if self.own.scale != "linear":
            return None
        values = ticks(self.palette.low, self.palette.high, most, self.legend.is_whole)
        return values, labels(values)

    def _title(self, axes: Any, upright: bool) -> None:
        page, width = self.panel.page, float((self.span[1] - self.span[0])[0])
        room = max(MAX_BAR_NAME * self.panel.unit, width / 2 if upright else width)
        title = broken_lines(visible(bar_title(self.legend)), room, page.measure(), page.points)
        how = {"color": page.text_color, "fontsize": page.points}
        if upright:
            axes.set_title(title, loc="left", pad=page.to_points(0.5 * self.panel.unit), **how)
        else:
            axes.set_xlabel(title, **how)


def value_norm(palette: Palette, bar: ColorBar) -> tuple[Any, Any]:
    """The norm and colour map of matplotlib that give values the colours that a palette gives them."""
    from matplotlib import colors

    cmap = colors.ListedColormap(palette.table)
    ends = palette.low, palette.high
    if bar.bands is not None and palette.edges is not None:
        return colors.BoundaryNorm([ends[0], *palette.edges.tolist(), ends[1]], len(palette.table)), cmap
    if bar.scale == "log":
        return colors.LogNorm(*ends), cmap
    if bar.scale == "symlog":
        return colors.SymLogNorm(linear_part(bar, *ends), vmin=ends[0], vmax=ends[1], base=10), cmap
    return colors.Normalize(*ends), cmap
