"""Vortex cores of ``elvis trace --cores``: their options, output and messages."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from elvis.core.streamlines.lines.files import check_suffix, write_lines

if TYPE_CHECKING:
    from elvis.core.cores import VortexCores
    from elvis.renderer.commands.sources import Data

F = TypeVar("F", bound=Callable[..., Any])

#: how many ids of undecided elements are listed
_LISTED = 10


def core_options(function: F) -> F:
    """The options of vortex cores."""
    options = [
        click.option(
            "--cores", is_flag=True, help="Find the cores of all vortices (parallel vectors) instead of using seeds."
        ),
        click.option(
            "--criterion",
            type=click.Choice(["acceleration", "vorticity"]),
            help="With --cores: vector parallel to the velocity, (grad v) v or curl v.  [default: acceleration]",
        ),
        click.option(
            "--min-swirl",
            type=float,
            metavar="RATE",
            help="With --cores: minimum imaginary part of the eigenvalues of grad v, in radians per unit of time.  "
            "[default: 0]",
        ),
        click.option("--min-length", type=float, help="With --cores: minimum length of lines.  [default: 0]"),
        click.option("--only-q", is_flag=True, help="With --cores: only where Q = -tr((grad v)^2)/2 is also positive."),
    ]
    for option in reversed(options):
        function = option(function)
    return function


def check_course(course: Mapping[str, Any], is_followed: bool) -> None:
    """UsageError where settings are given that cores have not."""
    given = [name for name, value in course.items() if name != "velocity" and value not in (None, (), [])]
    if is_followed:
        raise click.UsageError("--cores: expected no --ftle, --kind or --releases, as cores are not traced from seeds")
    if given:
        raise click.UsageError(f"--{given[0]}: expected without --cores, which need no seeds")


def check_seeds(limits: Mapping[str, Any], seeds: object) -> None:
    """UsageError where settings of cores are given without --cores, or neither seeds nor --cores."""
    for name, value in limits.items():
        if value not in (None, False):
            raise click.UsageError(f"--{name.replace('_', '-')}: expected --cores")
    if not seeds:
        raise click.UsageError("expected --seeds, where lines begin, or --cores")


def trace_cores(
    data: Data,
    velocity: str | None,
    limits: Mapping[str, Any],
    spacing: float | None,
    quantities: Sequence[str],
    as_json: bool,
    output: Path | None,
    overwrite: bool,
) -> None:
    """Find and follow cores, write them, and print how they end."""
    from elvis.core.base.terminal import print_json, print_table, progress
    from elvis.core.cores import vortex_cores
    from elvis.core.data.arguments import texts_of
    from elvis.core.files.output import check_places

    if output is not None:
        check_suffix(output)
        check_places([output], data.inputs(), overwrite)
    source = data.source()
    if source.dataset is None:
        raise click.UsageError("--cores needs native or converted data, found data of a runtime plugin")
    asked = {name: value for name, value in limits.items() if value is not None}
    with progress("searching vortex cores") as told:
        found = vortex_cores(
            source.dataset, texts_of(velocity), spacing=spacing, fields=quantities, progress=told, **asked
        )
    _warn_of_undecided(found)
    if output is not None:
        write_lines(output, found, found.of_lines())
    if as_json:
        facts = {"lines": len(found), "points": len(found.points), "ends": found.counts()}
        print_json({**facts, "lengths": found.lengths.tolist(), "undecided": list(found.undecided)})
    elif len(found):
        print_table(("end", "meaning", "ends"), found.table())
    else:
        click.echo("no vortex cores")


def _warn_of_undecided(found: VortexCores) -> None:
    """Name elements in which there may be more cores than were found."""
    from elvis.core.base.terminal import warn

    if found.undecided:
        ids = ", ".join(map(str, found.undecided[:_LISTED]))
        more = ", …" if len(found.undecided) > _LISTED else ""
        warn(f"in {len(found.undecided)} elements, which are undecided, there may be more cores: {ids}{more}")
