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


@pytest.mark.parametrize(
    ("kind", "nodes", "sets"),
    [("SHELL4", SQUARES, SQUARE_SETS), ("QUAD4", SQUARES, SQUARE_SETS), ("TRI3", TRIANGLES, TRIANGLE_SETS)],
)
def test_sides_of_shells_are_edges(tmp_path, kind, nodes, sets):
    path = write_classic(tmp_path / "shell.e", [ExodusBlock("plate", kind, nodes)], PLACES, sets)
    dataset = read(path)
    for name, wanted in WANTED.items():
        found = [row.value for row in integrate(dataset, ["1", "x", "y"], name)]
        assert found == pytest.approx(wanted, abs=1e-13)


def test_sides_of_plane_elements_in_the_plane_count_from_one(tmp_path):
    sets = {name: [(element, side - 2) for element, side in own] for name, own in SQUARE_SETS.items()}
    path = write_classic(tmp_path / "plane.e", [ExodusBlock("plate", "QUAD4", SQUARES)], PLACES[:, :2], sets)
    dataset = read(path)
    for name, wanted in WANTED.items():
        assert [row.value for row in integrate(dataset, ["1", "x", "y"], name)] == pytest.approx(wanted, abs=1e-13)


def test_faces_of_shells_on_volumes_are_sides_of_these(tmp_path):
    places, nodes = unit_cubes(2)
    shells = nodes[-1:, [1, 2, 6, 5]]
    blocks = [ExodusBlock("solid", "HEX8", nodes), ExodusBlock("skin", "SHELL4", shells)]
    dataset = read(write_classic(tmp_path / "skin.e", blocks, places, {"outlet": [(3, 1)], "edges": [(3, 4)]}))
    area, moment = integrate(dataset, ["1", "x"], "outlet")
    assert (area.value, moment.value) == pytest.approx((1, places[:, 0].max()), abs=1e-13)
    assert any("1 of the 1 sides of the boundary 'edges' were left out" in remark for remark in dataset.remarks)


def test_elements_with_nodes_of_their_own_are_neighbours(tmp_path):
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
