"""Writes docs/elvis.1, the manual page, from the commands themselves; `make pages` runs it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import click

from elvis.plugins.running import elvis

PAGE = Path(__file__).parents[1] / "docs" / "elvis.1"
HEAD = """.\\" made by tools/manual.py from the commands
.TH ELVIS 1
.SH NAME
elvis \\- pixel-exact pictures of high-order finite element solutions"""
TAIL = """.SH ENVIRONMENT
.TP
.B ELVIS_DEBUG
Where it is 1, failures show their traceback, as with \\-\\-debug.
.TP
.B ELVIS_SLANG_OPTIMIZATION
How much Slang optimises kernels before the driver does: none, default, high or maximal. With none some compile a fifth
sooner, and some draw a tenth slower; for those who work on kernels.
.TP
.B XDG_CACHE_HOME
The folder in which compiled kernels and conversions are kept; ~/.cache by default.
.SH EXIT STATUS
0 only when the output is whole; 2 after a usage error, 130 after an interrupt, 1 after any other failure, with one
sentence on standard error."""


def manual() -> str:
    """The page in roff."""
    context = click.Context(elvis, info_name="elvis", max_content_width=100)
    lines = [HEAD, ".SH SYNOPSIS", ".B elvis", "COMMAND [OPTIONS] DATA...", ".SH DESCRIPTION", *_prose(elvis.help)]
    lines.append(".SH COMMANDS")
    for command in own_commands(context):
        lines += _command(command)
    return "\n".join([*lines, TAIL, ""])


def own_commands(context: click.Context) -> Iterator[click.Context]:
    """The contexts of the commands of this distribution."""
    for name in elvis.list_commands(context):
        command = elvis.get_command(context, name)
        if command is not None and _own(name):
            yield click.Context(command, info_name=name, parent=context)


def _own(name: str) -> bool:
    """Whether a command is of this distribution."""
    from elvis.plugins.registry import plugins

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
    """Paragraphs; those that click leaves as they are, after a \\b, stand so here, too."""
    for number, paragraph in enumerate(re.split(r"\n\s*\n", (text or "").strip("\n"))):
        if number:
            yield ".PP"
        if paragraph.lstrip().startswith("\b"):
            yield from (".nf", *map(_roff, paragraph.lstrip().removeprefix("\b\n").splitlines()), ".fi")
        else:
            yield _roff(" ".join(paragraph.split()))


def _roff(text: str) -> str:
    """A line of text, with nothing in it that roff would act on."""
    escaped = text.replace("\\", "\\e").replace("-", "\\-").replace("…", "...")
    return f"\\&{escaped}" if escaped.startswith((".", "'")) else escaped


if __name__ == "__main__":
    PAGE.write_text(manual(), encoding="utf-8")
