"""The fields of a source on native blocks: at orders that are given, or at the lowest that are good enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import joined_ints, largest
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import Mesh
from elvis.plugins.conversion.plugin import SourceField
from elvis.plugins.projection.adaptivity import adapt, bounds_of, enrich
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.fitting import FieldFit, fit_fields, join_traces
from elvis.plugins.projection.sampling import Sampler
from elvis.plugins.projection.traces import Traces
from elvis.plugins.projection.verification import Findings, Maps, check

#: rounds of raising orders
_ROUNDS = 6

#: how much worse than its parts a field with one trace may be
_FAR = 4.0


@dataclass(frozen=True, eq=False)
class Projection:
    """Fields on native blocks, and what a check of them and of the map of the mesh file found."""

    blocks: list[NativeBlock]
    fields: list[FieldFit]
    findings: Findings


def at_order(
    sampler: Sampler,
    mesh: Mesh,
    blocks: list[NativeBlock],
    fields: Sequence[SourceField],
    before: Sequence[FieldFit] = (),
) -> Projection:
    """The fields at the orders of the blocks, or at their own on blocks without one.

    before  fields on these elements, which are reused for the same ``fields``
    """
    known = {id(each.field): each for each in before}
    new = fit_joined(sampler, mesh, blocks, [field for field in fields if id(field) not in known])
    known.update({id(each.field): each for each in new})
    fitted = [known[id(field)] for field in fields]
    return Projection(blocks, fitted, check(sampler, Maps(Dataset(mesh)), blocks, fitted, sampler.source.precision))


def fit_joined(
    sampler: Sampler, mesh: Mesh, blocks: Sequence[NativeBlock], fields: Sequence[SourceField]
) -> list[FieldFit]:
    """The fields at the orders of the blocks or their own, with one trace where they are continuous; not checked."""
    return _join(sampler, mesh, blocks, fit_fields(sampler, blocks, fields))


def at_tolerance(
    sampler: Sampler,
    mesh: Mesh,
    blocks: list[NativeBlock],
    fields: Sequence[SourceField],
    tolerance: float,
    highest: int,
) -> Projection:
    """The fields at orders, at most ``highest``, at which no error exceeds ``tolerance`` of the field's range.

    Starts with the lowest order that each element needs by its own, raised where the trace of a neighbour requires it.
    """
    bounds = bounds_of(sampler, blocks, fields, tolerance)
    blocks = adapt(sampler, blocks, fields, bounds, highest)
    maps = Maps(Dataset(mesh))
    for _ in range(_ROUNDS):
        fitted = _join(sampler, mesh, blocks, fit_fields(sampler, blocks, fields), by_force=True)
        findings = check(sampler, maps, blocks, fitted, sampler.source.precision, bounds)
        last = Projection(blocks, fitted, findings)
        beyond = joined_ints(ids for tally in findings.fields for ids in tally.beyond)
        if not len(beyond):
            return last
        blocks = enrich(blocks, fields, beyond, highest)
        if _orders(blocks) == _orders(last.blocks):
            break
    return _parted_where_better(sampler, maps, last)


def _orders(blocks: Sequence[NativeBlock]) -> list[tuple[int | None, int]]:
    return [(block.modes, len(block)) for block in blocks]


def _parted_where_better(sampler: Sampler, maps: Maps, joint: Projection) -> Projection:
    """Each field with one trace, unless that is off by far more than what elements hold by themselves."""
    alone = fit_fields(sampler, joint.blocks, [each.field for each in joint.fields])
    apart = check(sampler, maps, joint.blocks, alone, sampler.source.precision)
    fitted = list(joint.fields)
    for i, (one, none) in enumerate(zip(joint.findings.fields, apart.fields, strict=True)):
        if one.worst > _FAR * none.worst:
            fitted[i], joint.findings.fields[i] = replace(alone[i], jump=fitted[i].jump), none
    return Projection(joint.blocks, fitted, joint.findings)


def _join(
    sampler: Sampler, mesh: Mesh, blocks: Sequence[NativeBlock], fitted: Sequence[FieldFit], by_force: bool = False
) -> list[FieldFit]:
    """The fields, continuous ones with one trace on shared entities.

    by_force  also if elements of different order differ there
    """
    source, result = sampler.source, list(fitted)
    known: dict[tuple[int, ...], Traces] = {}
    for i, each in enumerate(result):
        modes = tuple(0 if block.is_ortho else n for block, n in zip(blocks, each.modes, strict=True))
        if not each.field.is_continuous or not source.is_conforming or not any(modes):
            continue
        if modes not in known:
            known[modes] = Traces(mesh, blocks, modes)
        magnitude = max(map(largest, each.coefficients), default=0.0)
        tolerance = np.inf if by_force else (1e-9 + 16 * source.precision) * magnitude
        result[i] = join_traces(each, known[modes])
        if not result[i].jump <= tolerance:
            alone = fit_fields(sampler, blocks, [each.field])[0]
            result[i] = replace(alone, jump=result[i].jump)
    return result
