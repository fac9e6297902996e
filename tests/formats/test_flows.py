"""The table of predefined quantities: closed forms of gases, parameters and where they come from, what hints say."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elvis import Dataset
from elvis.core.base.errors import ElvisError
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.evaluator import Sampler
from elvis.core.quantities.flows import PUBLIC
from elvis.core.quantities.predefined import PARAMETERS, QUANTITIES
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid

GAS = ("rho", "rhou", "rhov", "rhow", "E")
PLAIN = ("u", "v", "w", "p")


def state(kind, dimension, gamma):
    """Rules for the fields of a gas, conservative or primitive, and what they are made of at points."""
    velocity = [lambda p: 1 + p[:, 1], lambda p: 0.5 - p[:, 0], lambda p: 0.2 + 0 * p[:, 0]][:dimension]
    density, pressure = lambda p: 1 + p[:, 0], lambda p: 2 + p[:, 1]
    if kind == "primitive":
        return {"rho": density, "p": pressure, **dict(zip("uvw", velocity, strict=False))}, velocity, density, pressure
    energy = lambda p: pressure(p) / (gamma - 1) + 0.5 * density(p) * sum(u(p) ** 2 for u in velocity)  # noqa: E731
    momenta = {name: lambda p, u=u: density(p) * u(p) for name, u in zip(GAS[1:4], velocity, strict=False)}
    return {"rho": density, **momenta, "E": energy}, velocity, density, pressure


@pytest.mark.parametrize("kind", ["primitive", "conservative"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_total_states_and_entropy_of_gases_are_their_closed_forms(kind, dimension):
    gamma, gas_constant = 1.3, 2.5
    rules, velocity, density, pressure = state(kind, dimension, gamma)
    dataset = Dataset(grid(Shape.HEXAHEDRON if dimension == 3 else Shape.QUADRILATERAL, 1))
    fields = tuple(approximated(dataset, name, rule, 5) for name, rule in rules.items())
    dataset = replace(dataset, fields=fields, metadata={"Gamma": "1.3", "GasConstant": "2.5", "pInf": "1.5"})
    points = np.zeros((20, 3))
    points[:, :dimension] = np.random.default_rng(1).uniform(0, 1, (20, dimension))

    rho, p, squares = density(points), pressure(points), sum(u(points) ** 2 for u in velocity)
    mach2 = squares * rho / (gamma * p)
    temperature = p / (rho * gas_constant)
    truth = {
        "pressure" if kind == "conservative" else "p": p,
        "mach": np.sqrt(mach2),
        "temperature": temperature,
        "total_pressure": p * (1 + 0.15 * mach2) ** (1.3 / 0.3),
        "total_temperature": temperature * (1 + 0.15 * mach2),
        "entropy": np.log(p / rho**gamma),
        "pressure_coefficient(rho_ref=2, u_ref=3)": (p - 1.5) / 9,
        "total_pressure(gamma=1.5)": None,
    }
    if kind == "primitive":
        truth["total_pressure(gamma=1.5)"] = p * (1 + 0.25 * squares * rho / (1.5 * p)) ** 3
    else:
        own = 0.5 / 0.3 * p
        truth["total_pressure(gamma=1.5)"] = own * (1 + 0.25 * squares * rho / (1.5 * own)) ** 3
    for text, values in truth.items():
        found = Sampler(dataset, [Expression.of(dataset, text)]).sample(points).values[:, 0]
        assert np.abs(found - values).max() < 1e-10 * np.abs(values).max(), text


def test_incompressible_flows_have_their_total_pressure():
    names = Names(PLAIN)
    assert same("total_pressure", "p + 0.5*(u*u + v*v + w*w)", names, density=1.0)
    assert same("total_pressure(density=2)", "p + (u*u + v*v + w*w)", names, density=2.0)
    assert same("pressure_coefficient(p_ref=0, u_ref=2)", "p/2", names, density=1.0)


def same(text, other, names, density):
    """Whether two texts have equal values at random ones of their leaves."""
    from elvis.core.quantities.functions import function
    from elvis.core.quantities.tree import fold, leaves

    roots = [Expression.parse(each, names).root for each in (text, other)]
    rng = np.random.default_rng(0)
    given = {leaf: rng.uniform(1, 2, 5) for leaf in leaves(*roots)}
    leaf = lambda node: node.value if node.op == "number" else given[node]  # noqa: E731
    first, second = (fold(root, leaf, lambda node, parts: function(node).numpy(*parts)) for root in roots)
    return np.allclose(first, second, rtol=1e-14)


@pytest.mark.sampled
@pytest.mark.parametrize(
    "fields", [GAS, PLAIN, ("u", "v", "w", "rho", "p", "T"), ("velocity_x", "velocity_y"), ("vx",)]
)
@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_hints_are_correct(fields, dimension):
    """What is listed can be read, what waits for parameters as soon as it has them, and nothing else can."""
    names = Names(fields, dimension)
    for name in PUBLIC:
        if name in names.flow.available:
            assert Expression.parse(name, names).leaves or name == "divergence"
        elif name in names.flow.waiting:
            with pytest.raises(ElvisError, match=rf"{name} needs .*: pass --set .*, or write {name}\(") as error:
                Expression.parse(name, names)
            given = str(error.value).rpartition(", or write ")[2].replace("…", "2")
            assert Expression.parse(given, names).leaves
        elif name not in fields:
            with pytest.raises(ElvisError, match=f"{name} needs"):
                Expression.parse(name, names)


def test_every_velocity_has_its_components_by_one_name():
    for fields in (("rho", "rhou", "rhov", "rhow"), PLAIN, ("vx", "vy", "vz")):
        assert {"speed", "velocity_x", "velocity_z"} <= set(Names(fields).flow.available)
    assert "velocity_z" not in Names(PLAIN, 2).flow.available


def test_numbers_in_parentheses_override_those_of_the_data():
    names = Names(PLAIN, 3, parameters={"mu": 0.5, "nu": 7.0})
    assert same("wall_shear_x(mu=1)", "2*wall_shear_x", names, 1.0)
    assert same("wall_shear_x(nu=1)", "2*wall_shear_x", names, 1.0)
    assert same("wall_shear_x(nu=1, density=3)", "6*wall_shear_x", names, 1.0)
    assert same("wall_shear_x(mu=2*x)", "4*x*wall_shear_x", names, 1.0)


@pytest.mark.parametrize(
    ("text", "fields", "dimension", "sentence"),
    [
        (
            "y_plus",
            PLAIN,
            3,
            "y_plus needs mu (dynamic viscosity) or nu (kinematic viscosity): pass --set mu=…",
        ),
        (
            "temperature",
            GAS,
            3,
            "temperature needs R (specific gas constant): pass --set R=…, or write",
        ),
        (
            "skin_friction",
            GAS,
            3,
            "skin_friction needs mu (dynamic viscosity) or nu (kinematic viscosity), rho_ref (reference density), and "
            "u_ref (reference speed): pass --set mu=… rho_ref=… u_ref=…, or write "
            "skin_friction(mu=…, rho_ref=…, u_ref=…)",
        ),
        ("mach", PLAIN, 3, "mach needs a velocity, rho, and p or E; the data lack a density: rho; the fields are u"),
        ("lambda2", ("p",), 3, "the data lack a velocity: u, v, w, or velocity_x, …, or rho with rhou, …"),
        ("helicity", ("u", "v"), 2, "helicity needs 3 coordinates, and the data have 2"),
        ("2*mach(gama=1.3)", GAS, 3, "character 3: mach takes gamma of these data, found 'gama'"),
        ("total_pressure(desnity=2)", PLAIN, 3, "total_pressure takes density of these data, found 'desnity' (perhaps"),
        ("total_pressure(density=2)", GAS, 3, "total_pressure takes gamma of these data, found 'density'"),
        ("vorticity(mu=1)", PLAIN, 3, "vorticity takes no parameters of these data, found 'mu'"),
        ("mach(1.3)", GAS, 3, "expected the name of a parameter, found '1.3'"),
        ("mach()", GAS, 3, "expected the name of a parameter, found ')'"),
        ("mach(gamma 1.3)", GAS, 3, "expected = after gamma, found '1.3'"),
        ("mach(gamma=1.3", GAS, 3, "expected , or ) after a parameter, found its end"),
        ("mach(gamma=1.3, gamma=1.4)", GAS, 3, "expected each parameter once, found 'gamma'"),
        ("lamda2", PLAIN, 3, "there is no 'lamda2' (perhaps lambda2)"),
        ("p-1", GAS, 3, "there is no 'p' (perhaps pressure)"),
        ("ux", PLAIN, 3, "there is no 'ux'"),
        ("traction", PLAIN, 3, "there is no 'traction'"),
    ],
)
def test_missing_inputs_are_named_with_a_remedy(text, fields, dimension, sentence):
    with pytest.raises(ElvisError) as error:
        Expression.parse(text, Names(fields, dimension))
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_invalid_metadata_are_skipped():
    dataset = Dataset(grid(Shape.HEXAHEDRON, 1), metadata={"gamma": "0.9", "Kinvis": "1e-3", "mu": "-1", "pInf": "all"})
    assert Names.of(dataset).parameters == {"nu": 1e-3}


def test_the_page_is_that_of_the_table():
    """Else: make pages."""
    repository = Path(__file__).resolve().parents[2]
    made = runpy.run_path(str(repository / "tools" / "quantities_page.py"))
    text = (repository / "docs" / "quantities.md").read_text(encoding="utf-8")
    assert text == made["page"]()
    assert all(f"| `{name}` |" in text for name in (*PUBLIC, *PARAMETERS))


def test_the_table_is_whole():
    """Each quantity once in flows of each dimension, with a meaning; vortex criteria with their source."""
    for dimension in (1, 2, 3):
        names = [quantity.name for quantity in QUANTITIES if dimension in quantity.dimensions]
        assert len(names) == len(set(names))
    assert all(quantity.meaning and quantity.formulas for quantity in QUANTITIES)
    assert all(parameter.meaning for parameter in PARAMETERS.values())
