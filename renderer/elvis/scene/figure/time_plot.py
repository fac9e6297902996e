"""Plots of numbers over time or length, and of histograms, by matplotlib: a panel a quantity, a curve a place."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.core.base.errors import ElvisError
from elvis.core.base.terminal import visible
from elvis.core.files.output import Outputs
from elvis.scene.figure.figure import METADATA, settings
from elvis.scene.model.whole import Scene

#: inches: width of a plot, and height of each of its panels
WIDTH, HEIGHT = 6.4, 2.6
#: places that the legend names, and points of a curve that are marked
_NAMED, _MARKED = 10, 60


@dataclass(frozen=True, eq=False)
class Plot:
    """Values of quantities at points over time.

    times   (n,)
    places  the name of each curve, "" for one that needs none
    values  (places, n) by quantity, NaN if missing
    over    meaning of ``times`` if they are not times
    is_reversed  whether the y axis is reversed
    is_logarithmic  whether both axes are logarithmic
    overlays     points (n, 2) to plot in addition, by label
    """

    times: Floats
    places: Sequence[str]
    values: Mapping[str, Floats]
    over: str = "time"
    is_reversed: bool = False
    overlays: Mapping[str, Floats] = field(default_factory=dict)
    is_logarithmic: bool = False

    def save(self, path: Path) -> None:
        """Write PNG, SVG or PDF, by the suffix; equal values give equal bytes.

        Raises ElvisError where the suffix is another, matplotlib is missing, or the file can't be written.
        """
        _save(path, self._figure)

    def _figure(self) -> Any:
        """The panels, one below the other."""
        from matplotlib import colormaps

        count = len(self.places)
        colors = colormaps["viridis"](np.linspace(0.0, 0.85, count))
        figure, panels = _panels(len(self.values), is_shared=True)
        marker = "." if len(self.times) <= _MARKED else None
        for panel, (name, curves) in zip(panels, self.values.items(), strict=True):
            for place, curve, color in zip(self.places, curves, colors, strict=True):
                panel.plot(self.times, curve, color=color, label=_plain(place), marker=marker, linewidth=1.2)
                alone = _alone(curve)
                panel.plot(self.times[alone], curve[alone], ".", color=color)
            for number, (own, points) in enumerate(self.overlays.items()):
                panel.plot(*points.T, "os^Dv"[number % 5], fillstyle="none", color="black", label=_plain(own))
            if self.is_reversed:
                panel.invert_yaxis()
            if self.is_logarithmic:
                panel.set_xscale("log")
                panel.set_yscale("log")
            panel.set_ylabel(_plain(name))
            panel.grid(alpha=0.3)
        panels[-1].set_xlabel(self.over)
        if 1 < count <= _NAMED or self.overlays:
            handles, labels = panels[0].get_legend_handles_labels()
            figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize="small")
        elif count == 1 and self.places[0]:
            panels[0].set_title(_plain(self.places[0]), fontsize="medium")
        return figure


@dataclass(frozen=True, eq=False)
class Profiles:
    """Profiles above stations, each drawn at its station as in a figure of a boundary layer.

    stations  (k,) abscissas of the stations
    heights   of each station (n,)
    values    of each station (n,), by quantity
    scale     abscissas per unit of a value; None to fill the gaps between stations
    """

    stations: Floats
    heights: Sequence[Floats]
    values: Mapping[str, Sequence[Floats]]
    scale: float | None = None

    def save(self, path: Path) -> None:
        """As `Plot.save`."""
        _save(path, self._figure)

    def _figure(self) -> Any:
        """A panel for each quantity: a line at each station, and the profile as the distance from it."""
        figure, panels = _panels(len(self.values), is_shared=True)
        for panel, (name, profiles) in zip(panels, self.values.items(), strict=True):
            scale = self._scale_of(profiles) if self.scale is None else self.scale
            for station, heights, own in zip(self.stations, self.heights, profiles, strict=True):
                panel.plot([station, station], [0, heights.max()], color="#bbbbbb", linewidth=0.8)
                panel.plot(station + scale * own, heights, color="#3b528b", linewidth=1.2)
            panel.set_ylabel(f"height: x + {scale:.3g} {_plain(name)}")
            panel.grid(alpha=0.3)
        panels[-1].set_xlabel("x")
        return figure

    def _scale_of(self, profiles: Sequence[Floats]) -> float:
        """The scale at which the largest value takes nine tenths of the smallest gap between stations."""
        largest = max((float(np.nanmax(np.abs(own), initial=0.0)) for own in profiles), default=0.0)
        gaps = np.diff(np.unique(self.stations))
        gap = float(gaps.min()) if len(gaps) else 1.0
        return 0.9 * gap / largest if largest > 0 else 1.0


def _alone(curve: Floats) -> Bools:
    """Flags (n,) of the values (n,), NaN if missing, that have no neighbour: a line plot does not show them."""
    known = np.pad(np.isfinite(curve), 1)
    return np.asarray(known[1:-1] & ~known[:-2] & ~known[2:])


@dataclass(frozen=True, eq=False)
class Bars:
    """How much of the data has which values of quantities.

    bins  ends (n + 1,) of bins and shares (n,) in them, by quantity
    """

    bins: Mapping[str, tuple[Floats, Floats]]

    def save(self, path: Path) -> None:
        """As `Plot.save`."""
        _save(path, self._figure)

    def _figure(self) -> Any:
        """A panel for each quantity, whose shares go over four decades."""
        figure, panels = _panels(len(self.bins), is_shared=False)
        for panel, (name, (ends, shares)) in zip(panels, self.bins.items(), strict=True):
            style = {"color": "#3b528b", "edgecolor": "white", "linewidth": 0.3}
            panel.bar(ends[:-1], shares, np.diff(ends), align="edge", **style)
            panel.set_xlim(ends[0], ends[-1])
            panel.set_yscale("log")
            panel.set_ylim(shares.max() * 1e-4, shares.max() * 2)
            panel.set_xlabel(_plain(name))
            panel.set_ylabel("share of the domain")
            panel.grid(axis="y", alpha=0.3)
            panel.set_axisbelow(True)
        return figure


def _save(path: Path, build: Callable[[], Any]) -> None:
    """Write a figure as PNG, SVG or PDF; ElvisError where that can't be."""
    suffix = check_plot(path)
    with settings(Scene()), Outputs() as outputs, outputs.file(path) as new:
        build().savefig(new, format=suffix[1:], dpi=150, metadata=METADATA[suffix])


def _panels(count: int, is_shared: bool) -> tuple[Any, Any]:
    """A figure and its panels, stacked, which may share their x axis."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 0.4 + HEIGHT * count), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(count, 1, sharex=is_shared, squeeze=False)[:, 0]


def check_plot(path: Path) -> str:
    """The suffix; ElvisError where it is none of a plot."""
    suffix = path.suffix.lower()
    if suffix not in METADATA:
        raise ElvisError(
            f"{path}: expected a name that ends in {', '.join(METADATA)} for a plot, found {suffix or 'none'}"
        )
    return suffix


def _plain(text: str) -> str:
    """A text without control characters, in which no dollar begins mathematics."""
    return visible(text).replace("$", r"\$")
