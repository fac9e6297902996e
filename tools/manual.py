"""Writes docs/elvis.1, the manual page, from the commands themselves; `make pages` runs it."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import click

from elvis.plugins.command.help_topics import GEOMETRY
from elvis.plugins.command.running import elvis

PAGE = Path(__file__).parents[1] / "docs" / "elvis.1"
HEAD = """.\\" made by tools/manual.py from the commands
.TH ELVIS 1
.SH NAME
elvis \\- pixel-exact pictures of high-order finite element solutions"""
TAIL = """.SH ENVIRONMENT
.TP
.B ELVIS_DEBUG
If set to 1, failures show their traceback, as with \\-\\-debug.
.TP
.B ELVIS_SLANG_OPTIMIZATION
Optimisation of kernels by Slang, before that of the driver: none, default, high or maximal. With none, some kernels
compile in a fifth less time and some draw a tenth slower. The device cpu uses maximal if nothing is set. Meant for
work on kernels.
.TP
.B XDG_CACHE_HOME
Folder of the caches of compiled kernels and conversions; ~/.cache by default.
.SH EXIT STATUS
0 if the output is complete; 2 after a usage error, 130 after an interrupt, 1 after any other failure, with a one-line
message on standard error."""


def manual() -> str:
    """The page in roff."""
    context = click.Context(elvis, info_name="elvis", max_content_width=100)
    lines = [HEAD, ".SH SYNOPSIS", ".B elvis", "COMMAND [OPTIONS] DATA...", ".SH DESCRIPTION", *_prose(elvis.help)]
    lines.append(".SH COMMANDS")
    for command in own_commands(context):
        lines += _command(command)
    geometry = [".SH GEOMETRY", ".nf", *map(_roff, GEOMETRY.splitlines()), ".fi"]
    return "\n".join([*lines, *geometry, TAIL, ""])


def own_commands(context: click.Context) -> Iterator[click.Context]:
    """The contexts of the commands of this distribution."""
    for name in elvis.list_commands(context):
        command = elvis.get_command(context, name)
        if command is not None and _own(name):
            yield click.Context(command, info_name=name, parent=context)


def _own(name: str) -> bool:
    """Whether a command belongs to this distribution."""
    from elvis.plugins.command.registry import plugins

    return plugins("elvis.commands")[name].distribution.startswith("elvis-viz ")


def _command(context: click.Context) -> Iterator[str]:
    """A command with its options."""
    command = context.command
    yield f".SS {_roff(f'elvis {context.info_name}')}"
    yield _roff(" ".join(command.collect_usage_pieces(context)))
    yield ".PP"
    yield from _prose(command.help)
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is not None and isinstance(parameter, click.Option) and "--help" not in parameter.opts:
            yield from (".TP", f".B {_roff(record[0])}", _roff(record[1]))
    if command.epilog:
        yield from _prose(command.epilog)


def _prose(text: str | None) -> Iterator[str]:
    """Paragraphs in roff; those after a \\b are preformatted, as in click."""
    # before Python 3.13, docstrings are indented
    for number, paragraph in enumerate(re.split(r"\n\s*\n", inspect.cleandoc(text or ""))):
        if number:
            yield ".PP"
        if paragraph.lstrip().startswith("\b"):
            yield from (".nf", *map(_roff, paragraph.lstrip().removeprefix("\b\n").splitlines()), ".fi")
        else:
            yield _roff(" ".join(paragraph.split()))


def _roff(text: str) -> str:
    """A line of text with all special characters of roff escaped."""
    escaped = text.replace("\\", "\\e").replace("-", "\\-").replace("…", "...")
    return f"\\&{escaped}" if escaped.startswith((".", "'")) else escaped


if __name__ == "__main__":
    PAGE.write_text(manual(), encoding="utf-8")
