"""Fields in HDF5, version 1 (format notes 5.2)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.arrays import Ints
from elvis.core.errors import FormatError
from elvis.core.polynomials.bases import Basis
from elvis.formats.nektar import hdf5
from elvis.formats.nektar.basis_numbers import TODAY, Numbering, numbering
from elvis.formats.nektar.fields_xml import list_of_ints
from elvis.formats.nektar.sections import Section, Space, read_shape, read_space

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

GREATEST_VERSION = 1

#: columns of DECOMPOSITION before the key, and the datasets that each counts in
_COLUMNS = ("ELEMENTIDS", "DATA", "POLYORDERS", "HOMOGENEOUSYIDS", "HOMOGENEOUSZIDS", "HOMOGENEOUSSIDS")


def read_fields(path: Path) -> tuple[list[Section], dict[str, str]]:
    """All blocks of the file, one section each, and the metadata."""
    with hdf5.opened(path) as file:
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
            _section(root, str(path), blocks[row, 6], _cut(columns, spans), meaning)
            for row, spans in enumerate(offsets)
        ]
        return sections, _metadata(root)


def _column(root: h5py.Group, name: str) -> NDArray[Any]:
    values = hdf5.floats(root, name) if name == "DATA" else hdf5.ints(root, name)
    return np.empty(0, np.int64) if values is None else values


def _offsets(counts: NDArray[np.uint64], sizes: list[int]) -> list[list[tuple[int, int]]]:
    """For each block and dataset the span that it owns; FormatError where they don't fill the datasets exactly."""
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
    """What the numbers of bases mean in this file; today's where it is damaged, which shows when it is read."""
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


def _section(root: h5py.Group, file: str, key: np.uint64, columns: list[NDArray[Any]], meaning: Numbering) -> Section:
    ids, values, orders, y_ids, z_ids, strips = columns
    definition = hdf5.required_group(root, str(key))
    try:
        space = _space(definition, meaning, orders, len(ids), (y_ids, z_ids, strips))
        space.check_elements(len(ids))
        expected = space.total(len(ids))
        if len(values) != expected:
            raise FormatError(f"expected {expected} coefficients, found {len(values)}")
    except FormatError as error:
        raise error.within(place=f"/NEKTAR/{key}") from error
    return Section(space, ids, values, file, f"/NEKTAR/{key}")


def _space(
    definition: h5py.Group, meaning: Numbering, orders: Ints, elements: int, ids: tuple[Ints, Ints, Ints]
) -> Space:
    bases = _bases(hdf5.attribute(definition, "BASIS").tolist(), meaning)
    y_ids, z_ids, strips = (tuple(part.tolist()) for part in ids)
    return read_space(
        tuple(hdf5.text(name) for name in hdf5.attribute(definition, "FIELDS")),
        hdf5.text_attribute(definition, "SHAPE"),
        bases,
        _modes(hdf5.text_attribute(definition, "NUMMODESPERDIR"), orders, elements, len(bases)),
        (_lengths(definition), y_ids, z_ids, strips),
    )


def _lengths(definition: h5py.Group) -> tuple[float, ...]:
    values = hdf5.attribute(definition, "HOMOGENEOUSLENGTHS", is_required=False)
    if values.dtype.kind != "f":
        raise FormatError(f"expected numbers in HOMOGENEOUSLENGTHS, found {values.dtype}")
    return tuple(values.astype(np.float64).tolist())


def _bases(codes: list[object], known: Numbering) -> tuple[Basis, ...]:
    if not all(isinstance(code, int) and code in known for code in codes):
        raise FormatError(f"expected numbers of bases, found {codes}")
    return tuple(known[code] for code in codes if isinstance(code, int))


def _modes(text: str, orders: Ints, elements: int, bases: int) -> Ints:
    """(1, bases) or (elements, bases) numbers of modes."""
    if text.startswith("MIXORDER"):
        if len(orders) != elements * bases or not elements:
            raise FormatError(f"expected {elements * bases} numbers in POLYORDERS, found {len(orders)}")
        return orders.reshape(-1, bases)
    values = list_of_ints(text.removeprefix("UNIORDER:")) if text.startswith("UNIORDER:") else np.empty(0, np.int64)
    if len(values) != bases:
        raise FormatError(f"expected UNIORDER: and {bases} numbers of modes, or MIXORDER, found {text[:40]!r}")
    return values.reshape(1, bases)


def _metadata(root: h5py.Group) -> dict[str, str]:
    group = hdf5.group(root, "Metadata")
    if group is None:
        return {}
    return {hdf5.text(key): _metadata_text(group, key) for key in hdf5.attribute_names(group)}


def _metadata_text(group: h5py.Group, key: str) -> str:
    values = hdf5.attribute(group, key)
    return ",".join(hdf5.text(value) if isinstance(value, str | bytes) else str(value) for value in values)
