"""The volume that shows quantities of a dataset, or of what a runtime plugin has opened."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.distances import surface_of
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.elements.sides import SIDES
from elvis.core.quantities.tree import target_of
from elvis.plugins.native import NativeVolume
from elvis.plugins.runtime.distances import buffers_of
from elvis.plugins.runtime.formulas import Formula, facets_of, ideal_of, is_distance
from elvis.plugins.runtime.host.evaluation import (
    POINTWISE,
    HostEvaluation,
    evaluate_expression,
    host_evaluations_by_field,
    number_of,
)
from elvis.plugins.runtime.joining import join_fields
from elvis.plugins.runtime.opening import PluginData, call_plugin
from elvis.plugins.runtime.volume import Part, PartsVolume, Quantity, Solution, Volume


def volume_of(data: Dataset | PluginData, quantities: Sequence[str | Expression]) -> Volume:
    """The elements that have the first quantity, each with all of them.

    quantities  fields, expressions or predefined quantities (see `elvis.core.quantities`), as texts or parsed; every
                part
                has them by these texts in ``Part.quantities``, and the first as its own field

    ElvisError for an invalid quantity.
    """
    if isinstance(data, Dataset):
        return NativeVolume.of(data, quantities)
    return _open(data, quantities)


def names_of(data: Dataset | PluginData) -> Names:
    """Meaning of the names in expressions."""
    if isinstance(data, Dataset):
        return Names.of(data)
    own = call_plugin(data.name, "its time", lambda: float(data.source.time))
    return Names(data.fields, time=own if data.time is None else data.time, parameters=data.reference)


def _open(opened: PluginData, quantities: Sequence[str | Expression]) -> Volume:
    """A plugin's volume; expressions use the values and gradients of its fields."""
    names = names_of(opened)
    expressions = [one if isinstance(one, Expression) else Expression.parse(one, names) for one in quantities]
    volumes = volumes_of(opened, expressions)
    volume = next(iter(volumes.values()))
    if expressions[0].is_field and len(expressions) == 1:
        return volume
    parts = [
        _express(Fields(dict(zip(volumes, own, strict=True)), volume.shader_folder, volume.dimension), expressions)
        for own in zip(*(other.parts for other in volumes.values()), strict=True)
    ]
    return PartsVolume(parts, Path(volume.shader_folder), volume.dimension, getattr(volume, "faces", None))


def volumes_of(opened: PluginData, expressions: Sequence[Expression]) -> dict[str, Volume]:
    """A plugin's volumes by the fields of expressions, its first one if they have none.

    ElvisError if there is no field, and for fields on different elements.
    """
    used = tuple(dict.fromkeys(name for each in expressions for name in each.fields)) or opened.fields[:1]
    if not used:
        raise ElvisError(f"the plugin {opened.name} has opened a mesh but no field: also give the field file")
    volumes = {name: opened.volume(name) for name in used}
    for name, other in volumes.items():
        if list(map(_kind, other.parts)) != list(map(_kind, volumes[used[0]].parts)):
            raise ElvisError(f"the plugin {opened.name} has {used[0]} and {name} on different elements: choose one")
    return volumes


def _kind(part: Part) -> tuple[str, bytes]:
    """Key of the properties that parts of several fields must share."""
    return part.module, np.asarray(part.element_ids).tobytes()


@dataclass(frozen=True, eq=False)
class Fields:
    """The same elements with each of some fields; the first is the field of the resulting part."""

    parts: Mapping[str, Part]
    folder: Path
    dimension: int

    @property
    def part(self) -> Part:
        """The elements with the first field."""
        return next(iter(self.parts.values()))

    @property
    def hosts(self) -> Mapping[str, HostEvaluation] | None:
        """The elements in NumPy, by field; None where they aren't described there."""
        return host_evaluations_by_field(self.parts)


def _express(fields: Fields, expressions: Sequence[Expression]) -> Part:
    """A plugin's part with quantities; the first becomes its own."""
    part = fields.part
    quantities = {expression.text: _quantity(fields, expression) for expression in expressions}
    own = quantities[expressions[0].text]
    if expressions[0].is_field:
        return replace(part, quantities=quantities)
    return replace(
        part,
        type=own.type,
        source=own.source,
        buffers={**part.buffers, **own.buffers},
        degree=0,
        solve=_solve(fields, expressions[0]),
        bends=part.bends if fields.hosts else None,
        evaluate=None,
        bounds=None,
        rounding=None,
        is_distance=own.is_distance,
        quantities=quantities,
    )


def _solve(fields: Fields, expression: Expression) -> Callable[[Ints, Floats], Solution] | None:
    """The last resort of the part, with the values of an expression."""
    part = fields.part
    solve = part.solve
    hosts = fields.hosts
    if solve is None or hosts is None:
        return None

    def solved(elements: Ints, points: Floats) -> Solution:
        found = solve(elements, points)
        inside = np.flatnonzero(found.status == 1)
        own = found.reference[inside, : fields.dimension]
        native = 2 * own - 1 if part.unit else own
        found.field[inside] = evaluate_expression(expression, hosts, elements[inside], native)
        return found

    return solved


def _quantity(fields: Fields, expression: Expression) -> Quantity:
    names, shape = expression.fields, fields.part.shape
    part = fields.parts[names[0]] if names else fields.part
    if expression.is_field:
        buffers = {} if part is fields.part else part.buffers
        return Quantity(part.type, part.source, buffers, part.degree, part.bounds, rounding=part.rounding)
    known = (*POINTWISE, *(("shape", "quality", *SIDES) if shape else ()))
    for name in expression.attributes:
        if name not in known and target_of(name) is None:
            raise ElvisError(f"there is no {name} of elements that a runtime plugin draws")
    type, source, buffers = part.type, part.source, part.buffers
    if len(names) > 1:
        type, source, buffers = join_fields([fields.parts[name] for name in names], fields.folder)
    formula = Formula(expression, names, ideal_of(shape), fields.dimension, facets_of(shape, part.unit))
    constants = [fields.part.element_ids if name == "element" else number_of(shape) for name in formula.constants]
    table = np.stack([np.broadcast_to(one, len(part)) for one in constants] or [np.zeros(1)], axis=1)
    surfaces = buffers_of([surface_of(None, target) for target in formula.targets]) if formula.targets else {}
    own = {} if part is fields.part and len(names) < 2 else buffers
    every = {**own, "element_constants": np.ascontiguousarray(table, np.float64), **surfaces}
    plain = is_distance(expression.root)
    return Quantity(f"Expressed<{type}, Given>", f"{source} {formula.source}", every, is_distance=plain)
