"""Continuous piecewise polynomials on a whole mesh, and the L2 projection onto them (FieldConvert's C0Projection).

An element's functions are given by their values at nodes of vertices, edges and faces, which elements that meet there
share, and by coordinates among the functions that vanish on its boundary.  A boundary function has the smallest L2 norm
on the reference element among all functions with its boundary values.  On affine elements it is orthogonal to the
inner ones, so conjugate gradients scaled by the diagonal take few steps (static condensation: Karniadakis and Sherwin,
Spectral/hp Element Methods for CFD, section 4.2.3).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from scipy.linalg import solve_triangular
from scipy.sparse.linalg import LinearOperator, cg

from elvis.core.base.arrays import Floats, Ints, frozen_floats, joined_columns
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Block, Dataset, Expansion, Field
from elvis.core.mapping.mode_entities import entities
from elvis.core.mapping.orientation import chunks, local_vertices
from elvis.core.mapping.patch import Patch, patches
from elvis.core.mapping.projections import rule
from elvis.core.polynomials.cubature import COLLAPSE
from elvis.core.polynomials.evaluation import evaluate, evaluate_with_gradients
from elvis.core.polynomials.expansion import mode_count, values, values_and_gradients
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.quadrature import lobatto
from elvis.core.quantities.jumps import jumps
from elvis.core.resolution.shared_points import groups_of_points

#: numbers in a table of values at points of elements
_BATCH = 1 << 21
#: residual, relative to the right-hand side, at which conjugate gradients end
_RESIDUAL = 1e-14
#: residual relative to the true one, in a second round
_OF_TRUE = 0.01
#: steps after which conjugate gradients are given up
_MAX_STEPS = 2000
#: jump, relative to the largest coefficient, that rounding of maps and coefficients explains
_JUMP = 1e-6


def continuous_projection(
    dataset: Dataset, field: Field, name: str, length: float = 0.0
) -> tuple[ContinuousSpace, Field]:
    """The best approximation in L2 of a field by a continuous one, in Modified expansions of its highest order.

    Its integral equals that of the field, and a continuous field of one order is its own projection.

    length  of smoothing: waves of the length l become smaller by 1/(1 + (length/l)^2); see `ContinuousSpace.projected`

    Returns the space and the field.  Raises ElvisError with Fourier directions, for values that are not finite, and on
    non-conforming meshes.
    """
    own = Dataset(dataset.mesh, (*dataset.map_fields, field), metadata=dataset.metadata)
    held = [patch for patch in patches(own, [field.name]) if patch.fields[0] is not None and len(patch)]
    space = ContinuousSpace.of(
        dataset, held, max(2, *(max(block.expansion.modes) for block in field.blocks)), field.name
    )
    found = space.field(name, space.projected(_own_values, length))
    _, remaining = jumps(replace(dataset, fields=(*dataset.map_fields, found)), name)
    largest = np.abs(np.concatenate([block.coefficients.reshape(-1) for block in found.blocks])).max()
    if np.nanmax(remaining, initial=0.0) > _JUMP * largest:
        raise ElvisError(
            f"{field.name}: expected elements that share whole sides to make it continuous, found a mesh on which "
            f"jumps of up to {np.nanmax(remaining):.3g} would remain"
        )
    return space, found


@dataclass(frozen=True, eq=False)
class _Nodes:
    """Nodes of the boundary of an element.

    points    (k, d) in reference coordinates
    vertices  local vertices of the entity of each
    modes     (k,) modes of the boundary; the functions of others vanish there
    """

    points: Floats
    vertices: tuple[tuple[int, ...], ...]
    modes: Ints


@dataclass(frozen=True, eq=False)
class Part:
    """The elements of a patch.

    target     expansion of the continuous field
    functions  (m, m) coefficients of each function of an element
    numbers    (n, m) of the unknowns of the functions of each element
    points     (q, d) of the quadrature
    weights    (n, q) of the quadrature in space
    """

    patch: Patch
    target: Expansion
    functions: Floats
    numbers: Ints
    points: Floats
    weights: Floats

    @cached_property
    def table(self) -> Floats:
        """(q, m) values of the functions at the points."""
        return values(self.target, self.points) @ self.functions

    @cached_property
    def slopes(self) -> Floats:
        """(q, m, d) gradients of the functions at the points, in reference coordinates."""
        _, modal = values_and_gradients(self.target, self.points)
        return np.asarray(np.einsum("qdc,cm->qmd", modal, self.functions))

    def metrics(self, rows: slice) -> Floats:
        """(n, q, d, d) products of gradients of reference coordinates, times the weights, on some elements."""
        if rows.start not in self._metrics:
            _, jacobians = evaluate_with_gradients(
                self.patch.geometry, self.patch.geometry_coefficients[rows], self.points
            )
            columns = np.swapaxes(jacobians, 1, 2)
            inverse = np.linalg.inv(np.swapaxes(columns, 2, 3) @ columns)
            self._metrics[rows.start] = inverse * self.weights[rows, :, None, None]
        return self._metrics[rows.start]

    @cached_property
    def _metrics(self) -> dict[int, Floats]:
        """Metrics of batches by their first row."""
        return {}

    @property
    def boundary(self) -> Floats:
        """(k, d) nodes of the boundary."""
        return _nodes(self.target).points

    @property
    def batches(self) -> Iterator[slice]:
        """Rows of elements that are processed together."""
        return chunks(len(self.patch), max(1, _BATCH // len(self.points)))


#: values (n, q) of a function in some elements of a part, at its points
Sampled: TypeAlias = Callable[[Part, slice], Floats]


class ContinuousSpace:
    """The continuous functions on the elements that have a field.

    size  number of unknowns
    """

    def __init__(self, parts: Sequence[Part], size: int) -> None:
        self.parts, self.size = tuple(parts), size

    @staticmethod
    def of(dataset: Dataset, held: Sequence[Patch], modes: int, name: str) -> ContinuousSpace:
        """The space on some patches, with ``modes`` modes in each direction; messages name the field."""
        _check(held, name)
        targets = [modified(patch.shape, (modes,) * patch.shape.dimension) for patch in held]
        numbers, size = _numbers(dataset, held, targets)
        return ContinuousSpace(list(map(_part, held, targets, numbers)), size)

    def projected(self, sampled: Sampled, length: float = 0.0) -> Floats:
        """(size,) unknowns of the L2 projection of a function: conjugate gradients, scaled by the diagonal.

        With a length L the solution v of v - (L/2pi)^2 laplacian v = u, without flux through the boundary: a Helmholtz
        filter, whose integral is that of u (FieldConvert's helmsmoothing).
        """
        diagonal, right = np.zeros(self.size), np.zeros(self.size)
        factor = (length / (2 * np.pi)) ** 2
        for part in self.parts:
            table = part.table
            for rows in part.batches:
                weighted = part.weights[rows] * sampled(part, rows)
                right += self.scattered(part.numbers[rows], weighted @ table)
                diagonal += self.scattered(part.numbers[rows], part.weights[rows] @ table**2)
                if factor:
                    own = np.einsum("nqij,qmi,qmj->nm", part.metrics(rows), part.slopes, part.slopes, optimize=True)
                    diagonal += factor * self.scattered(part.numbers[rows], own)
        root = np.sqrt(diagonal)

        def product(u: Floats) -> Floats:
            plain = u / root
            total = self._mass(plain)
            if factor:
                total = total + factor * self._stiffness(plain)
            return np.asarray(total / root)

        scaled = LinearOperator((self.size, self.size), matvec=product, dtype=np.float64)
        found = np.zeros(self.size)
        # the residual of the recurrence drifts from the true one, from which the second round starts
        for residual in (_RESIDUAL, _OF_TRUE):
            step, failure = cg(scaled, right / root - product(found), rtol=residual, atol=0.0, maxiter=_MAX_STEPS)
            if failure:
                raise ElvisError(f"the continuous projection did not converge in {_MAX_STEPS} steps")
            found += step
        return np.asarray(found / root)

    def field(self, name: str, unknowns: Floats) -> Field:
        """The field of given unknowns (size,)."""
        blocks = []
        for part in self.parts:
            coefficients = unknowns[part.numbers] @ part.functions.T
            blocks.append(Block(part.target, part.patch.element_ids, frozen_floats(coefficients)))
        return Field(name, tuple(blocks), True)

    def one(self) -> Floats:
        """(size,) unknowns of the function that is 1 everywhere."""
        found = np.zeros(self.size)
        for part in self.parts:
            # the functions of vertices of a Modified expansion add up to 1
            coefficients = np.zeros(len(part.functions))
            coefficients[entities(part.target.shape, max(part.target.modes)).vertices] = 1.0
            found[part.numbers] = np.linalg.solve(part.functions, coefficients)
        return found

    def means(self, unknowns: Floats, owner: Ints) -> Floats:
        """(size,) for each unknown the mean of a function over the part of the mesh (size,) that owns it."""
        count = int(owner.max()) + 1
        total, measure = np.zeros(count), np.zeros(count)
        for part in self.parts:
            of_element = owner[part.numbers[:, 0]]
            integrals = np.einsum("nq,nq->n", part.weights, unknowns[part.numbers] @ part.table.T)
            total += np.bincount(of_element, integrals, count)
            measure += np.bincount(of_element, part.weights.sum(axis=1), count)
        return np.asarray((total / measure)[owner])

    def _mass(self, unknowns: Floats) -> Floats:
        """The mass matrix times a vector (size,)."""
        total = np.zeros(self.size)
        for part in self.parts:
            table = part.table
            for rows in part.batches:
                at_points = unknowns[part.numbers[rows]] @ table.T
                total += self.scattered(part.numbers[rows], (part.weights[rows] * at_points) @ table)
        return total

    def _stiffness(self, unknowns: Floats) -> Floats:
        """The matrix of products of gradients times a vector (size,)."""
        total = np.zeros(self.size)
        for part in self.parts:
            slopes = part.slopes
            for rows in part.batches:
                gradients = np.einsum("qmi,nm->nqi", slopes, unknowns[part.numbers[rows]], optimize=True)
                fluxes = np.einsum("nqij,nqj->nqi", part.metrics(rows), gradients)
                total += self.scattered(part.numbers[rows], np.einsum("nqi,qmi->nm", fluxes, slopes, optimize=True))
        return total

    def scattered(self, numbers: Ints, added: Floats) -> Floats:
        """(size,) sums over elements of what each adds (n, m) to its unknowns."""
        return np.bincount(numbers.reshape(-1), added.reshape(-1), self.size)


def _own_values(part: Part, rows: slice) -> Floats:
    """The values of the first field."""
    expansion, coefficients = part.patch.fields[0], part.patch.coefficients[0]
    assert expansion is not None
    assert coefficients is not None
    return evaluate(expansion, coefficients[rows], part.points)


def _check(held: Sequence[Patch], name: str) -> None:
    """Raise ElvisError for fields that have no continuous projection."""
    if not held:
        raise ElvisError(f"expected elements of the domain with {name}, found none")
    if any(patch.homogeneous for patch in held):
        raise ElvisError(f"{name}: expected a field without Fourier directions to make it continuous")
    for patch in held:
        if not all(own is None or np.isfinite(own).all() for own in patch.coefficients):
            raise ElvisError(f"{name}: expected finite values to make it continuous, found others")


def _part(patch: Patch, target: Expansion, numbers: Ints) -> Part:
    """The functions of a patch's elements, and their quadrature."""
    count = max(target.modes) + max(patch.geometry.modes) - 1
    points, weights = rule(patch.shape, count)
    scale = 0.5 ** sum(COLLAPSE[patch.shape])
    in_space = np.concatenate(
        [_measures(patch, rows, points) for rows in chunks(len(patch), max(1, _BATCH // len(points)))]
    )
    return Part(patch, target, _functions(target), numbers, points, in_space * (scale * weights))


def _measures(patch: Patch, rows: slice, points: Floats) -> Floats:
    """(n, q) length, area or volume in space per unit of the reference element: sqrt(det(J^T J))."""
    coefficients = patch.geometry_coefficients[rows]
    _, jacobians = evaluate_with_gradients(patch.geometry, coefficients, points)
    columns = np.swapaxes(jacobians, 1, 2)
    return np.asarray(np.sqrt(np.abs(np.linalg.det(np.swapaxes(columns, 2, 3) @ columns))))


def _numbers(dataset: Dataset, held: Sequence[Patch], targets: Sequence[Expansion]) -> tuple[list[Ints], int]:
    """(n, m) of the unknowns of each patch's elements: those of nodes first, then inner ones; and their count."""
    parts = [_placed_nodes(dataset, patch, target) for patch, target in zip(held, targets, strict=True)]
    group = groups_of_points(*joined_columns(parts))
    start, size = 0, int(group.max()) + 1
    found = []
    for patch, target in zip(held, targets, strict=True):
        outer = len(_nodes(target).points)
        inner = mode_count(target) - outer
        shared = group[start : start + len(patch) * outer].reshape(len(patch), outer)
        inside = size + np.arange(len(patch) * inner).reshape(len(patch), inner)
        found.append(np.concatenate([shared, inside], axis=1))
        start, size = start + shared.size, size + inside.size
    return found, size


def _placed_nodes(dataset: Dataset, patch: Patch, target: Expansion) -> tuple[Floats, Ints, Floats]:
    """Positions (k, 3) of the nodes of all elements, vertices (k, 4) of their entities, and sizes (k,) of elements."""
    nodes, mesh = _nodes(target), dataset.mesh
    corners = local_vertices(mesh, patch.shape)[mesh.of(patch.shape).rows_of(patch.element_ids)]
    vertices = np.full((len(patch), len(nodes.points), 4), -1)
    for number, local in enumerate(nodes.vertices):
        vertices[:, number, : len(local)] = np.sort(corners[:, list(local)], axis=1)
    world = np.swapaxes(evaluate(patch.geometry, patch.geometry_coefficients, nodes.points), 1, 2)
    sizes = np.repeat(np.ptp(world, axis=1).max(axis=1), len(nodes.points))
    return world.reshape(-1, 3), vertices.reshape(-1, 4), sizes


@bounded_cache
def _functions(target: Expansion) -> Floats:
    """(m, m) coefficients of the functions of nodes, then of orthonormal functions that vanish on the boundary."""
    nodes = _nodes(target)
    inside = np.setdiff1d(np.arange(mode_count(target)), nodes.modes)
    points, weights = rule(target.shape, max(target.modes) + 1)
    table = values(target, points) * np.sqrt(weights)[:, None]
    found = np.zeros((mode_count(target),) * 2)

    # boundary values 1 at one node and 0 at others
    outer = np.linalg.inv(values(target, nodes.points)[:, nodes.modes])
    found[nodes.modes, : len(outer)] = outer
    if len(inside):
        # inner functions Q R^-1 are orthonormal; boundary functions become orthogonal to them
        q, r = np.linalg.qr(table[:, inside])
        inner = solve_triangular(r, np.eye(len(r)))
        found[inside, : len(outer)] = -inner @ (q.T @ (table[:, nodes.modes] @ outer))
        found[inside, len(outer) :] = inner
    return frozen_floats(found)


@bounded_cache
def _nodes(target: Expansion) -> _Nodes:
    """The nodes of the boundary: as many on each entity as it has modes, symmetric under permutations of vertices."""
    shape, modes = target.shape, max(target.modes)
    groups = entities(shape, modes)
    line = lobatto(modes)[0][1:-1]
    points = [shape.vertices]
    vertices: list[tuple[int, ...]] = [(i,) for i in range(len(shape.vertices))]
    numbers = [groups.vertices]
    for local, own in (*zip(shape.edges, groups.edges, strict=False), *zip(shape.faces, groups.faces, strict=False)):
        if len(own):
            inner = _inner_nodes(len(local), line)
            points.append(inner @ shape.vertices[list(local)])
            vertices += [tuple(local)] * len(inner)
            numbers.append(own)
    return _Nodes(frozen_floats(np.concatenate(points)), tuple(vertices), np.concatenate(numbers))


def _inner_nodes(corners: int, line: Floats) -> Floats:
    """(k, corners) weights of the corners of a line, triangle or quadrilateral in nodes inside of it.

    line  (n,) inner nodes of a line, symmetric about 0
    """
    t = (1 + line) / 2
    if corners == 2:
        return np.stack([1 - t, t], axis=1)
    if corners == 4:
        r, s = (axis.reshape(-1) for axis in np.meshgrid(t, t))
        return np.stack([(1 - r) * (1 - s), r * (1 - s), r * s, (1 - r) * s], axis=1)

    # Blyth and Pozrikidis 2006, A Lobatto interpolation grid over the triangle
    n = len(line) + 1
    whole = np.concatenate([[0.0], t, [1.0]])
    i, j = (own.reshape(-1) for own in np.meshgrid(np.arange(1, n), np.arange(1, n)))
    i, j = i[i + j < n], j[i + j < n]
    indices = np.stack([n - i - j, i, j], axis=1)
    own = whole[indices]
    return np.asarray((1 + 3 * own - own.sum(axis=1, keepdims=True)) / 3)
