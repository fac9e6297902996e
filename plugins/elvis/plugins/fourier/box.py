"""The runtime plugin for periodic boxes: one element, any number of modes.

A file is a NumPy archive (.npz): ``low`` and ``high`` (3,) corners, ``bases`` (3,) names ``fourier`` or ``legendre`` of
the three directions, ``time``, and for each field ``field_NAME`` (n_x, n_y, n_z).  The functions of a Fourier direction
are 1, cos t, sin t, cos 2t, sin 2t, … with t = 2 pi (x - low) / (high - low); the others are the Legendre polynomials
of 2 (x - low) / (high - low) - 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, Ints, joined_floats
from elvis.core.base.errors import FormatError
from elvis.core.files.archives import Archive, names_in
from elvis.core.files.output import replacing
from elvis.core.shapes import Shape
from elvis.plugins.runtime.source import VolumeSource
from elvis.plugins.runtime.volume import Part, PartsVolume, boxes_between

_NEEDED = ("low", "high", "bases")
_PREFIX = "field_"
BASES = ("fourier", "legendre")
#: numbers in an intermediate array of the NumPy evaluation
_BATCH = 1 << 22


class FourierBox(VolumeSource):
    """A box whose fields are truncated Fourier series in one to three directions, and Legendre series in the others."""

    format = "periodic box in Fourier bases (.npz)"

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """One archive with corners and bases."""
        return len(paths) == 1 and names_in(Path(paths[0])) >= set(_NEEDED)

    def __init__(self, paths: Sequence[Path]) -> None:
        """Open the file."""
        self._path = Path(paths[0])
        arrays = _arrays(self._path)
        self.low, self.high = (self._corner(name, arrays[name]) for name in ("low", "high"))
        if not (self.low < self.high).all():
            raise self._error("high", f"expected a corner above {self.low}, found {self.high}")
        self.bases = tuple(str(name) for name in np.ravel(arrays["bases"]))
        if len(self.bases) != 3 or not set(self.bases) <= set(BASES):
            raise self._error("bases", f"expected three of {', '.join(BASES)}, found {', '.join(self.bases)}")
        self.amplitudes = {
            name.removeprefix(_PREFIX): self._field(name, array)
            for name, array in arrays.items()
            if name.startswith(_PREFIX)
        }
        self.fields = tuple(self.amplitudes)
        self.time = float(arrays.get("time", np.zeros(1)).ravel()[0])

    def _corner(self, name: str, array: NDArray[Any]) -> Floats:
        if array.shape != (3,) or array.dtype.kind not in "fi" or not np.isfinite(array).all():
            raise self._error(name, f"expected three numbers, found an array {array.shape} of {array.dtype}")
        return np.asarray(array, np.float64)

    def _field(self, name: str, array: NDArray[Any]) -> Floats:
        if array.ndim != 3 or 0 in array.shape or array.dtype.kind not in "fi":
            raise self._error(name, f"expected numbers (n_x, n_y, n_z), found an array {array.shape} of {array.dtype}")
        return np.asarray(array, np.float64)

    def _error(self, place: str, message: str) -> FormatError:
        return FormatError(message, file=self._path, place=place)

    def volume(self, field: str) -> PartsVolume:
        """The box with one of its fields."""
        amplitudes = self.amplitudes[field]

        def evaluate(elements: Ints, points: Floats) -> tuple[Floats, Floats]:
            positions = self.low + (1 + points) / 2 * (self.high - self.low)
            return positions, series(self.bases, amplitudes, points)

        part = Part(
            "fourier_box",
            f"Box<{', '.join(name.capitalize() for name in self.bases)}>",
            np.zeros(1, np.int64),
            boxes_between(self.low[None], self.high[None]),
            {
                "box": np.concatenate([self.low, (self.high - self.low) / 2]),
                "modes": np.array(amplitudes.shape, np.uint32),
                "amplitudes": np.ascontiguousarray(amplitudes.T),
            },
            evaluate=evaluate,
            shape=Shape.HEXAHEDRON,
            bounds=lambda: _bounds(amplitudes),
        )
        return PartsVolume([part], Path(__file__).parent)


def _bounds(amplitudes: Floats) -> tuple[Floats, Floats]:
    """(1,) a value that the series is never below, and one that it is never above: functions are at most 1."""
    mean, radius = amplitudes[0, 0, 0], (1 + 1e-12) * np.abs(amplitudes).sum()
    return np.array([mean - (radius - abs(mean))]), np.array([mean + (radius - abs(mean))])


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an archive that are known; FormatError where one can't be read."""
    with Archive(path) as file:
        known = (*_NEEDED, "time", *(name for name in file.names if name.startswith(_PREFIX)))
        return {name: file[name] for name in known if name in file.names or name in _NEEDED}


def write_box(
    path: str | Path, low: Floats, high: Floats, bases: Sequence[str], fields: Mapping[str, Floats], time: float = 0.0
) -> None:
    """Write a file that FourierBox opens; see the head of this module."""
    named: dict[str, Any] = {_PREFIX + name: amplitudes for name, amplitudes in fields.items()}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, low=low, high=high, bases=np.array(bases), time=time, **named)


def series(bases: Sequence[str], amplitudes: Floats, points: Floats) -> Floats:
    """(n,) values of a tensor product series at points (n, 3) of [-1, 1]^3."""
    step = max(1, _BATCH // amplitudes.size)
    batches = [_series(bases, amplitudes, points[k : k + step]) for k in range(0, len(points), step)]
    return joined_floats(batches)


def _series(bases: Sequence[str], amplitudes: Floats, points: Floats) -> Floats:
    x, y, z = (
        line(name, count, points[:, axis])
        for axis, (name, count) in enumerate(zip(bases, amplitudes.shape, strict=True))
    )
    layers = np.einsum("pk,ijk->pij", z, amplitudes)
    return np.asarray(np.einsum("pi,pi->p", x, np.einsum("pj,pij->pi", y, layers)))


def line(basis: str, count: int, r: Floats) -> Floats:
    """(n, count) basis functions of one direction at r (n,) in [-1, 1]."""
    if basis == "legendre":
        return np.asarray(np.polynomial.legendre.legvander(r, count - 1), np.float64)
    wave = (np.arange(count) + 1) // 2
    angle = np.pi * np.outer(1 + r, wave)
    return np.where(np.arange(count) % 2, np.cos(angle), np.where(wave == 0, 1.0, np.sin(angle)))
