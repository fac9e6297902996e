"""Surfaces as the buffers of ``shaders/distances.slang``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Ints, starts_of
from elvis.core.distances import Surface
from elvis.core.distances.search import EQUAL
from elvis.core.distances.surface_patches import SurfacePatches

Buffers = dict[str, NDArray[Any]]

#: numbers of a patch before its coefficients
_BOUNDS = 10
#: bits of a patch whose normal points into its element, or out of it
_INTO, _OUT_OF = 4, 8


def buffers_of(surfaces: Sequence[Surface]) -> Buffers:
    """The buffers by name: surfaces one after the other, patches of each in the order of its tree."""
    trees, patches, numbers, first_node, first_patch, first_number = [], [], [], 0, 0, 0
    for surface in surfaces:
        own, values = _patches(surface)
        own[:, 0] += first_number
        trees.append((first_node, surface.tree.leaves, first_patch, len(own)))
        patches.append(own)
        numbers.append(values)
        first_node += len(surface.tree.nodes)
        first_patch += len(own)
        first_number += len(values)
    return {
        "surface_nodes": np.concatenate([surface.tree.nodes for surface in surfaces]),
        "surface_trees": np.array(trees, np.uint32),
        "surface_facts": np.array([(EQUAL * each.scale, float(not each.is_planar)) for each in surfaces]),
        "surface_pieces": np.concatenate(patches).astype(np.uint32),
        "surface_numbers": np.concatenate(numbers),
    }


def _patches(surface: Surface) -> tuple[Ints, NDArray[np.float64]]:
    """(n, 4) the records of a surface's patches, and their numbers."""
    facts = ((group, surface.sides[group.face], surface.inward[group.face]) for group in surface.groups)
    records, numbers = zip(*(_group(*each) for each in facts), strict=True)
    starts = starts_of(numbers)
    for record, start in zip(records, starts, strict=False):
        record[:, 0] += start
    return np.concatenate(records)[surface.tree.order], np.concatenate(numbers)


def _group(patches: SurfacePatches, sides: Ints, inward: Ints) -> tuple[Ints, NDArray[np.float64]]:
    """The records and numbers of patches of one kind."""
    count, (m, k) = len(patches), patches.coefficients.shape[1:3]
    numbers = np.concatenate([patches.bounds, patches.coefficients.reshape(count, -1)], axis=1)
    first = np.arange(count) * numbers.shape[1]
    signs = np.where(sides[:, 0] != sides[:, 1], (sides[:, 0] < 0).astype(np.int64), np.where(sides[:, 0] > 0, 2, 3))
    signs |= np.where(inward > 0, _INTO, np.where(inward < 0, _OUT_OF, 0))
    kind = np.full(count, patches.corners | k << 8 | m << 16)
    return np.stack([first, kind, patches.outer, signs], axis=1), numbers.reshape(-1)
