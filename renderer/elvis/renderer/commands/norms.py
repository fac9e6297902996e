"""``elvis norms``: how large coordinates and fields are."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import TYPE_CHECKING

import click

from elvis.core.data.arguments import field_option, json_option
from elvis.plugins.command.running import shared
from elvis.renderer.commands.sources import Data, data_options, tell_conversion

if TYPE_CHECKING:
    from elvis.core.base.ranks import Ranks
    from elvis.core.data.dataset import Dataset
    from elvis.core.numbers.norms import Norm

EPILOG = """\b
Examples:
  elvis norms wing.xml wing.fld
  elvis norms --json wing.xml wing.fld     {"x": {"L2": ..., "Linf": ...}, ..., "u": ...}
  elvis norms wing.xml wing.fld --field divergence
"""


@click.command("norms", epilog=EPILOG, short_help="Print the L2 and maximum norm of coordinates and fields.")
@field_option
@json_option
@data_options
@shared
def norms(data: Data, ranks: Ranks, quantities: tuple[str, ...], as_json: bool) -> None:
    """Print the L2 and maximum norm of each coordinate and each field over the domain.

    The quadrature is that of the solver, so that the values can be compared with those of FieldConvert. Linf is the
    maximum magnitude at the quadrature points; maximum, which FieldConvert calls L inf, is the maximum value there.
    With --field only those quantities are integrated, with the rule of the field in them that has most modes; the L2
    norm is the root of the integral of the square, so that 1 gives the root of the volume. Data of runtime plugins are
    integrated with rules that are refined until they agree.
    """
    from elvis.core.base.terminal import stage
    from elvis.core.quantities import Expression

    def comes_apart(dataset: Dataset) -> bool:
        return all(Expression.of(dataset, text).is_borrowed for text in quantities)

    source = data.shared(ranks, comes_apart)
    with stage("integrating"):
        found = source.norms(quantities or None, ranks)
    if found:
        _tell_measure(quantities, found)
        tell_conversion(found, [norm.linf_error for norm in found.values()])
        _print(found, as_json)


def _print(found: Mapping[str, Norm], as_json: bool) -> None:
    from elvis.core.base.terminal import print_json, print_table

    if as_json:
        print_json({name: _facts(norm) for name, norm in found.items()})
        return
    rows = [(name, *(f"{number:.10g}" for number in (n.l2, n.linf, n.maximum))) for name, n in found.items()]
    print_table(("", "L2", "Linf", "maximum"), rows)


def _facts(norm: Norm) -> dict[str, float | None]:
    """For ``--json``: estimates of errors where a conversion lost something, None where they are not known."""
    facts: dict[str, float | None] = {"L2": norm.l2, "Linf": norm.linf}
    if norm.l2_error or norm.linf_error:
        errors = {"L2_estimate": norm.l2_error, "Linf_estimate": norm.linf_error}
        facts |= {name: error if isfinite(error) else None for name, error in errors.items()}
    return facts


def _tell_measure(quantities: tuple[str, ...], found: Mapping[str, Norm]) -> None:
    """Warn about the norm of the first constant, as its user probably expects the volume."""
    from elvis.core.base.errors import ElvisError
    from elvis.core.base.terminal import warn
    from elvis.core.quantities import Expression, Names

    for text in quantities:
        try:
            is_constant = not Expression.parse(text, Names(())).leaves
        except ElvisError:
            continue
        norm = found.get(text)
        if is_constant and norm is not None and norm.linf > 0:
            measure = (norm.l2 / norm.linf) ** 2
            volume = f"the domain's volume (area, length) is {measure:.10g}"
            warn(f"the L2 norm of {text} is the root of an integral: {volume}")
            return
