"""Common checks of converters' input: number of files, their roles, steps, rows."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path

from elvis.core.base.arrays import Ints, distinct, joined_ints
from elvis.core.base.errors import ElvisError, FormatError
from elvis.plugins.conversion.plugin import Option

#: digits that every number of 64 bits may have
_DIGITS = 18

#: different numbers that name parts of a mesh; each part takes about a millisecond and some kB
MOST_PARTS = 1 << 16

#: the option of converters of series
STEP = Option("step", "Step of a series in one file or of its index, counted from 0.  [default: the last]")


def step_number(step: str | None, may_be_negative: bool = True) -> int:
    """The step that `STEP` names, -1 for the last; raises ElvisError if it is not a number."""
    if step is None:
        return -1
    digits = step.lstrip("-") if may_be_negative else step
    if not digits.isdigit():
        raise ElvisError(f"expected a number for the option step, found {step!r}")
    return int(step)


def is_count(word: str | bytes) -> bool:
    """Whether a word is a nonnegative integer that fits an array of numbers."""
    return word.isdigit() and len(word) <= _DIGITS


def single(paths: Sequence[Path]) -> Path:
    """The only file; raises FormatError if there are several."""
    if len(paths) != 1:
        raise FormatError(f"expected one file, found {len(paths)}", file=paths[0])
    return Path(paths[0])


def by_kind(paths: Sequence[Path], kind_of: Callable[[Path], str]) -> defaultdict[str, list[Path]]:
    """The files of each kind; none of kinds that no file is of.

    kind_of  looks into each file once
    """
    found = defaultdict[str, list[Path]](list)
    for path in paths:
        found[kind_of(path)].append(path)
    return found


def check_roles(meshes: int, others: int, what: str = "solution") -> None:
    """Raise FormatError unless there are one mesh and at most one other file, which holds ``what``."""
    if meshes != 1 or others > 1:
        advice = f"; of the steps of a series give one {what}" if others > 1 else ""
        advice = "; also give its mesh" if not meshes else advice
        raise FormatError(f"expected one mesh and at most one {what}, found {meshes} and {others}{advice}")


def check_rows(
    rows: Ints, count: int, what: str, first: int = 0, file: str | Path | None = None, place: str | None = None
) -> None:
    """Raise FormatError unless all of ``rows``, which count from 0, are rows of a table of ``count``.

    what   noun for the content of the table
    first  number of the first row in the file
    """
    if rows.size and not 0 <= rows.min() <= rows.max() < count:
        found = f"{rows.min() + first} to {rows.max() + first}"
        raise FormatError(f"expected {what} {first} to {count - 1 + first}, found {found}", file=file, place=place)


def excess_of_parts(numbers: Sequence[Ints], what: str) -> str:
    """A remark that numbers name no parts of a mesh, since too many of them differ; empty if they do.

    numbers  arrays of numbers, one for each element or side
    what     noun for the numbers, such as ``references of elements``
    """
    found = distinct(joined_ints(map(distinct, numbers)))
    if len(found) <= MOST_PARTS:
        return ""
    return f"{len(found)} different {what} are ignored: at most {MOST_PARTS} name parts of a mesh"
