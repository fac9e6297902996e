"""Side sets of Exodus: edges and faces of shells, and elements that have nodes of their own."""

import numpy as np
import pytest
from exodus_writer import ExodusBlock, unit_cubes, write_classic

from elvis import integrate, read, trace

#: two squares, or four triangles, that make [0, 2] x [0, 1] in space
PLACES = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 0]], float)
SQUARES = np.array([[0, 1, 4, 3], [1, 2, 5, 4]])
TRIANGLES = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
#: elements and sides; in space sides 1 and 2 are the faces
SQUARE_SETS = {"bottom": [(1, 3), (2, 3)], "right": [(2, 4)], "top": [(1, 5), (2, 5)], "left": [(1, 6)]}
TRIANGLE_SETS = {"bottom": [(1, 3), (3, 3)], "right": [(3, 4)], "top": [(2, 4), (4, 4)], "left": [(2, 5)]}
#: length of each side, and the integrals of x and y
WANTED = {"bottom": (2, 2, 0), "right": (1, 2, 0.5), "top": (2, 2, 2), "left": (1, 0, 0.5)}


#: what types of elements are called, and whether their faces count before their edges: those of a writer each
NUMBERINGS = [
    ("SHELL4", 3, True),
    ("SHELL4", 2, True),
    ("QUAD4", 3, True),
    ("QUAD4", 3, False),
    ("QUAD4", 2, False),
    ("TRI3", 3, True),
    ("TRISHELL3", 2, True),
    ("TRISHELL3", 2, False),
    ("TRI3", 2, False),
]


@pytest.mark.parametrize("is_discontinuous", [False, True])
@pytest.mark.parametrize(("kind", "space", "has_faces"), NUMBERINGS)
def test_sides_of_plane_elements_are_edges(tmp_path, kind, space, has_faces, is_discontinuous):
    nodes, sets = (TRIANGLES, TRIANGLE_SETS) if kind.startswith("TRI") else (SQUARES, SQUARE_SETS)
    sets = {name: [(element, side - 2 * (not has_faces)) for element, side in own] for name, own in sets.items()}
    places = PLACES[:, :space]
    if is_discontinuous:
        places, nodes = places[nodes.reshape(-1)], np.arange(nodes.size).reshape(nodes.shape)
    dataset = read(write_classic(tmp_path / "plate.e", [ExodusBlock("plate", kind, nodes)], places, sets))
    for name, wanted in WANTED.items():
        found = [row.value for row in integrate(dataset, ["1", "x", "y"], name)]
        assert found == pytest.approx(wanted, abs=1e-13)


#: three by three squares in space
BOARD = np.array([(i, j, 0.5 * i) for j in range(4) for i in range(4)], float)
FIELDS = np.array([(k, k + 1, k + 5, k + 4) for k in (0, 1, 2, 4, 5, 6, 8, 9, 10)])


@pytest.mark.parametrize(("first", "elements", "height"), [(1, (1, 2, 3), 0), (3, (7, 8, 9), 3)])
@pytest.mark.parametrize("has_faces", [True, False])
def test_one_set_determines_the_numbering_of_sides_of_quadrilaterals_in_space(
    tmp_path, first, elements, height, has_faces
):
    sets = {"edge": [(element, first + 2 * has_faces) for element in elements]}
    dataset = read(write_classic(tmp_path / "one.e", [ExodusBlock("plate", "QUAD4", FIELDS)], BOARD, sets))
    length, moment = integrate(dataset, ["1", "y"], "edge")
    assert (length.value, moment.value) == pytest.approx((3 * 1.25**0.5, 3 * 1.25**0.5 * height), abs=1e-12)
    # the first sides of some elements may also be faces of shells
    is_open = first == 1 and not has_faces
    assert len(dataset.remarks) == 1 + is_open


def test_faces_of_quadrilaterals_in_space_are_not_edges(tmp_path):
    sets = {"skin": [(element, 1) for element in range(1, 10)]}
    dataset = read(write_classic(tmp_path / "skin.e", [ExodusBlock("plate", "QUAD4", FIELDS)], BOARD, sets))
    assert "9 of the 9 sides of the boundary 'skin' were skipped" in dataset.remarks[-1]


def test_sides_that_fit_two_numberings_are_named(tmp_path):
    blocks = [ExodusBlock("plate", "QUAD4", SQUARES)]
    dataset = read(write_classic(tmp_path / "row.e", blocks, PLACES, {"long": [(1, 3), (2, 3)]}))
    assert "were read as edges that count from 1" in dataset.remarks[-1]


def test_faces_of_shells_on_volumes_are_sides_of_these(tmp_path):
    places, nodes = unit_cubes(2)
    shells = nodes[-1:, [1, 2, 6, 5]]
    blocks = [ExodusBlock("solid", "HEX8", nodes), ExodusBlock("skin", "SHELL4", shells)]
    dataset = read(write_classic(tmp_path / "skin.e", blocks, places, {"outlet": [(3, 1)], "edges": [(3, 4)]}))
    area, moment = integrate(dataset, ["1", "x"], "outlet")
    assert (area.value, moment.value) == pytest.approx((1, places[:, 0].max()), abs=1e-13)
    assert any("1 of the 1 sides of the boundary 'edges' were skipped" in remark for remark in dataset.remarks)


def test_elements_with_separate_nodes_are_neighbours(tmp_path):
    places, nodes = unit_cubes(3)
    places, nodes = places[nodes.reshape(-1)], np.arange(24).reshape(3, 8)
    sets = {"in": [(1, 4)], "out": [(3, 2)]}
    dataset = read(write_classic(tmp_path / "dg.e", [ExodusBlock("row", "HEX8", nodes)], places, sets))
    assert len(dataset.mesh.vertices) == 16
    rows = {row.over: row.value for row in integrate(dataset, ["1"], "all")}
    assert rows.pop("total") == pytest.approx(14, abs=1e-12)
    assert rows == pytest.approx({"in": 1, "out": 1, "boundary": 12}, abs=1e-12)
    lines = trace(dataset, ["point:0.1,0.4,0.6"], ["1+0*x", "0*x", "0*x"])
    assert lines.ends[lines.end[0]] == "out"
    assert lines.points[-1] == pytest.approx([3, 0.4, 0.6], abs=1e-12)
