"""Patches: elements with one expansion of the geometry and one of each field, the unit of all evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats, frozen_ints
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.data.dataset import Block, Dataset, Expansion, Homogeneous
from elvis.core.mapping.geometry import Corners, GeometryBlock, geometry
from elvis.core.polynomials.expansion import mode_count
from elvis.core.polynomials.grouping import Group, grouped
from elvis.core.shapes import Shape


@dataclass(frozen=True, eq=False)
class Patch:
    """Elements of one shape that share every expansion.

    element_ids            (n,)       ids in the file
    geometry               expansion of the mapping
    geometry_coefficients  (n, 3, m)  of the world coordinates
    fields                 expansion of each field, None for a field that doesn't hold these elements
    coefficients           (n, m) for each field, or None; a view of the dataset's array if whole blocks coincide
    corners                the vertices of the mesh that are the maps' coefficients, if they are vertices
    """

    shape: Shape
    element_ids: Ints
    geometry: Expansion
    geometry_coefficients: Floats
    fields: tuple[Expansion | None, ...]
    coefficients: tuple[Floats | None, ...]
    corners: Corners | None = None

    def __len__(self) -> int:
        return len(self.element_ids)

    def part(self, rows: Ints) -> Patch:
        """Some of the elements."""
        coefficients = tuple(own if own is None else frozen_floats(own[rows]) for own in self.coefficients)
        return replace(
            self,
            element_ids=frozen_ints(self.element_ids[rows]),
            geometry_coefficients=frozen_floats(self.geometry_coefficients[rows]),
            coefficients=coefficients,
            corners=self.corners and self.corners.take(rows),
        )

    @cached_property
    def homogeneous(self) -> Homogeneous | None:
        """Fourier directions of the fields in addition to the directions of the shape."""
        return next((own.homogeneous for own in self.fields if own is not None and own.homogeneous), None)

    @property
    def periods(self) -> tuple[tuple[int, float], ...]:
        """World axis and length of each homogeneous direction, in the order of their coordinates zeta."""
        lengths = self.homogeneous.lengths if self.homogeneous else ()
        return tuple(zip(range(3 - len(lengths), 3), lengths, strict=True))

    @property
    def dimension(self) -> int:
        """Number of reference coordinates, homogeneous ones included."""
        return self.shape.dimension + len(self.periods)

    @cached_property
    def is_flat(self) -> bool:
        """Whether every coordinate beyond the dimension of the shape is zero throughout."""
        return not self.geometry_coefficients[:, self.shape.dimension :].any()

    @cached_property
    def is_linear(self) -> bool:
        """Whether the maps are linear by their expansion: of straight simplices."""
        return max(self.geometry.modes) == 2 and self.shape in (Shape.SEGMENT, Shape.TRIANGLE, Shape.TETRAHEDRON)


def check_not_homogeneous(what: str, some: Sequence[Patch]) -> None:
    """Raise ElvisError for patches with Fourier directions."""
    if any(patch.homogeneous for patch in some):
        raise ElvisError(f"{what}: expected no Fourier direction; elvis convert --extrude makes volume elements of it")


def patches(
    dataset: Dataset, field_names: Sequence[str] = (), blocks: Sequence[GeometryBlock] | None = None
) -> tuple[Patch, ...]:
    """The elements of the domain with their mapping and the named fields, in as few patches as there are expansions.

    blocks  the dataset's `geometry`, where it is at hand already
    Raises ElvisError for a field that the dataset hasn't; raises FormatError if a field gives an element another shape
    or another number of coefficients than its expansion has.
    """
    mapping = geometry(dataset) if blocks is None else tuple(blocks)
    sources: list[Sequence[Block]] = [_field(dataset, name) for name in field_names]
    if not mapping:
        return ()
    ids = np.concatenate([block.element_ids for block in mapping])
    names = ("the mesh", *field_names)
    return tuple(_patch(group, names, _corners(group, mapping)) for group in grouped(ids, [mapping, *sources]))


def _field(dataset: Dataset, name: str) -> tuple[Block, ...]:
    try:
        return dataset.field(name).blocks
    except KeyError:
        names = ", ".join(field.name for field in dataset.solution) or "none"
        raise ElvisError(f"expected a field of the dataset ({names}), found {name}") from None


def _corners(group: Group, mapping: Sequence[GeometryBlock]) -> Corners | None:
    """The vertices of a group's elements; None if they aren't known, or are in several blocks."""
    own = [block for block in mapping if block.expansion == group.expansions[0]]
    if len(own) > 1 or own[0].corners is None:
        return None
    if len(group.element_ids) == len(own[0]):
        return own[0].corners
    return own[0].corners.take(np.flatnonzero(np.isin(own[0].element_ids, group.element_ids)))


def _patch(group: Group, names: tuple[str, ...], corners: Corners | None) -> Patch:
    mapping, *fields = zip(group.expansions, group.coefficients, strict=True)
    expansion, coefficients = mapping
    assert expansion is not None
    assert coefficients is not None
    for name, (own, values) in zip(names[1:], fields, strict=True):
        if own is not None and values is not None:
            _check(group.element_ids, expansion.shape, own, values, name)
    frozen = tuple(values if values is None else frozen_floats(values) for _, values in fields)
    return Patch(
        expansion.shape,
        frozen_ints(group.element_ids),
        expansion,
        frozen_floats(coefficients),
        tuple(own for own, _ in fields),
        frozen,
        corners,
    )


def _check(element_ids: Ints, shape: Shape, expansion: Expansion, coefficients: Floats, name: str) -> None:
    place = f"field {name}, element {element_ids[0]}"
    if expansion.shape is not shape:
        found = expansion.shape.label.lower()
        raise FormatError(f"expected a {shape.label.lower()} as in the mesh, found a {found}", place=place)
    if coefficients.shape[1] != mode_count(expansion):
        expected = f"{mode_count(expansion)} coefficients for its bases and orders"
        raise FormatError(f"expected {expected}, found {coefficients.shape[1]}", place=place)
