"""One order for all fields of an element, as files of the native format hold them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats, frozen_ints
from elvis.core.data.dataset import Block, Dataset, Expansion
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.expansion import mode_count
from elvis.core.polynomials.grouping import Group, grouped
from elvis.plugins.projection.fitting import padded

#: families in which low-order functions are among the high-order ones, so that zeros raise the order
_HIERARCHICAL = frozenset(
    {
        Basis.MODIFIED_A,
        Basis.MODIFIED_B,
        Basis.MODIFIED_C,
        Basis.MODIFIED_PYR_C,
        Basis.ORTHO_A,
        Basis.ORTHO_B,
        Basis.ORTHO_C,
        Basis.ORTHO_PYR_C,
        Basis.LEGENDRE,
        Basis.CHEBYSHEV,
    }
)


def on_common_blocks(dataset: Dataset) -> Dataset:
    """The dataset with one order for all fields of an element, their highest: new modes are zero.

    A file then has one section for each shape with all fields, as solvers expect.
    """
    if not dataset.fields:
        return dataset
    held = [block.element_ids for own in dataset.fields for block in own.blocks]
    ids = np.unique(np.concatenate(held))
    blocks: list[list[Block]] = [[] for _ in dataset.fields]
    for group in grouped(ids, [own.blocks for own in dataset.fields]):
        for own, block in zip(blocks, _widened(group), strict=True):
            if block is not None:
                own.append(block)
    fields = tuple(replace(own, blocks=tuple(new)) for own, new in zip(dataset.fields, blocks, strict=True))
    return replace(dataset, fields=fields)


def _widened(group: Group) -> list[Block | None]:
    """The block of each field, with the most modes in each direction that one of the same family has."""
    families: dict[object, list[tuple[int, ...]]] = {}
    for expansion in group.expansions:
        if expansion is not None:
            families.setdefault(_family(expansion), []).append(expansion.modes)
    found: list[Block | None] = []
    for expansion, coefficients in zip(group.expansions, group.coefficients, strict=True):
        if expansion is None or coefficients is None:
            found.append(None)
            continue
        many = expansion
        if _HIERARCHICAL.issuperset(expansion.bases):
            most = np.max(families[_family(expansion)], axis=0)
            many = replace(expansion, modes=tuple(most.tolist()))
        found.append(
            Block(many, frozen_ints(group.element_ids), frozen_floats(_by_plane(coefficients, expansion, many)))
        )
    return found


def _by_plane(coefficients: Floats, few: Expansion, many: Expansion) -> Floats:
    """Coefficients in an expansion with more modes, of each Fourier plane."""
    if few == many:
        return coefficients
    flat, wide = replace(few, homogeneous=None), replace(many, homogeneous=None)
    planes = coefficients.reshape(len(coefficients), -1, mode_count(flat))
    return padded(planes, flat, wide).reshape(len(coefficients), -1)


def _family(expansion: Expansion) -> object:
    return expansion.shape, expansion.bases, expansion.homogeneous
