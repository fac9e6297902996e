"""Exact records of pictures: the channels that are compared, from files, frames and baselines alike."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.files.archives import Archive
from elvis.core.files.output import replacing
from elvis.scene.record.frame import Frame

#: channels and their dimensions beyond height and width
CHANNELS = {"color": 3, "depth": 0, "field": 0, "element": 0, "position": 3, "reference": 3, "normal": 3, "status": 0}


@dataclass(frozen=True, eq=False)
class Record:
    """A picture's channels, (height, width[, 3]); row 0 is the top.

    color      in [0, 1]
    depth      distance from the eye's plane along the view, infinite if nothing is visible
    field      NaN if nothing is visible
    element    id in the file, -1 if nothing is visible
    position, reference, normal  world and reference coordinates, unit normals; NaN if nothing is visible
    status     0 miss, 1 certain, 2 ambiguous, 3 failed
    uncertainty  maximum error of the depth; NaN if nothing is visible, None if it isn't known
    """

    color: Floats
    depth: Floats
    field: Floats
    element: Ints
    position: Floats
    reference: Floats
    normal: Floats
    status: Ints
    uncertainty: Floats | None = None

    @staticmethod
    def of(frame: Frame) -> Record:
        """The record of a frame that has reference coordinates."""
        from elvis.scene.figure.saving import arrays

        found = arrays(frame)
        return Record(**{name: found[name] for name in (*CHANNELS, "uncertainty")})

    @staticmethod
    def load(path: Path) -> Record:
        """A record from an .npz file; raises FormatError for other files, or if a channel is missing."""
        with Archive(path, "a record that elvis render writes as .npz") as archive:
            found = {name: archive[name] for name in (*CHANNELS, "uncertainty") if name in archive.names}
        missing = [name for name in CHANNELS if name not in found]
        if missing:
            raise FormatError(f"expected the channels {', '.join(CHANNELS)}, found no {', '.join(missing)}", file=path)
        return Record._check(found, path)

    @staticmethod
    def _check(found: dict[str, Any], path: Path) -> Record:
        """The record, if every channel has the picture's size and a number at each pixel."""
        size = found["field"].shape
        for name in found:
            depth = CHANNELS.get(name, 0)
            expected = (*size, depth) if depth else size
            if len(size) != 2 or found[name].shape != expected or found[name].dtype.kind not in "fiu":
                shape = " x ".join(map(str, found[name].shape)) or "a single value"
                raise FormatError(
                    f"expected numbers at all pixels of one picture, found {shape}", file=path, place=name
                )
        whole = {name: np.int64 if name in ("element", "status") else np.float64 for name in found}
        return Record(**{name: values.astype(whole[name]) for name, values in found.items()})

    @staticmethod
    def of_strips(strips: Iterable[Record]) -> Record:
        """The record of a picture from the records of its strips of rows, top first."""
        parts = list(strips)
        names = [own.name for own in fields(Record) if getattr(parts[0], own.name) is not None]
        return Record(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})

    def rows(self, first: int, last: int) -> Record:
        """The rows from one to before another."""
        names = [own.name for own in fields(self) if getattr(self, own.name) is not None]
        return Record(**{name: getattr(self, name)[first:last] for name in names})

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        height, width = self.field.shape
        return height, width

    @cached_property
    def seen(self) -> Bools:
        """(h, w) whether something is visible."""
        return self.element >= 0

    def save(self, path: Path) -> None:
        """Write an .npz file as ``elvis render`` does."""
        with replacing(path) as temporary, temporary.open("wb") as stream:
            every = {own.name: getattr(self, own.name) for own in fields(self)}
            np.savez_compressed(stream, **{name: values for name, values in every.items() if values is not None})
