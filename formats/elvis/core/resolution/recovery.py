"""Recovered fields: of one order more, with derivatives that are one order more accurate than those of the field.

Around each vertex v, a polynomial q_v in x, y, z of degree p + 1 is fitted to a field of order p on all elements that
share v.  The fit compares like with like: with R the operator that makes fields of functions (`Restriction`), R q_v is
compared with the field, not q_v.  The polynomials of an element's vertices are blended,

    b = sum over v of hat_v q_v,        hat_v multilinear, 1 at v and 0 at other vertices,

after those that misfit the element were replaced by the one that fits best (`_trusted`): next to layers and corners,
the elements on the other side of a vertex would spoil the fit.

and only the part of b that the order p lacks is added to the field u on the element:

    u* = u + b - R b.

If u = R f for a polynomial f of degree p + 1, then q_v = f and u* = f.  For smooth f, the derivatives of u* have the
order p + 1, those of u the order p.

Zienkiewicz and Zhu 1992, The superconvergent patch recovery and a posteriori error estimates (patches of vertices);
Zhang and Naga 2005, A new finite element gradient recovery method: superconvergence property (polynomials of degree
p + 1 fitted to the field); Babuska and Melenk 1997, The partition of unity method (blending).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy import sparse

from elvis.core.arrays import Bools, Floats, Ints, frozen_floats, frozen_ints
from elvis.core.bounded_cache import bounded_cache
from elvis.core.dataset import Block, Dataset, Expansion, Field
from elvis.core.errors import ElvisError
from elvis.core.mapping.mode_entities import vertex_functions
from elvis.core.mapping.orientation import chunks, local_vertices
from elvis.core.mapping.projections import best, conforming
from elvis.core.patch import Patch, patches
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.jacobi import jacobi
from elvis.core.quantities.jumps import jumps
from elvis.core.resolution.element_resolution import DOUBLE, SINGLE, is_single
from elvis.core.resolution.modal_bases import exact_rule, modal_basis

#: numbers in a table of polynomials at points of elements
_BATCH = 1 << 21
#: vertices whose normal equations are solved together
_TOGETHER = 1 << 9
#: share of a polynomial's energy that the field must capture to say something of it
_CAPTURED = 0.15
#: what is added to scalar products, relative to their sum, so that rounding leaves them positive
_REGULAR = 1e-15
#: points in each direction beyond those that make a projection exact for polynomials of its degree
EXTRA = 1
#: rounding that the jumps of a continuous field may add up to
_JUMPS = 10.0


@dataclass(frozen=True, eq=False)
class Restriction:
    """The operator R that makes a field on an element of a function.

    points    (n, d)
    matrix    (n, m) from values at the points to the coefficients of the field
    compared  (m, k) from coefficients to the modes, orthonormal, up to the total degree of the field
    functions (k, m) coefficients of these modes
    """

    points: Floats
    matrix: Floats
    compared: Floats
    functions: Floats

    @staticmethod
    @bounded_cache
    def of(expansion: Expansion, is_continuous: bool) -> Restriction:
        """The operator of an expansion.

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
        is_compared = levels < max(expansion.modes)
        to_modal = basis.modal(np.eye(matrix.shape[1])).reshape(len(levels), -1)
        compared, functions = to_modal[:, is_compared], np.linalg.inv(to_modal)[is_compared]
        return Restriction(points, frozen_floats(matrix), frozen_floats(compared), frozen_floats(functions))


@dataclass(frozen=True, eq=False)
class _Elements:
    """The elements of a patch.

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


def enriched(dataset: Dataset, name: str) -> Field:
    """The field u* of one order more than a field, in Modified expansions; it jumps between elements.

    Raises ElvisError without elements, with Fourier directions, and for surfaces and curves in space.
    """
    elements = list(_elements(dataset, name))
    fits = _VertexFits(dataset, elements, is_continuous(dataset, name))
    blocks = []
    for own in elements:
        target = raised(own.field[0])
        step = max(1, _BATCH // (len(best(target, EXTRA).points) * fits.size))
        parts = [fits.enriched(own, np.arange(len(own))[part]) for part in chunks(len(own), step)]
        blocks.append(Block(target, own.patch.element_ids, frozen_floats(np.concatenate(parts))))
    return Field(name, tuple(blocks))


def raised(expansion: Expansion) -> Expansion:
    """The Modified expansion of one order more, the same in each direction."""
    return modified(expansion.shape, (max(expansion.modes) + 1,) * expansion.shape.dimension)


def is_continuous(dataset: Dataset, name: str) -> bool:
    """Whether the jumps of a field are rounding, in double or, if it was written so, in single precision."""
    field = dataset.field(name)
    if field.continuous is not None:
        return field.continuous
    held = [patch for patch in patches(dataset, [name]) if patch.fields[0] is not None and len(patch)]
    rounding = SINGLE if all(map(is_single, held)) else DOUBLE
    size = max((np.abs(np.nan_to_num(block.coefficients)).max(initial=0.0) for block in field.blocks), default=0.0)
    _, jump = jumps(dataset, name)
    return bool(np.nanmax(jump, initial=0.0) <= _JUMPS * rounding * size)


def _elements(dataset: Dataset, name: str) -> Iterator[_Elements]:
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
            yield _Elements(patch, start, vertices)
            start += len(patch)
    if not start:
        raise ElvisError(f"expected elements of the domain with finite values of {name}, found none")


class _VertexFits:
    """The polynomials q_v around the vertices of a mesh.

    coefficients    (v, k) of products of Legendre polynomials
    centres, sizes  (v, d) of the boxes on which these are orthogonal: half the lengths of the sides
    """

    def __init__(self, dataset: Dataset, elements: list[_Elements], is_continuous: bool) -> None:
        self._elements, self._is_continuous = elements, is_continuous
        dimension, count = dataset.mesh.dimension, len(dataset.mesh.vertices)
        self._degrees = _degrees(dimension, max(max(own.field[0].modes) for own in elements))
        self.coefficients = np.zeros((count, self.size))
        self.centres, self.sizes = np.zeros((count, dimension)), np.ones((count, dimension))

        corners = [own.positions(slice(None), own.patch.shape.vertices) for own in elements]
        self._low = np.concatenate([own.min(axis=1) for own in corners])
        self._high = np.concatenate([own.max(axis=1) for own in corners])
        self._fit(self._around(count))

    @property
    def size(self) -> int:
        """Number of coefficients of a polynomial."""
        return len(self._degrees)

    def enriched(self, own: _Elements, rows: Ints) -> Floats:
        """(n, m) coefficients of u* on some elements of a patch."""
        expansion, coefficients = own.field
        target = raised(expansion)
        operator, restriction = best(target, EXTRA), self._restriction(own)
        found = self._at(own, rows, operator.points)

        # R of functions in the space of u*
        restricted = values(target, restriction.points).T @ restriction.matrix
        modes = found @ (operator.matrix @ restricted @ restriction.compared)
        misfits = ((modes - coefficients[rows] @ restriction.compared) ** 2).sum(axis=2)
        hats = vertex_functions(own.patch.shape, operator.points)
        blended = np.einsum("qv,vnq->nq", hats, _trusted(found, misfits)) @ operator.matrix

        # u + b - R b, with u and R b in the space of u*
        lacking = coefficients[rows] - blended @ restricted
        return np.asarray(blended + evaluate(expansion, lacking, operator.points) @ operator.matrix)

    def _at(self, own: _Elements, rows: Ints, points: Floats) -> Floats:
        """(v, n, q) values of the polynomials of the vertices of some elements, at reference points (q, d)."""
        places = own.positions(rows, points)
        found = np.empty((own.vertices.shape[1], *places.shape[:2]))
        for corner, vertices in enumerate(own.vertices[rows].T):
            table = self._table(vertices, places)
            found[corner] = np.einsum("knq,nk->nq", table, self.coefficients[vertices])
        return found

    def _table(self, vertices: Ints, places: Floats) -> Floats:
        """(k, n, q) products of Legendre polynomials of vertices (n,) at positions (n, q, d)."""
        local = (places - self.centres[vertices, None]) / self.sizes[vertices, None]
        lines = [
            jacobi(int(self._degrees.max(initial=0)), 0, 0, axis.reshape(-1)) for axis in np.moveaxis(local, -1, 0)
        ]
        table = lines[0][self._degrees[:, 0]]
        for line, degrees in zip(lines[1:], self._degrees.T[1:], strict=True):
            table *= line[degrees]
        return table.reshape(self.size, *local.shape[:2])

    def _around(self, count: int) -> sparse.csr_matrix:
        """(v, e) 1 for the elements that share a vertex."""
        ends = np.concatenate([own.vertices.reshape(-1) for own in self._elements])
        numbers = [np.repeat(own.start + np.arange(len(own)), own.vertices.shape[1]) for own in self._elements]
        ones = np.ones(len(ends))
        return sparse.csr_matrix((ones, (ends, np.concatenate(numbers))), (count, len(self._low)))

    def _fit(self, around: sparse.csr_matrix) -> None:
        """Fit all polynomials; vertices with too few elements, as on boundaries, take that of the nearest other one."""
        vertices = np.flatnonzero(np.diff(around.indptr))
        is_open = [self._fitted(vertices[part], around[vertices[part]]) for part in chunks(len(vertices), _TOGETHER)]
        is_known = np.zeros(around.shape[0], bool)
        is_known[vertices] = ~np.concatenate(is_open)
        neighbours = (around @ around.T).tocsr()
        places = self.centres.copy()
        waiting = np.flatnonzero(~is_known)
        while len(waiting):
            waiting = self._take_nearest(waiting, neighbours, is_known, places)

    def _take_nearest(self, waiting: Ints, neighbours: sparse.csr_matrix, is_known: Bools, places: Floats) -> Ints:
        """Give vertices the polynomial of their nearest neighbour that has one; return those that may have one next."""
        near = neighbours[waiting]
        owner, other = np.repeat(np.arange(len(waiting)), np.diff(near.indptr)), near.indices
        owner, other = owner[is_known[other]], other[is_known[other]]
        distance = np.linalg.norm(places[other] - places[waiting[owner]], axis=1)
        order = np.lexsort([distance, owner])
        owners, first = np.unique(owner[order], return_index=True)
        taking, source = waiting[owners], other[order][first]
        for own in (self.coefficients, self.centres, self.sizes):
            own[taking] = own[source]
        is_known[taking] = True
        return np.setdiff1d(waiting, taking) if len(taking) else waiting[:0]

    def _fitted(self, vertices: Ints, near: sparse.csr_matrix) -> Bools:
        """(n,) whether elements ``near`` vertices leave polynomials undetermined; these get minimal coefficients."""
        starts = near.indptr[:-1]
        low = np.minimum.reduceat(self._low[near.indices], starts)
        high = np.maximum.reduceat(self._high[near.indices], starts)
        self.centres[vertices], self.sizes[vertices] = (low + high) / 2, (high - low) / 2
        owner = np.repeat(np.arange(len(vertices)), np.diff(near.indptr))
        sums = [np.zeros((len(vertices), size)) for size in (self.size**2, self.size**2, self.size)]
        for own in self._elements:
            held = np.flatnonzero((near.indices >= own.start) & (near.indices < own.start + len(own)))
            for pairs in self._batches(own, held):
                ones, numbers = np.ones(len(pairs)), np.arange(len(pairs))
                adding = sparse.csr_matrix((ones, (owner[pairs], numbers)), (len(vertices), len(pairs)))
                products = self._products(own, near.indices[pairs] - own.start, vertices[owner[pairs]])
                for total, some in zip(sums, products, strict=True):
                    total += adding @ some.reshape(len(pairs), -1)
        captured, lacking, right = sums
        square = (len(vertices), self.size, self.size)
        self.coefficients[vertices], is_open = _least_fits(captured.reshape(square), lacking.reshape(square), right)
        return is_open

    def _batches(self, own: _Elements, pairs: Ints) -> Iterator[Ints]:
        """Pairs (n,) of vertices and elements of a patch, some at a time."""
        step = max(1, _BATCH // (len(self._restriction(own).points) * self.size))
        return (pairs[part] for part in chunks(len(pairs), step))

    def _restriction(self, own: _Elements) -> Restriction:
        """The operator that makes the field on the elements of a patch."""
        return Restriction.of(own.field[0], self._is_continuous)

    def _products(self, own: _Elements, rows: Ints, vertices: Ints) -> tuple[Floats, Floats, Floats]:
        """Scalar products on elements, as sums of them make the fits.

        These are those of the modes of restricted polynomials of vertices (n, k, k), of what the modes lack of the
        polynomials (n, k, k), and of the modes and the field (n, k).
        """
        restriction, (expansion, coefficients) = self._restriction(own), own.field
        table = self._table(vertices, own.positions(rows, restriction.points))
        modes = table @ (restriction.matrix @ restriction.compared)
        points, weights = exact_rule(raised(expansion))
        functions = values(expansion, points) @ restriction.functions.T
        lacking = self._table(vertices, own.positions(rows, points)) - modes @ functions.T
        lacking *= np.sqrt(weights)
        right = np.einsum("knr,nr->nk", modes, coefficients[rows] @ restriction.compared)
        return _squares(modes), _squares(lacking), right


def _trusted(found: Floats, misfits: Floats) -> Floats:
    """(v, n, q) values of the polynomials of vertices, those that misfit an element replaced by the best one.

    A polynomial is fitted to all elements around a vertex.  If the field is rough on one, it misfits the others.  Each
    is mixed with the best one; its part is the quotient of their squared misfits, as in weighted essentially
    non-oscillatory schemes (Liu, Osher and Chan 1994).

    found    (v, n, q) values of the polynomials
    misfits  (v, n) squared norms of their differences to the field on the elements
    """
    best_ones = misfits.argmin(axis=0)
    least = misfits.min(axis=0)
    part = np.where(misfits > 0, least / np.where(misfits > 0, misfits, 1.0), 1.0)[..., None]
    fitting = np.take_along_axis(found, best_ones[None, :, None], axis=0)
    return np.asarray(part * found + (1 - part) * fitting)


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
