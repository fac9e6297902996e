"""Domains of integration by name: the domain, a region of it, a boundary, all outer faces, surfaces, curves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Bools, Ints, joined_ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps
from elvis.core.base.ranks import ALONE, Ranks
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import Mesh
from elvis.core.distances.boundaries import ALL, boundaries, inner_sides, outer_sides
from elvis.core.integrals.along_curves import CurvePiece
from elvis.core.integrals.coincident import Sides
from elvis.core.integrals.levels.of_elements import Level, LevelPiece
from elvis.core.integrals.reference_cells import Piece, side_shape, whole_elements
from elvis.core.mapping.patch import Patch
from elvis.core.portions.portion import knows_inner_sides
from elvis.core.shapes import Shape

#: name for all elements
DOMAIN = "domain"
#: before the name of a region, before the id of an element whose faces are meant, and, if wanted, before a boundary
REGION, ELEMENT, BOUNDARY = "region:", "element:", "boundary:"
#: kinds of pieces
Part = Piece | LevelPiece | CurvePiece
#: name of rows without a name of their own: faces in no boundary
UNNAMED = "(others)"


@dataclass(frozen=True, eq=False)
class Target:
    """One row of a table of integrals: its name, and the pieces of elements that it is."""

    name: str
    pieces: tuple[Part, ...]


@dataclass(frozen=True, eq=False)
class Targets:
    """The targets that match one name, with their union if there are several.

    rows   disjoint pieces if ``total`` is None
    total  the union, if there are several
    """

    rows: tuple[Target, ...]
    total: Target | None = None


@dataclass(frozen=True, eq=False)
class Places:
    """The elements of a dataset and their sides, on which integrals are requested.

    ranks  the ranks that have parts of it, including this one
    """

    dataset: Dataset
    patches: tuple[Patch, ...]
    levels: Mapping[str, Level]
    curves: Mapping[str, tuple[CurvePiece, ...]] = field(default_factory=dict)
    ranks: Ranks = ALONE

    def somewhere(self, flags: Sequence[bool]) -> list[bool]:
        """Whether each of some flags holds in this part or another one."""
        return [any(own) for own in zip(*self.ranks.exchange(list(flags), "targets"), strict=True)]

    def shared(self, pieces: Sequence[Part], ranks: Ranks) -> list[Part]:
        """A rank's share of pieces: all of a part, otherwise every n-th element; the first rank takes the curves."""
        if self.dataset.mesh.excerpt is not None or ranks.size == 1:
            return list(pieces)
        found: list[Part] = []
        for piece in pieces:
            if isinstance(piece, CurvePiece):
                found += [] if ranks.rank else [piece]
                continue
            own = piece.part(np.arange(ranks.rank, len(piece), ranks.size))
            found += [own] if len(own) else []
        return found

    @property
    def sides(self) -> Sides | None:
        """The sides of all elements, of data of two or three dimensions."""
        if self._mesh.dimension < 2:
            return None
        is_joined = np.zeros(len(self._owners), bool)
        inner = inner_sides(self._mesh)
        is_joined[inner[inner < len(is_joined)]] = True
        return Sides(self._members, is_joined)

    @property
    def _mesh(self) -> Mesh:
        return self.dataset.mesh

    @cached_property
    def regions(self) -> dict[str, Ints]:
        """Ids of elements by the names and ids of composites that hold some."""
        tags = {shape.tag for shape in Shape.of_dimension(self._mesh.dimension)}
        tags |= {1: {"E"}, 2: {"F"}, 3: set()}[self._mesh.dimension]
        named = self._mesh.named_parts()
        held = {name: [ids for tag, ids in parts if tag in tags] for name, parts in named.items()}
        return {name: np.concatenate(ids) for name, ids in held.items() if ids}

    @cached_property
    def boundaries(self) -> dict[str, Ints]:
        """Rows of sides by the names and ids of composites that hold some."""
        return boundaries(self._mesh)

    def clipped(self, name: str, clip: Level) -> Targets:
        """The rest of the domain or a region after clipping with a level; raises ElvisError for other targets."""
        targets = self.named(name)
        pieces = [piece for row in targets.rows for piece in row.pieces]
        elements = [piece for piece in pieces if isinstance(piece, Piece) and not piece.is_side]
        if len(elements) < len(pieces):
            raise ElvisError(f"--clip: expected the domain or a region to be clipped, found {name}")
        return Targets((Target(name, tuple(LevelPiece(piece, clip, is_filled=True) for piece in elements)),))

    def named(self, name: str) -> Targets:
        """The targets of a name; raises ElvisError, with similar names, for an unknown one."""
        if name in self.levels:
            level, elements = self.levels[name], whole_elements(self.patches)
            return Targets((Target(name, tuple(LevelPiece(piece, level) for piece in elements)),))
        if name in self.curves:
            return Targets((Target(name, self.curves[name]),))
        name = name if name in self.boundaries else without_prefix(name)
        if name == DOMAIN:
            return Targets((Target(DOMAIN, tuple(whole_elements(self.patches))),))
        if name == ALL:
            return self._outer()
        if name.startswith(REGION):
            return self._region(name)
        if name.startswith(ELEMENT) and name not in self.boundaries:
            return self._faces_of(name)
        if name not in self.boundaries:
            known = [DOMAIN, *((ALL,) if self._mesh.dimension > 1 else ()), *self.boundaries]
            known += [REGION + own for own in self.regions]
            raise ElvisError(f"there is no boundary {name!r}{perhaps(name, known)}; there are {', '.join(known)}")
        sides = np.isin(np.arange(len(self._owners)), self.boundaries[name])
        pieces = tuple(self._sides(sides & (self._owners > 0)))
        if not any(self.somewhere([bool(pieces)])):
            raise ElvisError(f"expected a boundary with faces of the data's elements, found none in {name!r}")
        return Targets((Target(name, pieces),))

    def together(self, several: Sequence[Targets]) -> Targets:
        """Several targets as one, with their total, which counts shared sides once, where all are sides or elements."""
        rows = tuple(row for own in several for row in own.rows)
        if len(several) == 1:
            return several[0]
        pieces = [piece for row in rows for piece in row.pieces]
        known = [piece for piece in pieces if isinstance(piece, Piece)]
        sides = [piece for piece in known if piece.is_side]
        kinds = self.somewhere([len(known) < len(pieces), len(sides) > 0, len(sides) < len(known)])
        if kinds[0] or all(kinds[1:]):
            return Targets(rows)
        return Targets(rows, Target("total", tuple(_united(known))))

    def _region(self, name: str) -> Targets:
        own = name.removeprefix(REGION)
        if own not in self.regions:
            known = self.regions
            raise ElvisError(f"there is no region {own!r}{perhaps(own, known)}; there are {', '.join(known) or 'none'}")
        pieces = [
            piece.part(np.isin(piece.patch.element_ids, self.regions[own])) for piece in whole_elements(self.patches)
        ]
        return Targets((Target(name, tuple(piece for piece in pieces if len(piece))),))

    def _faces_of(self, name: str) -> Targets:
        """All faces of one element, edges of 2D ones, a row each; their normals lead out of it."""
        own = name.removeprefix(ELEMENT)
        if self._mesh.dimension < 2 or not own.isascii() or not own.isdigit():
            raise ElvisError(f"expected element: and the id of an element of 2D or 3D data, found {name!r}")
        rows = []
        for patch, members in zip(self.patches, self._members, strict=True):
            here = np.flatnonzero(patch.element_ids == int(own))
            for number in range(members.shape[1]) if len(here) else ():
                piece = Piece(patch, here, side_shape(patch.shape, number), number)
                rows.append(Target(f"{name}/{number}", (piece,)))
        if not rows:
            raise ElvisError(f"there is no element {own} in the data")
        return Targets(tuple(rows), Target("total", tuple(piece for row in rows for piece in row.pieces)))

    def _outer(self) -> Targets:
        """All outer faces, a row for each boundary that has some."""
        if self._mesh.dimension < 2:
            raise ElvisError("expected 2D or 3D data, found lines, which have no boundary faces")
        outer = outer_sides(self._mesh, self._owners)
        total = Target("total", tuple(self._sides(outer)))
        named, left = dict[str, Bools](), outer.copy()
        for name, sides in self._distinct.items():
            named[name] = outer & np.isin(np.arange(len(outer)), sides)
            left[sides] = False
        named[UNNAMED] = left
        held = self.somewhere([bool(here.any()) for here in named.values()])
        rows = [
            Target(name, tuple(self._sides(named[name]))) for name, is_held in zip(named, held, strict=True) if is_held
        ]
        rows = rows if any(held[:-1]) else []
        return Targets(tuple(rows), total) if len(rows) > 1 else Targets((replace(total, name=ALL),))

    @property
    def _distinct(self) -> Mapping[str, Ints]:
        """Boundaries, each once: by its name or label, else by its id."""
        named = {str(c.id): c.name or c.label for c in self._mesh.composites}
        return {name: sides for name, sides in self.boundaries.items() if not named.get(name) or named[name] == name}

    @cached_property
    def _members(self) -> tuple[Ints, ...]:
        """(n, sides) rows of the sides of each patch's elements: faces, triangles first, or edges."""
        mesh = self._mesh
        entities = [mesh.of(patch.shape) for patch in self.patches]
        return tuple(own.members[own.rows_of(p.element_ids)] for own, p in zip(entities, self.patches, strict=True))

    @cached_property
    def _owners(self) -> Ints:
        """(faces,) how many elements each side has."""
        every = [own.reshape(-1) for own in self._members]
        known = [np.max(sides, initial=-1) + 1 for sides in (*every, *self.boundaries.values())]
        return np.bincount(joined_ints(every), minlength=max(known, default=0))

    def _sides(self, wanted: Bools) -> Iterator[Piece]:
        """Sides (faces,) as pieces of elements, each of one element."""
        wanted = wanted.copy()
        for patch, members in zip(self.patches, self._members, strict=True):
            for number in range(members.shape[1]):
                side, first = np.unique(members[:, number], return_index=True)
                rows = first[wanted[side]]
                wanted[members[rows, number]] = False
                if len(rows):
                    yield Piece(patch, rows, side_shape(patch.shape, number), number)


def without_prefix(name: str) -> str:
    """The name of a boundary without the word before it."""
    return name.removeprefix(BOUNDARY)


def _united(pieces: Sequence[Piece]) -> Iterator[Piece]:
    """The elements or sides of pieces, each once."""
    groups: dict[tuple[int, int | None], list[Piece]] = {}
    for piece in pieces:
        groups.setdefault((id(piece.patch), piece.number), []).append(piece)
    for group in groups.values():
        yield replace(group[0], rows=np.unique(np.concatenate([piece.rows for piece in group])))


def overlap(rows: Sequence[Target], total: Target) -> bool:
    """Whether rows share pieces, so that they don't add up to the total."""
    return sum(len(piece) for row in rows for piece in row.pieces) != sum(len(piece) for piece in total.pieces)


def has_outer_boundaries(dataset: Dataset, names: Sequence[str]) -> bool:
    """Whether a part of a dataset knows its inner sides, and boundaries with these names have none of them."""
    mesh = dataset.mesh
    if mesh.excerpt is None or not names:
        return True
    if not knows_inner_sides(dataset):
        return False
    known = boundaries(mesh)
    names = [without_prefix(name) for name in names]
    return not any(np.isin(known[name], mesh.excerpt.sides).any() for name in names if name in known)
