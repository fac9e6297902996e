"""The report of a conversion, from its findings: errors of map and fields, and remarks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np

from elvis.core.base.arrays import Ints, joined_ints
from elvis.plugins.conversion.plugin import Converter
from elvis.plugins.conversion.report import Measure, Report, is_rounding
from elvis.plugins.projection.fitting import FieldFit
from elvis.plugins.projection.topology import Topology
from elvis.plugins.projection.verification import Findings, Tally, joint

#: the largest error is somewhat greater than the largest that is found, as it lies between points
_BETWEEN = 1.25


def report_of(
    source: Converter,
    plan: Topology,
    findings: Findings,
    straight: Findings,
    fitted: Sequence[FieldFit],
    has_map: bool,
    files: Sequence[str],
) -> Report:
    """The report of findings on the finished data, and of ``straight`` findings on the bare mesh file."""
    counts = {shape.label.lower(): len(entities) for shape, entities in plan.mesh.elements.items()}
    listed = {
        "inverted": _ids(findings.inverted),
        "degenerate": _ids([*findings.degenerate, plan.repeated]),
        "detached": _ids([plan.detached]),
        "not finite": _ids([ids for tally in findings.fields for ids in tally.broken]),
    }
    return Report(
        type(source).format or type(source).__name__,
        tuple(files),
        counts,
        _of_coordinates(source, plan, findings),
        straight.deviation,
        has_map,
        tuple(measures_of_fields(fitted, findings.fields, source)),
        listed,
        (*source.notes, *_notes(source, plan, fitted)),
        (*source.warnings, *source.declared.check(source), *plan.notes),
    )


def _of_coordinates(source: Converter, plan: Topology, findings: Findings) -> Measure:
    """How far off the coordinates are."""
    diagonal = float(np.sqrt((np.ptp(findings.box, axis=0) ** 2).sum()))
    magnitude = float(np.abs(findings.box).max(initial=0))
    order = max(block.source.order for block in plan.blocks)
    return _measure("coordinates", order, findings.coordinates, diagonal, magnitude, source)


def measures_of_fields(fitted: Sequence[FieldFit], tallies: Sequence[Tally], source: Converter) -> Iterator[Measure]:
    """How far off the fields are; where one has several planes, the worst of their coefficients."""
    pairs = zip(fitted, tallies, strict=True)
    for name, group in groupby(pairs, lambda pair: pair[0].field.name):
        planes, found = zip(*group, strict=True)
        tally = joint(found)
        spread = max(0.0, tally.high - tally.low)
        magnitude = max(abs(tally.low), abs(tally.high)) if np.isfinite(spread) else 0.0
        magnitude = max([magnitude, *(each.terms for each in found)])
        order = max((n for each in planes for n in each.modes), default=1) - 1
        is_continuous = all(each.is_continuous for each in planes)
        yield _measure(name, order, tally, spread, magnitude, source, is_continuous)


def _measure(
    name: str,
    order: int,
    tally: Tally,
    spread: float,
    magnitude: float,
    source: Converter,
    continuous: bool | None = None,
) -> Measure:
    """The error of coordinates or a field, including the error of the source itself."""
    before, before_slope = source.errors.get(name if continuous is not None else "", (0.0, 0.0))
    exact = is_rounding(tally.worst + before, spread, magnitude, source.precision)
    return Measure(
        name,
        order,
        max=before + tally.worst * (1.0 if exact else _BETWEEN),
        l2=float(np.sqrt(tally.square)),
        range=spread if np.isfinite(spread) else 0.0,
        magnitude=magnitude,
        precision=source.precision,
        element=tally.element,
        is_exact=exact,
        is_continuous=continuous,
        slope=before_slope + tally.slope * _BETWEEN,
    )


def _notes(source: Converter, plan: Topology, fitted: Sequence[FieldFit]) -> list[str]:
    notes = []
    hexahedra = sum(len(block) for block in plan.blocks if block.is_collapsed)
    if hexahedra:
        notes.append(
            f"{hexahedra} pyramids became hexahedra with a vanishing upper face, which represent their functions "
            "exactly; their sides count as non-conforming next to triangles"
        )
    for axis in sorted({each.field.name for each in fitted} & {"x", "y", "z"}):
        notes.append(f"field {axis} has the name of a coordinate: in expressions {axis} is the field")
    for each in fitted:
        if each.field.is_continuous and not each.is_continuous and source.is_conforming:
            notes.append(
                f"field {each.field.name} jumps between elements by up to {each.jump:.2g}; the jumps were preserved"
            )
    if not source.is_conforming and any(each.field.is_continuous for each in fitted):
        notes.append("faces touch only parts of others: continuous fields were converted element by element")
    return notes


def _ids(parts: Sequence[Ints]) -> tuple[int, ...]:
    return tuple(np.unique(joined_ints(parts)).tolist())
