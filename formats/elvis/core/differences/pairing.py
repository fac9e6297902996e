"""Two solutions in one dataset: the other one has a name in expressions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Ints, frozen_floats, frozen_ints, joined_ints
from elvis.core.data.dataset import Block, Dataset, Field
from elvis.core.differences.common_elements import CommonElements, common_elements
from elvis.core.mapping.geometry import share
from elvis.core.quantities.tree import Node, field, other

#: the other solution in expressions
REFERENCE = "reference"
#: relative distances of maps below which no remark is made
_ROUNDING = 1e-13


def common_fields(first: Dataset, second: Dataset) -> list[str]:
    """The names of fields that both have, in the order of the first."""
    known = {one.name for one in second.solution}
    return [one.name for one in first.solution if one.name in known]


class Pair:
    """Two datasets, their common elements, and the first dataset with fields of the second added."""

    def __init__(self, first: Dataset, second: Dataset) -> None:
        self._first, self._second = first, second
        # each field is integrated on maps that are the same for all of them
        share(first.mesh)
        share(second.mesh)
        self._common = common_elements(first, second)

    @property
    def is_same_mesh(self) -> bool:
        """Whether all elements of the first dataset are elements of the second."""
        return self._common.is_whole

    def remarks(self) -> Iterator[str]:
        """Remarks about elements that are treated as identical."""
        if self._common.apart > _ROUNDING:
            part = f"{self._common.apart:.1g} of the coordinates"
            yield f"elements of both meshes count as the same, although their maps differ by up to {part}"

    def parts(self, name: str) -> Iterator[tuple[Dataset, bool]]:
        """The first dataset with a field on common elements, and with it on the others; which of both it is.

        In both the second dataset's field may be named as `theirs` does.  There is one at least.
        """
        own, others = self._first.field(name), {REFERENCE: self._second}
        has_both = np.isin(self._common.others, _ids(self._second.field(name)))
        ids = self._common.element_ids[has_both]
        held = _ids(own)
        shared, rest = np.intersect1d(held, ids), np.setdiff1d(held, ids)
        if len(shared):
            common: dict[str, CommonElements] = {REFERENCE: self._common}
            yield replace(_with(self._first, _on(own, shared)), others=others, shared=common), True
        if len(rest) or not len(shared):
            yield replace(_with(self._first, _on(own, rest)), others=others, shared={}), False


def _ids(of: Field) -> Ints:
    """Ids of the elements that hold a field."""
    return joined_ints(block.element_ids for block in of.blocks)


def _with(dataset: Dataset, own: Field) -> Dataset:
    """The dataset with another field of a name that it has."""
    return replace(dataset, fields=tuple(own if one.name == own.name else one for one in dataset.fields))


def _on(of: Field, ids: Ints) -> Field:
    """A field restricted to some elements."""
    return replace(of, blocks=tuple(part for block in of.blocks if len(part := _part(block, ids))))


def _part(block: Block, ids: Ints) -> Block:
    held = np.isin(block.element_ids, ids)
    if held.all():
        return block
    return Block(block.expansion, frozen_ints(block.element_ids[held]), frozen_floats(block.coefficients[held]))


def theirs(name: str, is_common: bool) -> Node:
    """A field of the second dataset in a part of the first, on common elements or on others."""
    return field(f"{REFERENCE}:{name}") if is_common else other(REFERENCE, f'"{name}"')
