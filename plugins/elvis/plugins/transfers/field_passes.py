"""Fields of a source on the mesh of a dataset, projected with some settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from elvis.core.base.arrays import frozen_floats, frozen_ints
from elvis.core.data.dataset import Block, Dataset
from elvis.plugins.conversion.converting import Settings, projected
from elvis.plugins.conversion.plugin import Converter, SourceField
from elvis.plugins.projection.choosing import ChosenOrders
from elvis.plugins.projection.measuring import measure
from elvis.plugins.projection.projecting import Projection
from elvis.plugins.projection.sampling import Sampler
from elvis.plugins.projection.verification import Maps


class DatasetSource(Converter):
    """A source that has the mesh of a dataset."""

    dataset: Dataset


class FieldPass:
    """The projection of some fields with some settings."""

    def __init__(self, source: DatasetSource, fields: Sequence[SourceField], settings: Settings) -> None:
        sampler, maps = Sampler(source), Maps(source.dataset)
        held = [any(own.is_on(i) for own in fields) for i in range(len(source.blocks))]
        orders = ChosenOrders.of(source, fields, False)
        plan = replace(orders.plan, blocks=tuple(own for own in orders.plan.blocks if held[own.number]))
        found: Projection = projected(sampler, source.dataset.mesh, replace(orders, plan=plan), settings)
        first = None if source.dataset.map_names else found.findings
        findings = measure(sampler, maps, found.blocks, found.fields, first)
        self.projection = replace(found, findings=findings)


def blocks_of(passes: Sequence[FieldPass], name: str) -> tuple[Block, ...]:
    """The blocks of a field from all projections."""
    found = []
    for own in passes:
        for fit in own.projection.fields:
            for block, modes, coefficients in zip(own.projection.blocks, fit.modes, fit.coefficients, strict=True):
                if fit.field.name == name and modes:
                    values = frozen_floats(coefficients)
                    found.append(Block(block.expansion(modes), frozen_ints(block.ids), values))
    return tuple(found)
