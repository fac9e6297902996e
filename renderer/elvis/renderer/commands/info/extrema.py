"""``elvis info --extrema``: certified minima and maxima of quantities, on request also of truncated fields."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from elvis.core.base.rounded_up import rounded_up
from elvis.renderer.commands.sources import NativeSource, tell_conversion

if TYPE_CHECKING:
    from elvis.core.bounds.extrema import Extremum
    from elvis.core.quantities import Expression

Facts = dict[str, Any]
#: the two ends of a quantity's values
_ENDS = ("minimum", "maximum")


def print_extrema(names: Sequence[str], as_json: bool, without_top_modes: bool, source: NativeSource) -> None:
    """Print minimum and maximum of quantities, with positions and certified bounds.

    without_top_modes  whether to also print those of the fields without their highest modes
    """
    from elvis.core.base.terminal import print_json, print_table, stage
    from elvis.core.data.arguments import field_names
    from elvis.core.quantities import Expression
    from elvis.core.quantities.largest_radii import largest_radii

    dataset = source.dataset
    known = [Expression.of(dataset, name) for name in names or field_names(dataset, None)]
    with stage("bounding"):
        pairs = source.extrema(known)
        less = source.without_top_modes().extrema(known) if without_top_modes else None
    if not pairs:
        return
    radii = largest_radii(dataset, known).tolist() if not source.is_part else []
    tell_conversion([each.text for each in known[: len(radii)]], radii)
    if as_json:
        print_json(_facts(known, pairs, less))
        return
    headers, rows = _table(known, pairs)
    if less is not None:
        from elvis.core.resolution.truncation import orders_below

        _, rows_below = _table(known, less)
        headers = (*headers, orders_below(dataset), "certain to", "difference")
        values = [end.value for both in pairs for end in both]
        values_below = [end.value for both in less for end in both]
        cells = zip(rows, rows_below, values, values_below, strict=True)
        rows = [(*row, *below[2:4], f"{value - other:.4g}") for row, below, value, other in cells]
    print_table(headers, rows)


def _facts(
    known: Sequence[Expression],
    pairs: Sequence[tuple[Extremum, Extremum]],
    less: Sequence[tuple[Extremum, Extremum]] | None,
) -> Facts:
    """Plain data of each quantity; with ``less`` also of its values without the highest modes."""
    found: Facts = {}
    for number, each in enumerate(known):
        ends = {end: asdict(own) for end, own in zip(_ENDS, pairs[number], strict=True)}
        for end, below in zip(_ENDS, () if less is None else less[number], strict=False):
            ends[end]["without_top_modes"] = asdict(below)
            ends[end]["difference"] = ends[end]["value"] - below.value
        found[each.text] = ends
    return found


def _table(
    known: Sequence[Expression], pairs: Sequence[tuple[Extremum, Extremum]]
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Headers and rows: quantity, end, value, certainty, place and element."""
    rows: list[tuple[str, ...]] = []
    for each, ends in zip(known, pairs, strict=True):
        for end, own in zip(_ENDS, ends, strict=True):
            place = ", ".join(f"{x:.10g}" for x in own.position)
            certainty = rounded_up(abs(own.bound - own.value))
            rows.append((each.text, end, f"{own.value:.15g}", certainty, place, str(own.element)))
    return ("quantity", "", "value", "bound", "position", "element"), rows
