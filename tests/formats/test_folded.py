"""Elements that fold are found by every command, and the quick test passes none of them."""

import numpy as np
import pytest
from click.testing import CliRunner

from elvis.core.geometry import geometry
from elvis.core.mapping.connectivity import connected
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.quadrature import gauss
from elvis.core.summary import summary
from elvis.core.testing import curved, grid, ripple
from elvis.core.validity.folded import TOUCHING, are_regular, folded
from elvis.core.validity.validity import ValidityStatus, validity
from elvis.formats import Block, Dataset, Field, Shape, write
from elvis.plugins.command import elvis as group

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


@pytest.mark.parametrize("nodes", [2, 3, 5])
@pytest.mark.parametrize("size", [0.05, 0.25, 0.6])
@pytest.mark.parametrize("shape", SHAPES)
def test_folded_elements_are_those_of_the_proof(shape, size, nodes):
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
        ("integrate", "--over", "domain", "--field", "1"),
        ("trace", "--velocity", "1+0*x,0*x,0*x", "--seeds", "point:-0.9,0.2,0.3"),
    ],
    ids=lambda command: command[0],
)
def test_every_command_warns(tmp_path, command):
    files = [str(path) for path in write(folded_between_samples(), tmp_path / "folded.xml")]
    outcome = CliRunner().invoke(group, [command[0], *files, *command[1:]])
    assert outcome.exit_code == 0
    assert "1 element is inverted or folded" in " ".join(outcome.stderr.split())
