"""Surroundings of parts of a dataset: boundaries for distances, neighbours of elements.

For a boundary, each rank contributes the elements of its part that touch it; for neighbours, its elements at sides
shared with other parts.  Only these are sent, as portions, and put together in the order of the whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, among, frozen_floats, rows_of
from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import Ranks
from elvis.core.data.dataset import Block, Expansion, Field
from elvis.core.data.mesh import NON_CONFORMING
from elvis.core.distances.boundaries import (
    ALL,
    Faces,
    boundaries,
    faces_of,
    joined_sides,
    owners_of_sides,
    sides_of,
)
from elvis.core.distances.surface import is_file, surface_of_faces
from elvis.core.mapping.geometry import geometry
from elvis.core.portions.portion import Portion, unite
from elvis.core.quantities.jumps import jumps
from elvis.core.quantities.tree import jump_name
from elvis.core.shapes import Shape

_NONE = np.empty(0, np.int64)


def with_surface(portion: Portion, target: str, ranks: Ranks) -> Portion:
    """The part of a rank, with the surface of a boundary of the whole; every rank must call this.

    An unknown name is reported where distances are measured.
    """
    dataset = portion.dataset
    if target in dataset.surfaces or is_file(dataset, target) or dataset.mesh.dimension < 2:
        return portion
    map_alone = portion.with_fields(())
    every = np.sort(dataset.mesh.domain_ids())
    outer = _outer(portion, every, ranks) if target == ALL else _NONE
    numbers = portion.side_numbers
    rows = np.flatnonzero(np.isin(numbers, outer)) if target == ALL else boundaries(dataset.mesh).get(target, _NONE)
    is_wanted = np.zeros(len(numbers), bool)
    is_wanted[rows] = True
    touching = _with_sides(portion, every, is_wanted)
    # blocks of maps that fields give come in the order of their first elements
    first = [block.element_ids[:1] for block in geometry(dataset)] if dataset.map_names else []
    own = map_alone.of(np.unique(np.concatenate([touching, *first]))).alone
    united = unite(ranks.exchange(own, f"elements at {target}"))
    if target == ALL:
        sides = united.side_numbers
        united = united.with_sides(sides[~np.isin(sides, outer)])
    faces: list[Faces] = []
    with suppress(ElvisError):
        faces = faces_of(united.dataset, target)
    if not faces:
        return portion
    surface = surface_of_faces(united.dataset, target, faces, ranks)
    return replace(portion, dataset=replace(dataset, surfaces={**dataset.surfaces, target: surface}))


def with_jumps(portion: Portion, name: str, ranks: Ranks) -> Portion:
    """The part of a rank, with the jumps of one of its fields as another field; every rank must call this.

    Undefined jumps, as across Fourier directions, are reported where they are evaluated.
    """
    dataset, own = portion.dataset, jump_name(name)
    field = dataset.field(name)
    if own in dataset or any(block.expansion.homogeneous for block in field.blocks):
        return portion
    greatest = _jumps(portion.with_fields([name]), field, ranks)
    blocks = tuple(_constant(block, *greatest) for block in field.blocks)
    fields, borrowed = (*dataset.fields, Field(own, blocks)), dataset.borrowed | {own}
    dataset = replace(dataset, fields=fields, borrowed=borrowed)
    return replace(portion, dataset=dataset, blocks={**portion.blocks, own: portion.blocks[name]})


def _outer(portion: Portion, ids: Ints, ranks: Ranks) -> Ints:
    """(n,) ascending numbers in the whole of sides that belong to exactly one element of the domain.

    ids  (n,) ids of this rank's elements
    """
    numbers, owners = portion.side_numbers, _owners(portion, ids)
    candidates = np.concatenate(ranks.exchange(numbers[owners == 1], "outer sides of parts"))
    outer, counts = np.unique(candidates, return_counts=True)
    outer = outer[counts == 1]
    # a part may have two elements at a side where another part has one
    inner = ranks.exchange(outer[np.isin(outer, numbers[owners > 1])], "sides that are not outer sides")
    return np.setdiff1d(outer, np.concatenate(inner))


def _jumps(portion: Portion, field: Field, ranks: Ranks) -> tuple[Ints, Floats]:
    """Ascending ids (n,) of a part's elements that have its one field, and its largest jump (n,) at their sides.

    Jumps are found twice: in the part, and in its elements at sides of other parts together with theirs.
    """
    held = np.concatenate([_NONE, *(block.element_ids for block in field.blocks)])
    held = held[np.isin(held, portion.dataset.mesh.domain_ids())]
    modes = max((max(block.expansion.modes) for block in field.blocks if len(block)), default=0)
    numbers, owners = portion.side_numbers, _owners(portion, held)
    every = ranks.exchange((numbers[owners == 1], modes), f"sides of elements that have {field.name}")
    modes = max(own for _, own in every)
    sent = [
        None if number == ranks.rank else _at(portion, held, np.isin(numbers, sides) & (owners > 0))
        for number, (sides, _) in enumerate(every)
    ]
    found = ranks.alltoall(sent, f"neighbours of elements that have {field.name}")
    neighbours = [own for own in found if own is not None]
    border = [own for own in sent if own is not None]
    parts = [portion, *([unite([*border, *neighbours])] if neighbours else [])]
    parts += _at_interfaces(portion, held, ranks)
    ids, greatest = np.sort(held), np.zeros(len(held))
    for some in parts:
        own, jump = jumps(some.dataset, field.name, modes)
        is_here = among(own, ids)
        np.maximum.at(greatest, rows_of(ids, own[is_here]), jump[is_here])
    return ids, greatest


def _at_interfaces(portion: Portion, held: Ints, ranks: Ranks) -> list[Portion]:
    """The elements of all parts at sides that don't match, together; none if there are none.

    held  (n,) ids of the part's elements that count
    """
    mesh = portion.dataset.mesh
    if not any(composite.name == NON_CONFORMING for composite in mesh.composites):
        return []
    is_joined = np.zeros(len(portion.side_numbers), bool)
    is_joined[joined_sides(mesh).get(NON_CONFORMING, _NONE)] = True
    every = ranks.exchange(_at(portion, held, is_joined), "elements at non-conforming sides")
    found = [own for own in every if own is not None]
    return [unite(found)] if found else []


def _constant(block: Block, ids: Ints, values: Floats) -> Block:
    """A block's elements with a number (n,) of each of elements ids (n,), ascending; NaN for others."""
    found = np.full((len(block), 1), np.nan)
    is_known = among(block.element_ids, ids)
    found[is_known, 0] = values[np.searchsorted(ids, block.element_ids[is_known])]
    shape = block.expansion.shape
    expansion = Expansion(shape, block.expansion.bases, (1,) * shape.dimension)
    return Block(expansion, block.element_ids, frozen_floats(found))


def _of_shapes(portion: Portion, ids: Ints) -> Iterator[tuple[Shape, Ints]]:
    """The elements with ids (n,), grouped by shape."""
    for shape, entities in portion.dataset.mesh.elements.items():
        yield shape, entities.ids[np.isin(entities.ids, ids)]


def _owners(portion: Portion, ids: Ints) -> Ints:
    """(n,) how many of the elements with ids (n,) each side of a part belongs to."""
    mesh = portion.dataset.mesh
    return owners_of_sides(mesh, [sides_of(mesh, shape, own) for shape, own in _of_shapes(portion, ids)])


def _with_sides(portion: Portion, ids: Ints, is_wanted: Bools) -> Ints:
    """The elements with ids (n,) that have one of the requested sides (m,)."""
    mesh = portion.dataset.mesh
    found = [own[is_wanted[sides_of(mesh, shape, own)].any(axis=1)] for shape, own in _of_shapes(portion, ids)]
    return np.concatenate([_NONE, *found])


def _at(portion: Portion, ids: Ints, is_wanted: Bools) -> Portion | None:
    """The portion's elements of these at wanted sides; None if there are none."""
    own = _with_sides(portion, ids, is_wanted)
    return portion.of(own).alone if len(own) else None
