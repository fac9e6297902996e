"""The volume that shows quantities of a dataset, or of what a runtime plugin has opened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from elvis.formats.dataset import Dataset
from elvis.formats.distances import surface_of
from elvis.formats.errors import ElvisError
from elvis.formats.quantities import Expression, Names
from elvis.formats.quantities.attributes import target_of
from elvis.plugins.distances import buffers_of
from elvis.plugins.formulas import Formula
from elvis.plugins.native import NativeVolume
from elvis.plugins.opening import Opened, guarded
from elvis.plugins.volume import Part, Quantity, Shown, Volume


def volume_of(data: Dataset | Opened, quantities: Sequence[str]) -> Volume:
    """The elements that have the first quantity, each with all of them.

    quantities  fields, expressions or ready-made quantities (see `elvis.formats.quantities`); every part has them by
                these names in ``Part.quantities``, and the first as its own field

    ElvisError for what names no quantity.  A runtime plugin's volume serves quantities of one of its fields.
    """
    if isinstance(data, Dataset):
        return NativeVolume.of(data, quantities)
    return _opened(data, quantities)


def names_of(data: Dataset | Opened) -> Names:
    """What names in expressions can stand for."""
    if isinstance(data, Dataset):
        return Names.of(data)
    return Names(data.fields, time=guarded(data.name, "its time", lambda: float(data.source.time)))


def dimension_of(dataset: Dataset) -> int:
    """Number of coordinates that a picture of the dataset has: those of its elements, and Fourier directions."""
    names = Names.of(dataset)
    return dataset.mesh.dimension + names.dimension - dataset.mesh.space


def _opened(opened: Opened, texts: Sequence[str]) -> Volume:
    """A plugin's volume; expressions are made of its values and slopes."""
    names = names_of(opened)
    expressions = [Expression.parse(text, names) for text in texts]
    used = tuple(dict.fromkeys(name for each in expressions for name in each.fields)) or opened.fields[:1]
    if len(used) != 1:
        found = ", ".join(used) or "none"
        raise ElvisError(f"the plugin {opened.name} shows quantities of one of its fields, found {found}")
    volume = opened.volume(used[0])
    if expressions[0].is_field and len(expressions) == 1:
        return volume
    parts = [_expressed(part, expressions, volume.dimension) for part in volume.parts]
    return Shown(parts, Path(volume.shader_folder), volume.dimension, getattr(volume, "faces", None))


def _expressed(part: Part, expressions: Sequence[Expression], dimension: int) -> Part:
    """A plugin's part with quantities, of which the first is its own."""
    quantities = {expression.text: _quantity(part, expression, dimension) for expression in expressions}
    own = quantities[expressions[0].text]
    if expressions[0].is_field:
        return replace(part, quantities=quantities)
    return replace(
        part,
        type=own.type,
        source=own.source,
        buffers={**part.buffers, **own.buffers},
        degree=0,
        solve=None,
        evaluate=None,
        quantities=quantities,
    )


def _quantity(part: Part, expression: Expression, dimension: int) -> Quantity:
    if expression.is_field:
        return Quantity(part.type, part.source, {}, part.degree, part.bounds)
    unknown = [name for name in expression.attributes if name != "element" and target_of(name) is None]
    if unknown:
        raise ElvisError(f"there is no {unknown[0]} of elements that a runtime plugin draws")
    formula = Formula(expression, expression.fields, np.eye(3), dimension)
    constants = part.element_ids.astype(np.float64) if formula.constants else np.zeros(1)
    source = f"{part.source} {formula.source}"
    surfaces = buffers_of([surface_of(None, target) for target in formula.targets]) if formula.targets else {}
    return Quantity(f"Expressed<{part.type}, Given>", source, {"element_constants": constants, **surfaces})
