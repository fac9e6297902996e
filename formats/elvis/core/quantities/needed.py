"""Fields that quantities need, so that only these are read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset, Field, rate_name
from elvis.core.quantities.derived import original_of
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.names import Names
from elvis.core.quantities.tree import Node, measured_of

if TYPE_CHECKING:
    from elvis.core.streamlines.moving import Interval

#: attributes of an element that depend on its fields
_OF_FIELDS = "order"


def needed_fields(dataset: Dataset, texts: Sequence[str]) -> tuple[str, ...]:
    """The names of the fields that quantities need, and of the fields that hold the map; at least one field.

    texts  of the quantities; an empty one is the first field

    All names if one of the texts is invalid for these data.  Blocks of the fields are not used.
    """
    every = tuple(field.name for field in dataset.fields)
    solution = tuple(field.name for field in dataset.solution)
    known = dict.fromkeys(text or solution[0] for text in texts) if solution else {}
    asked = {text: _meanings(dataset, text) for text in known}
    found = set(dataset.map_names)
    for own in asked.values():
        fields = own.fields_of(dataset)
        if fields is None:
            return every
        found |= fields
    if not found.intersection(solution):
        found.update(solution[:1])
    few = replace(dataset, fields=tuple(field for field in dataset.fields if field.name in found))
    # a component of the velocity is one field, which is known as that by the others
    if any(_meanings(few, text).roots != own.roots for text, own in asked.items()):
        return every
    return tuple(name for name in every if name in found)


def lack_of(dataset: Dataset, text: str) -> str:
    """The reason why a quantity of a step of a series has no values in a dataset; empty if it has values.

    text  text of the quantity; derivatives in time are derivatives of the fields
    """
    asked, names = _AskedRates(), Names.of(dataset)
    try:
        Expression.parse(text, replace(names, time=names.time or 1.0, rates=asked))
    except ElvisError as error:
        return str(error).partition(";")[0]
    lacking = sorted(asked.names.difference(names.fields))
    return f"there is no field {lacking[0]!r}" if lacking else ""


@dataclass(frozen=True, eq=False)
class _Meanings:
    """A quantity for each number of coordinates for which a text is valid, and the fields whose rates it needs."""

    expressions: Sequence[Expression]
    rates: frozenset[str]

    @property
    def roots(self) -> list[Node]:
        """The roots of its expressions."""
        return [each.root for each in self.expressions]

    def fields_of(self, dataset: Dataset) -> set[str] | None:
        """Its fields, for any number of coordinates; None if nothing is known of it."""
        if not self.expressions or any(_OF_FIELDS in each.attributes for each in self.expressions):
            return None
        attributes = [name for each in self.expressions for name in each.attributes]
        measured = {own[1] for name in attributes if (own := measured_of(name)) is not None}
        found = {original_of(name) for each in self.expressions for name in each.fields}
        return (found | measured | self.rates).intersection(Names.of(dataset).fields)


def _meanings(dataset: Dataset, text: str) -> _Meanings:
    """The meaning of a text for a dataset."""
    asked, names = _AskedRates(), Names.of(dataset)
    found = []
    for dimension in range(dataset.mesh.space, 4):
        with suppress(ElvisError):
            own = replace(names, dimension=dimension, time=names.time or 1.0, rates=asked)
            found.append(Expression.parse(text, own))
    return _Meanings(found, frozenset(asked.names))


class _AskedRates:
    """Placeholders for derivatives in time of a series; they record the names of the fields requested."""

    remark = ""

    def __init__(self) -> None:
        self.names: set[str] = set()
        self.times: Floats = np.empty(0)

    def field(self, name: str) -> Field:
        """A field without values."""
        self.names.add(name)
        return Field(rate_name(name), ())

    def intervals(self, start: float, stop: float) -> Iterator[Interval]:
        """None: nothing is followed here."""
        return iter(())
