"""Options of commands that write fields: quantities to add, names to change."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

_add_option = click.option(
    "--add",
    "added",
    multiple=True,
    metavar="NAME=EXPR",
    help='A quantity to write as a field, as "Cp=2*(p-1)", or a predefined one, as vorticity; exact where it is a '
    "polynomial on an element.  Repeatable.",
)
_rename_option = click.option(
    "--rename",
    "renames",
    multiple=True,
    metavar="OLD=NEW",
    help="Another name for a field in what is written.  Repeatable.",
)


def field_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options ``added`` and ``renames``."""
    return _add_option(_rename_option(command))
