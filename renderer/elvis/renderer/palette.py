"""Values to colours; the one piece of picture-making that renderer and reference share."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

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

    def colors(self, values: Floats) -> Floats:
        """Colours (…, 3) in [0, 1] of values (…); finite values beyond the range take the end's colour."""
        span = self.high - self.low
        scaled = (values - self.low) * (STEPS / span if span > 0 else 0.0)
        finite = np.isfinite(values)
        step = np.clip(np.where(finite, scaled, 0.0), 0, STEPS - 1).astype(np.uint8)
        colors = self.table[step]
        colors[~finite] = NOT_A_NUMBER
        return np.asarray(colors)


def automatic_range(values: Floats) -> tuple[float, float]:
    """Least and greatest finite value; (0, 1) where there is none, a sliver around a constant."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    if low == high:
        return low - max(abs(low), 1.0) * 1e-6, high + max(abs(high), 1.0) * 1e-6
    return low, high
