"""Continuous fields from discontinuous ones, and from their derivatives, by averages over the elements that meet.

Projection-based interpolation (`elvis.core.mapping.projections`) takes values at points of vertices, edges, faces and
the inside in turn.  If the elements that share a vertex, an edge or a face take the same values there, the result is
continuous.  They take the mean of theirs (Oswald 1993, On a BPX-preconditioner for P1 elements).

An element next to a layer or a corner is often many times more accurate than its neighbour there, and the plain mean
would give it half of the neighbour's error.  The weights are therefore 1/s, with s the norm of the highest modes of the
field on an element.  On smooth fields, all weights of a mean are nearly equal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.data.dataset import Block, Dataset, Expansion, Field
from elvis.core.mapping import tangents
from elvis.core.mapping.orientation import local_vertices
from elvis.core.mapping.patch import Patch, patches
from elvis.core.mapping.projections import conforming, points_on_entities
from elvis.core.polynomials.evaluation import evaluate, evaluate_with_gradients
from elvis.core.polynomials.interpolation import modified
from elvis.core.resolution.modal_bases import modal_basis
from elvis.core.resolution.patch_fits import EXTRA
from elvis.core.resolution.shared_points import groups_of_points

#: norm of highest modes, relative to the largest in the mesh, below which differences are rounding
_SMALLEST = 1e-10


def averaged(dataset: Dataset, field: Field, name: str, axis: int | None = None) -> Field:
    """A field, or its derivative along an axis, made continuous, in Modified expansions of the highest order.

    It is continuous across sides that elements share as a whole.
    """
    own = Dataset(dataset.mesh, (*dataset.map_fields, field), metadata=dataset.metadata)
    held = [patch for patch in patches(own, [field.name]) if patch.fields[0] is not None and len(patch)]
    modes = max(max(block.expansion.modes) for block in field.blocks)
    outer = [_Outer.of(own, patch, modes, axis) for patch in held]
    means = _means(outer)
    blocks = []
    for own_means, part in zip(means, outer, strict=True):
        values = np.concatenate([own_means, part.inside], axis=1)
        coefficients = values @ conforming(part.target, EXTRA).matrix
        blocks.append(Block(part.target, part.patch.element_ids, frozen_floats(coefficients)))
    return Field(name, tuple(blocks))


@dataclass(frozen=True, eq=False)
class _Outer:
    """The values of a patch at the points of projection-based interpolation.

    target  expansion of the result
    values  (n, q) at points of vertices, edges and faces; for lines at the ends
    inside  (n, r) at the points inside
    places  (n, q, 3) positions of the outer points
    entity  (n, q, 4) vertices, ascending, of the entity that holds each; -1 where there are fewer
    sizes   (n,) norms of the highest modes of the field
    """

    patch: Patch
    target: Expansion
    values: Floats
    inside: Floats
    places: Floats
    entity: Ints
    sizes: Floats

    @staticmethod
    def of(dataset: Dataset, patch: Patch, modes: int, axis: int | None) -> _Outer:
        """The values of the first field, or of its derivative."""
        expansion, coefficients = patch.fields[0], patch.coefficients[0]
        assert expansion is not None
        assert coefficients is not None
        target = modified(patch.shape, (modes,) * patch.shape.dimension)
        places, values = _sampled(patch, conforming(target, EXTRA).points, axis)
        stages = [stage for stage in points_on_entities(target, EXTRA) if stage[0]]
        count = stages[-1][1].stop
        mesh = dataset.mesh
        vertices = local_vertices(mesh, patch.shape)[mesh.of(patch.shape).rows_of(patch.element_ids)]
        entity = np.full((len(patch), count, 4), -1)
        for local, part in stages:
            entity[:, part, : len(local)] = np.sort(vertices[:, list(local)], axis=1)[:, None]
        sizes = modal_basis(expansion).top_norms(coefficients)
        return _Outer(patch, target, values[:, :count], values[:, count:], places[:, :count], entity, sizes)


def _sampled(patch: Patch, points: Floats, axis: int | None) -> tuple[Floats, Floats]:
    """Positions (n, q, 3) of points of elements, and the values (n, q) of the field or its derivative there."""
    expansion, coefficients = patch.fields[0], patch.coefficients[0]
    assert expansion is not None
    assert coefficients is not None
    world, jacobians = evaluate_with_gradients(patch.geometry, patch.geometry_coefficients, points)
    world = np.swapaxes(world, 1, 2)
    if axis is None:
        return world, evaluate(expansion, coefficients, points)
    _, gradients = evaluate_with_gradients(expansion, coefficients, points)
    jacobians = np.swapaxes(jacobians, 1, 2)
    d = patch.shape.dimension
    duals = tangents.duals(jacobians.reshape(-1, 3, d))
    return world, (gradients.reshape(-1, d) * duals[:, axis]).sum(axis=1).reshape(gradients.shape[:2])


def _means(outer: Sequence[_Outer]) -> list[Floats]:
    """For each patch (n, q) means of the values over all elements that have the same point on the same entity."""
    largest = max((float(own.sizes.max(initial=0.0)) for own in outer), default=0.0)
    # weights of 1 where all fields are of lower order
    weights = [1 / np.maximum(own.sizes, _SMALLEST * largest or 1.0) for own in outer]
    values = np.concatenate([own.values.reshape(-1) for own in outer])
    places = np.concatenate([own.places.reshape(-1, 3) for own in outer])
    entity = np.concatenate([own.entity.reshape(-1, 4) for own in outer])
    lengths = [np.repeat(np.ptp(own.places, axis=1).max(axis=1), own.values.shape[1]) for own in outer]

    group = groups_of_points(places, entity, np.concatenate(lengths))
    weight = np.concatenate([np.repeat(found, own.values.shape[1]) for found, own in zip(weights, outer, strict=True)])
    found = (np.bincount(group, weight * values) / np.bincount(group, weight))[group]
    ends = np.cumsum([own.values.size for own in outer])[:-1]
    return [part.reshape(own.values.shape) for part, own in zip(np.split(found, ends), outer, strict=True)]
