"""Names of boundaries that stand in comments behind their entries."""

import re
from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, Shape, read, write
from elvis.core.base.errors import ElvisError
from elvis.core.data.mesh import Composite
from elvis.core.distances.boundaries import boundaries
from elvis.core.testing import grid
from elvis.formats.nektar.remarks import read_remarks
from elvis.formats.reading import read as read_native
from elvis.plugins.faces import faces_of
from elvis.plugins.runtime.serving import volume_of


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ('<B ID="0"> C[2] </B>    <!-- Wall -->', [(b" C[2] ", "Wall")]),
        ('<B ID="0"> C[2,4-5] </B><!--- z  min /-->', [(b" C[2,4-5] ", "z min")]),
        ('<C ID="7"> Q[0-3] </C>\t<!-- Domain -->', [(b"7", "Domain")]),
        ('<B ID="0"> C[2] </B>\n<!-- Wall -->', []),
        ('<B ID="0"> C[2] </B> <!-- 3 -->', []),
        ('<B ID="0"> C[2] </B> <!-- a, b -->', []),
        ('<B ID="0"> C[2] </B> <!-- ' + "long " * 20 + "-->", []),
        ('<B ID="0"> C[2] </B> <!-- cut', []),
        ("</B> <!-- alone -->", []),
        ("<B> C[2] </B> <!-- without a number -->", []),
        ('<!--<B ID="0"> C[2] </B>--> <P> x </P>', []),
        ('<D VAR="u"/> <!-- velocity -->', []),
    ],
)
def test_comments_behind_entries_are_names(text, found):
    assert read_remarks(text.encode()) == found


@pytest.fixture
def commented(tmp_path):
    """A cube whose composites 1 (z = 0), 2 (z = 1) and 3 (the other sides) are named by comments alone."""
    bare = grid(Shape.HEXAHEDRON, 2)
    faces = bare.of(Shape.QUADRILATERAL)
    members = bare.of(Shape.SEGMENT).members[faces.members].reshape(len(faces), -1)
    places = bare.vertices[members]
    outer = boundaries(bare)["boundary"]
    low, high = (np.flatnonzero((places[:, :, 2] == z).all(axis=1)) for z in (bare.vertices[:, 2].min(), 1.0))
    rest = np.setdiff1d(outer, [*low, *high])
    sides = [Composite(id, (("F", faces.ids[rows]),)) for id, rows in enumerate((low, high, rest), 1)]
    mesh = replace(bare, composites=(bare.composites[0], *sides))
    path = tmp_path / "cube.xml"
    write(Dataset(mesh), path)
    text = path.read_text()
    regions = (
        '<CONDITIONS><BOUNDARYREGIONS>\n<B ID="0"> C[1] </B> <!-- Wall -->\n<B ID="1"> C[2] </B> <!-- Top side -->\n'
        '<B ID="2"> C[3] </B> <!-- Wall -->\n</BOUNDARYREGIONS></CONDITIONS>\n</NEKTAR>'
    )
    path.write_text(text.replace("</NEKTAR>", regions))
    return path


def test_boundaries_are_known_by_them(commented):
    mesh = read_native(commented).mesh
    assert [composite.label for composite in mesh.composites][1:] == ["Wall", "Top side", "Wall"]
    found = boundaries(mesh)
    assert set(found["Wall"]) == {*found["1"], *found["3"]}
    assert set(found["Top side"]) == set(found["2"])


def test_faces_are_selected_by_them(commented):
    dataset = read(commented)
    faces = faces_of(dataset, volume_of(dataset, ["x"]))
    count = lambda *words: sum(map(len, faces.select(words)))  # noqa: E731
    assert count("Wall") == count("1", "3") == 20
    assert count("Top side") == 4
    with pytest.raises(ElvisError, match=re.escape("found 'wall' (perhaps Wall)")):
        faces.select(["wall"])


def test_file_names_precede_remarks(commented):
    mesh = read_native(commented).mesh
    named = replace(mesh, composites=(replace(mesh.composites[1], name="Top side"), *mesh.composites[2:]))
    assert set(boundaries(named)["Top side"]) == set(boundaries(mesh)["1"])


@pytest.mark.parametrize(
    ("case", "walls"),
    [
        ("hex_gll8", {"Inlet", "Outlet", "Wall", "Wall left", "Wall right"}),
        ("bfs_tq7_hdf5", {"Wall", "Inlet", "Outlet"}),
    ],
)
def test_files_of_the_solver(nektar, case, walls):
    (mesh,) = [path for path in (nektar / case).iterdir() if path.suffix == ".xml"]
    assert walls <= boundaries(read_native(mesh).mesh).keys()
