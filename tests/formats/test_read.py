"""Reading: every kind of file the format has, told apart by content, with its habits and its oddities."""

import gzip
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace

import h5py
import numpy as np
import pytest

from elvis.formats import Basis, ElvisError, FormatError, Shape, read, write
from elvis.formats.expansion import mode_count
from elvis.formats.nektar.counts import coefficient_counts

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
        for block, twin in zip(a.blocks, b.blocks, strict=True):
            assert np.array_equal(block.element_ids, twin.element_ids)
            assert np.array_equal(block.coefficients, twin.coefficients)


def test_uniform_data_are_views_of_one_array(case_files):
    dataset = read(*case_files("bfs_tq7"))
    triangles = [field.blocks[0].coefficients for field in dataset.fields]
    bases = {
        coefficients.base.ctypes.data if coefficients.base.base is None else id(coefficients.base.base)
        for coefficients in triangles
    }
    assert len(bases) == 1
    assert all(field.blocks[0].element_ids is dataset.fields[0].blocks[0].element_ids for field in dataset.fields)


def test_sections_of_one_shape_become_one_block(case_files):
    (block,) = read(*case_files("chan3d_tet")).field("p").blocks
    assert block.element_ids.tolist() == [2, 3, 4, 0, 1, 5]


@pytest.mark.parametrize("case", ["gen_allelem_var_h5", "gen_quadface_2d", "cyl_mixorder", "kova_varp"])
def test_mixed_orders_make_a_block_for_each(case, case_files):
    dataset = read(*case_files(case))
    for field in dataset.fields:
        expansions = [block.expansion for block in field.blocks]
        assert len(expansions) == len(set(expansions)) > 1
        ids = np.concatenate([block.element_ids for block in field.blocks])
        assert sorted(ids.tolist()) == dataset.mesh.domain_ids().tolist()


def test_coefficients_are_counted_as_modes_are():
    rng = np.random.default_rng(5)
    families = {
        Shape.TETRAHEDRON: (Basis.MODIFIED_A, Basis.MODIFIED_B, Basis.MODIFIED_C),
        Shape.PYRAMID: (Basis.MODIFIED_A, Basis.MODIFIED_A, Basis.MODIFIED_PYR_C),
        Shape.PRISM: (Basis.MODIFIED_A, Basis.MODIFIED_A, Basis.MODIFIED_B),
        Shape.TRIANGLE: (Basis.MODIFIED_A, Basis.MODIFIED_B),
    }
    from elvis.formats import Expansion

    for shape in Shape:
        bases = families.get(shape, (Basis.MODIFIED_A,) * shape.dimension)
        modes = np.sort(rng.integers(2, 12, (60, shape.dimension)), axis=1)
        counts = coefficient_counts(shape, modes)
        assert counts.tolist() == [mode_count(Expansion(shape, bases, tuple(row))) for row in modes.tolist()]


def test_time_and_metadata(case_files):
    dataset = read(*case_files("chan3d_tet"))
    assert dataset.time == 0.2
    assert dataset.metadata == {"Kinvis": "1", "Time": "0.20000000000000001"}
    assert read(*case_files("kova_varp")).metadata["SessionName1"] == "KovaFlow_varP.xml"
    assert read(*case_files("quad4")).time is None


def test_names_of_composites_and_several_tokens(square):
    mesh = square().mesh
    assert mesh.composite(1).name == "wall"
    assert [(tag, ids.tolist()) for tag, ids in mesh.composite(1).parts] == [("E", [0, 1, 2]), ("E", [3])]
    assert dict(mesh.domains) == {0: (0,)}


def test_ids_that_do_not_exist_are_ignored_in_composites(square):
    mesh = square(("E[3]", "E[3-99999999999,5]"), ("Q[7]", "Q[0-7000000000000]")).mesh
    assert mesh.composite(1).parts[1][1].tolist() == [3]
    assert mesh.domain_ids().tolist() == [7]


def test_several_domains(case_files):
    assert dict(read(case_files("gen_quadface_2d")[0]).mesh.domains) == {0: (409,), 1: (410,)}
    assert dict(read(case_files("gen_tet_p8_nekg2")[0]).mesh.domains) == {0: (105,), 1: (106,)}


def test_expansion_rules(case_files, square):
    rules = read(case_files("tet_small")[0]).expansions
    assert [rule.kind for rule in rules[:1]] == ["Modified_A,Modified_A,Modified_B"]
    assert rules[0].modes == (4, 4, 4)
    assert rules[0].points == (6, 6, 5)
    assert rules[0].point_types == ("GaussLobattoLegendre", "GaussLobattoLegendre", "GaussRadauMAlpha1Beta0")
    entries = """</GEOMETRY> <CONDITIONS>
      <PARAMETERS> <P> N = 3 </P> <P> M = 2*N+1 </P> <P> odd </P> </PARAMETERS> </CONDITIONS>
      <EXPANSIONS> <E COMPOSITE="C[0,4-5]" NUMMODES="M-1" TYPE="MODIFIED" FIELDS="u, v"/>
      <H COMPOSITE="C[0]" TYPE-X="FOURIER" NUMMODES-X="8" TYPE-Y="MODIFIED" NUMMODES-Y="N" FIELDS="p"/>
      <F FILE="x.fld"/> </EXPANSIONS>"""
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
def test_xml_that_strict_parsers_refuse(changes, square, assert_same):
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


def test_gzip_is_seen_by_content(square, tmp_path, assert_same):
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


def test_hdf5_meshes_are_found_beside_in_the_working_folder_or_among_the_files(moved, monkeypatch, assert_same):
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


def test_bare_hdf5_meshes_have_the_least_dimensions(case_files, nektar):
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
    reordered = read(*sorted(folder.iterdir(), reverse=True))
    assert sorted(reordered.mesh.vertex_ids.tolist()) == list(range(36))


def test_parallel_fields_by_folder_by_info_and_by_their_old_name(nektar, tmp_path, assert_same):
    mesh = nektar / "chan_parallel" / "chan_interpfield_nparts_xml"
    folder = nektar / "chan_parallel" / "chan_interpfield_nparts.fld"
    whole = read(mesh, folder)
    assert_same(read(folder / "Info.xml", mesh), whole)
    old = shutil.copytree(folder, tmp_path / "old.fld")
    info = (old / "Info.xml").read_text()
    (old / "Info.xml").write_text(
        info.replace("Partition", "MultipleFldFiles").replace("</Metadata>", "<Time>2.5</Time></Metadata>")
    )
    assert read(old, mesh).time == 2.5
    (old / "Info.xml").unlink()
    assert_same(read(old, mesh), whole)


def test_elements_that_repeat_in_overlapping_partitions_count_once(nektar, tmp_path, assert_same):
    mesh = nektar / "chan_parallel" / "chan_interpfield_nparts_xml"
    folder = shutil.copytree(nektar / "chan_parallel" / "chan_interpfield_nparts.fld", tmp_path / "a.fld")
    whole = read(mesh, folder)
    shutil.copy(folder / "P0000001.fld", folder / "P0000003.fld")
    shutil.copy(folder / "P0000001.fld", folder / "P0000002.fld")
    partial = read(mesh, folder).field("u").blocks[0]
    assert sorted(partial.element_ids.tolist()) == [0, 1, 5, 6, 10, 11, 15, 16, 17, 20, 21, 22]
    place = whole.field("u").blocks[0].element_ids.tolist().index(15)
    assert np.array_equal(
        partial.coefficients[partial.element_ids == 15][0], whole.field("u").blocks[0].coefficients[place]
    )


def test_several_field_files_are_united(case_files, tmp_path, assert_same):
    mesh, fields = case_files("tet_small")
    dataset = read(mesh, fields)
    for name in ("one", "two"):
        kept = dataset.fields[:2] if name == "one" else dataset.fields[1:]
        write(replace(dataset, fields=kept), field_path=tmp_path / f"{name}.fld")
    assert_same(read(tmp_path / "one.fld", mesh, tmp_path / "two.fld"), dataset)
    assert [field.name for field in read(tmp_path / "two.fld", mesh, tmp_path / "one.fld").fields] == [
        "v",
        "w",
        "p",
        "u",
    ]
    block = dataset.fields[1].blocks[0]
    other = replace(dataset.fields[1], blocks=(replace(block, coefficients=block.coefficients + 1e-3),))
    write(replace(dataset, fields=(other,)), field_path=tmp_path / "other.fld")
    with pytest.raises(FormatError, match=r"expected field v once on element \d+, found it twice with other data"):
        read(mesh, fields, tmp_path / "other.fld")


def test_several_roots_in_one_file(case_files, tmp_path, assert_same):
    mesh, fields = case_files("gen_allelem_n4")
    text = fields.read_text()
    split = text.index('    <ELEMENTS FIELDS="u,v" SHAPE="Prism"')
    (tmp_path / "f.fld").write_text(text[:split] + "</NEKTAR>\n<NEKTAR>\n" + text[split:])
    assert_same(read(mesh, tmp_path / "f.fld"), read(mesh, fields))


def test_wrapped_padded_and_bare_payloads(case_files, tmp_path, assert_same):
    mesh, fields = case_files("taylor_q8")
    text = fields.read_text()
    wrapped = re.sub(r"([A-Za-z0-9+/]{76})", "\\1\n", text)
    bare = text.replace(' COMPRESSED="B64Z-LittleEndian" BITSIZE="64"', "")
    lower = text.replace("B64Z-LittleEndian", "b64z-littleendian")
    for changed in (wrapped, bare, lower):
        (tmp_path / "f.fld").write_text(changed)
        assert_same(read(mesh, tmp_path / "f.fld"), read(mesh, fields))


def test_elements_that_the_mesh_lacks_are_skipped(case_files, square, tmp_path):
    dataset = read(*case_files("gen_allelem_n4"))
    write(dataset, field_path=tmp_path / "f.fld")
    text = (tmp_path / "f.fld").read_text()
    (tmp_path / "f.fld").write_text(
        text.replace('ID="112-180"', 'ID="9112-9180"').replace('ID="0-65"', 'ID="60-125"', 1)
    )
    with pytest.raises(FormatError, match="expected element 112 to be a pyramid as in the mesh, found a tetrahedron"):
        read(case_files("gen_allelem_n4")[0], tmp_path / "f.fld")
    (tmp_path / "f.fld").write_text(
        text.replace('ID="112-180"', 'ID="9112-9180"').replace('ID="0-65"', 'ID="0-5,906-965"')
    )
    blocks = read(case_files("gen_allelem_n4")[0], tmp_path / "f.fld").field("u").blocks
    assert [(b.expansion.shape, len(b)) for b in blocks] == [
        (Shape.TETRAHEDRON, 6),
        (Shape.PRISM, 36),
        (Shape.HEXAHEDRON, 10),
    ]
    assert np.array_equal(blocks[0].coefficients, dataset.field("u").blocks[0].coefficients[:6])


def test_fourier_directions(case_files):
    (block,) = read(*case_files("chan3dh1d")).field("u").blocks
    homogeneous = block.expansion.homogeneous
    assert (homogeneous.bases, homogeneous.lengths, homogeneous.y_ids) == ((Basis.FOURIER,), (1.0,), ())
    assert homogeneous.z_ids == tuple(range(8))
    assert block.expansion.modes == (4, 4)
    assert block.coefficients.shape == (4, 8 * 16)


def two_fourier_directions(case_files, tmp_path):
    from elvis.formats import Block, Dataset, Expansion, Field, Homogeneous

    mesh = read(case_files("line_1d")[0]).mesh
    ids = mesh.of(Shape.SEGMENT).ids
    lines = [(y, z) for z in (0, 1, 2, 3) for y in (0, 1)]
    homogeneous = Homogeneous(
        (Basis.FOURIER, Basis.FOURIER), (2.0, 0.1), tuple(z for _, z in lines), tuple(y for y, _ in lines)
    )
    values = np.random.default_rng(3).standard_normal((len(ids), 3 * 8))
    block = Block(Expansion(Shape.SEGMENT, (Basis.MODIFIED_A,), (3,), homogeneous), ids, values)
    return Dataset(mesh, (Field("u", (block,)), Field("v", (replace(block, coefficients=-values),))))


@pytest.mark.parametrize("field_format", ["xml", "hdf5"])
def test_two_fourier_directions_and_strips(field_format, case_files, tmp_path, assert_same):
    dataset = two_fourier_directions(case_files, tmp_path)
    write(dataset, tmp_path / "m.xml", field_format=field_format)
    again = read(tmp_path / "m.xml", tmp_path / "m.fld")
    assert_same(again, replace(dataset, metadata=again.metadata))
    if field_format == "xml":
        head = re.search(r"<ELEMENTS[^>]*>", (tmp_path / "m.fld").read_text())[0]
        assert 'SHAPE="Segment-HomogenousExp2D"' in head
        assert 'HOMOGENEOUSLENGTHS="2.0,0.1"' in head
        assert 'HOMOGENEOUSYIDS="0,1,0,1,0,1,0,1"' in head
        assert 'NUMMODESPERDIR="UNIORDER:3,2,4"' in head


def test_strips_stay_apart(case_files, tmp_path):
    dataset = read(*case_files("chan3dh1d"))
    (block,) = dataset.field("u").blocks
    strips = tuple(
        replace(
            block,
            expansion=replace(block.expansion, homogeneous=replace(block.expansion.homogeneous, strips=(number,))),
            coefficients=block.coefficients + number,
        )
        for number in range(3)
    )
    for field_format in ("xml", "hdf5"):
        write(
            replace(dataset, fields=(replace(dataset.fields[0], blocks=strips),)),
            tmp_path / "m.xml",
            field_format=field_format,
        )
        again = read(tmp_path / "m.xml", tmp_path / "m.fld").field("u").blocks
        assert [b.expansion.homogeneous.strips for b in again] == [(0,), (1,), (2,)]
        assert np.array_equal(again[2].coefficients, block.coefficients + 2)


def test_planes_of_parallel_runs_are_united(case_files, tmp_path):
    mesh, fields = case_files("chan3dh1d")
    (block,) = read(mesh, fields).field("u").blocks
    dataset = read(mesh, fields)
    for name, planes in (("a", (0, 1, 2)), ("b", (3, 4, 5, 6, 7))):
        expansion = replace(block.expansion, homogeneous=replace(block.expansion.homogeneous, z_ids=planes))
        values = block.coefficients.reshape(4, 8, 16)[:, planes].reshape(4, -1)
        part = replace(block, expansion=expansion, coefficients=values)
        write(
            replace(dataset, fields=(replace(dataset.fields[0], blocks=(part,)),)), field_path=tmp_path / f"{name}.fld"
        )
    (whole,) = read(mesh, tmp_path / "a.fld", tmp_path / "b.fld").field("u").blocks
    assert whole.expansion == block.expansion
    assert np.array_equal(whole.coefficients, block.coefficients)


def test_hdf5_files_as_other_programs_may_write_them(case_files, tmp_path, assert_same):
    mesh, fields = case_files("bfs_tq7_hdf5")
    shutil.copy(fields, tmp_path / "f.h5")
    with h5py.File(tmp_path / "f.h5", "r+") as file:
        root = file["NEKTAR"]
        ids, values = root["ELEMENTIDS"][()], root["DATA"][()]
        del root["ELEMENTIDS"], root["DATA"]
        root["ELEMENTIDS"] = ids.astype(np.int64)
        root.create_dataset("DATA", data=values.astype(">f8"), compression="gzip", shuffle=True, chunks=(1000,))
    assert_same(read(mesh, tmp_path / "f.h5"), read(mesh, fields))


def test_reading_needs_no_hdf5_library_for_xml(case_files):
    mesh, fields = case_files("quad4")
    paths = f"{str(mesh)!r}, {str(fields)!r}"
    code = f"import sys; from elvis.formats import read; read({paths}); print('h5py' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "False"


def test_no_mesh_no_files_and_two_meshes(case_files, nektar):
    _, fields = case_files("quad4")
    with pytest.raises(ElvisError, match="expected files to read, found none"):
        read()
    with pytest.raises(FormatError, match=r"no geometry among .*interpfield_4quad\.fld; give the mesh file too"):
        read(fields)
    bare = [next((nektar / case).glob("*.nekg")) for case in ("bfs_tq7_hdf5", "interptest_hdf5")]
    with pytest.raises(FormatError, match="expected one mesh, found"):
        read(*bare)
    with pytest.raises(FormatError, match="found none of its elements"):
        read(case_files("quad4")[0], case_files("sphere_manifold")[1])
