"""``elvis probe``: exact values at points."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from elvis.core.arguments import (
    TextType,
    Triple,
    field_option,
    json_option,
    overwrite_option,
    times_option,
    triples,
)
from elvis.core.errors import ElvisError
from elvis.core.ranks import ALONE, Ranks, is_idle
from elvis.plugins.running import shared
from elvis.renderer.commands.asked import Asked
from elvis.renderer.commands.look import Look
from elvis.renderer.commands.probe_curves import ProbeCurves, curve_options
from elvis.renderer.commands.sources import Data, data_options, or_alone

if TYPE_CHECKING:
    from elvis.core.arrays import Floats
    from elvis.core.files.columns import Columns
    from elvis.core.files.nrrd import Grid
    from elvis.core.quantities import Expression
    from elvis.renderer.commands.sources import Source

_COLUMNS = ("point", "x", "y", "z", "element", "status")

#: points along a line, and along each side of a plane, where -n says nothing
_ALONG = 101
#: points of a grid along one axis, and of those that are asked together
_MOST, _TOGETHER = 65536, 1 << 18


def _counts(value: str) -> tuple[int, ...]:
    """``200`` as (200,), ``200x100`` as (200, 100)."""
    try:
        counts = tuple(int(part) for part in value.lower().split("x"))
    except ValueError:
        counts = ()
    if len(counts) not in (1, 2) or min(counts) < 2:
        raise click.BadParameter(
            f"expected a number such as 200, or 200x100 for a plane, each at least 2, found {value!r}"
        )
    return counts


def _grid_counts(value: str) -> tuple[int, ...]:
    """``64,64,32``: points along x, y and z."""
    parts = value.split(",")
    if len(parts) != 3 or not all(part.strip().isdecimal() and 1 <= int(part) <= _MOST for part in parts):
        raise click.BadParameter(f"expected three numbers from 1 to {_MOST} such as 64,64,32, found {value!r}")
    return tuple(map(int, parts))


_PAIR = TextType(partial(triples, count=2))
EPILOG = """\b
Examples:
  elvis probe wing.xml wing.fld --line 0,0,0:1,0,0 -n 200 -o line.csv
  elvis probe wing.xml wing.fld --plane 0,0,0:1,0,0:0,1,0 -n 100x50 --fields u,v -o plane.npz
  elvis probe wing.xml wing.fld --point 0.5,0,0.1 --field p
  elvis probe wing.xml wing.fld --points sensors.csv --all
  elvis probe wing.xml wing.fld --grid 128,128,64 --box 0,0,0:1,1,0.5 --fields p -o pressure.nrrd
  elvis probe wing.xml wing.fld --along normal:wing:0.5,0,0.2:0.05 --fields u --plot layer.png
  elvis probe wing.xml wing.fld --along section:wing:plane:0,0.5,0:0,1,0 --field p --plot cp.pdf --x x/c --reverse
  elvis probe wing.xml wing.fld --along line:0,0,0:1,0,0 --along line:0,1,0:1,1,0 --field p --plot lines.pdf
  elvis probe wing.xml wing.fld --along normal:wing:stations.csv:0.05 --layers u --plot layers.pdf
  elvis probe wing.xml wing.fld --points taps.csv --snap wing --field p
  elvis probe wing.xml wing.fld --line 0,0,0:1,0,0 --clip sphere:0.5,0,0:0.2 -o outside.csv
  elvis probe wing.xml wing_*.chk --point 0.5,0,0.1 --times all -o signal.csv --plot signal.svg
  elvis probe wing.xml wing.fld --line 0,0,0:1,0,0 --field "sqrt(u^2+v^2)" --field "d(v,x)-d(u,y)"
"""


@click.command("probe", epilog=EPILOG, short_help="Evaluate fields exactly at points, along a line or over a plane.")
@click.option("--points", metavar="FILE", help="Points from a table, - for standard input: columns x, y, z.")
@click.option(
    "--point",
    "single",
    metavar="P",
    multiple=True,
    type=TextType(partial(triples, count=1)),
    help="A point, as 0,0,0.  Repeatable.",
)
@click.option("--line", metavar="P:Q", type=_PAIR, help="Points from P to Q, as 0,0,0:1,0,0.")
@curve_options
@click.option(
    "--plane",
    metavar="P:U:V",
    type=TextType(partial(triples, count=3)),
    help="Points P + s U + t V, s and t from 0 to 1.",
)
@click.option(
    "--grid", metavar="NX,NY,NZ", type=TextType(_grid_counts), help="Points of a regular grid, for a NRRD file."
)
@click.option("--box", metavar="LOW:HIGH", type=_PAIR, help="Ends of the grid.  [default: those of the data]")
@click.option(
    "-n", "counts", metavar="N[xM]", type=TextType(_counts), help="Points along the line or the plane.  [default: 101]"
)
@field_option
@click.option(
    "--clip",
    metavar="SURFACE",
    help="Leave out what is inside of plane:P:N, sphere:C:R, cylinder:P:A:R or QUANTITY=VALUE, where the quantity is "
    "less; with outside: before it what is outside.",
)
@click.option(
    "--snap",
    metavar="NAME",
    help="Take the places of a boundary that are nearest to the points, as the element behind has them; a column says "
    "how far they are.",
)
@click.option("--all", "every", is_flag=True, help="A row for each element that holds the point, not just one.")
@times_option
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="File to write, .csv, .npz or .parquet, of a grid .nrrd.  [default: CSV on standard output]",
)
@click.option(
    "--plot",
    type=click.Path(path_type=Path),
    help="Draw the values over --times or --along, .png, .svg or .pdf; the table is left out where -o names none.",
)
@json_option
@overwrite_option
@data_options
@shared
def probe(
    data: Data,
    ranks: Ranks,
    points: str | None,
    single: tuple[tuple[Triple], ...],
    line: tuple[Triple, Triple] | None,
    curves: ProbeCurves,
    plane: tuple[Triple, Triple, Triple] | None,
    grid: tuple[int, int, int] | None,
    box: tuple[Triple, Triple] | None,
    counts: tuple[int, ...] | None,
    quantities: tuple[str, ...],
    clip: str | None,
    snap: str | None,
    every: bool,
    times: tuple[float, float, int] | str | None,
    output: Path | None,
    plot: Path | None,
    as_json: bool,
    overwrite: bool,
) -> None:
    """Evaluate fields exactly at points: the solver's own polynomials on the element that holds the point.

    Columns are point (row of the input), x, y, z, element, status, then one a field. Outside the domain, and where
    --clip leaves nothing, element is -1 and fields are nan; status is 0 outside, 1 inside, 3 where the search failed.
    Where a field jumps between elements, --all shows the value of each. A grid's values alone are written, of one field
    or the components of a vector. With --times the first column is the time, and all points follow for each; with
    --along it is the length of the curve up to the point; --plot draws them. On boundaries (--along boundary:NAME or
    section:NAME:plane:P:N) values are those of the element behind the wall; further columns are the number of the curve
    where there are several, x/c and the normal. Several curves go into one table and one plot, with a legend.
    """
    is_grid = grid is not None or box is not None
    _check_outputs(output, plot, is_grid, data.inputs(points), overwrite)
    curves.check(plot is not None)
    _check_ways(curves, plot, times, every, clip, snap)
    if is_grid or curves.are_on_walls or curves.speed or snap or points == "-":
        if is_idle(ranks):
            return
        ranks = ALONE
    ways = [way for way in (points, single or None, line, plane, times) if way is not None]
    asked = Asked(list(quantities) or None, every, clip, ranks)
    if is_grid:
        others = [*ways, *curves.names, *([counts] if counts else []), *([snap] if snap else [])]
        _write_grid(data, asked, grid, box, output, alone=not others and not every)
        return
    if curves.names:
        if ways:
            raise click.UsageError("expected --along without other points and --times", click.get_current_context())
        columns = _along(data.source(asked.quantities), curves, counts, asked)
        places = None
    else:
        places = _places(points, single, line, plane, counts)
        if snap is not None:
            columns = _snapped(data.source(asked.quantities), snap, places, asked)
        else:
            columns = _at_moments(times, data, places, asked) if times else _columns(asked.source(data), places, asked)
    if not ranks.rank:
        _show(columns, places, plot, curves.look, output, as_json)


def _show(
    columns: Columns, places: Floats | None, plot: Path | None, look: Look, output: Path | None, as_json: bool
) -> None:
    """Write, draw or print what was found at places (n, 3), or along curves."""
    from elvis.core.files.columns import csv_lines, write_columns
    from elvis.core.terminal import print_json, visible

    if plot is not None:
        _plot(plot, columns, places, look)
    if output is not None:
        write_columns(output, columns)
    elif as_json:
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        print_json([dict(zip(columns, row, strict=True)) for row in rows])
    elif plot is None:
        lines = csv_lines(columns)
        sys.stdout.writelines(map(visible, lines) if sys.stdout.isatty() else lines)
    _tell(columns)


def _along(source: Source, curves: ProbeCurves, counts: tuple[int, ...] | None, asked: Asked) -> Columns:
    """The table along curves."""
    if source.dataset is None:
        name = curves.names[0]
        raise ElvisError(f"--along: expected data of a known map, found what a plugin opens; {name} may be a --line")
    context = click.get_current_context()
    if counts and (len(counts) > 1 or curves.speed is not None):
        expected = "no -n with --layers" if curves.speed is not None else "one number of points along a curve"
        raise click.BadParameter(f"expected {expected}", context, param_hint="'-n'")
    wanted = _wanted(source, asked.texts) if curves.are_on_walls else ()
    count = counts[0] if counts else _ALONG
    return curves.table(source.dataset, wanted, count, partial(_columns, source, asked=asked))


def _snapped(source: Source, boundary: str, places: Floats, asked: Asked) -> Columns:
    """The table at the places of a boundary that are nearest to points (n, 3)."""
    from elvis.core.terminal import note
    from elvis.core.wall_curves import at_walls

    if source.dataset is None:
        raise ElvisError("--snap: expected data of a known map, found what a plugin opens")
    columns = at_walls(source.dataset, boundary, places, _wanted(source, asked.texts))
    note(f"points were moved onto {boundary} by up to {float(columns['distance'].max(initial=0.0)):.3g}")
    return columns


def _check_ways(
    curves: ProbeCurves,
    plot: Path | None,
    times: tuple[float, float, int] | str | None,
    every: bool,
    clip: str | None,
    snap: str | None,
) -> None:
    """UsageError for options that don't go together."""
    context = click.get_current_context()
    if plot is not None and ((times is None) == (not curves.names) or every):
        raise click.UsageError("expected --plot with --times or --along, and without --all", context)
    if (curves.are_on_walls or curves.speed) and (every or clip):
        raise click.UsageError("expected --along on a boundary, and --layers, without --all and --clip", context)
    if snap is not None and (every or clip or times is not None or curves.names):
        raise click.UsageError("expected --snap without --along, --all, --clip and --times", context)


def _check_outputs(output: Path | None, plot: Path | None, is_grid: bool, read: list[Path], overwrite: bool) -> None:
    """ElvisError where the files can't be written, before any long work."""
    from elvis.core.files.columns import check_suffix
    from elvis.core.files.output import check_places

    if output is not None and not is_grid:
        check_suffix(output)
    elif output is not None and output.suffix.lower() != ".nrrd":
        raise ElvisError(f"{output}: expected a name that ends in .nrrd for a grid, found {output.suffix or 'none'}")
    if plot is not None:
        from elvis.scene.time_plot import check_plot

        check_plot(plot)
    check_places([path for path in (output, plot) if path is not None], read, overwrite)


def _plot(path: Path, columns: Columns, places: Floats | None, look: Look) -> None:
    """Draw what was found at places (n, 3) over the times, or along curves."""
    import numpy as np

    from elvis.scene.time_plot import Plot

    if places is None:
        look.along(columns).save(path)
        return
    known = {name: np.asarray(column, np.float64) for name, column in columns.items() if name not in _COLUMNS}
    curves = {name: column.reshape(-1, len(places)).T for name, column in known.items()}
    times = curves.pop("time")[0]
    names = ["at " + ", ".join(f"{x:g}" for x in place) for place in places.tolist()]
    is_outside = columns["element"].reshape(-1, len(places))[0] < 0
    names = [f"{name}: outside" if out else name for name, out in zip(names, is_outside, strict=True)]
    Plot(times, names, curves).save(path)


def _places(
    points: str | None,
    single: tuple[tuple[Triple], ...],
    line: tuple[Triple, Triple] | None,
    plane: tuple[Triple, Triple, Triple] | None,
    counts: tuple[int, ...] | None,
) -> Floats:
    """(n, 3) the points asked for; usage error unless there is just one way."""
    import numpy as np

    from elvis.core.queries import points_in_table, points_on_line, points_on_plane

    if sum(way is not None for way in (points, single or None, line, plane)) != 1:
        ways = "--points, --point, --line, --plane and --grid"
        raise click.UsageError(f"expected one of {ways}", click.get_current_context())
    if plane is not None:
        n, m = counts * 2 if counts and len(counts) == 1 else counts or (_ALONG, _ALONG)
        return points_on_plane(*plane, (n, m))
    if counts and (line is None or len(counts) == 2):
        expected = "no -n beside points" if line is None else "one number of points along a line"
        raise click.BadParameter(f"expected {expected}", click.get_current_context(), param_hint="'-n'")
    if line is not None:
        return points_on_line(*line, counts[0] if counts else _ALONG)
    if single:
        return np.array([point for (point,) in single], np.float64)
    assert points is not None
    return points_in_table(points)


def _columns(source: Source, places: Floats, asked: Asked) -> Columns:
    """The table: what was asked, what was found, and one column a quantity; without rows but at the first rank."""
    from elvis.core.terminal import stage

    wanted = _wanted(source, asked.texts)
    with stage(f"probing {len(places)} points"):
        found = asked.of(source, places, wanted)
    _tell_beyond(wanted, found)
    return found


def _at_moments(times: tuple[float, float, int] | str, data: Data, places: Floats, asked: Asked) -> Columns:
    """The table at one time after another; nothing elsewhere than at the first rank."""
    found = or_alone(asked.ranks, lambda own: _at(times, data, places, replace(asked, ranks=own)))
    return found or {}


def _at(times: tuple[float, float, int] | str, data: Data, places: Floats, asked: Asked) -> Columns:
    """The same, with a column of times."""
    import numpy as np

    what = f"probing {len(places)} points"
    series, moments = data.moments(times, what, asked.quantities, asked.ranks, asked.comes_apart)
    parts: list[Columns] = []
    taken: list[float] = []
    for time, source in moments:
        wanted = _wanted(source, asked.texts)
        if not parts:
            asked = replace(asked, texts=[each.text for each in wanted])
            series.ask_for(*asked.quantities)
        found = asked.of(source, places, wanted)
        parts.append({"time": np.full(len(found["point"]), time), **found})
        taken.append(time)
    data.tell_of(series, taken, any(each.has_rates for each in wanted))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _write_grid(
    data: Data,
    asked: Asked,
    counts: tuple[int, int, int] | None,
    box: tuple[Triple, Triple] | None,
    output: Path | None,
    alone: bool,
) -> None:
    """Write the values at the points of a grid, some planes after others."""
    import numpy as np

    from elvis.core.files.nrrd import write_nrrd

    if counts is None or output is None or not alone:
        raise click.UsageError("expected --grid with -o NAME.nrrd, and no other points", click.get_current_context())
    source = data.source(asked.quantities)
    grid = _grid(source, counts, box)
    step = max(1, _TOGETHER // (counts[0] * counts[1]))

    def part(first: int) -> Columns:
        found = _columns(source, grid.planes(first, first + step), asked)
        return {name: column for name, column in found.items() if name not in _COLUMNS}

    opening = part(0)

    def parts() -> Iterator[Floats]:
        yield np.column_stack(list(opening.values()))
        for first in range(step, counts[2], step):
            yield np.column_stack(list(part(first).values()))

    write_nrrd(output, grid, list(opening), parts())


def _grid(source: Source, counts: tuple[int, int, int], box: tuple[Triple, Triple] | None) -> Grid:
    """The grid in a box, by default that of the data; ElvisError where several points would be at one place."""
    from elvis.core.files.nrrd import Grid

    if box is None:
        found = source.box()
        lower, upper = ([float(end or 0.0) for end in found[name]] for name in ("lower", "upper"))
        box = (lower[0], lower[1], lower[2]), (upper[0], upper[1], upper[2])
    for name, low, high, count in zip("xyz", *box, counts, strict=True):
        if not low < high and count > 1:
            raise ElvisError(f"--grid: expected one point along {name}, where the box goes from {low:g} to {high:g}")
    return Grid(*box, counts)


def _wanted(source: Source, texts: Sequence[str] | None) -> Sequence[Expression]:
    """The quantities, all fields where none are named, but for those with the name of another column.

    ElvisError where such a one is named, or there is no other.
    """
    from elvis.core.quantities.expression import taken_name
    from elvis.core.terminal import warn

    found = source.expressions(texts)
    wanted = [each for each in found if each.text not in _COLUMNS]
    for each in found:
        if each not in wanted:
            if texts or not wanted:
                raise ElvisError(taken_name(each.text))
            warn(f"{taken_name(each.text)}: it is left out")
    return wanted


def _tell_beyond(wanted: Sequence[Expression], columns: Columns) -> None:
    """Say at how many points another dataset, which a quantity names, has nothing."""
    import numpy as np

    from elvis.core.mapping.inverse import Status
    from elvis.core.quantities.tree import other_of
    from elvis.core.terminal import warn

    for quantity in (each for each in wanted if any(map(other_of, each.attributes))):
        inside = columns["status"] == Status.INSIDE
        beyond = int(np.isnan(columns[quantity.text][inside]).sum())
        if beyond:
            some = f"{beyond} of {int(inside.sum())} points inside"
            warn(f"{quantity.text} has no value at {some}: the other data end there")


def _tell(columns: Columns) -> None:
    """Say on a terminal how many points were found, and how many not."""
    if not sys.stderr.isatty() or "status" not in columns:
        return
    import numpy as np

    from elvis.core.mapping.inverse import Status

    point, status = columns["point"], columns["status"]
    counts = [len(np.unique(point[status == state])) for state in (Status.INSIDE, Status.OUTSIDE, Status.FAILED)]
    words = "{} points inside, {} outside, {} failed".format(*counts)
    print(f"elvis: {words}", file=sys.stderr)
