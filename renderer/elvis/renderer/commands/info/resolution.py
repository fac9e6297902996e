"""``elvis info --resolution``: how well fields are resolved, as tables."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import ROUND_CEILING, Context
from math import isfinite, isnan
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elvis.core.data.dataset import Dataset
    from elvis.renderer.commands.sources import Data, NativeSource

Facts = dict[str, Any]

#: ids of elements that a sentence holds
_NAMED = 8
#: headers of the table of fields
_HEADERS = (
    *("field", "order", "tail", "decay", "by direction", "one order less", "at most", "jump", "error"),
    "of gradient",
)
_LEGEND = """
tail: largest share of the energy in the highest modes; decay: median rate per order; one order less: L2 norm of the
difference to the projection; at most: certified bound of its magnitude; error: estimated L2 norm; of gradient:
estimated L2 norm of the error of the gradient, by a recovered gradient"""


def print_resolution(source: NativeSource, names: Sequence[str], as_json: bool) -> None:
    """Print a row for each field, the worst elements, and advice; ElvisError for names that are not fields."""
    from elvis.core.base.terminal import print_json, stage

    with stage("measuring"):
        facts = _facts(source.dataset, names)
    if as_json:
        print_json(facts)
    else:
        _print_tables(facts)


def print_resolution_over_time(data: Data, names: Sequence[str], as_json: bool) -> None:
    """Print a row for each step of a series and each field; ElvisError for names that are not fields."""
    from elvis.core.base.terminal import print_json, print_table, say

    series, moments = data.moments("all", "measuring")
    steps = [{"time": time, **_facts(source.dataset, names)} for time, source in moments]
    data.tell_of(series, [own["time"] for own in steps])
    if as_json:
        print_json({"steps": steps})
        return
    rows = [(f"{step['time']:.10g}", *_field_row(own)) for step in steps for own in step["fields"]]
    print_table(("time", *_HEADERS), rows)
    say(_LEGEND)


def _facts(dataset: Dataset, names: Sequence[str]) -> Facts:
    """The facts on some fields of a dataset, or on all of them."""
    from elvis.core.base.errors import ElvisError
    from elvis.core.resolution.facts import resolution_facts

    fields = [field.name for field in dataset.solution]
    wrong = [name for name in names if name not in fields]
    if not fields:
        raise ElvisError("--resolution: the data contain no fields")
    if wrong:
        raise ElvisError(f"--resolution: expected a field of the data ({', '.join(fields)}), found {wrong[0]}")
    return resolution_facts(dataset, list(dict.fromkeys(names)) or fields)


def _print_tables(facts: Facts) -> None:
    """The table of fields, their advice, and the worst elements."""
    import click

    from elvis.core.base.terminal import print_table, say, warn

    headers = (
        "field",
        "order",
        "tail",
        "decay",
        "by direction",
        "one order less",
        "at most",
        "jump",
        "error",
        "of gradient",
    )
    print_table(headers, [_field_row(field) for field in facts["fields"]])
    click.echo()
    for field in facts["fields"]:
        say(f"{field['name']}: {field['advice']}")
        if field["growing"]:
            say(f"{field['name']}: energy grows at the highest mode of {_first(field['growing'])}")
        if field["gradient_error"]["reason"]:
            say(f"{field['name']}: no error of the gradient: {field['gradient_error']['reason']}")
        if field["not_finite"]:
            warn(f"{field['name']}: coefficients are not finite in {_first(field['not_finite'])}, which do not count")
    click.echo()
    columns = ("worst element", "position", "field", "tail", "decay", "one order less", "error", "of the norm")
    print_table(columns, [_worst_row(row) for row in facts["worst"]])
    say(_LEGEND)


def _field_row(field: Facts) -> tuple[object, ...]:
    """A row of the table of fields."""
    least, most = field["orders"]
    removed = field["removed"]
    return (
        field["name"],
        f"{least}" if least == most else f"{least} to {most}",
        _text(field["tail"]["maximum"]),
        _text(field["decay"]["median"]),
        ", ".join(map(_text, field["rates"])),
        _text(removed["L2"]),
        _text_above(removed["bound"]),
        _text(field["jump"]),
        _text(field["error"]["L2"]),
        _text(field["gradient_error"]["L2"]),
    )


def _worst_row(row: Facts) -> tuple[object, ...]:
    """A row of the table of elements."""
    place = ", ".join(f"{x:.6g}" for x in row["position"])
    numbers = (_text(row[name]) for name in ("tail", "decay", "removed", "error", "relative"))
    return row["element"], place, row["field"], *numbers


def _text(number: float | None) -> str:
    """A number with four digits; a dash where there is none."""
    return "-" if number is None or isnan(number) else f"{number:.4g}"


def _text_above(number: float) -> str:
    """A bound with four digits, rounded up so that it stays a bound; a dash where there is none."""
    if not isfinite(number):
        return "-"
    above = Context(prec=4, rounding=ROUND_CEILING).create_decimal_from_float(number)
    return f"{abs(float(above)):.4g}"


def _first(ids: Sequence[int]) -> str:
    """The first few of many elements."""
    more = ", …" if len(ids) > _NAMED else ""
    return f"element{'s' if len(ids) > 1 else ''} {', '.join(map(str, ids[:_NAMED]))}{more}"
