"""Written files: reading back gives the same bits, other programs find what they need, and nothing is left half."""

import os
import re
from dataclasses import replace

import h5py
import numpy as np
import pytest

from elvis import Composite, ElvisError, Field, read, write

MESH_FORMATS = ["compressed", "text", "hdf5"]
FIELD_FORMATS = ["xml", "hdf5"]


def dataset_of(case_files, case):
    return read(*[path for path in case_files(case) if path])


@pytest.mark.parametrize("mesh_format", MESH_FORMATS)
def test_meshes_round_trip_bit_by_bit(case, mesh_format, case_files, assert_same, tmp_path):
    dataset = replace(dataset_of(case_files, case), fields=())
    files = write(dataset, tmp_path / "mesh.xml", mesh_format=mesh_format)
    assert [file.name for file in files] == ["mesh.xml", "mesh.nekg"][: len(files)]
    assert_same(read(tmp_path / "mesh.xml"), dataset)


@pytest.mark.parametrize("field_format", FIELD_FORMATS)
def test_fields_round_trip_bit_by_bit(case, field_format, case_files, assert_same, tmp_path):
    dataset = dataset_of(case_files, case)
    if not dataset.fields:
        pytest.skip("the case has no fields")
    write(dataset, tmp_path / "a.xml", field_format=field_format)
    assert_same(read(tmp_path / "a.fld", tmp_path / "a.xml"), dataset)


def mixed(case_files, case="gen_allelem_n4"):
    return dataset_of(case_files, case)


@pytest.mark.parametrize("name", ["a.xml.gz", "b.xml"])
def test_files_named_gz_are_compressed(name, case_files, assert_same, tmp_path):
    dataset = mixed(case_files)
    write(dataset, tmp_path / name, tmp_path / "fields.fld.gz")
    assert (tmp_path / name).read_bytes()[:2] == (b"\x1f\x8b" if name.endswith(".gz") else b"<?")
    assert_same(read(tmp_path / name, tmp_path / "fields.fld.gz"), dataset)


def test_fields_with_and_without_a_mesh(case_files, assert_same, tmp_path):
    mesh, _ = case_files("tet_small")
    dataset = mixed(case_files, "tet_small")
    assert write(dataset, field_path=tmp_path / "only.chk") == (tmp_path / "only.chk",)
    assert_same(read(mesh, tmp_path / "only.chk"), dataset)
    assert write(dataset, tmp_path / "x.xml.gz", mesh_format="hdf5") == (
        tmp_path / "x.xml.gz",
        tmp_path / "x.nekg",
        tmp_path / "x.fld",
    )
    assert_same(read(tmp_path / "x.nekg", tmp_path / "x.fld"), dataset)


def test_time_and_metadata_are_written_with_every_file(case_files, tmp_path):
    dataset = replace(mixed(case_files), time=0.1 + 0.2, metadata={"Kinvis": "1 < 2 & 3", "GeometryMap": "map_x"})
    for name, field_format in (("x", "xml"), ("h", "hdf5")):
        write(dataset, tmp_path / f"{name}.xml", field_format=field_format)
        again = read(tmp_path / f"{name}.xml", tmp_path / f"{name}.fld")
        assert again.time == 0.1 + 0.2
        assert again.metadata == {"Kinvis": "1 < 2 & 3", "GeometryMap": "map_x", "Time": repr(0.1 + 0.2)}
    write(replace(dataset, fields=()), tmp_path / "mesh.xml")
    assert read(tmp_path / "mesh.xml").metadata["Kinvis"] == "1 < 2 & 3"


def test_special_values_round_trip(case_files, tmp_path):
    dataset = mixed(case_files, "quad4")
    block = dataset.fields[0].blocks[0]
    values = block.coefficients.copy()
    values.flat[:5] = [np.nan, np.inf, -np.inf, -0.0, 5e-324]
    special = replace(dataset, fields=(Field("odd", (replace(block, coefficients=values),)),))
    for field_format in FIELD_FORMATS:
        write(special, tmp_path / "s.xml", field_format=field_format)
        again = read(tmp_path / "s.xml", tmp_path / "s.fld").field("odd").blocks[0].coefficients
        assert again.tobytes() == values.tobytes()


@pytest.mark.parametrize("mesh_format", MESH_FORMATS)
def test_a_mesh_without_domain_gets_one_of_all_elements(mesh_format, case_files, tmp_path):
    dataset = mixed(case_files)
    bare = replace(dataset, mesh=replace(dataset.mesh, domains={}), expansions=())
    write(bare, tmp_path / "m.xml", mesh_format=mesh_format)
    again = read(tmp_path / "m.xml", tmp_path / "m.fld")
    assert again.mesh.domain_ids().tolist() == dataset.mesh.domain_ids().tolist()
    added = [again.mesh.composite(id) for id in again.mesh.domains[0]]
    assert [[tag for tag, _ in composite.parts] for composite in added] == [["A"], ["P"], ["R"], ["H"]]
    assert not {c.id for c in added} & {c.id for c in dataset.mesh.composites}


@pytest.mark.parametrize("mesh_format", MESH_FORMATS)
def test_names_of_composites_are_preserved_and_empty_composites_dropped(mesh_format, case_files, tmp_path):
    dataset = mixed(case_files)
    named = Composite(77, (("A", dataset.mesh.composites[0].parts[0][1][:3]),), "wall & <inflow>")
    empty = Composite(78, (("A", dataset.mesh.composites[0].parts[0][1][:0]),))
    mesh = replace(dataset.mesh, composites=(*dataset.mesh.composites, named, empty))
    write(replace(dataset, mesh=mesh, fields=()), tmp_path / "m.xml", mesh_format=mesh_format)
    again = read(tmp_path / "m.xml").mesh
    assert again.composite(77).name == "wall & <inflow>"
    assert again.composite(78) is None


def test_expansions_cover_every_field_at_the_order_of_the_data(case, case_files, tmp_path):
    dataset = dataset_of(case_files, case)
    write(dataset, tmp_path / "m.xml")
    again = read(tmp_path / "m.xml", *([tmp_path / "m.fld"] if dataset.fields else []))
    names = {field.name for field in dataset.fields}
    for composite in {c for composites in again.mesh.domains.values() for c in composites}:
        rules = [rule for rule in again.expansions if composite in rule.composites]
        fields = [name for rule in rules for name in rule.fields]
        assert len(fields) == len(set(fields))
        assert names <= set(fields)
        elements = np.concatenate([ids for _, ids in again.mesh.composite(composite).parts])
        for field in dataset.fields:
            orders = [max(b.expansion.modes) for b in field.blocks if np.isin(b.element_ids, elements).any()]
            (rule,) = [rule for rule in rules if field.name in rule.fields]
            assert min(rule.modes) >= max(orders, default=0)


def test_output_is_strict_xml_with_payloads_on_one_line(case, case_files, tmp_path):
    etree = pytest.importorskip("lxml.etree")
    dataset = dataset_of(case_files, case)
    write(dataset, tmp_path / "m.xml")
    for path in tmp_path.iterdir():
        root = etree.parse(str(path), etree.XMLParser(huge_tree=True)).getroot()
        assert root.tag == "NEKTAR"
        for element in root.iter():
            if "COMPRESSED" in element.attrib and not len(element):
                assert element.get("BITSIZE") == "64"
                assert re.fullmatch(r"[A-Za-z0-9+/]+", element.text)
                assert len(element.text) % 4 == 0
    geometry = etree.parse(str(tmp_path / "m.xml")).getroot().find("GEOMETRY")
    assert set(geometry.attrib) == {"DIM", "SPACE"}


def test_one_section_a_shape_with_mixed_orders(case_files, tmp_path):
    dataset = mixed(case_files, "gen_allelem_var_h5")
    write(dataset, field_path=tmp_path / "f.fld")
    heads = re.findall(r'SHAPE="(\w+)".*?NUMMODESPERDIR="(\w+):', (tmp_path / "f.fld").read_text())
    assert heads == [(name, "MIXORDER") for name in ("Tetrahedron", "Pyramid", "Prism", "Hexahedron")]


def facts(path):
    """What h5dump shows: kind, type, string form and space of every attribute and dataset, by path."""
    found = {}

    def string_form(type_id):
        if not isinstance(type_id, h5py.h5t.TypeStringID):
            return type_id.dtype.str
        return ("variable" if type_id.is_variable_str() else "fixed", type_id.get_cset(), type_id.get_strpad())

    def visit(name, item):
        name = re.sub(r"\d{3,}|(?<=NEKTAR/)\d+", "KEY", name)
        if isinstance(item, h5py.Dataset):
            rank, kind = item.ndim, string_form(item.id.get_type())
            found[name] = ("dataset", kind, rank, item.shape[1:], item.chunks, item.compression)
        for key in item.attrs:
            attribute = h5py.h5a.open(item.id, key.encode())
            found[f"{name}@{key}"] = (string_form(attribute.get_type()), attribute.get_space().get_simple_extent_type())

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    return found


@pytest.mark.parametrize("case", ["bfs_tq7_hdf5", "interptest_hdf5", "gen_tet_p8_nekg2"])
def test_hdf5_meshes_have_the_types_of_real_files(case, nektar, case_files, tmp_path):
    (real,) = (nektar / case).glob("*.nekg")
    write(dataset_of(case_files, case), tmp_path / "m.xml", mesh_format="hdf5")
    # names that comments or regions give stand in an attribute that other readers pass over
    found = {key: fact for key, fact in facts(tmp_path / "m.nekg").items() if not key.endswith("COMPOSITE@NAME")}
    assert found == facts(real)
    with h5py.File(tmp_path / "m.nekg") as mine, h5py.File(real) as other:
        for group in ("MESH", "MAPS"):
            for name, values in other[f"NEKTAR/GEOMETRY/{group}"].items():
                kept = slice(None) if name != "CURVE_NODES" else np.s_[:, :2]  # the third of two is never set
                assert np.array_equal(mine[f"NEKTAR/GEOMETRY/{group}/{name}"][kept], values[kept]), name


@pytest.mark.parametrize("case", ["bfs_tq7_hdf5", "kova_varp", "gen_allelem_var_h5", "triquad_h5", "gen_hex_xscale"])
def test_hdf5_fields_have_the_types_of_real_files(case, case_files, tmp_path):
    _, real = case_files(case)
    dataset = dataset_of(case_files, case)
    metadata = {key: text for key, text in dataset.metadata.items() if key != "NekMeshCommandLine"}  # of the mesh
    write(replace(dataset, metadata=metadata), field_path=tmp_path / "f.fld", field_format="hdf5")
    provenance = {key for key in facts(real) if "Provenance@" in key}
    assert facts(tmp_path / "f.fld") == {key: fact for key, fact in facts(real).items() if key not in provenance}
    with h5py.File(tmp_path / "f.fld") as mine:
        keys = {int(key) for key in mine["NEKTAR"] if key.isdigit()}
        assert sorted(mine["NEKTAR/DECOMPOSITION"][()].reshape(-1, 7)[:, 6]) == sorted(keys)
        assert 0 not in keys


@pytest.mark.parametrize("case", ["chan3dh1d", "naca_h1d_line", "triquad_h1d"])
def test_orders_of_fourier_directions_are_written_like_the_solver(case, case_files, tmp_path):
    _, real = case_files(case)
    write(dataset_of(case_files, case), field_path=tmp_path / "f.fld")
    pattern = r'(?:NUMMODESPERDIR|HOMOGENEOUSZIDS|SHAPE|BASIS)="[^"]*"'
    assert set(re.findall(pattern, (tmp_path / "f.fld").read_text())) == set(re.findall(pattern, real.read_text()))


def test_a_failed_write_changes_nothing(case_files, tmp_path, monkeypatch):
    dataset = mixed(case_files)
    old = {name: (tmp_path / name).write_text(name) and name for name in ("m.xml", "m.nekg", "m.fld")}

    def full_disk(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("elvis.formats.nektar.fields_output.write_hdf5", full_disk)
    with pytest.raises(ElvisError, match=r"m\.fld: cannot be written: No space left on device"):
        write(dataset, tmp_path / "m.xml", mesh_format="hdf5", field_format="hdf5")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == old


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "expected the name of a file to write, found none"),
        ({"path": "a.xml", "field_path": "a.xml"}, "a.xml: expected two names"),
        ({"path": "a.nekg", "mesh_format": "hdf5"}, "a.nekg: expected the name of the XML file"),
        ({"path": "a.xml", "mesh_format": "binary"}, "expected one of the formats compressed, text, hdf5"),
        ({"field_path": "a.fld.gz", "field_format": "hdf5"}, "a.fld.gz: expected a name without .gz"),
        ({"path": "a\udcff.xml", "mesh_format": "hdf5"}, "a\udcff.xml: expected a name that is UTF-8"),
        ({"path": "nowhere/a.xml"}, "nowhere/a.xml: cannot be written: there is no folder"),
    ],
)
def test_unwritable_data_give_a_one_line_error(arguments, message, case_files, tmp_path, monkeypatch):
    dataset = mixed(case_files)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ElvisError) as caught:
        write(dataset, **arguments)
    assert str(caught.value).startswith(message)
    assert os.listdir(tmp_path) == []


def test_names_and_ids_beyond_a_format(case_files, tmp_path):
    dataset = mixed(case_files, "quad4")
    comma = replace(dataset, fields=(replace(dataset.fields[0], name="a,b"),))
    with pytest.raises(ElvisError, match="without commas"):
        write(comma, tmp_path / "m.xml")
    twice = replace(dataset, fields=dataset.fields * 2)
    with pytest.raises(ElvisError, match="distinct names"):
        write(twice, tmp_path / "m.xml")
    with pytest.raises(ElvisError, match="found none"):
        write(replace(dataset, fields=()), field_path=tmp_path / "f.fld")
    empty = replace(dataset, fields=(replace(dataset.fields[0], blocks=()),))
    with pytest.raises(ElvisError, match="expected fields on elements of the domain"):
        write(empty, tmp_path / "m.xml", field_format="hdf5")
    mesh = replace(dataset.mesh, vertex_ids=dataset.mesh.vertex_ids + 2**40)
    with pytest.raises(ElvisError, match=r"below 2\^31"):
        write(replace(dataset, mesh=mesh), tmp_path / "m.xml", mesh_format="hdf5")
    assert os.listdir(tmp_path) == []


def test_writing_does_not_change_the_dataset(case_files, assert_same, tmp_path):
    dataset, untouched = (mixed(case_files, "interptest") for _ in range(2))
    for mesh_format in MESH_FORMATS:
        write(dataset, tmp_path / "m.xml", mesh_format=mesh_format)
    assert_same(dataset, untouched)
    assert dataset.expansions == untouched.expansions


def test_output_is_the_same_every_time(case_files, tmp_path):
    dataset = mixed(case_files)
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write(dataset, tmp_path / name / "m.xml.gz", mesh_format="hdf5", field_format="hdf5")
    files = ["m.xml.gz", "m.nekg", "m.fld"]
    assert [(tmp_path / "a" / f).read_bytes() for f in files] == [(tmp_path / "b" / f).read_bytes() for f in files]
