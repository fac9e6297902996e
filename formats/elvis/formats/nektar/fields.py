"""From sections of field files to fields in memory, on the elements that the mesh has."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints, frozen_floats, frozen_ints
from elvis.core.dataset import Block, Expansion, Field
from elvis.core.errors import FormatError
from elvis.core.mesh import Mesh
from elvis.core.shapes import Shape
from elvis.formats.nektar.lookup import Lookup
from elvis.formats.nektar.partition import first_rows
from elvis.formats.nektar.sections import Piece, Section, pieces

#: coefficients that two files give for one element may differ by rounding, relative to the greatest
_SAME = 1e-9


def assemble(sections: Sequence[Section], mesh: Mesh) -> tuple[Field, ...]:
    """One field a name, one block an expansion; elements that the mesh lacks are left out.

    FormatError where an element has another shape in the mesh, where data of one element contradict each other, and
    where no element is in the mesh.
    """
    on_mesh = _OnMesh(mesh)
    groups: dict[tuple[tuple[str, ...], Expansion], list[Piece]] = {}
    for section in sections:
        for piece in on_mesh.pieces(section):
            groups.setdefault((piece.names, piece.expansion), []).append(piece)
    united = _unite_planes([_concatenated(group) for group in groups.values()])
    if sections and not united:
        raise FormatError("expected fields on elements of the mesh, found none of its elements", file=sections[0].file)

    blocks: dict[str, list[Block]] = {}
    for piece in united:
        for name, coefficients in zip(piece.names, piece.coefficients, strict=True):
            blocks.setdefault(name, []).append(Block(piece.expansion, piece.element_ids, coefficients))
    return tuple(Field(name, _distinct_blocks(name, parts)) for name, parts in blocks.items())


class _OnMesh:
    """Cuts sections down to the elements of the mesh."""

    def __init__(self, mesh: Mesh) -> None:
        self._lookups = {shape: Lookup(entities.ids, "element") for shape, entities in mesh.elements.items()}

    def pieces(self, section: Section) -> Iterable[Piece]:
        """The pieces of a section, without the elements that the mesh lacks."""
        shape = section.space.shape
        known = self._present(shape, section.element_ids)
        others = [other for other in self._lookups if other is not shape]
        for other in others:
            wrong = section.element_ids[self._lookups[other].present(section.element_ids)]
            if len(wrong):
                message = f"expected element {wrong[0]} to be a {other.label.lower()} as in the mesh"
                raise FormatError(f"{message}, found a {shape.label.lower()}", file=section.file, place=section.place)
        for piece in pieces(section):
            kept = known if piece.element_ids is section.element_ids else self._present(shape, piece.element_ids)
            if kept.any():
                yield _kept(piece, kept)

    def _present(self, shape: Shape, ids: Ints) -> Bools:
        return self._lookups[shape].present(ids) if shape in self._lookups else np.zeros(len(ids), bool)


def _kept(piece: Piece, kept: Bools) -> Piece:
    if kept.all():
        return piece
    return replace(piece, element_ids=piece.element_ids[kept], coefficients=piece.coefficients[:, kept])


def _concatenated(group: list[Piece]) -> Piece:
    """Pieces of one expansion as one, elements that repeat once."""
    first = group[0]
    ids = np.concatenate([piece.element_ids for piece in group]) if len(group) > 1 else first.element_ids
    coefficients = first.coefficients
    if len(group) > 1:
        coefficients = np.concatenate([piece.coefficients for piece in group], axis=1)
    rows = first_rows(ids)
    if len(rows) < len(ids):
        for name, values in zip(first.names, coefficients, strict=True):
            _check_repeats(name, ids, values)
        ids, coefficients = ids[rows], coefficients[:, rows]
    return Piece(first.names, first.expansion, frozen_ints(ids), frozen_floats(coefficients))


def _check_repeats(name: str, ids: Ints, values: Floats) -> None:
    """FormatError where an element comes twice with other coefficients."""
    _, first, inverse = np.unique(ids, return_index=True, return_inverse=True)
    scale = np.max(np.abs(values), where=np.isfinite(values), initial=0.0)
    repeated = np.flatnonzero(first[inverse] != np.arange(len(ids)))
    same = np.isclose(values[repeated], values[first[inverse[repeated]]], rtol=0, atol=_SAME * scale, equal_nan=True)
    if not same.all():
        wrong = ids[repeated[np.flatnonzero(~same.all(axis=1))[0]]]
        raise FormatError(f"expected field {name} once on element {wrong}, found it twice with other data")


def _unite_planes(parts: list[Piece]) -> list[Piece]:
    """Parts of runs that were split along the homogeneous direction, put together plane after plane."""
    found: dict[object, Piece] = {}
    for piece in parts:
        key: object = (piece.names, _without_planes(piece.expansion), piece.element_ids.tobytes())
        if piece.expansion.homogeneous is None or piece.expansion.homogeneous.strips:
            found[id(piece)] = piece
        elif key in found:
            found[key] = _with_planes(found[key], piece)
        else:
            found[key] = piece
    return list(found.values())


def _without_planes(expansion: Expansion) -> Expansion:
    homogeneous = expansion.homogeneous
    return replace(expansion, homogeneous=homogeneous and replace(homogeneous, y_ids=(), z_ids=()))


def _with_planes(first: Piece, second: Piece) -> Piece:
    """The planes of the first, then those of the second."""
    one, two = first.expansion.homogeneous, second.expansion.homogeneous
    assert one is not None
    assert two is not None
    planes = [list(zip(h.y_ids, h.z_ids, strict=True)) if h.y_ids else list(h.z_ids) for h in (one, two)]
    if set(planes[0]) & set(planes[1]):
        raise FormatError(f"expected every Fourier mode of {first.names[0]} once, found one twice")
    joined = replace(one, z_ids=one.z_ids + two.z_ids, y_ids=one.y_ids + two.y_ids)
    coefficients = frozen_floats(np.concatenate([first.coefficients, second.coefficients], axis=2))
    return Piece(first.names, replace(first.expansion, homogeneous=joined), first.element_ids, coefficients)


def _distinct_blocks(name: str, blocks: list[Block]) -> tuple[Block, ...]:
    """The blocks of a field, one an expansion, no element twice (but for strips, which are copies side by side)."""
    by_expansion: dict[Expansion, list[Block]] = {}
    for block in blocks:
        by_expansion.setdefault(block.expansion, []).append(block)
    distinct = tuple(_joined(name, parts) for parts in by_expansion.values())
    plain = [b.element_ids for b in distinct if not (b.expansion.homogeneous and b.expansion.homogeneous.strips)]
    if len(plain) > 1:
        ids, counts = np.unique(np.concatenate(plain), return_counts=True)
        if (counts > 1).any():
            wrong = ids[counts > 1][0]
            raise FormatError(f"expected field {name} once on element {wrong}, found it in two expansions")
    return distinct


def _joined(name: str, parts: list[Block]) -> Block:
    if len(parts) == 1:
        return parts[0]
    pieces_ = [Piece((name,), b.expansion, b.element_ids, b.coefficients[None]) for b in parts]
    joined = _concatenated(pieces_)
    return Block(joined.expansion, joined.element_ids, joined.coefficients[0])
