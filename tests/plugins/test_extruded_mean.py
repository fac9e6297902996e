"""Means of extruded meshes are exact whatever the orientation and height of elements, and other meshes are rejected."""

import itertools

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals import integrate
from elvis.core.numbers.norms import quantity_norms
from elvis.core.polynomials.quadrature import lobatto
from elvis.core.quantities import Expression
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid
from elvis.plugins.conversion.arrays import from_arrays
from elvis.plugins.means.extruded_mean import extruded_mean

ORDER = 4
#: the 24 rotations of a cube, as order and direction of axes
ROTATIONS = [
    (order, signs)
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1, -1), repeat=3)
    if np.linalg.det(np.eye(3)[list(order)]) * np.prod(signs) > 0
]


def boxes(count, layers):
    """Positions (n, q, 3) of nodes of curved elements over count x count plane elements, each turned in some way."""
    line = (1 + lobatto(ORDER + 1)[0]) / 2
    nodes = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)
    rng = np.random.default_rng(3)
    found = []
    for i, j, k in itertools.product(range(count), range(count), range(len(layers) - 1)):
        x, y, t = (nodes[..., 0] + i) / count, (nodes[..., 1] + j) / count, nodes[..., 2]
        # heights that are not linear in the reference coordinate
        z = layers[k] + (layers[k + 1] - layers[k]) * (0.7 * t + 0.3 * t**2)
        world = np.stack([x + 0.2 * y**2, y - 0.1 * x**2, z], axis=-1)
        order, signs = ROTATIONS[rng.integers(len(ROTATIONS))]
        turned = world.transpose(*order, 3)[tuple(slice(None, None, sign) for sign in signs)]
        # the first coordinate varies fastest
        found.append(turned.transpose(2, 1, 0, 3).reshape(-1, 3))
    return np.array(found)


def extruded(layers=(0.0, 0.1, 0.4, 1.0), keep=slice(None)):
    """Data on such elements with the field x^2 z + y z^2."""
    places = boxes(2, layers)[keep]
    x, y, z = np.moveaxis(places, -1, 0)
    return from_arrays({"hexahedron": places}, u=x**2 + y * z**2)


def test_elements_in_any_orientation_have_an_exact_mean():
    found = extruded_mean(extruded(), "z").dataset
    assert found.mesh.count == 4
    assert integrate(found, "1").value == pytest.approx(integrate(extruded(), "1").value, rel=1e-12)
    # the mean of z^2 over 0 to 1 is 1/3
    norms = quantity_norms(found, [Expression.of(found, "u - (x^2 + y/3)")])
    assert norms["u - (x^2 + y/3)"].linf < 1e-12


@pytest.mark.parametrize(("shape", "axis"), [(Shape.HEXAHEDRON, "z"), (Shape.PRISM, "y")])
def test_sides_along_the_axis_are_boundaries_of_the_plane(shape, axis):
    height = "xyz".index(axis)
    flat = [i for i in range(3) if i != height]

    def bend(points):
        moved = points.copy()
        moved[:, flat[0]] += 0.1 * points[:, flat[1]] ** 2
        return moved

    bare = Dataset(curved(grid(shape, 2), bend, 3))
    field = approximated(bare, "u", lambda p: p[:, flat[0]] + p[:, height] ** 2, 4)
    source = Dataset(bare.mesh, (field,))
    found = extruded_mean(source, axis).dataset
    whole = integrate(source, "u").value
    assert integrate(found, "u").value == pytest.approx(whole, rel=1e-12)
    # two straight sides of length 1, and two parabolas
    arc = integrate(found, "1", over="boundary").value
    parabola = 0.5 * np.sqrt(1.04) + np.arcsinh(0.2) / 0.4
    assert arc == pytest.approx(2 + 2 * parabola, rel=1e-6)


def test_other_meshes_raise_an_error():
    with pytest.raises(ElvisError, match=r"--direction x: expected elements that are extruded along x, found element"):
        extruded_mean(extruded(), "x")
    with pytest.raises(ElvisError, match=r"--direction z: expected columns of the height 1, found 1 of 4 with others"):
        extruded_mean(extruded(keep=slice(1, None)), "z")
    with pytest.raises(ElvisError, match=r"expected hexahedra and prisms .* along z, found 6 tetrahedrons"):
        extruded_mean(Dataset(grid(Shape.TETRAHEDRON, 1)), "z")
    with pytest.raises(ElvisError, match="expected a 3D mesh or a Fourier direction"):
        extruded_mean(Dataset(grid(Shape.TRIANGLE, 1)), "z")
