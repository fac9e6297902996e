"""The faces of a volume's elements, and which of them are meant."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, concatenated, starts_of
from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps
from elvis.plugins.faces.nets import FaceSpace


@dataclass(frozen=True, eq=False)
class FaceBlock:
    """Faces of one shape, of elements of one part of a volume; an inner face is there twice, once for each side.

    part     number of the part
    solid    what the elements are called, e.g. ``prism``
    space    shape and degree of the faces' maps, over coordinates (s, t) in the reference triangle or square
    element  (n,)       number of the element within its part
    local    (n,)       which of the element's faces it is, a row of ``frames``
    entity   (n,)       number of the face in the mesh, from 0: both sides of an inner face have the same
    frames   (k, 3, 3)  rows f0, f1, f2: the point (s, t) of the face is f0 + s f1 + t f2 in reference coordinates
    nets     rows (m,) of this block to homogeneous control points (m, space.count, 4): w x, w y, w z, w with w > 0
    """

    part: int
    solid: str
    space: FaceSpace
    element: Ints
    local: Ints
    entity: Ints
    frames: Floats
    nets: Callable[[Ints], Floats]

    def __len__(self) -> int:
        return len(self.element)


@dataclass(frozen=True, eq=False)
class Faces:
    """All faces of a volume's elements.

    ids         for each part the ids of its elements in the file
    boundaries  name or id of a boundary -> numbers of faces (entities)
    regions     name or id of a set of elements -> their ids
    inner       numbers of faces that are inner ones though their other side may not be here: of a part of the data
    """

    blocks: Sequence[FaceBlock]
    ids: Sequence[Ints]
    boundaries: Mapping[str, Ints] = field(default_factory=dict)
    regions: Mapping[str, Ints] = field(default_factory=dict)
    inner: Ints = field(default_factory=lambda: np.empty(0, np.int64))

    def select(self, words: Sequence[str]) -> tuple[Ints, ...]:
        """For each block the rows of the faces that any of the words names, ascending.

        Words are ``all`` (outer faces), ``inner`` (faces between elements, both sides), the name or id of a boundary,
        or ``element:ID``, ``shape:NAME`` or ``region:NAME`` for every face of these elements.  ElvisError for a word
        without a match.
        """
        chosen = [np.zeros(len(block), bool) for block in self.blocks]
        for word in words:
            found = self._faces_of_word(word)
            if not any(mask.any() for mask in found):
                there = ", ".join(sorted({block.solid for block in self.blocks}))
                raise ElvisError(f"no face of the data belongs to {word!r}: the shapes are {there}")
            chosen = [mask | more for mask, more in zip(chosen, found, strict=True)]
        return tuple(np.flatnonzero(mask) for mask in chosen)

    @cached_property
    def neighbours(self) -> tuple[Ints, ...]:
        """For each block the index in the volume of the element beyond each face, -1 where it is outer."""
        first = starts_of(self.ids)
        entity = np.concatenate([block.entity for block in self.blocks])
        owner = np.concatenate([block.element + first[block.part] for block in self.blocks])
        order = np.argsort(entity, kind="stable")
        pairs = np.flatnonzero(np.diff(entity[order]) == 0)
        result = np.full(len(entity), -1)
        result[order[pairs]], result[order[pairs + 1]] = owner[order[pairs + 1]], owner[order[pairs]]
        return tuple(np.split(result, np.cumsum([len(block) for block in self.blocks])[:-1]))

    def _faces_of_word(self, word: str) -> list[Bools]:
        """For each block the flags (n,) of the faces with a name."""
        kind, colon, name = word.partition(":")
        if word in ("all", "inner"):
            return [self._is_inner[block.entity] == (word == "inner") for block in self.blocks]
        if word in self.boundaries:
            return [np.isin(block.entity, self.boundaries[word]) for block in self.blocks]
        if colon and kind == "shape":
            return [np.full(len(block), block.solid == name.lower()) for block in self.blocks]
        if colon and kind in ("element", "region"):
            ids = self._elements(kind, name)
            return [np.isin(self.ids[block.part], ids)[block.element] for block in self.blocks]
        names = ["all", "inner", *self.boundaries]
        known = ", ".join([*names, "element:ID", "shape:NAME", "region:NAME"])
        near = [word.lower()] if word.lower() in names[:2] else self.boundaries
        raise ElvisError(f"expected faces to be one of {known}, found {word!r}{perhaps(word, near)}")

    def _elements(self, kind: str, name: str) -> Ints:
        """Ids of the elements that ``element:`` or ``region:`` names."""
        if kind == "element":
            if not name.isdigit():
                raise ElvisError(f"expected the number of an element, found {name!r}")
            return np.array([int(name)])
        if name not in self.regions:
            found = f"{name!r}{perhaps(name, self.regions)}"
            raise ElvisError(f"expected one of the regions {', '.join(self.regions) or '(none)'}, found {found}")
        return self.regions[name]

    @cached_property
    def _is_inner(self) -> Bools:
        """(entities,) whether each face of the mesh has elements on both sides, also if one of them is not here."""
        found = np.bincount(concatenated([block.entity for block in self.blocks])) > 1
        found[self.inner[self.inner < len(found)]] = True
        return found
