"""Writing fields as XML and as HDF5 (format notes 5), in one section a shape wherever the blocks allow it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Block, Dataset, Expansion, Homogeneous
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape
from elvis.formats.nektar.hdf5 import created
from elvis.formats.nektar.numbers import comma_list, format_ids
from elvis.formats.nektar.xml import COMPRESSED, Writer

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]


@dataclass(eq=False)
class Part:
    """Elements of one expansion and the coefficients (n, m) of each field that has this very block."""

    expansion: Expansion
    element_ids: Ints
    names: list[str] = field(default_factory=list)
    coefficients: list[Floats] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class OutputSection:
    """Parts of one shape, set of bases and set of fields; orders differ where there are several."""

    parts: tuple[Part, ...]

    @property
    def names(self) -> list[str]:
        """Names of the fields."""
        return self.parts[0].names

    @property
    def shape(self) -> Shape:
        """Shape of the elements."""
        return self.parts[0].expansion.shape

    @property
    def homogeneous(self) -> Homogeneous | None:
        """The Fourier directions."""
        return self.parts[0].expansion.homogeneous

    @property
    def shape_label(self) -> str:
        """SHAPE with the suffixes of Fourier directions and strips."""
        if self.homogeneous is None:
            return self.shape.label
        strips = "-Strips" if self.homogeneous.strips else ""
        return f"{self.shape.label}-HomogenousExp{len(self.homogeneous.bases)}D{strips}"

    @property
    def bases(self) -> tuple[Basis, ...]:
        """The bases of the shape's directions, followed by the bases of the Fourier directions."""
        return self.parts[0].expansion.bases + (self.homogeneous.bases if self.homogeneous else ())

    @property
    def element_ids(self) -> Ints:
        """(n,) ids in the order of the data."""
        return np.concatenate([part.element_ids for part in self.parts])

    @property
    def is_mixed(self) -> bool:
        """Whether orders differ."""
        return len(set(self.modes())) > 1

    def modes(self) -> list[tuple[int, ...]]:
        """Numbers of modes of each part, Fourier directions included."""
        fourier = _fourier_modes(self.homogeneous) if self.homogeneous else ()
        return [part.expansion.modes + fourier for part in self.parts]

    def orders(self) -> Ints:
        """(n bases,) numbers of modes element by element."""
        repeated = [np.tile(modes, len(part.element_ids)) for modes, part in zip(self.modes(), self.parts, strict=True)]
        return np.concatenate(repeated).astype(np.int64)

    def values(self) -> Iterator[Floats]:
        """The coefficients in the order of the file: field by field, element by element."""
        for index in range(len(self.names)):
            for part in self.parts:
                yield part.coefficients[index].astype("<f8", copy=False)


def output_sections(dataset: Dataset) -> list[OutputSection]:
    """The fields of a dataset as sections, by shape in the order of the format.

    Raises ElvisError if two fields have one name.
    """
    names = [field.name for field in dataset.fields]
    if len(set(names)) < len(names):
        raise ElvisError(f"expected fields of distinct names, found {', '.join(sorted(names))}")
    groups: dict[object, list[Part]] = {}
    for part in _parts(dataset):
        e = part.expansion
        groups.setdefault((tuple(part.names), e.shape, e.bases, e.homogeneous), []).append(part)
    sections = [OutputSection(tuple(parts)) for parts in groups.values()]
    return sorted(sections, key=lambda section: list(Shape).index(section.shape))


def _parts(dataset: Dataset) -> list[Part]:
    """Blocks that fields have in common, once."""
    # blocks of other elements begin with another one: lists of more than one part are rare
    found: dict[tuple[Expansion, bytes], list[Part]] = {}
    for each in dataset.fields:
        for block in each.blocks:
            key = block.expansion, block.element_ids[:1].tobytes()
            part = _part_of(block, found.setdefault(key, []))
            part.names.append(each.name)
            part.coefficients.append(block.coefficients)
    return [part for parts in found.values() for part in parts]


def _part_of(block: Block, parts: list[Part]) -> Part:
    """The part with the elements of the block; a new one if none exists."""
    for part in parts:
        if part.element_ids is block.element_ids or np.array_equal(part.element_ids, block.element_ids):
            return part
    parts.append(Part(block.expansion, block.element_ids))
    return parts[-1]


def _fourier_modes(homogeneous: Homogeneous) -> tuple[int, ...]:
    """NUMMODES of the Fourier directions: enough for the highest mode there is."""
    ids = [homogeneous.y_ids, homogeneous.z_ids] if homogeneous.y_ids else [homogeneous.z_ids]
    return tuple(_enough(basis, set(each)) for basis, each in zip(homogeneous.bases, ids, strict=True))


def _enough(basis: Basis, ids: set[int]) -> int:
    if basis is not Basis.FOURIER:
        return len(ids)
    return max(ids) + 1 if len(ids) == 1 and max(ids) == 0 else (max(ids) // 2 + 1) * 2


FORMAT_VERSION = 1


def write_sections(writer: Writer, sections: Sequence[OutputSection]) -> None:
    """The sections ELEMENTS; raises ElvisError for names that a comma-separated list can't hold."""
    for section in sections:
        _check_names(section.names)
        homogeneous = section.homogeneous
        attributes: dict[str, object] = {
            "FIELDS": comma_list(section.names),
            "SHAPE": section.shape_label,
            "BASIS": comma_list([basis.label for basis in section.bases]),
        }
        if homogeneous:
            attributes["HOMOGENEOUSLENGTHS"] = comma_list([repr(float(length)) for length in homogeneous.lengths])
            lists = {"Y": homogeneous.y_ids, "Z": homogeneous.z_ids, "S": homogeneous.strips}
            attributes |= {f"HOMOGENEOUS{axis}IDS": comma_list(ids) for axis, ids in lists.items() if ids}
        attributes |= {"NUMMODESPERDIR": _orders(section), "ID": format_ids(section.element_ids), **COMPRESSED}
        writer.payload("ELEMENTS", attributes, section.values())


def write_hdf5(path: Path, sections: Sequence[OutputSection], metadata: Mapping[str, str]) -> None:
    """A whole HDF5 field file; raises ElvisError if ids are too great for it."""
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
        return f"MIXORDER:{comma_list(section.orders().tolist())}"
    return f"UNIORDER:{comma_list(section.modes()[0])}"


def _write_definition(group: h5py.Group, section: OutputSection, is_mixed: bool) -> None:
    orders = "MIXORDER" if is_mixed else _orders(section)
    group.attrs.create("FIELDS", section.names, dtype=_string("".join(section.names)))
    group.attrs.create("BASIS", np.array(section.bases, np.int32))
    group.attrs.create("SHAPE", section.shape_label, dtype=_string(""))
    group.attrs.create("NUMMODESPERDIR", orders, dtype=_string(""))
    if section.homogeneous:
        group.attrs.create("HOMOGENEOUSLENGTHS", np.array(section.homogeneous.lengths, np.float64))


def _write_columns(root: h5py.Group, sections: Sequence[OutputSection], is_mixed: bool) -> None:
    """Write DECOMPOSITION and the columns that it counts, except the coefficients."""
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
