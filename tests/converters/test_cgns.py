"""CGNS meshes against points that Gmsh evaluated, and against a file that it writes here."""

import shutil

import numpy as np
import pytest

from elvis.converters.cgns import Cgns
from elvis.formats import FormatError, write
from elvis.formats.judging.strict import findings
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


def test_what_it_does_not_take(solvers, tmp_path):
    assert not Cgns.opens([solvers / "gmsh" / "mixed_o3.msh"])
    assert not Cgns.opens([tmp_path / "missing.cgns"])
    whole = (solvers / "cgns" / "gmsh_ball_tet_o3.cgns").read_bytes()
    (tmp_path / "half.cgns").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FormatError):
        Cgns([tmp_path / "half.cgns"])
