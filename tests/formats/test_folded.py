"""Elements that fold are found by every command, and the quick test passes none of them."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import Block, Dataset, ElvisError, Field, Shape, integrate, open_series, write
from elvis.core.mapping.connectivity import connected
from elvis.core.mapping.geometry import geometry
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.quadrature import gauss
from elvis.core.summary.summary import summary
from elvis.core.testing import curved, grid, ripple, scattered
from elvis.core.validity.folded import folded
from elvis.core.validity.regularity import are_regular
from elvis.core.validity.validity import TOUCHING, ValidityStatus, validity
from elvis.plugins.command.command import elvis as group

SHAPES = [shape for shape in Shape if shape.dimension > 1]
#: where the map of `folded_between_samples` turns back, and half of the width of its fold
PLACE, HALF = 0.45, 0.02


def folded_between_samples():
    """A hexahedron of order 4 whose Jacobian is negative in a slab that no Gauss point is in.

    dx/dxi1 = (xi1 - PLACE)² - HALF²
    """
    corners = np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]], float)
    mesh = connected(np.concatenate([corners, corners + np.array([0, 0, 2])]), {Shape.HEXAHEDRON: np.arange(8)[None]})
    expansion = modified(Shape.HEXAHEDRON, (5, 5, 5))
    line = gauss(5)[0]
    xi = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    places = xi.copy()
    places[:, 0] = (xi[:, 0] - PLACE) ** 3 / 3 - HALF**2 * xi[:, 0]
    columns = np.linalg.solve(values(expansion, xi), places).T
    ids = next(iter(mesh.elements.values())).ids
    fields = [
        Field(f"map_{axis}", (Block(expansion, ids, column[None]),))
        for axis, column in zip("xyz", columns, strict=True)
    ]
    return Dataset(mesh, tuple(fields), metadata={"GeometryMap": "map_x,map_y,map_z"})


@pytest.mark.sampled(least=12)
@pytest.mark.parametrize("nodes", [2, 3, 5])
@pytest.mark.parametrize("size", [0.05, 0.25, 0.6])
@pytest.mark.parametrize("shape", SHAPES)
def test_folded_elements_match_those_of_the_proof(shape, size, nodes):
    dataset = Dataset(curved(grid(shape, 2), ripple(size, seed=5), nodes))
    proved = validity(dataset)
    found = folded(dataset)
    assert found.wrong.tolist() == sorted(proved.element_ids[proved.status == ValidityStatus.NOT_POSITIVE].tolist())
    is_open = (proved.status == ValidityStatus.UNDECIDED) & ~(proved.lower >= -TOUCHING * proved.error)
    assert found.undecided.tolist() == sorted(proved.element_ids[is_open].tolist())
    positive = set(proved.element_ids[proved.status == ValidityStatus.POSITIVE].tolist())
    for block in geometry(dataset):
        passed = block.element_ids[are_regular(block.expansion, block.coefficients)].tolist()
        assert positive.issuperset(passed)
        assert passed or size > 0.1


def test_folds_between_samples_are_found():
    dataset = folded_between_samples()
    assert folded(dataset).wrong.tolist() == [0]
    assert summary(dataset)["geometry"]["jacobian"]["elements_not_positive"] == [0]


@pytest.mark.parametrize(
    "command",
    [
        ("info",),
        ("norms",),
        ("probe", "--point", "0.1,0.2,0.3", "--field", "2*y"),
        ("integrate", "--over", "domain", "--field", "1", "--error", "0.01"),
        ("trace", "--velocity", "1+0*x,0*x,0*x", "--seeds", "point:-0.9,0.2,0.3"),
    ],
    ids=lambda command: command[0],
)
def test_every_command_warns(tmp_path, command):
    files = [str(path) for path in write(folded_between_samples(), tmp_path / "folded.xml")]
    outcome = CliRunner().invoke(group, [command[0], *files, *command[1:]])
    assert outcome.exit_code == 0
    assert "1 element is inverted or folded" in " ".join(outcome.stderr.split())


def test_steps_of_series_warn(tmp_path):
    files = write(folded_between_samples(), tmp_path / "mesh.xml")
    steps = [tmp_path / f"run_{number}.chk" for number in range(2)]
    for number, step in enumerate(steps):
        write(replace(folded_between_samples(), time=number / 2), field_path=step)
    files[1].unlink()
    series = open_series(files[0], *steps)
    assert all(any("inverted or folded" in remark for remark in step.remarks) for step in (*series, series.at(0.25)))


def test_integrals_take_the_jacobian_or_its_absolute_value():
    """Over the slab of the fold, 2 HALF wide, dx/dxi1 is negative: its integral is -4/3 HALF³, and the area is 4."""
    data = folded_between_samples()
    signed = ((1 - PLACE) ** 3 + (1 + PLACE) ** 3) / 3 - 2 * HALF**2
    absolute = signed + 2 * (4 / 3) * HALF**3
    with_sign, without = integrate(data, "1", jacobian="signed"), integrate(data, "1", error=1e-2)
    assert with_sign[0].exact
    assert abs(with_sign.value - 4 * signed) <= with_sign[0].error < 1e-12
    assert abs(without.value - 4 * absolute) <= without[0].error < 3e-2
    root = integrate(data, "sqrt(2+y)", jacobian="signed")
    assert abs(root.value - 2 * signed * (3**1.5 - 1) * 2 / 3) <= root[0].error < 1e-5
    with pytest.raises(ElvisError, match="divide the integrals"):
        integrate(data, "average(y)", jacobian="signed")


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.HEXAHEDRON])
def test_inverted_elements_have_negative_volumes_with_the_sign_of_the_jacobian(shape):
    mirrored = Dataset(curved(grid(shape, 2), lambda x: x * [-1, 1, 1], 2))
    assert integrate(mirrored, "1", jacobian="signed").value == pytest.approx(-1, rel=1e-13)
    assert integrate(mirrored, "1").value == pytest.approx(1, rel=1e-13)


def bent(shape, bend, shift=0.0):
    """A map of order 2 with the Jacobian 1 + bend xi1, turned by half a radian, and moved."""
    expansion = modified(shape, (3,) * shape.dimension)
    nodes = scattered(shape, 60, seed=1)
    places = np.zeros((len(nodes), 3))
    places[:, : shape.dimension] = nodes
    places[:, 0] += bend * nodes[:, 0] ** 2 / 2
    turn = np.array([[np.cos(0.5), -np.sin(0.5), 0], [np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])
    return expansion, np.linalg.lstsq(values(expansion, nodes), places @ turn.T + shift, rcond=None)[0].T[None]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("space", [2, 3])
def test_maps_pass_until_they_fold(shape, space):
    if space < shape.dimension:
        pytest.skip("no such map")
    for bend, expected in ((0.99, True), (-0.99, True), (1.01, False), (-1.01, False)):
        assert are_regular(*bent(shape, bend), space).tolist() == [expected]


@pytest.mark.parametrize("shape", SHAPES)
def test_maps_within_rounding_do_not_pass(shape):
    assert are_regular(*bent(shape, 0.5, 1e3)).all()
    assert not are_regular(*bent(shape, 0.5, 1e14)).any()


@pytest.mark.parametrize("shape", SHAPES)
def test_mirrored_maps_do_not_pass(shape):
    expansion, coefficients = bent(shape, 0.5)
    assert not are_regular(expansion, coefficients[:, [1, 0, 2]]).any()
    assert are_regular(expansion, coefficients[:, [1, 0, 2]], 3).all() == (shape.dimension == 2)


@pytest.mark.parametrize("shape", [shape for shape in SHAPES if shape.dimension == 3])
def test_maps_that_turn_by_more_than_a_right_angle_pass(shape):
    """Halving leaves less of the turn in a box."""

    def turned(x):
        angle = 0.9 * x[:, 2]
        return np.stack(
            [
                x[:, 0] * np.cos(angle) - x[:, 1] * np.sin(angle),
                x[:, 0] * np.sin(angle) + x[:, 1] * np.cos(angle),
                x[:, 2],
            ],
            1,
        )

    expansion = modified(shape, (8,) * 3)
    nodes = scattered(shape, 2000, seed=1)
    coefficients = np.linalg.lstsq(values(expansion, nodes), turned(nodes), rcond=None)[0].T[None]
    assert are_regular(expansion, coefficients).all()
