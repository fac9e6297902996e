"""Plots of numbers over time or length, by matplotlib: a panel a quantity, a curve a place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from elvis.core.arrays import Floats
from elvis.core.errors import ElvisError
from elvis.core.files.output import Outputs
from elvis.scene.figure import DATES, settings
from elvis.scene.whole import Scene

#: inches: width of a plot, and height of each of its panels
WIDTH, HEIGHT = 6.4, 2.6
#: places that the legend names, and points of a curve that are marked
_NAMED, _MARKED = 10, 60


@dataclass(frozen=True, eq=False)
class Plot:
    """Values of quantities at places over time.

    times   (n,) ascending
    places  the name of each curve, "" for one that needs none
    values  (places, n) by quantity, NaN where there is none
    over    what ``times`` are, where they are none
    """

    times: Floats
    places: Sequence[str]
    values: Mapping[str, Floats]
    over: str = "time"

    def save(self, path: Path) -> None:
        """Write PNG, SVG or PDF, by the suffix; equal values give equal bytes.

        Raises ElvisError where the suffix is another, matplotlib is missing, or the file can't be written.
        """
        suffix = check_plot(path)
        with settings(Scene()), Outputs() as outputs, outputs.file(path) as new:
            figure = self._figure()
            figure.savefig(new, format=suffix[1:], dpi=150, metadata=DATES[suffix])

    def _figure(self) -> Any:
        """The panels, one below the other."""
        from matplotlib import colormaps
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        count = len(self.places)
        colors = colormaps["viridis"](np.linspace(0.0, 0.85, count))
        figure = Figure(figsize=(WIDTH, 0.4 + HEIGHT * len(self.values)), layout="constrained")
        FigureCanvasAgg(figure)
        panels = figure.subplots(len(self.values), 1, sharex=True, squeeze=False)[:, 0]
        marker = "." if len(self.times) <= _MARKED else None
        for panel, (name, curves) in zip(panels, self.values.items(), strict=True):
            for place, curve, color in zip(self.places, curves, colors, strict=True):
                panel.plot(self.times, curve, color=color, label=_plain(place), marker=marker, linewidth=1.2)
            panel.set_ylabel(_plain(name))
            panel.grid(alpha=0.3)
        panels[-1].set_xlabel(self.over)
        if 1 < count <= _NAMED:
            handles, labels = panels[0].get_legend_handles_labels()
            figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize="small")
        elif count == 1 and self.places[0]:
            panels[0].set_title(_plain(self.places[0]), fontsize="medium")
        return figure


def check_plot(path: Path) -> str:
    """The suffix; ElvisError where it is none of a plot."""
    suffix = path.suffix.lower()
    if suffix not in DATES:
        raise ElvisError(
            f"{path}: expected a name that ends in {', '.join(DATES)} for a plot, found {suffix or 'none'}"
        )
    return suffix


def _plain(text: str) -> str:
    """A text in which no dollar begins mathematics."""
    return text.replace("$", r"\$")
