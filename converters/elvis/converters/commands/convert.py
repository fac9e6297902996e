"""``elvis convert``: solver output into the native format."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from elvis.converters.commands.convert_changes import (
    extruded,
    in_other_waves,
    made_continuous,
    with_stream_function,
)
from elvis.converters.commands.field_options import field_options
from elvis.core.data.arguments import between_option, names_option, other_option, set_option, time_option
from elvis.core.data.moments import Moment

if TYPE_CHECKING:
    from elvis.core.data.dataset import Dataset
    from elvis.plugins.conversion.converting import Conversion
    from elvis.plugins.conversion.discovery import Candidate
    from elvis.plugins.conversion.plugin import Converter, Option
    from elvis.plugins.conversion.report import Report
    from elvis.plugins.data.chosen_fields import ChosenFields
    from elvis.plugins.data.data import Reading

EPILOG = """\b
Examples:
  elvis convert case.pyfrm case-01.pyfrs                    writes case.xml and case.fld
  elvis convert run.pvd -o step3 --step 3                   step3.xml and step3.fld
  elvis convert run.pvd -o between --time 0.35              coefficients interpolated between two steps
  elvis convert flow.msh -o flow.xml --tolerance 1e-6       the lowest sufficient order on each element
  elvis convert mine.dat -o mine.xml --plugin my_solver.py  with a converter of your own
  elvis convert case.h5 -o case.xml --json --max-error 1e-10
  elvis convert wing.xml wing.fld --add "Cp=2*(p-1)" --add vorticity_z -o cp.fld     quantities as fields
  elvis convert a.xml a.fld --onto b.xml -o on_b.fld                                 L2 projection onto another mesh
  elvis convert points.csv --onto b.xml --order 4 -o on_b.fld                        values at scattered points
  elvis convert a.xml a.fld --stream-function -o psi.fld                             for contours that are streamlines
  elvis convert a.xml a.fld --plane 2 -o cosine.xml                                  one plane of Fourier coefficients
  elvis convert a.xml a.fld --extrude 16 -o volume.xml                               Fourier data as volume elements
  elvis convert a.xml a.fld --add vorticity --continuous -o smooth.fld               without jumps, same integrals
  elvis convert a.xml a.fld --other b=b.xml,b.fld --add "du=u-b:u" --fields u -o du.fld
  elvis convert --list
"""

FILE = click.Path(path_type=Path)


class ConvertCommand(click.Command):
    """A command that also has the options of the installed converters."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Its own parameters, then the ones that converters declare; each name once."""
        params = super().get_params(ctx)
        taken = {name for param in params for name in param.opts}
        for name, option in _declare().items():
            if f"--{name}" not in taken:
                params.insert(-1, _parameter(option))
        return params


def _declare() -> dict[str, Option]:
    """The options of all installed converters by name."""
    from elvis.plugins.conversion.discovery import installed_converters

    found: dict[str, Option] = {}
    for candidate in installed_converters():
        for option in candidate.converter.options if candidate.converter else ():
            found.setdefault(option.name, option)
    return found


def _parameter(option: Option) -> click.Option:
    """A flag, a choice or a text; None if omitted."""
    name = "converter_" + option.name.replace("-", "_")
    text = option.help + (f"  [default: {option.default}]" if option.default else "")
    if option.choices is None:
        return click.Option([f"--{option.name}", name], is_flag=True, default=None, help=text)
    kind = click.Choice(option.choices) if option.choices else click.STRING
    return click.Option([f"--{option.name}", name], type=kind, default=None, help=text)


def _pairs(context: click.Context, parameter: click.Parameter, values: tuple[str, ...]) -> dict[str, str]:
    """``NAME=VALUE`` texts as a dictionary."""
    for value in values:
        if "=" not in value:
            raise click.BadParameter(f"expected NAME=VALUE, found {value!r}")
    return dict(value.split("=", 1) for value in values)


@click.command("convert", cls=ConvertCommand, epilog=EPILOG, short_help="Convert solver output to the native format.")
@click.argument("files", nargs=-1, type=FILE, metavar="FILES...")
@click.option(
    "--output",
    "-o",
    type=FILE,
    help="Mesh file to write, .xml; fields go next to it, .fld.  For native FILES also a single field file, .fld.  "
    "[default: the name of the first of FILES, in the current folder]",
)
@click.option("--from", "name", metavar="CONVERTER", help="Converter to use.  [default: the one that opens FILES]")
@click.option("--plugin", type=FILE, metavar="FILE.py", help="Use the converter that this Python file defines.")
@click.option("--list", "show_list", is_flag=True, help="List the converters: what each needs, preserves and loses.")
@names_option("Fields to convert, separated by commas.  [default: all]")
@field_options
@other_option
@set_option
@time_option
@between_option
@click.option(
    "--order",
    type=int,
    help="Order of all fields, or with --add of the added ones; with --tolerance the maximum.  [default: the source's]",
)
@click.option(
    "--tolerance",
    type=float,
    help="Choose the order per element: the lowest with a relative error below this.  With --add it applies to added "
    "fields that are not polynomials, by default 1e-6.",
)
@click.option(
    "--onto",
    metavar="FILE,…",
    help="Project the fields onto the elements of another mesh in L2, at --order; prints errors, integrals before and "
    "after, and the share of the mesh that is covered.  FILES may be a table of points, .csv or .pts, with columns x, "
    "y, z and values.",
)
@click.option(
    "--interpolation",
    type=click.Choice(["linear", "spline", "nearest"]),
    default="linear",
    show_default=True,
    help="Values between the points of a table: linear on Delaunay simplices, thin plate splines (cubic ones in one "
    "coordinate), or those of the nearest point.",
)
@click.option(
    "--outside",
    metavar="error|nan|nearest|VALUE",
    default="error",
    show_default=True,
    help="Treatment by --onto of points that the data don't cover.",
)
@click.option(
    "--geometry",
    type=click.Choice(["auto", "curves", "map"]),
    default="auto",
    show_default=True,
    help="Write the full map as fields: always (map), never (curves), or if curves of edges and faces lack it (auto).",
)
@click.option(
    "--pyramids",
    type=click.Choice(["exact", "native"]),
    default="exact",
    show_default=True,
    help="Write pyramids in the smallest form that contains them, or projected onto the native form.",
)
@click.option(
    "--format",
    "kind",
    type=click.Choice(["compressed", "text", "hdf5"]),
    default="compressed",
    show_default=True,
    help="File format; hdf5 writes a .nekg file next to the .xml.",
)
@click.option(
    "--max-error", type=float, help="Fail without output if a relative error beyond rounding exceeds this value."
)
@click.option(
    "--plane",
    type=click.IntRange(0),
    metavar="K",
    help="Coefficients of one plane of a Fourier direction, as plane data: 0 the mean, 2k and 2k+1 cosine and sine of "
    "wave k; numbers as in the file, unless --full rewrites single and half modes.",
)
@click.option("--mean-mode", is_flag=True, help="Mean along a Fourier direction, as plane data.")
@click.option("--zero-plane", type=click.IntRange(0), metavar="K", help="Set one plane of a Fourier direction to zero.")
@click.option(
    "--stretch",
    type=click.IntRange(1),
    metavar="N",
    help="Repeat a Fourier direction N times: the same functions in all waves of a period N times as long.",
)
@click.option("--full", is_flag=True, help="Write single and half Fourier modes as full Fourier expansions.")
@click.option(
    "--sine",
    metavar="NAMES",
    help="With --full: fields of half modes, separated by commas, whose coefficients are those of a sine, such as w "
    "next to cosines of u, v and p.",
)
@click.option(
    "--extrude",
    type=click.IntRange(1),
    metavar="N",
    help="Write a Fourier direction as N slabs of volume elements, of --order, for quantities, surfaces and programs "
    "that need these.",
)
@click.option(
    "--stream-function",
    "stream",
    is_flag=True,
    help="Add the field stream_function of a plane flow, with d(stream_function,y) = u and d(stream_function,x) = -v; "
    "prints how far its velocity is from the flow's.",
)
@click.option(
    "--continuous",
    is_flag=True,
    help="Replace each field, including added ones, by its continuous L2 projection; print the change.",
)
@click.option(
    "--smooth",
    type=click.FloatRange(0, min_open=True),
    metavar="L",
    help="Like --continuous, and reduce waves of the length l by the factor 1/(1 + (L/l)^2): a Helmholtz filter.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the report as JSON, with all digits of the numbers.")
@click.option(
    "--overwrite", is_flag=True, help="Allow outputs to replace inputs, and to replace or remove files of another mesh."
)
@click.option(
    "--reader",
    "pairs",
    multiple=True,
    metavar="NAME=VALUE",
    callback=_pairs,
    help="Option of the converter; from=NAME chooses the converter.  Repeatable.",
)
def convert(files: tuple[Path, ...], output: Path | None, show_list: bool, **options: Any) -> None:
    """Convert FILES, a solver's mesh and solution, and report the errors.

    Every converted quantity is compared with the solver's own at points that were not used for fitting: the report
    states, for the geometry and each field, whether it is exact, exact to rounding, or its error and where it occurs.

    With --add the report also covers the added quantities: exact if a quantity is a polynomial on each element, else
    projected within --tolerance.  Meshes and fields of native FILES then remain unchanged.
    """
    if show_list:
        _print_list()
        return
    context = click.get_current_context()
    if not files:
        raise click.UsageError("expected FILES to convert", context)
    place = _place(files, output)
    if place.suffix not in (".xml", ".gz", ".fld"):
        message = f"expected a name ending in .xml or .fld, found {place}; elvis export writes other formats"
        raise click.BadParameter(message, context, param_hint="'-o'")
    _convert(files, place, **options)


def _place(files: tuple[Path, ...], output: Path | None) -> Path:
    """The mesh file to write: by default named after the first file, in the current folder; .xml is added to stems."""
    if output is None:
        stem = Path(os.path.basename(os.path.abspath(files[0])).removesuffix(".gz")).stem
        return Path(f"{stem}.xml")
    return output if output.suffix or not output.name else output.with_name(f"{output.name}.xml")


def _convert(
    files: tuple[Path, ...],
    output: Path,
    kind: str,
    max_error: float | None,
    as_json: bool,
    overwrite: bool,
    continuous: bool,
    smooth: float | None,
    stream: bool,
    **options: Any,
) -> None:
    """Convert, report, and write where the errors are in bounds."""
    from elvis.core.base.errors import ElvisError
    from elvis.core.base.terminal import print_json

    waves = {key: options.pop(key) for key in ("plane", "mean_mode", "zero_plane", "stretch", "full", "sine")}
    slabs = options.pop("extrude")
    onto = options["onto"]
    more = () if onto is None else tuple(map(Path, onto.split(",")))
    _check_places(output, kind, (*files, *more), overwrite)
    if slabs is not None and (options["added"] or output.suffix == ".fld"):
        raise ElvisError("--extrude: expected no --add and a mesh file, .xml, to write; convert twice")
    order = options["order"]
    dataset, report = _results(files, is_of_fields=output.suffix == ".fld", **options)
    dataset = in_other_waves(dataset, **waves)
    if slabs is not None:
        dataset, report = extruded(dataset, slabs, order, files)
    if stream:
        dataset, report = with_stream_function(dataset, report)
    if continuous or smooth is not None:
        dataset, report = made_continuous(dataset, report, smooth or 0.0)
    if as_json:
        print_json(report.facts())
    else:
        _print_report(report)
    beyond = report.beyond(max_error) if max_error is not None else []
    if beyond:
        found = f"{beyond[0].relative:.3g} in {beyond[0].name}"
        raise ElvisError(f"{output}: not written: expected errors up to {max_error:g}, found {found}")
    _write(dataset, output, kind, overwrite, as_json)


def _check_places(output: Path, kind: str, files: tuple[Path, ...], overwrite: bool) -> None:
    """Raise ElvisError if an output can't be written, is an input or of another mesh; before any long work."""
    from elvis.core.base.errors import ElvisError
    from elvis.core.files.output import check_places
    from elvis.formats.reading import named_files
    from elvis.formats.writing import companions

    if output.suffix == ".fld":
        check_places([output], [*files, *named_files(files)], overwrite)
        return
    others = companions(output)[: 2 if kind == "hdf5" else 1]
    check_places([output, *others], [*files, *named_files(files)], overwrite)
    for other in others:
        if other.exists() and not output.exists() and not overwrite:
            raise ElvisError(
                f"{other}: not written: it exists without {output.name}, so it belongs to something else; "
                "name another output, or pass --overwrite"
            )


def _write(dataset: Dataset, output: Path, kind: str, overwrite: bool, is_silent: bool) -> None:
    """Write the files; remaining files of an earlier conversion raise an error, or are removed."""
    from elvis.core.base.errors import ElvisError
    from elvis.core.base.terminal import say, stage
    from elvis.core.files.output import Outputs
    from elvis.formats.writing import companions, write

    if output.suffix == ".fld":
        with stage(f"writing {output.name}"):
            write(dataset, field_path=output, field_format="hdf5" if kind == "hdf5" else "xml")
        if not is_silent:
            say(f"\nwrote {output}")
        return
    fields, data = companions(output)
    stale = [fields] if fields.exists() and not dataset.fields else []
    if data.exists() and kind != "hdf5" and output.exists():
        stale.append(data)
    if stale and not overwrite:
        raise ElvisError(
            f"{stale[0]}: it belongs to the existing {output.name}, and this output would not replace it: "
            "remove it, or pass --overwrite"
        )
    formats: dict[str, Any] = {"mesh_format": kind, "field_format": "hdf5" if kind == "hdf5" else "xml"}
    with stage(f"writing {output.name}"), Outputs() as outputs:
        for file in stale:
            outputs.remove(file)
        written = write(dataset, output, outputs=outputs, **formats)
    if not is_silent:
        say(f"\nwrote {' and '.join(map(str, written))}")


def _results(
    files: tuple[Path, ...],
    is_of_fields: bool,
    added: tuple[str, ...],
    renames: tuple[str, ...],
    others: tuple[str, ...],
    reference: dict[str, float],
    onto: str | None,
    outside: str,
    interpolation: str,
    **options: Any,
) -> tuple[Dataset, Report]:
    """The data to write before they are made continuous, and the errors of the conversion and of added quantities.

    Writing only fields requires native files.
    """
    from elvis.core.base.errors import ElvisError
    from elvis.formats.reading import is_native
    from elvis.plugins.data.chosen_fields import ChosenFields
    from elvis.plugins.data.data import Reading

    named = Reading(others=others, reference=reference)
    if onto is not None:
        if added or renames or others or options["tolerance"] is not None:
            raise ElvisError("--onto: expected no --add, --rename, --other and --tolerance; convert twice")
        return _projected(files, tuple(map(Path, onto.split(","))), outside, interpolation, options)
    if not (added or renames or others or is_of_fields):
        conversion = _converted(files, **options)
        return conversion.dataset, conversion.report
    fields = options.pop("fields")
    wanted = None if fields is None else tuple(part.strip() for part in fields.split(","))
    order, tolerance = options.pop("order"), options.pop("tolerance")
    chosen = ChosenFields(added, renames, wanted, order, tolerance)
    if (order is not None or tolerance is not None) and not added:
        raise ElvisError("--order and --tolerance: expected quantities that --add names, found none")
    if all(map(is_native, files)) and _is_plain(options):
        return _with_fields(files, chosen, named, options, is_of_fields)
    if is_of_fields:
        raise ElvisError("-o: expected a name ending in .xml, as the mesh is converted, found one ending in .fld")
    return _converted_with_fields(files, chosen, named, options)


def _projected(
    files: tuple[Path, ...], onto: tuple[Path, ...], outside: str, interpolation: str, options: dict[str, Any]
) -> tuple[Dataset, Report]:
    """The fields, or the values of a table of points, on the mesh of other files."""
    from elvis.core.base.terminal import note
    from elvis.plugins.data.data import Reading, dataset_of
    from elvis.plugins.fourier.onto_waves import onto_any_mesh
    from elvis.plugins.transfers.onto_mesh import report_of_transfer
    from elvis.plugins.transfers.scattered_points import is_point_table, points_onto_mesh

    fields = options["fields"]
    names = None if fields is None else [part.strip() for part in fields.split(",")]
    target = dataset_of(onto, Reading())
    if is_point_table(files):
        for remark in target.remarks:
            note(remark)
        return points_onto_mesh(files[0], target, options["order"], outside, interpolation, names)
    asked = dict(options["pairs"])
    if options["name"] is not None:
        asked["from"] = options["name"]
    moment = Moment(time=options["time"], between=options["between"])
    plugin = None if options["plugin"] is None else str(options["plugin"])
    source = dataset_of(files, Reading(plugin, asked, moment=moment))
    for remark in (*source.remarks, *target.remarks):
        note(remark)
    found = onto_any_mesh(source, target, options["order"], outside, names)
    return found.dataset, report_of_transfer(found, (*files, *onto))


def _is_plain(options: dict[str, Any]) -> bool:
    """Whether no option requests a conversion of a mesh."""
    settings: dict[str, object] = {"name": None, "plugin": None, "pairs": {}, "geometry": "auto", "pyramids": "exact"}
    own = {key: value for key, value in options.items() if key.startswith("converter_") and value is not None}
    return not own and all(options[key] == value for key, value in settings.items())


def _with_fields(
    files: tuple[Path, ...],
    chosen: ChosenFields,
    named: Reading,
    options: dict[str, Any],
    is_of_fields: bool,
) -> tuple[Dataset, Report]:
    """Native data with further fields, whose own mesh and coefficients stay."""
    from elvis.core.base.terminal import note
    from elvis.plugins.data.added_quantities import report_of_quantities
    from elvis.plugins.data.chosen_fields import orders_that_are_cut
    from elvis.plugins.data.data import dataset_of

    moment = Moment(time=options["time"], between=options["between"])
    dataset = dataset_of(files, replace(named, moment=moment))
    for remark in dataset.remarks:
        note(remark)
    found, measures = chosen.of(dataset)
    for sentence in (*found.remarks[len(dataset.remarks) :], *(orders_that_are_cut(found) if is_of_fields else ())):
        note(sentence)
    return found, report_of_quantities(found, measures, files)


def _converted_with_fields(
    files: tuple[Path, ...], chosen: ChosenFields, named: Reading, options: dict[str, Any]
) -> tuple[Dataset, Report]:
    """Converted data with further fields."""
    from elvis.core.base.terminal import note
    from elvis.plugins.data.others import Others

    conversion = _converted(files, fields=None, order=None, tolerance=None, **options)
    source = Others(named, files).beside(conversion.dataset)
    dataset, measures = chosen.of(source)
    for remark in dataset.remarks[len(source.remarks) :]:
        note(remark)
    return dataset, chosen.reported(conversion.report, measures)


def _converted(
    files: tuple[Path, ...],
    name: str | None,
    plugin: Path | None,
    fields: str | None,
    pairs: dict[str, str],
    time: float | None,
    between: str,
    **options: Any,
) -> Conversion:
    """The converted data; options that begin with ``converter_`` are the converter's."""
    from elvis.core.base.terminal import stage
    from elvis.plugins.conversion.converting import Settings
    from elvis.plugins.conversion.converting import convert as convert_source
    from elvis.plugins.conversion.discovery import choose_converter, in_file, installed_converters, with_defaults

    name = pairs.pop("from", name)
    own = {key: value for key, value in options.items() if not key.startswith("converter_")}
    names = None if fields is None else tuple(part.strip() for part in fields.split(","))
    settings = Settings(fields=names, **own)
    given = {
        key.removeprefix("converter_").replace("_", "-"): value
        for key, value in options.items()
        if key.startswith("converter_") and value is not None
    }
    with stage(f"reading {', '.join(file.name for file in files)}"):
        if time is not None:
            source = _moment(files, name, plugin, {**given, **pairs}, Moment(time=time, between=between))
        else:
            found = choose_converter(in_file(plugin) if plugin else installed_converters(), files, name).converter
            assert found is not None
            source = found(files, **with_defaults(found, {**given, **pairs}))
    return convert_source(source, settings, files)


def _moment(
    files: tuple[Path, ...], name: str | None, plugin: Path | None, options: dict[str, str], moment: Moment
) -> Converter:
    """A moment of a series, in the native form of its steps; print a note on how it was computed."""
    from elvis.converters.native import Native
    from elvis.core.base.terminal import note
    from elvis.plugins.data.data import Reading, dataset_of

    composites = options.pop("composites", None)
    asked = {**options, **({} if name is None else {"from": name})}
    dataset = dataset_of(files, Reading(None if plugin is None else str(plugin), asked, False, moment))
    for remark in dataset.remarks:
        note(remark)
    return Native.of(dataset, composites)


def _print_report(report: Report) -> None:
    from elvis.core.base.terminal import print_table, say
    from elvis.plugins.conversion.report import HEADERS

    counts = ", ".join(f"{count} {label}" for label, count in report.elements.items())
    say(f"{report.converter}: {counts}\n")
    print_table(HEADERS, report.rows())
    for sentence in report.sentences():
        say(f"\nnote: {sentence}")


def _print_list() -> None:
    from elvis.core.base.terminal import print_table
    from elvis.plugins.conversion.discovery import installed_converters

    print_table(("name", "reads", "state", "keeps", "loses"), [_row(candidate) for candidate in installed_converters()])


def _row(candidate: Candidate) -> tuple[str, ...]:
    if candidate.converter is None:
        return candidate.name, "", candidate.fault or "", "", ""
    state = f"needs {', '.join(candidate.missing)}" if candidate.missing else "ready"
    return candidate.name, candidate.converter.format, state, candidate.converter.keeps, candidate.converter.loses
