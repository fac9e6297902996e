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
    help='Quantity to write as a field, such as "Cp=2*(p-1)" or the predefined vorticity; exact if it is a polynomial '
    "on each element.  Repeatable.",
)
_rename_option = click.option(
    "--rename",
    "renames",
    multiple=True,
    metavar="OLD=NEW",
    help="Write a field under another name.  Repeatable.",
)


def field_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options ``added`` and ``renames``."""
    return _add_option(_rename_option(command))
