"""Texts of Netgen and MFEM as others write them: empty lines, numbers for names, foreign meshes, vectors on a plane."""

import numpy as np
import pytest

from elvis import FormatError, integrate, read
from elvis.converters.mfem.files import building_seconds
from elvis.converters.mfem.pieces import _name
from elvis.plugins.testing import values_found

#: a rectangle [0, 3] x [0, 2] of two quadrilaterals, its sides numbered 1 to 4
AREA = """areamesh2
6
1 1 2
1 2 3
2 3 6
3 6 5
3 5 4
4 4 1
2
1 4 1 2 5 4
1 4 2 3 6 5
6
0 0
1 0
3 0
0 2
1 2
3 2
"""

#: a tetrahedron with the corners at the origin and at (1, 0, 0), (0, 2, 0) and (0, 0, 3)
NEUTRAL = """NETGEN_Neutral_Format
4
0 0 0
1 0 0
0 2 0
0 0 3
1
1 1 2 3 4
4
1 1 2 3
2 1 2 4
2 1 3 4
3 2 3 4
"""

#: a square of side 2 of four triangles around its centre, each side a boundary of its own
VOL = """mesh3d

dimension
2

geomtype
0

facedescriptors
1
1 0 0 1 1

surfaceelements
4

{rows}

edgesegmentsgi2
4
1 0 1 2 -1 -1 1 0 1 0 1 0

2 0 2 3 -1 -1 1 0 2 0 2 0

3 0 3 4 -1 -1 1 0 3 0 3 0

4 0 4 1 -1 -1 1 0 4 0 4 0

points
5
0 0 0

2 0 0
2 2 0

0 2 0
1 1 0

materials
1
1 default

bcnames
4
{names}

endmesh
"""
#: a triangle in MFEM's own text
PLAIN = """MFEM mesh v1.0

dimension
2

elements
1
1 2 0 1 2

boundary
1
1 1 0 1

vertices
3
2
0 0
1 0
0 1
"""
ROWS = ["2 1 0 0 3 1 2 5", "2 1 0 0 3 2 3 5", "2 1 0 0 3 3 4 5", "2 1 0 0 3 4 1 5"]


def test_texts_written_by_netgen_are_read_by_mfem(tmp_path):
    pytest.importorskip("mfem.ser")
    (tmp_path / "plane.mesh").write_text(AREA)
    plane = read(tmp_path / "plane.mesh")
    assert integrate(plane, "area")[0].value == pytest.approx(6)
    lengths = [integrate(plane, "length", f"boundary{n}")[0].value for n in range(1, 5)]
    assert lengths == pytest.approx([3, 2, 3, 2])
    (tmp_path / "space.mesh").write_text(NEUTRAL)
    space = read(tmp_path / "space.mesh")
    assert integrate(space, "volume")[0].value == pytest.approx(1)
    assert integrate(space, "area", "boundary1")[0].value == pytest.approx(1)


@pytest.mark.parametrize("text", [AREA, NEUTRAL])
@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_texts_written_by_netgen_must_be_complete(tmp_path, text, share):
    words = text.split()
    (tmp_path / "cut.mesh").write_text("\n".join(words[: int(share * len(words))]))
    with pytest.raises(FormatError, match="expected as many numbers as declared"):
        read(tmp_path / "cut.mesh")


def test_vectors_on_a_plane_may_have_three_components(tmp_path):
    mfem = pytest.importorskip("mfem.ser")
    mesh = mfem.Mesh(2, 2, "TRIANGLE")
    mesh.Save(str(tmp_path / "m.mesh"), 16)
    point = np.array([[0.3, 0.4, 0.0]])
    for kind in ("ND", "RT"):
        collection = getattr(mfem, f"{kind}_R2D_FECollection")(2, 2)
        space = mfem.FiniteElementSpace(mesh, collection)
        function = mfem.GridFunction(space)
        constant = mfem.Vector([1.0, -2.0, 3.0])
        coefficient = mfem.VectorConstantCoefficient(constant)
        function.ProjectCoefficient(coefficient)
        function.Save(str(tmp_path / f"{kind}.gf"), 16)
        dataset = read(tmp_path / "m.mesh", tmp_path / f"{kind}.gf")
        assert list(dataset) == [f"{kind}_{axis}" for axis in "xyz"]
        found = [values_found(dataset, name, point)[0] for name in dataset]
        assert found == pytest.approx([1, -2, 3], abs=1e-9)


@pytest.mark.parametrize(
    ("mesh", "field", "name"),
    [
        ("p.mesh", "pressure.gf", "pressure"),
        ("flow.mesh", "flow.u.gf", "u"),
        ("flow.mesh", "flow-u.gf", "u"),
        ("flow.mesh", "flow.gf", "flow"),
        ("flow.mesh", "flower.gf", "flower"),
    ],
)
def test_names_of_functions_are_never_truncated(tmp_path, mesh, field, name):
    assert _name(tmp_path / mesh, tmp_path / field) == name


def test_time_grows_with_the_order_of_a_space():
    assert building_seconds("FiniteElementCollection: H1_3D_P3\n") == 0
    assert building_seconds("vertices\nFiniteElementCollection: H1_3D_P20\nVDim: 3") > 300
    assert building_seconds("no space") == 0


@pytest.mark.parametrize("between", ["\n", "\n\n", " "])
def test_netgen_meshes_are_parsed_by_tokens_not_by_lines(tmp_path, between):
    pytest.importorskip("ngsolve")
    names = "\n".join(f"{i} default" for i in range(1, 5))
    (tmp_path / "m.vol").write_text(VOL.format(rows=between.join(ROWS), names=names))
    assert integrate(read(tmp_path / "m.vol"), "area")[0].value == pytest.approx(4)


def test_boundaries_of_one_name_are_distinguished_by_number(tmp_path):
    pytest.importorskip("ngsolve")
    names = "\n".join(f"{i} {name}" for i, name in enumerate(("wall", "out", "wall", "in"), 1))
    (tmp_path / "m.vol").write_text(VOL.format(rows="\n".join(ROWS), names=names))
    dataset = read(tmp_path / "m.vol")
    wanted = {"wall": (4, 4), "boundary1": (2, 0), "boundary3": (2, 4), "out": (2, 2)}
    for name, values in wanted.items():
        found = tuple(row.value for row in integrate(dataset, ["length", "y"], name))
        assert found == pytest.approx(values, abs=1e-13)
    assert "boundary2" not in [composite.name for composite in dataset.mesh.composites]


def test_elements_dropped_by_the_library_are_reported(tmp_path, monkeypatch):
    """Counts that a file declares are compared with what arrives."""
    pytest.importorskip("ngsolve")
    pytest.importorskip("mfem.ser")
    names = "\n".join(f"{i} default" for i in range(1, 5))
    (tmp_path / "m.vol").write_text(VOL.format(rows="\n".join(ROWS), names=names))
    (tmp_path / "p.mesh").write_text(PLAIN)
    for path, counter in (("m.vol", "ngsolve.files._declared"), ("p.mesh", "mfem.mfem.declared_elements")):
        monkeypatch.setattr(f"elvis.converters.{counter}", lambda *_: 7)
        with pytest.raises(FormatError, match="expected 7 elements, as the files declare, found"):
            read(tmp_path / path, cache=False)
        monkeypatch.undo()
        assert len(read(tmp_path / path, cache=False).mesh.elements)
