"""Matrices (3, 3) with entries in ranges: bounds on their eigenvalues.

Ranges are given by middles and radii, (n, 3, 3) each.  The mean value theorem bounds the deviation of a function of a
matrix from its value at the middle: by its derivatives on the whole range, times the radii.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.core.cores.parallel import real_eigenvalues

_EYE = np.eye(3)
#: steps of Newton's method for an eigenvalue
_STEPS = 8
#: cosine of the angle between left and right eigenvectors that counts as none
_NORMAL = 1e-3


@dataclass(frozen=True, eq=False)
class MatrixRange:
    """Matrices between middle - radius and middle + radius, entry by entry."""

    middle: Floats
    radius: Floats

    @staticmethod
    def of_nets(nets: Floats) -> MatrixRange:
        """The range of matrices whose nine entries have Bernstein nets (n, 9, …)."""
        flat = nets.reshape(len(nets), 9, int(np.prod(nets.shape[2:])))
        low, high = flat.min(axis=2), flat.max(axis=2)
        return MatrixRange(((low + high) / 2).reshape(-1, 3, 3), ((high - low) / 2).reshape(-1, 3, 3))

    def shifted(self, numbers: Floats, errors: Floats) -> MatrixRange:
        """Less numbers (n,) times the unit matrix, that are known up to errors (n,)."""
        return MatrixRange(self.middle - numbers[:, None, None] * _EYE, self.radius + errors[:, None, None] * _EYE)

    def cofactors(self) -> MatrixRange:
        """The range of the matrices' cofactors: signed minors."""
        a, r = self.middle, self.radius
        middle, radius = np.empty_like(a), np.empty_like(a)
        for i, j in np.ndindex(3, 3):
            i1, i2, j1, j2 = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            middle[:, i, j] = a[:, i1, j1] * a[:, i2, j2] - a[:, i1, j2] * a[:, i2, j1]
            radius[:, i, j] = _product_radius(a, r, (i1, j1), (i2, j2)) + _product_radius(a, r, (i1, j2), (i2, j1))
        return MatrixRange(middle, radius)

    def sum_of_minors(self) -> tuple[Floats, Floats]:
        """(n,) middle and radius of the sum of the principal minors, whose derivative is tr A - A^T.

        A change E adds the sum of e_ii e_jj - e_ij e_ji over all i < j, which has no squares of diagonal entries.
        """
        trace = np.einsum("nii->n", self.middle)
        middle = 0.5 * (trace**2 - np.einsum("nij,nji->n", self.middle, self.middle))
        spread = np.einsum("nii->n", self.radius)
        slopes = np.abs(trace[:, None, None] * _EYE - self.middle.swapaxes(1, 2))
        others = spread[:, None, None] * _EYE + (1 - 2 * _EYE) * self.radius.swapaxes(1, 2)
        return middle, np.einsum("nij,nij->n", slopes + 0.5 * others, self.radius)


def _product_radius(a: Floats, r: Floats, first: tuple[int, int], second: tuple[int, int]) -> Floats:
    (i, j), (k, m) = first, second
    return np.asarray(np.abs(a[:, i, j]) * r[:, k, m] + r[:, i, j] * (np.abs(a[:, k, m]) + r[:, k, m]))


@dataclass(frozen=True, eq=False)
class Eigenvalue:
    """A real eigenvalue of matrices that are functions on boxes, given by its deviation from their first entry.

    is_known    (n,) whether there is exactly one in a range that holds every real eigenvalue without real others, and
                no left eigenvector is normal to the first axis
    error       (n,) maximum deviation from the first entry
    slope_error (n, 3)  (n, 3) maximum deviation of its derivatives from the derivatives of the first entry
    """

    is_known: Bools
    error: Floats
    slope_error: Floats

    @staticmethod
    def of(matrices: MatrixRange, slopes: list[MatrixRange]) -> Eigenvalue:
        """The eigenvalue of matrices minus their first entry times the unit matrix, with derivatives along three axes.

        After subtracting the eigenvalue of the middle, y^3 - P y^2 + Q y - D = 0 has one root in |y| <= Y = 2 |D| / Q,
        if the derivative has one sign there: if 8 |P| |D| <= Q^2.  In bases of `eigenbases`, D is of second order in
        the size of the range, since it has two factors that are zero at the middle.
        """
        start = real_eigenvalues(matrices.middle)
        less = matrices.shifted(start, np.zeros_like(start))
        minors, radius = less.sum_of_minors()
        lowest = minors - radius
        trace = np.abs(np.einsum("nii->n", less.middle)) + np.einsum("nii->n", less.radius)
        cofactors = less.cofactors()
        det = np.einsum("nij,nij->n", np.abs(cofactors.middle) + cofactors.radius, less.radius)
        is_known = (lowest > 0) & (8 * trace * det <= lowest**2)

        # its derivative is tr(adj dA) / tr adj, with the adjugate of A minus the eigenvalue
        with np.errstate(all="ignore"):
            spread = np.where(is_known, 2 * det / lowest, 0.0)
            cofactors = less.shifted(np.zeros_like(start), spread).cofactors()
            total, off = (np.einsum("nii->n", own) for own in (cofactors.middle, cofactors.radius))
            is_known &= (total > off) & (np.abs(cofactors.middle[:, 0, 0]) > cofactors.radius[:, 0, 0])
            sizes = np.abs(cofactors.middle) + cofactors.radius
            steep = [np.einsum("nij,nij->n", sizes, np.abs(own.middle) + own.radius) for own in slopes]
            slope_error = np.stack(steep, axis=1) / (total - off)[:, None]
        return Eigenvalue(np.asarray(is_known), np.abs(start) + spread, np.asarray(slope_error))


def eigenbases(matrices: Floats) -> tuple[Floats, Floats]:
    """Bases (n, 3, 3), as columns, and their inverses, in which matrices are an eigenvalue and a 2 x 2 block.

    The first vector is the right eigenvector of the real eigenvalue, the others are normal to the left one.  Nearly
    diagonal matrices have sharper bounds.  If both eigenvectors are nearly normal to one another, the basis is the unit
    matrix.
    """
    less = matrices - real_eigenvalues(matrices)[:, None, None] * _EYE
    adjugate = np.cross(less[:, [1, 2, 0]], less[:, [2, 0, 1]]).swapaxes(1, 2)
    every = np.arange(len(adjugate))
    right = adjugate[every, :, np.linalg.norm(adjugate, axis=1).argmax(axis=1)]
    left = adjugate[every, np.linalg.norm(adjugate, axis=2).argmax(axis=1)]
    with np.errstate(all="ignore"):
        right, left = (own / np.linalg.norm(own, axis=1, keepdims=True) for own in (right, left))
    sound = np.abs(np.einsum("ni,ni->n", left, right)) > _NORMAL
    bases = np.tile(_EYE, (len(matrices), 1, 1))
    others = across(left[sound])
    bases[sound] = np.stack([right[sound], others[:, 0], others[:, 1]], axis=2)
    return bases, np.linalg.inv(bases)


def across(normal: Floats) -> Floats:
    """(n, 2, 3) unit vectors normal to unit vectors (n, 3) and to one another."""
    least = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = np.cross(normal, least)
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normal, first)], axis=1)


def polished(matrices: Floats, start: Floats) -> Floats:
    """(n,) the eigenvalue of matrices (n, 3, 3) near ``start`` (n,), by Newton's method."""
    found = start
    for _ in range(_STEPS):
        less = matrices - found[:, None, None] * _EYE
        cofactors = np.cross(less[:, [1, 2, 0]], less[:, [2, 0, 1]])
        det = np.einsum("nj,nj->n", less[:, 0], cofactors[:, 0])
        total = np.einsum("nii->n", cofactors)
        with np.errstate(all="ignore"):
            found = found + np.where(total != 0, det / total, 0.0)
    return np.asarray(found)
