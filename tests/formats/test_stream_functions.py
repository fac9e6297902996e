"""Stream functions of polynomial flows are exact, and flows with sources report what is left."""

import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals import integrate
from elvis.core.numbers.norms import quantity_norms
from elvis.core.quantities import Expression
from elvis.core.resolution.stream_functions import stream_function
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid, mixed_plane

MESHES = {shape.label: (lambda shape=shape: grid(shape, 3)) for shape in (Shape.TRIANGLE, Shape.QUADRILATERAL)}
MESHES["mixed"] = mixed_plane


def flow(mesh, **fields):
    """Fields of order 3 on a mesh."""
    bare = Dataset(mesh)
    made = tuple(approximated(bare, name, function, 4) for name, function in fields.items())
    return Dataset(mesh, made)


@pytest.mark.parametrize("mesh", MESHES)
def test_a_polynomial_flow_has_its_stream_function(mesh):
    # psi = x^3 y - y^4/4 + x
    dataset = flow(MESHES[mesh](), u=lambda p: p[:, 0] ** 3 - p[:, 1] ** 3, v=lambda p: -3 * p[:, 0] ** 2 * p[:, 1] - 1)
    found = stream_function(dataset, "psi")
    assert found.residual < 1e-12
    both = Dataset(dataset.mesh, (*dataset.fields, found.field))
    area = integrate(both, "1").value
    mean = integrate(both, "x^3*y - y^4/4 + x").value / area
    text = f"psi - (x^3*y - y^4/4 + x) + {mean!r}"
    assert quantity_norms(both, [Expression.of(both, text)])[text].linf < 1e-11


def test_a_source_reports_what_no_stream_function_holds():
    # gradients nearest to the rotation (-y, x) are those of the warping of a twisted square rod: what is left is the
    # torsion constant 0.1405770 a^4 (Saint-Venant; Timoshenko and Goodier, Theory of Elasticity, section 109) of a^4/6
    middle = grid(Shape.QUADRILATERAL, 4).vertices.max(axis=0) / 2
    source = flow(grid(Shape.QUADRILATERAL, 4), u=lambda p: p[:, 0] - middle[0], v=lambda p: p[:, 1] - middle[1])
    assert stream_function(source, "psi").residual ** 2 == pytest.approx(0.1405770 * 6, rel=1e-5)


def test_only_plane_flows_have_a_stream_function():
    with pytest.raises(ElvisError, match="psi: expected plane data, found 3D elements"):
        stream_function(Dataset(grid(Shape.HEXAHEDRON, 1)), "psi")
    with pytest.raises(ElvisError, match="velocity"):
        stream_function(flow(grid(Shape.TRIANGLE, 1), q=lambda p: p[:, 0]), "psi")
