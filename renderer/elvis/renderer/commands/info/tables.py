"""Tables of the facts that ``elvis info`` prints."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from elvis.plugins.conversion.report import RecordedReport

Facts = dict[str, Any]
Row = tuple[object, ...]


def print_opened(facts: Facts) -> None:
    """Print what a runtime plugin says of its data."""
    from elvis.core.base.terminal import print_table

    rows = [("plugin", f"{facts['plugin']}: {facts['format']}"), ("dimension", str(facts["dimension"]))]
    rows += [("elements", f"{count} {kind}") for kind, count in facts["elements"].items()]
    for axis, lower, upper in zip("xyz", facts["box"]["lower"], facts["box"]["upper"], strict=True):
        rows.append((axis, f"within {lower:.10g} and {upper:.10g}"))
    rows.append(("jacobian", f"{facts['jacobian']['minimum']:.4g} to {facts['jacobian']['maximum']:.4g}, sampled"))
    rows.append(("time", f"{facts['time']:.10g}"))
    print_table(("", ""), rows)
    fields = [_range_row(*item) for item in {**facts["fields"], **facts["quantities"]}.items()]
    if fields:
        click.echo()
        print_table(("field", "lower bound", "upper bound", "least found", "greatest found"), fields)


def print_facts(facts: Facts, many: int | None) -> None:
    """Print the facts as tables; lists of more than ``many`` rows are shortened, with a note."""
    from elvis.core.base.terminal import print_table
    from elvis.core.data.conversion_errors import REPORT
    from elvis.core.data.dataset import MAP_KEY
    from elvis.plugins.conversion.report import CONVERTED, RecordedReport

    maps = [_expansion_row(expansion) for expansion in facts["geometry"]["expansions"]]
    fields = [_field_row(field) for field in facts["fields"]]
    orders = list(_orders(facts["fields"]))
    composites = shortened(facts["composites"], many, _composite_row)
    report = RecordedReport.of(facts["metadata"])
    # the table of the map shows these keys, and so does the report
    shown_elsewhere = {MAP_KEY, *((CONVERTED, REPORT) if report else ())}
    metadata = [item for item in facts["metadata"].items() if item[0] not in shown_elsewhere]
    ranges = [_range_row(*item) for item in facts.get("quantities", {}).items()]
    targets = [_target_row(*item) for item in facts.get("distances", {}).items()]

    if "series" in facts:
        _print_series(facts["series"], many)
    print_table(("", ""), _overview(facts))
    tables = [
        (("map of", "elements", "bases", "modes (order + 1)"), maps),
        (("field", "elements", "lower bound", "upper bound", "state"), fields),
        (("quantity", "lower bound", "upper bound", "least found", "greatest found"), ranges),
        (("distance to", "faces", "sign"), targets),
        (("fields", "on", "elements", "bases", "modes (order + 1)"), shortened(orders, many)),
        (("composite", "name", "holds"), composites),
        (("metadata", "value"), shortened(metadata, many)),
    ]
    for headers, rows in tables:
        if rows:
            click.echo()
            print_table(headers, rows)
    if report:
        _print_conversion(report, many)


def _target_row(name: str, target: Facts) -> tuple[object, ...]:
    """A row for what distances are measured to."""
    return name, target["faces"], _sign(target)


def _print_series(series: Facts, many: int | None) -> None:
    """Print the steps of a series, of many of them those at both ends."""
    from elvis.core.base.terminal import print_table, say

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
    """Print the errors of a conversion: a row for the coordinates and for each field, and the notes."""
    from elvis.core.base.terminal import print_table, say
    from elvis.plugins.conversion.report import HEADERS

    say(f"\n{report.heading}")
    print_table(HEADERS, shortened(report.rows, many))
    for sentence in report.sentences:
        say(f"note: {sentence}")


def _overview(facts: Facts) -> Iterator[tuple[str, str]]:
    """Pairs of topic and description."""
    mesh, geometry = facts["mesh"], facts["geometry"]
    yield "dimension", f"{facts['dimension']} in a space of {facts['space']}"
    counts = [f"{count} {label}" for label, count in mesh["elements"].items()]
    yield "elements", ", ".join(counts) or "none"
    yield "in the domain", str(mesh["elements_in_domain"])
    yield "vertices", str(mesh["vertices"])
    yield "curved", f"{mesh['curved_edges']} edges, {mesh['curved_faces']} faces"
    kind = "edges" if facts["dimension"] == 2 else "faces"
    if mesh["non_conforming_sides"]:
        yield "non-conforming", f"{mesh['non_conforming_sides']} inner {kind}"
    if mesh["periodic_sides"]:
        yield "periodic", f"{mesh['periodic_sides']} {kind}"
    if mesh.get("periods"):
        lengths = ", ".join(f"{length:.6g} along {axis}" for axis, length in mesh["periods"].items())
        yield "periods", f"{lengths} (--repeat {next(iter(mesh['periods']))}:COUNT draws several)"
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
    if facts["minimum"] is None:
        return "no elements"
    wrong = facts["elements_not_positive"]
    where = "positive at all quadrature points" if not wrong else f"NOT POSITIVE in {_ids(wrong)}"
    return f"{where} ({facts['minimum']:.4g} to {facts['maximum']:.4g}, sampled)"


def _ids(ids: Sequence[int]) -> str:
    shown = ", ".join(map(str, ids[:5]))
    return f"{len(ids)} elements ({shown}{', ...' if len(ids) > 5 else ''})"


def _field_row(field: Facts) -> tuple[object, ...]:
    bounds = (field["range"]["lower"], field["range"]["upper"])
    return (field["name"], field["elements"], *("-" if b is None else f"{b:.10g}" for b in bounds), _state(field))


def _range_row(text: str, found: Facts | None) -> tuple[object, ...]:
    return (text, *(_number(found, key) for key in ("lower", "upper", "minimum", "maximum")))


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


def shortened(items: Sequence[Any], many: int | None, row: Callable[[Any], Row] = tuple) -> list[Row]:
    """At most ``many`` rows, the last of which states how many are missing.

    row  makes the row of an item
    """
    if many is None or len(items) <= many:
        return [row(item) for item in items]
    rows = [row(item) for item in items[: many - 1]]
    blank = ("",) * (len(row(items[0])) - 2)
    return [*rows, ("...", f"{len(items) - many + 1} more, shown by --all", *blank)]


def _size(count: int) -> str:
    size = float(count)
    for unit in ("bytes", "kB", "MB", "GB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} TB"
