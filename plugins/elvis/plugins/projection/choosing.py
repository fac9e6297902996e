"""Choice of fields and orders: the source's orders, or higher ones if these are not exact.

A few elements predict which orders are needed, so that most sources are projected once.  Elements that turn out to be
worse raise the orders again; then only the changed parts are projected again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from elvis.core.base.arrays import starts_of
from elvis.core.shapes import Shape
from elvis.plugins.conversion.plugin import Converter, PyramidSpace, SourceField
from elvis.plugins.projection.adaptivity import ranges
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.raising import (
    Raise,
    added_to_field,
    added_to_map,
    field_error,
    goal_of,
    leading,
    raised,
    with_more,
)
from elvis.plugins.projection.sampling import Sampler
from elvis.plugins.projection.spaces import needs_hexahedra
from elvis.plugins.projection.topology import Topology, given_topology, topology
from elvis.plugins.projection.verification import Tally

#: number of elements that predict the orders
_FEW = 64

#: how much larger than wanted errors are that raise orders again
_SLACK = 4.0

#: name of the map among the names of fields
_MAP = ""


@dataclass(frozen=True, eq=False)
class ChosenOrders:
    """A source with the orders of its map and fields.

    fields  the fields to convert
    plan    the mesh, without curves unless the source has them, and the blocks with their expansions
    has_native_pyramids  whether pyramids are projected onto the form of Nektar++, whatever these can represent
    final   names of fields, and of the map, whose orders are no longer raised
    """

    source: Converter
    fields: tuple[SourceField, ...]
    plan: Topology
    has_native_pyramids: bool
    final: frozenset[str] = frozenset()

    @classmethod
    def of(cls, source: Converter, fields: Sequence[SourceField], has_native_pyramids: bool) -> ChosenOrders:
        """The orders of the source."""
        return cls(source, tuple(fields), _plan(source, fields, has_native_pyramids), has_native_pyramids)

    def with_map(self, added: int) -> ChosenOrders:
        """The orders, with the map's order raised by ``added``."""
        if not added:
            return self
        source = copy(self.source)
        source.blocks = [raised(block, added) for block in source.blocks]
        return self._with(source, self.fields)

    def with_fields(self, raises: Mapping[str, Raise]) -> ChosenOrders:
        """With more orders of fields, by name."""
        added = {name: more.added for name, more in raises.items() if more.added}
        if not added:
            return self
        return self._with(self.source, [with_more(field, added.get(field.name, 0)) for field in self.fields])

    def _with(self, source: Converter, fields: Sequence[SourceField]) -> ChosenOrders:
        """With other orders; the mesh is the same unless they turn other pyramids into hexahedra."""
        plan = self.plan
        collapsed = [_is_collapsed(source, block.number, fields, self.has_native_pyramids) for block in plan.blocks]
        if source.mesh is None and collapsed != [block.is_collapsed for block in plan.blocks]:
            plan = _plan(source, fields, self.has_native_pyramids)
            return replace(self, source=source, fields=tuple(fields), plan=plan)
        blocks = tuple(replace(block, source=source.blocks[block.number]) for block in plan.blocks)
        return replace(self, source=source, fields=tuple(fields), plan=replace(plan, blocks=blocks))


def with_foreseen_map(orders: ChosenOrders) -> ChosenOrders:
    """The map with the orders that a few elements need."""
    vertices, blocks = orders.plan.mesh.vertices, orders.plan.blocks
    goal = goal_of(float(vertices.min()), float(vertices.max()), orders.source.precision)
    more = added_to_map(Sampler(orders.source), blocks, _few(blocks), goal)
    return _closed(orders.with_map(more.added), {_MAP: more})


def with_better_map(orders: ChosenOrders, tally: Tally) -> ChosenOrders:
    """The map with the orders that the elements with the largest errors need."""
    blocks, goal = orders.plan.blocks, goal_of(tally.low, tally.high, orders.source.precision)
    if _MAP in orders.final or tally.worst <= _SLACK * goal:
        return orders
    return orders.with_map(added_to_map(Sampler(orders.source), blocks, leading(blocks, tally), goal).added)


def with_foreseen_fields(orders: ChosenOrders) -> ChosenOrders:
    """Fields with the orders that a few elements need."""
    sampler, blocks = Sampler(orders.source), orders.plan.blocks
    few, precision = _few(blocks), orders.source.precision
    raises: dict[str, Raise] = {}
    for field in orders.fields:
        # the range of a few elements lies within the whole range, which is only needed for fields that are not exact
        (known,) = ranges(sampler, few, [field])
        if field_error(sampler, few, field) <= goal_of(*known, precision):
            continue
        (known,) = ranges(sampler, blocks, [field], inside=1)
        _include(raises, field.name, added_to_field(sampler, blocks, few, field, goal_of(*known, precision)))
    return _closed(orders.with_fields(raises), raises)


def with_better_fields(orders: ChosenOrders, tallies: Sequence[Tally]) -> ChosenOrders:
    """Fields with the orders that the elements with the largest errors need; ``tallies`` of each field."""
    sampler, blocks = Sampler(orders.source), orders.plan.blocks
    raises: dict[str, Raise] = {}
    for field, tally in zip(orders.fields, tallies, strict=True):
        goal = goal_of(tally.low, tally.high, orders.source.precision)
        if tally.worst > _SLACK * goal and field.name not in orders.final:
            _include(raises, field.name, added_to_field(sampler, blocks, leading(blocks, tally), field, goal))
    return orders.with_fields(raises)


def _include(raises: dict[str, Raise], name: str, more: Raise) -> None:
    """Take in what one field of a name needs; several are planes of one field, which have the same orders."""
    before = raises.get(name, Raise())
    raises[name] = Raise(max(before.added, more.added), before.is_enough and more.is_enough)


def _closed(orders: ChosenOrders, raises: Mapping[str, Raise]) -> ChosenOrders:
    """Stop raising orders if no number of them was enough for a few elements."""
    failed = {name for name, more in raises.items() if not more.is_enough}
    return replace(orders, final=orders.final | failed)


def _few(blocks: Sequence[NativeBlock]) -> list[NativeBlock]:
    """A few elements, the same ones every time."""
    ends = starts_of(blocks)
    chosen = np.random.default_rng(20261128).permutation(ends[-1])[:_FEW]
    rows = [np.sort(chosen[(chosen >= a) & (chosen < b)]) - a for a, b in pairwise(ends.tolist())]
    return [block.select(own, block.modes) for block, own in zip(blocks, rows, strict=True) if len(own)]


def _plan(source: Converter, fields: Sequence[SourceField], has_native_pyramids: bool) -> Topology:
    """The mesh, its curves still to come unless the source has it whole, and the blocks with their expansions."""
    if source.mesh is not None:
        plan = given_topology(source, source.mesh)
    else:
        plan = topology(source, lambda number: _is_collapsed(source, number, fields, has_native_pyramids))
    return replace(plan, blocks=tuple(_spaced(block, has_native_pyramids) for block in plan.blocks))


def _is_collapsed(source: Converter, number: int, fields: Sequence[SourceField], has_native_pyramids: bool) -> bool:
    return not has_native_pyramids and needs_hexahedra(source.blocks[number], number, fields)


def _spaced(block: NativeBlock, has_native_pyramids: bool) -> NativeBlock:
    """The block with the family of its expansions."""
    is_polynomial = block.shape is Shape.PYRAMID and block.source.pyramid is PyramidSpace.POLYNOMIAL
    return replace(block, is_ortho=is_polynomial and not has_native_pyramids)
