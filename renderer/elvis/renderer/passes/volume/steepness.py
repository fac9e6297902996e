"""How much transfer functions change with their quantity, and which error of it colours bear."""

from __future__ import annotations

import numpy as np

from elvis.scene import Transfer


def tolerance(transfer: Transfer, error: float, length: float) -> float:
    """Error of the quantity that changes colours by less than a quarter of ``error`` along rays of some length."""
    return float(0.25 * error / max(steepest(transfer) * length, 1e-300)) if len(transfer.values) > 1 else np.inf


def steepest(transfer: Transfer) -> float:
    """How much densities, and colours times the largest one, change at most for a unit of the quantity."""
    values, densities, colors = (
        np.asarray(x, np.float64) for x in (transfer.values, transfer.densities, transfer.colors)
    )
    if len(values) < 2:
        return 0.0
    steps = np.diff(values)
    of_colors = densities.max() * np.abs(np.diff(colors, axis=0) / steps[:, None]).max()
    return float(np.abs(np.diff(densities) / steps).max() + of_colors)
