"""Fields of one dataset on the mesh of another: the L2 projection on each element, with its errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from elvis.core.base.arrays import frozen_floats, frozen_ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.rounded_up import rounded_up
from elvis.core.data.dataset import Block, Dataset, Field
from elvis.core.integrals import integrate
from elvis.plugins.conversion.report import Measure, Report
from elvis.plugins.conversion.reporting import measures_of_fields
from elvis.plugins.data.added_quantities import unchanged_map, with_errors
from elvis.plugins.data.common_blocks import on_common_blocks
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.fitting import FieldFit
from elvis.plugins.projection.measuring import measure
from elvis.plugins.projection.sampling import Sampler
from elvis.plugins.projection.verification import Maps
from elvis.plugins.transfers.element_projection import ElementProjection
from elvis.plugins.transfers.other_mesh import OtherMesh

#: share of a target up to which it counts as not covered
_LEAST_COVERED = 1e-12
#: difference of two areas or volumes, as a share, that means the same
_SAME_SIZE = 1e-6


@dataclass(frozen=True)
class Integral:
    """The integral of a field over the source and over the target."""

    name: str
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Transfer:
    """Fields on the mesh of another dataset.

    measures   the error of each, at points that no rule has used
    integrals  of each, before and after
    covered    the share of the target's measure that the source covers
    halvings   how often boxes were bisected at most
    residual   disagreement of rules in the end, as a share of an element's integral: an estimate of the error
    reaches_beyond  whether elements of the source lie outside the target
    not_finite  ids of elements in which a field is nan
    """

    dataset: Dataset
    measures: tuple[Measure, ...]
    integrals: tuple[Integral, ...]
    covered: float
    halvings: int
    residual: float
    reaches_beyond: bool = False
    not_finite: tuple[int, ...] = ()


def onto_mesh(
    source: Dataset,
    target: Dataset,
    order: int | None = None,
    outside: str = "error",
    fields: Sequence[str] | None = None,
) -> Transfer:
    """The fields of a dataset, projected in L2 onto the elements of another one's mesh.

    order    polynomial degree of the projections, 1 to 30; by default each field's own
    outside  ``error``, ``nan``, ``nearest`` (the value at the nearest point of the source's boundary) or a number,
             for points that the source doesn't cover
    fields   names; None for all

    ElvisError for data of different dimensions or with Fourier directions, and for points outside with ``error``.

    >>> coarse = elvis.from_arrays({"triangle": [[[0, 0], [1, 0], [0, 1]]]})
    >>> ds = elvis.from_arrays({"triangle": [[[0, 0], [1, 0], [0, 1]]]}, u=[[0, 1, 0]], v=[[0, 0, 0]])
    >>> elvis.onto_mesh(ds, coarse).dataset
    <Dataset 2D: 1 triangle; fields u, v of order 1>
    """
    if source.mesh.dimension != target.mesh.dimension:
        found = f"{source.mesh.dimension}D and {target.mesh.dimension}D"
        raise ElvisError(f"--onto: expected meshes of one dimension, found {found}")
    converter = OtherMesh(source, target, order, outside, fields)
    work = ElementProjection(converter, target)
    fitted = work.fitted()
    if not work.covered > _LEAST_COVERED:
        raise ElvisError("--onto: the mesh and the data do not overlap")
    sampler = Sampler(converter)
    findings = measure(sampler, Maps(target), work.blocks, fitted)
    measures = tuple(measures_of_fields(fitted, findings.fields, converter))
    solution = tuple(_field(fit, work.blocks) for fit in fitted)
    held = tuple(own for own in target.fields if own.name in target.map_names)
    bare = replace(target, fields=(*held, *solution), time=source.time, expansions=(), session={}, remarks=())
    dataset = on_common_blocks(replace(bare, metadata=with_errors(bare, measures)))
    lost = tuple(sorted({own for field in solution for block in field.blocks for own in _not_finite(block)}))
    integrals = [Integral(own.name, _integral(source, own.name), _integral(dataset, own.name)) for own in solution]
    size = _integral(source, "1")
    beyond = size - work.covered * work.measure > (_SAME_SIZE + work.residual) * size
    return Transfer(dataset, measures, tuple(integrals), work.covered, work.halvings, work.residual, beyond, lost)


def _field(fit: FieldFit, blocks: Sequence[NativeBlock]) -> Field:
    parts = [
        Block(block.expansion(modes), frozen_ints(block.ids), frozen_floats(coefficients))
        for block, modes, coefficients in zip(blocks, fit.modes, fit.coefficients, strict=True)
    ]
    return Field(fit.field.name, tuple(parts), False)


def _not_finite(block: Block) -> list[int]:
    ids: list[int] = block.element_ids[~np.isfinite(block.coefficients).all(axis=1)].tolist()
    return ids


def _integral(dataset: Dataset, name: str) -> float:
    return integrate(dataset, name).value


def report_of_transfer(found: Transfer, files: Sequence[Path]) -> Report:
    """The report of a projection: errors, integrals before and after, and the share that is covered."""
    counts = {shape.label.lower(): len(entities) for shape, entities in found.dataset.mesh.elements.items()}
    names = tuple(file.name for file in files)
    notes = [_sentence(own, found.reaches_beyond) for own in found.integrals]
    if found.covered < 1:
        is_estimate = ", an estimate" if found.residual > 0 else ""
        notes.append(f"the data cover {found.covered:.10g} of the target's measure{is_estimate}")
    if found.residual > 0:
        notes.append(
            f"the quadrature error where elements of the data end is up to {rounded_up(found.residual)} of a field, an "
            "estimate from two rules"
        )
    transfer = {
        "covered": found.covered,
        "residual": found.residual,
        "is_bound": found.residual == 0,
        "integrals": {own.name: {"before": own.before, "after": _finite(own.after)} for own in found.integrals},
    }
    listed = {"not finite": found.not_finite}
    report = Report(
        OtherMesh.format,
        names,
        counts,
        unchanged_map(found.dataset),
        (0.0, -1),
        False,
        found.measures,
        listed,
        tuple(notes),
    )
    return replace(report, transfer=transfer)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _sentence(own: Integral, reaches_beyond: bool) -> str:
    if reaches_beyond:
        return (
            f"the integral of {own.name} over the mesh is {own.after:.15g}; over all elements of the data, which reach "
            f"beyond the mesh, {own.before:.15g}"
        )
    return (
        f"the integral of {own.name} is {own.after:.15g}, in the data {own.before:.15g}: {own.after - own.before:+.2g}"
    )
