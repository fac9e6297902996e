"""Modes of every shape, family and order."""

import itertools

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.data.dataset import Expansion, Homogeneous
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.collapse import collapse_jacobian, uncollapse
from elvis.core.polynomials.expansion import (
    FAMILIES,
    dimension,
    mode_count,
    mode_indices,
    values,
    values_and_gradients,
)
from elvis.core.polynomials.factors import lagrange_nodes
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape

A, B, C = Basis.MODIFIED_A, Basis.MODIFIED_B, Basis.MODIFIED_C
MODIFIED = {
    Shape.SEGMENT: (A,),
    Shape.TRIANGLE: (A, B),
    Shape.QUADRILATERAL: (A, A),
    Shape.TETRAHEDRON: (A, B, C),
    Shape.PYRAMID: (A, A, Basis.MODIFIED_PYR_C),
    Shape.PRISM: (A, A, B),
    Shape.HEXAHEDRON: (A, A, A),
}
O = Basis.ORTHO_A  # noqa: E741
ORTHO = {
    Shape.SEGMENT: (O,),
    Shape.TRIANGLE: (O, Basis.ORTHO_B),
    Shape.QUADRILATERAL: (O, O),
    Shape.TETRAHEDRON: (O, Basis.ORTHO_B, Basis.ORTHO_C),
    Shape.PYRAMID: (O, O, Basis.ORTHO_PYR_C),
    Shape.PRISM: (O, O, Basis.ORTHO_B),
    Shape.HEXAHEDRON: (O, O, O),
}
FOURIER = (Basis.FOURIER, Basis.FOURIER_SINGLE_MODE, Basis.FOURIER_HALF_MODE_RE, Basis.FOURIER_HALF_MODE_IM)
LINE = FAMILIES[Shape.SEGMENT][0][0]
UNIFORM = [(shape, n) for shape in Shape for n in (1, 2, 3, 5, 8)]
ORDERS = {  # anisotropic, all that the shape admits up to 4
    shape: [
        modes
        for modes in itertools.product(range(1, 5), repeat=shape.dimension)
        if shape in (Shape.SEGMENT, Shape.QUADRILATERAL, Shape.HEXAHEDRON)
        or (shape in (Shape.TRIANGLE, Shape.TETRAHEDRON) and list(modes) == sorted(modes))
        or (shape is Shape.PRISM and modes[0] <= modes[2])
        or (shape is Shape.PYRAMID and max(modes) == modes[2])
    ]
    for shape in Shape
}
ANISOTROPIC = [(shape, modes) for shape in Shape for modes in ORDERS[shape]]


def inside(shape, count=60, seed=1):
    return uncollapse(shape, np.random.default_rng(seed).uniform(-0.98, 0.98, (count, shape.dimension)))


def modified(shape, n):
    return Expansion(shape, MODIFIED[shape], (n,) * shape.dimension)


def ortho(shape, n):
    return Expansion(shape, ORTHO[shape], (n,) * shape.dimension)


def some_bases(shape):
    """Every family: on tensor shapes each basis in all directions, and each with its neighbour in the list."""
    for family in FAMILIES[shape]:
        if family[0] != LINE:
            yield from itertools.product(*family)
            continue
        turned = [LINE[k:] + LINE[:k] for k in range(len(LINE))]
        neighbours = [around[: len(family)] for around in turned] if len(family) > 1 else []
        yield from [*[(basis,) * len(family) for basis in LINE], *neighbours]


EVERY = [(shape, bases) for shape in Shape for bases in some_bases(shape)]


def test_every_shape_and_every_basis_is_listed():
    assert set(FAMILIES) == set(MODIFIED) == set(ORTHO) == set(Shape)
    used = {basis for _, bases in EVERY for basis in bases}
    assert used == set(Basis) - {Basis.NONE}


# --- number and order of modes ---


def tensor(modes):
    return [index[::-1] for index in itertools.product(*map(range, modes[::-1]))]


EXPECTED = {
    Shape.SEGMENT: tensor,
    Shape.QUADRILATERAL: tensor,
    Shape.HEXAHEDRON: tensor,
    Shape.TRIANGLE: lambda m: [(p, q) for p in range(m[0]) for q in range(m[1] - p)],
    Shape.PRISM: lambda m: [(p, q, r) for p in range(m[0]) for q in range(m[1]) for r in range(m[2] - p)],
    Shape.PYRAMID: lambda m: [(p, q, r) for p in range(m[0]) for q in range(m[1]) for r in range(m[2] - max(p, q))],
    Shape.TETRAHEDRON: lambda m: [(p, q, r) for p in range(m[0]) for q in range(m[1] - p) for r in range(m[2] - p - q)],
}
COUNTS = {
    Shape.SEGMENT: lambda n: n,
    Shape.QUADRILATERAL: lambda n: n * n,
    Shape.HEXAHEDRON: lambda n: n**3,
    Shape.TRIANGLE: lambda n: n * (n + 1) // 2,
    Shape.PRISM: lambda n: n * n * (n + 1) // 2,
    Shape.PYRAMID: lambda n: n * (n + 1) * (2 * n + 1) // 6,
    Shape.TETRAHEDRON: lambda n: n * (n + 1) * (n + 2) // 6,
}


@pytest.mark.sampled
@pytest.mark.parametrize(("shape", "modes"), ANISOTROPIC)
@pytest.mark.parametrize("family", [MODIFIED, ORTHO])
def test_modes_are_in_the_order_of_the_format(shape, modes, family):
    expansion = Expansion(shape, family[shape], modes)
    assert [tuple(row) for row in mode_indices(expansion).tolist()] == EXPECTED[shape](modes)
    assert mode_count(expansion) == len(EXPECTED[shape](modes))


@pytest.mark.parametrize("shape", Shape)
@pytest.mark.parametrize("n", [1, 2, 5, 20])
def test_counts_follow_the_formulas(shape, n):
    assert mode_count(modified(shape, n)) == mode_count(ortho(shape, n)) == COUNTS[shape](n)


@pytest.mark.parametrize(("p", "q"), [(p, q) for q in range(1, 9) for p in range(1, q + 1)])
def test_anisotropic_counts_follow_the_formulas(p, q):
    triangle = p * (p + 1) // 2 + p * (q - p)
    assert mode_count(Expansion(Shape.TRIANGLE, MODIFIED[Shape.TRIANGLE], (p, q))) == triangle
    assert mode_count(Expansion(Shape.PRISM, MODIFIED[Shape.PRISM], (p, 3, q))) == 3 * triangle


@pytest.mark.sampled
@pytest.mark.parametrize(("shape", "modes"), ANISOTROPIC)
@pytest.mark.parametrize("family", [MODIFIED, ORTHO])
def test_functions_do_not_depend_on_the_number_of_modes(shape, modes, family):
    small, large = Expansion(shape, family[shape], modes), Expansion(shape, family[shape], (5,) * shape.dimension)
    where = {tuple(row): i for i, row in enumerate(mode_indices(large).tolist())}
    columns = [where[tuple(row)] for row in mode_indices(small).tolist()]
    points = inside(shape, 7)
    assert np.array_equal(values(small, points), values(large, points)[:, columns])


# --- the Modified family ---


def vertex_modes(shape):
    """Indices of the modes of the vertices, in their order (format notes 4)."""
    if shape is Shape.TRIANGLE:
        return [(0, 0), (1, 0), (0, 1)]
    if shape is Shape.TETRAHEDRON:
        return [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    if shape is Shape.PYRAMID:
        return [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1)]
    if shape is Shape.PRISM:
        return [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (0, 1, 1)]
    return [tuple(row) for row in ((shape.vertices + 1) / 2).astype(int).tolist()]


def vertex_columns(shape, n):
    order = [tuple(row) for row in mode_indices(modified(shape, n)).tolist()]
    return [order.index(mode) for mode in vertex_modes(shape)]


@pytest.mark.parametrize(("shape", "n"), [case for case in UNIFORM if case[1] > 1])
def test_vertex_modes_are_a_partition_of_unity(shape, n):
    table, derivatives = values_and_gradients(modified(shape, n), inside(shape))
    columns = vertex_columns(shape, n)
    assert np.abs(table[:, columns].sum(axis=1) - 1).max() < 1e-14
    assert np.abs(derivatives[:, :, columns].sum(axis=2)).max() < 1e-13
    assert (table[:, columns] >= 0).all()


@pytest.mark.parametrize(("shape", "n"), [case for case in UNIFORM if case[1] > 1])
def test_at_a_vertex_only_its_mode_is_one_and_all_others_vanish(shape, n):
    table = values(modified(shape, n), shape.vertices)
    expected = np.zeros_like(table)
    expected[np.arange(len(table)), vertex_columns(shape, n)] = 1
    assert np.abs(table - expected).max() < 1e-14


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1])
def test_interior_modes_vanish_on_the_boundary(shape):
    expansion = modified(shape, 6)
    index = mode_indices(expansion)
    bubbles = (index >= 2).all(axis=1)
    if shape in (Shape.TRIANGLE, Shape.PRISM, Shape.PYRAMID):
        bubbles = (index[:, :-1] >= 2).all(axis=1) & (index[:, -1] >= 1)
    elif shape is Shape.TETRAHEDRON:
        bubbles = (index[:, 0] >= 2) & (index[:, 1:] >= 1).all(axis=1)

    # points of every edge and face: convex combinations of its vertices
    random = np.random.default_rng(3)
    borders = shape.edges if shape.dimension == 2 else shape.faces
    points = np.concatenate([random.dirichlet(np.ones(len(b)), 20) @ shape.vertices[list(b)] for b in borders])
    assert bubbles.any()
    assert np.abs(values(expansion, points)[:, bubbles]).max() < 1e-13


# --- the Ortho family ---


@pytest.mark.parametrize(
    ("shape", "n"), [*UNIFORM, (Shape.SEGMENT, 20), (Shape.TRIANGLE, 15), (Shape.QUADRILATERAL, 12)]
)
def test_ortho_modes_are_orthonormal(shape, n):
    if mode_count(ortho(shape, n)) > 300:
        n = 6
    rules = [gauss(2 * n + 1)] * shape.dimension
    eta = np.stack(np.meshgrid(*[rule[0] for rule in rules]), axis=-1).reshape(-1, shape.dimension)
    weights = np.stack(np.meshgrid(*[rule[1] for rule in rules]), axis=-1).reshape(-1, shape.dimension).prod(axis=1)
    table = values(ortho(shape, n), uncollapse(shape, eta))
    gram = (table.T * (weights * collapse_jacobian(shape, eta))) @ table
    assert np.abs(gram - np.eye(len(gram))).max() < 1e-12


# --- spaces ---


def total_degree(shape, n, points):
    """Monomials that an expansion of n modes in every direction must hold."""
    exponents = itertools.product(range(n), repeat=shape.dimension)
    if shape in (Shape.TRIANGLE, Shape.TETRAHEDRON, Shape.PYRAMID):
        exponents = (e for e in exponents if sum(e) < n)
    elif shape is Shape.PRISM:
        exponents = (e for e in exponents if e[0] + e[2] < n)
    return np.stack([(points**e).prod(axis=1) for e in exponents], axis=1)


POLYNOMIAL = [(shape, bases) for shape, bases in EVERY if not set(bases) & set(FOURIER)]


@pytest.mark.sampled
@pytest.mark.parametrize(("shape", "bases"), POLYNOMIAL)
@pytest.mark.parametrize("n", [2, 4, 6])
def test_polynomials_of_the_space_are_represented(shape, bases, n):
    points = inside(shape, 800)
    table = values(Expansion(shape, bases, (n,) * shape.dimension), points)
    wanted = total_degree(shape, n, points)
    coefficients, _, rank, _ = np.linalg.lstsq(table, wanted, rcond=1e-12)
    assert rank == table.shape[1]
    assert np.abs(table @ coefficients - wanted).max() < 1e-10


@pytest.mark.parametrize("basis", [Basis.GLL_LAGRANGE, Basis.GAUSS_LAGRANGE])
@pytest.mark.parametrize("n", range(2, 21))
def test_lagrange_polynomials_are_nodal(basis, n):
    nodes = lagrange_nodes(basis, n)
    table = values(Expansion(Shape.SEGMENT, (basis,), (n,)), nodes[:, None])
    assert np.abs(table - np.eye(n)).max() < 1e-13


@pytest.mark.parametrize("n", range(1, 21))
def test_chebyshev_and_monomial_functions(n):
    z = np.linspace(-1, 1, 41)
    chebyshev = values(Expansion(Shape.SEGMENT, (Basis.CHEBYSHEV,), (n,)), z[:, None])
    assert np.abs(chebyshev - np.cos(np.arange(n) * np.arccos(z)[:, None])).max() < 1e-13
    monomial = values(Expansion(Shape.SEGMENT, (Basis.MONOMIAL,), (n,)), z[:, None])
    assert np.abs(monomial - z[:, None] ** np.arange(n)).max() == 0


def test_fourier_functions():
    z = 0.3

    def at(basis, n):
        return values(Expansion(Shape.SEGMENT, (basis,), (n,)), np.array([[z]]))[0]

    angle = np.pi * (z + 1)
    six = [1, 0, np.cos(angle), -np.sin(angle), np.cos(2 * angle), -np.sin(2 * angle)]
    assert at(Basis.FOURIER, 6) == pytest.approx(six, abs=1e-15)
    assert at(Basis.FOURIER_SINGLE_MODE, 2) == pytest.approx([np.cos(angle), -np.sin(angle)], abs=1e-15)
    assert at(Basis.FOURIER_HALF_MODE_RE, 1) == pytest.approx([np.cos(np.pi * z)], abs=1e-15)
    assert at(Basis.FOURIER_HALF_MODE_IM, 1) == pytest.approx([-np.sin(np.pi * z)], abs=1e-15)


# --- gradients (exact ones, at collapsed points too, are compared with the Bernstein form in test_bernstein.py) ---


def differences(expansion, points, step=1e-3):
    """Sixth-order central differences, (n, d, m)."""
    weights = {1: 45 / 60, 2: -9 / 60, 3: 1 / 60}
    columns = []
    for d in step * np.eye(points.shape[1]):
        pairs = (
            w * (values(expansion, points + k * d) - values(expansion, points - k * d)) for k, w in weights.items()
        )
        columns.append(sum(pairs) / step)
    return np.stack(columns, axis=1)


@pytest.mark.parametrize(("shape", "bases"), EVERY)
def test_gradients_match_those_of_the_values(shape, bases):
    n = 2 if Basis.FOURIER_SINGLE_MODE in bases else 6 if shape.dimension < 3 else 4
    expansion = Expansion(shape, bases, (n,) * shape.dimension)
    points = uncollapse(shape, np.random.default_rng(2).uniform(-0.9, 0.8, (25, shape.dimension)))
    table, derivatives = values_and_gradients(expansion, points)
    assert np.array_equal(table, values(expansion, points))
    assert np.abs(derivatives - differences(expansion, points)).max() < 1e-9 * (1 + np.abs(derivatives).max())


@pytest.mark.parametrize("family", [MODIFIED, ORTHO])
@pytest.mark.parametrize("n", [2, 5, 9])
def test_gradients_at_an_apex_are_limits_along_the_guarded_direction(family, n):
    expansion = Expansion(Shape.PYRAMID, family[Shape.PYRAMID], (n, n, n))
    near = uncollapse(Shape.PYRAMID, np.array([[-1, -1, 1 - 1e-7]]))
    at_apex = values_and_gradients(expansion, Shape.PYRAMID.vertices[4:])[1]
    assert np.isfinite(at_apex).all()
    beside = values_and_gradients(expansion, near)[1]
    assert np.abs(at_apex - beside).max() < 1e-5 * max(1, np.abs(at_apex).max()) * n**2


# --- homogeneous directions ---


PLANES = Homogeneous((Basis.FOURIER,), (2.5,), (0, 1, 2, 3))
LINES = Homogeneous((Basis.FOURIER, Basis.FOURIER), (1.0, 2.0), (0, 0, 2, 2), y_ids=(2, 3, 2, 3))


@pytest.mark.parametrize(
    ("shape", "planes"), [(Shape.TRIANGLE, PLANES), (Shape.QUADRILATERAL, PLANES), (Shape.SEGMENT, LINES)]
)
def test_homogeneous_modes_are_plane_by_plane(shape, planes):
    flat, full = modified(shape, 4), Expansion(shape, MODIFIED[shape], (4,) * shape.dimension, planes)
    extra = len(planes.bases)
    assert dimension(full) == shape.dimension + extra
    assert mode_count(full) == 4 * mode_count(flat)
    points = np.hstack([inside(shape, 9), np.random.default_rng(5).uniform(-1, 1, (9, extra))])
    spatial = values(flat, points[:, :-extra])

    # number -> function of zeta
    waves = [
        lambda t: 1 + 0 * t,
        lambda t: 0 * t,
        lambda t: np.cos(np.pi * (t + 1)),
        lambda t: -np.sin(np.pi * (t + 1)),
    ]
    found = values(full, points).reshape(9, 4, -1)
    for plane, z in enumerate(planes.z_ids):
        wave = waves[z](points[:, -1])
        wave = wave * waves[planes.y_ids[plane]](points[:, -2]) if planes.y_ids else wave
        assert np.abs(found[:, plane] - wave[:, None] * spatial).max() < 1e-15

    index = mode_indices(full)
    assert index.shape == (mode_count(full), shape.dimension + extra)
    assert index[:, -1].tolist() == np.repeat(planes.z_ids, mode_count(flat)).tolist()


@pytest.mark.parametrize(("shape", "planes"), [(Shape.TRIANGLE, PLANES), (Shape.SEGMENT, LINES)])
def test_homogeneous_gradients_match_those_of_the_values(shape, planes):
    full = Expansion(shape, MODIFIED[shape], (4,) * shape.dimension, planes)
    points = np.hstack([0.9 * inside(shape, 9) - 0.05, np.random.default_rng(5).uniform(-1, 1, (9, len(planes.bases)))])
    table, derivatives = values_and_gradients(full, points)
    assert np.array_equal(table, values(full, points))
    assert np.abs(derivatives - differences(full, points)).max() < 1e-9 * np.abs(derivatives).max()


# --- what is rejected ---


@pytest.mark.parametrize(
    ("expansion", "message"),
    [
        (Expansion(Shape.TRIANGLE, (A, B), (5, 4)), "direction 1 than in direction 2, found 5x4"),
        (Expansion(Shape.TETRAHEDRON, (A, B, C), (3, 5, 4)), "direction 2 than in direction 3, found 3x5x4"),
        (Expansion(Shape.PRISM, (A, A, B), (5, 2, 4)), "direction 1 than in direction 3"),
        (Expansion(Shape.PYRAMID, (A, A, Basis.MODIFIED_PYR_C), (2, 5, 4)), "direction 2 than in direction 3"),
        (
            Expansion(Shape.PYRAMID, (A, A, C), (4, 4, 4)),
            "belong together on this shape, found Modified_A, Modified_A, Modified_C",
        ),
        (Expansion(Shape.TRIANGLE, (A, Basis.ORTHO_B), (4, 4)), "belong together"),
        (Expansion(Shape.TRIANGLE, (A, A), (4, 4)), "belong together"),
        (Expansion(Shape.QUADRILATERAL, (A, B), (4, 4)), "belong together"),
        (Expansion(Shape.HEXAHEDRON, (A, A), (4, 4)), "expected 3 bases and orders, found 2 and 2"),
        (Expansion(Shape.SEGMENT, (A,), (0,)), "at least one mode"),
        (Expansion(Shape.SEGMENT, (Basis.GLL_LAGRANGE,), (1,)), "at least two"),
        (Expansion(Shape.SEGMENT, (Basis.FOURIER,), (5,)), "even number of Fourier modes, found 5"),
        (Expansion(Shape.SEGMENT, (A,), (3,), Homogeneous((A,), (1.0,), (0,))), "Fourier bases"),
        (Expansion(Shape.SEGMENT, (A,), (3,), Homogeneous((Basis.FOURIER,), (), (0,))), "one length"),
        (Expansion(Shape.SEGMENT, (A,), (3,), Homogeneous((Basis.FOURIER,), (1.0,), ())), "each plane or line"),
        (Expansion(Shape.SEGMENT, (A,), (3,), Homogeneous((Basis.FOURIER,), (1.0,), (0,), strips=(1,))), "strips"),
    ],
)
def test_impossible_expansions_are_rejected(expansion, message):
    with pytest.raises(FormatError, match=message):
        mode_count(expansion)


def test_points_of_another_dimension_are_rejected():
    with pytest.raises(ElvisError, match=r"expected points \(n, 3\)"):
        values(modified(Shape.TETRAHEDRON, 3), np.zeros((4, 2)))
