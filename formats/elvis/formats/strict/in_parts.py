"""Check the rules for a mesh and its fields on several ranks, each with one part.

Valid parts that fit together form a valid whole.  A rule about one element, side or curve is checked in the part that
holds it.  Rules about several are checked jointly: no two entities have the same members, a side has at most two
elements, and the parts together hold everything.  Entities are sent to ranks as rows and a hash of their members, so
entities with the same members meet on one rank.  Different entities may share a hash (probability 2^-64) and would be
confused; in case of a match one process compares all of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Ints, joined_columns
from elvis.core.base.errors import FormatError
from elvis.core.base.ranks import Ranks
from elvis.core.data.dataset import Dataset
from elvis.core.distances.boundaries import owners_of_sides
from elvis.core.mapping.orientation import chunks
from elvis.core.portions.portion import Portion, members_in_whole
from elvis.core.shapes import Shape
from elvis.formats.nektar.assembly import AT_ONCE, Lookup
from elvis.formats.nektar.sections import Section
from elvis.formats.reading import read_part
from elvis.formats.strict.field_rules import Needed, needed_modes
from elvis.formats.strict.mesh_rules import mesh_findings

#: steps of a 64-bit hash, from SplitMix64 (Steele, Lea and Flood 2014, Fast splittable pseudorandom numbers)
_GAP, _STEPS = 0x9E3779B97F4A7C15, ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB))

#: elements at a side that are too many
_CROWD = 3
#: tables of entities: rows in the whole (n,), hashes of their members (n,), and the number of elements of the part at
#: each (n,), up to a count that suffices
_Table: TypeAlias = tuple[Ints, NDArray[np.uint64], NDArray[np.uint8]]
_Entities: TypeAlias = dict[Shape, _Table]


@dataclass(frozen=True, eq=False)
class SoundPart:
    """The part of a sound mesh and its fields that a rank has.

    needed  the most modes of fields on composites, in the whole
    """

    dataset: Dataset
    needed: Needed


def sound_part(paths: Sequence[str | Path], sections: Sequence[Section], ranks: Ranks) -> SoundPart | None:
    """The part that one of several ranks has; None at all of them where something may be wrong in one.

    sections  of all fields
    """
    task = f"rules of {', '.join(Path(path).name for path in paths)}"
    try:
        found = _Checked.of(read_part(ranks.rank, ranks.size, *paths), sections)
    except FormatError:
        found = None
    every = [own for own in ranks.exchange(None if found is None else found.facts, task) if own is not None]
    if found is None or len(every) < ranks.size:
        return None
    entries = {name: sum(own.entries[name] for own in every) for name in every[0].entries}
    if entries != _entries(sections) or not _fits(found.part, ranks, task):
        return None
    needed = {key: max(own.needed[key] for own in every) for key in every[0].needed}
    return SoundPart(found.part.dataset, needed)


@dataclass(frozen=True)
class _Facts:
    """Facts about a valid part: by field, the number of section entries on its elements, and the modes these need."""

    entries: Mapping[str, int]
    needed: Needed


@dataclass(frozen=True, eq=False)
class _Checked:
    """A part in which nothing is wrong."""

    part: Portion
    facts: _Facts

    @staticmethod
    def of(part: Portion, sections: Sequence[Section]) -> _Checked | None:
        """None if something is wrong."""
        if any(True for _ in mesh_findings(part.dataset)):
            return None
        entries = {}
        for name in _entries(sections):
            count = _covered(part.dataset, [own for own in sections if name in own.space.names])
            if count is None:
                return None
            entries[name] = count
        return _Checked(part, _Facts(entries, needed_modes(part.dataset, sections)))


def _entries(sections: Sequence[Section]) -> dict[str, int]:
    """Number of elements that the sections of each field list."""
    found: dict[str, int] = {}
    for section in sections:
        for name in section.space.names:
            found[name] = found.get(name, 0) + len(section.element_ids)
    return found


def _covered(dataset: Dataset, sections: Sequence[Section]) -> int | None:
    """Number of entries of a field's sections that belong to elements of a part.

    None if an element is missing or occurs twice.
    """
    found = [np.empty(0, np.int64)]
    for section in sections:
        lookup = Lookup(dataset.mesh.of(section.space.shape).ids, "element")
        for some in chunks(len(section.element_ids), AT_ONCE):
            ids = section.element_ids[some]
            found.append(ids[lookup.present(ids)])
    every = np.concatenate(found)
    ids, counts = np.unique(every, return_counts=True)
    is_twice = (counts > 1).any() and not any(section.space.homogeneous for section in sections)
    return None if is_twice or len(np.setdiff1d(dataset.mesh.domain_ids(), ids)) else len(every)


def _fits(part: Portion, ranks: Ranks, task: str) -> bool:
    """Whether parts have all entities of the whole, each with members of its own, and two elements at most at sides."""
    every = [own for own in ranks.alltoall(_by_bucket(part, ranks.size), task) if own is not None]
    counts = {shape: _distinct([own[shape] for own in every]) for shape in part.dataset.mesh.entities}
    found = ranks.exchange(counts, task)
    known = {shape: count for shape, count in part.counts.entities.items() if count}
    sums = {shape: [own[shape] for own in found] for shape in counts}
    if any(None in own for own in sums.values()):
        return False
    return {shape: total for shape, own in sums.items() if (total := sum(filter(None, own)))} == known


def _by_bucket(part: Portion, count: int) -> list[_Entities]:
    """The entities of a part for each of ``count`` ranks, by their hashes."""
    found: list[_Entities] = [{} for _ in range(count)]
    for shape, owners in _owners(part):
        few = np.minimum(owners, _CROWD).astype(np.uint8)
        hashes = _hashes(np.sort(members_in_whole(part, shape), axis=1))
        bucket = hashes % np.uint64(count)
        for number, tables in enumerate(found):
            here = bucket == number
            tables[shape] = part.rows[shape][here], hashes[here], few[here]
    return found


def _owners(part: Portion) -> Iterator[tuple[Shape, Ints]]:
    """For each shape, the number of elements of a part that have each entity (n,) as a side.

    Zero for shapes that are not sides.
    """
    mesh = part.dataset.mesh
    every = owners_of_sides(mesh, [own.members for own in mesh.elements.values()])
    start = 0
    for shape, entities in mesh.entities.items():
        is_side = shape.dimension == mesh.dimension - 1
        yield shape, every[start : start + len(entities)] if is_side else np.zeros(len(entities), np.int64)
        start += len(entities) if is_side else 0


def _hashes(members: Ints) -> NDArray[np.uint64]:
    """(n,) of rows of whole numbers (n, k)."""
    found = np.zeros(len(members), np.uint64)
    for column in members.T:
        found = (found ^ column.astype(np.uint64)) + np.uint64(_GAP)
        for shift, factor in _STEPS:
            found = (found ^ found >> np.uint64(shift)) * np.uint64(factor)
        found ^= found >> np.uint64(31)
    return found


def _distinct(tables: Sequence[_Table]) -> int | None:
    """Number of distinct entities of several parts in a bucket.

    None if two have the same members, or one has three elements.
    """
    rows, hashes, owners = joined_columns(tables)
    _, first, place = np.unique(rows, return_index=True, return_inverse=True)
    is_crowded = (np.bincount(place.reshape(-1), owners, len(first)) > 2).any()
    return None if is_crowded or len(np.unique(hashes[first])) < len(first) else len(first)
