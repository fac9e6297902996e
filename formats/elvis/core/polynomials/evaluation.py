"""Fields and maps from coefficients: many elements at the same points, or an element for each point.

Points are taken in batches, so that the (n, m) tables of modes stay within a few megabytes for any n; a lattice of
points needs no such tables (`lattices`).  The result on an element doesn't depend on the other elements in the same
call.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import Expansion
from elvis.core.polynomials.expansion import dimension, is_factored, mode_count, values, values_and_gradients
from elvis.core.polynomials.lattices import lattice_lines, values_and_slopes_on_lattice, values_on_lattice
from elvis.core.polynomials.row_products import row_products
from elvis.core.polynomials.tensor_points import values_and_gradients_at_points, values_at_points

#: numbers in a table of modes
_BATCH = 1 << 18


def evaluate(expansion: Expansion, coefficients: Floats, points: Floats) -> Floats:
    """(e, ..., n) values of e elements with ``coefficients`` (e, ..., m), all at the same points xi (n, d)."""
    result = np.empty((*coefficients.shape[:-1], len(points)))
    lines = lattice_lines(expansion, points)
    if lines is not None:
        flat, found = coefficients.reshape(-1, coefficients.shape[-1]), result.reshape(-1, len(points))
        for batch in _batches(len(flat), len(points)):
            found[batch] = values_on_lattice(expansion, flat[batch], lines)
        return result
    for batch in _batches(len(points), mode_count(expansion)):
        result[..., batch] = row_products(coefficients, values(expansion, points[batch]).T)
    return result


def evaluate_with_gradients(expansion: Expansion, coefficients: Floats, points: Floats) -> tuple[Floats, Floats]:
    """Values (e, ..., n) and gradients in xi (e, ..., n, d) of e elements, all at the same points xi (n, d)."""
    shape = (*coefficients.shape[:-1], len(points))
    values = np.empty(shape)
    # in memory each derivative is one block: they are computed, and used, one after another
    slopes = np.empty((dimension(expansion), *shape))
    gradients = np.moveaxis(slopes, 0, -1)
    lines = lattice_lines(expansion, points)
    if lines is not None:
        flat, found = coefficients.reshape(-1, coefficients.shape[-1]), values.reshape(-1, len(points))
        every = slopes.reshape(len(slopes), *found.shape)
        for batch in _batches(len(flat), len(points)):
            found[batch], every[:, batch] = values_and_slopes_on_lattice(expansion, flat[batch], lines)
        return values, gradients
    for batch in _batches(len(points), mode_count(expansion)):
        modes, mode_gradients = values_and_gradients(expansion, points[batch])
        values[..., batch] = row_products(coefficients, modes.T)
        for i in range(gradients.shape[-1]):
            gradients[..., batch, i] = row_products(coefficients, mode_gradients[:, i].T)
    return values, gradients


def evaluate_at(expansion: Expansion, coefficients: Floats, rows: Ints, points: Floats) -> Floats:
    """(n, ...) values at the points xi (n, d), point i in element ``rows[i]`` of ``coefficients`` (e, ..., m)."""
    if is_factored(expansion):
        return values_at_points(expansion, coefficients, rows, points)
    result = np.empty((len(points), *coefficients.shape[1:-1]))
    for batch in _batches(len(points), _width(coefficients)):
        modes = values(expansion, points[batch])
        result[batch] = np.einsum("n...m,nm->n...", coefficients[rows[batch]], modes)
    return result


def evaluate_at_with_gradients(
    expansion: Expansion, coefficients: Floats, rows: Ints, points: Floats
) -> tuple[Floats, Floats]:
    """Values (n, ...) and gradients in xi (n, ..., d) at the points xi (n, d), point i in element ``rows[i]``."""
    if is_factored(expansion):
        return values_and_gradients_at_points(expansion, coefficients, rows, points)
    values = np.empty((len(points), *coefficients.shape[1:-1]))
    gradients = np.empty((*values.shape, dimension(expansion)))
    for batch in _batches(len(points), _width(coefficients)):
        modes, mode_gradients = values_and_gradients(expansion, points[batch])
        own = coefficients[rows[batch]]
        values[batch] = np.einsum("n...m,nm->n...", own, modes)
        gradients[batch] = np.einsum("n...m,ndm->n...d", own, mode_gradients)
    return values, gradients


def has_small_table(expansion: Expansion, points: Floats) -> bool:
    """Whether the table of modes at points (n, d) is built in one batch, so that it may be cached."""
    return not is_factored(expansion) and 0 < len(points) * mode_count(expansion) <= _BATCH


def _width(coefficients: Floats) -> int:
    return int(np.prod(coefficients.shape[1:]))


def _batches(count: int, width: int) -> Iterator[slice]:
    """Slices of range(count) that keep ``width`` numbers a point within the batch size."""
    step = max(1, _BATCH // max(1, width))
    return (slice(start, start + step) for start in range(0, count, step))
