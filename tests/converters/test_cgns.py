"""CGNS meshes against points that Gmsh evaluated, and against a file that it writes here."""

import shutil

import numpy as np
import pytest

from elvis.converters.cgns import Cgns
from elvis.formats import FormatError, write
from elvis.formats.strict import findings
from elvis.plugins.converting import convert
from elvis.plugins.testing import check, positions_at


@pytest.mark.parametrize(("name", "count"), [("gmsh_ball_tet_o3", 679), ("gmsh_mixed_o2", 142)])
def test_places_agree_with_the_library(solvers, truth, near, tmp_path, name, count):
    path = solvers / "cgns" / f"{name}.cgns"
    conversion = check(Cgns, [path])
    assert conversion.report.geometry.state == "exact"
    assert sum(conversion.report.elements.values()) == count
    own = truth(solvers / "cgns" / f"{name}.truth.npz")
    blocks = {{"Tetrahedron": "tet", "Hexahedron": "hex", "Prism": "prism", "Pyramid": "pyr"}[b.shape.label]: i
              for i, b in enumerate(Cgns([path]).blocks)}  # fmt: skip
    near(by_shape(conversion, own, blocks), own.xyz, 1e-12)
    written = write(conversion.dataset, tmp_path / "a.xml")
    assert findings(*written) == ()


def by_shape(conversion, own, blocks):
    """Places of the truth's points: its elements are counted within each shape."""
    found = np.empty_like(own.xyz)
    for name in np.unique(own.shape):
        here = own.shape == name
        found[here] = positions_at(conversion, blocks[str(name)], own.elem[here], own.ref[here])
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
    assert any("WALL is specified on Vertex" in note for note in done.report.notes)
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


def test_solutions_in_the_older_container_are_left_out_in_a_sentence(findings, tmp_path):
    raw = (findings / "sh27.cgns").read_bytes()
    label = b"DiscreteData_t"
    assert raw.count(label) == 1
    (tmp_path / "a.cgns").write_bytes(raw.replace(label, b"FlowSolution_t"))
    assert "the solutions PID were left out" in Cgns([tmp_path / "a.cgns"]).notes


def test_files_that_only_resemble_the_older_container(tmp_path):
    path = tmp_path / "a.cgns"
    mark = b"@(#)ADF Database Version"
    for start, is_ours in ((mark, True), (bytes(b | 128 for b in mark[:4]) + mark[4:], True),
                           (bytes(b | 128 for b in mark), False), (b" " + mark, False), (mark[:9], False)):  # fmt: skip
        path.write_bytes(start)
        assert Cgns.opens([path]) == is_ours


def test_what_it_does_not_take(solvers, tmp_path):
    assert not Cgns.opens([solvers / "gmsh" / "mixed_o3.msh"])
    assert not Cgns.opens([tmp_path / "missing.cgns"])
    whole = (solvers / "cgns" / "gmsh_ball_tet_o3.cgns").read_bytes()
    (tmp_path / "half.cgns").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FormatError):
        Cgns([tmp_path / "half.cgns"])
