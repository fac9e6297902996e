"""``elvis probe``: exact values at points."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import ALONE, Ranks, is_idle
from elvis.core.data.arguments import (
    TextType,
    Triple,
    json_option,
    named_expressions,
    named_field_option,
    overwrite_option,
    times_option,
    triples,
)
from elvis.plugins.command.running import shared
from elvis.renderer.commands.outputs import check_outputs
from elvis.renderer.commands.probe.asked import Asked
from elvis.renderer.commands.probe.curves import ProbeCurves, curve_options
from elvis.renderer.commands.probe.look import Look
from elvis.renderer.commands.probe.points import (
    ALONG,
    COLUMNS,
    across_box,
    chosen_points,
    counts_of,
    grid_counts,
    grid_of,
    points_of_grid,
    spanned,
)
from elvis.renderer.commands.probe.spectra import segment_of, spectra_of
from elvis.renderer.commands.sources import Data, NativeSource, data_options, or_alone
from elvis.renderer.commands.with_copies import copies_options

if TYPE_CHECKING:
    from elvis.core.base.arrays import Floats
    from elvis.core.data.dataset import Dataset
    from elvis.core.files.columns import Columns
    from elvis.core.quantities import Expression
    from elvis.renderer.commands.sources import Source
    from elvis.scene.model.copies import Copies


#: points of a grid that are asked together
_TOGETHER = 1 << 18


_PAIR = TextType(partial(triples, count=2))
EPILOG = """\b
Examples:
  elvis probe wing.xml wing.fld --line 0,0,0:1,0,0 -n 200 -o line.csv
  elvis probe wing.xml wing.fld --plane 0,0,0:1,0,0:0,1,0 -n 100x50 --fields u,v -o plane.npz
  elvis probe wing.xml wing.fld --point 0.5,0,0.1 --field p
  elvis probe wing.xml wing.fld --points sensors.csv --all
  elvis probe wing.xml wing.fld --grid 128x128x64 --box 0,0,0:1,1,0.5 -f p -o pressure.nrrd
  elvis probe wing.xml wing.fld --plane z=0.2 -n 100x50 -f p -o plane.csv
  elvis probe wing.xml wing.fld --along normal:wing:0.5,0,0.2:0.05 --fields u --plot layer.png
  elvis probe wing.xml wing.fld --along section:wing:plane:0,0.5,0:0,1,0 --field p --plot cp.pdf --x x/c --reverse
  elvis probe wing.xml wing.fld --along line:0,0,0:1,0,0 --along line:0,1,0:1,1,0 --field p --plot lines.pdf
  elvis probe wing.xml wing.fld --along normal:wing:stations.csv:0.05 --layers u --plot layers.pdf
  elvis probe wing.xml wing.fld --points taps.csv --snap wing --field p
  elvis probe wing.xml wing.fld --line 0,0,0:1,0,0 --clip sphere:0.5,0,0:0.2 -o outside.csv
  elvis probe wing.xml wing_*.chk --point 0.5,0,0.1 --times all -o signal.csv --plot signal.svg
  elvis probe wing.xml wing_*.chk --point 0.5,0,0.1 --times all --spectrum 256 --plot spectrum.svg
  elvis probe wing.xml wing.fld --line 0,0,0:1,0,0 --field "sqrt(u^2+v^2)" --field "d(v,x)-d(u,y)"
"""


@click.command("probe", epilog=EPILOG, short_help="Evaluate fields exactly at points, on lines and planes.")
@click.option("--points", metavar="FILE", help="Table of points with columns x, y, z; - for standard input.")
@click.option(
    "--point",
    "single",
    metavar="P",
    multiple=True,
    type=TextType(partial(triples, count=1)),
    help="Point, such as 0,0,0.  Repeatable.",
)
@click.option("--line", metavar="P:Q", type=_PAIR, help="Points from P to Q, such as 0,0,0:1,0,0.")
@curve_options
@click.option(
    "--plane",
    metavar="P:U:V|z=V|z",
    type=TextType(spanned),
    help="Points P + s U + t V with s and t from 0 to 1; z=V and z cover the bounding box of the data.",
)
@click.option("--grid", metavar="NXxNYxNZ", type=TextType(grid_counts), help="Points of a regular grid, x fastest.")
@click.option("--box", metavar="LOW:HIGH", type=_PAIR, help="Corners of the grid.  [default: those of the data]")
@click.option(
    "-n",
    "counts",
    metavar="N[xM]",
    type=TextType(counts_of),
    help="Number of points along the line, or along both sides of the plane.  [default: 101]",
)
@named_field_option
@click.option(
    "--clip",
    metavar="SURFACE",
    help="Exclude the inside of plane:P:N, sphere:C:R or cylinder:P:A:R, or the part where QUANTITY=VALUE is below the "
    "value; outside:SURFACE excludes the outside.",
)
@click.option(
    "--snap",
    metavar="NAME",
    help="Move points to the nearest positions on a boundary, in the element behind it; a column gives the distance.",
)
@click.option("--all", "every", is_flag=True, help="Print a row for each element that contains the point.")
@times_option
@click.option(
    "--spectrum",
    metavar="all|N",
    type=TextType(segment_of),
    help="Power spectral densities over --times instead of values, by Welch's method with segments of N times, or with "
    "a single segment (all).",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="File to write, .csv, .npz or .parquet; for a grid also .nrrd.  [default: CSV on standard output]",
)
@click.option(
    "--plot",
    type=click.Path(path_type=Path),
    help="Plot the values over --times, --along or --line as .png, .svg or .pdf; without -o no table is printed.",
)
@json_option
@overwrite_option
@copies_options
@data_options
@shared
def probe(
    data: Data,
    ranks: Ranks,
    points: str | None,
    single: tuple[tuple[Triple], ...],
    line: tuple[Triple, Triple] | None,
    curves: ProbeCurves,
    plane: tuple[Triple, Triple, Triple] | str | None,
    grid: tuple[int, int, int] | None,
    box: tuple[Triple, Triple] | None,
    counts: tuple[int, ...] | None,
    quantities: tuple[str, ...],
    clip: str | None,
    snap: str | None,
    every: bool,
    times: tuple[float, float, int] | str | None,
    spectrum: int | None,
    output: Path | None,
    plot: Path | None,
    as_json: bool,
    overwrite: bool,
    copies: Copies | None,
) -> None:
    """Evaluate fields exactly at points, with the solver's own polynomials on the element that contains each point.

    Columns are point (row of the input), x, y, z, element, status, then one per field. Outside the domain, and in parts
    excluded by --clip, element is -1 and fields are nan; status is 0 outside, 1 inside, 3 if the search failed.
    If a field jumps between elements, --all prints the value of each. A .nrrd file contains only the values of a grid,
    of one field or of the components of a vector. With --times the first column is the time, with all points for each
    time; with --along it is the arc length of the curve up to the point; --plot draws both. On boundaries (--along
    boundary:NAME or section:NAME:plane:P:N) values are those of the element behind the wall; further columns are the
    number of the curve if there are several, x/c and the normal. Several curves share one table and one plot, with a
    legend. With --with-copies the column copy has the number of the copy that contains the point, -1 outside.
    """
    if copies is not None and (every or clip or snap or plot or curves.names or spectrum):
        raise click.UsageError(
            "expected --with-copies without --all, --clip, --snap, --along, --spectrum and --plot",
            click.get_current_context(),
        )
    if box is not None and grid is None:
        raise click.UsageError("expected --box with --grid", click.get_current_context())
    if line is not None and plot is not None and not curves.names and times is None:
        # a straight curve, which has the column of lengths that a plot goes over
        name = "line:" + ":".join(",".join(map(repr, end)) for end in line)
        curves = replace(curves, names=(name,))
        line = None
    is_nrrd = grid is not None and output is not None and output.suffix.lower() == ".nrrd"
    check_outputs(output, plot, data.inputs(points), overwrite, is_nrrd)
    curves.check(plot is not None)
    _check_ways(curves, plot, times, every, clip, snap)
    if spectrum is not None and (times is None or every):
        raise click.UsageError("expected --spectrum with --times, and without --all", click.get_current_context())
    spans_box = grid is not None or isinstance(plane, str)
    if copies or spans_box or curves.are_on_walls or curves.speed or snap or points == "-":
        if is_idle(ranks):
            return
        ranks = ALONE
    ways = [way for way in (points, single or None, line, plane, times) if way is not None]
    data = replace(data, is_copied=copies is not None)
    named = named_expressions(quantities)
    asked = Asked(list(dict.fromkeys(named.values())) or None, every, clip, ranks, copies)
    if grid is not None:
        others = [
            points,
            *single,
            line,
            plane,
            *curves.names,
            counts,
            snap,
            copies if is_nrrd else None,
            *([every or None, times] if is_nrrd else []),
        ]
        if any(other is not None for other in others):
            raise click.UsageError("expected --grid without other points", click.get_current_context())
    if is_nrrd:
        assert grid is not None
        assert output is not None
        _write_grid(data, asked, grid, box, output)
        return
    if curves.names:
        if ways:
            raise click.UsageError("expected --along without other points and --times", click.get_current_context())
        columns = _along(data.source(asked.quantities), curves, counts, asked)
        places = None
    else:
        source = asked.source(data) if spans_box else None
        if source is not None and grid is not None:
            places = points_of_grid(grid_of(source, grid, box))
        else:
            if isinstance(plane, str):
                assert source is not None
                plane = across_box(source, plane)
            places = chosen_points(points, single, line, plane, counts)
        if snap is not None:
            columns = _snapped(source or data.source(asked.quantities), snap, places, asked)
        elif times:
            columns = _at_moments(times, data, places, asked)
            if spectrum is not None and not ranks.rank:
                columns = spectra_of(columns, len(places), spectrum)
        else:
            columns = _columns(source or asked.source(data), places, asked)
    if not ranks.rank:
        _show(_labelled(columns, named), places, plot, curves.look, output, as_json)


def _labelled(columns: Columns, named: Mapping[str, str]) -> Columns:
    """Columns of expressions with the names of these; raises ElvisError for names of other columns."""
    wanted = set(named.values())
    found = {}
    for text, column in columns.items():
        names = [name for name, own in named.items() if own == text] if text in wanted else [text]
        for name in names:
            if name in found:
                raise ElvisError(f"--field: expected a name of no other column, found {name!r}")
            found[name] = column
    return found


def _show(
    columns: Columns, places: Floats | None, plot: Path | None, look: Look, output: Path | None, as_json: bool
) -> None:
    """Write, plot or print the values at points (n, 3), or along curves."""
    from elvis.core.base.terminal import print_json, visible
    from elvis.core.files.columns import csv_lines, write_columns

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
        raise ElvisError(
            f"--along: expected data with a known element map, found data opened by a plugin; {name} may be a --line"
        )
    context = click.get_current_context()
    if counts and (len(counts) > 1 or curves.speed is not None):
        expected = "no -n with --layers" if curves.speed is not None else "one number of points along a curve"
        raise click.BadParameter(f"expected {expected}", context, param_hint="'-n'")
    dataset = source.dataset

    def at_points(own: Dataset, places: Floats) -> Columns:
        return _columns(source if own is dataset else NativeSource(own, False), places, asked)

    texts = None if asked.texts is None else list(asked.texts)
    if curves.are_on_walls:
        texts = [each.text for each in _wanted(source, texts)]
    return curves.table(dataset, texts, counts[0] if counts else ALONG, at_points)


def _snapped(source: Source, boundary: str, places: Floats, asked: Asked) -> Columns:
    """The table at the places of a boundary that are nearest to points (n, 3)."""
    from elvis.core.base.terminal import note
    from elvis.core.wall_curves import at_walls

    if source.dataset is None:
        raise ElvisError("--snap: expected data with a known element map, found data opened by a plugin")
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
        raise click.UsageError("expected --plot with --times, --along or --line, and without --all", context)
    if (curves.are_on_walls or curves.speed) and (every or clip):
        raise click.UsageError("expected --along on a boundary, and --layers, without --all and --clip", context)
    if snap is not None and (every or clip or times is not None or curves.names):
        raise click.UsageError("expected --snap without --along, --all, --clip and --times", context)


def _plot(path: Path, columns: Columns, places: Floats | None, look: Look) -> None:
    """Plot the values at points (n, 3) over the times, or along curves."""
    import numpy as np

    from elvis.scene.figure.time_plot import Plot

    if places is None:
        look.along(columns).save(path)
        return
    known = {name: np.asarray(column, np.float64) for name, column in columns.items() if name not in COLUMNS}
    curves = {name: column.reshape(-1, len(places)).T for name, column in known.items()}
    is_spectrum = "frequency" in curves
    times = curves.pop("frequency" if is_spectrum else "time")[0]
    names = ["at " + ", ".join(f"{x:g}" for x in place) for place in places.tolist()]
    is_outside = columns["element"].reshape(-1, len(places))[0] < 0
    names = [f"{name}: outside" if out else name for name, out in zip(names, is_outside, strict=True)]
    if is_spectrum:
        # no logarithm of the frequency 0
        shown = {name: own[:, 1:] for name, own in curves.items()}
        Plot(times[1:], names, shown, "frequency", is_logarithmic=True).save(path)
        return
    Plot(times, names, curves).save(path)


def _columns(source: Source, places: Floats, asked: Asked) -> Columns:
    """The table: points, status, and one column per quantity; without rows except on the first rank."""
    from elvis.core.base.terminal import stage

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
    counts: tuple[int, int, int],
    box: tuple[Triple, Triple] | None,
    output: Path,
) -> None:
    """Write the values at the points of a grid, some planes after others."""
    import numpy as np

    from elvis.core.files.nrrd import write_nrrd

    source = data.source(asked.quantities)
    grid = grid_of(source, counts, box)
    step = max(1, _TOGETHER // (counts[0] * counts[1]))

    def part(first: int) -> Columns:
        found = _columns(source, grid.planes(first, first + step), asked)
        return {name: column for name, column in found.items() if name not in COLUMNS}

    opening = part(0)
    if not opening:
        raise ElvisError("--grid: expected a quantity other than the coordinates, which a .nrrd file does not contain")

    def parts() -> Iterator[Floats]:
        yield np.column_stack(list(opening.values()))
        for first in range(step, counts[2], step):
            yield np.column_stack(list(part(first).values()))

    write_nrrd(output, grid, list(opening), parts())


def _wanted(source: Source, texts: Sequence[str] | None) -> Sequence[Expression]:
    """The quantities, by default all fields, except those with the name of another column.

    ElvisError if such a quantity is named, or if no other remains.
    """
    from elvis.core.base.terminal import warn
    from elvis.core.quantities.expression import taken_name

    found = source.expressions(texts)
    if source.dataset is not None:
        # coordinates are columns of the table anyway
        found = [each for each in found if each.root.op != "coordinate"]
        if not found:
            return []
    wanted = [each for each in found if each.text not in COLUMNS]
    for each in found:
        if each not in wanted:
            if texts or not wanted:
                raise ElvisError(taken_name(each.text))
            warn(f"{taken_name(each.text)}: it is skipped")
    return wanted


def _tell_beyond(wanted: Sequence[Expression], columns: Columns) -> None:
    """Say at how many points another dataset, which a quantity names, has nothing."""
    import numpy as np

    from elvis.core.base.terminal import warn
    from elvis.core.mapping.inverse import Status
    from elvis.core.quantities.tree import other_of

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
