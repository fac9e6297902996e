"""Homogeneous (quasi-3D) data as a runtime plugin: plane elements with a Fourier series along z."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np

from elvis.formats.arrays import Floats
from elvis.formats.bases import Basis
from elvis.formats.boxes import element_boxes
from elvis.formats.dataset import Block, Dataset, Field, Homogeneous
from elvis.formats.errors import ElvisError
from elvis.formats.patch import Patch
from elvis.plugins.native.solving import Solver
from elvis.plugins.native.volume import NativeVolume
from elvis.plugins.volume import Part


@dataclass(frozen=True, eq=False)
class PlanesVolume:
    """A Volume: one period of the plane elements of a dataset along z."""

    parts: Sequence[Part]
    dimension: int = 3

    @property
    def shader_folder(self) -> Path:
        """Where the native Slang modules stand."""
        return Path(__file__).parent

    @staticmethod
    def serves(dataset: Dataset, field: str) -> bool:
        """Whether a field of plane elements has one Fourier direction."""
        found = series(dataset, field)
        return found is not None and len(found.lengths) == 1 and dataset.mesh.dimension == dataset.mesh.space == 2

    @staticmethod
    def of(dataset: Dataset, field: str) -> PlanesVolume:
        """The elements that have the field.  ElvisError where its blocks don't share one Fourier series."""
        found = series(dataset, field)
        blocks = dataset.field(field).blocks
        if found is None or any(block.expansion.homogeneous != found for block in blocks):
            raise ElvisError(f"expected one Fourier series in all elements of the field {field!r}, found several")
        planes = [NativeVolume.of(_plane(dataset, field, m), field) for m in range(len(found.z_ids))]
        return PlanesVolume([_part(found, parts) for parts in zip(*(some.parts for some in planes), strict=True)])


def series(dataset: Dataset, field: str) -> Homogeneous | None:
    """The Fourier directions of a field's first block, None where there are none."""
    blocks = dataset.field(field).blocks
    return blocks[0].expansion.homogeneous if blocks else None


def _plane(dataset: Dataset, field: str, mode: int) -> Dataset:
    """One Fourier mode as a field of the plane."""
    blocks = []
    for block in dataset.field(field).blocks:
        count = len(block.expansion.homogeneous.z_ids) if block.expansion.homogeneous else 1
        own = block.coefficients.reshape(len(block.element_ids), count, -1)[:, mode]
        blocks.append(Block(replace(block.expansion, homogeneous=None), block.element_ids, own))
    return replace(dataset, fields=(Field(field, tuple(blocks)),))


def _part(found: Homogeneous, modes: Sequence[Part]) -> Part:
    """The like parts of all modes as one."""
    first, length = modes[0], found.lengths[0]
    fields = np.stack([part.buffers["coefficients"].reshape(len(part), -1) for part in modes], axis=1)
    buffers = {"coefficients": np.ascontiguousarray(fields), "waves": waves(found), "period": np.array([length])}
    return replace(
        first,
        type=f"Planes<{first.type}, {len(modes)}>",
        source=f"{first.source} import native_planes;",
        boxes=np.concatenate([element_boxes(_extended(patch, found)) for patch in cast(Solver, first.solve).patches]),
        buffers={**first.buffers, **buffers},
        solve=None,
    )


def _extended(patch: Patch, found: Homogeneous) -> Patch:
    """A patch of the plane with the Fourier directions."""
    return replace(patch, fields=tuple(own and replace(own, homogeneous=found) for own in patch.fields))


def waves(found: Homogeneous) -> Floats:
    """(m, 4) each mode's half turns a unit of zeta, factors of cosine and sine, and shift of zeta.

    Mode 2k is cos(k pi (zeta + 1)), mode 2k + 1 is -sin(k pi (zeta + 1)), the single-mode family has k = 1, the half
    modes are cos(pi zeta) and -sin(pi zeta), as in `elvis.formats.factors.fourier`.
    """
    (basis,), mode = found.bases, np.asarray(found.z_ids)
    wave, sine, shift = mode // 2, mode % 2, np.ones(len(mode))
    if basis is Basis.FOURIER_SINGLE_MODE:
        wave = np.ones_like(mode)
    elif basis in (Basis.FOURIER_HALF_MODE_RE, Basis.FOURIER_HALF_MODE_IM):
        wave, sine, shift = np.ones_like(mode), np.full_like(mode, basis is Basis.FOURIER_HALF_MODE_IM), 0 * shift
    return np.stack([wave, 1 - sine, -sine, shift], axis=1).astype(np.float64)
