"""Reading: every kind of file the format has, told apart by content, with its habits and its oddities."""

import gzip
import os
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from elvis import ElvisError, FormatError, Shape, write
from elvis.core.polynomials.expansion import mode_count
from elvis.formats.reading import read, read_part

SQUARE = """<?xml version="1.0" encoding="utf-8" ?>
<NEKTAR>
  <GEOMETRY DIM="2" SPACE="2">
    <VERTEX> <V ID="0">0 0 0</V> <V ID="1">1 0 0</V> <V ID="2">1 1 0</V> <V ID="3">0 1 0</V> </VERTEX>
    <EDGE> <E ID="0">0 1</E> <E ID="1">1 2</E> <E ID="2">2 3</E> <E ID="3">3 0</E> </EDGE>
    <ELEMENT> <Q ID="7">0 1 2 3</Q> </ELEMENT>
    <COMPOSITE> <C ID="0"> Q[7] </C> <C ID="1" NAME="wall"> E[0-2] E[3] </C> </COMPOSITE>
    <DOMAIN> C[0] </DOMAIN>
  </GEOMETRY>
</NEKTAR>
"""


@pytest.fixture
def square(tmp_path):
    """Writes the unit square, changed as asked, and reads it."""

    def changed(*changes, text=SQUARE, name="square.xml"):
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / name).write_text(text)
        return read(tmp_path / name)

    return changed


def test_every_case_reads(case, case_files):
    mesh, fields = case_files(case)
    dataset = read(*[path for path in (fields, mesh) if path])
    assert len(dataset.mesh.domain_ids())
    assert bool(dataset.fields) == bool(fields)
    for field in dataset.fields:
        for block in field.blocks:
            present = dataset.mesh.of(block.expansion.shape).ids
            assert np.isin(block.element_ids, present).all()
            planes = len(block.expansion.homogeneous.z_ids) if block.expansion.homogeneous else 1
            plain = replace(block.expansion, homogeneous=None)
            assert block.coefficients.shape == (len(block), mode_count(plain) * planes)
            assert not block.coefficients.flags.writeable
            assert block.coefficients.flags.c_contiguous


@pytest.mark.parametrize("pair", [("bfs_tq7", "bfs_tq7_hdf5"), ("interptest", "interptest_hdf5")])
def test_xml_and_hdf5_of_one_dataset_are_the_same(pair, case_files):
    one, other = (read(*case_files(case)) for case in pair)
    for shape in one.mesh.entities:
        assert np.array_equal(one.mesh.of(shape).ids, other.mesh.of(shape).ids)
        assert np.array_equal(one.mesh.of(shape).members, other.mesh.of(shape).members)
    assert np.abs(one.mesh.vertices - other.mesh.vertices).max() < 1e-8
    for a, b in zip(one.fields, other.fields, strict=True):
        assert a.name == b.name
        for block, other in zip(a.blocks, b.blocks, strict=True):
            assert np.array_equal(block.element_ids, other.element_ids)
            assert np.array_equal(block.coefficients, other.coefficients)


def test_names_of_composites_and_several_tokens(square):
    mesh = square().mesh
    assert mesh.composite(1).name == "wall"
    assert [(tag, ids.tolist()) for tag, ids in mesh.composite(1).parts] == [("E", [0, 1, 2, 3])]
    assert dict(mesh.domains) == {0: (0,)}


def test_ids_that_do_not_exist_are_ignored_in_composites(square):
    mesh = square(("E[3]", "E[3-99999999999,5]"), ("Q[7]", "Q[0-7000000000000], Q[]")).mesh
    assert mesh.composite(1).parts[0][1].tolist() == [0, 1, 2, 3]
    assert mesh.domain_ids().tolist() == [7]


def test_several_domains(case_files):
    assert dict(read(case_files("gen_quadface_2d")[0]).mesh.domains) == {0: (409,), 1: (410,)}
    assert dict(read(case_files("gen_tet_p8_nekg2")[0]).mesh.domains) == {0: (105,), 1: (106,)}


def test_expansion_rules(case_files, square):
    rules = read(case_files("tet_small")[0]).expansions
    assert [rule.kind for rule in rules] == ["Modified_A,Modified_B,Modified_C"] * 2  # those for no composite are left
    assert rules[0].modes == (4, 4, 4)
    assert rules[0].points == (6, 5, 5)
    assert rules[0].point_types == ("GaussLobattoLegendre", "GaussRadauMAlpha1Beta0", "GaussRadauMAlpha2Beta0")
    entries = """</GEOMETRY> <CONDITIONS>
      <PARAMETERS> <P> N = 3 </P> <P> M = 2*N+1 </P> <P> odd </P> </PARAMETERS> </CONDITIONS>
      <EXPANSIONS> <E COMPOSITE="C[0,4-5]" NUMMODES="M-1" TYPE="MODIFIED" FIELDS="u, v"/>
      <H COMPOSITE="C[0]" TYPE-X="FOURIER" NUMMODES-X="8" TYPE-Y="MODIFIED" NUMMODES-Y="N" FIELDS="p"/>
      <E COMPOSITE="C[0]" NUMMODES="unknown" TYPE="MODIFIED" FIELDS="w"/> <F FILE="x.fld"/> </EXPANSIONS>"""
    rules = square(("</GEOMETRY>", entries)).expansions
    assert [(rule.composites, rule.kind, rule.modes, rule.fields) for rule in rules] == [
        ((0,), "MODIFIED", (6,), ("u", "v")),
        ((0,), "FOURIER,MODIFIED", (8, 3), ("p",)),
    ]


CURVES = """</ELEMENT>
    <CURVED>
      <E ID="0" EDGEID="2" NUMPOINTS="3" TYPE="PolyEvenlySpaced">1 1 0  .5 1.25 0  0 1 0</E>
      <F ID="1" FACEID="7" NUMPOINTS="4" TYPE="GaussLobattoLegendre">0 0 0 1 0 0 0 1 0 1 1 0</F>
    </CURVED>"""


def test_scaling_of_text_moves_vertices_and_edges_but_not_faces(square):
    mesh = square(
        ("<VERTEX>", '<VERTEX XSCALE="2*PI/(1+1)" YMOVE="-sqrt(4)^2" ZMOVE="9">'), ("</ELEMENT>", CURVES)
    ).mesh
    assert np.allclose(
        mesh.vertices, np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * [np.pi, 1, 0] - [0, 4, 0]
    )
    assert np.allclose(mesh.edge_curves.points, [[np.pi, -3, 0], [np.pi / 2, -2.75, 0], [0, -3, 0]])
    assert np.allclose(mesh.face_curves.points, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    assert mesh.edge_curves.rows.tolist() == [2]
    assert mesh.edge_curves.kinds.tolist() == [17]
    assert mesh.face_curves.kinds.tolist() == [4]


def test_scaling_of_compressed_files_moves_all(square, tmp_path):
    write(square(("</ELEMENT>", CURVES)), tmp_path / "packed.xml")
    text = (tmp_path / "packed.xml").read_text().replace("<VERTEX ", '<VERTEX XSCALE="3" ')
    mesh = square(text=text).mesh
    assert mesh.vertices[2].tolist() == [3, 1, 0]
    assert mesh.edge_curves.points[1].tolist() == [1.5, 1.25, 0]
    assert mesh.face_curves.points[3].tolist() == [3, 1, 0]


def test_coordinates_beyond_the_space_are_ignored(square):
    assert square(("1 1 0<", "1 1 6.9e-310<")).mesh.vertices[2].tolist() == [1, 1, 0]
    assert square(("1 1 0<", "1 1 6.9e-310<"), ('SPACE="2"', 'SPACE="3"')).mesh.vertices[2, 2] == 6.9e-310


@pytest.mark.parametrize(
    "changes",
    [
        [("<?xml", "\n\n  <?xml")],
        [("<?xml", "\ufeff<?xml")],
        [("<NEKTAR>", "<!-- a -- b --- c <GEOMETRY> --><NEKTAR>")],
        [("<EDGE>", "<EDGE> <!-- <E ID='9'>0 0</E> -->")],
        [("  <GEOMETRY", "  <NOTE>\x01 a & b &unknown; <![CDATA[ </NEKTAR> <x ]]> </NOTE>\n<GEOMETRY")],
        [("<GEOMETRY", '<CONDITIONS> <I VALUE="x>0 and y<1"/> </CONDITIONS> <GEOMETRY')],
        [('ID="0"', "ID = '0'")],
        [("</V>", "</V\n>"), ("<Q ID", "<Q\tID")],
        [('<?xml version="1.0" encoding="utf-8" ?>\n', "")],
        [("<NEKTAR>", "<NEKTAR note='>'>"), ("</NEKTAR>", "</NEKTAR> trailing")],
    ],
)
def test_xml_rejected_by_strict_parsers(changes, square, assert_same):
    assert_same(square(*changes), square())


def test_files_are_merged_tag_by_tag(tmp_path, square):
    square()
    (tmp_path / "other.xml").write_text(
        '<NEKTAR> <GEOMETRY/> <EXPANSIONS><E COMPOSITE="C[0]" NUMMODES="2" TYPE="MODIFIED"/></EXPANSIONS> </NEKTAR>'
    )
    (tmp_path / "empty.xml").write_text("<NEKTAR> <EXPANSIONS> </EXPANSIONS> </NEKTAR>")
    names = [tmp_path / name for name in ("square.xml", "other.xml", "empty.xml")]
    assert read(*names).expansions[0].modes == (2,)
    assert read(*reversed(names)).expansions[0].modes == (2,)
    (tmp_path / "last.xml").write_text((tmp_path / "square.xml").read_text().replace('ID="7"', 'ID="8"'))
    assert read(*names, tmp_path / "last.xml").mesh.of(Shape.QUADRILATERAL).ids.tolist() == [8]


def test_gzip_is_recognised_by_content(square, tmp_path, assert_same):
    dataset = square()
    packed = gzip.compress(SQUARE[:300].encode()) + gzip.compress(SQUARE[300:].encode())
    (tmp_path / "plain_name.xml").write_bytes(packed)
    assert_same(read(tmp_path / "plain_name.xml"), dataset)


@pytest.fixture
def moved(nektar, tmp_path):
    """A case whose mesh is in HDF5, copied."""
    for path in (nektar / "interptest_hdf5").iterdir():
        shutil.copy(path, tmp_path / path.name)
    return tmp_path


def test_hdf5_meshes_are_found_next_to_the_file_in_the_working_folder_or_among_the_arguments(
    moved, monkeypatch, assert_same
):
    dataset = read(moved / "interptest_hdf5.xml", moved / "interptest_hdf5.fld")
    elsewhere = moved / "elsewhere"
    elsewhere.mkdir()
    nekg = shutil.move(moved / "interptest_hdf5.nekg", elsewhere)
    with pytest.raises(
        FormatError, match=r"interptest_hdf5\.xml: line 3, <GEOMETRY>: expected the file interptest_hdf5\.nekg"
    ):
        read(moved / "interptest_hdf5.xml")
    assert_same(read(moved / "interptest_hdf5.fld", nekg, moved / "interptest_hdf5.xml"), dataset)
    os.rename(nekg, elsewhere / "renamed.h5")
    assert_same(read(elsewhere / "renamed.h5", moved / "interptest_hdf5.xml", moved / "interptest_hdf5.fld"), dataset)
    bare = read(elsewhere / "renamed.h5")
    assert (bare.mesh.dimension, bare.mesh.space) == (2, 2)
    os.rename(elsewhere / "renamed.h5", elsewhere / "interptest_hdf5.nekg")
    monkeypatch.chdir(elsewhere)
    assert_same(read(moved / "interptest_hdf5.xml", moved / "interptest_hdf5.fld"), dataset)


def test_bare_hdf5_meshes_have_the_minimum_dimension(case_files, nektar):
    for case, expected in (("bfs_tq7_hdf5", (2, 2)), ("gen_tet_p8_nekg2", (3, 3))):
        (path,) = (nektar / case).glob("*.nekg")
        bare, full = read(path), read(case_files(case)[0])
        assert (bare.mesh.dimension, bare.mesh.space) == expected == (full.mesh.dimension, full.mesh.space)
        assert np.array_equal(bare.mesh.vertices, full.mesh.vertices)


def test_pieces_of_a_mesh_are_united_by_ids(nektar, assert_same):
    folder = nektar / "chan_parallel" / "chan_interpfield_nparts_xml"
    whole = read(folder)
    assert len(whole.mesh.of(Shape.QUADRILATERAL)) == 25
    assert sorted(whole.mesh.vertex_ids.tolist()) == list(range(36))
    assert sorted(whole.mesh.of(Shape.SEGMENT).ids.tolist()) == list(range(60))
    assert whole.mesh.composite(0).parts[0][1].tolist()[:4] == [0, 1, 5, 6]
    assert len(whole.mesh.domain_ids()) == 25
    assert_same(read(*sorted(folder.iterdir())), whole)
    assert_same(read(*sorted(folder.iterdir()), folder / "P0000002.xml"), whole)
    reordered = read(*sorted(folder.iterdir(), reverse=True))
    assert sorted(reordered.mesh.vertex_ids.tolist()) == list(range(36))


@pytest.mark.parametrize("number", range(4))
def test_a_piece_of_a_mesh_that_is_missing(nektar, tmp_path, number):
    """Told by the numbers of the others; of the last one by the fields, which are on its elements."""
    folder, fields = (nektar / "chan_parallel" / f"chan_interpfield_nparts{end}" for end in ("_xml", ".fld"))
    for path in folder.iterdir():
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / f"P000000{number}.xml").unlink()
    if number < 3:
        with pytest.raises(
            FormatError, match=f"expected the pieces of a mesh .*, found none named P000000{number}.xml"
        ):
            read(tmp_path, fields)
        return
    whole = read(tmp_path, fields)
    lacking = 25 - len(whole.mesh.of(Shape.QUADRILATERAL))
    assert whole.remarks == (f"fields are on {lacking} elements that are not in the mesh; they are ignored",)
    assert read_part(0, 2, tmp_path, fields).dataset.remarks == whole.remarks
    assert read(folder, fields).remarks == ()


def test_reading_needs_no_hdf5_library_for_xml(case_files):
    mesh, fields = case_files("quad4")
    paths = f"{str(mesh)!r}, {str(fields)!r}"
    code = f"import sys; from elvis.formats import read; read({paths}); print('h5py' in sys.modules)"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert result.stdout.strip() == "False"


def test_missing_and_duplicate_meshes(case_files, nektar):
    _, fields = case_files("quad4")
    with pytest.raises(ElvisError, match="expected files to read, found none"):
        read()
    with pytest.raises(
        FormatError,
        match=r"no geometry among .*4quad\.fld, where only fields are; also give the mesh file, ",
    ):
        read(fields)
    bare = [next((nektar / case).glob("*.nekg")) for case in ("bfs_tq7_hdf5", "interptest_hdf5")]
    with pytest.raises(FormatError, match="expected one mesh, found"):
        read(*bare)
    with pytest.raises(FormatError, match="found none of its elements"):
        read(case_files("quad4")[0], case_files("sphere_manifold")[1])
