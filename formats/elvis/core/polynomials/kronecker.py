"""Matrices between lattices, such as nodes, points and modes of a hexahedron, applied one direction after another.

A Kronecker product of matrices of p numbers a direction takes 2 d p^(d + 1) operations a row instead of 2 p^(2 d): sum
factorization (Orszag 1980, Spectral methods for problems in complex geometries).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.mapping.orientation import even_chunks
from elvis.core.polynomials.row_products import row_products

#: digits after the point in which coordinates of a lattice agree
_DIGITS = 9
#: largest deviation of a matrix from the product of its factors, relative to its largest number: from rounding
_ROUNDING = 1e-13
#: numbers of a matrix from which on factors pay
_LEAST = 1 << 15
#: numbers of rows that are multiplied together, so that they stay in a processor's cache
_AT_ONCE = 1 << 17


@dataclass(frozen=True, eq=False)
class Lattice:
    """Points that are the product of a line of points in each direction.

    order  (n,) the points, those along the first direction next to each other
    lines  (n_i,) coordinates of the line of each direction, ascending
    """

    order: Ints
    lines: tuple[Floats, ...]

    @property
    def sizes(self) -> tuple[int, ...]:
        """Points of the line of each direction."""
        return tuple(map(len, self.lines))

    @staticmethod
    def of(points: Floats | Ints) -> Lattice | None:
        """The lattice that points (n, d) form; None if they form none.

        >>> Lattice.of(np.array([[0, 0], [0, 1], [2, 0], [2, 1]])).order
        array([0, 2, 1, 3])
        """
        keys = np.round(points, _DIGITS) + 0.0
        lines = [np.unique(column) for column in keys.T]
        if prod(map(len, lines)) != len(keys):
            return None
        order = np.lexsort(keys.T)
        if not np.array_equal(keys[order], product_points(lines)):
            return None
        ordered = np.asarray(points, np.float64)[order]
        steps = np.cumprod([1, *map(len, lines)])[:-1]
        every = zip(ordered.T, steps, map(len, lines), strict=True)
        return Lattice(order, tuple(column[:: int(step)][:count] for column, step, count in every))


def product_points(lines: Sequence[Floats]) -> Floats:
    """(n, d) the product of a line of points (n_i,) in each direction, those along the first one next to each other."""
    return np.stack(np.meshgrid(*lines[::-1], indexing="ij")[::-1], axis=-1).reshape(-1, len(lines))


class RowMap:
    """Rows of numbers on some points times a matrix (k, n), by its factors if it is a Kronecker product.

    source, target  lattices of the k numbers of a row, and of the n numbers of a result; None where they form none
    factors         gives a matrix (k_i, n_i) for each direction, between lines of the lattices
    """

    def __init__(
        self,
        matrix: Floats,
        source: Lattice | None,
        target: Lattice | None,
        factors: Callable[[Lattice, Lattice], Sequence[Floats]],
    ) -> None:
        self.matrix, self._source, self._target, self._given = matrix, source, target, factors
        self._joined: dict[RowMap, RowMap] = {}

    def __call__(self, rows: Floats) -> Floats:
        """(..., n) the rows (..., k), each times the matrix; no result depends on the other rows."""
        if self.factors is None:
            return row_products(rows, self.matrix)
        assert self._source is not None
        assert self._target is not None
        flat = rows.reshape(-1, rows.shape[-1])
        result = np.empty((len(flat), self.matrix.shape[1]))
        largest = max(self.matrix.shape)
        for some in even_chunks(len(flat), max(1, _AT_ONCE // largest)):
            net = np.take(flat[some], self._source.order, axis=1)
            result[some, self._target.order] = along_directions(net, self.factors)
        return result.reshape(*rows.shape[:-1], -1)

    def then(self, other: RowMap) -> RowMap:
        """This map followed by another one, whose rows are on the points of these results, as one map."""
        if other not in self._joined:

            def products(source: Lattice, target: Lattice) -> Sequence[Floats]:
                if self.factors is None or other.factors is None:
                    return []
                return [first @ second for first, second in zip(self.factors, other.factors, strict=True)]

            self._joined[other] = RowMap(self.matrix @ other.matrix, self._source, other._target, products)
        return self._joined[other]

    @cached_property
    def factors(self) -> Sequence[Floats] | None:
        """(k_i, n_i) a matrix for each direction; None if their product isn't the matrix, or they don't pay."""
        if self._source is None or self._target is None or self.matrix.size < _LEAST:
            return None
        found = [np.ascontiguousarray(own) for own in self._given(self._source, self._target)]
        if [own.shape for own in found] != list(zip(self._source.sizes, self._target.sizes, strict=True)):
            return None
        ordered = self.matrix[self._source.order][:, self._target.order]
        product: Floats = np.ones((1, 1))
        for own in found:
            product = np.asarray(np.kron(own, product), np.float64)
        return found if np.abs(product - ordered).max() <= _ROUNDING * np.abs(ordered).max() else None


def lagrange_factors(source: Lattice, target: Lattice) -> list[Floats]:
    """For each direction (k_i, n_i) the Lagrange polynomials of nodes at points, both in the same coordinates."""
    return [_lagrange(nodes, points) for nodes, points in zip(source.lines, target.lines, strict=True)]


def _lagrange(nodes: Floats, points: Floats) -> Floats:
    """(k, n) at points (n,) the products of (x - x_j) / (x_i - x_j) over the other nodes j, for each node i (k,)."""
    others = ~np.eye(len(nodes), dtype=bool)
    ratios = points[:, None, None] - nodes
    ratios = ratios / np.where(others, nodes[:, None] - nodes, 1.0)
    return np.asarray(np.prod(ratios, axis=2, where=others).T)


def along_directions(rows: Floats, factors: Sequence[Floats]) -> Floats:
    """(r, n) rows (r, k) times a Kronecker product, on lattices whose first direction is the fastest.

    factors  (k_i, n_i) of each direction

    Products have the same size for each row, so that no result depends on how many others there are.
    """
    first, *others = factors
    count, left = len(rows), rows.shape[1] // len(first)
    net = np.matmul(rows.reshape(count, left, len(first)), first)
    done = first.shape[1]
    for factor in others:
        left //= len(factor)
        net = np.matmul(factor.T, net.reshape(count * left, len(factor), done))
        done *= factor.shape[1]
    return np.asarray(net.reshape(count, done))
