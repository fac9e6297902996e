"""``elvis extract``: boundaries, cuts and isosurfaces as data for other programs."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from elvis.core.base.errors import ElvisError
from elvis.core.base.rounded_up import rounded_up
from elvis.core.data.arguments import (
    between_option,
    cache_option,
    complex_options,
    deform_options,
    named_expressions,
    other_option,
    overwrite_option,
    reader_option,
    set_option,
    step_option,
    time_option,
)
from elvis.core.data.axis_planes import box_of, point_and_normal

if TYPE_CHECKING:
    from collections.abc import Sequence

    from elvis.core.base.arrays import Floats
    from elvis.core.data.complex_fields import ComplexChoice
    from elvis.core.data.dataset import Dataset
    from elvis.core.deformed.deformation import Deformation
    from elvis.core.triangles import LevelLines, SurfaceTriangles

EPILOG = """\b
Examples:
  elvis extract wing.xml wing.fld --isosurface q_criterion=0.5 --field p -o vortex.ply
  elvis extract wing.xml wing.fld --plane 0,0.5,0:0,1,0 --field p -o cut.vtp
  elvis extract wing.xml wing.fld --cut sphere:0.5,0.5,0.5:0.3 --tolerance 1e-3 -o ball.stl
  elvis extract wing.xml wing.fld --boundary all --field p -o skin.xml                  a native surface mesh, exact
  elvis extract wing.xml wing.fld --boundary all --field "shear=wall_shear(mu=2e-4)" -o skin.vtu
  elvis extract wing.xml --boundary all --clip plane:0,0.5,0:0,1,0 -o half.stl
  elvis extract wing.xml wing.fld --isosurface p=-0.3 --order 2 -o iso.vtu                  curved triangles
  elvis extract cylinder.xml cylinder.fld --isosurface u=0.5 --field p -o isoline.vtp
  elvis extract wing.xml wing.fld --streamlines random:50 --clip sphere:0,0,1:1 --field p -o lines.vtp
"""

FILE = click.Path(path_type=Path)
#: suffixes of surfaces with their own elements
_MESHES = (".xml", ".vtu", ".msh")
#: suffixes of lines
_LINES = (".vtp", ".vtu")


@click.command("extract", epilog=EPILOG, short_help="Write boundaries as data, cuts and isosurfaces as triangles.")
@click.argument("data", nargs=-1, required=True, type=FILE, metavar="DATA...")
@click.option(
    "--output",
    "-o",
    type=FILE,
    required=True,
    help="File to write: triangles as .stl, .ply, .obj, .glb or .vtp; a boundary with its own elements also as .xml "
    "(fields go next to it, .fld), .vtu or .msh, and so with --order other surfaces; a plane across a Fourier "
    "direction also as .xml; streamlines as .vtp, .csv or .npz; cuts and isolines of 2D data as .vtp or .vtu.",
)
@click.option("--boundary", multiple=True, metavar="NAME", help="Name of a boundary, or all for all outer faces.")
@click.option(
    "--plane",
    multiple=True,
    metavar="P:N|z=V|z",
    help="Plane through P with normal N, such as 0,0,0.5:0,0,1, or z=0.5.",
)
@click.option(
    "--cut",
    multiple=True,
    metavar="SURFACE",
    help="Surface such as sphere:C:R, cylinder:P:A:R, or an equation, x*y=0.1.",
)
@click.option("--isosurface", multiple=True, metavar="Q=V", help="Isosurface of quantity Q at value V.")
@click.option(
    "--streamlines",
    "seeds",
    multiple=True,
    metavar="SEEDS",
    help="Streamlines of the velocity from seeds, such as random:50 (see elvis help geometry); elvis trace has more "
    "options.  Repeatable.",
)
@click.option(
    "--field",
    "-f",
    "quantities",
    multiple=True,
    metavar="[NAME=]EXPR",
    help="Field or quantity to write on the surface.  Repeatable.  [default: all fields]",
)
@click.option(
    "--tolerance",
    type=float,
    help="Maximum distance of triangles from the exact surface.  [default: 1/1000 of the size of the data]",
)
@click.option(
    "--order",
    type=click.IntRange(2, 10),
    help="Curved triangles of this order with all nodes on the surface, as .vtu, .msh or .xml; .vtp files hold only "
    "flat ones.  [default: flat triangles]",
)
@click.option(
    "--clip",
    "clips",
    multiple=True,
    metavar="SURFACE",
    help="Remove the parts of triangles and lines inside plane:P:N, sphere:C:R or cylinder:P:A:R, or where an "
    "expression of coordinates is below a value, such as x*y=0.1; outside:SURFACE removes those outside.  Repeatable.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON, with all digits of the numbers.")
@reader_option
@step_option
@time_option
@between_option
@other_option
@set_option
@deform_options
@complex_options
@cache_option
@overwrite_option
def extract(
    data: tuple[Path, ...],
    output: Path,
    reader: tuple[str, ...],
    step: int | None,
    time: float | None,
    between: str,
    others: tuple[str, ...],
    reference: dict[str, float],
    deformation: Deformation | None,
    complexes: ComplexChoice,
    no_cache: bool,
    overwrite: bool,
    **options: Any,
) -> None:
    """Write a surface of DATA, a boundary, a cut or an isosurface, or streamlines.

    Triangles have their corners on the exact surface and lie within --tolerance of it, by bounds on second derivatives
    if the quantity is a smooth function of polynomials on each element, else by an estimate.  The same holds for their
    outlines at the border of the domain.  Triangles meet without gaps inside elements and across elements on which the
    quantity is continuous.  In 2D data the same holds for lines of cuts and isolines.  A boundary with its own elements
    is exact: its curved faces and fields are those of the volume.  Quantities of the volume behind a boundary, such as
    wall_shear, are projected onto it, and the errors are printed.
    """
    from elvis.core.base.terminal import note
    from elvis.core.data.moments import Moment
    from elvis.core.files.output import check_places
    from elvis.plugins.data.data import Reading, dataset_of, pairs

    surface = _surface({key: options.pop(key) for key in ("boundary", "plane", "cut", "isosurface", "seeds")})
    is_mesh = _check_output(output, surface, options)
    read = [*data, *(Path(text) for text in surface[1].split("\n") if Path(text).is_file())]
    check_places([output, output.with_suffix(".fld")] if output.suffix == ".xml" else [output], read, overwrite)
    reading = Reading(None, pairs(reader), not no_cache, Moment(step, time, between), others)
    reading = replace(reading, reference=reference, deformation=deformation, complexes=complexes)
    dataset = dataset_of(data, reading)
    for remark in dataset.remarks:
        note(remark)
    _write(dataset, surface, is_mesh, output, options)


def _write(dataset: Dataset, surface: tuple[str, str], is_mesh: bool, output: Path, options: dict[str, Any]) -> None:
    """Write a surface or lines in the form that the options request."""
    kind, name = surface
    order = options.pop("order")
    if order is not None:
        _write_curved(dataset, name, output, order, **options)
    elif is_mesh and kind == "plane":
        _write_plane(dataset, name.removeprefix("plane:"), output, options["quantities"], options["as_json"])
    elif is_mesh:
        _write_mesh(dataset, name, output, options["quantities"], options["as_json"])
    elif dataset.mesh.dimension == 2 and kind != "boundary" and kind != "seeds":
        _write_level_lines(dataset, name, output, **options)
    elif dataset.mesh.dimension == 2 and kind == "boundary":
        known = ", ".join(_MESHES)
        raise ElvisError(f"{output}: expected a name ending in {known}, as boundaries of 2D data are lines")
    elif kind == "seeds":
        _write_lines(dataset, name.split("\n"), output, options["quantities"], options["clips"])
    else:
        _write_triangles(dataset, surface, output, **options)


def _surface(named: dict[str, Any]) -> tuple[str, str]:
    """The kind of the requested surface or lines, and its name; seeds are separated by line ends."""
    seeds = named.pop("seeds")
    given = [(key, text) for key, texts in named.items() for text in texts]
    if seeds:
        given.append(("seeds", "\n".join(seeds)))
    if len(given) != 1:
        raise click.UsageError("expected one of --boundary, --plane, --cut, --isosurface and --streamlines, once")
    ((kind, text),) = given
    if kind == "seeds":
        return kind, text
    if kind == "isosurface" and "=" not in text:
        raise click.BadParameter(f"expected Q=V, such as p=0.5, found {text!r}", param_hint="'--isosurface'")
    return kind, f"plane:{text}" if kind == "plane" else text


def _check_output(output: Path, surface: tuple[str, str], options: dict[str, Any]) -> bool:
    """Whether a boundary, or a plane of Fourier data, keeps its own elements.

    Raises ElvisError for an unsuitable name.
    """
    from elvis.converters.tables.triangles import SUFFIXES, check_name
    from elvis.core.streamlines.lines.files import check_suffix

    if options["order"] is not None:
        _check_curved(output, surface, options)
        return True
    if surface[0] == "seeds":
        check_suffix(output)
        if options["tolerance"] is not None or options["as_json"]:
            raise ElvisError("--streamlines: expected no --tolerance and no --json")
        return False
    is_plane = surface[0] == "plane" and output.suffix == ".xml"
    if is_plane or (surface[0] == "boundary" and output.suffix in _MESHES):
        if options["tolerance"] is not None or options["clips"]:
            raise ElvisError(
                f"{output}: --tolerance and --clip are for triangles, found a name ending in {output.suffix}"
            )
        return True
    if output.suffix == ".vtu":
        # lines of 2D data
        return False
    if output.suffix not in SUFFIXES:
        known = (*SUFFIXES, *(_MESHES if surface[0] == "boundary" else ()))
        raise click.BadParameter(f"expected a name ending in {', '.join(known)}, found {output}", param_hint="'-o'")
    check_name(output)
    return False


def _check_curved(output: Path, surface: tuple[str, str], options: dict[str, Any]) -> None:
    """Raise ElvisError for surfaces and names of files that curved triangles cannot have."""
    if surface[0] in ("boundary", "seeds") or options["clips"]:
        raise ElvisError("--order: expected --plane, --cut or --isosurface, without --clip")
    if output.suffix not in _MESHES:
        raise ElvisError(f"{output}: expected a name ending in {', '.join(_MESHES)} for curved triangles")


def _named(dataset: Dataset, texts: tuple[str, ...]) -> dict[str, str]:
    """Expressions by their names; without texts, all fields."""
    return named_expressions(texts or tuple(dataset))


def _write_lines(
    dataset: Dataset, seeds: Sequence[str], output: Path, texts: tuple[str, ...], clips: tuple[str, ...]
) -> None:
    """Trace streamlines and write what the clips leave of them."""
    from dataclasses import replace

    from elvis.core.base.terminal import print_table, say, stage
    from elvis.core.streamlines import trace
    from elvis.core.streamlines.clipped_lines import clipped_lines
    from elvis.core.streamlines.lines.files import write_lines

    named = _named(dataset, texts) if texts else {}
    with stage("following lines"):
        found = trace(dataset, list(seeds), fields=list(named.values()))
    if not len(found.points):
        raise ElvisError(f"all {len(found)} seeds lie outside the mesh")
    for clip in clips:
        found = clipped_lines(found, dataset, clip)
    found = replace(found, values={name: found.values[text] for name, text in named.items()})
    write_lines(output, found, {"seed": found.seed, "end": found.end})
    print_table(("end", "meaning", "lines"), found.table())
    say(f"\n{output}: {len(found)} lines with {len(found.points):,} points")


def _write_level_lines(
    dataset: Dataset,
    curve: str,
    output: Path,
    quantities: tuple[str, ...],
    tolerance: float | None,
    clips: tuple[str, ...],
    as_json: bool,
) -> None:
    """Find the lines of a curve in 2D data and write them."""
    from elvis.core.base.terminal import note, print_json, say, stage
    from elvis.core.triangles import level_lines
    from elvis.core.triangles.clipped import clipped_lines_of_level
    from elvis.core.triangles.surface_triangles import default_tolerance

    if any(block.expansion.homogeneous for own in dataset.fields for block in own.blocks):
        raise ElvisError(f"{curve}: expected no Fourier direction; elvis convert --extrude makes volume elements of it")
    if output.suffix not in _LINES:
        known = " or ".join(_LINES)
        raise ElvisError(f"{output}: expected a name ending in {known}, as {curve} meets 2D data in lines")
    named = _named(dataset, quantities)
    with stage(f"lines of {curve}"):
        found = level_lines(dataset, curve, list(named.values()), tolerance)
        for clip in clips:
            found = clipped_lines_of_level(found, dataset, clip, default_tolerance(dataset, tolerance))
    number = _save_lines(found, {name: found.values[text] for name, text in named.items()}, output)
    for sentence in found.remarks:
        note(sentence)
    if as_json:
        facts = {"lines": number, "segments": len(found.lines), "length": found.length}
        print_json({**facts, "distance": found.distance, "is_bound": found.is_bound})
        return
    count = f"{len(found.lines):,} segments of {number} line{'s' if number > 1 else ''}"
    far = f"within {rounded_up(found.distance)} of the curve" + ("" if found.is_bound else ", an estimate")
    say(f"{output}: {count}, {far}; length {found.length:.10g}")


def _save_lines(found: LevelLines, values: dict[str, Floats], output: Path) -> int:
    """Write lines with values at their points; return how many lines there are."""
    from elvis.core.files.polydata import write_polylines
    from elvis.plugins.conversion.arrays import from_arrays

    rows, offsets = found.joined()
    if output.suffix == ".vtp":
        write_polylines(output, found.points[rows], offsets, {name: own[rows] for name, own in values.items()}, {})
    else:
        ends = {name: own[found.lines] for name, own in values.items()}
        _save_mesh(from_arrays({"segment": found.points[found.lines]}, ends), output)
    return len(offsets) - 1


def _write_triangles(
    dataset: Dataset,
    surface: tuple[str, str],
    output: Path,
    quantities: tuple[str, ...],
    tolerance: float | None,
    clips: tuple[str, ...],
    as_json: bool,
) -> None:
    """Find the triangles and write them."""
    from dataclasses import replace

    from elvis.converters.tables.triangles import export_triangles
    from elvis.core.base.terminal import note, stage
    from elvis.core.triangles import boundary_triangles, clipped, level_triangles
    from elvis.core.triangles.surface_triangles import default_tolerance

    named = _named(dataset, quantities)
    find = boundary_triangles if surface[0] == "boundary" else level_triangles
    with stage(f"triangles of {surface[1]}"):
        found = find(dataset, surface[1], list(named.values()), tolerance)
        for clip in clips:
            found = clipped(found, dataset, clip, default_tolerance(dataset, tolerance))
    found = replace(found, values={name: found.values[text] for name, text in named.items()})
    for sentence in (*found.remarks, *export_triangles(found, output)):
        note(sentence)
    _tell(found, output, as_json)


def _write_curved(
    dataset: Dataset,
    surface: str,
    output: Path,
    order: int,
    quantities: tuple[str, ...],
    tolerance: float | None,
    as_json: bool,
    **_: Any,
) -> None:
    """Find curved triangles and write them as data with their own elements."""
    from elvis.core.base.terminal import print_json, say, stage
    from elvis.core.shapes import Shape
    from elvis.core.triangles.curved_triangles import curved_triangles
    from elvis.plugins.conversion.arrays import from_arrays

    named = _named(dataset, quantities)
    with stage(f"triangles of {surface}"):
        found = curved_triangles(dataset, surface, order, list(named.values()), tolerance)
        values = {name: found.values[text] for name, text in named.items()}
        reference = {"triangle": found.weights @ Shape.TRIANGLE.vertices}
        made = from_arrays({"triangle": found.points}, values, reference=reference)
    _save_mesh(made, output)
    if as_json:
        print_json({"triangles": len(found.points), "order": order, "distance": found.distance, "is_bound": False})
        return
    far = f"within {rounded_up(found.distance)} of the surface, an estimate"
    say(f"{output}: {len(found.points):,} triangles of order {order}, {far}")


def _tell(found: SurfaceTriangles, output: Path, as_json: bool) -> None:
    """Print a summary of the written file."""
    from elvis.core.base.terminal import print_json, say

    if as_json:
        facts = {"triangles": len(found.triangles), "points": len(found.points), "area": found.area}
        print_json({**facts, "distance": found.distance, "is_bound": found.is_bound})
        return
    far = f"within {rounded_up(found.distance)} of the surface" + ("" if found.is_bound else ", an estimate")
    say(f"{output}: {len(found.triangles):,} triangles, {far}; area {found.area:.10g}")


def _write_mesh(dataset: Dataset, boundary: str, output: Path, texts: tuple[str, ...], as_json: bool) -> None:
    """Write a boundary with its own elements."""
    from elvis.core.base.terminal import note, print_json, print_table, say
    from elvis.plugins.conversion.report import HEADERS
    from elvis.plugins.data.boundary_data import convert_boundary

    fields = [text for text in texts if text in dataset] if texts else None
    quantities = [text for text in texts if text not in dataset]
    conversion = convert_boundary(dataset, boundary, quantities, fields)
    if as_json:
        print_json(conversion.report.facts())
    else:
        print_table(HEADERS, conversion.report.rows())
    for sentence in conversion.report.sentences():
        note(sentence)
    _save_mesh(conversion.dataset, output)
    if not as_json:
        say(f"\nwrote {output}")


def _save_mesh(dataset: Dataset, output: Path) -> None:
    """Write data with their own elements in the format of the suffix."""
    from elvis.core.base.terminal import note
    from elvis.formats.writing import write
    from elvis.plugins.conversion.exporting import exporter

    if output.suffix == ".xml":
        write(dataset, output)
        return
    for sentence in exporter(output.suffix[1:])(dataset, None, None, output, lambda losses: None):
        note(f"{output.name}: {sentence}")


def _write_plane(dataset: Dataset, text: str, output: Path, texts: tuple[str, ...], as_json: bool) -> None:
    """Write a plane across the Fourier direction of data as plane data."""
    from dataclasses import replace

    from elvis.converters.tables.triangles import SUFFIXES
    from elvis.core.base.terminal import say
    from elvis.formats.writing import write
    from elvis.plugins.fourier.planes import fourier_plane

    if not any(block.expansion.homogeneous for own in dataset.fields for block in own.blocks):
        known = ", ".join(SUFFIXES)
        raise ElvisError(f"{output}: expected a name ending in {known}, as the data have no Fourier direction")
    axis, place = _across(point_and_normal(text, partial(box_of, dataset)))
    found = fourier_plane(dataset, axis, place)
    unknown = [name for name in texts if name not in dataset]
    if unknown or as_json:
        raise ElvisError(f"{output}: expected names of fields and no --json, found {', '.join(unknown) or '--json'}")
    if texts:
        found = replace(found, fields=tuple(own for own in found.fields if own.name in texts))
    say(f"wrote {' and '.join(map(str, write(found, output)))}")


def _across(text: str) -> tuple[str, float]:
    """The axis that a plane is at right angles to, and where it cuts it; raises ElvisError for a plane across none."""
    from elvis.core.data.arguments import triples

    try:
        point, normal = triples(text, 2)
    except (ValueError, click.BadParameter):
        raise ElvisError(f"--plane: expected P:N or z=0.5, found {text!r}") from None
    axes = [axis for axis, own in enumerate(normal) if own]
    if len(axes) != 1:
        raise ElvisError(f"--plane: expected a plane across an axis for a name ending in .xml, found {text}")
    return "xyz"[axes[0]], point[axes[0]]
