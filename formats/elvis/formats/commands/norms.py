"""``elvis norms``: how large coordinates and fields are."""

from __future__ import annotations

from pathlib import Path

import click

from elvis.formats.commands.arguments import (
    data_argument,
    expressions,
    field_option,
    json_option,
    opened,
    plugin_option,
    read_data,
)

EPILOG = """\b
Examples:
  elvis norms wing.xml wing.fld
  elvis norms --json wing.xml wing.fld     {"x": {"L2": ..., "Linf": ...}, ..., "u": ...}
  elvis norms wing.xml wing.fld --field divergence
"""


@click.command("norms", epilog=EPILOG, short_help="Print the L2 and maximum norm of coordinates and fields.")
@data_argument
@field_option
@json_option
@plugin_option
def norms(data: tuple[Path, ...], quantities: tuple[str, ...], as_json: bool, plugin: str | None) -> None:
    """Print the L2 and maximum norm of each coordinate and each field over the domain.

    The quadrature is that of the solver, so that the numbers can be laid beside those of FieldConvert. Linf is the
    greatest magnitude at the quadrature points; maximum, which FieldConvert calls L inf, is the greatest value there.
    With --field just those quantities are integrated, by the rule of the field with most modes in them. Data of runtime
    plugins are integrated by rules that are refined until they agree.
    """
    from elvis.formats.norms import norms as norms_of
    from elvis.formats.norms import quantity_norm
    from elvis.formats.terminal import print_json, print_table, stage

    answers = opened(data, plugin)
    dataset = None if answers else read_data(data)
    with stage("integrating"):
        if dataset is None:
            assert answers is not None
            found = dict(answers.norms(quantities or None))
        elif quantities:
            found = {each.text: quantity_norm(dataset, each) for each in expressions(dataset, quantities)}
        else:
            found = norms_of(dataset)
    if as_json:
        print_json({name: {"L2": norm.l2, "Linf": norm.linf} for name, norm in found.items()})
        return
    rows = [(name, *(f"{number:.10g}" for number in (n.l2, n.linf, n.maximum))) for name, n in found.items()]
    print_table(("", "L2", "Linf", "maximum"), rows)
