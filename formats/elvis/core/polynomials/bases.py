"""The one-dimensional basis families and their products on the reference shapes (format notes 4)."""

from __future__ import annotations

from enum import IntEnum


class Basis(IntEnum):
    """A factor family; HDF5 field files use these numbers, text files use the names ``basis.label``."""

    NONE = 0
    ORTHO_A = 1
    ORTHO_B = 2
    ORTHO_C = 3
    MODIFIED_A = 4
    MODIFIED_B = 5
    MODIFIED_C = 6
    ORTHO_PYR_C = 7
    MODIFIED_PYR_C = 8
    FOURIER = 9
    GLL_LAGRANGE = 10
    GAUSS_LAGRANGE = 11
    LEGENDRE = 12
    CHEBYSHEV = 13
    MONOMIAL = 14
    FOURIER_SINGLE_MODE = 15
    FOURIER_HALF_MODE_RE = 16
    FOURIER_HALF_MODE_IM = 17

    @property
    def label(self) -> str:
        """The name in XML files, e.g. ``Modified_A``."""
        return _LABELS[self]

    @classmethod
    def from_label(cls, label: str) -> Basis:
        """The basis that files call ``label``; raises KeyError if there is none."""
        return {name: basis for basis, name in _LABELS.items()}[label]


_LABELS = {
    Basis.NONE: "NoBasisType",
    Basis.ORTHO_A: "Ortho_A",
    Basis.ORTHO_B: "Ortho_B",
    Basis.ORTHO_C: "Ortho_C",
    Basis.MODIFIED_A: "Modified_A",
    Basis.MODIFIED_B: "Modified_B",
    Basis.MODIFIED_C: "Modified_C",
    Basis.ORTHO_PYR_C: "OrthoPyr_C",
    Basis.MODIFIED_PYR_C: "ModifiedPyr_C",
    Basis.FOURIER: "Fourier",
    Basis.GLL_LAGRANGE: "GLL_Lagrange",
    Basis.GAUSS_LAGRANGE: "Gauss_Lagrange",
    Basis.LEGENDRE: "Legendre",
    Basis.CHEBYSHEV: "Chebyshev",
    Basis.MONOMIAL: "Monomial",
    Basis.FOURIER_SINGLE_MODE: "FourierSingleMode",
    Basis.FOURIER_HALF_MODE_RE: "FourierHalfModeRe",
    Basis.FOURIER_HALF_MODE_IM: "FourierHalfModeIm",
}
