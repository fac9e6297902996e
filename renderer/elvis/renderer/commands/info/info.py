"""``elvis info``: the contents of a dataset."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from elvis.core.base.ranks import Ranks, is_idle
from elvis.core.data.arguments import field_option, json_option, top_modes_option
from elvis.plugins.command.running import shared
from elvis.renderer.commands.info.extrema import print_extrema
from elvis.renderer.commands.info.quality import print_quality
from elvis.renderer.commands.info.resolution import print_resolution, print_resolution_over_time
from elvis.renderer.commands.info.tables import print_facts, print_opened, shortened
from elvis.renderer.commands.info.waves import print_waves
from elvis.renderer.commands.sources import Data, NativeSource, Source, data_options, native_source

if TYPE_CHECKING:
    from elvis.core.data.dataset import Dataset
    from elvis.formats.strict.finding import Finding
    from elvis.plugins.series.series import Series

Facts = dict[str, Any]

#: rows of a table that may grow without bound; --all and --json show the rest
_MANY = 20


EPILOG = """\b
Examples:
  elvis info wing.xml wing.fld
  elvis info --json wing.xml wing.fld >facts.json
  elvis info --strict wing.xml wing.fld
  elvis info --jacobian wing.xml
  elvis info wing.xml wing.fld --field vorticity
  elvis info wing.xml wing.fld --field "distance(wall)"
  elvis info wing.xml wing.fld --quantities
  elvis info wing.xml wing.fld --extrema --field p --field speed
  elvis info wing.xml wing.fld --critical
  elvis info wing.xml wing.fld --critical --wall wing
  elvis info wing.xml wing.fld --resolution --field p
  elvis info wing.xml wing.fld --quality
  elvis info beam.xml beam.fld --deform u,v,w --largest-scale
  elvis info wing.xml wing_*.chk
  elvis info wing.xml wing_*.chk --time 0.25
"""


#: facts for which all elements are taken together
_OF_THE_WHOLE = ("resolution", "quality", "waves")


@click.command("info", epilog=EPILOG, short_help="Describe a dataset: shapes, orders, fields, ranges, validity.")
@field_option
@json_option
@click.option("--all", "everything", is_flag=True, help="Print long tables in full.")
@click.option(
    "--strict",
    is_flag=True,
    help="Check the rules that others impose on the format; fail if a required one is broken.",
)
@click.option("--jacobian", is_flag=True, help="Prove that the Jacobian is positive everywhere; fail if it isn't.")
@click.option(
    "--quantities",
    "predefined",
    is_flag=True,
    help="List the predefined quantities, and what is missing for each in these data.",
)
@click.option("--extrema", is_flag=True, help="Find certified minima and maxima of quantities, with positions.")
@top_modes_option
@click.option(
    "--critical",
    is_flag=True,
    help="Find and classify all critical points (zeros of the velocity) in the interior; --field, repeated, gives the "
    "components of another vector.",
)
@click.option(
    "--resolution",
    is_flag=True,
    help="Estimate how well fields are resolved: decay of their modes, effect of one order less, the worst elements, "
    "and advice.",
)
@click.option(
    "--quality",
    is_flag=True,
    help="Measure the shapes and sizes of elements, list the worst, and give the time step of CFL number 1.",
)
@click.option("--waves", is_flag=True, help="Energy of each field in each wave of a Fourier direction, exact.")
@click.option(
    "--box", metavar="X0,X1,Y0,Y1", help="With --waves: only elements whose corners have their mean in this box."
)
@click.option(
    "--largest-scale", is_flag=True, help="With --deform: find the smallest scale at which an element folds, certified."
)
@click.option("--wall", metavar="NAME", help="With --critical: zeros of the wall shear on this boundary.")
@data_options
@shared
def info(
    data: Data,
    ranks: Ranks,
    quantities: tuple[str, ...],
    as_json: bool,
    everything: bool,
    without_top_modes: bool,
    wall: str | None,
    box: str | None,
    **asked: bool,
) -> None:
    """Describe a dataset: shapes, orders, fields with their ranges, bounding box, and validity.

    Ranges and the bounding box are certified bounds from Bernstein coefficients: no value lies outside, and they are
    usually tight to nine digits (wider with Fourier directions). The sign of the Jacobian is sampled at quadrature
    points; --jacobian proves it everywhere and lists the elements in which it is not positive, each with a position.
    --critical finds every point except in elements that it lists as undecided; with --wall it distinguishes attachment
    from separation.
    --field adds the certified range of any quantity. Data opened by runtime plugins without bounds are sampled.
    For a series, all steps are listed with their times; the details describe the last step, or that of --step or
    --time.
    """
    many = None if everything else _MANY
    _check_options(asked, wall, box, without_top_modes)
    if asked["largest_scale"]:
        from elvis.renderer.commands.info.scale import print_largest_scale

        print_largest_scale(data, ranks, as_json)
        return
    if asked["strict"]:
        _check(data.paths, ranks, as_json)
        return
    data = replace(data, is_of_map=asked["jacobian"])
    series = data.series(ranks=ranks)
    if asked["resolution"] and series is not None:
        if not is_idle(ranks):
            print_resolution_over_time(data, quantities, as_json)
        return
    comes_apart = partial(_is_in_parts, quantities, any(asked[name] for name in _OF_THE_WHOLE))
    if asked["critical"]:
        comes_apart = partial(_have_all_sides, quantities, wall, ranks)
    source = _opened(data, series, comes_apart, ranks)
    if source is None or (asked["predefined"] and is_idle(ranks)):
        return
    tasks = {
        "jacobian": partial(_prove, many=many, as_json=as_json),
        "extrema": partial(print_extrema, quantities, as_json, without_top_modes),
        "critical": partial(_isolate, names=quantities, wall=wall, as_json=as_json),
        "resolution": partial(print_resolution, names=quantities, as_json=as_json),
        "waves": partial(print_waves, box=box, as_json=as_json),
    }
    if asked["quality"]:
        print_quality(source, as_json)
        return
    if _is_done(source, tasks, asked):
        return
    if asked["predefined"]:
        _list([*source.names.flow.catalogue(), *source.names.attributes()], as_json)
        return
    _describe(source, series, quantities, as_json, many)


def _describe(
    source: Source, series: Series | None, quantities: Sequence[str], as_json: bool, many: int | None
) -> None:
    """Print all facts of the data and, if any, of their series."""
    from elvis.core.base.terminal import stage

    with stage("measuring"):
        facts = source.facts(quantities)
    if not facts:
        return
    if series is not None:
        facts = {"series": series.facts(), **facts}
    _tell(facts, as_json, lambda: _print(facts, source, many))


def _print(facts: Facts, source: Source, many: int | None) -> None:
    """Print facts as tables, with the periods of data that are at hand as a whole."""
    from elvis.core.deformed.copied_domains import periods

    if not isinstance(source, NativeSource):
        print_opened(facts)
        return
    mesh = facts["mesh"] if source.is_part else {**facts["mesh"], "periods": periods(source.dataset)}
    print_facts({**facts, "mesh": mesh}, many)


def _is_done(source: Source, tasks: Mapping[str, Callable[[NativeSource], None]], asked: Mapping[str, bool]) -> bool:
    """Do the first task that is requested, and tell whether there is one; UsageError for data of a runtime plugin.

    tasks  by the names of their parameters
    """
    for name, task in tasks.items():
        if asked[name]:
            task(native_source(source, f"--{name}"))
            return True
    return False


def _check_options(asked: Mapping[str, bool], wall: str | None, box: str | None, without_top_modes: bool) -> None:
    """Raise UsageError for several questions at once, and for options of others than the one that is asked."""
    if sum(asked.values()) > 1:
        some = "--strict, --jacobian, --quantities, --extrema, --critical, --resolution, --quality, --waves"
        raise click.UsageError(f"expected {some} or --largest-scale, found several")
    if wall is not None and not asked["critical"]:
        raise click.UsageError("--wall: expected with --critical")
    if box is not None and not asked["waves"]:
        raise click.UsageError("--box: expected with --waves")
    if without_top_modes and not asked["extrema"]:
        raise click.UsageError("--without-top-modes: expected with --extrema")


def _opened(data: Data, series: Series | None, comes_apart: Callable[[Dataset], bool], ranks: Ranks) -> Source | None:
    """The data that a rank describes: its part; if data don't come apart, all on the first rank, else None."""
    found = data.part(ranks, comes_apart, series=series)
    if isinstance(found, NativeSource) and found.is_part:
        return found
    if is_idle(ranks):
        return None
    return data.source() if found is None else found


def _is_in_parts(quantities: Sequence[str], is_whole: bool, dataset: Dataset) -> bool:
    """Whether facts are put together from parts, unless they take all elements together."""
    return not is_whole and _are_borrowed(quantities, dataset)


def _are_borrowed(quantities: Sequence[str], dataset: Dataset) -> bool:
    """Whether quantities on a part depend only on it and on the data that it borrows."""
    from elvis.core.quantities import Expression

    return all(Expression.of(dataset, text).is_borrowed for text in quantities)


def _have_all_sides(quantities: Sequence[str], wall: str | None, ranks: Ranks, dataset: Dataset) -> bool:
    """Whether quantities depend only on single elements, and all parts know their inner sides.

    wall  a boundary, if any, whose sides are not inner ones
    """
    from elvis.core.critical.wall_points import is_outer_wall
    from elvis.core.portions.portion import knows_inner_sides
    from elvis.core.quantities import Expression

    is_known = knows_inner_sides(dataset) if wall is None else is_outer_wall(dataset, wall)
    is_known &= all(Expression.of(dataset, text).is_local for text in quantities)
    return all(ranks.exchange(is_known, "sides of elements"))


def _isolate(source: NativeSource, names: Sequence[str], wall: str | None, as_json: bool) -> None:
    """Print zeros of a velocity in the interior, or of its wall shear, with kinds, and undecided elements."""
    from elvis.core.base.terminal import note, print_json, print_table, stage, warn

    with stage("searching"):
        found = source.critical(names, wall)
    if found is None:
        return
    if as_json:
        print_json(found.facts())
    else:
        rows = []
        for each in found.points:
            place = ", ".join(f"{x:.10g}" for x in each.position)
            values = ", ".join(f"{value:.6g}" if value.imag else f"{value.real:.6g}" for value in each.eigenvalues)
            rows.append((each.kind, str(each.index), place, str(each.element), values))
        print_table(("kind", "index", "position", "element", "eigenvalues"), rows)
    if found.undecided:
        warn(
            f"undecided in {len(found.undecided)} elements, for example along lines of zeros: {_first(found.undecided)}"
        )
    if found.near_boundary:
        note(f"not searched next to the outer boundary, within 1/128 of {len(found.near_boundary)} elements")


def _first(ids: Sequence[int]) -> str:
    """The first few of many ids."""
    return ", ".join(map(str, ids[:8])) + (", …" if len(ids) > 8 else "")


def _list(quantities: Sequence[Facts], as_json: bool) -> None:
    """Print what predefined quantities are, and what the data lack for them."""
    from elvis.core.base.terminal import print_json, print_table

    if as_json:
        print_json({"quantities": quantities})
        return
    rows = [(each["name"], each["meaning"], each["missing"] or "-") for each in quantities]
    print_table(("quantity", "meaning", "missing"), rows)


def _tell(facts: Facts, as_json: bool, tables: Callable[[], None]) -> None:
    """Print facts as JSON or as tables."""
    from elvis.core.base.terminal import print_json

    if as_json:
        print_json(facts)
    else:
        tables()


def _check(data: tuple[Path, ...], ranks: Ranks, as_json: bool) -> None:
    """Print the rules that the files break; ElvisError where some of these are required."""
    from elvis.core.base.errors import ElvisError
    from elvis.core.base.terminal import print_json, say, stage
    from elvis.formats.strict import findings

    with stage("checking"):
        found = findings(*data, ranks=ranks)
    if ranks.rank:
        return
    required, advised = ([each for each in found if each.is_required is kind] for kind in (True, False))
    if as_json:
        facts = [{"place": each.place, "message": each.sentence, "required": each.is_required} for each in found]
        print_json({"findings": facts})
    else:
        _print_findings("required by programs of the format:", required)
        _print_findings("recommended, but not required by programs of the format:", advised)
        if not found:
            say("all rules are satisfied")
    if required:
        count = f"{len(required)} broken"
        raise ElvisError(f"expected files that follow all required rules, found {count}")


def _print_findings(title: str, found: Sequence[Finding]) -> None:
    from elvis.core.base.terminal import one_line, say

    if found:
        say("\n".join([title, *(f"  {one_line(str(each))}" for each in found)]))


def _prove(source: NativeSource, as_json: bool, many: int | None) -> None:
    """Print the status of the Jacobian of every element; ElvisError where one is not positive for certain."""
    from elvis.core.base.errors import ElvisError
    from elvis.core.base.terminal import print_json, print_table, say, stage
    from elvis.core.validity.validity import ValidityStatus, validity_facts

    with stage("proving"):
        found = source.validity()
    if found is None:
        return
    facts = validity_facts(found)
    if as_json:
        print_json(facts)
    else:
        say(_validity_sentence(facts))
        headers = ("element", "shape", "jacobian", "lower bound", "upper bound", "minimum", "at xi", "at x")
        rows = [_listed_row(row) for row in facts["listed"]]
        if rows:
            click.echo()
            print_table(headers, shortened(rows, many))
    wrong, unknown = found.count(ValidityStatus.NOT_POSITIVE), found.count(ValidityStatus.UNDECIDED)
    if wrong or unknown:
        reasons = f"{wrong} where it is not and {unknown} where that could not be decided"
        raise ElvisError(f"expected a positive Jacobian everywhere in every element, found {reasons}")


def _validity_sentence(facts: Facts) -> str:
    """One sentence on all elements."""
    if facts["range"] is None:
        return f"{facts['elements']} elements, none with a known Jacobian"
    bounds = f"{facts['range']['lower']:.10g} to {facts['range']['upper']:.10g}"
    return (
        f"{facts['positive']} of {facts['elements']} elements have a positive Jacobian everywhere; "
        f"its range is {bounds}"
    )


def _listed_row(row: Facts) -> tuple[object, ...]:
    places = (", ".join(f"{x:.6g}" for x in row[name]) for name in ("reference", "world"))
    values = (f"{row[name]:.10g}" for name in ("lower", "upper", "minimum"))
    status = f"{row['status']}: {row['reason']}" if row["reason"] else row["status"]
    return row["element"], row["shape"], status, *values, *places
