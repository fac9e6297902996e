"""Power spectral densities of signals, by Welch's method (IEEE Trans. Audio Electroacoust. 15, 1967)."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.base.needing import require_module

#: tolerance for the evenness of time steps, relative to the mean step
_EVEN = 1e-6
#: samples of a segment at least
_LEAST = 4


def power_spectrum(times: Floats, values: Floats, segment: int | None = None) -> tuple[Floats, Floats]:
    """One-sided power spectral densities of real signals.

    Parameters
    ----------
    times : (n,) array
        Even steps, ascending.
    values : (n, k) array
        k signals.
    segment : int, optional
        Samples of each segment; segments overlap by half.  One segment spans the whole signal if omitted.

    Returns
    -------
    frequency : (m,) array
        Cycles per unit of time, from 0.
    density : (m, k) array
        Squares of the signals' units by frequency: over all frequencies a density adds up to about the variance.

    Raises
    ------
    ElvisError
        If there are too few times, or steps are uneven.

    Notes
    -----
    Each segment has its mean removed and is multiplied by a Hann window, as in `scipy.signal.welch`.

    Examples
    --------
    >>> frequency, density = power_spectrum(times, signal[:, None], 256)  # doctest: +SKIP
    """
    steps = np.diff(times)
    count = len(times) if segment is None else segment
    if not _LEAST <= count <= len(times):
        raise ElvisError(f"--spectrum: expected segments of {_LEAST} to {len(times)} times, found {count}")
    if not (np.abs(steps - steps.mean()) <= _EVEN * abs(steps.mean())).all():
        raise ElvisError("--spectrum: expected even steps of time, found others: pass --times A:B:N")
    signal = require_module("scipy.signal", "a spectrum", "signals")
    frequency, density = signal.welch(values, 1 / steps.mean(), nperseg=count, axis=0)
    return np.asarray(frequency), np.asarray(density)
