"""Norms of functions whose integrals are known, on every shape; real data are in test_truth.py."""

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Block, Dataset, Expansion, ExpansionRule, Field, Homogeneous
from elvis.core.mapping.connectivity import connected
from elvis.core.numbers.norms import norms
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.expansion import mode_count, values
from elvis.core.polynomials.interpolation import modified
from elvis.core.shapes import Shape

#: integral of (xi1)^2 over the reference shape
SECOND_MOMENTS = {
    Shape.SEGMENT: 2 / 3,
    Shape.TRIANGLE: 2 / 3,
    Shape.QUADRILATERAL: 4 / 3,
    Shape.TETRAHEDRON: 8 / 15,
    Shape.PYRAMID: 4 / 5,
    Shape.PRISM: 4 / 3,
    Shape.HEXAHEDRON: 8 / 3,
}

PLANES = Homogeneous((Basis.FOURIER,), (2.5,), (0, 1, 2, 3))


def alone(shape, vertices=None, space=None):
    """The mesh of one element, the reference shape itself unless other vertices are given."""
    points = np.zeros((len(shape.vertices), 3))
    points[:, : shape.dimension] = shape.vertices
    rows = np.arange(len(points))[None, :]
    return connected(points if vertices is None else vertices, {shape: rows}, space or shape.dimension)


def field(name, expansion, coefficients):
    rows = np.atleast_2d(coefficients)
    return Field(name, (Block(expansion, np.arange(len(rows)), rows),))


def linear(shape, n):
    """Coefficients of the function xi1 in Modified modes: -1 at vertices with xi1 = -1, and so on."""
    expansion = modified(shape, (n,) * shape.dimension)
    table = values(expansion, shape.vertices)
    coefficients = np.zeros(mode_count(expansion))
    for vertex, row in zip(shape.vertices, table, strict=True):
        coefficients[np.argmax(row)] = vertex[0]
    return expansion, coefficients


def test_every_shape_is_listed():
    assert set(SECOND_MOMENTS) == set(Shape)


@pytest.mark.parametrize("shape", Shape)
@pytest.mark.parametrize("n", [3, 6])
def test_a_linear_function_on_the_reference_element(shape, n):
    found = norms(Dataset(alone(shape), (field("f", *linear(shape, n)),)))
    assert list(found) == [*"xyz"[: shape.dimension], "f"]
    for name in ("x", "f"):
        assert found[name].l2 == pytest.approx(np.sqrt(SECOND_MOMENTS[shape]), rel=1e-13)
        assert found[name].linf == pytest.approx(1, rel=1e-13)


@pytest.mark.parametrize("shape", Shape)
def test_norms_scale_with_the_map(shape):
    mesh = alone(shape)
    stretched = alone(shape, mesh.vertices * [2.0, 3.0, 5.0])
    expansion, coefficients = linear(shape, 4)
    before, after = (norms(Dataset(m, (field("f", expansion, coefficients),))) for m in (mesh, stretched))
    volume = np.prod([2.0, 3.0, 5.0][: shape.dimension])
    assert after["f"].l2 == pytest.approx(before["f"].l2 * np.sqrt(volume), rel=1e-13)
    assert after["x"].l2 == pytest.approx(before["x"].l2 * 2 * np.sqrt(volume), rel=1e-13)


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension < 3])
def test_surfaces_and_curves_in_space_use_their_intrinsic_measure(shape):
    random = np.random.default_rng(0)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    flat = alone(shape, space=3)
    expansion, coefficients = linear(shape, 3)
    before, after = (
        norms(Dataset(m, (field("f", expansion, coefficients),)))
        for m in (flat, alone(shape, flat.vertices @ turn, space=3))
    )
    assert after["f"].l2 == pytest.approx(before["f"].l2, rel=1e-13)
    total = sum(after[axis].l2 ** 2 for axis in "xyz")
    assert total == pytest.approx(sum(before[axis].l2 ** 2 for axis in "xyz"), rel=1e-13)


def test_orientation_does_not_change_norms():
    vertices = np.array([[0.0, 0, 0], [0, 2, 0], [1, 2, 0], [1, 0, 0]])
    backwards = norms(Dataset(alone(Shape.QUADRILATERAL, vertices)))
    assert backwards["x"].l2 == pytest.approx(np.sqrt(2 / 3), rel=1e-14)


def test_the_maximum_has_its_sign():
    shape = Shape.QUADRILATERAL
    expansion, coefficients = linear(shape, 3)
    found = norms(Dataset(alone(shape), (field("f", expansion, coefficients - 3 * (coefficients != 0)),)))["f"]
    assert found.maximum == pytest.approx(-2, rel=1e-13)
    assert found.linf == pytest.approx(4, rel=1e-13)


def test_a_mesh_without_fields_uses_its_expansions_or_orders():
    mesh = alone(Shape.TRIANGLE)
    composite = mesh.composites[0].id
    fine = Dataset(mesh, expansions=(ExpansionRule((composite,), "MODIFIED", (9,)),))
    elsewhere = Dataset(mesh, expansions=(ExpansionRule((composite + 7,), "MODIFIED", (9,)),))
    for dataset in (fine, elsewhere, Dataset(mesh)):
        assert norms(dataset)["x"].l2 == pytest.approx(np.sqrt(2 / 3), rel=1e-13)
    # the collapsed vertex is no quadrature point: more points come nearer to it
    assert norms(fine)["y"].maximum > norms(elsewhere)["y"].maximum == norms(Dataset(mesh))["y"].maximum


@pytest.mark.parametrize("basis", [Basis.FOURIER, Basis.FOURIER_SINGLE_MODE])
def test_homogeneous_planes_integrate_waves(basis):
    """1 + 2 cos on the reference square times the period LZ: 4 LZ (1 + 2) without the mean 4 LZ 2."""
    length, shape = 2.5, Shape.QUADRILATERAL
    numbers = (0, 1, 2, 3) if basis is Basis.FOURIER else (2, 3)
    expansion = Expansion(shape, (Basis.MODIFIED_A,) * 2, (2, 2), Homogeneous((basis,), (length,), numbers))
    waves = [1.0, 0, 2, 0] if basis is Basis.FOURIER else [2.0, 0]
    found = norms(Dataset(alone(shape), (field("f", expansion, np.repeat(waves, 4)),)))
    assert list(found) == ["x", "y", "z", "f"]
    mean = 3 if basis is Basis.FOURIER else 2
    assert found["f"].l2 == pytest.approx(np.sqrt(4 * length * mean), rel=1e-13)
    assert found["x"].l2 == pytest.approx(np.sqrt(4 / 3 * length), rel=1e-13)
    assert found["z"].maximum == pytest.approx(length * 3 / 4)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_single_wave_has_four_planes(sign):
    """FieldConvert gives it as many: the largest value is found whichever sign the wave has."""
    expansion = Expansion(
        Shape.QUADRILATERAL, (Basis.MODIFIED_A,) * 2, (2, 2), Homogeneous((Basis.FOURIER_SINGLE_MODE,), (2.5,), (2, 3))
    )
    found = norms(Dataset(alone(Shape.QUADRILATERAL), (field("f", expansion, np.repeat([3.0 * sign, 0], 4)),)))
    assert found["f"].maximum == pytest.approx(3)
    assert found["f"].l2 == pytest.approx(3 * np.sqrt(4 * 2.5 / 2), rel=1e-13)


@pytest.mark.parametrize(("basis", "place"), [(Basis.FOURIER_HALF_MODE_RE, 1 / 2), (Basis.FOURIER_HALF_MODE_IM, 1 / 4)])
def test_half_mode_expansions_have_one_plane_over_the_whole_length(basis, place):
    """FieldConvert takes the cosine at one point, the middle, with the weight of the midpoint rule."""
    expansion = Expansion(Shape.QUADRILATERAL, (Basis.MODIFIED_A,) * 2, (2, 2), Homogeneous((basis,), (2.5,), (2,)))
    found = norms(Dataset(alone(Shape.QUADRILATERAL), (field("f", expansion, np.repeat(3.0, 4)),)))
    assert found["f"].l2 == pytest.approx(3 * np.sqrt(4 * 2.5), rel=1e-13)
    assert found["f"].maximum == pytest.approx(3)
    assert found["x"].l2 == pytest.approx(np.sqrt(4 / 3 * 2.5), rel=1e-13)
    assert found["z"].maximum == pytest.approx(2.5 * place)


def test_two_homogeneous_directions():
    planes = Homogeneous((Basis.FOURIER,) * 2, (2.0, 3.0), z_ids=(0, 0, 0, 0, 2, 2, 2, 2), y_ids=(0, 1, 2, 3) * 2)
    expansion = Expansion(Shape.SEGMENT, (Basis.MODIFIED_A,), (2,), planes)
    waves = np.zeros(8)
    waves[6] = 1  # cos in y times cos in z
    found = norms(Dataset(alone(Shape.SEGMENT), (field("f", expansion, np.repeat(waves, 2)),)))
    assert list(found) == ["x", "y", "z", "f"]
    # two wave numbers in z make two planes, at cos = 1 and cos = -1
    assert found["f"].l2 == pytest.approx(np.sqrt(2 * 2 * 3 / 2), rel=1e-13)
    assert found["y"].maximum == pytest.approx(1.5)
    assert found["z"].maximum == pytest.approx(1.5)


def test_segments_with_one_homogeneous_direction_sum_over_planes():
    expansion = Expansion(Shape.SEGMENT, (Basis.MODIFIED_A,), (2,), Homogeneous((Basis.FOURIER,), (5.0,), (0, 1, 2, 3)))
    found = norms(Dataset(alone(Shape.SEGMENT, space=2), (field("f", expansion, [1.0, 1, 0, 0, 0, 0, 0, 0]),)))
    assert list(found) == ["x", "y", "z", "f"]
    assert found["f"].l2 == pytest.approx(np.sqrt(2 * 4), rel=1e-14)


def test_elements_without_the_field_do_not_count():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]])
    mesh = connected(vertices, {Shape.QUADRILATERAL: np.array([[0, 1, 2, 3], [1, 4, 5, 2]])}, 2)
    found = norms(Dataset(mesh, (field("f", modified(Shape.QUADRILATERAL, (2, 2)), [2.0, 2, 2, 2]),)))
    assert found["f"].l2 == pytest.approx(2, rel=1e-14)
    assert found["x"].linf == pytest.approx(2, rel=1e-14)

    # the planes of a homogeneous field are those of the coordinates, where the field lacks elements too
    expansion = Expansion(Shape.QUADRILATERAL, (Basis.MODIFIED_A,) * 2, (2, 2), PLANES)
    found = norms(Dataset(mesh, (field("f", expansion, np.repeat([1.0, 0, 0, 0], 4)),)))
    assert found["f"].l2 == pytest.approx(np.sqrt(2.5), rel=1e-14)
    assert found["x"].l2 == pytest.approx(np.sqrt(8 / 3 * 2.5), rel=1e-14)
    nowhere = Field("g", (Block(modified(Shape.QUADRILATERAL, (2, 2)), np.array([17]), np.ones((1, 4))),))
    with pytest.raises(ElvisError, match="under g, found none"):
        norms(Dataset(mesh, (nowhere,)))


def test_batches_do_not_change_norms(monkeypatch):
    vertices = np.stack([*np.meshgrid(np.arange(6.0), np.arange(2.0)), np.zeros((2, 6))], axis=-1).reshape(-1, 3)
    rows = np.array([[i, i + 1, i + 7, i + 6] for i in range(5)])
    dataset = Dataset(connected(vertices, {Shape.QUADRILATERAL: rows}, 2))
    whole = norms(dataset)
    monkeypatch.setattr("elvis.core.numbers.norms._BATCH", 1)
    assert norms(dataset)["x"].l2 == pytest.approx(whole["x"].l2, rel=1e-14)
    assert whole["x"].l2 == pytest.approx(np.sqrt(125 / 3), rel=1e-13)
