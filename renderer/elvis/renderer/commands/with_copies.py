"""Copies of the data in commands that print numbers: ``--with-copies``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

from elvis.core.base.errors import ElvisError
from elvis.renderer.commands.sources import NativeSource, Source, native_source
from elvis.scene.commandline.command import text_type
from elvis.scene.model.copies import Copies
from elvis.scene.model.settings import settings

if TYPE_CHECKING:
    from elvis.core.base.arrays import Floats
    from elvis.core.deformed.isometries import Isometry
    from elvis.core.files.columns import Columns
    from elvis.core.quantities import Expression

HELP = "Count the copies by --mirror, --turn and --repeat: values with the signs that they have there."


def copies_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """A command whose parameter ``copies`` combines the options of copies; None without ``--with-copies``."""

    @wraps(command)
    def parsed(with_copies: bool, **rest: Any) -> Any:
        parts = {name: rest.pop(f"copies_{name}") for name in settings(Copies)}
        given = {name: value for name, value in parts.items() if value}
        if with_copies != bool(given):
            raise click.UsageError(
                "expected --mirror, --turn or --repeat together with --with-copies", click.get_current_context()
            )
        return command(copies=Copies(**given) if given else None, **rest)

    found = click.option("--with-copies", is_flag=True, help=HELP)(parsed)
    for name, setting in reversed(settings(Copies).items()):
        names = setting.option, f"copies_{name}"
        found = click.option(
            *names,
            multiple=True,
            type=text_type(setting.parse),
            metavar=setting.metavar,
            help=setting.option_words.replace("Also draw", "Count").replace("Draw", "Count"),
        )(found)
    return found


def isometries_of(source: Source, copies: Copies) -> tuple[NativeSource, tuple[Isometry, ...]]:
    """The source, with the isometries of all copies of its data.

    Raises ElvisError for copies that overlap, mirrors that cut the domain, and data of a runtime plugin.
    """
    from elvis.renderer.frame.copy_checks import check_copies, periods_of

    native = native_source(source, "--with-copies")
    whole = copies.with_periods(periods_of(native.dataset))
    check_copies(whole, native.dataset)
    return native, whole.isometries()


def probe_copies(source: Source, copies: Copies, points: Floats, wanted: Sequence[Expression]) -> Columns:
    """The table of quantities at points (n, 3): of the first copy that contains each, whose number is a column."""
    import numpy as np

    from elvis.core.mapping.inverse import Status
    from elvis.core.quantities import Names
    from elvis.core.quantities.expression import taken_name
    from elvis.core.quantities.moved_expressions import moved

    native, isometries = isometries_of(source, copies)
    if any(each.text == "copy" for each in wanted):
        raise ElvisError(taken_name("copy"))
    names = Names.of(native.dataset)
    found: dict[str, Any] = {}
    number = np.full(len(points), -1)
    for copy, isometry in enumerate(isometries):
        rest = np.flatnonzero(number < 0)
        images = [moved(each, isometry, names) for each in wanted]
        own = native.probe(isometry.points_before(points[rest]), images, False)
        found = found or {name: np.array(column) for name, column in own.items()}
        inside = own["status"] == Status.INSIDE
        better = inside | ((own["status"] == Status.FAILED) & (found["status"][rest] == Status.OUTSIDE))
        for name in ("element", "status", *(each.text for each in wanted)):
            found[name][rest[better]] = own[name][better]
        number[rest[inside]] = copy
    found |= {"point": np.arange(len(points)), **dict(zip("xyz", points.T, strict=True))}
    place = list(found).index("status") + 1
    items = list(found.items())
    return dict([*items[:place], ("copy", number), *items[place:]])
