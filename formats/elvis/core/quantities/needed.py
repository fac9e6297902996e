"""Which fields of a dataset quantities are made of, so that no others need be read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from elvis.core.dataset import Dataset, Field, rate_name
from elvis.core.errors import ElvisError
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.names import Names
from elvis.core.quantities.tree import jumping_of

if TYPE_CHECKING:
    from elvis.core.streamlines.moving import Interval

#: what is known of an element by the fields on it
_OF_FIELDS = "order"


def needed_fields(dataset: Dataset, texts: Sequence[str]) -> tuple[str, ...]:
    """The names of the fields that quantities are made of, and of those that hold the map; one field at least.

    texts  of the quantities; an empty one is the first field

    All names, where one of the texts says nothing of these data.  Blocks of the fields are not looked at.
    """
    every = tuple(field.name for field in dataset.fields)
    solution = tuple(field.name for field in dataset.solution)
    found = set(dataset.map_names)
    for text in texts if solution else ():
        own = _fields_of(dataset, text or solution[0])
        if own is None:
            return every
        found |= own
    if not found.intersection(solution):
        found.update(solution[:1])
    return tuple(name for name in every if name in found)


def lack_of(dataset: Dataset, text: str) -> str:
    """Why a quantity of a step of a series has no values in a dataset; empty where it has.

    text  of the quantity; derivatives in time are those of the fields
    """
    asked, names = _AskedRates(), Names.of(dataset)
    try:
        Expression.parse(text, replace(names, time=names.time or 1.0, rates=asked))
    except ElvisError as error:
        return str(error).partition(";")[0]
    lacking = sorted(asked.names.difference(names.fields))
    return f"there is no field {lacking[0]!r}" if lacking else ""


def _fields_of(dataset: Dataset, text: str) -> set[str] | None:
    """The fields of one quantity, however many coordinates the fields depend on; None where nothing is known of it."""
    asked, names = _AskedRates(), Names.of(dataset)
    found: set[str] | None = None
    for dimension in range(dataset.mesh.space, 4):
        try:
            expression = Expression.parse(
                text, replace(names, dimension=dimension, time=names.time or 1.0, rates=asked)
            )
        except ElvisError:
            continue
        if _OF_FIELDS in expression.attributes:
            return None
        jumping = {own for name in expression.attributes if (own := jumping_of(name)) is not None}
        found = {*(found or ()), *expression.fields, *jumping}
    return None if found is None else {name for name in found | asked.names if name in names.fields}


class _AskedRates:
    """Derivatives in time that stand in for those of a series: they tell of which fields they are asked for."""

    remark = ""

    def __init__(self) -> None:
        self.names: set[str] = set()

    def field(self, name: str) -> Field:
        """A field without values."""
        self.names.add(name)
        return Field(rate_name(name), ())

    def intervals(self, start: float, stop: float) -> Iterator[Interval]:
        """None: nothing is followed here."""
        return iter(())
