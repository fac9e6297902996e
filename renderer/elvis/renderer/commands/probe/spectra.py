"""Spectra of ``elvis probe``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from elvis.core.base.errors import ElvisError
from elvis.renderer.commands.probe.points import COLUMNS

if TYPE_CHECKING:
    from elvis.core.files.columns import Columns

#: what stands for all times in one segment
WHOLE = 0


def segment_of(text: str) -> int:
    """``all``, or a number of times."""
    if text == "all":
        return WHOLE
    if not text.isdecimal() or int(text) < 1:
        raise ElvisError(f"expected all, or a number of times, found {text!r}")
    return int(text)


def spectra_of(columns: Columns, count: int, segment: int) -> Columns:
    """The table of densities, a row for each frequency and place, from one of values at times for ``count`` places."""
    import numpy as np

    from elvis.core.numbers.spectra import power_spectrum

    times = np.asarray(columns["time"], np.float64)[::count]
    found: dict[str, Any] = {}
    for name in (name for name in columns if name not in ("time", *COLUMNS)):
        values = np.asarray(columns[name], np.float64).reshape(-1, count)
        frequency, density = power_spectrum(times, values, segment or None)
        found[name] = density.reshape(-1)
    places = {name: np.tile(columns[name][:count], len(frequency)) for name in COLUMNS}
    return {"frequency": np.repeat(frequency, count), **places, **found}
