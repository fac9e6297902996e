"""Samples of fields on elements and along Fourier directions, and the best approximation of such samples.

With Fourier directions a mode is the product of one of the shape and a wave, and so is the best approximation on a
lattice: evenly spaced planes, on which waves are orthogonal, as on the period, if there are more than two planes for
the shortest (Briggs and Henson, The DFT, 1995, section 2.5).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Expansion, Homogeneous
from elvis.core.mapping.projections import best
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.expansion import values, wave_values
from elvis.core.polynomials.interpolation import modified


@dataclass(frozen=True, eq=False)
class Lattice:
    """Reference points of a shape, repeated on planes along Fourier directions.

    points  (n, d) of the shape
    zeta    (k, p) of the planes; a single plane without coordinates if there are no such directions
    """

    points: Floats
    zeta: Floats

    @classmethod
    def of(cls, expansion: Expansion, extra: int = 1) -> Lattice:
        """The points at which an expansion is fitted, with ``extra`` ones each way that show what a fit leaves."""
        return cls(best(flat(expansion), extra).points, _planes(expansion.homogeneous, extra))


@dataclass(frozen=True, eq=False)
class Table:
    """Values of the modes of an expansion on a lattice.

    modes  (n, m) values of the modes of the shape
    waves  (k, l) of the Fourier factor of each plane of coefficients
    """

    modes: Floats
    waves: Floats

    @classmethod
    def of(cls, expansion: Expansion, lattice: Lattice) -> Table:
        """The table of an expansion."""
        return cls(values(flat(expansion), lattice.points), _waves(expansion.homogeneous, lattice.zeta))

    @property
    def size(self) -> int:
        """Number of coefficients of an element."""
        return int(self.modes.shape[1] * self.waves.shape[1])

    def samples(self, coefficients: Floats) -> Floats:
        """(elements, k n) values of fields with coefficients (elements, l m), the points of one plane together."""
        by_plane = coefficients.reshape(len(coefficients), self.waves.shape[1], self.modes.shape[1])
        return (self.waves @ (by_plane @ self.modes.T)).reshape(len(coefficients), -1)


@dataclass(frozen=True, eq=False)
class Fit:
    """The best approximation in an expansion of samples on its lattice (see `Lattice.of`).

    modes  (n, m)
    waves  (l, k)
    """

    modes: Floats
    waves: Floats

    @classmethod
    def of(cls, expansion: Expansion, extra: int = 1) -> Fit:
        """The fit of an expansion."""
        waves = _waves(expansion.homogeneous, _planes(expansion.homogeneous, extra))
        return cls(best(flat(expansion), extra).matrix, np.linalg.pinv(waves))

    def coefficients(self, samples: Floats) -> Floats:
        """(elements, l m) of samples (elements, k n)."""
        by_plane = samples.reshape(len(samples), self.waves.shape[1], self.modes.shape[0])
        return (self.waves @ (by_plane @ self.modes)).reshape(len(samples), -1)


def flat(expansion: Expansion) -> Expansion:
    """The expansion without its Fourier directions."""
    return replace(expansion, homogeneous=None)


def product_space(one: Expansion, other: Expansion) -> Expansion:
    """The expansion that holds the products of two, but for the rational functions on pyramids.

    Degrees add up, and so do wave numbers.  ElvisError where Fourier directions differ.
    """
    modes = tuple(p + q - 1 for p, q in zip(one.modes, other.modes, strict=True))
    found = modified(one.shape, modes)
    a, b = one.homogeneous, other.homogeneous
    if a is None and b is None:
        return found
    if a is None or b is None or a.lengths != b.lengths:
        raise ElvisError("expected fields along the same Fourier directions")
    waves = [sum(pair) for pair in zip(_shortest(a), _shortest(b), strict=True)]
    ids = list(product(*(range(2 * count + 2) for count in waves[::-1])))  # y runs fastest
    own = {"z_ids": tuple(each[0] for each in ids), "y_ids": tuple(each[-1] for each in ids if len(each) > 1)}
    return replace(found, homogeneous=Homogeneous((Basis.FOURIER,) * len(waves), a.lengths, **own))


def _shortest(planes: Homogeneous) -> list[int]:
    """The highest wave number along each Fourier direction, y before z."""
    numbers = (planes.y_ids, planes.z_ids) if len(planes.bases) == 2 else (planes.z_ids,)
    return [
        max(ids, default=0) // 2 if basis is Basis.FOURIER else 1
        for basis, ids in zip(planes.bases, numbers, strict=True)
    ]


def _planes(planes: Homogeneous | None, extra: int) -> Floats:
    """(k, p) coordinates zeta of evenly spaced planes along the Fourier directions, y fastest."""
    if planes is None:
        return np.empty((1, 0))
    counts = [2 * (waves + extra) + 1 for waves in _shortest(planes)]
    axes = np.meshgrid(*(-1 + 2 * np.arange(count) / count for count in counts[::-1]), indexing="ij")
    return np.stack([axis.reshape(-1) for axis in axes[::-1]], axis=1)


def _waves(planes: Homogeneous | None, zeta: Floats) -> Floats:
    """(k, l) values of the Fourier factor of each plane or line of coefficients."""
    return np.ones((len(zeta), 1)) if planes is None else wave_values(planes, zeta)
