"""Recovered fields: of one order more, with derivatives that are one order more accurate than those of the field.

Around each vertex v, a polynomial q_v in x, y, z of degree p + 2 is fitted to a field of order p on all elements that
share v.  The fit compares like with like: with R the operator that makes fields of functions (`Restriction`), R q_v is
compared with the field, not q_v.  The polynomials of an element's vertices are blended,

    b = sum over v of hat_v q_v,        hat_v multilinear, 1 at v and 0 at other vertices,

after those that misfit the element were replaced by the one that fits best (`_trusted`): next to layers and corners,
the elements on the other side of a vertex would spoil the fit.

and only the part of b that the order p lacks is added to the field u on the element:

    u* = u + b - R b.

If u = R f for a polynomial f of degree p + 1, then q_v = f and u* = f.  For smooth f, the derivatives of u* have the
order p + 1, those of u the order p.  Polynomials of degree p + 1 would do for that, but leave a larger error: with the
part of degree p + 2, they also fit what changes the derivatives of order p + 1 over the patch.

Zienkiewicz and Zhu 1992, The superconvergent patch recovery and a posteriori error estimates (patches of vertices);
Zhang and Naga 2005, A new finite element gradient recovery method: superconvergence property (polynomials of degree
p + 1 fitted to the field); Babuska and Melenk 1997, The partition of unity method (blending).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_floats
from elvis.core.data.dataset import Block, Dataset, Expansion, Field
from elvis.core.mapping.mode_entities import vertex_functions
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import patches
from elvis.core.mapping.projections import best
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.quantities.jumps import jumps
from elvis.core.resolution.patch_fits import BATCH, EXTRA, TOGETHER, FieldElements, PatchFits, field_elements
from elvis.core.resolution.stored_precision import DOUBLE, JUMPS, SINGLE, is_single

#: degrees of the polynomials beyond the order of the field
MORE = 2


def enriched(dataset: Dataset, name: str) -> Field:
    """The field u* of one order more than a field, in Modified expansions; it jumps between elements.

    Raises ElvisError without elements, with Fourier directions, and for surfaces and curves in space.
    """
    elements = list(field_elements(dataset, name))
    fits = _VertexFits(dataset, elements, is_continuous(dataset, name))
    blocks = []
    for own in elements:
        target = raised(own.field[0])
        step = max(1, BATCH // (len(best(target, EXTRA).points) * fits.size))
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
    return bool(np.nanmax(jump, initial=0.0) <= JUMPS * rounding * size)


class _VertexFits(PatchFits):
    """The polynomials q_v around the vertices of a mesh."""

    def __init__(self, dataset: Dataset, elements: Sequence[FieldElements], is_continuous: bool) -> None:
        order = max(max(own.field[0].modes) for own in elements) - 1
        super().__init__(elements, len(dataset.mesh.vertices), order + MORE, is_continuous, is_complete=False)
        self._fit_all(self._around())

    def enriched(self, own: FieldElements, rows: Ints) -> Floats:
        """(n, m) coefficients of u* on some elements of a patch."""
        expansion, coefficients = own.field
        target = raised(expansion)
        operator, restriction = best(target, EXTRA), self.restriction(own)
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

    def _at(self, own: FieldElements, rows: Ints, points: Floats) -> Floats:
        """(v, n, q) values of the polynomials of the vertices of some elements, at reference points (q, d)."""
        places = own.positions(rows, points)
        found = np.empty((own.vertices.shape[1], *places.shape[:2]))
        for corner, vertices in enumerate(own.vertices[rows].T):
            found[corner] = self.values(vertices, places)
        return found

    def _around(self) -> sparse.csr_matrix:
        """(v, e) 1 for the elements that share a vertex."""
        ends = np.concatenate([own.vertices.reshape(-1) for own in self.elements])
        numbers = [np.repeat(own.start + np.arange(len(own)), own.vertices.shape[1]) for own in self.elements]
        ones = np.ones(len(ends))
        shape = (len(self.coefficients), sum(map(len, self.elements)))
        return sparse.csr_matrix((ones, (ends, np.concatenate(numbers))), shape)

    def _fit_all(self, around: sparse.csr_matrix) -> None:
        """Fit all polynomials; vertices with too few elements, as on boundaries, take that of the nearest other one."""
        vertices = np.flatnonzero(np.diff(around.indptr))
        is_open = [self.fit(vertices[part], around[vertices[part]]) for part in chunks(len(vertices), TOGETHER)]
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
