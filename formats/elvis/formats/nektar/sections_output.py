"""From fields in memory to the sections of a field file: one a shape, wherever the blocks allow it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.dataset import Block, Dataset, Expansion, Homogeneous
from elvis.core.errors import ElvisError
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape


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
        """Of the fields."""
        return self.parts[0].names

    @property
    def shape(self) -> Shape:
        """Of the elements."""
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
        """Of the shape's directions, then of the Fourier directions."""
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

    ElvisError where two fields have one name.
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
    found: dict[Expansion, list[Part]] = {}
    for each in dataset.fields:
        for block in each.blocks:
            part = _part_of(block, found.setdefault(block.expansion, []))
            part.names.append(each.name)
            part.coefficients.append(block.coefficients)
    return [part for parts in found.values() for part in parts]


def _part_of(block: Block, parts: list[Part]) -> Part:
    """The part with the elements of the block, a new one where there is none."""
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


def joined(values: Sequence[object]) -> str:
    """A comma-separated list."""
    return ",".join(map(str, values))
