"""Isosurfaces of expressions with roots and quotients: those of polynomials that have values in the same places."""

import numpy as np
import pytest

from elvis import Camera, Status
from elvis.core.data.dataset import Dataset
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.evaluator import Sampler
from elvis.core.quantities.levels import fraction, same_level
from elvis.core.quantities.tree import ONE
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.plugins.runtime.serving import volume_of
from elvis.renderer.passes.isosurface.isosurface import IsosurfaceDrawer
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View

COUNT = 90
VIEW = View.through(Camera((2.6, -1.9, 1.9), (0.5, 0.5, 0.5), fov=32), (32, 26))


def gas(shape, bend, modes):
    mesh = curved(grid(shape, 2), ripple(bend), n=3) if bend else grid(shape, 2)
    functions = {
        "u": lambda p: np.sin(3 * p[:, 0] + p[:, 1]),
        "v": lambda p: np.cos(2 * p[:, 1] - p[:, 2]),
        "p": lambda p: 1 + 0.5 * np.sin(4 * p[:, 2] + p[:, 0]),
        "rho": lambda p: 1.2 + 0.4 * np.cos(3 * p[:, 0] * p[:, 1]),
    }
    return Dataset(mesh, tuple(approximated(Dataset(mesh), name, f, modes) for name, f in functions.items()))


CASES = [
    (Shape.TETRAHEDRON, 0.0, "sqrt(u^2+v^2)", 0.8, True),
    (Shape.TETRAHEDRON, 0.0, "sqrt(u^2+v^2)/sqrt(1.4*p/rho)", 0.7, True),
    (Shape.TETRAHEDRON, 0.05, "sqrt((u/rho)^2+(v/rho)^2)/sqrt(1.4*(p-0.2*u^2/rho)/rho)", 0.8, True),
    (Shape.HEXAHEDRON, 0.05, "p/rho", 0.8, True),
    (Shape.HEXAHEDRON, 0.0, "u/p*tanh(v)", 0.1, True),
    (Shape.HEXAHEDRON, 0.05, "u + 0.01*d(d(u,x),y)", 0.5, False),
]


@pytest.mark.sampled(least=2, free=("shape", "bend", "text", "value", "proved"))
@pytest.mark.parametrize(("shape", "bend", "text", "value", "proved"), CASES)
def test_dense_samples_never_refute_certain_pixels(renderer, shape, bend, text, value, proved):
    dataset = gas(shape, bend, 3)
    hits = IsosurfaceDrawer(DeviceVolume(renderer("vulkan").device, volume_of(dataset, [text]))).draw(VIEW, None, value)
    sampler = Sampler(dataset, [Expression.of(dataset, text)])
    origins, ways = VIEW.every_ray()
    hit, sure = np.isfinite(hits.depth), hits.status != Status.AMBIGUOUS
    assert hit.mean() > 0.04
    assert (sure[hit].mean() > 0.95) == proved
    assert (hits.field[hit] == value).all()
    found = sampler.sample((origins + hits.depth[:, None] * ways)[hit], all=True)
    near = np.abs(found.values[:, 0] - value) < 1e-9
    assert set(found.location.point[near]) == set(range(hit.sum()))

    depths = np.linspace(1.5, 5.0, COUNT)
    dense = sampler.sample((origins[:, None] + depths[:, None] * ways[:, None]).reshape(-1, 3))
    element = dense.location.element_id.reshape(-1, COUNT)
    above = np.where(element >= 0, dense.values[:, 0].reshape(-1, COUNT) - value, np.nan)
    crosses = (above[:, 1:] * above[:, :-1] < 0) & (element[:, 1:] == element[:, :-1])
    first = np.where(crosses.any(axis=1), depths[1 + crosses.argmax(axis=1)], np.inf)
    assert crosses.any()
    assert (hits.depth[sure] <= first[sure]).all()


TEXTS = {
    "sqrt(x^2+y^2)": 0.7,
    "2*sqrt(x*x+y*y)+1": 2.1,
    "3-x/(1+y^2)": 2.8,
    "1/(1+x^2)": 0.8,
    "exp(-x*y)": 0.9,
    "log(1+x*x)": 0.2,
    "abs(x)/sqrt(1+y)": 0.3,
    "(x/y)^2": 0.5,
    "tanh(x-y)": 0.25,
}


@pytest.mark.parametrize("text", TEXTS)
def test_levels_are_in_the_same_places(text):
    """Bisection along random lines: the expression has its value where the other one has its own."""
    names = Names(("u",))
    level = same_level(Expression.parse(text, names).root, TEXTS[text])
    assert level is not None
    rng = np.random.default_rng(1)
    ends = rng.uniform(0.05, 1.5, (2, 400, 2))
    other = [evaluated(level.root, end) - level.value for end in ends]
    own = [evaluated(Expression.parse(text, names).root, end) - TEXTS[text] for end in ends]
    assert np.array_equal(other[0] * other[1] < 0, own[0] * own[1] < 0)
    assert (own[0] * own[1] < 0).any()


#: functions whose values are zeros of a product, which has others
PRODUCTS = {
    "max(x, y*y)": 0.6,
    "1 - min(x, x*y)/2": 0.7,
    "middle_eigenvalue(x, y, 1, 0.3, x*y, 0.2)": 0.6,
    "middle_eigenvalue(x/y, y, 1/(x*x), 0.3/(x*y), x*y, 0.2)": 0.6,
    "2*imaginary_root(x - 0.4, y - 0.5)": 1.1,
    "imaginary_root(x - 0.4, 0.01*y)": 0.4,
}


def test_common_factors_of_numerators_and_denominators_are_removed():
    """|m|/rho = v sqrt(gamma p/rho) is |m|^2 = v^2 gamma (gamma - 1) (E rho - |m|^2 / 2), of degree 2."""
    mesh = grid(Shape.TETRAHEDRON, 1)
    bare = Dataset(mesh)
    values = {"rho": 1.0, "rhou": 0.3, "rhov": 0.1, "rhow": 0.2, "E": 2.0}
    fields = [approximated(bare, name, lambda p, v=v: v + 0.1 * p[:, 0] ** 3, 4) for name, v in values.items()]
    (part,) = volume_of(Dataset(mesh, tuple(fields)), ["mach"]).parts
    stand_in, _ = part.level(0.2)
    assert stand_in.degree == 6


@pytest.mark.parametrize("text", PRODUCTS)
def test_zeros_of_products_count_unless_proved_spurious(text):
    """Between points near to each other the expression passes its value where the other one does, and counts."""
    level = same_level(Expression.parse(text, Names(("u",))).root, PRODUCTS[text])
    rng = np.random.default_rng(1)
    starts = rng.uniform(0.05, 1.5, (40000, 2))
    ends = [starts, starts + rng.uniform(-0.01, 0.01, starts.shape)]
    own = [evaluated(Expression.parse(text, Names(("u",))).root, end) - PRODUCTS[text] for end in ends]
    zeros, spurious = ([evaluated(root, end) for end in ends] for root in (level.root, level.spurious))
    assert level.value == 0.0
    counts = (spurious[0] < 0) & (spurious[1] < 0)
    unclear = spurious[0] * spurious[1] <= 0
    passes, passed = own[0] * own[1] < 0, zeros[0] * zeros[1] < 0
    assert np.array_equal(passes[~unclear], (passed & counts)[~unclear])
    assert (passes & counts).sum() > 40 > (passes & unclear).sum()
    assert "max" not in text or (passed & ~counts).any()


@pytest.mark.parametrize("text", [text for text in PRODUCTS if "middle" in text])
def test_second_eigenvalues_have_their_sign_without_quotients(text):
    """Factors that entries are multiplied by are positive here, so that LAPACK's eigenvalues keep their signs."""
    level = same_level(Expression.parse(text, Names(("u",))).root, PRODUCTS[text])
    points = np.random.default_rng(2).uniform(0.05, 1.5, (2000, 2))
    xx, yy, zz, xy, xz, yz = (evaluated(entry, points) for entry in level.matrix)
    matrices = np.moveaxis(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), -1, 0)
    own = evaluated(Expression.parse(text, Names(("u",))).root, points) - PRODUCTS[text]
    assert np.array_equal(np.linalg.eigvalsh(matrices)[:, 1] > 0, own > 0)
    assert all(fraction(entry)[1] is ONE for entry in level.matrix)


def evaluated(root, points):
    """(n,) an expression of x and y at points (n, 2)."""
    from elvis.core.quantities.functions import function
    from elvis.core.quantities.tree import fold

    def leaf(node):
        return np.full(len(points), node.value) if node.op == "number" else points[:, node.axes[0]]

    return fold(root, leaf, lambda node, parts: function(node).numpy(*parts))


def test_only_quotients_with_attained_values_have_another_level():
    names = Names(("u", "v"))
    for text, value in (
        ("sqrt(u)", -1.0),
        ("min(u, abs(v))", 0.2),
        ("imaginary_root(u, v)", 0.0),
        ("sin(u)", 0.1),
        ("exp(u)", -0.5),
        ("sqrt(u)*sqrt(v)", 1.0),
        ("max(0.5, d(u,x))", 0.5),
    ):
        assert same_level(Expression.parse(text, names).root, value) is None
