"""Output for a person at a terminal: tables and progress; plain and silent in a pipe.

Names come from files and may hold anything: control characters appear as question marks.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from math import isfinite
from typing import TypeAlias, TypeVar

Item = TypeVar("Item")
#: characters of a message: names in it may come from files
MAX_LINE = 2_000
#: called with the amount of work done and the total
Progress: TypeAlias = Callable[[int, int], object]


def visible(text: str) -> str:
    """The text with a question mark for each character that has no picture, lines but for their ends."""
    return "".join(c if c.isprintable() or c == "\n" else "?" for c in text)


def plain_names(names: Iterable[str]) -> tuple[str, ...]:
    """Names as `visible` on one line, for files of other programs; equal names are made distinct by a number."""
    found: list[str] = []
    for name in names:
        plain = candidate = visible(name).replace("\n", "?")
        number = 2
        while candidate in found:
            candidate = f"{plain}_{number}"
            number += 1
        found.append(candidate)
    return tuple(found)


def one_line(text: str) -> str:
    """The text as `visible`, its words on one line; a long text without its middle."""
    line = " ".join(text.split())
    if len(line) > MAX_LINE:
        line = f"{line[: MAX_LINE // 2]} … {line[-MAX_LINE // 2 :]}"
    return visible(line)


def say(text: str = "") -> None:
    """Print text on standard output."""
    print(visible(text))


def print_table(headers: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table on standard output, columns of numbers to the right: framed on a terminal, bare in a pipe.

    In a pipe no cell is wrapped or cut, however long the line.
    """
    cells = [[visible(str(cell)).replace("\n", " ") for cell in row] for row in rows]
    columns = range(len(headers))
    numeric = [bool(cells) and all(_is_number(row[column]) for row in cells) for column in columns]
    if not sys.stdout.isatty():
        heads = [list(map(visible, headers))] if any(headers) else []
        print("\n".join(aligned([*heads, *cells], numeric)))
        return
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_header=any(headers))
    for header, is_numeric in zip(headers, numeric, strict=True):
        table.add_column(header, justify="right" if is_numeric else "left", overflow="fold")
    for row in cells:
        table.add_row(*(Text(cell) for cell in row))
    Console().print(table)


def aligned(rows: Sequence[Sequence[str]], numeric: Sequence[bool]) -> Iterator[str]:
    """The lines of a table, each column as wide as its widest cell; columns of numbers are flush right."""
    from rich.cells import cell_len

    widths = [max(map(cell_len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        parts = []
        for cell, width, is_numeric in zip(row, widths, numeric, strict=True):
            blanks = " " * (width - cell_len(cell))
            parts.append(blanks + cell if is_numeric else cell + blanks)
        yield "  ".join(parts).rstrip()


@contextmanager
def stage(description: str) -> Iterator[None]:
    """Show on a terminal what is in progress while the block runs; the message disappears afterwards."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.text import Text

    with Console(stderr=True).status(Text(one_line(description))):
        yield


def track(items: Iterable[Item], description: str, count: int | None = None) -> Iterator[Item]:
    """The items one by one; on a terminal with a bar, and how long the rest will take.

    count  of the items, where they are no sequence; some may be missing
    """
    if not sys.stderr.isatty():
        yield from items
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import track as rich_track

    shown = escape(one_line(description))
    yield from rich_track(items, total=count, description=shown, console=Console(stderr=True), transient=True)


@contextmanager
def progress(description: str) -> Iterator[Progress | None]:
    """A bar on a terminal, that shows how much of how much is done; None in a pipe."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich import progress as bars
    from rich.console import Console
    from rich.markup import escape

    with bars.Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(escape(one_line(description)), total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def warn(sentence: str) -> None:
    """Say on standard error what the user should know of a result."""
    tell("warning", sentence)


def note(sentence: str) -> None:
    """Say on standard error what the user may want to know of a result."""
    tell("note", sentence)


def tell(kind: str, sentence: str) -> None:
    """Print a warning or a note, and remember it where another process of the run may print it."""
    line = one_line(sentence)
    if _told is not None and len(_told) < MAX_TOLD:
        _told[kind, line] = None
    # in one piece: an interrupt leaves no half of it
    print(f"elvis: {kind}: {line}\n", end="", file=sys.stderr)


#: kinds and messages that this process has printed, in order; None in a process without ranks
_told: dict[tuple[str, str], None] | None = None
#: maximum number of these messages
MAX_TOLD = 1000


def remember_told() -> None:
    """Remember warnings and notes from now on, for `told_lines`."""
    global _told
    _told = {}


def told_lines() -> list[tuple[str, str]]:
    """The kinds and sentences of the warnings and notes since `remember_told`, each once."""
    return list(_told or ())


def announce(sentence: str) -> None:
    """Say on a terminal what takes a while; silent in a pipe."""
    if sys.stderr.isatty():
        print("elvis:", one_line(sentence), file=sys.stderr, flush=True)


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", ""))
    except ValueError:
        return cell in ("", "-")
    return True


def print_json(value: object) -> None:
    """Print JSON on standard output, floats with every digit; numbers that are not finite become null."""
    import json

    print(json.dumps(_plain(value), indent=2, allow_nan=False))


def _plain(value: object) -> object:
    """The structure with floats that JSON does not support replaced."""
    if isinstance(value, float) and not isfinite(value):
        return None
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, (list, tuple)) else value
