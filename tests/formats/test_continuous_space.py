"""The continuous projection is continuous, reproduces continuous fields, and is the best of all in L2."""

import numpy as np
import pytest

from elvis.core.data.dataset import Dataset
from elvis.core.integrals import integrate
from elvis.core.numbers.norms import quantity_norms
from elvis.core.quantities import Expression
from elvis.core.quantities.jumps import jumps
from elvis.core.resolution.continuous_space import continuous_projection
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, interpolated, mixed_plane, mixed_volume, ripple

MESHES = {shape.label: (lambda shape=shape: curved(grid(shape, 2), ripple(0.05), 3)) for shape in Shape}
MESHES |= {"mixed plane": mixed_plane, "mixed volume": mixed_volume}


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
