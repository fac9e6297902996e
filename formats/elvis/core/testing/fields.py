"""Fields made from functions of the world coordinates."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats, grid_points
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.data.dataset import Block, Dataset, Expansion, Field
from elvis.core.data.mesh import Mesh
from elvis.core.mapping.geometry import GeometryBlock, geometry
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.projections import conforming
from elvis.core.polynomials.collapse import collapse_jacobian, uncollapse
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.expansion import mode_count, values
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape

#: elements sampled at once
_CHUNK = 1 << 12

#: components of a velocity (n,) at points (n, 3), with vortices
VORTICES: Mapping[str, Callable[[Floats], Floats]] = {
    "u": lambda p: np.sin(3 * p[:, 0]) * np.cos(2 * p[:, 1]),
    "v": lambda p: -np.cos(3 * p[:, 0]) * np.sin(2 * p[:, 1] + p[:, 2]),
    "w": lambda p: np.sin(3 * p[:, 2] + p[:, 0] * p[:, 1]),
}


def approximated(dataset: Dataset, name: str, function: Callable[[Floats], Floats], modes: int) -> Field:
    """The field that approximates ``function``, points (n, 3) to values (n,), best in the mean on each element.

    In the Modified basis with ``modes`` modes each way, weighted in reference space; exact where the function is in the
    space of every element.
    """
    blocks = [_block(block, function, modes) for block in geometry(dataset)]
    return Field(name, tuple(blocks))


def interpolated(dataset: Dataset, name: str, function: Callable[[Floats], Floats], modes: int) -> Field:
    """The field that interpolates ``function``, points (n, 3) to values (n,), by projections; it is continuous.

    In the Modified basis with ``modes`` modes each way; fields that are `approximated` are discontinuous.
    """
    blocks = []
    for own in geometry(dataset):
        expansion = modified(own.expansion.shape, (modes,) * own.expansion.shape.dimension)
        operator = conforming(expansion, 1)
        places = np.swapaxes(evaluate(own.expansion, own.coefficients, operator.points), 1, 2)
        samples = function(places.reshape(-1, 3)).reshape(places.shape[:2])
        blocks.append(Block(expansion, own.element_ids, frozen_floats(samples @ operator.matrix)))
    return Field(name, tuple(blocks))


def with_field(mesh: Mesh, function: Callable[[Floats], Floats], modes: int = 3) -> Dataset:
    """A dataset of a mesh with one field, ``u``, that approximates ``function``."""
    return Dataset(mesh, (approximated(Dataset(mesh), "u", function, modes),))


def _block(block: GeometryBlock, function: Callable[[Floats], Floats], modes: int) -> Block:
    expansion = modified(block.expansion.shape, (modes,) * block.expansion.shape.dimension)
    points, projection = _projection(expansion)
    tables = values(block.expansion, points)
    coefficients = np.empty((len(block), mode_count(expansion)))
    for part in chunks(len(block), _CHUNK):
        world = (block.coefficients[part] @ tables.T).transpose(0, 2, 1)
        samples = function(world.reshape(-1, 3)).reshape(world.shape[:2])
        coefficients[part] = samples @ projection.T
    return Block(expansion, block.element_ids, frozen_floats(coefficients))


@bounded_cache
def _projection(expansion: Expansion) -> tuple[Floats, Floats]:
    """Points xi (n, d) and the matrix (m, n) from values there to the modes of the best approximation."""
    shape = expansion.shape
    # degrees up to n - 1 in each collapsed coordinate, on pyramids up to 2 n - 3 in the last one
    lines = [gauss(2 * count if shape is Shape.PYRAMID else count + 1) for count in expansion.modes]
    eta = grid_points(*(nodes for nodes, _ in lines))
    weights = np.ones(1)
    for _, line in lines:
        weights = np.multiply.outer(weights, line).reshape(-1)
    xi = uncollapse(shape, eta)
    modes = values(expansion, xi)
    weighted = modes * (weights * collapse_jacobian(shape, eta))[:, None]
    return frozen_floats(xi), frozen_floats(np.linalg.solve(modes.T @ weighted, weighted.T))
