"""Expressions: what they mean, their derivatives and predefined quantities against analytic ones on every shape."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, integrate, read
from elvis.core.base.errors import ElvisError
from elvis.core.bounds.bounding import quantity_range
from elvis.core.numbers.norms import quantity_norms
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.evaluator import Evaluator, Sampler
from elvis.core.quantities.functions import FUNCTIONS, OPERATORS
from elvis.core.quantities.tree import MEASURES, leaves, measure_name, measured_of, partial
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, ripple, scattered

#: by order of the derivatives: fits of the fields are off by 1e-12, and derivatives enlarge that
TOLERANCES = (1e-11, 5e-10, 1e-8)

NAMES = Names(("u", "v", "w", "rho", "rho u", "E"), 3, 0.5)


def bent(points):
    """Bent to the second degree, in the plane where the points are."""
    x, y, z = points.T
    return points + np.stack([0.05 * y**2, 0.1 * x * y, 0.08 * z * (x + z)], axis=1)


#: polynomials of the world coordinates, and their gradients
FIELDS = {
    "u": (lambda x, y, z: x * y - z * z + y, lambda x, y, z: (y, x + 1, -2 * z)),
    "v": (lambda x, y, z: x * x + 0.5 * y * z, lambda x, y, z: (2 * x, 0.5 * z, 0.5 * y)),
    "w": (lambda x, y, z: z * x - 2 * y, lambda x, y, z: (z, -2 + 0 * x, x)),
}
QUANTITIES = {
    "d(u,x)": lambda x, y, z: y,
    "d(v,x) - d(u,y)": lambda x, y, z: 2 * x - x - 1,
    "d(u*v, y)": lambda x, y, z: (x + 1) * (x * x + 0.5 * y * z) + (x * y - z * z + y) * 0.5 * z,
    "d(sin(x*v), x)": lambda x, y, z: np.cos(x * (x * x + 0.5 * y * z)) * (3 * x * x + 0.5 * y * z),
    "d(d(u,x),y) + 3*d(d(v,x),x)": lambda x, y, z: 7 + 0 * x,
    "speed": lambda x, y, z: np.sqrt(sum(f(x, y, z) ** 2 for f, _ in FIELDS.values())),
}
SOLID = {
    "divergence": lambda x, y, z: y + 0.5 * z + x,
    "vorticity_x": lambda x, y, z: -2 - 0.5 * y,
    "vorticity_y": lambda x, y, z: -2 * z - z,
    "vorticity": lambda x, y, z: np.sqrt((2 + 0.5 * y) ** 2 + 9 * z * z + (x - 1) ** 2),
    "q_criterion": lambda x, y, z: (
        -0.5 * (y * y + 0.25 * z * z + x * x + 2 * ((x + 1) * 2 * x - 2 * z * z - 0.5 * y * 2))
    ),
    "laplacian(u) + laplacian(w*w)": lambda x, y, z: -2 + 2 * (z * z + 4 + x * x) + 0 * x,
    "grad(w)": lambda x, y, z: np.sqrt(z * z + 4 + x * x),
}


def flowing(mesh):
    """The fields on a mesh curved to the second degree: of degree 4 in the reference coordinates."""
    dataset = Dataset(mesh)
    fields = [approximated(dataset, name, lambda p, f=f: f(*p.T), 5) for name, (f, _) in FIELDS.items()]
    return replace(dataset, fields=tuple(fields), time=0.5)


MESHES = {
    "solid": curved(mixed_volume(seed=3), bent, n=3),
    "plane": curved(mixed_plane(seed=3), bent, n=3),
}


def places(evaluator, count=50):
    """Patches with rows, reference points away from where pyramids end, and world points."""
    from elvis.core.mapping.pointwise import positions

    for patch in evaluator.patches:
        reference = scattered(patch.shape, count)
        if patch.shape is Shape.PYRAMID:
            reference = reference[reference[:, 2] < 0.7]
        rows = np.resize(np.arange(len(patch)), len(reference))
        yield patch, rows, reference, positions(patch, rows, reference)


@pytest.mark.parametrize("kind", MESHES)
def test_expressions_and_their_derivatives_are_closed_forms(kind):
    dataset, shapes = flowing(MESHES[kind]), set()
    closed = QUANTITIES | (SOLID if kind == "solid" else {})
    if kind == "plane":
        closed = {name: rule for name, rule in closed.items() if name != "speed"}
    expressions = {name: Expression.of(dataset, name) for name in closed}
    evaluator = Evaluator(dataset, list(expressions.values()))
    for patch, rows, reference, world in places(evaluator):
        shapes.add(patch.shape)
        for name, rule in closed.items():
            truth = rule(*world.T)
            found = evaluator.values(expressions[name], patch, rows, reference)
            tolerance = TOLERANCES[expressions[name].order]
            assert np.abs(found - truth).max() < tolerance * max(1, np.abs(truth).max()), (name, patch.shape)
    assert shapes == set(Shape.of_dimension(3 if kind == "solid" else 2))


def test_samples_are_the_values_of_expressions():
    dataset = flowing(MESHES["solid"])
    points = np.random.default_rng(1).uniform(0.1, 0.9, (50, 3)) * [2.5, 1, 1]
    found = Sampler(dataset, [Expression.of(dataset, text) for text in ("q_criterion", "t*u", "element")]).sample(
        points
    )
    x, y, z = points.T
    assert found.names == ("q_criterion", "t*u", "element")
    assert np.abs(found.values[:, 0] - SOLID["q_criterion"](x, y, z)).max() < 1e-9
    assert np.abs(found.values[:, 1] - 0.5 * FIELDS["u"][0](x, y, z)).max() < 1e-11
    assert np.array_equal(found.values[:, 2], found.location.element_id)


def test_gases_are_the_closed_forms_of_their_state():
    """Velocity from momentum, pressure from energy, with the ratio of heats that the metadata tell."""
    mesh = grid(Shape.HEXAHEDRON, 1)
    state = {"rho": lambda p: 1 + p[:, 0], "E": lambda p: 5 + p[:, 2]}
    state |= {name: lambda p, k=k: k + p[:, 1] for k, name in enumerate(("rhou", "rhov", "rhow"))}
    fields = tuple(approximated(Dataset(mesh), name, rule, 3) for name, rule in state.items())
    dataset = Dataset(mesh, fields, metadata={"Gamma": "1.3"})
    points = np.random.default_rng(1).uniform(0, 1, (20, 3))
    rho, energy = state["rho"](points), state["E"](points)
    squares = sum(state[name](points) ** 2 for name in ("rhou", "rhov", "rhow"))
    pressure = 0.3 * (energy - squares / (2 * rho))
    truth = {"speed": np.sqrt(squares) / rho, "pressure": pressure, "schlieren": 1 + 0 * rho}
    truth["mach"] = truth["speed"] / np.sqrt(1.3 * pressure / rho)
    for name, values in truth.items():
        found = Sampler(dataset, [Expression.of(dataset, name)]).sample(points).values[:, 0]
        assert np.abs(found - values).max() < 1e-11, name


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-2^2", -4.0),
        ("2^3^2", 512.0),
        ("2^-1", 0.5),
        ("1-2-3", -4.0),
        ("8/4/2", 1.0),
        ("--x", 3.0),
        ("2*-y", 10.0),
        ("max(x, min(y, z)) + 1.5e1", 18.0),
        ("pi - e + abs(y)", np.pi - np.e + 5),
        (".5*(x+1.)", 2.0),
        ("pow(x, 2) + sign(y)", 8.0),
        ("atan2(y, x) - atan(y/x)", 0.0),
        ("sin(asin(0.3)) + cos(acos(0.2))", 0.5),
        ("1/(x-3)", np.nan),
        ("sqrt(y)", np.nan),
        ("log(0*x)", np.nan),
        ("(x-3)^-1", np.nan),
        ("0*z", 0.0),
        ("d(x^3*y, x)", -135.0),
        ("d(tanh(x), x) - (1 - tanh(x)^2)", 0.0),
        ("t*4", 2.0),
        ("step(x) + 10*step(y) + 100*step(0*x)", 1.0),
        ("if(y+6, z, x) + if(y, 0.5, 0.25)", 7.25),
    ],
)
def test_expressions_follow_mathematics(text, value):
    vertices = np.array([[3.0, -5.0, 7.0]]) + 0.25 * Shape.HEXAHEDRON.vertices
    mesh = replace(grid(Shape.HEXAHEDRON, 1), vertices=vertices[[0, 1, 3, 2, 4, 5, 7, 6]])
    dataset = Dataset(mesh, time=0.5)
    found = Sampler(dataset, [Expression.of(dataset, text)]).sample(np.array([[3.0, -5.0, 7.0]])).values[0, 0]
    assert found == pytest.approx(value, rel=1e-14, abs=1e-14, nan_ok=True)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "expected a number, a name or (, found its end"),
        ("sin(x", "expected ) after one operand, found its end"),
        ("x y", "character 3: expected an operator, found 'y'"),
        ("x+", "expected a number, a name or (, found its end"),
        ("2*sin", "character 3: expected ( after sin"),
        ("min(x)", "expected 2 operands, found 1"),
        ("if(x, 1)", "expected 3 operands, found 2"),
        (
            "2*uu",
            "character 3: there is no 'uu' (perhaps u); the fields are u, v, w, rho, rho u, E; there are also x, y, z, "
            "t, pi, e, element, composite, order, h, shape, quality, jacobian, scaled_jacobian, jacobian_sign, nx, ny, "
            "nz, face_height, and what elvis info --quantities lists",
        ),
        ("mach", "mach needs a velocity, rho, and p or E"),
        ("__import__('os')", "there is no function '__import__'; there are abs"),
        ("x.real", "character 2: expected an operator, found '.'"),
        ("u**2", "character 3: expected a number, a name or (, found '*'"),
        ("(" * 99 + "x", "at most 60 levels"),
        ("+".join("x" * 1999), "at most 1000 tokens"),
        ("u + " + "v" * 100_000, "a name of at most 1000 characters for a part of an expression, found 100000: 'vvv"),
        ("1e999", "expected a number of double precision, found 1e999"),
        ("d(u,s)", "expected x, y, z or t, found 's'"),
        ("d(u)", "expected , and a coordinate"),
        ("x+d(d(d(u,x),x),x)", "character 3: expected derivatives of at most second order"),
        ("jump(2*u)", "expected a field in jump"),
        ("d(quality,x)", "there is no derivative of quality"),
        ("d(" * 20 + "tan(x)^tan(x)" + ",x)" * 20, "at most 20000 parts"),
    ],
)
def test_invalid_expressions_give_a_one_line_error(text, sentence):
    with pytest.raises(ElvisError) as error:
        Expression.parse(text, NAMES)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_random_texts_are_expressions_or_rejected():
    words = [
        "u",
        "v",
        "x",
        "t",
        "(",
        ")",
        ",",
        *"+-*/^",
        "sin",
        "d(",
        "grad(",
        "jump",
        "2",
        "1e300",
        "'rho u'",
        '"',
        "speed",
        "é",
        "∂",
    ]
    rng, read = np.random.default_rng(8), 0
    for _ in range(3000):
        try:
            Expression.parse("".join(rng.choice(words, rng.integers(1, 12))), NAMES)
            read += 1
        except ElvisError:
            pass
    assert read > 50


def test_a_field_comes_before_all_else_that_has_its_name():
    names = Names(("x", "a-b", "e", "d", "sin"))
    assert Expression.parse("x + e + d", names).fields == ("x", "e", "d")
    assert Expression.parse("a-b", names).is_field
    assert Expression.parse("2*'a-b'", names).fields == ("a-b",)
    assert Expression.parse("sin*sin(1)", names).fields == ("sin",)
    with pytest.raises(ElvisError, match="the data don't contain the time t"):
        Expression.parse("t", names)


@pytest.mark.parametrize("name", [*FUNCTIONS, *OPERATORS])
def test_derivatives_of_functions_are_their_differences(name):
    """By complex steps where the function takes them, else by central differences, away from kinks."""
    function, letters = {**FUNCTIONS, **OPERATORS}[name], "ghklmn"
    operands = np.random.default_rng(2).uniform(0.2, 0.8, (6, 40))[: function.arity]
    text = f"g{name}h" if name in "+-*/^" else f"{name}({', '.join(letters[: function.arity])})"
    if name == "step":
        return
    root = Expression.parse(text, Names(tuple(letters))).root
    given = dict(zip(letters, operands, strict=False))
    for number, leaf in enumerate(sorted(leaves(root), key=lambda leaf: leaf.name)):
        step = 1e-6
        shifted = [[x + sign * step * (k == number) for k, x in enumerate(operands)] for sign in (1, -1)]
        difference = (function.numpy(*shifted[0]) - function.numpy(*shifted[1])) / (2 * step)
        assert np.abs(evaluated(partial(root, leaf), given) - difference).max() < 1e-8


def evaluated(root, given):
    from elvis.core.quantities.functions import function
    from elvis.core.quantities.tree import fold

    leaf = lambda node: node.value if node.op == "number" else given[node.name]  # noqa: E731
    return fold(root, leaf, lambda node, parts: function(node).numpy(*parts))


# what is known of elements


def test_attributes_match_those_of_straight_elements():
    """A box is stretched by (2, 3, 5): its Jacobian is that of (1, 3/2, 5/2); its corners stay right ones."""
    mesh = grid(Shape.HEXAHEDRON, 1)
    mesh = replace(mesh, vertices=mesh.vertices * [2.0, 3.0, 5.0])
    dataset = Dataset(mesh)
    dataset = replace(dataset, fields=(approximated(dataset, "u", lambda p: p[:, 0], 4),))
    texts = ("element", "order", "shape", "jacobian", "scaled_jacobian", "quality", "jump(u)")
    values = Sampler(dataset, [Expression.of(dataset, text) for text in texts]).sample(np.ones((1, 3))).values[0]
    quality = 3 * (2 * 3 * 5) ** (2 / 3) / (4 + 9 + 25)
    assert np.allclose(values, [0, 3, 6, 30 / 8, 1, quality, 0], rtol=1e-14)


def test_the_sign_of_jacobians_is_the_proved_one():
    mesh = grid(Shape.TETRAHEDRON, 2)
    mesh = replace(mesh, vertices=mesh.vertices * [1.0, 1.0, -1.0])
    points = np.random.default_rng(0).uniform(0.1, 0.9, (20, 3)) * [1.0, 1.0, -1.0]
    values = Sampler(Dataset(mesh), [Expression.of(Dataset(mesh), "jacobian_sign")]).sample(points).values
    assert (values == -1).all()


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 0])
def test_ideal_elements_have_quality_one(shape):
    from elvis.core.mapping.connectivity import connected
    from elvis.core.quantities.attributes import from_ideal

    corners = (shape.vertices + 1) / 2 @ np.linalg.inv(from_ideal(shape)).T
    if shape is Shape.PYRAMID:
        corners[4] = [0.5, 0.5, np.sqrt(0.5)]
    vertices = np.zeros((len(corners), 3))
    vertices[:, : shape.dimension] = corners
    edges = np.linalg.norm(np.subtract(*(vertices[list(end)] for end in zip(*shape.edges, strict=True))), axis=1)
    assert np.allclose(edges, 1)
    dataset = Dataset(connected(vertices, {shape: np.arange(len(corners))[None]}, shape.dimension))
    evaluator = Evaluator(dataset, [Expression.of(dataset, "quality")])
    for patch, rows, reference, _ in places(evaluator, 5):
        values = evaluator.values(evaluator.expressions[0], patch, rows, reference)
        assert np.allclose(values, 1) if shape is not Shape.PYRAMID else (values > 0.9).all()


def test_names_of_measures_contain_their_function_and_field():
    for function in MEASURES:
        assert measured_of(measure_name(function, "rho_e")) == (function, "rho_e")
    assert measured_of("rho_e") is None
    assert measured_of("quality(rho_e)") is None


@pytest.mark.parametrize("kind", [*MESHES, "line"])
def test_jumps_match_those_of_a_field_with_a_constant_in_each_element(kind):
    """x plus a constant jumps by the difference of the constants; a continuous field doesn't jump."""
    mesh = grid(Shape.SEGMENT, 5) if kind == "line" else MESHES[kind]
    dataset = Dataset(mesh)
    field = approximated(dataset, "u", lambda p: p[:, 0], 4)
    ids = np.concatenate([block.element_ids for block in field.blocks])
    values = jump_of(replace(dataset, fields=(field,)), ids)
    assert (values < 1e-10).all()

    rng, shifted, constants = np.random.default_rng(4), [], np.zeros(ids.max() + 1)
    for block in field.blocks:
        constants[block.element_ids] = rng.normal(size=len(block.element_ids))
        ones = approximated(dataset, "one", lambda p: 1 + 0 * p[:, 0], 4)
        one = next(other for other in ones.blocks if other.element_ids[0] == block.element_ids[0])
        by = constants[block.element_ids][:, None]
        shifted.append(replace(block, coefficients=block.coefficients + by * one.coefficients))
    found = jump_of(replace(dataset, fields=(replace(field, blocks=tuple(shifted)),)), ids)
    truth = np.zeros(len(ids))
    for a, b in neighbours(mesh):
        for one, other in ((a, b), (b, a)):
            row = np.flatnonzero(ids == one)[0]
            truth[row] = max(truth[row], abs(constants[one] - constants[other]))
    assert np.abs(found - truth).max() < 1e-10


def jump_of(dataset, ids):
    evaluator = Evaluator(dataset, [Expression.of(dataset, "jump(u)")])
    return evaluator.at(evaluator.expressions[0], ids, np.zeros((len(ids), 3)))


def neighbours(mesh):
    """Pairs of ids of elements that share a side."""
    owners = {}
    for entities in mesh.elements.values():
        for id, members in zip(entities.ids, entities.members, strict=True):
            for member in members:
                owners.setdefault(member, []).append(id)
    return [pair for pair in owners.values() if len(pair) == 2]


# bounds

BOUNDED = (
    "2*u - v",
    "sqrt(u^2+v^2)",
    "d(v,x)-d(u,y)",
    "q_criterion",
    "x*y^3/(4+z)",
    "sin(9*x*y)",
    "jacobian",
    "element",
)


@pytest.mark.sampled
@pytest.mark.parametrize("kind", MESHES)
@pytest.mark.parametrize("text", BOUNDED)
def test_ranges_contain_every_value_and_are_tight(kind, text):
    dataset = flowing(MESHES[kind])
    expression = Expression.of(dataset, text)
    found = quantity_range(dataset, expression)
    evaluator = Evaluator(dataset, [expression])
    for patch, rows, reference, _ in places(evaluator, 300):
        values = evaluator.values(expression, patch, rows, reference)
        assert values.min() >= found.lower - 1e-12
        assert values.max() <= found.upper + 1e-12
    assert found.lower <= found.minimum <= found.maximum <= found.upper
    assert found.upper - found.lower <= 1.1 * (found.maximum - found.minimum)


def test_unbounded_ranges_are_infinite_and_empty_ones_none():
    dataset = flowing(MESHES["plane"])
    assert quantity_range(dataset, Expression.of(dataset, "1/(x-1)")).upper == np.inf
    assert quantity_range(dataset, Expression.of(dataset, "laplacian(u)")).lower == -np.inf
    assert quantity_range(dataset, Expression.of(dataset, "sqrt(-1-u^2)")) is None


def test_ranges_of_functions_with_small_support():
    dataset = Dataset(grid(Shape.HEXAHEDRON, 1))
    found = quantity_range(dataset, Expression.of(dataset, "sqrt(0.03 - (x-0.3)^2 - (y-0.3)^2 - (z-0.3)^2)"))
    assert 0.1 < found.maximum <= found.upper


@pytest.mark.parametrize("name", [*FUNCTIONS, *OPERATORS])
def test_intervals_contain_the_values_of_functions(name):
    function, rng = {**FUNCTIONS, **OPERATORS}[name], np.random.default_rng(6)
    ends = np.sort(rng.normal(size=(6, 500, 2)) * rng.choice([0.3, 1, 4], (1, 500, 1)), axis=2)
    intervals = [(a[:, 0], a[:, 1]) for a in ends][: function.arity]
    powers = (-2.0, -1.0, 0.5, 2.0, 3.0, 2.7) if name in ("^", "pow") else (None,)
    for power in powers:
        if power is not None:
            intervals[1] = (np.float64(power),) * 2
        with np.errstate(all="ignore"):
            low, high = function.interval(*intervals)
            for _ in range(50):
                values = function.numpy(*(a + rng.random(500) * (b - a) for a, b in intervals))
                there = np.isfinite(values)
                assert (values >= low - 1e-12 * np.abs(low))[there].all()
                assert (values <= high + 1e-12 * np.abs(high))[there].all()


# the solver's data

#: printed by FieldConvert's modules vorticity and divergence
PUBLISHED = {
    ("chan3d_tet", "chan3D", "vorticity_x"): 0.0,
    ("chan3d_tet", "chan3D", "vorticity_y"): 3.26599,
    ("chan3d_tet", "chan3D", "vorticity_z"): 0.0,
    ("chan3d_tet", "chan3D", "divergence"): 0.0,
    ("bfs_tq7", "bfs_tg", "vorticity"): 10.8071,
}


@pytest.mark.parametrize("case", PUBLISHED)
def test_norms_of_predefined_quantities_match_published_values(nektar, case):
    folder, name, text = case
    dataset = read(*(nektar / folder / f"{name}.{end}" for end in ("xml", "fld")))
    norm = quantity_norms(dataset, [Expression.of(dataset, text)])[text]
    assert PUBLISHED[case] == (float(f"{norm.l2:.6g}") if norm.l2 > 1e-12 else 0.0)


@pytest.mark.parametrize("case", ["gen_allelem_n4", "gen_allelem_var_h5", "gen_allelem_ortho", "gen_hex_xscale"])
def test_derivatives_of_a_field_of_the_solver_are_closed_forms(nektar, case):
    """v = 1 + x^2 - y z / 2 + x y / 4 was projected by Nektar++ itself; its coefficients are those of the file."""
    dataset = read(*(path for path in sorted((nektar / case).iterdir()) if path.suffix in (".xml", ".fld")))
    closed = {
        "d(v,x)": lambda x, y, z: 2 * x + 0.25 * y,
        "d(v,y) - d(v,z)": lambda x, y, z: -0.5 * z + 0.25 * x + 0.5 * y,
        "laplacian(v)": lambda x, y, z: 2 + 0 * x,
    }
    expressions = [Expression.of(dataset, text) for text in closed]
    evaluator = Evaluator(dataset, expressions)
    for patch, rows, reference, world in places(evaluator, 20):
        for expression, rule in zip(expressions, closed.values(), strict=True):
            error = np.abs(evaluator.values(expression, patch, rows, reference) - rule(*world.T)).max()
            assert error < (1e-7 if expression.order == 2 else 1e-9), (patch.shape, expression.text)


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1])
def test_sizes_and_composites_of_elements(shape):
    """Powers of sizes add up to the measure of curved elements; composites have the ids of the mesh."""
    mesh = curved(grid(shape, 2), ripple(0.04), 3)
    dataset = Dataset(mesh)
    evaluator = Evaluator(dataset, [Expression.of(dataset, text) for text in ("h", "composite")])
    total = 0.0
    for patch in evaluator.patches:
        rows, middle = np.arange(len(patch)), np.zeros((len(patch), shape.dimension))
        size, composite = (evaluator.values(each, patch, rows, middle) for each in evaluator.expressions)
        total += (size**shape.dimension).sum()
        assert set(composite) == {float(mesh.composites[0].id)}
    assert total == pytest.approx(integrate(dataset, "1").value, rel=1e-12)
