"""The reference of all commands as a page of the site, made from the commands themselves (docs/conf.py)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import click

from elvis.plugins.command.help_topics import GEOMETRY
from elvis.plugins.command.running import elvis


def page() -> str:
    """A chapter for each command of this distribution, and one on geometry."""
    from manual import own_commands

    context = click.Context(elvis, info_name="elvis")
    chapters = "\n".join(line for command in own_commands(context) for line in _chapter(command))
    return f"{chapters}\n## Geometry\n\n```text\n{GEOMETRY}```\n"


class Recorder(click.HelpFormatter):
    """Keeps the options of a command as rows of tables, one table a chapter of its help."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    @contextmanager
    def section(self, name: str) -> Iterator[None]:
        """Begin the table of a chapter."""
        self.lines.append(f"\n**{name}**\n\n| option | meaning |\n|---|---|")
        yield

    def write_dl(self, rows: Sequence[tuple[str, str]], col_max: int = 30, col_spacing: int = 2) -> None:
        """Add options to it."""
        self.lines += [f"| {_code(option)} | {_cell(meaning)} |" for option, meaning in rows]


def _chapter(context: click.Context) -> Iterator[str]:
    """Usage, what the command does, its options in chapters, examples."""
    command = context.command
    usage = " ".join(command.collect_usage_pieces(context))
    options = Recorder()
    command.format_options(context, options)
    yield f"\n## elvis {context.info_name}\n"
    yield f"```text\nelvis {context.info_name} {usage}\n```\n"
    yield _prose(command.help)
    yield from options.lines
    yield "\n" + _prose(command.epilog)


def _prose(text: str | None) -> str:
    """Paragraphs; those that click leaves as they are, after a \\b, become blocks of code."""
    parts = []
    for paragraph in re.split(r"\n\s*\n", (text or "").strip("\n")):
        if paragraph.lstrip().startswith("\b"):
            parts.append(f"```text\n{_undented(paragraph.lstrip().removeprefix(chr(8)))}\n```")
        else:
            parts.append(_text(" ".join(paragraph.split())))
    return "\n\n".join(parts) + "\n"


def _undented(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip()]
    indent = min((len(line) - len(line.lstrip()) for line in lines), default=0)
    return "\n".join(line[indent:] for line in lines)


def _code(text: str) -> str:
    return f"`{text}`".replace("|", "\\|")


def _cell(text: str) -> str:
    return _text(text).replace("|", "\\|")


def _text(text: str) -> str:
    """Text in which no letter means more than itself."""
    return re.sub(r"([*_<\[\]])", r"\\\1", text)
