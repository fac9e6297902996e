"""The Fourier functions of quasi-3D data, as the kernels take them."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import Homogeneous
from elvis.core.polynomials.bases import Basis


def waves(found: Homogeneous) -> Floats:
    """(m, directions, 4) each mode's half turns a unit of zeta, factors of cosine and sine, and shift of zeta.

    Mode 2k is cos(k pi (zeta + 1)), mode 2k + 1 is -sin(k pi (zeta + 1)), the single-mode family has k = 1, the half
    modes are cos(pi zeta) and -sin(pi zeta), as in `elvis.core.polynomials.factors.fourier`.
    """
    numbers = (found.y_ids, found.z_ids)[-len(found.bases) :]
    return np.stack([_line(basis, np.asarray(own)) for basis, own in zip(found.bases, numbers, strict=True)], axis=1)


def _line(basis: Basis, mode: Ints) -> Floats:
    """(m, 4) of one direction."""
    wave, sine, shift = mode // 2, mode % 2, np.ones(len(mode))
    if basis is Basis.FOURIER_SINGLE_MODE:
        wave = np.ones_like(mode)
    elif basis in (Basis.FOURIER_HALF_MODE_RE, Basis.FOURIER_HALF_MODE_IM):
        wave, sine, shift = np.ones_like(mode), np.full_like(mode, basis is Basis.FOURIER_HALF_MODE_IM), 0 * shift
    return np.stack([wave, 1 - sine, -sine, shift], axis=1).astype(np.float64)
