"""CGNS files of other programs: against points that Gmsh evaluated, and against files that it writes here."""

import shutil

import numpy as np
import pytest

from elvis import FormatError, write
from elvis.converters.cgns.cgns import Cgns
from elvis.converters.cgns.elements import element_type, nodes_of_type
from elvis.converters.cgns.tree import opened
from elvis.converters.shared.unit import UNIT as UNIT_SHAPES
from elvis.core.integrals import integrate
from elvis.core.shapes import Shape
from elvis.formats.strict import findings
from elvis.plugins.conversion.converting import convert
from elvis.plugins.conversion.nodal import native_points
from elvis.plugins.testing import check, positions_at

UNIT = [(0, 0), (1, 0), (0, 1)]
SQUARE = [(-1, -1), (1, -1), (1, 1), (-1, 1)]

#: Gmsh's reference coordinates of corners, in its order, which is that of CGNS
FRAMES = {
    "tet": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "hex": [(*corner, w) for w in (-1, 1) for corner in SQUARE],
    "prism": [(*corner, w) for w in (-1, 1) for corner in UNIT],
    "pyr": [*((*corner, 0) for corner in SQUARE), (0, 0, 1)],
}
SHAPES = {"tet": Shape.TETRAHEDRON, "hex": Shape.HEXAHEDRON, "prism": Shape.PRISM, "pyr": Shape.PYRAMID}


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "count"), [("gmsh_ball_tet_o3", 679), ("gmsh_mixed_o2", 142)])
def test_places_agree_with_the_library(solvers, truth, near, tmp_path, name, count):
    path = solvers / "cgns" / f"{name}.cgns"
    conversion = check(Cgns, [path])
    assert conversion.report.geometry.state == "exact"
    assert sum(conversion.report.elements.values()) == count
    own = truth(solvers / "cgns" / f"{name}.truth.npz")
    blocks = {b.shape: i for i, b in enumerate(Cgns([path]).blocks)}
    near(by_shape(conversion, own, blocks), own.xyz, 1e-12)
    written = write(conversion.dataset, tmp_path / "a.xml")
    assert findings(*written) == ()


def by_shape(conversion, own, blocks):
    """Places of the truth's points: its elements are counted within each shape."""
    found = np.empty_like(own.xyz)
    for name in np.unique(own.shape):
        here = own.shape == name
        shape = SHAPES[str(name)]
        frame = np.array(FRAMES[str(name)], float)[UNIT_SHAPES[shape].corners]
        points = native_points(shape, frame, own.ref[here])
        found[here] = positions_at(conversion, blocks[shape], own.elem[here], points)
    return found


def test_names_of_families_and_conditions(solvers):
    names = {c.name for c in convert(Cgns([solvers / "cgns" / "gmsh_mixed_o2.cgns"])).dataset.mesh.composites}
    assert "wall" in names
    ball = convert(Cgns([solvers / "cgns" / "gmsh_ball_tet_o3.cgns"])).dataset.mesh
    assert "S_1" in {c.name for c in ball.composites}


def test_a_file_of_the_library(tmp_path):
    import gmsh

    gmsh.initialize(["test"], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("box")
        gmsh.model.occ.addBox(0, 0, 0, 1, 2, 3)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMin", 1)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(tmp_path / "box.cgns"))
        count = len(gmsh.model.mesh.getElementsByType(11)[0])
    finally:
        gmsh.finalize()
    shutil.move(tmp_path / "box.cgns", tmp_path / "box.data")
    conversion = check(Cgns, [tmp_path / "box.data"])
    assert conversion.report.elements == {"tetrahedron": count}


def test_the_older_container(findings, tmp_path):
    """A mesh of hexahedra of Nek5000's tools: as many, with the nodes that VTK's own reader finds."""
    reader = pytest.importorskip("vtkmodules.vtkIOCGNSReader").vtkCGNSReader()
    path = findings / "sh27.cgns"
    done = check(Cgns, [path])
    assert done.report.elements == {"hexahedron": 160}
    assert done.report.geometry.is_exact
    wall = integrate(done.dataset, "1", over="WALL")[0].value
    assert wall == pytest.approx(integrate(done.dataset, "1", over="all")[0].value)
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput().GetBlock(0).GetBlock(0)
    wanted = np.array([grid.GetPoint(i) for i in range(grid.GetNumberOfPoints())])
    # of each cell of 27 nodes the last is the middle, the first eight are the corners
    middles = np.array([grid.GetPoint(grid.GetCell(i).GetPointId(26)) for i in range(160)])
    found = positions_at(done, 0, np.arange(160), np.zeros((160, 3)))
    # 27 terms are fitted, and 27 added up, of coordinates up to 1: each may be rounded
    assert np.abs(found - middles).max() < 2 * 27 * np.finfo(float).eps
    corners = {grid.GetCell(i).GetPointId(j) for i in range(160) for j in range(8)}
    found, own = done.dataset.mesh.vertices, wanted[sorted(corners)]
    assert len(found) == len(own)
    assert np.abs(own[:, None] - found).max(axis=2).min(axis=1).max() < 1e-14


def test_files_that_only_resemble_the_older_container(tmp_path):
    path = tmp_path / "a.cgns"
    mark = b"@(#)ADF Database Version"
    for start, is_ours in ((mark, True), (bytes(b | 128 for b in mark[:4]) + mark[4:], True),
                           (bytes(b | 128 for b in mark), False), (b" " + mark, False), (mark[:9], False)):  # fmt: skip
        path.write_bytes(start)
        assert Cgns.opens([path]) == is_ours


KINDS = {"tet": (4, 3), "hex": (5, 3), "prism": (6, 3), "pyr": (7, 3), "tri": (2, 2), "quad": (3, 2)}


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("is_edges", [False, True])
@pytest.mark.parametrize("name", KINDS)
def test_nodes_have_the_order_of_another_writer(tmp_path, name, order, is_edges):
    """Gmsh places the nodes of one element evenly, and writes them with a type of CGNS."""
    import gmsh

    frame = np.array(FRAMES.get(name, {"tri": UNIT, "quad": SQUARE}.get(name)), float)
    corners = np.zeros((len(frame), 3))
    corners[:, : frame.shape[1]] = frame
    kind, dimension = KINDS[name]
    gmsh.initialize(["test"], readConfigFiles=False, interruptible=False)
    try:
        for option in ("General.Terminal", "General.AbortOnError"):
            gmsh.option.setNumber(option, 0)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", is_edges)
        gmsh.model.add("one")
        entity = gmsh.model.addDiscreteEntity(dimension)
        tags = list(range(1, len(corners) + 1))
        gmsh.model.mesh.addNodes(dimension, entity, tags, corners.reshape(-1))
        gmsh.model.mesh.addElementsByType(entity, kind, [1], tags)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(tmp_path / "one.cgns"))
    finally:
        gmsh.finalize()
    with opened(tmp_path / "one.cgns") as root:
        (zone,) = root.labelled("CGNSBase_t")[0].labelled("Zone_t")
        points = np.stack([each.floats(None) for each in zone.required("GridCoordinates").children], axis=1)
        sections = zone.labelled("Elements_t")
        if not sections:  # it writes no quadrilaterals of order 4 with nodes on edges alone
            pytest.skip("not written")
        number = int(sections[0].ints(2)[0])
        own = points[sections[0].required("ElementConnectivity").ints(None) - 1]
    if (name, order, is_edges) == ("pyr", 4, True):
        number = 48  # written as 32, which has as many nodes, and order 3
    wanted = element_type(number)
    assert (wanted.order, len(wanted.nodes)) == (order, len(own))
    shape = wanted.shape
    found = native_points(shape, frame[UNIT_SHAPES[shape].corners], own[:, :dimension])
    assert np.abs(found - nodes_of_type(number)).max() < 1e-9


def at_centroids(number, rows):
    """Nodes, counted from 1, that the standard places at the centroids of others."""
    nodes = nodes_of_type(number, True)
    for node, others in rows.items():
        assert np.abs(nodes[node - 1] - nodes[np.array(others) - 1].mean(axis=0)).max() < 1e-12


def test_nodes_of_the_standard():
    """SIDS, notes below the figures of TETRA_35, PENTA_40, PENTA_75 and PYRA_55."""
    tetrahedron = [(1, 12, 6), (2, 6, 9), (3, 9, 12), (1, 6, 15), (2, 18, 6), (4, 15, 18), (2, 9, 18), (3, 21, 9),
                   (4, 18, 21), (3, 12, 21), (1, 15, 12), (4, 21, 15), (1, 2, 3, 4)]  # fmt: skip
    at_centroids(47, dict(enumerate(tetrahedron, 23)))
    at_centroids(36, {39: (13, 17, 15), 40: (14, 18, 16)})
    low = [(1, 14, 8), (2, 8, 11), (3, 11, 14)]
    inner = [(4, 26, 32), (5, 29, 26), (6, 32, 29), (16, 38, 56), (19, 47, 38), (22, 56, 47), (17, 45, 63),
             (20, 54, 45), (23, 63, 54), (18, 42, 60), (21, 51, 42), (24, 60, 51)]  # fmt: skip
    at_centroids(53, dict(enumerate(low, 34)) | dict(enumerate(inner, 64)))
    pyramid = [(1, 7, 19), (2, 22, 7), (5, 19, 22), (2, 10, 22), (3, 25, 10), (5, 22, 25), (3, 13, 25), (4, 28, 13),
               (5, 25, 28), (4, 16, 28), (1, 19, 16), (5, 28, 19)]  # fmt: skip
    at_centroids(50, dict(enumerate(pyramid, 39)))
    nodes = nodes_of_type(50, True)
    # on the lines from the apex, N5, to N30, N32, N34, N36 and N38, at the heights of N18 and, by the figure, N19
    for node, base, level in ((51, 30, 18), (52, 32, 18), (53, 34, 18), (54, 36, 18), (55, 38, 19)):
        share = (nodes[level - 1][2] + 1) / 2
        assert np.abs(nodes[node - 1] - (1 - share) * nodes[base - 1] - share * nodes[4]).max() < 1e-12


def test_unsupported_input_is_rejected(solvers, tmp_path):
    assert not Cgns.opens([solvers / "gmsh" / "mixed_o3.msh"])
    assert not Cgns.opens([tmp_path / "missing.cgns"])
    whole = (solvers / "cgns" / "gmsh_ball_tet_o3.cgns").read_bytes()
    (tmp_path / "half.cgns").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FormatError):
        Cgns([tmp_path / "half.cgns"])
