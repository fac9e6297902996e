"""``elvis trace``: streamlines and vortex cores as numbers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from elvis.core.base.errors import ElvisError
from elvis.core.data.arguments import field_option, json_option, overwrite_option, top_modes_option
from elvis.core.streamlines.lines.files import check_suffix, write_lines
from elvis.renderer.commands.core_lines import check_course, check_seeds, core_options, trace_cores
from elvis.renderer.commands.sources import Data, Source, data_options, native_source
from elvis.scene.commandline.options import COURSE, course_options

if TYPE_CHECKING:
    from collections.abc import Sequence

    from elvis.core.base.arrays import Floats
    from elvis.core.streamlines import TracedLines
    from elvis.renderer.commands.lines_below import LinesBelow
    from elvis.scene import Streamlines

EPILOG = """\b
Examples:
  elvis trace wing.xml wing.fld --seeds line:0.1,0.5,0.1:0.1,0.5,0.9:20 -o lines.vtp
  elvis trace wing.xml wing.fld --seeds random:200 --direction both --length 2 -o lines.npz
  elvis trace bend.xml bend.fld --seeds boundary:inlet:4 --field p -o lines.csv
  elvis trace wing.xml wing.fld --wall wing --seeds boundary:wing:2 -o friction.vtp
  elvis trace jet.xml jet.fld --seeds seeds.csv --velocity rhou/rho,rhov/rho --duration 5
  elvis trace wave.xml wave_*.chk --kind pathlines --velocity "d(u,y),-d(u,x)" --seeds random:20 -o paths.vtp
  elvis trace wave.xml wave_*.chk --kind streaklines --velocity "d(u,y),-d(u,x)" --seeds point:0.4,0.4 -o dye.vtp
  elvis trace wing.xml wing.fld --cores --min-length 0.1 -o cores.vtp
"""

#: what a line may be
KINDS = ("streamlines", "pathlines", "streaklines")


@click.command(
    "trace",
    params=course_options(),
    epilog=EPILOG,
    short_help="Trace streamlines and vortex cores through curved elements.",
)
@click.option(
    "--kind",
    type=click.Choice(KINDS),
    default=KINDS[0],
    show_default=True,
    help="Streamlines along the velocity of one time; pathlines of particles released at --time in a series; or "
    "streaklines of all particles that a seed has released since --time.",
)
@click.option("--releases", type=int, help="Number of particles of a streakline, at even time steps.  [default: 101]")
@click.option("--spacing", type=float, help="Maximum spacing of points along a line.  [default: 1/200 diagonal]")
@click.option(
    "--device",
    default="auto",
    show_default=True,
    help="Device that traces large numbers of lines (see elvis devices); reference computes in NumPy.",
)
@core_options
@click.option(
    "--clip",
    "clips",
    multiple=True,
    metavar="SURFACE",
    help="Remove the parts of lines inside plane:P:N, sphere:C:R or cylinder:P:A:R; outside:SURFACE removes those "
    "outside.  Repeatable.",
)
@click.option("--ftle", is_flag=True, help="Also compute finite-time Lyapunov exponents with the exact gradient.")
@field_option
@top_modes_option
@json_option
@click.option("-o", "--output", type=click.Path(path_type=Path), help="File to write, .csv, .npz or .vtp (ParaView).")
@overwrite_option
@data_options
def trace(
    data: Data,
    kind: str,
    releases: int | None,
    spacing: float | None,
    clips: tuple[str, ...],
    ftle: bool,
    device: str,
    quantities: tuple[str, ...],
    without_top_modes: bool,
    as_json: bool,
    output: Path | None,
    overwrite: bool,
    cores: bool,
    criterion: str | None,
    min_swirl: float | None,
    min_length: float | None,
    only_q: bool,
    **course: Any,
) -> None:
    """Trace streamlines from seeds, and print how they end.

    Lines are integrated in the elements' own coordinates with a method of order 8, one element at a time, so that
    curved elements, high orders and jumps cost no accuracy. The end of each line has a name: left or the name of the
    boundary through which the line left, length, duration, speed, steps, stagnation, jump, outside, nan, inverted,
    failed. With --direction both, upstream lines are listed after the others. With --wall, lines stay on a boundary
    and follow the wall shear. For pathlines and streaklines, coefficients are interpolated between steps (--between
    linear, of order 2 in the step size, or cubic, of order 4), without the device. The output file contains the points
    of all lines with time, length, element, velocity and the quantities of --field.
    --cores needs no seeds: it finds and traces the cores of all vortices in 3D data.
    """
    from elvis.core.base.terminal import stage
    from elvis.core.data.arguments import texts_of
    from elvis.core.files.output import check_places
    from elvis.core.resolution.truncation import orders_below
    from elvis.core.streamlines.clipped_lines import clipped_lines
    from elvis.renderer.commands.lines_below import LinesBelow
    from elvis.renderer.passes.streams.following import following
    from elvis.scene import Streamlines

    limits = {"criterion": criterion, "min_swirl": min_swirl, "min_length": min_length, "only_q": only_q}
    if clips and (cores or without_top_modes or kind != KINDS[0]):
        raise ElvisError("--clip: expected streamlines without --cores and --without-top-modes")
    if without_top_modes and (cores or kind != KINDS[0]):
        raise ElvisError(f"--without-top-modes: expected streamlines, found {'--cores' if cores else kind}")
    if cores:
        check_course(course, ftle or releases is not None or kind != KINDS[0])
        trace_cores(data, course["velocity"], limits, spacing, quantities, as_json, output, overwrite)
        return
    check_seeds(limits, course["seeds"])
    # missing settings have the defaults of a scene, whose checks also apply here
    followed = Streamlines(**{name: value for name, value in course.items() if value is not None})
    asked = {name: getattr(followed, name) for name in COURSE if name not in ("seeds", "velocity")}
    if output is not None:
        check_suffix(output)
        check_places(
            [output], [*data.inputs(), *(Path(seed) for seed in followed.seeds if Path(seed).is_file())], overwrite
        )
    velocity = texts_of(followed.velocity)
    found: TracedLines
    if releases is not None and kind != "streaklines":
        raise ElvisError("--releases: expected --kind streaklines with it")
    if kind != "streamlines":
        found = _in_time(
            kind, data, followed, velocity, releases=releases, spacing=spacing, fields=quantities, ftle=ftle
        )
        _report(found, output, as_json)
        return
    asked |= {"ftle": ftle, "spacing": spacing, "fields": quantities}

    def traced(source: Source) -> TracedLines:
        with stage("following lines"):
            if device == "reference":
                return source.trace(list(followed.seeds), velocity, **asked)
            with following(device) as make:
                return source.trace(list(followed.seeds), velocity, make=make, **asked)

    source = data.source()
    less = None
    if without_top_modes:
        below = native_source(source, "--without-top-modes").without_top_modes()
        less = LinesBelow(orders_below(below.dataset), traced(below))
    lines = traced(source)
    for clip in clips:
        lines = clipped_lines(lines, native_source(source, "--clip").dataset, clip)
    _report(lines, output, as_json, less)


def _in_time(
    kind: str,
    data: Data,
    followed: Streamlines,
    velocity: Sequence[str] | None,
    *,
    releases: int | None,
    spacing: float | None,
    fields: Sequence[str],
    ftle: bool,
) -> TracedLines:
    """Paths or streaks in a series; ElvisError for settings that these have not."""
    from elvis.core.base.terminal import note, stage
    from elvis.core.data.moments import checked_step
    from elvis.plugins.series.paths import ORDERS, pathlines, streaklines

    if followed.wall is not None:
        raise ElvisError(f"--wall: expected streamlines, found {kind}, which are not on walls")
    own: dict[str, Any] = {"velocity": velocity, "between": data.between, "fields": fields, "random": followed.random}
    own |= {name: getattr(followed, name) for name in ("duration", "tolerance")}
    series = data.whole_series((*(velocity or ()), *fields) if velocity else ())
    own["start"] = data.time
    if data.step is not None:
        own["start"] = float(series.times[checked_step(data.step, len(series))])
    if kind == "pathlines":
        further = ("direction", "length", "speed", "steps")
        own |= {"spacing": spacing, "ftle": ftle, **{name: getattr(followed, name) for name in further}}
        with stage("following particles"):
            found = pathlines(series, list(followed.seeds), **own)
    else:
        no_use = {"--spacing": spacing, "--ftle": ftle or None, "--length": followed.length}
        given = [name for name, value in no_use.items() if value is not None]
        if given or followed.direction != "forward":
            raise ElvisError(f"streaklines: expected no {given[0] if given else '--direction'}")
        with stage("following particles"):
            found = streaklines(series, list(followed.seeds), releases=releases or 101, **own)
    note(f"between steps coefficients are interpolated in time ({data.between}, of order {ORDERS[data.between]})")
    for remark in series.told:
        note(remark)
    return found


def _report(found: TracedLines, output: Path | None, as_json: bool, less: LinesBelow | None = None) -> None:
    """Write lines and print how they end; with ``less`` also how those of truncated fields differ."""
    from elvis.core.base.terminal import print_json, print_table

    _warn_of_seeds(found)
    if output is not None:
        own = {} if less is None else {"distance_without_top_modes": less.distances(found)}
        write_lines(output, found, _of_lines(found) | own)
    if as_json:
        print_json(_facts(found) | ({} if less is None else less.facts(found)))
        return
    print_table(("end", "meaning", "lines"), found.table())
    if found.ftle is not None:
        click.echo(_exponents(found.ftle))
    if less is not None:
        click.echo(less.sentence(found))


def _facts(found: TracedLines) -> dict[str, Any]:
    """How lines end, how long each is and, where they were requested, the exponents; None where there is none."""
    last = found.offsets[1:] - 1
    lengths = [float(found.length[k]) if k >= first else None for first, k in zip(found.offsets, last, strict=False)]
    facts = {"lines": len(found), "points": len(found.points), "ends": found.counts(), "lengths": lengths}
    return facts if found.ftle is None else {**facts, "ftle": found.ftle.tolist()}


def _exponents(ftle: Floats) -> str:
    """A sentence on the exponents (n,) of lines, NaN for lines without."""
    import numpy as np

    known = ftle[np.isfinite(ftle)]
    if not len(known):
        return "no line has an exponent"
    return f"finite-time Lyapunov exponents from {known.min():.6g} to {known.max():.6g}, of {len(known)} lines"


def _of_lines(found: TracedLines) -> dict[str, Any]:
    """Facts of each line: its seed, its end and, if requested, its exponent."""
    own = {"seed": found.seed, "end": found.end}
    return own if found.ftle is None else {**own, "ftle": found.ftle}


def _warn_of_seeds(found: TracedLines) -> None:
    """Say how many seeds lie in no element; ElvisError where all do."""
    import numpy as np

    from elvis.core.base.terminal import warn

    outside = found.seed[found.end == found.ends.index("outside")]
    count, total = len(np.unique(outside)), len(np.unique(found.seed))
    if count == total:
        raise ElvisError(f"all {total} seeds lie outside the mesh")
    if count:
        warn(f"{count} of {total} seeds lie outside the mesh")
