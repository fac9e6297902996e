"""Fields in XML and in HDF5, from files to fields in memory, on the elements that the mesh has (format notes 5)."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints, distinct, frozen_floats, frozen_ints, frozen_view, narrow_ints
from elvis.core.base.errors import FormatError
from elvis.core.data.dataset import Block, Expansion, Field
from elvis.core.data.mesh import Mesh
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape
from elvis.formats.nektar import hdf5, numbers
from elvis.formats.nektar.assembly import Lookup, first_rows
from elvis.formats.nektar.geometry.xml import is_compressed
from elvis.formats.nektar.numbers import split
from elvis.formats.nektar.packed import Packed
from elvis.formats.nektar.payload import check_possible, decode_exactly
from elvis.formats.nektar.sections import (
    TODAY,
    Numbering,
    Piece,
    Section,
    Space,
    coefficient_counts,
    numbering,
    pieces,
    read_bases,
    read_shape,
    read_space,
)
from elvis.formats.nektar.xml import Element, format_errors_at

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

_ORDERS = re.compile(r"\s*(UNIORDER|MIXORDER)\s*:(.*)", re.DOTALL)


def read_section(element: Element, wanted: Collection[str] | None = None, *, stays_packed: bool = False) -> Section:
    """A section ELEMENTS; raises FormatError if its attributes or data are wrong.

    wanted        names of the only fields to read, at least one of which the section has; None for all
    stays_packed  whether coefficients stay packed; errors in them are then reported when they are unpacked
    """
    with format_errors_at(element):
        is_compressed(element)
        space = _xml_space(element)
        ids = numbers.parse_ids(element.require("ID"))
        space.check_elements(ids.count)

        # a list of ids is expanded once its coefficients, at least as many, are there, or the text is long enough
        items = space.total(ids.count)
        names, place = space.names, f"<ELEMENTS ID={element.attributes['ID'][:40]}>"
        if stays_packed:
            check_possible(element.content, items)
            packed = Packed(element, space.counts(ids.count), len(names), tuple(range(len(names))))
            whole = Section(space, ids.expand(items), packed, element.file, place)
            return whole if wanted is None else whole.of(wanted)

        # fields follow one another: what comes behind the last that is requested is not unpacked
        count = len(names) if wanted is None else max(i + 1 for i, name in enumerate(names) if name in wanted)
        first = items // len(names) * count
        values: Floats = decode_exactly(element.content, items, first).view("<f8").astype(np.float64, copy=False)
        whole = Section(replace(space, names=names[:count]), ids.expand(items), values, element.file, place)
        return whole if wanted is None else whole.of(wanted)


def field_names(element: Element) -> tuple[str, ...]:
    """The names of the fields of a section ELEMENTS."""
    return split(element.require("FIELDS"))


def read_metadata(element: Element | None) -> dict[str, str]:
    """Key and text of each child but Provenance."""
    if element is None:
        return {}
    return {child.tag: child.text for child in element.children() if child.tag != "Provenance"}


def time_of(metadata: Mapping[str, str]) -> float | None:
    """The time of the metadata, None unless it is a number."""
    try:
        return float(metadata["Time"])
    except (KeyError, ValueError):
        return None


def _xml_space(element: Element) -> Space:
    attributes = element.attributes
    bases = read_bases(element.require("BASIS"))
    return read_space(
        field_names(element),
        element.require("SHAPE"),
        bases,
        _xml_modes(element.require("NUMMODESPERDIR"), len(bases)),
        (
            _xml_lengths(attributes.get("HOMOGENEOUSLENGTHS", "")),
            _numbers(attributes.get("HOMOGENEOUSYIDS", "")),
            _numbers(attributes.get("HOMOGENEOUSZIDS", "")),
            _numbers(attributes.get("HOMOGENEOUSSIDS", "")),
        ),
    )


def _xml_modes(text: str, bases: int) -> Ints:
    """(1, bases) or (n, bases) numbers of modes."""
    found = _ORDERS.fullmatch(text)
    if found is None:
        raise FormatError(f"expected UNIORDER: or MIXORDER: in NUMMODESPERDIR, found {text[:40]!r}")
    values = list_of_ints(found[2])
    wanted = bases if found[1] == "UNIORDER" else max(len(values) // bases, 1) * bases
    if len(values) != wanted:
        raise FormatError(f"expected {wanted} numbers of modes, found {len(values)}")
    return values.reshape(-1, bases)


def list_of_ints(text: str) -> Ints:
    """(n,) whole numbers separated by commas."""
    return numbers.ints(text.replace(",", " ").encode("ascii", "replace"))


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(list_of_ints(text).tolist())


def _xml_lengths(text: str) -> tuple[float, ...]:
    return tuple(numbers.floats(text.replace(",", " ").encode("ascii", "replace")).tolist())


GREATEST_VERSION = 1

#: columns of DECOMPOSITION before the key, and the datasets that each counts in
_COLUMNS = ("ELEMENTIDS", "DATA", "POLYORDERS", "HOMOGENEOUSYIDS", "HOMOGENEOUSZIDS", "HOMOGENEOUSSIDS")


def read_hdf5(path: Path) -> tuple[list[Section], dict[str, str]]:
    """All blocks of the file, one section each, and the metadata."""
    with hdf5.reading(path) as file:
        root = hdf5.required_group(file, "NEKTAR")
        hdf5.version(root, GREATEST_VERSION)
        table = hdf5.unsigned(root, "DECOMPOSITION")
        if table is None or len(table) % 7:
            raise FormatError("expected DECOMPOSITION with seven numbers a block, found otherwise", place="/NEKTAR")
        blocks = table.reshape(-1, 7)
        columns = [_column(root, name) for name in _COLUMNS]
        meaning = _numbering(root, blocks[:, 6])
        offsets = _offsets(blocks[:, :6], [len(column) for column in columns])
        sections = [
            _hdf5_section(root, str(path), blocks[row, 6], _cut(columns, spans), meaning)
            for row, spans in enumerate(offsets)
        ]
        return sections, read_hdf5_metadata(root)


def _column(root: h5py.Group, name: str) -> NDArray[Any]:
    values = hdf5.floats(root, name) if name == "DATA" else hdf5.table(root, name)
    return np.empty(0, np.int64) if values is None else values


def _offsets(counts: NDArray[np.uint64], sizes: list[int]) -> list[list[tuple[int, int]]]:
    """For each block and dataset the span that it owns; raises FormatError if they don't fill the datasets exactly."""
    if counts.sum(dtype=np.float64) > 1 << 60:
        raise FormatError(f"expected counts of data, found {counts.max()}", place="/NEKTAR/DECOMPOSITION")
    ends = np.cumsum(counts.astype(np.int64), axis=0)
    for column, (name, size) in enumerate(zip(_COLUMNS, sizes, strict=True)):
        total = int(ends[-1, column]) if len(ends) else 0
        if total != size:
            raise FormatError(f"expected {total} values as in DECOMPOSITION, found {size}", place=f"/NEKTAR/{name}")
    starts = ends - counts.astype(np.int64)
    return np.stack([starts, ends], axis=2).tolist()  # type: ignore[no-any-return]


def _cut(columns: list[NDArray[Any]], spans: list[tuple[int, int]]) -> list[NDArray[Any]]:
    return [column[slice(*span)] for column, span in zip(columns, spans, strict=True)]


def _numbering(root: h5py.Group, keys: NDArray[np.uint64]) -> Numbering:
    """The meaning of the numbers of bases in this file.

    Today's meaning if the file is damaged, which is reported when the data are read.
    """
    try:
        own = [hdf5.required_group(root, str(key)) for key in dict.fromkeys(keys.tolist())]
        codes = [hdf5.attribute(each, "BASIS").tolist() for each in own]
        shapes = [read_shape(hdf5.text_attribute(each, "SHAPE"))[0] for each in own]
        notes = hdf5.group(root, "Metadata")
        origin = None if notes is None else hdf5.group(notes, "Provenance")
        has_version = origin is not None and "NektarVersion" in hdf5.attribute_names(origin)
        version = _metadata_text(origin, "NektarVersion") if has_version else ""
    except FormatError:
        return TODAY
    return numbering(zip(codes, shapes, strict=True), version)


def _hdf5_section(
    root: h5py.Group, file: str, key: np.uint64, columns: list[NDArray[Any]], meaning: Numbering
) -> Section:
    ids, values, orders, y_ids, z_ids, strips = columns
    definition = hdf5.required_group(root, str(key))
    try:
        space = _hdf5_space(definition, meaning, orders, len(ids), (y_ids, z_ids, strips))
        space.check_elements(len(ids))
        expected = space.total(len(ids))
        if len(values) != expected:
            raise FormatError(f"expected {expected} coefficients, found {len(values)}")
    except FormatError as error:
        raise error.within(place=f"/NEKTAR/{key}") from error
    return Section(space, ids, values, file, f"/NEKTAR/{key}")


def _hdf5_space(
    definition: h5py.Group, meaning: Numbering, orders: Ints, elements: int, ids: tuple[Ints, Ints, Ints]
) -> Space:
    bases = _hdf5_bases(hdf5.attribute(definition, "BASIS").tolist(), meaning)
    y_ids, z_ids, strips = (tuple(part.tolist()) for part in ids)
    return read_space(
        tuple(hdf5.text(name) for name in hdf5.attribute(definition, "FIELDS")),
        hdf5.text_attribute(definition, "SHAPE"),
        bases,
        _hdf5_modes(hdf5.text_attribute(definition, "NUMMODESPERDIR"), orders, elements, len(bases)),
        (_hdf5_lengths(definition), y_ids, z_ids, strips),
    )


def _hdf5_lengths(definition: h5py.Group) -> tuple[float, ...]:
    values = hdf5.attribute(definition, "HOMOGENEOUSLENGTHS", is_required=False)
    if values.dtype.kind != "f":
        raise FormatError(f"expected numbers in HOMOGENEOUSLENGTHS, found {values.dtype}")
    return tuple(values.astype(np.float64).tolist())


def _hdf5_bases(codes: list[object], known: Numbering) -> tuple[Basis, ...]:
    if not all(isinstance(code, int) and code in known for code in codes):
        raise FormatError(f"expected numbers of bases, found {codes}")
    return tuple(known[code] for code in codes if isinstance(code, int))


def _hdf5_modes(text: str, orders: Ints, elements: int, bases: int) -> Ints:
    """(1, bases) or (elements, bases) numbers of modes."""
    if text.startswith("MIXORDER"):
        if len(orders) != elements * bases or not elements:
            raise FormatError(f"expected {elements * bases} numbers in POLYORDERS, found {len(orders)}")
        return orders.reshape(-1, bases)
    values = list_of_ints(text.removeprefix("UNIORDER:")) if text.startswith("UNIORDER:") else np.empty(0, np.int64)
    if len(values) != bases:
        raise FormatError(f"expected UNIORDER: and {bases} numbers of modes, or MIXORDER, found {text[:40]!r}")
    return values.reshape(1, bases)


def read_hdf5_metadata(root: h5py.Group) -> dict[str, str]:
    """Key and text of each entry."""
    group = hdf5.group(root, "Metadata")
    if group is None:
        return {}
    return {hdf5.text(key): _metadata_text(group, key) for key in hdf5.attribute_names(group)}


def _metadata_text(group: h5py.Group, key: str) -> str:
    values = hdf5.attribute(group, key)
    return ",".join(hdf5.text(value) if isinstance(value, str | bytes) else str(value) for value in values)


#: coefficients that two files give for one element may differ by rounding, relative to the largest
_SAME = 1e-9


def assemble(sections: Sequence[Section], mesh: Mesh) -> tuple[Field, ...]:
    """One field per name, one block per expansion; elements that are not in the mesh are dropped.

    Raises FormatError if an element has another shape in the mesh, if data of one element contradict each other, or if
    no element is in the mesh.
    """
    fields = _fields(sections, mesh)
    if sections and not fields:
        raise FormatError("expected fields on elements of the mesh, found none of its elements", file=sections[0].file)
    return fields


def without_values(sections: Sequence[Section], mesh: Mesh) -> tuple[Field, ...]:
    """The fields that `assemble` makes, with blocks that have no coefficients, and ids of the type of the sections."""
    return assemble([replace(section, values=None) for section in sections], mesh)


def assemble_part(
    sections: Sequence[Section], mesh: Mesh, whole: Sequence[Field]
) -> tuple[tuple[Field, ...], dict[str, tuple[Ints, ...]]]:
    """The blocks of fields of the whole on the elements that a part of its mesh has, and their rows in the whole.

    whole  see `without_values`
    """
    on_mesh = _OnMesh(mesh)
    found = {(own.name, block.expansion): block for own in _fields(sections, mesh) for block in own.blocks}
    fields, rows = [], {}
    for field in whole:
        chosen = [np.flatnonzero(on_mesh.present(block.expansion.shape, block.element_ids)) for block in field.blocks]
        rows[field.name] = tuple(
            narrow_ints(some, len(block)) for block, some in zip(field.blocks, chosen, strict=True)
        )
        blocks = zip(field.blocks, chosen, strict=True)
        own = (_block_with_ids(found.get((field.name, block.expansion)), block.of(some)) for block, some in blocks)
        fields.append(replace(field, blocks=tuple(own)))
    return tuple(fields), rows


def _block_with_ids(found: Block | None, wanted: Block) -> Block:
    """A block with the elements of another, which has no coefficients, in their order; None has no elements."""
    if found is None:
        own = wanted.expansion
        planes = 1 if own.homogeneous is None else len(own.homogeneous.z_ids)
        width = planes * coefficient_counts(own.shape, np.array([own.modes]))[0]
        return replace(wanted, coefficients=frozen_floats(np.empty((0, width))))
    if np.array_equal(found.element_ids, wanted.element_ids):
        return found
    return found.of(Lookup(found.element_ids, "element").rows(wanted.element_ids, "field"))


def _fields(sections: Sequence[Section], mesh: Mesh) -> tuple[Field, ...]:
    """See `assemble`; none if no element is in the mesh."""
    on_mesh = _OnMesh(mesh)
    frozen = frozen_ints if any(section.values is not None for section in sections) else frozen_view
    groups: dict[tuple[tuple[str, ...], Expansion], list[Piece]] = {}
    for section in sections:
        for piece in on_mesh.pieces(section):
            groups.setdefault((piece.names, piece.expansion), []).append(piece)
    united = _unite_planes([_concatenate(group) for group in groups.values()])
    blocks: dict[str, list[Block]] = {}
    for piece in united:
        ids = frozen(piece.element_ids)
        for name, coefficients in zip(piece.names, piece.coefficients, strict=True):
            blocks.setdefault(name, []).append(Block(piece.expansion, ids, coefficients))
    return tuple(Field(name, _distinct_blocks(name, parts)) for name, parts in blocks.items())


class _OnMesh:
    """Cuts sections down to the elements of the mesh."""

    def __init__(self, mesh: Mesh) -> None:
        self._lookups = {shape: Lookup(entities.ids, "element") for shape, entities in mesh.elements.items()}
        self._space = mesh.space

    def pieces(self, section: Section) -> Iterable[Piece]:
        """The pieces of a section, without the elements that the mesh lacks."""
        shape = section.space.shape
        self._check_directions(section)
        for other in (known for known in self._lookups if known is not shape):
            wrong = section.element_ids[self._lookups[other].present(section.element_ids)]
            if len(wrong):
                message = f"expected element {wrong[0]} to be a {other.label.lower()} as in the mesh"
                raise FormatError(f"{message}, found a {shape.label.lower()}", file=section.file, place=section.place)
        return pieces(section, self.present(shape, section.element_ids))

    def _check_directions(self, section: Section) -> None:
        """Raise FormatError if the mesh leaves too few coordinates for the Fourier directions."""
        planes = section.space.homogeneous
        directions = len(planes.bases) if planes else 0
        if self._space + directions > 3:
            expected = f"a mesh of SPACE {3 - directions} at most for {directions} Fourier directions"
            raise FormatError(f"expected {expected}, found {self._space}", file=section.file, place=section.place)

    def present(self, shape: Shape, ids: Ints) -> Bools:
        """Whether the mesh has each element (n,) of a shape."""
        return self._lookups[shape].present(ids) if shape in self._lookups else np.zeros(len(ids), bool)


def _concatenate(group: list[Piece]) -> Piece:
    """Pieces of one expansion as one, elements that repeat once."""
    first = group[0]
    ids = np.concatenate([piece.element_ids for piece in group]) if len(group) > 1 else first.element_ids
    coefficients = first.coefficients
    if len(group) > 1:
        coefficients = np.concatenate([piece.coefficients for piece in group], axis=1)
    if len(distinct(ids)) < len(ids):
        for name, values in zip(first.names, coefficients, strict=True):
            _check_repeats(name, ids, values)
        rows = first_rows(ids)
        ids, coefficients = ids[rows], coefficients[:, rows]
    return Piece(first.names, first.expansion, frozen_view(ids), frozen_floats(coefficients))


def _check_repeats(name: str, ids: Ints, values: Floats) -> None:
    """Raise FormatError if an element comes twice with other coefficients."""
    _, first, inverse = np.unique(ids, return_index=True, return_inverse=True)
    scale = np.max(np.abs(values), where=np.isfinite(values), initial=0.0)
    repeated = np.flatnonzero(first[inverse] != np.arange(len(ids)))
    same = np.isclose(values[repeated], values[first[inverse[repeated]]], rtol=0, atol=_SAME * scale, equal_nan=True)
    if not same.all():
        wrong = ids[repeated[np.flatnonzero(~same.all(axis=1))[0]]]
        raise FormatError(
            f"expected field {name} once on element {wrong}, found it twice with other data; "
            "of the steps of a series give one"
        )


def _unite_planes(parts: list[Piece]) -> list[Piece]:
    """Join pieces that were split along a homogeneous direction, plane after plane.

    A part of a mesh joins the pieces that the whole joins.
    """
    found: dict[object, Piece] = {}
    for piece in parts:
        if piece.expansion.homogeneous is None or piece.expansion.homogeneous.strips:
            found[id(piece)] = piece
            continue
        key: object = (piece.names, _without_planes(piece.expansion), piece.element_ids.tobytes())
        found[key] = _with_planes(found[key], piece) if key in found else piece
    return list(found.values())


def _without_planes(expansion: Expansion) -> Expansion:
    homogeneous = expansion.homogeneous
    return replace(expansion, homogeneous=homogeneous and replace(homogeneous, y_ids=(), z_ids=()))


def _with_planes(first: Piece, second: Piece) -> Piece:
    """The planes of the first piece, followed by the planes of the second."""
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
    distinct = tuple(_join_blocks(name, parts) for parts in by_expansion.values())
    plain = [b.element_ids for b in distinct if not (b.expansion.homogeneous and b.expansion.homogeneous.strips)]
    if len(plain) > 1:
        ids, counts = np.unique(np.concatenate(plain), return_counts=True)
        if (counts > 1).any():
            wrong = ids[counts > 1][0]
            raise FormatError(f"expected field {name} once on element {wrong}, found it in two expansions")
    return distinct


def _join_blocks(name: str, parts: list[Block]) -> Block:
    if len(parts) == 1:
        return parts[0]
    pieces_ = [Piece((name,), b.expansion, b.element_ids, b.coefficients[None]) for b in parts]
    joined = _concatenate(pieces_)
    return Block(joined.expansion, joined.element_ids, joined.coefficients[0])
