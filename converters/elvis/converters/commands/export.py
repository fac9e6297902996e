"""``elvis export``: native data into files that other programs open."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from elvis.converters.commands.field_options import field_options
from elvis.core.data.arguments import (
    between_option,
    cache_option,
    complex_options,
    deform_options,
    other_option,
    overwrite_option,
    reader_and_names_option,
    set_option,
    step_option,
    time_option,
)

if TYPE_CHECKING:
    from elvis.core.data.complex_fields import ComplexChoice
    from elvis.core.data.dataset import Dataset
    from elvis.core.deformed.deformation import Deformation
    from elvis.plugins.conversion.exporting import Loss
    from elvis.plugins.data.chosen_fields import ChosenFields

EPILOG = """\b
Examples:
  elvis export wing.xml wing.fld -o wing.vtu              Lagrange cells, for ParaView
  elvis export wing.xml wing.fld -o wing.msh --fields p   for Gmsh
  elvis export wing.xml wing.fld -o cp.vtu --add "Cp=2*(p-1)" --add q_criterion
  elvis export wing.xml wing.fld -o wing.plt --order 8    for Tecplot, 8 linear cells a side in each element
  elvis export wing.xml wing.fld -o points.csv            values at Gauss points of every element
"""

FILE = click.Path(path_type=Path)

#: relative errors up to here are rounding
_ROUNDING = 1e-11


@click.command("export", epilog=EPILOG, short_help="Write data as VTK, Gmsh or Tecplot files, or as points.")
@click.argument("data", nargs=-1, required=True, type=FILE, metavar="DATA...")
@click.option(
    "--output",
    "-o",
    type=FILE,
    required=True,
    help="File to write: .vtu for VTK, .msh for Gmsh, .dat or .plt for Tecplot, .csv or .pts for points.",
)
@click.option(
    "--order",
    type=click.IntRange(1, 30),
    help="Order of all cells; for Tecplot, whose cells are linear, their number a side.  [default: that of map and "
    "fields]",
)
@click.option(
    "--max-error", type=float, help="Fail without output if a relative error beyond rounding exceeds this value."
)
@click.option("--json", "as_json", is_flag=True, help="Print the errors as JSON, with all digits of the numbers.")
@field_options
@click.option(
    "--tolerance",
    type=float,
    default=1e-6,
    show_default=True,
    help="Error tolerance for added quantities that are not polynomials.",
)
@other_option
@set_option
@deform_options
@complex_options
@reader_and_names_option
@step_option
@time_option
@between_option
@cache_option
@overwrite_option
def export(
    data: tuple[Path, ...],
    output: Path,
    order: int | None,
    max_error: float | None,
    as_json: bool,
    added: tuple[str, ...],
    renames: tuple[str, ...],
    tolerance: float,
    others: tuple[str, ...],
    reference: dict[str, float],
    deformation: Deformation | None,
    complexes: ComplexChoice,
    reader: tuple[str, ...],
    step: int | None,
    time: float | None,
    between: str,
    no_cache: bool,
    overwrite: bool,
) -> None:
    """Write DATA, files of any format, as cells with values at nodes, and report the errors.

    Each element becomes one cell of the lowest order that contains its map and its fields, up to order 10 in VTK and 9
    in Gmsh.  Pyramids become hexahedra whose upper face is the apex, on which their functions are polynomials.  Notes
    list boundaries, regions and metadata that the format can't store.

    Tecplot files hold linear cells, --order of them a side in each element, in text (.dat) or binary (.plt).  Tables of
    points (.csv, and .pts of Nektar++) hold the values at Gauss points of every element, which determine the fields.
    """
    from functools import partial

    from elvis.core.base.terminal import note
    from elvis.core.data.moments import Moment
    from elvis.core.files.output import check_places
    from elvis.plugins.command.registry import plugins
    from elvis.plugins.conversion.exporting import GROUP, exporter
    from elvis.plugins.data.chosen_fields import ChosenFields
    from elvis.plugins.data.data import Reading, dataset_of, pairs

    _check_suffix(output, sorted(f".{name}" for name in plugins(GROUP)))
    check_places([output], data, overwrite)
    options = pairs(reader)
    fields = options.pop("fields", None) if added else None
    chosen = ChosenFields(added, renames, _names(fields), tolerance=tolerance)
    moment = Moment(step, time, between)
    reading = Reading(
        None, options, not no_cache, moment, others, reference=reference, deformation=deformation, complexes=complexes
    )
    dataset = dataset_of(data, reading)
    found = _with_chosen(chosen, dataset)
    report = partial(_report, path=output, bound=max_error, as_json=as_json)
    for sentence in exporter(output.suffix[1:])(found, None, order, output, report):
        note(f"{output.name}: {sentence}")


def _with_chosen(chosen: ChosenFields, dataset: Dataset) -> Dataset:
    """A dataset with the chosen fields, in slabs if it has waves; prints remarks and the errors of these as notes."""
    from elvis.core.base.terminal import note
    from elvis.plugins.fourier.planes import has_waves
    from elvis.plugins.fourier.slabs import in_slabs

    for remark in dataset.remarks:
        note(remark)
    found, measures = chosen.of(dataset)
    for sentence in (*(own.sentence() for own in measures), *found.remarks[len(dataset.remarks) :]):
        note(sentence)
    if not has_waves(found):
        return found
    conversion = in_slabs(found)
    note("the Fourier direction is written as slabs of volume elements, to which the errors below refer")
    for measure in conversion.report.fields:
        note(measure.sentence())
    return conversion.dataset


def _check_suffix(output: Path, suffixes: Sequence[str]) -> None:
    if output.suffix not in suffixes:
        known = f"{', '.join(suffixes[:-1])} or {suffixes[-1]}"
        raise click.BadParameter(f"expected a name ending in {known}, found {output}", param_hint="'-o'")


def _names(fields: str | None) -> tuple[str, ...] | None:
    """Names with commas between them; None for all."""
    return None if fields is None else tuple(map(str.strip, fields.split(",")))


def _report(losses: Sequence[Loss], path: Path, bound: float | None, as_json: bool) -> None:
    """Print the losses; raise ElvisError if they exceed the limit."""
    from elvis.core.base.errors import ElvisError
    from elvis.core.base.terminal import print_json, print_table

    if as_json:
        facts = [
            {"name": each.name, "order": each.order, "error": each.error, "relative": each.relative,
             "element": each.element} for each in losses
        ]  # fmt: skip
        print_json({"losses": facts})
    else:
        rows = [_row(each) for each in losses]
        print_table(("quantity", "order", "state", "largest error", "of the range", "in element"), rows)
    beyond = [each for each in losses if bound is not None and not each.is_within(bound)]
    if beyond:
        worst = max(beyond, key=lambda each: each.relative)
        found_text = f"{worst.relative:.3g} in {worst.name}"
        raise ElvisError(f"{path}: not written: expected errors up to {bound:g}, found {found_text}")


def _row(loss: Loss) -> tuple[object, ...]:
    state = "exact" if loss.is_within(_ROUNDING) else "interpolated"
    return loss.name, loss.order, state, f"{loss.error:.3g}", f"{loss.relative:.3g}", loss.element
