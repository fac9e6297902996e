"""Reading fields: sections, blocks, orders, Fourier directions, pieces of parallel runs."""

import re
import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest

from elvis import Basis, Block, Dataset, Expansion, Field, FormatError, Homogeneous, Shape, read, write
from elvis.core.polynomials.expansion import mode_count
from elvis.formats.nektar.sections import coefficient_counts


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


def test_coefficients_are_counted_like_modes():
    rng = np.random.default_rng(5)
    families = {
        Shape.TETRAHEDRON: (Basis.MODIFIED_A, Basis.MODIFIED_B, Basis.MODIFIED_C),
        Shape.PYRAMID: (Basis.MODIFIED_A, Basis.MODIFIED_A, Basis.MODIFIED_PYR_C),
        Shape.PRISM: (Basis.MODIFIED_A, Basis.MODIFIED_A, Basis.MODIFIED_B),
        Shape.TRIANGLE: (Basis.MODIFIED_A, Basis.MODIFIED_B),
    }
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


def test_elements_missing_from_the_mesh_are_skipped(case_files, tmp_path):
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
    mesh = replace(read(case_files("line_1d")[0]).mesh, space=1)
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


def test_strips_remain_separate(case_files, tmp_path):
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


def test_hdf5_files_of_other_writers(case_files, tmp_path, assert_same):
    mesh, fields = case_files("bfs_tq7_hdf5")
    shutil.copy(fields, tmp_path / "f.h5")
    with h5py.File(tmp_path / "f.h5", "r+") as file:
        root = file["NEKTAR"]
        ids, values = root["ELEMENTIDS"][()], root["DATA"][()]
        del root["ELEMENTIDS"], root["DATA"]
        root["ELEMENTIDS"] = ids.astype(np.int64)
        root.create_dataset("DATA", data=values.astype(">f8"), compression="gzip", shuffle=True, chunks=(1000,))
    assert_same(read(mesh, tmp_path / "f.h5"), read(mesh, fields))


#: the numbers of before March 2017, from names in the sources of that time
OF_BEFORE = {"Fourier": 7, "GLL_Lagrange": 8, "Gauss_Lagrange": 9, "Chebyshev": 11, "FourierSingleMode": 13}


def renumbered(path, version=None):
    """Give the bases of an HDF5 field file the numbers of before, and name the program's version."""
    with h5py.File(path, "r+") as file:
        root = file["NEKTAR"]
        for key in [key for key in root if key.isdigit()]:
            bases = [Basis(code) for code in root[key].attrs["BASIS"]]
            old = [OF_BEFORE.get(basis.label, int(basis)) for basis in bases]
            assert old != [int(basis) for basis in bases]
            root[key].attrs["BASIS"] = np.array(old, np.int32)
        if version:
            root["Metadata"].require_group("Provenance").attrs["NektarVersion"] = version
    return path


@pytest.mark.parametrize("case", ["chan3dh1d", "triquad_h1d", "hex_gll8"])
def test_old_basis_numbers_without_pyramids(case, case_files, tmp_path, assert_same):
    mesh, fields = case_files(case)
    paths = write(read(mesh, fields), tmp_path / "a.xml", field_format="hdf5")
    renumbered(paths[-1])
    assert_same(read(mesh, paths[-1]), read(mesh, fields))


@pytest.mark.parametrize(
    ("version", "basis"), [("4.4.1", Basis.GAUSS_LAGRANGE), ("5.0.0", Basis.FOURIER), (None, Basis.FOURIER)]
)
def test_ambiguous_basis_numbers_are_decided_by_the_version(version, basis, case_files, tmp_path):
    mesh, fields = case_files("hex_gll8")
    data = read(mesh, fields)
    blocks = tuple(
        replace(b, expansion=replace(b.expansion, bases=(Basis.GAUSS_LAGRANGE,) * 3)) for b in data.fields[0].blocks
    )
    paths = write(replace(data, fields=(Field("u", blocks),)), tmp_path / "a.xml", field_format="hdf5")
    again = read(mesh, renumbered(paths[-1], version)).fields[0].blocks[0].expansion
    assert again.bases == (basis,) * 3
