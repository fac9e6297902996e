"""Patches of a dataset turned into the buffers of the native Slang modules."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from pathlib import Path

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.boxes import Boxes, element_boxes
from elvis.core.mapping.geometry import kept
from elvis.core.mapping.patch import Patch, patches
from elvis.core.polynomials.bernstein import BernsteinSpace
from elvis.core.quantities import Expression
from elvis.core.quantities.attributes import Attributes
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.summary.picturing import Kind
from elvis.plugins.native.device_spaces import field_space, map_space
from elvis.plugins.native.elements import Elements
from elvis.plugins.native.polynomials import is_affine
from elvis.plugins.runtime.volume import Part

#: coefficients that may all be raised to one order
FEW_BYTES = 1 << 24


@dataclass(frozen=True, eq=False)
class NativeVolume:
    """The elements of a dataset that carry a quantity."""

    dimension: int
    parts: Sequence[Part]

    @property
    def shader_folder(self) -> Path:
        """Folder of the Slang modules of the shapes."""
        return Path(__file__).parent

    @staticmethod
    def of(dataset: Dataset, quantities: str | Sequence[str | Expression]) -> NativeVolume:
        """The elements that have the first quantity, with all of them: fields, expressions, predefined ones.

        Elements of one shape and one pair of degrees make a part; quasi-3D data become one period of their planes along
        z, or of their lines along z or y and z.  Raises ElvisError for what names no quantity, and for lines.
        """
        texts = (quantities,) if isinstance(quantities, str) else tuple(quantities)
        expressions = [one if isinstance(one, Expression) else Expression.of(dataset, one) for one in texts]
        names = tuple(dict.fromkeys(name for each in expressions for name in each.fields))
        carried = expressions[0].fields
        found = [
            patch
            for patch in patches(dataset, names)
            if all(patch.fields[names.index(name)] is not None for name in carried)
        ]
        dimension = _dimension(dataset, found)
        primary = names.index(carried[0]) if carried else None
        attributes = Attributes(dataset)
        derived = any(expression.order for expression in expressions)
        sorts = by_affinity(found) if derived else [found]
        count = dataset.mesh.count
        groups = [group for sort in sorts for group in _groups(sort, primary, count)]
        keep = partial(kept, dataset)
        made = (Elements(own, geometry, names, expressions, attributes, keep, count) for geometry, own in groups)
        parts = [elements.part() for elements in made]
        if dimension == 2 and Kind.of(dataset) is Kind.SURFACE:
            parts = [_in_space(part) for part in parts]
        return NativeVolume(dimension, parts)


def placed(
    dataset: Dataset,
    every: Sequence[Patch],
    expression: Expression,
    boxes_of: Callable[[Patch], Boxes] = element_boxes,
) -> NativeVolume:
    """The elements that carry a quantity, with ids and boxes only, in one part for each patch.

    every     patches with the fields of the quantity, and with others after these
    boxes_of  gives the boxes of a patch
    """
    count = len(expression.fields)
    found = [patch for patch in every if all(own is not None for own in patch.fields[:count])]
    parts = [Part("", "", patch.element_ids, boxes_of(patch), {}) for patch in found]
    return NativeVolume(_dimension(dataset, found), parts)


def stacks(found: Sequence[Patch], evaluator: Evaluator, names: tuple[str, ...]) -> Iterator[tuple[Part, list[Patch]]]:
    """Parts that have several fields of a dataset in each element (see Elements.stack), with the patches in each."""
    for geometry, own in _groups(found, evaluator.names.index(names[0]), sum(map(len, found))):
        elements = Elements(own, geometry, evaluator.names, evaluator.expressions, evaluator.attributes)
        part = elements.stack(names)
        is_in_space = geometry.shape.dimension == 2 and not all(patch.is_flat for patch in own)
        yield (_in_space(part) if is_in_space else part), own


def _dimension(dataset: Dataset, found: Sequence[Patch]) -> int:
    """2 (in the plane or on a surface in space) or 3; ElvisError for lines."""
    mesh = dataset.mesh
    waves = {own.homogeneous for patch in found for own in patch.fields if own is not None}
    if waves <= {None} and mesh.dimension > 1:
        return mesh.dimension
    (series, *others) = waves or {None}
    if others or series is None or mesh.dimension + len(series.lengths) > 3:
        wanted = "2D or 3D data, or the same Fourier directions in all fields and elements of a plane or a line"
        raise ElvisError(f"pictures of this field need {wanted}, found DIM={mesh.dimension} SPACE={mesh.space}")
    return mesh.dimension + len(series.lengths)


def _in_space(part: Part) -> Part:
    """The part with elements of a surface in space (see in_space in native_data.slang)."""
    says = " export static const bool in_space = true;"
    quantities = {name: replace(own, source=own.source + says) for name, own in part.quantities.items()}
    return replace(part, source=part.source + says, quantities=quantities)


def by_affinity(found: Sequence[Patch]) -> tuple[list[Patch], list[Patch]]:
    """Elements with affine maps, in which derivatives are polynomials (see `polynomials`), and the others."""
    straight, bent = [], []
    for patch in found:
        affine = is_affine(patch, np.arange(len(patch)))
        if affine.any():
            straight.append(patch.part(np.flatnonzero(affine)))
        if not affine.all():
            bent.append(patch.part(np.flatnonzero(~affine)))
    return straight, bent


def _groups(found: Sequence[Patch], primary: int | None, elements: int) -> Iterator[tuple[BernsteinSpace, list[Patch]]]:
    """Patches with one kind of map: by order of the field ``primary``, unless so few that one order does for all.

    elements  how many there are in all: it is for these to be few, so that a part of the data is drawn as the whole
    A part costs kernels of its own, which take longer to prepare than a few elements of higher degree to draw.
    """

    def order(patch: Patch) -> str:
        return repr((map_space(patch), field_space(patch, primary)))

    for geometry, own in groupby(sorted(found, key=order), key=map_space):
        alike = list(own)
        spaces = [field_space(patch, primary) for patch in alike]
        count = max(space.count for space in spaces)
        if elements * count * 8 <= FEW_BYTES:
            yield geometry, alike
        else:
            for _, some in groupby(alike, key=lambda patch: field_space(patch, primary)):
                yield geometry, list(some)
