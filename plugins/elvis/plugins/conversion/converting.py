"""Conversion: from a converter's samples to a dataset of the native format, with a report of the errors."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from elvis.core.base.arrays import concatenated, frozen_floats, frozen_ints, joined_ints
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.data.dataset import MAP_FIELDS, MAP_KEY, Block, Dataset, Field
from elvis.core.data.mesh import Mesh
from elvis.core.interfaces.interface_composites import with_interfaces
from elvis.core.mapping.mode_entities import entities
from elvis.core.quantities.needed import needed_fields
from elvis.core.validity.folded import folded
from elvis.plugins.conversion.plugin import Converter, SourceField
from elvis.plugins.conversion.report import Report
from elvis.plugins.conversion.reporting import report_of
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.choosing import (
    ChosenOrders,
    with_better_fields,
    with_better_map,
    with_foreseen_fields,
    with_foreseen_map,
)
from elvis.plugins.projection.curves import with_curves
from elvis.plugins.projection.fitting import FieldFit, Positions, beyond, field_modes, fit_positions, padded
from elvis.plugins.projection.measuring import is_exact_map, measure
from elvis.plugins.projection.projecting import Projection, at_order, at_tolerance, fit_joined
from elvis.plugins.projection.sampling import Sampler
from elvis.plugins.projection.topology import Topology
from elvis.plugins.projection.verification import Findings, Maps, check
from elvis.plugins.series.between import on_mesh_of

GeometryChoice = Literal["auto", "curves", "map"]
PyramidChoice = Literal["exact", "native"]

#: coefficients below this share of the largest are rounding
_LOST = 1e-12

#: the highest order that is asked of a source; more is a slip
HIGHEST = 30


@dataclass(frozen=True)
class Settings:
    """How to convert.

    order      of every field; None keeps the source's
    tolerance  relative error that each element must reach at the lowest order that does; None keeps the orders
    geometry   whether the full map travels as fields: always, never, or where the mesh file can't hold it
    pyramids   ``native`` projects onto the modified pyramid of Nektar++ whatever cannot be held by it
    fields     names of those to convert; None for all
    choose     selects the requested names, given a dataset with all names and no values; None for all
    """

    order: int | None = None
    tolerance: float | None = None
    geometry: GeometryChoice = "auto"
    pyramids: PyramidChoice = "exact"
    fields: tuple[str, ...] | None = None
    choose: Callable[[Dataset], Collection[str]] | None = None

    def __post_init__(self) -> None:
        if self.order is not None and not 1 <= self.order <= HIGHEST:
            raise ElvisError(f"expected an order from 1 to {HIGHEST}, found {self.order}")
        if self.tolerance is not None and not 0 < self.tolerance < np.inf:
            raise ElvisError(f"expected a positive tolerance, found {self.tolerance}")
        if self.geometry not in get_args(GeometryChoice) or self.pyramids not in get_args(PyramidChoice):
            raise ElvisError(f"expected known choices, found geometry {self.geometry} and pyramids {self.pyramids}")

    @property
    def raises_fields(self) -> bool:
        """Whether the orders of fields are chosen automatically."""
        return self.order is None and self.tolerance is None and self.pyramids != "native"


@dataclass(frozen=True, eq=False)
class Conversion:
    """The converted data and the report.

    blocks  how each element lies in the source's
    maps    the coordinates as fields, where the mesh file can't hold them
    fields  of the source, with the orders at which they were converted
    names   of all fields that could be converted
    """

    dataset: Dataset
    report: Report
    blocks: tuple[NativeBlock, ...]
    maps: tuple[FieldFit, ...] = ()
    fields: tuple[SourceField, ...] = ()
    names: tuple[str, ...] = ()

    @property
    def is_whole(self) -> bool:
        """Whether all fields were converted."""
        return len({field.name for field in self.fields}) == len(self.names)


@dataclass(frozen=True, eq=False)
class _Attempt:
    """A conversion with chosen orders.

    dataset   mesh and fields
    fitted    the fields on the native blocks
    maps      the coordinates as fields, if the mesh file can't represent them
    straight  findings on the map of the mesh file without these fields
    findings  findings on the data
    """

    orders: ChosenOrders
    dataset: Dataset
    blocks: list[NativeBlock]
    fitted: list[FieldFit]
    maps: list[FieldFit]
    straight: Findings
    findings: Findings

    def report(self, files: Sequence[str]) -> Report:
        """How far off everything is."""
        orders = self.orders
        has_map = bool(self.maps)
        return report_of(orders.source, orders.plan, self.findings, self.straight, self.fitted, has_map, files)


# the largest numbers of a source overflow in products: what becomes infinite is reported by its findings
@np.errstate(over="ignore", invalid="ignore")
def convert(source: Converter, settings: Settings | None = None, files: Sequence[str | Path] = ()) -> Conversion:
    """The native dataset of a source, checked against the source's own samples.

    files  to be named in the report and in errors
    ElvisError where the source can't be represented, or contradicts itself.
    """
    settings = settings or Settings()
    try:
        fields = _choose_fields(source, settings.fields)
        attempt = _best_attempt(source, fields, settings)
    except FormatError as error:
        raise error.within(", ".join(map(str, files))) from error
    interfaces = with_interfaces(
        attempt.dataset, attempt.orders.plan.outline, source.precision, [attempt.orders.plan.mortars]
    )
    dataset = interfaces.dataset
    # a mesh of the source's own may have elements that it doesn't list
    suspects = joined_ints(attempt.findings.doubtful) if source.mesh is None else None
    invalid = folded(dataset, suspects=suspects)
    attempt.findings.inverted.append(invalid.wrong)
    report = attempt.report([Path(file).name for file in files])
    report = replace(report, warnings=(*report.warnings, *interfaces.warnings, *invalid.sentences()))
    dataset = replace(dataset, metadata={**dataset.metadata, **report.metadata()})
    names = tuple(dict.fromkeys(field.name for field in fields))
    return Conversion(dataset, report, tuple(attempt.blocks), tuple(attempt.maps), attempt.orders.fields, names)


def _best_attempt(source: Converter, fields: Sequence[SourceField], settings: Settings) -> _Attempt:
    """The data at orders that a few elements need, or that the elements with the largest errors need."""
    orders = ChosenOrders.of(source, fields, settings.pyramids == "native")
    if settings.choose is not None:
        names = settings.choose(_without_values(source, orders.plan.mesh, fields))
        orders = replace(orders, fields=tuple(field for field in orders.fields if field.name in names))
    raises_map = source.mesh is None and settings.geometry != "curves"
    if raises_map:
        orders = with_foreseen_map(orders)
    if settings.raises_fields:
        orders = with_foreseen_fields(orders)
    attempt = _attempt(orders, settings)
    if raises_map and not is_exact_map(attempt.findings, source.precision):
        attempt = _attempt(with_better_map(attempt.orders, attempt.findings.coordinates), settings, attempt)
    if settings.raises_fields:
        attempt = _attempt(with_better_fields(attempt.orders, attempt.findings.fields), settings, attempt)
    return attempt


def _without_values(source: Converter, mesh: Mesh, fields: Sequence[SourceField]) -> Dataset:
    """The dataset of a source with only the names of fields."""
    named = tuple(Field(name, ()) for name in dict.fromkeys(field.name for field in fields))
    return Dataset(mesh, named, source.time, dict(source.metadata), source.expansions, source.session)


def convert_again(source: Converter, before: Conversion, quantities: Sequence[str] = ()) -> Dataset:
    """The dataset of a converted source in which only the fields have changed.

    quantities  for which fields are needed, the empty one for the first field: others are skipped; none: all are needed

    Mesh, blocks and the errors in the metadata are the previous ones: the error is not measured again.  ElvisError if
    the fields can't be represented.
    """
    orders = {field.name: field for field in before.fields}
    fields = [_at_order_of(field, orders.get(field.name)) for field in _choose_fields(source, None)]
    mesh, blocks = before.dataset.mesh, list(before.blocks)
    wanted = _needed(source, before, fields, quantities) if quantities else fields
    fitted = fit_joined(Sampler(source), mesh, blocks, wanted)
    dataset = _dataset(source, mesh, blocks, fields, [*fitted, *before.maps], bool(before.maps))
    dataset = replace(dataset, metadata={**dataset.metadata, **before.report.metadata()})
    return on_mesh_of(before.dataset, dataset)


def _at_order_of(field: SourceField, before: SourceField | None) -> SourceField:
    """A field at the order at which another state of it was converted."""
    if before is None:
        return field
    return replace(field, order=before.order, is_polynomial=before.is_polynomial)


def converted_object(source: Converter, name: str, settings: Settings | None = None) -> Dataset:
    """The dataset of a source that is not a file; a remark calls it ``name`` and states the error."""
    conversion = convert(source, settings, files=(name,))
    return replace(conversion.dataset, remarks=conversion.report.remarks())


def _attempt(orders: ChosenOrders, settings: Settings, before: _Attempt | None = None) -> _Attempt:
    """The data at chosen orders, measured; unchanged results of ``before`` are reused."""
    if before is not None and before.orders is orders:
        return before
    source, sampler = orders.source, Sampler(orders.source)
    if before is not None and before.orders.plan.mesh is not orders.plan.mesh:
        before = None
    mesh, positions = _mesh(orders, before)
    found = projected(sampler, mesh, orders, settings, before.fitted if before else ())
    blocks, fitted, straight = found.blocks, found.fields, found.findings

    # where the mesh file can't hold the map, it travels as fields
    has_map = settings.geometry == "map" or (settings.geometry == "auto" and straight.exceeding)
    maps = _maps(sampler, mesh, blocks, positions) if has_map else []
    del positions
    dataset = _dataset(source, mesh, blocks, orders.fields, [*fitted, *maps], has_map)
    first = straight
    if has_map:
        first = check(sampler, Maps(dataset), blocks, (), source.precision)
        first.fields = straight.fields
    findings = measure(sampler, Maps(dataset), blocks, fitted, first)
    return _Attempt(orders, dataset, blocks, fitted, maps, straight, findings)


def _mesh(orders: ChosenOrders, before: _Attempt | None) -> tuple[Mesh, Positions | None]:
    """The mesh with its curves, and the coordinates if they were fitted for that."""
    if orders.source.mesh is not None:
        return orders.plan.mesh, None
    if before is not None and before.orders.source is orders.source:
        return before.dataset.mesh, None
    return _curve(Sampler(orders.source), orders.plan)


def _needed(
    source: Converter, before: Conversion, fields: Sequence[SourceField], quantities: Sequence[str]
) -> list[SourceField]:
    """The fields on which quantities depend."""
    known = before.dataset
    named = (
        *(Field(name, ()) for name in dict.fromkeys(each.name for each in fields)),
        *map(known.field, known.map_names),
    )
    state = Dataset(known.mesh, named, source.time, {**known.metadata, **source.metadata})
    names = needed_fields(state, quantities)
    return [each for each in fields if each.name in names]


def _dataset(
    source: Converter,
    mesh: Mesh,
    blocks: Sequence[NativeBlock],
    fields: Sequence[SourceField],
    fitted: Sequence[FieldFit],
    has_map: bool,
) -> Dataset:
    """Mesh and fields, all with the maximum number of modes on each block: one section per shape in files.

    fields  all fields of the source, some of which may not be fitted
    """
    modes = [_modes(block, fields, [(each, i) for each in fitted]) for i, block in enumerate(blocks)]
    metadata = dict(source.metadata)
    if has_map:
        metadata[MAP_KEY] = ",".join(MAP_FIELDS[: mesh.space])
    named = [list(group) for _, group in groupby(fitted, lambda each: each.field.name)]
    converted = tuple(_field(planes, blocks, modes) for planes in named)
    return Dataset(mesh, converted, source.time, metadata, source.expansions, source.session)


def _modes(
    block: NativeBlock, fields: Sequence[SourceField], fitted: Sequence[tuple[FieldFit, int]]
) -> tuple[int, ...]:
    """Numbers of modes of a block in files, in each direction, given its number among the blocks of each field.

    The source's numbers are used if it states them and if nothing that they lack exceeds rounding.  Otherwise they do
    not depend on values: all steps of a solver have the same, for every choice of fields.
    """
    dimension = block.shape.dimension
    wide = max([2, *(field_modes(block, each) for each in fields), *(each.modes[i] for each, i in fitted)])
    alike = (wide,) * dimension
    fitted = [(each, i) for each, i in fitted if each.modes[i]]
    own = [each.field.modes[block.number] if each.field.modes else None for each, _ in fitted]
    if not any(own) or block.modes is not None or block.is_collapsed or block.order.any():
        return alike
    kept = tuple(np.max([modes or (2,) * dimension for modes in own], axis=0, initial=2).tolist())
    for each, i in fitted:
        coefficients = each.coefficients[i]
        lost = beyond(coefficients, block.expansion(each.modes[i]), block.expansion(kept))
        if lost > _LOST * float(np.abs(coefficients).max(initial=0.0)):
            return alike
    return kept


def _choose_fields(source: Converter, names: tuple[str, ...] | None) -> list[SourceField]:
    """The fields to convert that some elements have; ElvisError for unknown, doubled or reserved names."""
    known = [field.name for field in source.fields]
    for name in names or ():
        if name not in known:
            raise ElvisError(f"there is no field {name!r}; the fields are {', '.join(known) or 'none'}")
    chosen = [field for field in source.fields if names is None or field.name in names]
    for field in chosen:
        if len({id(each.homogeneous) for each in chosen if each.name == field.name}) > 1 or (
            field.homogeneous is None and [each.name for each in chosen].count(field.name) > 1
        ):
            raise ElvisError(f"expected fields of distinct names, found several {field.name!r}")
        if field.name in MAP_FIELDS:
            raise ElvisError(f"expected no field {field.name!r}, which is the name of a coordinate")
        _check_field(source, field)
    return [field for field in chosen if any(field.is_on(i) and len(b) for i, b in enumerate(source.blocks))]


def _check_field(source: Converter, field: SourceField) -> None:
    if not isinstance(field.order, int) and len(field.order) != len(source.blocks):
        raise ElvisError(f"field {field.name}: expected {len(source.blocks)} orders, found {len(field.order)}")
    for number in range(len(source.blocks)):
        order = field.order_on(number)
        if order is not None and not 0 <= order <= HIGHEST:
            raise ElvisError(f"field {field.name}: expected an order from 0 to {HIGHEST}, found {order}")


def _curve(sampler: Sampler, plan: Topology) -> tuple[Mesh, Positions]:
    """The mesh with the curves of the source's map, in the space of the axes up to the last that is used, and the map.

    The mesh file has no coefficients for the inside of elements; if there are any, all coefficients are kept.
    """
    is_kept = any(len(entities(block.shape, block.source.order + 1).inside) for block in plan.blocks)
    found = fit_positions(sampler, plan.mesh, plan.blocks, is_kept=is_kept)
    mesh = replace(plan.mesh, space=max(plan.mesh.dimension, found.space))
    pairs = zip(plan.blocks, found.columns, strict=False)
    lines = [(block.mesh_rows, own.transpose(1, 0, 2)) for block, own in pairs] if mesh.dimension == 1 else []
    return with_curves(mesh, found.skins, lines), found


def projected(
    sampler: Sampler, mesh: Mesh, orders: ChosenOrders, settings: Settings, before: Sequence[FieldFit] = ()
) -> Projection:
    """The fields on the blocks, parted by order where that is chosen by element, and how far off all is."""
    blocks = [block for block in orders.plan.blocks if len(block)]
    fields = orders.fields
    if settings.tolerance is not None and fields:
        return at_tolerance(sampler, mesh, blocks, fields, settings.tolerance, settings.order or HIGHEST)
    if settings.order is not None:
        blocks = [replace(block, modes=settings.order + 1) for block in blocks]
    return at_order(sampler, mesh, blocks, fields, before)


def _maps(sampler: Sampler, mesh: Mesh, blocks: Sequence[NativeBlock], known: Positions | None) -> list[FieldFit]:
    """The coordinates as fields, with one trace on what elements share wherever theirs agree.

    known  the coordinates in Modified expansions, None if they are to be fitted
    """
    is_known = known is not None and known.is_on(blocks) and not any(block.is_ortho for block in blocks)
    own = known if known is not None and is_known else fit_positions(sampler, mesh, blocks, in_own_space=True)
    found = own.joined()
    if found is None:
        found = fit_positions(sampler, mesh, blocks, in_own_space=True).columns
    modes = tuple(block.source.order + 1 for block in blocks)
    source_fields = [SourceField(name, max(modes) - 1) for name in MAP_FIELDS]
    columns = zip(source_fields, zip(*found, strict=True), strict=True)
    return [FieldFit(field, modes, column) for field, column in list(columns)[: mesh.space]]


def _field(planes: Sequence[FieldFit], blocks: Sequence[NativeBlock], modes: Sequence[tuple[int, ...]]) -> Field:
    """The field with ``modes`` on each block; of several planes where it has Fourier directions."""
    parts, first = [], planes[0]
    for i, (block, many) in enumerate(zip(blocks, modes, strict=True)):
        if not first.modes[i]:
            continue
        full = [padded(p.coefficients[i], block.expansion(p.modes[i]), block.expansion(many)) for p in planes]
        expansion = replace(block.expansion(many), homogeneous=first.field.homogeneous)
        stacked = concatenated(full, axis=1)
        parts.append(Block(expansion, frozen_ints(block.ids), frozen_floats(stacked)))
    return Field(first.field.name, tuple(parts), all(each.is_continuous for each in planes))
