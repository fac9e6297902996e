"""``elvis info``: what is in a dataset."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from elvis.core.arguments import field_option, json_option
from elvis.renderer.commands.sources import Data, data_options

if TYPE_CHECKING:
    from elvis.core.dataset import Dataset
    from elvis.formats.strict.finding import Finding
    from elvis.plugins.report import RecordedReport

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
  elvis info wing.xml wing_*.chk
  elvis info wing.xml wing_*.chk --time 0.25
"""


@click.command("info", epilog=EPILOG, short_help="Tell what is in a dataset: shapes, orders, fields, ranges, validity.")
@field_option
@json_option
@click.option("--all", "everything", is_flag=True, help="List everything, however long the tables.")
@click.option(
    "--strict",
    is_flag=True,
    help="Check the rules for other programs of the format; fail where a required one is broken.",
)
@click.option("--jacobian", is_flag=True, help="Prove that the Jacobian is positive all over; fail if it isn't.")
@click.option(
    "--quantities", "predefined", is_flag=True, help="List the predefined quantities, and what the data lack for them."
)
@click.option("--extrema", "extremes", is_flag=True, help="Find extremes of quantities, with places, certified.")
@click.option(
    "--critical",
    is_flag=True,
    help="Find all points inside where the velocity is zero, with their kinds; --field, repeated, gives components.",
)
@click.option("--wall", metavar="NAME", help="With --critical: points of this boundary where the wall shear is zero.")
@data_options
def info(
    data: Data,
    quantities: tuple[str, ...],
    as_json: bool,
    everything: bool,
    strict: bool,
    jacobian: bool,
    predefined: bool,
    extremes: bool,
    critical: bool,
    wall: str | None,
) -> None:
    """Tell what is in a dataset: shapes, orders, fields with their ranges, the box around it, and whether it is valid.

    Ranges and the box are certified bounds from Bernstein coefficients: no value lies outside, and as a rule they are
    tight to nine digits (wider with Fourier directions). The sign of the Jacobian is sampled at quadrature points;
    with --jacobian it is proved everywhere, and the elements where it is not positive are listed, each with a place.
    --critical misses no point, but for elements that it lists as undecided; with --wall it tells attachment from
    separation.
    --field adds the certified range of any quantity. What runtime plugins open is sampled where they give no bounds.
    Of a series all steps are listed with their times, and the last is told of, or that of --step or --time.
    """
    from elvis.core.terminal import stage

    many = None if everything else _MANY
    if strict + jacobian + predefined + extremes + critical > 1:
        raise click.UsageError("expected --strict, --jacobian, --quantities, --extrema or --critical, found several")
    if wall is not None and not critical:
        raise click.UsageError("--wall: expected --critical, whose points on a wall it asks for")
    if strict:
        _check(data.paths, as_json)
        return
    series = data.series()
    source = data.source() if series is None else data.source_of(series.at_moment())
    tasks = (
        (jacobian, "--jacobian proves", partial(_prove, as_json=as_json, many=many)),
        (extremes, "--extrema bounds", partial(_bound, names=quantities, as_json=as_json)),
        (critical, "--critical searches", partial(_isolate, names=quantities, wall=wall, as_json=as_json)),
    )
    for is_asked, what, task in tasks:
        if is_asked:
            if source.dataset is None:
                raise click.UsageError(f"{what} what is native, but a runtime plugin opens these data")
            task(source.dataset)
            return
    if predefined:
        _list(source.names.flow.catalogue(), as_json)
        return
    with stage("measuring"):
        facts = source.facts(quantities)
    if series is not None:
        facts = {"series": series.facts(), **facts}
    _tell(facts, as_json, lambda: _print_opened(facts) if source.dataset is None else _print(facts, many))


def _bound(dataset: Dataset, names: Sequence[str], as_json: bool) -> None:
    """Print the least and the greatest value of quantities, where they are, and what is certain of them."""
    from dataclasses import asdict

    from elvis.core.arguments import field_names
    from elvis.core.quantities import Expression
    from elvis.core.quantity_extrema import quantity_extrema
    from elvis.core.terminal import print_json, print_table, stage

    known = [Expression.of(dataset, name) for name in names or field_names(dataset, None)]
    with stage("bounding"):
        pairs = [quantity_extrema(dataset, each) for each in known]
    found = {
        each.text: dict(zip(("least", "greatest"), own, strict=True)) for each, own in zip(known, pairs, strict=True)
    }
    if as_json:
        print_json({name: {end: asdict(own) for end, own in ends.items()} for name, ends in found.items()})
        return
    rows = []
    for name, ends in found.items():
        for end, own in ends.items():
            place = ", ".join(f"{x:.10g}" for x in own.place)
            rows.append((name, end, f"{own.value:.15g}", f"{abs(own.bound - own.value):.2g}", place, str(own.element)))
    print_table(("quantity", "", "value", "certain to", "place", "element"), rows)


def _isolate(dataset: Dataset, names: Sequence[str], wall: str | None, as_json: bool) -> None:
    """Print where a velocity is zero inside of the data, or its shear on a wall, with kinds, and what is undecided."""
    from elvis.core.critical_points import critical_points
    from elvis.core.terminal import note, print_json, print_table, stage, warn
    from elvis.core.wall_points import wall_points

    with stage("searching"):
        found = critical_points(dataset, names or None) if wall is None else wall_points(dataset, wall, names or None)
    if as_json:
        print_json(found.facts())
    else:
        rows = []
        for each in found.points:
            place = ", ".join(f"{x:.10g}" for x in each.place)
            values = ", ".join(f"{value:.6g}" if value.imag else f"{value.real:.6g}" for value in each.eigenvalues)
            rows.append((each.kind, str(each.index), place, str(each.element), values))
        print_table(("kind", "index", "place", "element", "eigenvalues"), rows)
    if found.undecided:
        warn(f"undecided in {len(found.undecided)} elements, as along lines of zeros: {_first(found.undecided)}")
    if found.beside:
        note(f"not searched beside the outer boundary, within 1/128 of {len(found.beside)} elements")


def _first(ids: Sequence[int]) -> str:
    """The first few of many ids."""
    return ", ".join(map(str, ids[:8])) + (", …" if len(ids) > 8 else "")


def _list(quantities: Sequence[Facts], as_json: bool) -> None:
    """Print what predefined quantities are, and what the data lack for them."""
    from elvis.core.terminal import print_json, print_table

    if as_json:
        print_json({"quantities": quantities})
        return
    rows = [(each["name"], each["meaning"], each["lacks"] or "-") for each in quantities]
    print_table(("quantity", "meaning", "lacks"), rows)


def _tell(facts: Facts, as_json: bool, tables: Callable[[], None]) -> None:
    """Print facts as JSON or as tables."""
    from elvis.core.terminal import print_json

    if as_json:
        print_json(facts)
    else:
        tables()


def _print_opened(facts: Facts) -> None:
    """Print what a runtime plugin says of its data."""
    from elvis.core.terminal import print_table

    rows = [("plugin", f"{facts['plugin']}: {facts['format']}"), ("dimension", str(facts["dimension"]))]
    rows += [("elements", f"{count} {kind}") for kind, count in facts["elements"].items()]
    for axis, lower, upper in zip("xyz", facts["box"]["lower"], facts["box"]["upper"], strict=True):
        rows.append((axis, f"within {lower:.10g} and {upper:.10g}"))
    rows.append(("jacobian", f"{facts['jacobian']['least']:.4g} to {facts['jacobian']['greatest']:.4g}, sampled"))
    rows.append(("time", f"{facts['time']:.10g}"))
    print_table(("", ""), rows)
    fields = [_range_row(*item) for item in {**facts["fields"], **facts["quantities"]}.items()]
    if fields:
        click.echo()
        print_table(("field", "lower bound", "upper bound", "least found", "greatest found"), fields)


def _check(data: tuple[Path, ...], as_json: bool) -> None:
    """Print the rules that the files break; ElvisError where some of these are required."""
    from elvis.core.errors import ElvisError
    from elvis.core.terminal import print_json, say, stage
    from elvis.formats.strict import findings

    with stage("checking"):
        found = findings(*data)
    required, advised = ([each for each in found if each.is_required is kind] for kind in (True, False))
    if as_json:
        facts = [{"place": each.place, "sentence": each.sentence, "required": each.is_required} for each in found]
        print_json({"findings": facts})
    else:
        _print_findings("required by programs of the format:", required)
        _print_findings("good practice, which programs of the format do without:", advised)
        if not found:
            say("all rules are kept")
    if required:
        count = f"{len(required)} that {'is' if len(required) == 1 else 'are'} broken"
        raise ElvisError(f"expected files that keep all rules that are required, found {count}")


def _print_findings(title: str, found: Sequence[Finding]) -> None:
    from elvis.core.terminal import one_line, say

    if found:
        say("\n".join([title, *(f"  {one_line(str(each))}" for each in found)]))


def _prove(dataset: Dataset, as_json: bool, many: int | None) -> None:
    """Print the status of the Jacobian of every element; ElvisError where one is not positive for certain."""
    from elvis.core.errors import ElvisError
    from elvis.core.terminal import print_json, print_table, say, stage
    from elvis.core.validity.validity import ValidityStatus, validity, validity_facts

    with stage("proving"):
        found = validity(dataset)
    facts = validity_facts(found)
    if as_json:
        print_json(facts)
    else:
        say(_validity_sentence(facts))
        headers = ("element", "shape", "jacobian", "lower bound", "upper bound", "least", "at xi", "at x")
        rows = [_listed_row(row) for row in facts["listed"]]
        if rows:
            click.echo()
            print_table(headers, _shorten(rows, many))
    wrong, unknown = found.count(ValidityStatus.NOT_POSITIVE), found.count(ValidityStatus.UNDECIDED)
    if wrong or unknown:
        reasons = f"{wrong} where it is not and {unknown} where that could not be decided"
        raise ElvisError(f"expected a positive Jacobian all over every element, found {reasons}")


def _validity_sentence(facts: Facts) -> str:
    """One sentence on all elements."""
    if facts["range"] is None:
        return f"{facts['elements']} elements, of none of which the Jacobian is known"
    bounds = f"{facts['range']['lower']:.10g} to {facts['range']['upper']:.10g}"
    return (
        f"{facts['positive']} of {facts['elements']} elements have a positive Jacobian all over; its range is {bounds}"
    )


def _listed_row(row: Facts) -> tuple[object, ...]:
    places = (", ".join(f"{x:.6g}" for x in row[name]) for name in ("reference", "world"))
    values = (f"{row[name]:.10g}" for name in ("lower", "upper", "least"))
    status = f"{row['verdict']}: {row['reason']}" if row["reason"] else row["verdict"]
    return row["element"], row["shape"], status, *values, *places


def _print(facts: Facts, many: int | None) -> None:
    """Print the facts as tables, lists of more than ``many`` cut with a word."""
    from elvis.core.dataset import MAP_KEY
    from elvis.core.terminal import print_table
    from elvis.plugins.report import CONVERTED, REPORT, RecordedReport

    maps = [_expansion_row(expansion) for expansion in facts["geometry"]["expansions"]]
    fields = [_field_row(field) for field in facts["fields"]]
    orders = list(_orders(facts["fields"]))
    composites = [_composite_row(composite) for composite in facts["composites"]]
    report = RecordedReport.of(facts["metadata"])
    # the table of the map has what these keys tell, and so has the report
    shown_elsewhere = {MAP_KEY, *((CONVERTED, REPORT) if report else ())}
    metadata = [item for item in facts["metadata"].items() if item[0] not in shown_elsewhere]
    ranges = [_range_row(*item) for item in facts.get("quantities", {}).items()]
    targets: list[tuple[object, ...]] = [
        (name, each["faces"], _sign(each)) for name, each in facts.get("distances", {}).items()
    ]

    if "series" in facts:
        _print_series(facts["series"], many)
    print_table(("", ""), _overview(facts))
    tables = [
        (("map of", "elements", "bases", "modes (order + 1)"), maps),
        (("field", "elements", "lower bound", "upper bound", "state"), fields),
        (("quantity", "lower bound", "upper bound", "least found", "greatest found"), ranges),
        (("distance to", "faces", "sign"), targets),
        (("fields", "on", "elements", "bases", "modes (order + 1)"), _shorten(orders, many)),
        (("composite", "name", "holds"), _shorten(composites, many)),
        (("metadata", "value"), _shorten(metadata, many)),
    ]
    for headers, rows in tables:
        if rows:
            click.echo()
            print_table(headers, rows)
    if report:
        _print_conversion(report, many)


def _print_series(series: Facts, many: int | None) -> None:
    """Print the steps of a series, of many of them those at both ends."""
    from elvis.core.terminal import print_table, say

    rows = list(_steps(series))
    if many is not None and len(rows) > many:
        count = len(rows) - many + 1
        rows[many // 2 : many // 2 + count] = [("...", f"{count} more, shown by --all", "")]
    print_table(("step", "time", "files"), rows)
    first, last = (series["steps"][end]["time"] for end in (0, -1))
    count = len(series["steps"])
    say(f"\n{count} steps, times {first:.10g} to {last:.10g}\n" if count > 1 else f"\none step, time {first:.10g}\n")


def _steps(series: Facts) -> Iterator[tuple[object, ...]]:
    """A row for each step of a series."""
    for step in series["steps"]:
        yield step["step"], f"{step['time']:.10g}", ", ".join(step["files"])


def _print_conversion(report: RecordedReport, many: int | None) -> None:
    """Print what a conversion cost: a row for the coordinates and for each field, and what was noted."""
    from elvis.core.terminal import print_table, say
    from elvis.plugins.report import HEADERS

    say(f"\n{report.heading}")
    print_table(HEADERS, _shorten(report.rows, many))
    for sentence in report.sentences:
        say(f"note: {sentence}")


def _overview(facts: Facts) -> Iterator[tuple[str, str]]:
    """Pairs of topic and what there is to say."""
    mesh, geometry = facts["mesh"], facts["geometry"]
    yield "dimension", f"{facts['dimension']} in a space of {facts['space']}"
    counts = [f"{count} {label}" for label, count in mesh["elements"].items()]
    yield "elements", ", ".join(counts) or "none"
    yield "in the domain", str(mesh["elements_in_domain"])
    yield "vertices", str(mesh["vertices"])
    yield "curved", f"{mesh['curved_edges']} edges, {mesh['curved_faces']} faces"
    if geometry["given_by_fields"]:
        yield "map", "given by fields of the dataset"
    for axis, lower, upper in zip("xyz", geometry["box"]["lower"], geometry["box"]["upper"], strict=True):
        if lower is not None:
            yield axis, f"{lower:.10g} to {upper:.10g}"
    yield "jacobian", _jacobian(geometry["jacobian"])
    if facts["time"] is not None:
        yield "time", f"{facts['time']:.10g}"
    yield "memory", _size(facts["bytes"])


def _jacobian(facts: Facts) -> str:
    if facts["least"] is None:
        return "no elements"
    wrong = facts["elements_not_positive"]
    where = "positive at all quadrature points" if not wrong else f"NOT POSITIVE in {_ids(wrong)}"
    return f"{where} ({facts['least']:.4g} to {facts['greatest']:.4g}, sampled)"


def _ids(ids: Sequence[int]) -> str:
    shown = ", ".join(map(str, ids[:5]))
    return f"{len(ids)} elements ({shown}{', ...' if len(ids) > 5 else ''})"


def _field_row(field: Facts) -> tuple[object, ...]:
    bounds = (field["range"]["lower"], field["range"]["upper"])
    return (field["name"], field["elements"], *("-" if b is None else f"{b:.10g}" for b in bounds), _state(field))


def _range_row(text: str, found: Facts | None) -> tuple[object, ...]:
    return (text, *(_number(found, key) for key in ("lower", "upper", "least", "greatest")))


def _number(found: Facts | None, key: str) -> str:
    return "-" if found is None or found[key] is None else f"{found[key]:.10g}"


def _sign(surface: Facts) -> str:
    return "negative inside: it is closed" if surface["closed"] else "none: it is open"


def _state(field: Facts) -> str:
    """Whether all coefficients are numbers, and continuity where it is known."""
    words = [] if field["continuous"] is None else ["continuous" if field["continuous"] else "discontinuous"]
    if field["elements_not_finite"]:
        counts = f"{field['nan']} NaN and {field['infinite']} infinite coefficients"
        words.append(f"{counts} in {field['elements_not_finite']} elements, which the bounds leave out")
    return ", ".join(words) or "finite"


def _orders(fields: Sequence[Facts]) -> Iterator[tuple[object, ...]]:
    """One row for each expansion, with the names of all fields that have the same ones."""
    alike: dict[str, list[Facts]] = {}
    for field in fields:
        alike.setdefault(repr(field["expansions"]), []).append(field)
    for group in alike.values():
        names = ", ".join(field["name"] for field in group)
        for expansion in group[0]["expansions"]:
            yield (names, *_expansion_row(expansion))


def _expansion_row(expansion: Facts) -> tuple[object, ...]:
    bases = list(dict.fromkeys(expansion["bases"]))
    modes = "x".join(map(str, expansion["modes"]))
    if "fourier" in expansion:
        lengths = " by ".join(f"{length:.6g}" for length in expansion["fourier"]["lengths"])
        modes += f", {expansion['fourier']['planes']} Fourier over {lengths}"
    return expansion["shape"], expansion["elements"], ", ".join(bases), modes


def _composite_row(composite: Facts) -> tuple[object, ...]:
    parts = ", ".join(f"{part['tag']}[{part['entities']}]" for part in composite["parts"])
    return composite["id"], composite["name"] or composite["label"] or "", parts


def _shorten(rows: Sequence[tuple[object, ...]], many: int | None) -> Sequence[tuple[object, ...]]:
    """At most ``many`` rows, the last of which says how many more there are."""
    if many is None or len(rows) <= many:
        return rows
    blank = ("",) * (len(rows[0]) - 2)
    return [*rows[: many - 1], ("...", f"{len(rows) - many + 1} more, shown by --all", *blank)]


def _size(count: int) -> str:
    size = float(count)
    for unit in ("bytes", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} TB"
