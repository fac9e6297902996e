"""Arguments that several commands share, and how they become data."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from elvis.formats.errors import ElvisError

if TYPE_CHECKING:
    from elvis.formats.dataset import Dataset

Triple = tuple[float, float, float]

data_argument = click.argument("data", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="DATA...")
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON, numbers with all their digits.")


Parser = Callable[[click.Context, click.Parameter, Any], Any]


def numbers(*counts: int) -> Parser:
    """A callback for an option of the form ``0,0.5,1``: a tuple of as many numbers as one of ``counts`` says."""

    def parse(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[float, ...] | None:
        return None if value is None else _numbers(value, counts)

    return parse


def triples(count: int) -> Parser:
    """A callback for an option of the form ``0,0,0:1,0``: ``count`` triples; a third coordinate left out is zero."""

    def parse(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[Triple, ...] | None:
        if value is None:
            return None
        parts = value.split(":")
        if len(parts) != count:
            raise click.BadParameter(f"expected {count} points with colons between them, found {value!r}")
        padded = [(*_numbers(part, (2, 3)), 0.0) for part in parts]
        return tuple((p[0], p[1], p[2]) for p in padded)

    return parse


def _numbers(text: str, counts: tuple[int, ...]) -> tuple[float, ...]:
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if len(found) not in counts or not all(abs(number) < float("inf") for number in found):
        wanted = " or ".join(map(str, counts))
        raise click.BadParameter(f"expected {wanted} numbers with commas between them, found {text!r}")
    return found


def read_data(paths: Iterable[Path]) -> Dataset:
    """The dataset in these files, read with a word on the terminal."""
    from elvis.formats import read
    from elvis.formats.terminal import stage

    files = tuple(paths)
    with stage(f"reading {', '.join(file.name for file in files)}"):
        return read(*files)


def field_names(dataset: Dataset, wanted: str | None) -> tuple[str, ...]:
    """The names in ``wanted`` (commas between them), or all; ElvisError for one that the dataset lacks."""
    known = tuple(field.name for field in dataset.fields)
    if wanted is None:
        return known
    names = tuple(name.strip() for name in wanted.split(","))
    for name in names:
        if name not in known:
            raise ElvisError(f"there is no field {name!r}; {_known(known)}")
    return names


def _known(names: tuple[str, ...]) -> str:
    return f"the fields are {', '.join(names)}" if names else "the data hold no fields"
