"""``elvis average``: means over the steps of a series."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from elvis.core.base.errors import ElvisError
from elvis.core.base.rounded_up import rounded_up
from elvis.core.data.arguments import (
    TextType,
    cache_option,
    evenly,
    overwrite_option,
    reader_and_names_option,
    set_option,
)

if TYPE_CHECKING:
    from elvis.core.data.dataset import Dataset
    from elvis.plugins.data.data import Reading
    from elvis.plugins.series.extrema import FitError
    from elvis.plugins.series.series import Series
    from elvis.plugins.series.statistics import Average

EPILOG = """\b
Examples:
  elvis average wing.xml 'wing_*.chk' -o mean.fld
  elvis average wing.xml wing_*.chk --covariances -o mean.fld
  elvis render wing.xml mean.fld --field "sqrt(max(u_u,0))" --plane 0,0,0:0,0,1 -o rms.png
  elvis average wing.xml 'wing_*.chk' --wall wing --set mu=2e-4 -o shear.xml
  elvis average spanwise.xml spanwise.fld --direction z -o mean.xml
  elvis average channel.xml channel.fld --direction y --planes -1:1:65 -o profile.csv
  elvis average case.pyfrm case-*.pyfrs --over time -o mean.xml
"""

FILE = click.Path(path_type=Path)

#: endings of names of extrema
_ENDINGS = ("_min", "_max", "_time")
#: relative residual of covariance fits above which a message is printed
_ROUNDING = 1e-11


def _off(error: FitError) -> str:
    """The error of a fit, in words."""
    if error.bound < float("inf"):
        bound = rounded_up(error.bound, 3)
        return f"its error is at most {bound} of its largest value ({error.estimate:.3g} at points)"
    return f"its error is about {error.estimate:.3g} of its largest value, an estimate from points"


def _span(found: Average, series: Series) -> str:
    """Number and times of the averaged steps, in words."""
    count = found.dataset.metadata["AveragedSteps"]
    return f"{count} steps from time {series.times[0]:.10g} to {series.times[-1]:.10g}"


def _tell(found: Average, order: int | None) -> None:
    """Print which fields a mean leaves out, and the errors of statistics."""
    from elvis.core.base.terminal import note

    for remark in found.dataset.remarks:
        note(remark)
    if found.left_out:
        note(f"fields that differ between steps are skipped: {', '.join(found.left_out)}")
    for name, error in found.errors.items():
        if error.estimate > _ROUNDING:
            holds_any = order is None or name.endswith(_ENDINGS)
            reason = "no basis represents it" if holds_any else f"degree {order} does not hold it"
            note(f"{name}: {reason}: {_off(error)}")


def _write_along(
    files: Sequence[Path], direction: str, planes: tuple[float, float, int] | None, output: Path, reading: Reading
) -> None:
    """Write the mean of one state along a direction, or means over planes across it."""
    from elvis.core.base.terminal import note
    from elvis.plugins.data.data import dataset_of
    from elvis.plugins.series.series import series_in

    if series_in(files, reading) is not None:
        raise ElvisError("--direction: expected one state, found a series; write its mean first, or one step")
    dataset = dataset_of(files, reading)
    for remark in dataset.remarks:
        note(remark)
    if planes is not None:
        _write_planes(dataset, direction, planes, output)
    else:
        _write_mean_mode(dataset, direction, output)


def _write_mean_mode(dataset: Dataset, direction: str, output: Path) -> None:
    """Write the mean along a direction."""
    from elvis.core.base.terminal import note, say
    from elvis.formats.writing import write
    from elvis.plugins.means.extruded_mean import mean_along

    found = mean_along(dataset, direction)
    for remark in found.remarks:
        if remark not in dataset.remarks:
            note(remark)
    say(f"{', '.join(map(str, write(found, output)))}: mean along {direction}")


def _write_planes(dataset: Dataset, direction: str, planes: tuple[float, float, int], output: Path) -> None:
    """Write a table of means over planes across a direction."""
    import numpy as np

    from elvis.core.base.terminal import say, stage
    from elvis.core.files.columns import write_columns
    from elvis.plugins.means.plane_means import plane_means

    with stage(f"means over {planes[2]} planes"):
        found = plane_means(dataset, direction, np.linspace(*planes).tolist())
    columns = {direction: found.places, "size": found.sizes, **found.means}
    write_columns(output, {name: np.array(own) for name, own in columns.items()})
    worst = ", ".join(f"{name} {rounded_up(error)}" for name, error in found.errors.items())
    say(f"{output}: means over {len(found.places)} planes across {direction}; errors up to {worst}")


def _check_direction(direction: str | None, has_planes: bool, is_alone: bool, output: Path) -> None:
    """Raise UsageError for options that --direction and --planes can't have."""
    from elvis.core.files.columns import check_suffix

    if direction is None:
        if has_planes:
            raise click.UsageError("expected --direction with --planes", click.get_current_context())
        return
    if not is_alone or (output.suffix != ".xml" and not has_planes):
        expected = "expected --direction with -o NAME.xml, without --covariances, --extrema, --order and --wall"
        raise click.UsageError(expected, click.get_current_context())
    if has_planes:
        check_suffix(output)


def _write_wall(series: Series, wall: str, over: str, output: Path, is_alone: bool) -> None:
    """Write the statistics of a wall; UsageError unless the name ends in .xml and there are no other statistics."""
    from elvis.core.base.terminal import note, say, stage
    from elvis.formats.writing import write
    from elvis.plugins.means.wall_statistics import wall_statistics

    if output.suffix != ".xml" or not is_alone:
        expected = "expected --wall with -o NAME.xml, without --covariances, --extrema, --order"
        raise click.UsageError(expected, click.get_current_context())
    with stage(f"wall shear of {len(series)} steps"):
        found = wall_statistics(series, wall, over)
    for remark in found.report.remarks():
        note(remark)
    say(f"{', '.join(map(str, write(found.dataset, output)))}: wall shear of {len(series)} steps on {wall}")


@click.command("average", epilog=EPILOG, short_help="Write the mean of a series, and covariances.")
@click.argument("data", nargs=-1, required=True, type=FILE, metavar="DATA...")
@click.option(
    "--output",
    "-o",
    type=FILE,
    required=True,
    help="Field file to write; or .xml for the mesh, with the fields next to it.",
)
@click.option(
    "--over",
    type=click.Choice(["steps", "time"]),
    default="steps",
    show_default=True,
    help="Weight all steps equally, or average over time with linear interpolation between steps.",
)
@click.option("--covariances", is_flag=True, help="Also write the covariances u_u, u_v, … of all pairs of fields.")
@click.option(
    "--extrema",
    "--extremes",
    is_flag=True,
    help="Also write the minimum and maximum over the steps, u_min and u_max, and their times, u_min_time and "
    "u_max_time; error bounds are printed.",
)
@click.option(
    "--order",
    type=click.IntRange(1, 30),
    help="Maximum degree of covariances; their errors are printed.  [default: the degree that contains them exactly]",
)
@click.option(
    "--wall",
    metavar="NAME",
    help="Write statistics of the wall shear on a boundary, as separate data, instead of fields: TAWSS (mean "
    "magnitude), the mean vector shear_x, shear_y, shear_z and, in 3D, transWSS (mean magnitude across it), and "
    "TAAFI and TACFI (mean cosine and sine of the angle to it). OSI, RRT and WSSG are predefined quantities of these.",
)
@click.option(
    "--direction",
    type=click.Choice(["x", "y", "z"]),
    help="Average one state along an axis instead of over steps, exactly, as plane data: the axis of its Fourier "
    "direction, or one along which its hexahedra and prisms are extruded.",
)
@click.option(
    "--planes",
    metavar="A:B:N",
    type=TextType(evenly),
    help="With --direction, means over N planes from A to B across the axis instead of along it: a profile, as .csv, "
    ".npz or .parquet.",
)
@set_option
@reader_and_names_option
@overwrite_option
@cache_option
def average(
    data: tuple[Path, ...],
    output: Path,
    over: str,
    covariances: bool,
    extrema: bool,
    order: int | None,
    wall: str | None,
    direction: str | None,
    planes: tuple[float, float, int] | None,
    reference: dict[str, float],
    reader: tuple[str, ...],
    overwrite: bool,
    no_cache: bool,
) -> None:
    """Write the exact mean of each field over the steps of a series: the mean of its coefficients.

    Covariances of the fluctuations about the means are also exact, in bases of twice the degree: u_u is the square of
    the rms fluctuation of u.  If a basis does not contain them, an estimate of the error is printed.
    """
    from elvis.core.base.terminal import say
    from elvis.core.files.output import check_places
    from elvis.formats.writing import write
    from elvis.plugins.data.data import Reading, pairs
    from elvis.plugins.series.series import open_series
    from elvis.plugins.series.statistics import average as mean_of
    from elvis.plugins.series.step_names import expanded

    has_mesh = output.suffix == ".xml"
    files = expanded(data)
    _check_direction(direction, planes is not None, not (covariances or extrema or order or wall), output)
    check_places([output, output.with_suffix(".fld")] if has_mesh else [output], files, overwrite)
    if direction is not None:
        reading = Reading(None, pairs(reader), not no_cache, reference=reference)
        _write_along(files, direction, planes, output, reading)
        return
    series = open_series(*files, reader=pairs(reader), cache=not no_cache, reference=reference)
    if wall is not None:
        _write_wall(series, wall, over, output, not (covariances or extrema or order))
        return
    if not (has_mesh or series.is_native):
        raise ElvisError(f"{output}: expected a name ending in .xml, as the mesh is converted")
    found = mean_of(series, over, covariances, order, extrema)
    _tell(found, order)
    written = write(found.dataset, output) if has_mesh else write(found.dataset, field_path=output)
    say(f"{', '.join(map(str, written))}: mean of {_span(found, series)}")
