"""The continuous projection is continuous, reproduces continuous fields, and is the best of all in L2."""

import numpy as np
import pytest

from elvis.core.dataset import Block, Dataset, Field
from elvis.core.geometry import geometry
from elvis.core.integrals import integrate
from elvis.core.mapping.projections import conforming
from elvis.core.norms import quantity_norms
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.interpolation import modified
from elvis.core.quantities import Expression
from elvis.core.quantities.jumps import jumps
from elvis.core.resolution.continuous_space import continuous_projection
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, ripple

MESHES = {shape.label: (lambda shape=shape: curved(grid(shape, 2), ripple(0.05), 3)) for shape in Shape}
MESHES |= {"mixed plane": mixed_plane, "mixed volume": mixed_volume}


def interpolated(bare, name, function, modes):
    """The projection-based interpolant, a continuous field."""
    blocks = []
    for own in geometry(bare):
        expansion = modified(own.expansion.shape, (modes,) * own.expansion.shape.dimension)
        operator = conforming(expansion, 1)
        places = np.swapaxes(evaluate(own.expansion, own.coefficients, operator.points), 1, 2)
        samples = function(places.reshape(-1, 3)).reshape(places.shape[:2])
        blocks.append(Block(expansion, own.element_ids, samples @ operator.matrix))
    return Field(name, tuple(blocks))


def wave(p):
    """A function that no space contains."""
    return np.exp(p[:, 0] - p[:, 1]) + np.sin(3 * p[:, 0] + 2 * p[:, -1])


@pytest.mark.parametrize("modes", [2, 5])
@pytest.mark.parametrize("mesh", MESHES)
def test_the_continuous_projection_is_orthogonal_to_its_error(mesh, modes):
    bare = Dataset(MESHES[mesh]())
    rough = approximated(bare, "u", lambda p: wave(p) + 0.3 * np.round(2 * p[:, 0]), modes)
    smooth = interpolated(bare, "v", lambda p: wave(2 * p), modes)
    _, found = continuous_projection(bare, rough, "a")
    _, again = continuous_projection(bare, smooth, "b")
    dataset = Dataset(bare.mesh, (rough, smooth, found, again))

    _, jump = jumps(dataset, "a")
    assert np.nanmax(jump, initial=0.0) < 1e-11
    assert quantity_norms(dataset, [Expression.of(dataset, "b - v")])["b - v"].linf < 1e-11

    # the error is orthogonal to each continuous function, constants included
    for other in ("1", "v"):
        assert abs(integrate(dataset, f"(a - u)*{other}").value) < 1e-11
