"""VTX data as DOLFINx lays it out: by plain arrays, and through ADIOS2's library where that is installed."""

import numpy as np
import pytest

pytest.importorskip("adios2")

from vtx_writer import schema_of, vtx_blocks, vtx_nodes, write_vtx

from elvis import FormatError
from elvis.converters.vtx.vtx import Vtx, grid_of
from elvis.core.integrals import integrate
from elvis.plugins.conversion.converting import convert
from elvis.plugins.testing import check

NEAR = 1e-12
FUNCTIONS = {
    "f": lambda x: x[:, 0] ** 3 * x[:, 1] + x[:, 1],
    "v": lambda x: np.stack([x[:, 1], x[:, 0], 0 * x[:, 0]], axis=1),
    "z_real": lambda x: x[:, 0],
    "z_imag": lambda x: -2 * x[:, 1],
}


def squares(order, is_even=False):
    """Arrays of two processes with unit squares in a row: two, and one with a copy of the second as a ghost."""
    nodes = vtx_nodes(70, order, is_even)
    ids = np.arange(3 * len(nodes)).reshape(3, -1)
    cells = [nodes + np.array([i, 0, 0]) for i in range(3)]
    return vtx_blocks([cells[:2], cells[1:]], [ids[:2], ids[1:]], FUNCTIONS)


class Arrays(Vtx):
    """A source of arrays that are there."""

    def __init__(self, kind, arrays, schema=""):
        self.read_grids = lambda paths, step: ([grid_of("arrays", 0.5, kind, schema, arrays)], None)
        super().__init__([])


def value(dataset, name):
    return integrate(dataset, name)[0].value


@pytest.mark.parametrize("is_even", [False, True])
def test_blocks_of_processes_make_one_grid(is_even):
    """Gauss-Lobatto nodes are found from straight edges; a cell that two processes have counts once."""
    conversion = convert(Arrays(70, squares(4, is_even)))
    dataset = conversion.dataset
    assert dataset.time == 0.5
    assert conversion.report.elements == {"quadrilateral": 3}
    assert all(own.is_exact for own in (conversion.report.geometry, *conversion.report.fields))
    assert value(dataset, "1") == pytest.approx(3, rel=NEAR)
    assert value(dataset, "f") == pytest.approx(81 / 8 + 1.5, rel=NEAR)
    assert value(dataset, "v_y") == pytest.approx(4.5, rel=NEAR)
    assert value(dataset, "z_imag") == pytest.approx(-3, rel=NEAR)


@pytest.mark.parametrize(("kind", "order", "volume"), [(69, 2, 0.5), (71, 2, 1 / 6), (72, 3, 1), (73, 2, 0.5)])
def test_shapes(kind, order, volume):
    nodes = vtx_nodes(kind, order, kind != 72)
    arrays = vtx_blocks([[nodes]], [[np.arange(len(nodes))]], {"f": lambda x: x[:, 0]})
    dataset = convert(Arrays(kind, arrays)).dataset
    assert value(dataset, "1") == pytest.approx(volume, rel=NEAR)
    wanted = {69: 1 / 6, 71: 1 / 24, 72: 0.5, 73: 1 / 6}[kind]
    assert value(dataset, "f") == pytest.approx(wanted, rel=NEAR)


def test_the_schema_identifies_arrays_on_cells():
    """One cell of one point more would leave it open; here as many cells as points have no schema."""
    arrays = {**squares(1), "c": [np.array([[1.0], [2.0]]), np.array([[2.0], [4.0]])]}
    assert value(convert(Arrays(70, arrays)).dataset, "c") == pytest.approx(7, rel=NEAR)
    schema = schema_of(["f"], ["c"])
    assert value(convert(Arrays(70, arrays, schema)).dataset, "c") == pytest.approx(7, rel=NEAR)


def test_a_process_may_have_no_cells():
    arrays = squares(2)
    for blocks in arrays.values():
        blocks.append(blocks[0][:0])
    assert value(convert(Arrays(70, arrays)).dataset, "1") == pytest.approx(3, rel=NEAR)


DAMAGES = [
    ("connectivity", [np.array([[3, 0, 1, 2, 3]])] * 2, "rows that begin with their number of nodes"),
    ("connectivity", [np.array([[4, 0, 1, 2, 99]])] * 2, "expected points 0 to 7, found 0 to 99"),
    ("geometry", [np.zeros((8, 2))] * 2, "positions of three coordinates in 2 blocks"),
    ("f", [np.zeros((8, 1)), np.zeros((8, 0))], r"the same number of components in all blocks, found \[0, 1\]"),
    ("f", [np.zeros((3, 1)), np.zeros((8, 1))], r"rows in blocks, found \[3, 8\]"),
    ("vtkOriginalPointIds", [], r"vtkOriginalPointIds: expected \[8, 8\] rows in blocks, found \[\]"),
    ("vtkOriginalPointIds", [np.arange(8), np.arange(7)], r"expected \[8, 8\] rows in blocks, found \[8, 7\]"),
]


@pytest.mark.parametrize(("name", "blocks", "message"), DAMAGES)
def test_damaged_arrays_give_a_one_line_error(name, blocks, message):
    with pytest.raises(FormatError, match=message):
        Arrays(70, {**squares(1), name: blocks})


@pytest.fixture
def folder(tmp_path):
    """Two steps, of which the first has the mesh for both, through the library."""
    pytest.importorskip("adios2")
    arrays = squares(3)
    second = {name: [2 * block for block in arrays[name]] for name in FUNCTIONS}
    return write_vtx(tmp_path / "u.bp", 70, [(0.5, arrays), (1.5, second)], schema_of([*FUNCTIONS], []))


def test_folders_of_the_library(folder):
    assert Vtx.times([folder]) == [0.5, 1.5]
    for step, factor in enumerate((1, 2)):
        dataset = check(Vtx, [folder], step=str(step)).dataset
        assert dataset.time == 0.5 + step
        assert value(dataset, "f") == pytest.approx(factor * (81 / 8 + 1.5), rel=NEAR)
    assert Vtx.opens([folder / "md.idx"])


def test_damaged_folders_give_a_one_line_error(folder):
    whole = (folder / "data.0").read_bytes()
    (folder / "data.0").write_bytes(whole[:100])
    with pytest.raises(FormatError, match="bytes of data, found 100"):
        Vtx([folder])
    (folder / "data.0").write_bytes(whole)
    (folder / "md.0").write_bytes((folder / "md.0").read_bytes()[:100])
    with pytest.raises(FormatError, match="expected a complete ADIOS2 f"):
        Vtx([folder])
