"""Values to colours; the one piece of picture-making that renderer and reference share."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elvis.formats.arrays import Floats
from elvis.renderer.errors import SceneError

#: colour of what is seen but is not a finite number
NOT_A_NUMBER = (1.0, 0.0, 1.0)
STEPS = 256


@dataclass(frozen=True, eq=False)
class Palette:
    """A colour map in equal steps: ``table`` (STEPS, 3) in [0, 1], for values from ``low`` to ``high``."""

    table: Floats
    low: float
    high: float

    @staticmethod
    def named(name: str, low: float, high: float) -> Palette:
        """The colour map that the cmap catalogue calls ``name``; SceneError with near names where there is none."""
        import cmap

        # a plain name stands for matplotlib's map where several collections have one
        logging.getLogger("cmap").setLevel(logging.ERROR)
        try:
            colormap = cmap.Colormap(name)
        except (ValueError, TypeError) as error:
            known = ", ".join(("viridis", "magma", "turbo", "coolwarm", "RdBu_r", "gray"))
            raise SceneError(
                f"unknown colour map {name!r}: expected a name of the cmap catalogue, e.g. {known}"
            ) from error
        return Palette(np.ascontiguousarray(colormap.lut(STEPS)[:, :3], dtype=np.float64), low, high)

    def steps(self, values: Floats) -> NDArray[np.uint16]:
        """Steps (…) of values (…): finite values beyond the range take the last one there, all others STEPS."""
        span = self.high - self.low
        with np.errstate(invalid="ignore", over="ignore"):
            scaled = (values - self.low) * (STEPS / span if span > 0 else 0.0)
        np.clip(scaled, 0, STEPS - 1, out=scaled)
        np.copyto(scaled, STEPS, where=~np.isfinite(values))
        return scaled.astype(np.uint16)

    def colors(self, values: Floats) -> Floats:
        """Colours (…, 3) in [0, 1] of values (…)."""
        return np.vstack([self.table, NOT_A_NUMBER]).take(self.steps(values), axis=0)


def automatic_range(values: Floats) -> tuple[float, float]:
    """Least and greatest finite value; (0, 1) where there is none, a sliver around a constant."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    if low == high:
        return low - max(abs(low), 1.0) * 1e-6, high + max(abs(high), 1.0) * 1e-6
    return low, high
