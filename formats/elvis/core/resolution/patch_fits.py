"""Polynomials in x, y, z that are fitted to a field on patches of elements.

A fit compares like with like: with R the operator that makes fields of functions (`Restriction`), it compares R q with
the field, not q.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import sparse

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_floats, frozen_ints
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset, Expansion
from elvis.core.mapping.orientation import chunks, local_vertices
from elvis.core.mapping.patch import Patch, patches
from elvis.core.mapping.projections import best, conforming
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.jacobi import jacobi
from elvis.core.resolution.modal_bases import exact_rule, modal_basis

#: numbers in a table of polynomials at points of elements
BATCH = 1 << 21
#: owners whose normal equations are solved together
TOGETHER = 1 << 9
#: share of a polynomial's energy that the field must capture to say something of it
_CAPTURED = 0.15
#: what is added to scalar products, relative to their sum, so that rounding leaves them positive
_REGULAR = 1e-15
#: points in each direction beyond those that make a projection exact for polynomials of its degree
EXTRA = 1


@dataclass(frozen=True, eq=False)
class Restriction:
    """The operator R that makes a field on an element of a function.

    points    (n, d)
    matrix    (n, m) from values at the points to the coefficients of the field
    compared  (m, k) from coefficients to orthonormal modes: all, or those up to the total degree of the field
    functions (k, m) coefficients of these modes
    """

    points: Floats
    matrix: Floats
    compared: Floats
    functions: Floats

    @staticmethod
    @bounded_cache
    def of(expansion: Expansion, is_continuous: bool, is_complete: bool) -> Restriction:
        """The operator of an expansion; on request with all modes.

        It is the best approximation in the mean for discontinuous fields, and projection-based interpolation for
        continuous ones: Galerkin solutions are closer to the latter.
        """
        operator = best(expansion, EXTRA)
        points, matrix = operator.points, operator.matrix
        if is_continuous and min(expansion.modes) == max(expansion.modes) > 1:
            own = modified(expansion.shape, expansion.modes)
            interpolating = conforming(own, EXTRA)
            # the interpolant, in the Modified basis, is a function of the field's space
            change = values(own, points).T @ matrix
            points, matrix = interpolating.points, interpolating.matrix @ change

        basis = modal_basis(expansion)
        levels = np.zeros(1, np.int64)
        for factor in basis.factors:
            levels = (levels[:, None] + factor.levels).reshape(-1)
        is_compared = is_complete | (levels < max(expansion.modes))
        to_modal = basis.modal(np.eye(matrix.shape[1])).reshape(len(levels), -1)
        compared, functions = to_modal[:, is_compared], np.linalg.inv(to_modal)[is_compared]
        return Restriction(points, frozen_floats(matrix), frozen_floats(compared), frozen_floats(functions))


@dataclass(frozen=True, eq=False)
class FieldElements:
    """The elements of a patch that have a field with finite coefficients.

    start     number of the first one among all elements with the field
    vertices  (n, k) of the mesh
    """

    patch: Patch
    start: int
    vertices: Ints

    def __len__(self) -> int:
        return len(self.patch)

    @property
    def field(self) -> tuple[Expansion, Floats]:
        """Expansion and coefficients of the field."""
        expansion, coefficients = self.patch.fields[0], self.patch.coefficients[0]
        assert expansion is not None
        assert coefficients is not None
        return expansion, coefficients

    def positions(self, rows: Ints | slice, points: Floats) -> Floats:
        """(n, q, d) world coordinates of reference points (q, d) of some elements."""
        world = evaluate(self.patch.geometry, self.patch.geometry_coefficients[rows], points)
        return np.swapaxes(world, 1, 2)[..., : self.patch.shape.dimension]


def field_elements(dataset: Dataset, name: str) -> Iterator[FieldElements]:
    """The elements that have a field with finite coefficients."""
    mesh, start = dataset.mesh, 0
    if mesh.dimension < mesh.space:
        raise ElvisError(f"{name}: expected elements of the dimension of the space to recover a field, found others")
    for patch in patches(dataset, [name]):
        if patch.homogeneous:
            raise ElvisError(f"{name}: expected a field without Fourier directions to recover it")
        if patch.coefficients[0] is None:
            continue
        patch = patch.part(np.flatnonzero(np.isfinite(patch.coefficients[0]).all(axis=1)))
        if len(patch):
            vertices = local_vertices(mesh, patch.shape)[mesh.of(patch.shape).rows_of(patch.element_ids)]
            yield FieldElements(patch, start, vertices)
            start += len(patch)
    if not start:
        raise ElvisError(f"expected elements of the domain with finite values of {name}, found none")


class PatchFits:
    """Polynomials of owners, such as the vertices of a mesh: each is fitted to the elements of a patch.

    coefficients    (v, k) of products of Legendre polynomials
    centres, sizes  (v, d) of the boxes on which these are orthogonal: half the lengths of the sides
    """

    def __init__(
        self, elements: Sequence[FieldElements], owners: int, degree: int, is_continuous: bool, is_complete: bool
    ) -> None:
        self.elements, self._is_continuous, self._is_complete = elements, is_continuous, is_complete
        dimension = elements[0].patch.shape.dimension
        self._degrees = _degrees(dimension, degree)
        self.coefficients = np.zeros((owners, self.size))
        self.centres, self.sizes = np.zeros((owners, dimension)), np.ones((owners, dimension))

        corners = [own.positions(slice(None), own.patch.shape.vertices) for own in elements]
        self._low = np.concatenate([own.min(axis=1) for own in corners])
        self._high = np.concatenate([own.max(axis=1) for own in corners])

    @property
    def size(self) -> int:
        """Number of coefficients of a polynomial."""
        return len(self._degrees)

    @property
    def degree(self) -> int:
        """Total degree of the polynomials."""
        return int(self._degrees.max(initial=0))

    def table(self, owners: Ints, places: Floats) -> Floats:
        """(k, n, q) products of Legendre polynomials of owners (n,) at positions (n, q, d)."""
        local = (places - self.centres[owners, None]) / self.sizes[owners, None]
        lines = [jacobi(self.degree, 0, 0, axis.reshape(-1)) for axis in np.moveaxis(local, -1, 0)]
        table = lines[0][self._degrees[:, 0]]
        for line, degrees in zip(lines[1:], self._degrees.T[1:], strict=True):
            table *= line[degrees]
        return table.reshape(self.size, *local.shape[:2])

    def values(self, owners: Ints, places: Floats) -> Floats:
        """(n, q) values of the polynomials of owners (n,) at positions (n, q, d)."""
        return np.asarray(np.einsum("knq,nk->nq", self.table(owners, places), self.coefficients[owners]))

    def fit(self, owners: Ints, patches_of: sparse.csr_matrix) -> Bools:
        """Fit polynomials of owners (v,) to the elements of their patches (v, e).

        Returns whether the elements (v,) leave polynomials undetermined; these get minimal coefficients.
        """
        starts = patches_of.indptr[:-1]
        low = np.minimum.reduceat(self._low[patches_of.indices], starts)
        high = np.maximum.reduceat(self._high[patches_of.indices], starts)
        self.centres[owners], self.sizes[owners] = (low + high) / 2, (high - low) / 2
        place = np.repeat(np.arange(len(owners)), np.diff(patches_of.indptr))
        sums = [np.zeros((len(owners), size)) for size in (self.size**2, self.size**2, self.size)]
        for own in self.elements:
            held = np.flatnonzero((patches_of.indices >= own.start) & (patches_of.indices < own.start + len(own)))
            for pairs in self._batches(own, held):
                ones, numbers = np.ones(len(pairs)), np.arange(len(pairs))
                adding = sparse.csr_matrix((ones, (place[pairs], numbers)), (len(owners), len(pairs)))
                products = self._products(own, patches_of.indices[pairs] - own.start, owners[place[pairs]])
                for total, some in zip(sums, products, strict=True):
                    total += adding @ some.reshape(len(pairs), -1)
        captured, lacking, right = sums
        square = (len(owners), self.size, self.size)
        self.coefficients[owners], is_open = _least_fits(captured.reshape(square), lacking.reshape(square), right)
        return is_open

    def _batches(self, own: FieldElements, pairs: Ints) -> Iterator[Ints]:
        """Pairs (n,) of owners and elements of a patch, some at a time."""
        step = max(1, BATCH // (len(self.restriction(own).points) * self.size))
        return (pairs[part] for part in chunks(len(pairs), step))

    def restriction(self, own: FieldElements) -> Restriction:
        """The operator that makes the field on the elements of a patch."""
        return Restriction.of(own.field[0], self._is_continuous, self._is_complete)

    def _products(self, own: FieldElements, rows: Ints, owners: Ints) -> tuple[Floats, Floats, Floats]:
        """Scalar products on elements, as sums of them make the fits.

        Of each owner: of the modes of its restricted polynomials (n, k, k), of the parts of the polynomials that the
        modes lack (n, k, k), and of the modes with the field (n, k).
        """
        restriction, (expansion, coefficients) = self.restriction(own), own.field
        table = self.table(owners, own.positions(rows, restriction.points))
        modes = table @ (restriction.matrix @ restriction.compared)
        points, weights = exact_rule(modified(expansion.shape, (self.degree + 1,) * expansion.shape.dimension))
        functions = values(expansion, points) @ restriction.functions.T
        lacking = self.table(owners, own.positions(rows, points)) - modes @ functions.T
        lacking *= np.sqrt(weights)
        right = np.einsum("knr,nr->nk", modes, coefficients[rows] @ restriction.compared)
        return _squares(modes), _squares(lacking), right


def _squares(table: Floats) -> Floats:
    """(n, k, k) scalar products of rows: of tables (k, n, q)."""
    own = table.transpose(1, 0, 2)
    return np.asarray(np.matmul(own, own.transpose(0, 2, 1)))


def _least_fits(captured: Floats, lacking: Floats, right: Floats) -> tuple[Floats, Bools]:
    """(n, k) polynomials with captured q = right, and whether others (n,) would do as well.

    captured, lacking  (n, k, k) scalar products of the modes of polynomials, and of what these lack of them
    The field says nothing of polynomials of which the modes capture too little: the solution that lacks least is taken.
    """
    # with captured + lacking = L L^T, the eigenvalues of L^-1 captured L^-T are the captured shares
    whole = captured + lacking
    identity = np.eye(whole.shape[1])
    trace = np.trace(whole, axis1=1, axis2=2)[:, None, None]
    lower = np.linalg.inv(np.linalg.cholesky(whole + _REGULAR * trace * identity))
    shares, vectors = np.linalg.eigh(lower @ captured @ lower.transpose(0, 2, 1))
    is_known = shares > _CAPTURED
    inverse = np.where(is_known, 1.0, 0.0) / np.where(is_known, shares, 1.0)
    directions = lower.transpose(0, 2, 1) @ vectors
    spectrum = np.matmul(directions.transpose(0, 2, 1), right[:, :, None])[..., 0]
    return np.matmul(directions, (inverse * spectrum)[:, :, None])[..., 0], ~is_known.all(axis=1)


@bounded_cache
def _degrees(dimension: int, most: int) -> Ints:
    """(k, d) degrees of the products of polynomials up to a total degree."""
    every = product(range(most + 1), repeat=dimension)
    return frozen_ints([degrees for degrees in every if sum(degrees) <= most])
