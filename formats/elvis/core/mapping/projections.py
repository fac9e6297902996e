"""Projections as matrices: from samples at fixed reference points to the coefficients of an expansion.

`best` is the best approximation in the mean on a single element.  `conforming` goes from the vertices to the edges,
the faces and the inside, each with the best approximation of the remainder: its result on a face depends only on the
samples on that face, so elements that agree there get the same trace.  Both reproduce the functions of the expansion.
Projection-based interpolation: Demkowicz, Computing with hp-adaptive finite elements, 2006, chapter 3.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Expansion
from elvis.core.mapping.mode_entities import entities
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.cubature import COLLAPSE
from elvis.core.polynomials.expansion import mode_count, mode_indices, values
from elvis.core.polynomials.kronecker import Lattice, RowMap
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import TENSOR, Shape

#: local vertices of an entity, points and weights there, and its modes
_Stage = tuple[tuple[int, ...], Floats, Floats, Ints]

#: shapes that are products, with the directions of each factor
_FACTORS: Mapping[Shape, tuple[tuple[Shape, tuple[int, ...]], ...]] = {
    Shape.QUADRILATERAL: ((Shape.SEGMENT, (0,)), (Shape.SEGMENT, (1,))),
    Shape.PRISM: ((Shape.TRIANGLE, (0, 2)), (Shape.SEGMENT, (1,))),
    Shape.HEXAHEDRON: ((Shape.SEGMENT, (0,)), (Shape.SEGMENT, (1,)), (Shape.SEGMENT, (2,))),
}

#: a fit that loses more digits than this is rejected
_WORST_CONDITION = 1e9

#: numbers in a matrix beyond which an order is absurd
_LARGEST = 1 << 27


@dataclass(frozen=True, eq=False)
class Operator:
    """Samples (…, n) at ``points`` (n, d) times ``matrix`` (n, m) are coefficients (…, m).

    condition  of the worst fit in it
    indices    (m, d) of the modes, see `mode_indices`
    lines      gives the operator of the expansion of each direction, if the shape is a product of lines
    """

    points: Floats
    matrix: Floats
    condition: float
    indices: Ints
    lines: Callable[[], Sequence[Operator]] = tuple

    @cached_property
    def fit(self) -> RowMap:
        """The same as a function of samples, a direction at a time on quadrilaterals and hexahedra."""
        return RowMap(self.matrix, Lattice.of(self.points), Lattice.of(self.indices), self._factors)

    def _factors(self, points: Lattice, modes: Lattice) -> list[Floats]:
        """(n_i, m_i) the matrix of each direction, points and modes ascending."""
        return [line.matrix[line.points[:, 0].argsort()][:, line.indices[:, 0].argsort()] for line in self.lines()]


def rule(shape: Shape, count: int) -> tuple[Floats, Floats]:
    """Points xi (n, d) and weights (n,) of the Gauss rule of ``count`` points each way, the collapse in the weights."""
    lines = [gauss(count, power, 0) for power in COLLAPSE[shape]]
    axes = np.meshgrid(*(nodes for nodes, _ in lines), indexing="ij")
    weights = np.ones(1)
    for _, line in lines:
        weights = np.multiply.outer(weights, line).reshape(-1)
    return uncollapse(shape, np.stack([axis.reshape(-1) for axis in axes], axis=1)), weights


@bounded_cache
def best(expansion: Expansion, extra: int = 0) -> Operator:
    """The best approximation in the mean on the reference element.

    extra  points in each direction beyond the number that makes it exact on the expansion itself
    """
    shape, modes = expansion.shape, max(expansion.modes)
    more = modes - 1 if shape is Shape.PYRAMID else 0
    count = modes + more // 2 + extra
    _check_size(expansion, count**shape.dimension)
    points, weights = rule(shape, count)
    if shape in _FACTORS:
        matrix, condition = _product(expansion, count)
    else:
        matrix, condition = _fit(values(expansion, points), weights, expansion)
    lines = partial(_lines, best, expansion, extra)
    return Operator(frozen_floats(points), frozen_floats(matrix.T), condition, mode_indices(expansion), lines)


def _product(expansion: Expansion, count: int, inside: bool = False) -> tuple[Floats, float]:
    """The fit (m, n) on a shape that is a product of others, from their fits; only of inside modes on request.

    The best approximation by products of functions is the product of the best approximations.
    """
    shape, index = expansion.shape, mode_indices(expansion)
    if inside:
        index = index[entities(shape, max(expansion.modes)).inside]
    matrix, worst = np.ones((len(index), 1)), 1.0
    for factor, directions in _FACTORS[shape]:
        fit, numbers, condition = _factor_fit(expansion, factor, directions, count, inside)
        rows = fit[numbers[tuple(index[:, directions].T)]]
        matrix = (matrix[:, :, None] * rows[:, None, :]).reshape(len(index), -1)
        worst *= condition

    # points of the rule count the first direction slowest
    axes = [i for _, directions in _FACTORS[shape] for i in directions]
    grid = matrix.reshape(len(index), *(count,) * len(axes))
    places = 1 + np.array(axes)
    return np.moveaxis(grid, np.arange(1, 1 + len(axes)), places).reshape(len(index), -1), worst


def _factor_fit(
    expansion: Expansion, factor: Shape, directions: tuple[int, ...], count: int, inside: bool
) -> tuple[Floats, Ints, float]:
    """The fit (k, n) on a factor of a product, the row of each mode in it, and its condition."""
    modes = tuple(expansion.modes[i] for i in directions)
    own = Expansion(factor, tuple(expansion.bases[i] for i in directions), modes)
    points, weights = rule(factor, count)
    chosen = entities(factor, max(modes)).inside if inside else np.arange(mode_count(own))
    fit, condition = _fit(values(own, points)[:, chosen], weights, own)
    numbers = np.full(modes, -1)
    numbers[tuple(mode_indices(own)[chosen].T)] = np.arange(len(chosen))
    return fit, numbers, condition


@bounded_cache
def conforming(expansion: Expansion, extra: int = 0) -> Operator:
    """Best approximations on vertices, edges, faces and the inside in turn; for Modified expansions of equal orders."""
    stages = [stage for _, *stage in _conforming_stages(expansion, extra)]
    _check_size(expansion, sum(len(stage[0]) for stage in stages))
    operator = _stage_operator(expansion, stages, max(expansion.modes) + extra)
    return replace(operator, lines=partial(_lines, conforming, expansion, extra))


def _lines(kind: Callable[[Expansion, int], Operator], expansion: Expansion, extra: int) -> list[Operator]:
    """The operators of a kind of the directions of an expansion; none on shapes that aren't products of lines.

    Both kinds are products of these: the fit inside of a product of remainders is the product of fits to remainders.
    """
    if expansion.shape not in TENSOR:
        return []
    every = zip(expansion.bases, expansion.modes, strict=True)
    return [kind(Expansion(Shape.SEGMENT, (basis,), (modes,)), extra) for basis, modes in every]


def _conforming_stages(expansion: Expansion, extra: int) -> list[_Stage]:
    """The entities of an element in turn: local vertices, none inside; points and weights there, and its modes."""
    shape, modes = expansion.shape, max(expansion.modes)
    groups = entities(shape, modes)
    count = modes + extra
    stages: list[_Stage] = []
    for i in range(len(shape.vertices)):
        stages.append(((i,), shape.vertices[[i]], np.ones(1), groups.vertices[[i]]))
    stages += [(ends, *_on(shape, ends, count), own) for ends, own in zip(shape.edges, groups.edges, strict=False)]
    stages += [(local, *_on(shape, local, count), own) for local, own in zip(shape.faces, groups.faces, strict=False)]
    more = modes // 2 if shape is Shape.PYRAMID else 0
    stages.append(((), *rule(shape, count + more), groups.inside))
    return [stage for stage in stages if len(stage[3])]


def points_on_entities(expansion: Expansion, extra: int = 0) -> list[tuple[tuple[int, ...], slice]]:
    """Local vertices of each entity, none for the inside, and its points among those of `conforming`."""
    found: list[tuple[tuple[int, ...], slice]] = []
    start = 0
    for local, points, _, _ in _conforming_stages(expansion, extra):
        found.append((local, slice(start, start + len(points))))
        start += len(points)
    return found


def _stage_operator(expansion: Expansion, stages: Sequence[Sequence[Any]], count: int) -> Operator:
    """The operator that fits the modes of each stage, at its points and weights, to what earlier ones leave.

    count  points each way of the rule inside
    """
    total = sum(len(points) for points, _, _ in stages)
    matrix = np.zeros((mode_count(expansion), total))
    worst, start = 1.0, 0
    known = np.empty(0, np.int64)
    inside = entities(expansion.shape, max(expansion.modes)).inside
    for points, weights, own in stages:
        table = values(expansion, points)
        if own is inside and expansion.shape in _FACTORS:
            fit, condition = _product(expansion, count, inside=True)
        else:
            fit, condition = _fit(table[:, own], weights, expansion)
        here = np.arange(start, start + len(points))
        matrix[own] = -(fit @ table[:, known]) @ matrix[known]
        matrix[np.ix_(own, here)] += fit
        known, start, worst = np.concatenate([known, own]), start + len(points), max(worst, condition)
    points = frozen_floats(np.concatenate([points for points, _, _ in stages]))
    return Operator(points, frozen_floats(matrix.T), worst, mode_indices(expansion))


def _on(shape: Shape, local: tuple[int, ...], count: int) -> tuple[Floats, Floats]:
    """Gauss points and weights on an edge or face given by its local vertices."""
    corners = shape.vertices[list(local)]
    kind = {2: Shape.SEGMENT, 3: Shape.TRIANGLE, 4: Shape.QUADRILATERAL}[len(local)]
    points, weights = rule(kind, count)
    t = (1 + points) / 2
    axes = corners[[1, 3]] if kind is Shape.QUADRILATERAL else corners[1:]
    return corners[0] + t @ (axes - corners[0]), weights


def _fit(table: Floats, weights: Floats, expansion: Expansion) -> tuple[Floats, float]:
    """(m, n) matrix of the weighted least-squares fit of modes with values ``table`` (n, m), and its condition."""
    roots = np.sqrt(weights)[:, None]
    weighted = table * roots
    scales = np.sqrt((weighted**2).sum(axis=0))
    q, r = np.linalg.qr(weighted / scales)
    condition = _condition(r)
    if not condition < _WORST_CONDITION:
        order = max(expansion.modes) - 1
        raise ElvisError(
            f"expected an order that 64 bits can resolve on a {expansion.shape.label.lower()}, found {order}"
        )
    return np.linalg.solve(r, q.T) / scales[:, None] * roots.T, condition


def _condition(r: Floats) -> float:
    """Condition number, in the 1-norm, of a triangular matrix."""
    if not r.size or not np.abs(np.diag(r)).min() > 0:
        return np.inf if r.size else 1.0
    return float(np.abs(r).sum(axis=0).max() * np.abs(np.linalg.inv(r)).sum(axis=0).max())


def _check_size(expansion: Expansion, points: int) -> None:
    if points * mode_count(expansion) > _LARGEST:
        order = max(expansion.modes) - 1
        raise ElvisError(f"expected an order that fits in memory on a {expansion.shape.label.lower()}, found {order}")
