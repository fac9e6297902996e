"""Reference points in elements, and what a patch has there; results shared by several expressions are computed once."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Floats, Ints, every_pair
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Expansion
from elvis.core.mapping import pointwise, tangents
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.curvature import hessians_at
from elvis.core.polynomials.evaluation import evaluate, evaluate_with_gradients, has_small_table
from elvis.core.polynomials.expansion import dimension, values, values_and_gradients


class ElementPoints:
    """Points in elements of a patch, an element for each.

    rows    (n,)    rows of the patch
    points  (n, D)  reference coordinates, as in `pointwise`
    normals (n, 3)  of a surface that they are on, None for sides of elements
    """

    def __init__(self, patch: Patch, rows: Ints, points: Floats, normals: Floats | None = None) -> None:
        self.patch, self.rows, self.points, self.normals = patch, rows, points, normals
        self._known: dict[Hashable, Floats] = {}

    def __len__(self) -> int:
        return len(self.rows)

    @cached_property
    def positions(self) -> Floats:
        """(n, 3) world coordinates."""
        return pointwise.positions(self.patch, self.rows, self.points)

    @cached_property
    def jacobians(self) -> Floats:
        """(n, 3, D) derivatives of the world coordinates in the reference coordinates."""
        return pointwise.jacobians(self.patch, self.rows, self.points)

    @cached_property
    def duals(self) -> Floats:
        """(n, 3, D) the world gradients of the reference coordinates, not finite where the Jacobian is singular."""
        return tangents.duals(self.jacobians)

    def in_patch(self, patch: Patch) -> ElementPoints:
        """The same points in a patch of the same elements with other fields; both share the derivatives of the map."""
        found = ElementPoints(patch, self.rows, self.points, self.normals)
        found.jacobians, found.duals = self.jacobians, self.duals
        return found

    def derivative(self, field: int, order: int) -> Floats:
        """(n,), (n, 3) or (n, 3, 3) a field's values, first or second derivatives; NaN if the patch lacks it."""
        return self._once((field, order), lambda: self._derivative(field, order))

    def _once(self, key: Hashable, make: Callable[[], Floats]) -> Floats:
        """The cached value for a key, computed at the first request.

        `functools.cache` of a method would keep these points in a reference cycle, and with them the coefficients of
        the patch until Python collects cycles.
        """
        if key not in self._known:
            self._known[key] = make()
        return self._known[key]

    def _derivative(self, field: int, order: int) -> Floats:
        if self.patch.fields[field] is None:
            return np.full((len(self), *(3,) * order), np.nan)
        return (self._values, self._gradients, self._hessians)[order](field)

    def _values(self, field: int) -> Floats:
        expansion, coefficients = self._own(field)
        if not has_small_table(expansion, self.points):
            return pointwise.values(self.patch, field, self.rows, self.points)
        return np.asarray(np.einsum("nm,nm->n", coefficients[self.rows], self._table(expansion)))

    def _gradients(self, field: int) -> Floats:
        own = self.reference_gradients(field)
        return np.asarray(np.einsum("nci,ni->nc", self.duals[:, :, : own.shape[1]], own))

    def reference_gradients(self, field: int) -> Floats:
        """(n, d) derivatives of a field that the patch has in the reference coordinates that it depends on."""
        expansion, coefficients = self._own(field)
        if has_small_table(expansion, self.points):
            return np.asarray(np.einsum("nm,ndm->nd", coefficients[self.rows], self._sloped_table(expansion)))
        return pointwise.reference_gradients(self.patch, field, self.rows, self.points)

    def _own(self, field: int) -> tuple[Expansion, Floats]:
        """The expansion and the coefficients (e, m) of a field that the patch has."""
        expansion, coefficients = self.patch.fields[field], self.patch.coefficients[field]
        assert expansion is not None
        assert coefficients is not None
        return expansion, coefficients

    def _table(self, expansion: Expansion) -> Floats:
        """(n, m) values of modes, which fields share."""
        points = self.points[:, : dimension(expansion)]
        return self._once(("values", expansion), lambda: values(expansion, points))

    def _sloped_table(self, expansion: Expansion) -> Floats:
        """(n, d, m) their reference gradients."""
        points = self.points[:, : dimension(expansion)]
        return self._once(("gradients", expansion), lambda: values_and_gradients(expansion, points)[1])

    def _hessians(self, field: int) -> Floats:
        """(n, 3, 3) in world coordinates; not finite if the Jacobian is singular.

        Solves u_xixi = J^T H J + sum_c g_c x_c,xixi for H, with u(x(xi)), the gradient g and the Jacobian J.
        """
        patch = self.patch
        expansion, coefficients = self._own(field)
        if patch.homogeneous or not patch.is_flat:
            raise ElvisError("expected second derivatives of 2D fields in the plane or of 3D fields, found others")
        bent = hessians_at(expansion, coefficients, self.rows, self.points)
        inverse = self.duals[:, :, : patch.shape.dimension]
        with np.errstate(invalid="ignore"):
            bent = bent - np.einsum("nc,ncij->nij", self.derivative(field, 1), self._bends)
            return np.asarray(np.einsum("nai,nij,nbj->nab", inverse, bent, inverse))

    @cached_property
    def _bends(self) -> Floats:
        """(n, 3, d, d) second derivatives of the map."""
        return hessians_at(self.patch.geometry, self.patch.geometry_coefficients, self.rows, self.points)


class Lattice(ElementPoints):
    """The points (q, D) repeated in each of some elements (e,), one after the other: they share tables of modes."""

    def __init__(self, patch: Patch, elements: Ints, lattice: Floats) -> None:
        super().__init__(patch, *every_pair(elements, lattice))
        self._elements, self._lattice = elements, lattice

    @cached_property
    def positions(self) -> Floats:
        """As in `ElementPoints`."""
        patch, own = self.patch, self.patch.shape.dimension
        positions = np.ascontiguousarray(self._map[0].reshape(3, -1).T)
        for i, (axis, length) in enumerate(patch.periods):
            positions[:, axis] = length * (1 + self.points[:, own + i]) / 2
        return positions

    @cached_property
    def jacobians(self) -> Floats:
        """As in `ElementPoints`."""
        patch, own = self.patch, self.patch.shape.dimension
        slopes = np.moveaxis(self._map[1], -1, 0).reshape(own, 3, len(self))
        if not patch.periods:
            return slopes.transpose(2, 1, 0)
        jacobians = np.zeros((patch.dimension, 3, len(self)))
        jacobians[:own] = slopes
        for i, (axis, length) in enumerate(patch.periods):
            jacobians[own + i, axis] = length / 2
        return jacobians.transpose(2, 1, 0)

    @cached_property
    def _map(self) -> tuple[Floats, Floats]:
        """(3, e, q) positions and (3, e, q, d) reference gradients of the map of the shape.

        Determinants and gradients combine whole columns of Jacobians, which are blocks of memory in this order.
        """
        patch, own = self.patch, self.patch.shape.dimension
        coefficients = patch.geometry_coefficients[self._elements].swapaxes(0, 1)
        return evaluate_with_gradients(patch.geometry, coefficients, self._lattice[:, :own])

    def _values(self, field: int) -> Floats:
        expansion, coefficients = self._own(field)
        points = self._lattice[:, : dimension(expansion)]
        return evaluate(expansion, coefficients[self._elements], points).reshape(-1)

    def reference_gradients(self, field: int) -> Floats:
        """As in `ElementPoints`."""
        expansion, coefficients = self._own(field)
        points = self._lattice[:, : dimension(expansion)]
        own = evaluate_with_gradients(expansion, coefficients[self._elements], points)[1]
        return own.reshape(len(self), points.shape[1])
