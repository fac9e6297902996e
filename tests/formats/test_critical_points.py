"""Critical points of velocities: none missed and none invented, next to brute force; kinds; walls; index sums."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.critical.points import classified, critical_points
from elvis.core.critical.wall_points import wall_points
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import Composite
from elvis.core.mapping.connectivity import connected
from elvis.core.mapping.orientation import local_vertices
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, ripple

SHAPES = [shape for shape in Shape if shape.dimension > 1]


def data(mesh, functions, modes=3, names="uvw"):
    bare = Dataset(mesh)
    return Dataset(
        mesh, tuple(approximated(bare, name, own, modes) for name, own in zip(names, functions, strict=False))
    )


def random_polynomial(dimension, degree, seed):
    """Powers (k, d) of total degree ``degree`` at most and random weights (d, k) of them in each component."""
    powers = np.indices((degree + 1,) * dimension).reshape(dimension, -1).T
    powers = powers[powers.sum(axis=1) <= degree]
    return powers, np.random.default_rng(seed).normal(size=(dimension, len(powers)))


def random_field(dimension, degree, seed):
    """Components of a random polynomial in 2 x - 1 of points x (n, 3 or more), complex ones too."""
    powers, weights = random_polynomial(dimension, degree, seed)

    def component(own):
        return lambda p: ((2 * p[:, None, :dimension] - 1) ** powers).prod(axis=2) @ own

    return [component(own) for own in weights]


def random_texts(dimension, degree, seed):
    """The components of `random_field` as expressions of fields u, v, w that are the coordinates."""
    powers, weights = random_polynomial(dimension, degree, seed)
    bases = [f"(2*{name}-1)" for name in "uvw"[:dimension]]
    terms = ["*".join(f"{base}^{power}" for base, power in zip(bases, own, strict=True)) for own in powers]
    return [
        "+".join(f"({weight!r})*{term}" for weight, term in zip(own.tolist(), terms, strict=True)) for own in weights
    ]


def brute_force(functions, dimension, starts=400):
    """All zeros in the unit box that Newton's method finds from many starts; derivatives by complex steps."""
    places = np.random.default_rng(0).uniform(0, 1, (starts, dimension))
    for _ in range(40):
        values = np.stack([own(places) for own in functions], axis=1)
        steps = 1e-30j * np.eye(dimension)
        slopes = np.stack(
            [np.stack([own(places + step).imag for own in functions], axis=1) / 1e-30 for step in steps], axis=2
        )
        places = np.clip(places - np.linalg.solve(slopes, values[:, :, None])[:, :, 0], -2, 3)
    sizes = np.abs(np.stack([own(places) for own in functions], axis=1)).max(axis=1)
    found = []
    for place in places[(sizes < 1e-12) & (places > 0).all(axis=1) & (places < 1).all(axis=1)]:
        if all(np.abs(place - other).max() > 1e-7 for other in found):
            found.append(place)
    return np.array(found).reshape(-1, dimension)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("bend", [0.0, 0.04])
@pytest.mark.parametrize("seed", range(20))
@pytest.mark.sampled(least=10, free=("seed",))
def test_all_are_found_and_none_is_spurious(shape, bend, seed):
    """Of fields in straight elements; in curved ones of polynomials of the coordinates, which are in every space there.

    A polynomial of the coordinates itself is not: on a curved pyramid it is rational in the reference coordinates.
    """
    d, degree = shape.dimension, 2 if shape.dimension == 3 else 3
    functions = random_field(d, degree, seed)
    mesh = curved(grid(shape, 1), ripple(bend), 3)
    if bend:
        coordinates = [lambda p, axis=axis: p[:, axis] for axis in range(d)]
        found = critical_points(data(mesh, coordinates), random_texts(d, degree, seed))
    else:
        found = critical_points(data(mesh, functions, degree + 1))
    places = np.array([point.position[:d] for point in found.points]).reshape(-1, d)
    truth = brute_force(functions, d)
    assert found.undecided == ()
    values = np.stack([own(places) for own in functions], axis=1)
    assert np.abs(values).max(initial=0) < 1e-11
    if not bend:
        assert len(places) == len(truth)
        assert all(np.abs(places - own).max(axis=1).min() < 1e-10 for own in truth)
    inner = truth[(np.abs(truth - 0.5) < 0.4).all(axis=1)]
    assert all(np.abs(places - own).max(axis=1).min() < 1e-10 for own in inner)
    for point, gradient in zip(found.points, gradients(functions, places), strict=True):
        assert point.index == np.sign(np.linalg.det(gradient))
        assert in_order(point.eigenvalues) == pytest.approx(in_order(np.linalg.eigvals(gradient)), rel=1e-8)


def gradients(functions, places):
    """(n, d, d) derivatives of components at places (n, d), by complex steps."""
    steps = 1e-30j * np.eye(len(functions))
    slopes = [np.stack([own(places + step).imag / 1e-30 for step in steps], axis=-1) for own in functions]
    return np.stack(slopes, axis=1)


def in_order(values):
    return sorted(values, key=lambda z: np.round([z.real, z.imag], 6).tolist())


@pytest.mark.parametrize("seed", range(4))
def test_indices_add_up_to_the_winding_number(seed):
    functions = random_field(2, 4, seed)
    found = critical_points(data(grid(Shape.TRIANGLE, 2), functions, 5))
    s = np.linspace(0, 1, 4001)
    border = np.concatenate(
        [np.stack(side, axis=1) for side in ((s, 0 * s), (1 + 0 * s, s), (s[::-1], 1 + 0 * s), (0 * s, s[::-1]))]
    )
    angles = np.unwrap(np.arctan2(functions[1](border), functions[0](border)))
    assert sum(point.index for point in found.points) == round((angles[-1] - angles[0]) / (2 * np.pi))


@pytest.mark.parametrize("shape", Shape.of_dimension(3))
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.sampled(least=3, free=("shape", "seed"))
def test_indices_in_space_add_up_to_the_degree_on_the_border(shape, seed):
    """How often directions on the cube's surface cover the sphere: solid angles of triangles.

    Van Oosterom and Strackee, IEEE Trans. Biomed. Eng. BME-30, 1983.
    """
    functions = random_field(3, 2, seed)
    s = np.linspace(0, 1, 61)
    p, q = (own.reshape(-1) for own in np.meshgrid(s, s, indexing="ij"))
    square = np.arange(61 * 61).reshape(61, 61)
    a, b, c, d = (own.reshape(-1) for own in (square[:-1, :-1], square[1:, :-1], square[1:, 1:], square[:-1, 1:]))
    total = 0.0
    for axis in range(3):
        for end in (0.0, 1.0):
            places = np.insert(np.stack([p, q], axis=1)[:, :: 1 if axis != 1 else -1], axis, end, axis=1)
            vectors = np.stack([own(places) for own in functions], axis=1)
            vectors /= np.linalg.norm(vectors, axis=1)[:, None]
            for corners in ((a, b, c), (a, c, d)):
                one, two, three = (vectors[own] for own in corners)
                volume = np.einsum("ni,ni->n", one, np.cross(two, three))
                dots = [(u * v).sum(axis=1) for u, v in ((one, two), (two, three), (three, one))]
                total += (2 * end - 1) * 2 * np.arctan2(volume, 1 + sum(dots)).sum()
    degree = total / (4 * np.pi)
    assert degree == pytest.approx(round(degree), abs=1e-9)
    found = critical_points(data(grid(shape, 1), functions))
    assert sum(point.index for point in found.points) == round(degree)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_zero_at_a_vertex_is_found_once(shape):
    d = shape.dimension
    functions = [lambda p, a=a: (1 + a) * (p[:, a] - 0.5) + 0.3 * (p[:, (a + 1) % d] - 0.5) for a in range(d)]
    found = critical_points(data(grid(shape, 2), functions))
    assert [(point.kind, point.index) for point in found.points] == [("node out", 1)]
    assert found.points[0].position[:d] == pytest.approx([0.5] * d, abs=1e-12)
    assert found.undecided == found.near_boundary == ()


@pytest.mark.parametrize(
    ("matrix", "kind", "index"),
    [
        ([[1, 0], [0, 2]], "node out", 1),
        ([[-1, 0.5], [0, -2]], "node in", 1),
        ([[1, 0], [0, -2]], "saddle", -1),
        ([[-1, 3], [-3, -1]], "spiral in", 1),
        ([[1, 3], [-3, 1]], "spiral out", 1),
        ([[0, 3], [-1, 0]], "centre", 1),
        ([[1, 3, 0], [-3, 1, 0], [0, 0, -1]], "spiral saddle", -1),
        ([[1, 0, 0], [0, 1, 0.5], [0, 0, -1]], "saddle", -1),
        ([[-1, 3, 0], [-3, -1, 0], [0, 0, -1]], "spiral in", -1),
    ],
)
def test_kinds(matrix, kind, index):
    d = len(matrix)
    centre = np.array([0.41, 0.37, 0.29])[:d]
    functions = [lambda p, row=row: (p[:, :d] - centre) @ np.array(row, float) for row in matrix]
    mesh = curved(grid(Shape.TRIANGLE if d == 2 else Shape.PRISM, 1), ripple(0.02), 3)
    (point,) = critical_points(data(mesh, functions, 4)).points
    assert (point.kind, point.index) == (kind, index)
    assert point.position[:d] == pytest.approx(centre, abs=1e-12)
    order = [
        sorted(own, key=lambda z: np.round([z.imag, z.real], 6).tolist())
        for own in (point.eigenvalues, np.linalg.eigvals(matrix))
    ]
    assert order[0] == pytest.approx(order[1], abs=1e-9)


@pytest.mark.parametrize("share", [0.99e-9, 1.01e-9])
def test_parts_of_eigenvalues_count_from_a_billionth_of_the_largest(share):
    def kind(*matrix):
        return classified(np.array(matrix), np.zeros(3), 0).kind

    counts = share > 1e-9
    assert kind([7.0, 0.0], [0.0, 7 * share]) == ("node out" if counts else "degenerate")
    assert kind([7 * share, -7.0], [7.0, 7 * share]) == ("spiral out" if counts else "centre")
    assert kind([7.0, -7 * share], [7 * share, 7.0]) == ("spiral out" if counts else "node out")


@pytest.mark.parametrize("shape", [Shape.QUADRILATERAL, Shape.TRIANGLE])
def test_a_cavity_with_walls_has_one_centre(shape):
    """From the stream function (x(1-x)y(1-y))^2, whose velocity is zero on all walls."""

    def bump(s):
        return (s * (1 - s)) ** 2

    def slope(s):
        return 2 * s * (1 - s) * (1 - 2 * s)

    functions = [lambda p: bump(p[:, 0]) * slope(p[:, 1]), lambda p: -slope(p[:, 0]) * bump(p[:, 1])]
    found = critical_points(data(grid(shape, 1), functions, 8))
    assert [(point.kind, point.index) for point in found.points] == [("centre", 1)]
    assert found.points[0].position == pytest.approx((0.5, 0.5, 0), abs=1e-10)
    assert found.undecided == ()


def test_a_line_of_zeros_is_undecided():
    found = critical_points(data(grid(Shape.QUADRILATERAL, 3), [lambda p: p[:, 0] - 0.47, lambda p: 0.47 - p[:, 0]]))
    assert found.points == ()
    assert found.undecided == (1, 4, 7)


def test_momenta_and_components_that_are_given():
    functions = [lambda p: 2 + p[:, 0], lambda p: p[:, 0] - 0.3, lambda p: 0.2 - p[:, 1]]
    dataset = data(mixed_plane(1), functions, names=("rho", "rhou", "rhov"))
    for velocity in (None, ["rhou", "rhov"]):
        (point,) = critical_points(dataset, velocity).points
        assert point.position == pytest.approx((0.3, 0.2, 0), abs=1e-13)
        assert point.eigenvalues == pytest.approx(
            [-1 / (1 if velocity else 2.3), 1 / (1 if velocity else 2.3)], abs=1e-11
        )
    with pytest.raises(ElvisError, match="expected a component that is zero where a polynomial"):
        critical_points(dataset, ["sin(rhou)", "rhov"])


def hill(points):
    """The floor z = b(x, y) of the flows below, and its gradient (n, 2)."""
    x, y = points[:, 0] - 0.4, points[:, 1] - 0.7
    return 0.3 * x * x - 0.2 * x * y, np.stack([0.6 * x - 0.2 * y, -0.2 * x], axis=1)


def above_floor(shape, functions, bend):
    """A flow at rest on the floor z = bend b, whose shear there is (q1, q2) for functions q seen from above."""

    def lifted(points):
        return points + np.outer(bend * hill(points)[0], [0, 0, 1])

    def component(k):
        def along(p):
            if k < 2:
                return functions[k](p)
            return bend * sum(own(p) * slope for own, slope in zip(functions, hill(p)[1].T, strict=True))

        return lambda p: (p[:, 2] - bend * hill(p)[0]) * along(p)

    flat = grid(shape, 1)
    parts = []
    for side in (Shape.TRIANGLE, Shape.QUADRILATERAL):
        if len(flat.of(side)):
            low = (flat.vertices[local_vertices(flat, side), 2] == 0).all(axis=1)
            parts.append(("F", flat.of(side).ids[low]))
    floor = Composite(7, tuple(parts), "floor")
    mesh = replace(curved(flat, lifted, 3) if bend else flat, composites=(*flat.composites, floor))
    return data(mesh, [component(k) for k in range(3)], 5)


@pytest.mark.parametrize("shape", Shape.of_dimension(3))
@pytest.mark.parametrize("bend", [0.0, 1.0])
@pytest.mark.parametrize("seed", range(20))
@pytest.mark.sampled(least=6, free=("seed",))
def test_all_on_walls_are_found_and_none_is_spurious(shape, bend, seed):
    functions = random_field(2, 2, seed)
    found = wall_points(above_floor(shape, functions, bend), "floor")
    truth = brute_force(functions, 2)
    places = np.array([point.position for point in found.points]).reshape(-1, 3)
    assert found.undecided == ()
    assert len(places) == len(truth)
    for point in found.points:
        place = np.array(point.position)
        assert np.abs(truth - place[:2]).max(axis=1).min() < 1e-10
        height, slope = hill(place[None])
        assert abs(place[2] - bend * height[0]) < 1e-12
        gradient = [[own(place[None] + 1e-30j * axis).imag[0] / 1e-30 for axis in np.eye(3)[:2]] for own in functions]
        rates = np.linalg.eigvals(gradient) * np.sqrt(1 + bend * (slope**2).sum())
        assert sorted(point.eigenvalues, key=lambda z: (z.real, z.imag)) == pytest.approx(
            sorted(rates, key=lambda z: (z.real, z.imag)), rel=1e-8
        )
        assert point.kind.split()[0] == ("attachment" if np.trace(gradient) > 0 else "separation")
        assert point.index == np.sign(np.linalg.det(gradient))


#: the squares of a cube with corners x + 2 y + 4 z, seen from outside anticlockwise
SQUARES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]


@pytest.fixture(scope="module")
def around_a_ball():
    """Six hexahedra about a ball, whose wall is within 2e-3 of a sphere, and a field h that is zero on it alone.

    Between cubes h is the distance by the largest coordinate, linear in each element; elements are curved with it.
    """
    inner = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float)
    elements = np.array([[*square, *[k + 8 for k in square]] for square in SQUARES])
    flat = connected(np.concatenate([inner, 1.8 * inner]), {Shape.HEXAHEDRON: elements}, 3)
    height = approximated(Dataset(flat), "h", lambda p: np.abs(p).max(axis=1) - 1, 2)

    def rounded(p):
        return p * (np.abs(p).max(axis=1) / np.linalg.norm(p, axis=1))[:, None]

    squares = flat.of(Shape.QUADRILATERAL)
    low = (np.abs(flat.vertices[local_vertices(flat, Shape.QUADRILATERAL)]).max(axis=2) == 1).all(axis=1)
    ball = Composite(7, (("F", squares.ids[low]),), "ball")
    mesh = curved(flat, rounded, 8)
    return Dataset(replace(mesh, composites=(*mesh.composites, ball)), (height,))


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.sampled(least=4, free=("seed",))
def test_indices_on_a_ball_add_up_to_two(around_a_ball, seed):
    """The theorem of Poincare and Hopf, for the shear of h times a random linear velocity; points as on the sphere."""
    rng = np.random.default_rng(seed)
    matrix, shift = rng.normal(size=(3, 3)), rng.normal(size=3)
    rows = [[f"({weight!r})*{x}" for weight, x in zip(own, "xyz", strict=True)] for own in matrix.tolist()]
    velocity = [f"h*({'+'.join(own)}+({by!r}))" for own, by in zip(rows, shift.tolist(), strict=True)]
    found = wall_points(around_a_ball, "ball", velocity)
    assert found.undecided == ()
    assert sum(point.index for point in found.points) == 2
    for point in found.points:
        place = np.array(point.position)
        vector = matrix @ place + shift
        off = np.linalg.norm(np.cross(vector, place / np.linalg.norm(place)))
        assert off < 0.02 * np.linalg.norm(vector)


def test_a_cavity_has_one_point_on_its_floor():
    """Shear x(1-x) y(1-y) times a focus: along the edges of the floor, where walls meet, it is zero, too."""
    functions = [
        lambda p: p[:, 0] * (1 - p[:, 0]) * p[:, 1] * (1 - p[:, 1]) * (0.4 - p[:, 0] - 2 * (p[:, 1] - 0.6)),
        lambda p: p[:, 0] * (1 - p[:, 0]) * p[:, 1] * (1 - p[:, 1]) * (0.6 - p[:, 1] + 2 * (p[:, 0] - 0.4)),
    ]
    dataset = above_floor(Shape.HEXAHEDRON, functions, 0.0)
    fields = [lambda p, own=own: p[:, 2] * own(p) for own in functions] + [lambda p: 0 * p[:, 0]]
    (point,) = wall_points(data(dataset.mesh, fields, 5), "floor").points
    assert (point.kind, point.index) == ("separation focus", 1)
    assert point.position == pytest.approx((0.4, 0.6, 0), abs=1e-10)


def test_slip_at_walls_is_reported():
    dataset = data(grid(Shape.PRISM, 1), [lambda p: 1 + p[:, 0], lambda p: p[:, 1], lambda p: p[:, 2]])
    with pytest.raises(ElvisError, match="zero on the wall all, found"):
        wall_points(dataset, "all")
    with pytest.raises(ElvisError, match="expected 3D data"):
        wall_points(data(mixed_plane(1), [lambda p: p[:, 0], lambda p: p[:, 1]]), "all")
