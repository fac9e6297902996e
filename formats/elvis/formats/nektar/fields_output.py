"""Writing fields as XML and as HDF5 (format notes 5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from elvis.core.errors import ElvisError
from elvis.formats.nektar.hdf5_output import created
from elvis.formats.nektar.idlist import format_ids
from elvis.formats.nektar.output_xml import COMPRESSED, Writer
from elvis.formats.nektar.sections_output import OutputSection, joined

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

FORMAT_VERSION = 1


def write_sections(writer: Writer, sections: Sequence[OutputSection]) -> None:
    """The sections ELEMENTS; ElvisError for names that a comma-separated list can't hold."""
    for section in sections:
        _check_names(section.names)
        homogeneous = section.homogeneous
        attributes: dict[str, object] = {
            "FIELDS": joined(section.names),
            "SHAPE": section.shape_label,
            "BASIS": joined([basis.label for basis in section.bases]),
        }
        if homogeneous:
            attributes["HOMOGENEOUSLENGTHS"] = joined([repr(float(length)) for length in homogeneous.lengths])
            lists = {"Y": homogeneous.y_ids, "Z": homogeneous.z_ids, "S": homogeneous.strips}
            attributes |= {f"HOMOGENEOUS{axis}IDS": joined(ids) for axis, ids in lists.items() if ids}
        attributes |= {"NUMMODESPERDIR": _orders(section), "ID": format_ids(section.element_ids), **COMPRESSED}
        writer.payload("ELEMENTS", attributes, section.values())


def write_hdf5(path: Path, sections: Sequence[OutputSection], metadata: Mapping[str, str]) -> None:
    """A whole HDF5 field file; ElvisError where ids are too great for it."""
    with created(path) as file:
        root = file.create_group("NEKTAR")
        root.attrs.create("FORMAT_VERSION", FORMAT_VERSION, dtype=np.uint32)
        notes = root.create_group("Metadata")
        notes.create_group("Provenance")
        for key, text in metadata.items():
            notes.attrs.create(key, text, dtype=_string(text))
        is_mixed = any(section.is_mixed for section in sections)
        for number, section in enumerate(sections, 1):
            _write_definition(root.create_group(str(number)), section, is_mixed)
        _write_columns(root, sections, is_mixed)
        _write_values(root, sections)


def _check_names(names: Sequence[str]) -> None:
    for name in names:
        if not name or name != name.strip() or "," in name:
            raise ElvisError(f"expected names of fields without commas or outer blanks, found {name!r}")


def _orders(section: OutputSection) -> str:
    if section.is_mixed:
        return f"MIXORDER:{joined(section.orders().tolist())}"
    return f"UNIORDER:{joined(section.modes()[0])}"


def _write_definition(group: h5py.Group, section: OutputSection, is_mixed: bool) -> None:
    orders = "MIXORDER" if is_mixed else _orders(section)
    group.attrs.create("FIELDS", section.names, dtype=_string("".join(section.names)))
    group.attrs.create("BASIS", np.array(section.bases, np.int32))
    group.attrs.create("SHAPE", section.shape_label, dtype=_string(""))
    group.attrs.create("NUMMODESPERDIR", orders, dtype=_string(""))
    if section.homogeneous:
        group.attrs.create("HOMOGENEOUSLENGTHS", np.array(section.homogeneous.lengths, np.float64))


def _write_columns(root: h5py.Group, sections: Sequence[OutputSection], is_mixed: bool) -> None:
    """DECOMPOSITION and what it counts, but for the coefficients."""
    columns: dict[str, list[np.ndarray[tuple[int, ...], np.dtype[np.int64]]]] = {
        "ELEMENTIDS": [section.element_ids for section in sections],
        "POLYORDERS": [section.orders() if is_mixed else np.empty(0, np.int64) for section in sections],
        "HOMOGENEOUSYIDS": [np.array(s.homogeneous.y_ids if s.homogeneous else (), np.int64) for s in sections],
        "HOMOGENEOUSZIDS": [np.array(s.homogeneous.z_ids if s.homogeneous else (), np.int64) for s in sections],
        "HOMOGENEOUSSIDS": [np.array(s.homogeneous.strips if s.homogeneous else (), np.int64) for s in sections],
    }
    sizes = [[len(part) for part in parts] for parts in columns.values()]
    values = [sum(part.size for part in section.values()) for section in sections]
    table = np.column_stack([sizes[0], values, *sizes[1:], np.arange(1, len(sections) + 1)])
    root["DECOMPOSITION"] = table.reshape(-1).astype("<u8")
    for name, parts in columns.items():
        joined_part = np.concatenate(parts)
        if len(joined_part) or name == "ELEMENTIDS":
            root[name] = _uint32(joined_part, name)


def _write_values(root: h5py.Group, sections: Sequence[OutputSection]) -> None:
    total = sum(part.size for section in sections for part in section.values())
    data = root.create_dataset("DATA", (total,), "<f8")
    start = 0
    for section in sections:
        for part in section.values():
            data[start : start + part.size] = part.reshape(-1)
            start += part.size


def _uint32(
    values: np.ndarray[tuple[int, ...], np.dtype[np.int64]], name: str
) -> np.ndarray[tuple[int, ...], np.dtype[np.uint32]]:
    if len(values) and not 0 <= values.min() <= values.max() < 2**32:
        raise ElvisError(f"expected {name} below 2^32 for HDF5, found {values.min()} to {values.max()}")
    return values.astype("<u4")


def _string(text: str) -> object:
    """Strings of variable length, in ASCII wherever it does."""
    import h5py

    return h5py.string_dtype("ascii" if text.isascii() else "utf-8")
