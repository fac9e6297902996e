"""Plots of a report: error against refinement, memory and time, as SVG."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from io import StringIO
from typing import Any

from elvis.core.base.terminal import visible
from elvis.reference.extras import comparison_module
from elvis.reference.line_study import LineStudy
from elvis.reference.report.words import size
from elvis.reference.study import Rival, Study

_STYLE = {
    "svg.hashsalt": "elvis",
    "svg.fonttype": "path",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.35,
    "legend.frameon": False,
}
#: the curves: label, number of a rival, colour, marker
_CURVES: tuple[tuple[str, Callable[[Rival], float | None], str, str], ...] = (
    ("maximum error, % of the range", lambda own: _part(own, "value_max"), "#bd0026", "o"),
    ("mean error, % of the range", lambda own: _part(own, "value_mean"), "#fd8d3c", "s"),
    ("pixels off by a colour step, %", lambda own: own.errors.off if own.errors else None, "#253494", "^"),
    ("contours off by, pixels", lambda own: own.errors.contour_max if own.errors else None, "#238b45", "D"),
)


def _part(rival: Rival, name: str) -> float | None:
    return 100 * float(getattr(rival.errors, name)) if rival.errors else None


def against_refinement(study: Study) -> str:
    """Errors of linear pictures by the number of cuts."""
    drawn = [rival for rival in study.rivals if rival.level is not None and rival.errors]

    def draw(axes: Any) -> None:
        _curves(axes, drawn, [float(rival.level or 0) for rival in drawn])
        axes.set_xticks([rival.level for rival in drawn])
        axes.set_xlabel("refinements of every element")

    return plot(draw)


def against_memory(study: Study) -> str:
    """Errors by the bytes of the linear mesh; a line where the exact picture's coefficients are."""
    drawn = [rival for rival in study.rivals if rival.errors and rival.counts.get("bytes")]

    def draw(axes: Any) -> None:
        _curves(axes, drawn, [rival.counts["bytes"] / 1e6 for rival in drawn])
        _exact(axes, study.stored / 1e6, f"exact: {size(study.stored)}")
        axes.set_xlabel("memory, MB")

    return plot(draw)


def of_distances(study: Study) -> str:
    """Histograms of the distances of exact points from linear surfaces, by refinement."""

    def draw(axes: Any) -> None:
        for rival in study.rivals:
            for name, own in rival.deviations.items():
                if own is not None and own.away.maximum > 0:
                    axes.stairs(own.shares, own.edges, label=f"{name}, {rival.name}")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("distance, units of the data")
        axes.set_ylabel("share of the exact points")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), fontsize=8)

    return plot(draw)


def of_lines(study: LineStudy) -> str:
    """Distances of VTK's ends of lines by refinement; levels where ours are and where those in its own cells are."""
    refined = [own for own in study.others if own.level is not None and own.maximum]

    def draw(axes: Any) -> None:
        places = [own.level for own in refined]
        for word, color, marker in (("maximum", "#bd0026", "o"), ("median", "#fd8d3c", "s")):
            label = f"VTK in linear elements, {word}"
            axes.plot(places, [getattr(own, word) for own in refined], marker=marker, color=color, label=label)
        for own in (study.ours, *(other for other in study.others if other.level is None)):
            if own.maximum:
                is_ours = own is study.ours
                look = {"color": "black" if is_ours else "#253494", "linestyle": "--" if is_ours else ":"}
                axes.axhline(own.maximum, label=f"{'ours' if is_ours else own.name}, greatest", **look)
        axes.set_yscale("log")
        axes.set_xticks(places)
        axes.set_xlabel("refinements of every element")
        axes.set_ylabel("distance of ends, parts of the box")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, fontsize=8)

    return plot(draw)


def against_time(study: Study) -> str:
    """Errors by the seconds for mesh and picture; a line where the exact picture is."""
    drawn = [rival for rival in study.rivals if rival.errors and rival.seconds]

    def draw(axes: Any) -> None:
        _curves(axes, drawn, [sum(rival.seconds.values()) for rival in drawn])
        seconds = study.seconds.get("exact", 0.0)
        _exact(axes, seconds, f"exact: {seconds:.2g} s")
        axes.set_xlabel("time, seconds")

    return plot(draw)


def _curves(axes: Any, rivals: Sequence[Rival], places: Sequence[float]) -> None:
    """All curves that have numbers, on a logarithmic scale of errors; hollow marks are pictures of no refinement."""
    order = sorted(range(len(rivals)), key=lambda i: rivals[i].level or 0)
    for word, number, color, marker in _CURVES:
        for refined in (True, False):
            found = [(places[i], number(rivals[i])) for i in order if (rivals[i].level is not None) == refined]
            points = [(x, y) for x, y in found if y is not None and 0 < y < float("inf")]
            look = {"label": word, "linewidth": 1.4} if refined else {"linestyle": "none", "markerfacecolor": "none"}
            if points:
                axes.plot(*zip(*points, strict=True), marker=marker, color=color, markersize=5, **look)
    _write_names(axes, [(places[i], rivals[i]) for i in order if rivals[i].level is None])
    axes.set_yscale("log")
    if axes.lines:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, fontsize=8)


def _write_names(axes: Any, others: Sequence[tuple[float, Rival]]) -> None:
    """Names above the marks that belong to no curve."""
    for place, rival in others:
        axes.annotate(
            rival.name, (place, 1.0), xycoords=("data", "axes fraction"), ha="center", va="bottom", fontsize=8
        )


def _exact(axes: Any, place: float, word: str) -> None:
    """The exact picture has no error: a line, on a logarithmic scale."""
    tickers = comparison_module("matplotlib.ticker")
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(tickers.LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(tickers.NullLocator())
    if place > 0:
        axes.axvline(place, color="black", linestyle="--", linewidth=1)
        axes.annotate(word, (place, 0.0), xycoords=("data", "axes fraction"), xytext=(4, 3), va="bottom",
                      textcoords="offset points", rotation=90, fontsize=8)  # fmt: skip


def plot(draw: Callable[[Any], None]) -> str:
    """The SVG text of one plot; the same bytes for the same numbers."""
    matplotlib, figures = comparison_module("matplotlib"), comparison_module("matplotlib.figure")
    with matplotlib.rc_context(_STYLE):
        figure = figures.Figure(figsize=(5.2, 3.6), layout="constrained")
        draw(figure.add_subplot())
        for text in figure.findobj(comparison_module("matplotlib.text").Text):
            text.set_text(visible(text.get_text()))
        content = StringIO()
        figure.savefig(content, format="svg", metadata={"Date": None, "Creator": None})
    return content.getvalue()
