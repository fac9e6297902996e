"""Quantities on walls: normals, shear, friction, y+ against closed forms, on straight and on curved sides."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset
from elvis.core.mapping.pointwise import positions
from elvis.core.quantities import Expression
from elvis.core.quantities.elements.sides import NEAR, places_on_sides
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, ripple
from elvis.plugins.runtime.serving import volume_of

VISCOSITY, RADIUS = 0.04, 2.0


def with_fields(mesh, order=7, metadata=None, **rules):
    dataset = Dataset(mesh, metadata=metadata or {})
    fields = (
        approximated(dataset, name, lambda p, rule=rule: rule(*p.T) + 0 * p[:, 0], order)
        for name, rule in rules.items()
    )
    return replace(dataset, fields=tuple(fields))


def on_sides(dataset, texts, chosen=lambda world: world[:, 0] < np.inf):
    """World points (n, 3) on sides of elements, where ``chosen`` says so, and quantities (n,) there by their text."""
    expressions = [Expression.of(dataset, text) for text in texts]
    evaluator = Evaluator(dataset, expressions)
    found, world = [[] for _ in texts], []
    for patch in evaluator.patches:
        reference = np.tile(places_on_sides(patch.shape), (len(patch), 1))
        rows = np.repeat(np.arange(len(patch)), len(reference) // len(patch))
        points = positions(patch, rows, reference)
        here = chosen(points)
        world.append(points[here])
        for values, expression in zip(found, expressions, strict=True):
            values.append(evaluator.values(expression, patch, rows[here], reference[here]))
    return np.concatenate(world), dict(zip(texts, map(np.concatenate, found), strict=True))


def rolled(points):
    """A box as a part of a ring around the z axis, from RADIUS outwards: its inner wall is curved."""
    x, y, z = points.T
    radius = RADIUS + y
    return np.stack([radius * np.sin(x / 2), radius * np.cos(x / 2), z], axis=1)


@pytest.mark.parametrize("shape", Shape.of_dimension(3))
def test_normals_point_out_of_elements_and_exist_only_on_sides(shape):
    """A box around the origin: on its border the normal is that of the box, and the height that of the layer."""
    dataset = Dataset(grid(shape, 2))
    world, found = on_sides(dataset, ("nx", "ny", "nz"), lambda p: (np.abs(p - 0.5) > 0.4999999).sum(axis=1) == 1)
    normals = np.stack([found[name] for name in ("nx", "ny", "nz")], axis=1)
    offset = world - 0.5
    truth = np.where(np.abs(offset) > 0.4999999, np.sign(offset), 0.0)
    assert len(world) > 20
    assert np.abs(normals - truth).max() < 1e-12
    expression = Expression.of(dataset, "nx")
    evaluator = Evaluator(dataset, [expression])
    (patch,) = evaluator.patches
    middle = shape.vertices.mean(axis=0, keepdims=True)
    assert np.isnan(evaluator.values(expression, patch, np.zeros(1, int), middle)).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_shear_of_couette_flow_on_a_straight_wall(dimension):
    """u = s y: the flow pulls the wall at y = 0 along x with mu s, whatever the pressure."""
    mesh = mixed_volume(seed=1) if dimension == 3 else mixed_plane(seed=1)
    zero = {"w": lambda x, y, z: 0 * x} if dimension == 3 else {}
    rules = {"u": lambda x, y, z: 3 * y, "v": lambda x, y, z: 0 * x, **zero, "p": lambda x, y, z: x}
    dataset = with_fields(mesh, 4, **rules)
    texts = [f"{name}(mu=0.5)" for name in ("wall_shear", "wall_shear_x", "wall_shear_y", "y_plus")]
    _, found = on_sides(dataset, ["ny", "face_height", *texts], lambda p: np.abs(p[:, 1]) < 1e-12)
    low = found["ny"] < -0.99
    assert low.sum() > 3
    assert np.abs(found["wall_shear(mu=0.5)"][low] - 1.5).max() < 1e-10
    assert np.abs(found["wall_shear_x(mu=0.5)"][low] - 1.5).max() < 1e-10
    assert np.abs(found["wall_shear_y(mu=0.5)"][low]).max() < 1e-10
    # u+ = y+ here: the height times the friction velocity sqrt(1.5), over nu = 0.5
    truth = found["face_height"] * np.sqrt(1.5) / 0.5
    assert np.abs(found["y_plus(mu=0.5)"] - truth)[low].max() < 1e-10


def test_shear_of_poiseuille_flow_and_its_y_plus():
    """u = 4 y (1 - y) on layers of height 1/4: mu du/dy = 4 mu at both walls, and y+ = u_tau / (4 nu)."""
    mesh = grid(Shape.HEXAHEDRON, 4)
    rules = {"u": lambda x, y, z: 4 * y * (1 - y), "v": lambda x, y, z: 0 * x, "w": lambda x, y, z: 0 * x}
    dataset = with_fields(mesh, 4, {"Kinvis": repr(VISCOSITY)}, **rules)
    friction = "skin_friction_x(rho_ref=1, u_ref=2)"
    _, found = on_sides(dataset, ("wall_shear_x", "y_plus", friction), lambda p: np.abs(p[:, 1] - 0.5) == 0.5)
    inner = np.abs(found["wall_shear_x"]) > 1e-9  # sides that meet the wall at right angles are none
    assert np.abs(found["wall_shear_x"][inner] - 4 * VISCOSITY).max() < 1e-11
    truth = 0.25 * np.sqrt(4 * VISCOSITY) / VISCOSITY
    assert np.abs(found["y_plus"][inner] - truth).max() < 1e-10
    assert np.abs(found[friction][inner] - 4 * VISCOSITY / 2).max() < 1e-11


@pytest.mark.parametrize(
    "shape", [Shape.QUADRILATERAL, Shape.TRIANGLE, Shape.HEXAHEDRON, Shape.PRISM, Shape.TETRAHEDRON]
)
def test_shear_of_taylor_couette_flow_on_a_curved_wall(shape):
    """u_theta = B / r: the shear on the inner cylinder is mu r d(u_theta / r)/dr = -2 mu B / R^2, against the flow.

    Solid rotation in addition has none.  Map and fields approximate the circle to 1e-7.
    """
    mesh = curved(grid(shape, 2), rolled, n=8)
    swirl = lambda x, y: 1.5 / (x * x + y * y) + 0.3  # noqa: E731
    zero = {"w": lambda x, y, z: 0 * x} if shape.dimension == 3 else {}
    rules = {"u": lambda x, y, z: y * swirl(x, y), "v": lambda x, y, z: -x * swirl(x, y), **zero}
    dataset = with_fields(mesh, 10, **rules)
    inner = lambda p: np.abs(np.hypot(p[:, 0], p[:, 1]) - RADIUS) < 1e-7  # noqa: E731
    world, found = on_sides(dataset, [*(f"wall_shear{end}(mu=2)" for end in ("", "_x", "_y")), "nx", "ny"], inner)
    x, y, _ = world.T
    wall = np.abs(found["nx"] * x + found["ny"] * y + RADIUS) < 1e-4
    assert wall.sum() > 5
    truth = 2 * 2 * 1.5 / RADIUS**2
    assert np.abs(found["wall_shear(mu=2)"] - truth)[wall].max() < 1e-5
    # the flow is clockwise, slower outside: it holds the inner wall back, which is counterclockwise
    assert np.abs(found["wall_shear_x(mu=2)"] + truth * y / RADIUS)[wall].max() < 1e-5
    assert np.abs(found["wall_shear_y(mu=2)"] - truth * x / RADIUS)[wall].max() < 1e-5


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_device_matches_numpy_on_walls(renderer, dimension):
    mesh = curved(mixed_volume(seed=1) if dimension == 3 else mixed_plane(seed=1), ripple(0.02), n=4)
    rng, drawing = np.random.default_rng(2), renderer("vulkan")
    dataset = with_fields(mesh, 4, **{name: lambda x, y, z: 0 * x for name in "uvw"[:dimension]})
    noisy = [replace(b, coefficients=rng.normal(size=b.coefficients.shape)) for f in dataset.fields for b in f.blocks]
    each = len(noisy) // dimension
    fields = (replace(f, blocks=tuple(noisy[k * each : (k + 1) * each])) for k, f in enumerate(dataset.fields))
    dataset = replace(dataset, fields=tuple(fields))
    texts = ["wall_shear_x(mu=2)", "y_plus(nu=0.1)", "nx + 2*ny + x"]
    volume = volume_of(dataset, texts)
    drawing.show(volume)
    expressions = [Expression.of(dataset, text) for text in texts]
    evaluator = Evaluator(dataset, expressions)
    for number, part in enumerate(volume.parts):
        shape = part.solve.patches[0].shape
        places = places_on_sides(shape)
        places = places[places[:, 2] < 0.7] if shape is Shape.PYRAMID else places
        rows, points = np.resize(np.arange(len(part)), len(places)), np.zeros((len(places), 3))
        points[:, :dimension] = places
        points = np.concatenate([points, 0.9 * points])
        rows = np.concatenate([rows, rows])
        centre = drawing.sample_elements(number, rows[:1], points[:1]).center
        for expression in expressions:
            found = drawing.sample_elements(number, rows, points - centre, expression.text).value
            truth = evaluator.at(expression, part.element_ids[rows], points)
            known = np.isfinite(truth)
            assert np.array_equal(known, np.isfinite(found))
            assert known.sum() >= len(places)
            assert np.abs(found - truth)[known].max() < 1e-11 * np.abs(truth[known]).max(), (shape, expression.text)


def test_gradients_near_an_edge_match_those_of_one_side(renderer):
    """nx is 1 on a side of a box, whatever side is nearest to the points that its derivative is made of."""
    drawing = renderer("vulkan")
    drawing.show(volume_of(Dataset(grid(Shape.HEXAHEDRON, 1)), ["nx + 0*x"]))
    points = np.array([[1.0, 1 - 1e-3, 0.0], [1.0, -0.2, 0.999]])
    found = drawing.sample_elements(0, np.zeros(2, int), points, "nx + 0*x")
    assert np.abs(found.value - 1).max() < 1e-14
    assert np.abs(found.gradient).max() < 1e-10
    assert NEAR < 1e-3


def test_heat_flows_out_of_a_square_down_the_temperature():
    """Of T = x + 2 y: -k through the side at x = 1, k through that at x = 0, with k = mu c_p / Pr or as given."""
    bare = Dataset(grid(Shape.QUADRILATERAL, 2))
    temperature = approximated(bare, "T", lambda p: p[:, 0] + 2 * p[:, 1], 2)
    dataset = replace(bare, fields=(temperature,))
    gas = "mu=0.5, R=2, gamma=1.5, Pr=0.75"
    conductivity = 0.5 * 2 * 1.5 / 0.5 / 0.75
    texts = ["heat_flux(conductivity=3)", f"heat_flux({gas})", "nx", "ny"]
    _, found = on_sides(dataset, texts, lambda p: np.isin(p[:, :2], (0, 1)).any(axis=1))
    along = found["nx"] + 2 * found["ny"]
    assert np.abs(found[texts[0]] + 3 * along).max() < 1e-12
    assert np.abs(found[texts[1]] + conductivity * along).max() < 1e-12


def test_the_friction_velocity_of_a_shear_flow():
    bare = Dataset(grid(Shape.QUADRILATERAL, 1))
    functions = {"u": lambda p: p[:, 1], "v": lambda p: 0 * p[:, 0]}
    dataset = replace(bare, fields=tuple(approximated(bare, name, own, 2) for name, own in functions.items()))
    _, found = on_sides(dataset, ["u_tau(mu=0.5, density=2)"], lambda p: p[:, 1] == 0)
    assert np.abs(found["u_tau(mu=0.5, density=2)"] - 0.5).max() < 1e-12
