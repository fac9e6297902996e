"""Curves of ``elvis probe``: requests along them, and the resulting tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from elvis.core.base.errors import ElvisError
from elvis.core.data.arguments import TextType, Triple, expressions, numbers, triples
from elvis.renderer.commands.probe.look import Look

if TYPE_CHECKING:
    from elvis.core.base.arrays import Floats
    from elvis.core.data.dataset import Dataset
    from elvis.core.files.columns import Columns

#: what finds the table at points (n, 3) of a dataset
AtPoints = Callable[["Dataset", "Floats"], "Columns"]


@dataclass(frozen=True)
class ProbeCurves:
    """Curves along which values are requested.

    names   of curves; empty if points are given in another way
    chord   points at which x/c is 0 and 1 on walls
    speed   of boundary layers, if these are requested instead of values
    look    appearance of the plot
    """

    names: tuple[str, ...]
    chord: tuple[Triple, Triple] | None
    speed: str | None
    look: Look

    @property
    def are_on_walls(self) -> bool:
        """Whether the curves are on boundaries; ElvisError where some are and some are not."""
        several = {_is_on_wall(name) for name in self.names}
        if len(several) > 1:
            raise ElvisError(
                "--along: expected only curves on boundaries, or none of them, found both; use two commands"
            )
        return several == {True}

    def check(self, is_plotted: bool) -> None:
        """UsageError for options that have nothing to act on."""
        context = click.get_current_context()
        if self.look != Look() and not (is_plotted and self.names):
            raise click.UsageError("expected --x, --reverse, --overlay and --profiles with --plot and --along", context)
        if self.look.profiles is not None and (self.look != Look(profiles=self.look.profiles) or self._has_others):
            raise click.UsageError("expected --profiles with --along normal:… only, and no --x, --reverse, --overlay")
        if self.chord is not None and not self.are_on_walls:
            raise click.UsageError("expected --chord with --along boundary:NAME or section:NAME:plane:P:N", context)
        if self.speed is not None and (not self.names or self.are_on_walls):
            raise click.UsageError("expected --layers with --along normal:BOUNDARY:POINT:LENGTH", context)

    @property
    def _has_others(self) -> bool:
        """Whether some curves are not normals, or there are no values along them."""
        return self.speed is not None or not all("normal:" in name for name in self.names)

    def table(self, dataset: Dataset, texts: Sequence[str] | None, count: int, at_points: AtPoints) -> Columns:
        """The table along all curves, with a column of their names if there are several.

        texts      quantities, None for all fields
        count      points along each curve
        at_points  evaluates in elements of a dataset; on boundaries values come from the element behind
        """
        names = [own for name in self.names for own in _stations(name)]
        if self.speed is not None:
            return _layers(dataset, names, self.speed)
        if not self.are_on_walls:
            tables = [_along(*_owner(dataset, name), count, at_points) for name in names]
            return _joined(names, tables)
        from elvis.core.wall_curves import on_walls

        tables = []
        for name in names:
            own, curve = _owner(dataset, name)
            tables.append(on_walls(own, curve, expressions(own, texts), count, self.chord))
        return _joined(names, tables)


def _is_on_wall(name: str) -> bool:
    """Whether a name, perhaps with the name of other data in front, denotes a curve on a boundary."""
    from elvis.core.integrals.curves import KINDS
    from elvis.core.wall_curves import is_wall_curve

    first, _, rest = name.partition(":")
    # a boundary may be called "boundary", as in normal:boundary:0,0,0:1
    return is_wall_curve(name) or (first not in KINDS and is_wall_curve(rest))


def curve_options(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameter ``curves`` combines the options for curves."""

    @click.option(
        "--along",
        metavar="CURVE",
        multiple=True,
        help="Points at even steps along a curve (see elvis help geometry); normal:BOUNDARY:FILE:LENGTH gives a curve "
        "for each point of a table.  A name of --other in front, as in ref:boundary:wing, chooses those data.  "
        "Repeatable.",
    )
    @click.option(
        "--chord",
        metavar="P:Q",
        type=TextType(partial(triples, count=2)),
        help="Points at which x/c is 0 and 1, for --along boundary: and section:.  [default: the ends of the curve, or "
        "its two points that are farthest apart]",
    )
    @click.option(
        "--layers",
        "speed",
        metavar="EXPR",
        help="With --along normal:…, print a table of boundary layers instead of values: foot point, speed EXPR at the "
        "end of the curve, delta99, displacement and momentum thickness, and shape factor.",
    )
    @click.option(
        "--profiles",
        metavar="auto|SCALE",
        type=TextType(_scale),
        help="Plot the values along each normal as a profile above its station: the height over x + SCALE value.",
    )
    @click.option("--x", "abscissa", metavar="COLUMN", help="Column of --along on the x axis.  [default: length]")
    @click.option(
        "--reverse",
        is_flag=False,
        flag_value="y",
        type=click.Choice(["y"]),
        metavar="[y]",
        help="Reverse the y axis of the plot, as is usual for Cp; the y may be left out.",
    )
    @click.option(
        "--overlay",
        metavar="FILE.csv[:X,Y]",
        multiple=True,
        help="Measured points to add to the plot: a table and two of its columns, by name or number.  "
        "[default: 1,2]  Repeatable.",
    )
    @wraps(command)
    def parsed(
        along: tuple[str, ...],
        chord: tuple[Triple, Triple] | None,
        speed: str | None,
        profiles: float | None,
        abscissa: str | None,
        reverse: str | None,
        overlay: tuple[str, ...],
        **rest: Any,
    ) -> None:
        names = tuple(dict.fromkeys(along))
        command(curves=ProbeCurves(names, chord, speed, Look(abscissa, reverse is not None, overlay, profiles)), **rest)

    return parsed


def _scale(text: str) -> float:
    """A positive number, or 0 for auto."""
    if text == "auto":
        return 0.0
    (found,) = numbers(text, 1)
    if found <= 0:
        raise click.BadParameter(f"expected auto or a positive number, found {text!r}")
    return found


def _owner(dataset: Dataset, name: str) -> tuple[Dataset, str]:
    """The dataset that a curve is in, another one where its name begins the curve's, and the curve in it."""
    other, _, rest = name.partition(":")
    return (dataset.others[other], rest) if other in dataset.others else (dataset, name)


def _layers(dataset: Dataset, names: Sequence[str], speed: str) -> Columns:
    """The table of boundary layers, with warnings about missing values."""
    from elvis.core.base.terminal import warn
    from elvis.core.integrals.boundary_layers import boundary_layers

    columns, remarks = boundary_layers(dataset, names, speed)
    for remark in dict.fromkeys(remarks):
        warn(remark)
    return columns


def _stations(name: str) -> list[str]:
    """The curves of a name: one, or one for each point of the table that stands for the point of a normal."""
    from elvis.core.numbers.queries import points_in_table

    kind, _, rest = name.partition(":")
    boundary, _, rest = rest.rpartition(":")[0].rpartition(":") if kind == "normal" else ("", "", "")
    if not rest or not Path(rest).is_file():
        return [name]
    length = name.rpartition(":")[2]
    points = points_in_table(rest).tolist()
    return [f"normal:{boundary}:{','.join(map(repr, point))}:{length}" for point in points]


def _along(dataset: Dataset, name: str, count: int, at_points: AtPoints) -> Columns:
    """The table at even steps of a curve in the world, with a column of lengths."""
    from elvis.core.integrals.curves import KINDS, Curve

    curve = Curve.parse(dataset, name)
    if curve is None:
        raise ElvisError(f"--along: expected a curve, one of {', '.join(KINDS)}, such as line:0,0:1,0, found {name!r}")
    places, lengths = curve.evenly(count)
    found = at_points(dataset, places)
    return {"length": lengths[found["point"]], **found}


def _joined(names: Sequence[str], tables: Sequence[Columns]) -> Columns:
    """Tables of several curves as one: points and curves are numbered through, names are a further column."""
    import numpy as np

    if len(tables) == 1:
        return tables[0]
    parts, points, curves = [], 0, 0
    for name, table in zip(names, tables, strict=True):
        count = len(table["point"])
        numbered = {"along": np.repeat(name, count), "curve": np.zeros(count, np.int64), **table}
        numbered["point"] = numbered["point"] + points
        numbered["curve"] = numbered["curve"] + curves
        points, curves = int(numbered["point"].max(initial=-1)) + 1, int(numbered["curve"].max(initial=-1)) + 1
        parts.append(numbered)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
