"""Predefined quantities of polynomial flows on curved elements of every shape: sympy, NumPy and a device agree."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sympy

from elvis import Dataset
from elvis.core.mapping.projections import rule
from elvis.core.numbers.mesh_quality import mesh_quality
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Evaluator, Sampler
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, ripple, scattered
from elvis.plugins.runtime.serving import volume_of

X = sympy.symbols("x y z")
#: a vortex whose middle eigenvalues are apart, of second degree in the world
FLOWS = {
    3: ("x*y - z**2 + 2*y", "-3*x + y*z/2 + x**2", "z*x - y/2 + z/3"),
    2: ("x*y - 3*y + x**2/2", "2*x + y**2 - x*y/4"),
}
#: Taylor polynomials of third degree of the vortices below: none of the quantities is constant
SERIES = {
    "taylor_green": ("x - x**3/6 - x*y**2/2 - x*z**2/2", "-y + y**3/6 + x**2*y/2 + y*z**2/2", "0"),
    "abc": ("z - z**3/6 + 2 - y**2", "x - x**3/6 + 1 - z**2/2", "2*y - y**3/3 + 1 - x**2/2"),
    "burgers": ("-x/2 - y + y*(x**2 + y**2)/2", "-y/2 + x - x*(x**2 + y**2)/2", "z"),
}
#: digits of fits of the fields are lost to derivatives
TOLERANCE = 2e-9


def bent(points):
    """Bent to the second degree, in the plane where the points are."""
    x, y, z = points.T
    return points + np.stack([0.05 * y**2, 0.1 * x * y, 0.08 * z * (x + z)], axis=1)


@cache
def flow(dimension, of="quadratic"):
    """The fields on elements of every shape, whose map is of degree 2: those of `velocities`."""
    mesh = mixed_volume(seed=3) if dimension == 3 else mixed_plane(seed=3)
    dataset = Dataset(curved(mesh, bent, n=3))
    fields, modes = [], 5 if of == "quadratic" else 7
    for name, part in zip("uvw", velocities(dimension, of), strict=True):
        rule = sympy.lambdify(X, part, "numpy")
        fields.append(approximated(dataset, name, lambda p, rule=rule: rule(*p.T) + 0 * p[:, 0], modes))
    return replace(dataset, fields=tuple(fields[:dimension]))


def velocities(dimension, of):
    """The components of a flow."""
    parts = FLOWS[dimension] if of == "quadratic" else SERIES[of]
    return [sympy.sympify(text) for text in (*parts, *["0"] * (3 - dimension))]


def gradient(velocity):
    """(3, 3) derivatives of the velocity (rows), along x, y and z, as sympy gives them."""
    return sympy.Matrix(velocity), sympy.Matrix(3, 3, lambda i, j: sympy.diff(velocity[i], X[j]))


def truths(dimension, world, of="quadratic"):
    """Quantities (n,) at world points (n, 3): derivatives by sympy, eigenvalues by LAPACK of general matrices."""
    u, a = gradient(velocities(dimension, of))
    number = lambda part: sympy.lambdify(X, part, "numpy")(*world.T) + 0 * world[:, 0]  # noqa: E731
    table = np.stack([np.stack([number(a[i, j]) for j in range(3)], axis=1) for i in range(3)], axis=1)
    strain, spin = (a + a.T) / 2, (a - a.T) / 2
    turning = sympy.Matrix([a[2, 1] - a[1, 2], a[0, 2] - a[2, 0], a[1, 0] - a[0, 1]])
    s, omega = ((table + sign * table.transpose(0, 2, 1)) / 2 for sign in (1, -1))
    found = {
        "divergence": number(a.trace()),
        "vorticity_z": number(turning[2]),
        "strain_xx": number(strain[0, 0]),
        "strain_xy": number(strain[0, 1]),
        "strain_yy": number(strain[1, 1]),
        "strain_rate": np.sqrt(number(2 * sum(x * x for x in strain))),
        "q_criterion": number((sum(x * x for x in spin) - sum(x * x for x in strain)) / 2),
        "q_invariant": number((a.trace() ** 2 - (a * a).trace()) / 2),
        "q_deviatoric": number(-((a - a.trace() / 3 * sympy.eye(3)) ** 2).trace() / 2),
        "lambda2": np.linalg.eigvalsh(s @ s + omega @ omega)[:, 1],
        "swirl": np.abs(np.linalg.eigvals(table).imag).max(axis=1),
    }
    if dimension == 2:
        return found | {"vorticity": found["vorticity_z"]}
    helicity, length, speed = (number(part) for part in (u.dot(turning), turning.dot(turning), u.dot(u)))
    return found | {
        "vorticity": np.sqrt(length),
        "vorticity_x": number(turning[0]),
        "vorticity_y": number(turning[1]),
        "strain_xz": number(strain[0, 2]),
        "strain_yz": number(strain[1, 2]),
        "strain_zz": number(strain[2, 2]),
        "helicity": helicity,
        "normalised_helicity": helicity / np.sqrt(length * speed),
        "r_invariant": -number(a.det()),
    }


def places(patch, count=40):
    """Rows, reference points away from the tips of pyramids, and world points."""
    from elvis.core.mapping.pointwise import positions

    middle = patch.shape.vertices.mean(axis=0)
    reference = middle + 0.9 * (scattered(patch.shape, count, seed=1) - middle)
    if patch.shape is Shape.PYRAMID:
        reference = reference[reference[:, 2] < 0.7]
    rows = np.resize(np.arange(len(patch)), len(reference))
    return rows, reference, positions(patch, rows, reference)


@pytest.mark.parametrize(("dimension", "of"), [(2, "quadratic"), (3, "quadratic"), *((3, of) for of in SERIES)])
def test_quantities_on_curved_elements_match_sympy(dimension, of):
    dataset, shapes, swirling = flow(dimension, of), set(), []
    names = list(truths(dimension, np.ones((1, 3)), of))
    expressions = {name: Expression.of(dataset, name) for name in names}
    evaluator = Evaluator(dataset, list(expressions.values()))
    for patch in evaluator.patches:
        rows, reference, world = places(patch)
        shapes.add(patch.shape)
        for name, truth in truths(dimension, world, of).items():
            found = evaluator.values(expressions[name], patch, rows, reference)
            assert np.abs(found - truth).max() < TOLERANCE * max(1, np.abs(truth).max()), (name, patch.shape)
            swirling += [truth > 0.1] if name == "swirl" else []
    assert shapes == set(Shape.of_dimension(dimension))
    assert np.concatenate(swirling).mean() > 0.2


def burgers():
    """A vortex along z in a strain of rate 1, of circulation 2 pi: plane eigenvalues meet where it only turns."""
    x, y, z = X
    r2 = x**2 + y**2
    turn = (1 - sympy.exp(-r2)) / r2
    return -x / 2 - y * turn, -y / 2 + x * turn, z


VORTICES = {
    "taylor_green": (
        sympy.sin(X[0]) * sympy.cos(X[1]) * sympy.cos(X[2]),
        -sympy.cos(X[0]) * sympy.sin(X[1]) * sympy.cos(X[2]),
        0,
    ),
    "abc": (
        sympy.sin(X[2]) + 2 * sympy.cos(X[1]),
        sympy.sin(X[0]) + sympy.cos(X[2]),
        2 * sympy.sin(X[1]) + sympy.cos(X[0]),
    ),
    "burgers": burgers(),
}


@pytest.mark.parametrize("vortex", VORTICES)
def test_vortices_that_are_known_have_their_closed_forms(monkeypatch, vortex):
    """Approximated to 1e-9 on one box, off the axis; ABC flows are their own rotation."""
    velocity = [sympy.sympify(part) for part in VORTICES[vortex]]
    monkeypatch.setattr(f"{__name__}.velocities", lambda dimension, of: velocity)
    mesh = grid(Shape.HEXAHEDRON, 1)
    dataset = Dataset(replace(mesh, vertices=0.5 * mesh.vertices + [0.3, 0.2, 0.1]))
    rules = {name: sympy.lambdify(X, part, "numpy") for name, part in zip("uvw", velocity, strict=True)}
    fields = [approximated(dataset, name, lambda p, r=rule: r(*p.T) + 0 * p[:, 0], 12) for name, rule in rules.items()]
    dataset = replace(dataset, fields=tuple(fields))
    names = ("lambda2", "swirl", "q_criterion", "vorticity", "strain_rate", "normalised_helicity")
    evaluator = Evaluator(dataset, [Expression.of(dataset, name) for name in names])
    (patch,) = evaluator.patches
    rows, reference, world = places(patch)
    truth = truths(3, world)
    if vortex == "abc":
        assert np.abs(truth["normalised_helicity"] - 1).max() < 1e-12
    for expression in evaluator.expressions:
        found = evaluator.values(expression, patch, rows, reference)
        assert np.abs(found - truth[expression.text]).max() < 1e-6, expression.text
    assert vortex != "burgers" or (truth["swirl"] > 0.1).all()


ON_DEVICES = ("lambda2", "swirl + strain_rate", "q_deviatoric*vorticity")


@cache
def volume(dimension):
    return volume_of(flow(dimension), list(ON_DEVICES))


@pytest.mark.sampled
@pytest.mark.parametrize("text", ON_DEVICES)
@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1], ids=lambda shape: shape.label)
def test_a_device_matches_numpy(renderer, shape, text):
    dimension, drawing = shape.dimension, renderer("vulkan")
    parts = volume(dimension).parts
    drawing.show(volume(dimension))
    expression = Expression.of(flow(dimension), text)
    (number,) = (k for k, part in enumerate(parts) if part.solve.patches[0].shape is shape)
    part = parts[number]
    rows, reference, _ = places(part.solve.patches[0])
    rows, points = np.resize(np.arange(len(part)), len(rows)), np.zeros((len(rows), 3))
    points[:, :dimension] = reference
    centre = drawing.sample_elements(number, rows[:1], points[:1], text).center
    found = drawing.sample_elements(number, rows, points - centre, text).value
    truth = Evaluator(flow(dimension), [expression]).at(expression, part.element_ids[rows], points)
    assert np.abs(found - truth).max() < 1e-11 * np.abs(truth).max()


def test_the_cfl_number_is_the_time_step_over_that_of_the_mesh_quality():
    """In closed form on squares of side 1/2 with u = 3, order 2: 0.2 p^2 dt u 2/h; else the largest in each element."""
    bare = Dataset(grid(Shape.QUADRILATERAL, 2))
    functions = {"u": lambda p: 3 + 0 * p[:, 0], "v": lambda p: p[:, 0]}
    data = replace(bare, fields=tuple(approximated(bare, name, own, 3) for name, own in functions.items()))
    found = Sampler(data, [Expression.of(data, "cfl(dt=0.5)")]).sample(np.array([[0.2, 0.7, 0.0], [0.9, 0.1, 0.0]]))
    assert found.values[:, 0] == pytest.approx([0.2 * 4 * 0.5 * 3 * 4] * 2, rel=1e-12)

    solid = Dataset(curved(mixed_volume(seed=3), ripple(0.05), 3))
    rules = {"u": lambda p: p[:, 1], "v": lambda p: p[:, 0] - p[:, 2], "w": lambda p: 1 + 0 * p[:, 0]}
    data = replace(solid, fields=tuple(approximated(solid, name, own, 3) for name, own in rules.items()))
    measures = mesh_quality(data)
    evaluator = Evaluator(data, [Expression.of(data, "cfl(dt=2)")])
    for patch in evaluator.patches:
        points = rule(patch.shape, max(patch.geometry.modes) + 2)[0]
        rows = np.repeat(np.arange(len(patch)), len(points))
        own = evaluator.values(evaluator.expressions[0], patch, rows, np.tile(points, (len(patch), 1)))
        steps = measures.measures["time_step"][np.isin(measures.element_ids, patch.element_ids)]
        assert own.reshape(len(patch), -1).max(axis=1) == pytest.approx(2 / steps, rel=1e-12)
