"""``elvis diff``: two solutions side by side, in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from elvis.core.data.arguments import (
    TextType,
    between_option,
    cache_option,
    complex_options,
    deform_options,
    json_option,
    names_option,
    overwrite_option,
    step_option,
    texts_of,
    time_option,
)

if TYPE_CHECKING:
    from elvis.core.data.complex_fields import ComplexChoice
    from elvis.core.data.dataset import Dataset
    from elvis.core.deformed.deformation import Deformation
    from elvis.core.differences import Differences, Family
    from elvis.plugins.data.data import Reading
    from elvis.reference.report.difference_maps import Maps
    from elvis.scene import Scene

EPILOG = """\b
Examples:
  elvis diff coarse.xml,coarse.fld fine.xml,fine.fld
  elvis diff wing.xml,wing.fld wing.vtu --fields p --json
  elvis diff run.xml,run.fld kept.xml,kept.fld --max 1e-9
  elvis diff a.xml,a.fld b.xml,b.fld c.xml,c.fld -o report/
  elvis diff wing.xml,wing.fld fine.xml,fine.fld --scene wing.toml -o report/
  elvis diff 'coarse.xml,coarse_*.chk' 'fine.xml,fine_*.chk' --time 0.6 --between cubic

The exit status is 1 if --max is exceeded; the requested output is still written.
"""


def _files(text: str) -> tuple[Path, ...]:
    """``a.xml,a.fld``: the files of one dataset."""
    found = tuple(Path(part.strip()) for part in text.split(",") if part.strip())
    if not found:
        raise click.BadParameter(f"expected files with commas between them, found {text!r}")
    return found


@click.command("diff", epilog=EPILOG, short_help="Compare two solutions on any meshes: norms of their difference.")
@click.argument("data", nargs=-1, required=True, type=TextType(_files), metavar="A [A2 ...] B")
@names_option("Fields to compare, separated by commas.  [default: all fields that both have]")
@click.option(
    "--error",
    type=float,
    default=1e-3,
    show_default=True,
    help="Requested relative error of squared norms if the meshes differ.",
)
@click.option(
    "--max",
    "limit",
    type=click.FloatRange(min=0),
    metavar="VALUE",
    help="Fail if a difference exceeds this value anywhere.",
)
@json_option
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="Table to write, .csv, .npz or .parquet, or folder of a report, which opens from disk.",
)
@click.option(
    "--scene",
    "scene_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Scene file (.toml, .yaml, .json) for the maps in a report, with objects and camera.  [default: outer faces; "
    "2D data in their plane]",
)
@click.option("--maps/--no-maps", "has_maps", default=True, show_default=True, help="Draw maps in the report.")
@step_option
@time_option
@between_option
@deform_options
@complex_options
@overwrite_option
@cache_option
def diff(
    data: tuple[tuple[Path, ...], ...],
    fields: str | None,
    error: float,
    limit: float | None,
    as_json: bool,
    output: Path | None,
    scene_file: Path | None,
    has_maps: bool,
    step: int | None,
    time: float | None,
    between: str,
    deformation: Deformation | None,
    complexes: ComplexChoice,
    overwrite: bool,
    no_cache: bool,
) -> None:
    """Compare solutions A with a reference B: norms of the difference of each field that both have.

    Write the files of one dataset together, separated by commas; any format works. On elements that both have, for
    every numbering and orientation, differences are computed exactly from coefficients, with a proved maximum. On other
    elements B is located exactly at every quadrature point on the elements of A, which are subdivided where borders of
    B's elements make kinks; every norm has an error in --json, and the maximum a proved bound from Bernstein
    coefficients, including rounding. Parts that B doesn't cover are excluded and reported. With several A, from coarse
    to fine, the order of convergence to B is also printed. A report shows the fields of the last A, of B and their
    difference in one scene. --step and --time choose a time of datasets that are series.
    """
    from elvis.core.base.terminal import print_json, stage, warn
    from elvis.core.data.moments import Moment
    from elvis.core.differences import family
    from elvis.plugins.data.data import Reading
    from elvis.reference.report.differences import write_difference_report
    from elvis.reference.report.writing import check_folder
    from elvis.scene import Scene
    from elvis.scene.model.files import read_scene

    if len(data) < 2:
        raise click.UsageError("expected at least two datasets, found one", click.get_current_context())
    if not 0 < error < 1:
        raise click.BadParameter(f"expected a number between 0 and 1, found {error:g}", param_hint="'--error'")
    read = [path for paths in data for path in paths]
    is_table = output is not None and output.suffix != ""
    if scene_file is not None and (output is None or is_table or not has_maps):
        raise click.UsageError("--scene: expected with the maps of a report, the folder that -o names")
    scene = Scene() if scene_file is None else read_scene(scene_file)
    if output is not None:
        _check_table(output, read, overwrite) if is_table else check_folder(output, read, overwrite)
    reading = Reading(
        is_kept=not no_cache, moment=Moment(step, time, between), deformation=deformation, complexes=complexes
    )
    *members, reference = _datasets(data, reading)
    names = [",".join(path.name for path in paths) for paths in data]
    with stage("comparing"):
        found = family(members, reference, names[:-1], texts_of(fields), error)
    for remark in dict.fromkeys(remark for member in found.members for remark in member.remarks):
        warn(remark)
    if output is not None and is_table:
        _write_table(output, found)
    elif output is not None:
        maps, remarks = (
            _maps(members[-1], reference, (names[-2], names[-1]), found, scene, scene_file is not None)
            if has_maps
            else ([], [])
        )
        write_difference_report(found, names[-1], output, read, overwrite, maps, remarks)
    if as_json:
        print_json(_facts(found))
    elif not is_table:
        _print(found)
    _check(limit, found.members[-1])


def _maps(
    first: Dataset, second: Dataset, names: tuple[str, str], found: Family, scene: Scene, is_asked: bool
) -> tuple[list[Maps], list[str]]:
    """The pictures of all fields, or a message why there are none; raises ElvisError instead if they were requested."""
    from elvis.core.base.errors import ElvisError
    from elvis.core.base.terminal import stage
    from elvis.reference.report.difference_maps import difference_maps

    try:
        with stage("drawing"):
            return list(difference_maps(first, second, names, found.fields, scene)), []
    except ElvisError as error:
        if is_asked:
            raise
        return [], [f"There are no maps: {error}."]


def _check_table(output: Path, read: list[Path], overwrite: bool) -> None:
    from elvis.core.files.columns import check_suffix
    from elvis.core.files.output import check_places

    check_suffix(output)
    check_places([output], read, overwrite)


def _datasets(data: Sequence[tuple[Path, ...]], reading: Reading) -> list[Dataset]:
    """The solutions.

    For series, the solution at a moment; raises ElvisError if a moment is requested and none is a series.
    """
    from elvis.core.base.errors import ElvisError
    from elvis.core.base.terminal import note
    from elvis.core.data.moments import Moment
    from elvis.plugins.data.data import dataset_of
    from elvis.plugins.series.series import series_in

    single = replace(reading, moment=Moment())
    are_series = [reading.moment.is_asked and series_in(paths, reading) is not None for paths in data]
    if reading.moment.is_asked and not any(are_series):
        raise ElvisError("--step, --time: expected a series among the solutions, found none")
    found = [
        dataset_of(paths, reading if is_series else single) for paths, is_series in zip(data, are_series, strict=True)
    ]
    for remark in (remark for dataset in found for remark in dataset.remarks):
        note(remark)
    return found


def _write_table(output: Path, found: Family) -> None:
    from elvis.core.files.columns import write_columns

    write_columns(output, found.members[0].columns() if len(found.members) == 1 else found.columns())


def _facts(found: Family) -> object:
    """Facts by field; for a family a list of these, each with its name, elements and orders."""
    if len(found.members) == 1:
        return found.members[0].facts()
    return [
        {
            "data": name,
            "elements": member.elements,
            "size": member.size,
            "fields": {
                field: {**member.of(field).facts(), "order": _known(found.orders(field)[number])}
                for field in found.fields
            },
        }
        for number, (name, member) in enumerate(zip(found.names, found.members, strict=True))
    ]


def _known(order: float) -> float | None:
    return order if order == order else None


def _print(found: Family) -> None:
    from elvis.core.base.terminal import print_table
    from elvis.core.differences.convergence import HEADERS as ORDERS
    from elvis.core.differences.difference import HEADERS

    if len(found.members) == 1:
        print_table(HEADERS, found.members[0].cells())
    else:
        print_table(ORDERS, found.cells())


def _check(limit: float | None, found: Differences) -> None:
    """Raise ElvisError if a difference is greater than allowed, or may be: the bound counts where there is one."""
    from elvis.core.base.errors import ElvisError

    for row in found:
        greatest = row.bound if row.bound == row.bound else row.linf
        if limit is not None and not greatest <= limit:
            where = ", ".join(f"{x:.6g}" for x in row.where)
            raise ElvisError(f"--max {limit:g}: {row.field} differs by up to {greatest:.6g}, at {where}")
