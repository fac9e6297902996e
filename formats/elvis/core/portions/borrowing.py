"""Inputs of quantities on a part of a dataset in addition to its own fields: other data and times, and surroundings.

Fields of other datasets, derivatives in time and jumps become fields of the part.  They are cut and united like its own
fields, and their own inputs are no longer needed.  All ranks have the surfaces of boundaries.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import Ranks
from elvis.core.data.dataset import Dataset, Field, is_rate, rate_name
from elvis.core.differences.common_elements import place_of
from elvis.core.portions.portion import Portion
from elvis.core.portions.surroundings import with_jumps, with_surface
from elvis.core.quantities.derived import original_of
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.tree import jumping_of, other_of, target_of

if TYPE_CHECKING:
    from elvis.core.streamlines.moving import Interval


@dataclass(frozen=True, eq=False)
class BorrowedRates:
    """Derivatives in time that a part of a dataset holds as fields: names, a remark on their origin, times of steps.

    They need no steps of a series any longer.
    """

    names: frozenset[str]
    remark: str
    times: Floats

    @staticmethod
    def of(dataset: Dataset) -> BorrowedRates | None:
        """The derivatives of a part; None if it is not a moment of a series."""
        if dataset.rates is None:
            return None
        names = (name[2:-3] for name in dataset.borrowed if is_rate(name))
        return BorrowedRates(frozenset(names), dataset.rates.remark, dataset.rates.times)

    def field(self, name: str) -> Field:
        """The derivative as in `elvis.core.data.dataset.Rates`, but only its name, since the part holds the values."""
        if name not in self.names:
            raise ElvisError(f"the derivative of {name} in time was not requested")
        return Field(rate_name(name), ())

    def intervals(self, start: float, stop: float) -> Iterator[Interval]:
        """None: nothing is followed in parts."""
        return iter(())


def borrowing(portion: Portion, texts: Iterable[str], ranks: Ranks) -> Portion:
    """The part of one of several ranks, with the inputs of quantities added to its fields; every rank must call this.

    If other data don't hold the same elements, their portions get the requested fields.
    """
    expressions = [Expression.of(portion.dataset, text) for text in texts]
    portion = _with_fields(portion, [name for each in expressions for name in each.fields], ranks)
    others = dict(portion.others)
    for name in _attributes(expressions):
        other = other_of(name)
        if other is not None:
            others[other[0]] = borrowing(others[other[0]], [other[1]], ranks)
    return surrounded(replace(portion, others=others), expressions, ranks)


def surrounded(portion: Portion, expressions: Iterable[Expression], ranks: Ranks) -> Portion:
    """The part of one of several ranks, with the surroundings of its elements that quantities need.

    Every rank must call this.

    Fields of other data are located on demand, and don't become its own.
    """
    for name in _attributes(expressions):
        target, jumping = target_of(name), jumping_of(name)
        if target is not None:
            portion = with_surface(portion, target, ranks)
        if jumping is not None:
            portion = with_jumps(_with_fields(portion, [jumping], ranks), jumping, ranks)
    return portion


def _attributes(expressions: Iterable[Expression]) -> dict[str, None]:
    """The attributes that quantities use, each once."""
    return dict.fromkeys(name for each in expressions for name in each.attributes)


def _with_fields(portion: Portion, names: Iterable[str], ranks: Ranks) -> Portion:
    """The part with fields by their names; of derived ones with the fields that these come from."""
    for name in dict.fromkeys(map(original_of, names)):
        if name in portion.dataset:
            continue
        field, rows = _in_time(portion, name) if is_rate(name) else _of_other(portion, name, ranks)
        dataset = portion.dataset
        fields, borrowed = (*dataset.fields, field), dataset.borrowed | {name}
        dataset = replace(dataset, fields=fields, borrowed=borrowed)
        portion = replace(portion, dataset=dataset, blocks={**portion.blocks, name: rows})
    return portion


def _in_time(portion: Portion, name: str) -> tuple[Field, tuple[Ints, ...]]:
    """A derivative in time, which has the bases and elements of its field, and the rows of its blocks in the whole."""
    return portion.dataset.field(name), portion.blocks[name[2:-3]]


def _of_other(portion: Portion, name: str, ranks: Ranks) -> tuple[Field, tuple[Ints, ...]]:
    """The field of another dataset that holds the same elements."""
    owner, _, own = name.partition(":")
    other, common = _with_fields(portion.others[owner], [own], ranks), portion.dataset.shared[owner]
    every = ranks.exchange(common.symmetries, f"symmetries of elements in {owner}")
    symmetries = sorted({symmetry for some in every for symmetry in some}, key=place_of)
    field, places = common.in_parts(other.dataset.field(own), name, symmetries)
    return field, tuple(other.blocks[own][number][rows] for number, rows in places)
