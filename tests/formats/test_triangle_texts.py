"""Triangles of text files against trimesh, which reads them by other code, and against shapes known beforehand."""

import tracemalloc

import numpy as np
import pytest
import trimesh

from elvis.core.base.errors import FormatError
from elvis.core.distances.triangle_files import corners_of, triangles_of

VERTICES = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0 0.5 0.5 0.5\n"
PLY = """ply
format ascii 1.0
comment a square and a triangle
element vertex 5
property uchar red
property float x
property float y
property float z
element skipped 2
property list uchar int numbers
element face 2
property float weight
property list uchar int vertex_indices
end_header
9 0 0 0
9 1 0 0
9 1 1 0
9 0 1 0
9 2 0 0
3 0 0 0
0
0.5 4 0 1 2 3
0.5 3 1 4 2
"""
#: corners of the square in two triangles
SQUARE = [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]]


def written(path, text):
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize(
    ("name", "options"),
    [("a.obj", {}), ("a.stl", {"file_type": "stl_ascii"}), ("a.ply", {"encoding": "ascii"}), ("b.ply", {})],
)
def test_triangles_are_those_that_trimesh_reads(tmp_path, name, options):
    path = tmp_path / name
    trimesh.creation.icosphere(subdivisions=2).export(path, **options)
    others = trimesh.load_mesh(path, process=False).triangles
    # it rounds what a text declares to be ``float``
    rounding = 6e-8 if name == "a.ply" else 0.0
    assert np.abs(corners_of(str(path)) - others).max() <= rounding


@pytest.mark.parametrize(
    "faces", ["f 1 2 3 4", "f 1/1 2/2/5 3//7 4 # a square", "f -4 -3 -2 -1", " f 1 2 \\\n3 4\r", "f 1 2 3\nf 1 3 4\n"]
)
def test_polygons_of_obj_are_fans(tmp_path, faces):
    path = written(tmp_path / "a.obj", f"o name\n{VERTICES}vn 0 0 1\n{faces}\nv 9 9 9")
    assert np.array_equal(corners_of(path), SQUARE)


def test_negative_indices_count_from_the_line(tmp_path):
    path = written(tmp_path / "a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 0 1 0\nf -4 -2 -1\n")
    assert np.array_equal(corners_of(path), SQUARE)


def test_other_elements_and_properties_of_ply_are_skipped(tmp_path):
    found = corners_of(written(tmp_path / "a.ply", PLY))
    assert np.array_equal(found, [*SQUARE, [[1, 0, 0], [2, 0, 0], [1, 1, 0]]])


def test_all_solids_of_stl_are_read(tmp_path):
    facet = "facet normal 0 0 1\n outer loop\n vertex 0 0 0\n VERTEX 1 0 0 vertex\n1 1 0\nendloop endfacet\n"
    path = written(tmp_path / "a.stl", f"solid vertex 1 2 3\n{facet}endsolid\n" * 3)
    assert np.array_equal(corners_of(path), SQUARE[:1] * 3)


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("a.obj", VERTICES + "f 1 2 5", "face: expected corners among 4 vertices, found others"),
        ("a.obj", VERTICES + "f 1 2", "face: expected three corners or more, found 2"),
        ("a.obj", VERTICES + "f 1 2 x", "expected numbers, found something else"),
        ("a.obj", VERTICES + "v 1\nf 1 2 3", "expected three coordinates for each vertex"),
        ("a.obj", VERTICES + "v \nf 1 2 3", "expected three coordinates for each vertex"),
        ("a.obj", "v 0 0 0\nv 1 0 nan\nv 1 1 0\nf 1 2 3", "expected finite coordinates, found others"),
        ("a.obj", VERTICES, "expected triangles, found none"),
        ("a.ply", PLY.replace("face 2", "face 200"), "face: expected 200 rows, found fewer numbers"),
        ("a.ply", PLY.replace("0.5 4 0", "0.5 400 0"), "expected lengths of lists, found other numbers"),
        ("a.ply", PLY.replace("0.5 4 0", "0.5 4 0.5"), "face: expected corners among 5 vertices, found others"),
        ("a.ply", PLY.replace("float x", "float a"), "header: expected vertices with numbers x, y and z"),
        ("a.ply", PLY.replace("face 2", "face -2"), "expected an element or a property, found 'element face -2'"),
        ("a.stl", "solid a\nvertex 0 0 0\nendsolid", "expected three vertices for each facet, found 1 vertices"),
    ],
)
def test_invalid_texts_give_one_line_errors(tmp_path, name, text, reason):
    with pytest.raises(FormatError, match=reason) as refused:
        triangles_of(written(tmp_path / name, text))
    assert str(refused.value).startswith(str(tmp_path / name))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("corner", [-1, 42])
def test_binary_files_with_corners_that_there_are_not_are_rejected(tmp_path, corner):
    mesh = trimesh.creation.icosphere(subdivisions=1)
    mesh.faces[7, 1] = corner
    (tmp_path / "a.ply").write_bytes(mesh.export(file_type="ply", vertex_normal=False))
    with pytest.raises(FormatError, match=r"a\.ply: face: expected corners among 42 vertices, found others"):
        triangles_of(str(tmp_path / "a.ply"))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.obj", VERTICES + "f" + " 1 2 3" * 50_000),
        ("b.obj", VERTICES + "f 1 2 3 1 2\n" * 25_000),
        ("a.ply", PLY.replace("0.5 4 0 1 2 3", "0.5 150000" + " 0 1 2" * 50_000)),
        ("a.stl", "solid\nendsolid\n" * 20_000 + "solid\n" + "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n" * 3000),
    ],
)
def test_memory_is_in_proportion_to_the_file(tmp_path, name, text):
    path = written(tmp_path / name, text)
    triangles_of(path)
    tracemalloc.start()
    triangles_of(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40 * len(text)
