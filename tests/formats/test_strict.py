"""Strict rules: what is written keeps them all, and each of them is missed when it is broken."""

import json
import re
import struct
from dataclasses import replace

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

from elvis import read, write
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.connectivity import connected
from elvis.core.portions import along_curve
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, ripple, shuffled
from elvis.core.testing.played_ranks import played
from elvis.formats import strict
from elvis.formats.reading import read_part
from elvis.formats.strict import findings
from elvis.formats.strict.mesh_rules import mesh_findings
from elvis.renderer.commands.info.info import info


def with_fields(mesh, modes=4):
    dataset = Dataset(mesh)
    functions = {"u": lambda x: x[:, 0] ** 2 + x[:, 1], "v": lambda x: x[:, 0] - x[:, 2]}
    return replace(dataset, fields=tuple(approximated(dataset, n, f, modes) for n, f in functions.items()))


MESHES = {
    "volume": lambda: curved(shuffled(mixed_volume(3), 1), ripple(0.05), 4),
    "plane": lambda: curved(mixed_plane(1), ripple(0.05), 3),
    **{shape.label: lambda shape=shape: curved(grid(shape, 2), ripple(0.02), 3) for shape in Shape},
}


@pytest.fixture(scope="module")
def volume():
    return with_fields(MESHES["volume"]())


@pytest.mark.sampled
@pytest.mark.parametrize("mesh", list(MESHES))
@pytest.mark.parametrize("form", ["compressed", "text", "hdf5"])
def test_written_files_pass_the_strict_checks(mesh, form, tmp_path, monkeypatch):
    dataset = with_fields(MESHES[mesh]())
    write(dataset, tmp_path / "a.xml", mesh_format=form, field_format="hdf5" if form == "hdf5" else "xml")
    assert findings(tmp_path / "a.xml", tmp_path / "a.fld") == ()
    assert findings(tmp_path / "a.xml") == () if form == "compressed" else True
    # no rank reads all of what is sound
    monkeypatch.delattr(strict, "read")
    assert findings_of_ranks(tmp_path / "a.xml", tmp_path / "a.fld") == ()


def of_two_orders(mesh, few):
    """A field with more modes on all elements but the first few."""
    low, high = with_fields(mesh, 3), with_fields(mesh, 4)
    parts = (low.fields[0].blocks[0], slice(0, few)), (high.fields[0].blocks[0], slice(few, None))
    blocks = (
        replace(own, element_ids=own.element_ids[rows], coefficients=own.coefficients[rows]) for own, rows in parts
    )
    return replace(high, fields=(replace(high.fields[0], blocks=tuple(blocks)),))


def test_mixed_orders_pass_the_strict_checks(tmp_path):
    dataset = of_two_orders(grid(Shape.TETRAHEDRON, 1), 2)
    for form in ("xml", "hdf5"):
        write(dataset, tmp_path / "a.xml", field_format=form)
        assert findings(tmp_path / "a.xml", tmp_path / "a.fld") == ()


@pytest.mark.parametrize("few", [0, 40])
def test_modes_that_one_part_needs_are_needed(few, tmp_path):
    """As all elements do, or the last ones alone."""
    write(of_two_orders(grid(Shape.TETRAHEDRON, 2), few), tmp_path / "a.xml", mesh_format="text", field_format="hdf5")
    path = tmp_path / "a.xml"
    path.write_text(re.sub(r'NUMMODES="\S+"', 'NUMMODES="3"', path.read_text()))
    assert_found("modes", "NUMMODES of 4 or more", path, tmp_path / "a.fld")


def test_values_on_elements_of_no_part_are_detected(tmp_path):
    write(with_fields(grid(Shape.TETRAHEDRON, 2)), tmp_path / "a.xml", field_format="hdf5")
    write(with_fields(grid(Shape.TETRAHEDRON, 1)), tmp_path / "b.xml", mesh_format="text", field_format="hdf5")
    assert_found("ids", "expected elements of the mesh, found 42 others", tmp_path / "b.xml", tmp_path / "a.fld")


def cut_digits(text):
    return re.sub(r"(?<=[ >-])\d+\.\d+(?:e-?\d+)?", lambda m: f"{float(m[0]):.9g}", text)


def twice(pattern, id):
    """The first entry that matches, once more under another id."""

    def edit(text):
        entry = re.search(pattern, text)[0]
        return text.replace(entry, entry + re.sub(r'ID="\d+"', f'ID="{id}"', entry, count=1), 1)

    return edit


def swap(pattern, text):
    """Exchange the first two numbers of the first entry that matches."""
    return re.sub(pattern, r"\1\3 \2", text, count=1)


MESH_DAMAGE = {
    "attribute": (lambda t: t.replace('DIM="3"', 'DIM="3" COLOUR="red"'), "expected only DIM, SPACE"),
    "digits": (cut_digits, "17 digits, found 9"),
    "edge twice": (twice(r'<E ID="0">.*?</E>', 9999), "edges: expected each once, found 9999"),
    "triangle twice": (twice(r'<T ID="\d+">.*?</T>', 9999), "triangles: expected each once"),
    "element twice": (twice(r'<A ID="\d+">.*?</A>', 9999), "tetrahedrons: expected each once"),
    "collapsed vertex": (lambda t: re.sub(r'(<T ID="\d+">)(\d+) (\d+) (\d+)', r"\1\3 \4 \2", t, count=1), "collapsed"),
    "open polygon": (lambda t: re.sub(r'(<Q ID="\d+">)(\d+) (\d+)', r"\1\3 \2", t, count=1), "closed polygon"),
    "straight edge of a curved face": (
        lambda t: re.sub(r'<E ID="\d+" EDGEID="0".*?</E>', "", t, count=1, flags=re.S),
        "edges curved with as many points",
    ),
    "family of nodes": (lambda t: t.replace("NodalTriEvenlySpaced", "NodalTriElec"), "found NodalTriElec"),
    "end of a curve": (lambda t: re.sub(r'(<V ID="0">)\S+', r"\g<1>0.01", t, count=1), "from vertex to vertex"),
    "blank in brackets": (lambda t: re.sub(r"(<C ID=\S+ NAME[^>]*> \w)\[", r"\1[ ", t, count=1), "without blanks"),
    "no domain": (lambda t: re.sub(r"<DOMAIN>.*?</DOMAIN>", "", t, flags=re.S), "expected a DOMAIN"),
    "text of the domain": (lambda t: t.replace("<DOMAIN> C[", "<DOMAIN> D["), "expected C[ids]"),
    "unknown composite": (lambda t: t.replace("<DOMAIN> C[0-3]", "<DOMAIN> C[0-3,77]"), "composites of the mesh"),
    "more composites than any mesh has": (
        lambda t: t.replace("<DOMAIN> C[0-3]", "<DOMAIN> C[0-1,3,0-999999999999]"),
        "composites of the mesh, found 5",
    ),
    "shapes mixed": (
        lambda t: re.sub(r'(<C ID="0"[^>]*>)([^<]*)(</C>)', r"\1\2 H[0] A[0]\3", t),
        "elements of one shape",
    ),
    "boundary in the domain": (lambda t: t.replace("<DOMAIN> C[0-3]", "<DOMAIN> C[0-4]"), "elements of one shape"),
    "no expansions": (lambda t: re.sub(r"<EXPANSIONS>.*</EXPANSIONS>", "", t, flags=re.S), "expected rules"),
    "expansion of a composite": (lambda t: re.sub(r'<E COMPOSITE="C\[1\]".*?/>', "", t), "a rule for composite 1"),
    "names of fields": (lambda t: t.replace('FIELDS="u,v"', 'FIELDS="u"'), "names the field v"),
    "modes": (lambda t: t.replace('NUMMODES="4"', 'NUMMODES="3"'), "NUMMODES of 4 or more"),
}


#: of these a reader makes something, or only warns of them; genuine files have some of them
ADVICE = {
    *("digits", "edge twice", "triangle twice", "element twice", "family of nodes", "end of a curve", "shapes mixed"),
    *("names of fields", "modes", "encoding", "two sections", "missing elements"),
    *("mesh version", "vertices", "faces", "ids", "curves", "field version", "element ids", "values", "bases"),
}


def findings_of_ranks(*paths, size=3):
    """What the first of several ranks finds; others find nothing."""
    found, *others = played(size, lambda ranks: findings(*paths, ranks=ranks))
    assert not any(others)
    return found


def assert_found(name, sentence, *paths):
    """A finding with that sentence, of the kind that it should be."""
    every = findings(*paths)
    assert findings_of_ranks(*paths) == every
    found = [each for each in every if sentence in str(each)]
    assert found
    assert {each.is_required for each in found} == {name not in ADVICE}


@pytest.mark.parametrize("name", list(MESH_DAMAGE))
def test_damaged_meshes_are_found(name, volume, tmp_path):
    edit, sentence = MESH_DAMAGE[name]
    write(volume, tmp_path / "a.xml", mesh_format="text")
    before = (tmp_path / "a.xml").read_text()
    after = edit(before)
    assert after != before
    (tmp_path / "a.xml").write_text(after)
    assert_found(name, sentence, tmp_path / "a.xml", tmp_path / "a.fld")


def wrapped(text):
    return re.sub(r"([A-Za-z0-9+/]{76})(?=[A-Za-z0-9+/])", r"\1\n", text)


FIELD_DAMAGE = {
    "lines": (wrapped, "on one line"),
    "encoding": (lambda t: re.sub(r' COMPRESSED="\S+"', "", t), "expected COMPRESSED"),
    "modes that descend": (lambda t: t.replace("UNIORDER:4,4,4", "UNIORDER:4,4,3"), "expected"),
    "two sections": (lambda t: re.sub(r"(<ELEMENTS.*?</ELEMENTS>)", r"\1\1", t, count=1, flags=re.S), "one section a"),
    "missing elements": (
        lambda t: re.sub(r"<ELEMENTS.*?</ELEMENTS>", "", t, count=1, flags=re.S),
        "elements of the domain, found none",
    ),
    "count": (lambda t: re.sub(r' ID="([\d-]+)', r' ID="900,\1', t, count=1), "expected"),
}


@pytest.mark.parametrize("name", list(FIELD_DAMAGE))
def test_damaged_fields_are_found(name, volume, tmp_path):
    edit, sentence = FIELD_DAMAGE[name]
    write(volume, tmp_path / "a.xml")
    before = (tmp_path / "a.fld").read_text()
    assert edit(before) != before
    (tmp_path / "a.fld").write_text(edit(before))
    assert_found(name, sentence, tmp_path / "a.xml", tmp_path / "a.fld")


def test_lines_and_forms_of_compressed_meshes(volume, tmp_path):
    write(volume, tmp_path / "a.xml")
    text = (tmp_path / "a.xml").read_text()
    (tmp_path / "a.xml").write_text(wrapped(text))
    assert "on one line" in str(findings(tmp_path / "a.xml", tmp_path / "a.fld")[0])
    write(volume, tmp_path / "b.xml", mesh_format="text")
    curves = re.search(r"<CURVED>.*</CURVED>", (tmp_path / "b.xml").read_text(), re.S)[0]
    mixed = re.sub(r"<CURVED .*</CURVED>", lambda _: curves, text, flags=re.S)
    (tmp_path / "a.xml").write_text(mixed)
    assert "expected compressed like VERTEX" in "\n".join(map(str, findings(tmp_path / "a.xml", tmp_path / "a.fld")))


def test_negative_jacobians_are_found(tmp_path):
    mesh = grid(Shape.HEXAHEDRON, 1)
    write(replace(Dataset(mesh), mesh=replace(mesh, vertices=mesh.vertices * [1, 1, -1])), tmp_path / "a.xml")
    assert [str(each) for each in findings(tmp_path / "a.xml")] == [
        "elements: expected positive Jacobians of the mesh, found others in 1: 0"
    ]


def retyped(name, dtype):
    """Store a dataset again with another type."""

    def edit(file):
        values = file[name][()]
        del file[name]
        file.create_dataset(name, data=values.astype(dtype))

    return edit


def attribute(group, name, value, dtype=None):
    return lambda file: file[group].attrs.create(name, value, dtype=dtype)


def removed(name):
    def edit(file):
        del file[name]

    return edit


FIXED = h5py.string_dtype("ascii", 16)
HDF5_DAMAGE = {
    "mesh version": ("a.nekg", attribute("NEKTAR/GEOMETRY", "FORMAT_VERSION", 1, np.int64), "as one uint32"),
    "vertices": ("a.nekg", retyped("NEKTAR/GEOMETRY/MESH/VERT", "f4"), "expected float64"),
    "faces": ("a.nekg", retyped("NEKTAR/GEOMETRY/MESH/TRI", "i8"), "expected int32, found int64"),
    "ids": ("a.nekg", retyped("NEKTAR/GEOMETRY/MAPS/HEX", "i8"), "expected int32, found int64"),
    "composites": ("a.nekg", retyped("NEKTAR/GEOMETRY/MESH/COMPOSITE", "S20"), "strings of variable length"),
    "curves": ("a.nekg", removed("NEKTAR/GEOMETRY/MESH/CURVE_FACE"), "a dataset CURVE_FACE"),
    "field version": ("a.fld", attribute("NEKTAR", "FORMAT_VERSION", [1], np.uint32), "as one uint32"),
    "metadata": ("a.fld", removed("NEKTAR/Metadata"), "expected a group Metadata"),
    "element ids": ("a.fld", retyped("NEKTAR/ELEMENTIDS", "i8"), "expected uint32, found int64"),
    "values": ("a.fld", retyped("NEKTAR/DATA", "f4"), "expected float64, found float32"),
    "shape": ("a.fld", attribute("NEKTAR/1", "SHAPE", "Tetrahedron", FIXED), "strings of variable length"),
    "bases": ("a.fld", attribute("NEKTAR/1", "BASIS", [4, 5, 6], np.int64), "expected int32, found int64"),
}


@pytest.mark.parametrize("name", list(HDF5_DAMAGE))
def test_damaged_hdf5_is_found(name, volume, tmp_path):
    path, edit, sentence = HDF5_DAMAGE[name]
    write(volume, tmp_path / "a.xml", mesh_format="hdf5", field_format="hdf5")
    with h5py.File(tmp_path / path, "r+") as file:
        edit(file)
    assert_found(name, sentence, tmp_path / "a.xml", tmp_path / "a.fld")


def test_hdf5_whose_objects_cannot_be_opened_is_found(volume, tmp_path):
    written = write(volume, tmp_path / "a.xml", mesh_format="hdf5", field_format="hdf5")
    field = next(path for path in written if path.suffix == ".fld")
    with h5py.File(field) as file:
        data = file["NEKTAR/DATA"].id
        layout = struct.pack("<QQ", data.get_offset(), data.get_storage_size())
    raw = field.read_bytes()
    assert raw.count(layout) == 1
    field.write_bytes(raw.replace(layout, bytes([7]) * 16))
    assert "the HDF5 data are damaged" in findings(*written)[0].sentence


def test_a_missing_file_is_found(volume, tmp_path):
    write(volume, tmp_path / "a.xml", mesh_format="hdf5")
    (tmp_path / "a.nekg").unlink()
    assert "expected the file a.nekg next to it" in str(findings(tmp_path / "a.xml")[0])


def test_real_files_are_checked_and_rewritten_ones_pass(case, case_files, tmp_path):
    paths = [path for path in case_files(case) if path]
    dataset = read(*paths)
    before = {str(each) for each in findings(*paths) if "elements" in each.place}
    write(replace(dataset, fields=()), tmp_path / "a.xml", mesh_format="text")
    after = [str(each) for each in findings(tmp_path / "a.xml")]
    kept = ("found NodalTriElec", "positive Jacobians", "each once", "elements of one shape")
    assert [each for each in after if each not in before and not any(word in each for word in kept)] == []


def test_genuine_files_satisfy_all_requirements(case, case_files):
    """They were written by the format's own programs, and are read by them."""
    paths = [path for path in case_files(case) if path]
    assert [str(each) for each in findings(*paths) if each.is_required] == []


def test_genuine_files_do_not_follow_all_recommendations(case_files):
    broken = [case for case in ("bfs_tq7", "chan3d_tet", "helmholtz_tq", "triquad_h5") if findings(*case_files(case))]
    assert len(broken) == 4


def test_the_command_fails_on_violated_requirements(volume, tmp_path):
    files = [str(file) for file in write(volume, tmp_path / "a.xml", mesh_format="text")]
    strict = lambda *more: CliRunner().invoke(info, ["--strict", *more, *files], standalone_mode=False)  # noqa: E731
    assert strict().exception is None
    assert strict().stdout == "all rules are satisfied\n"

    # good practice alone: told, and no failure
    text = (tmp_path / "a.xml").read_text()
    (tmp_path / "a.xml").write_text(text.replace('NUMMODES="4"', 'NUMMODES="2"'))
    sentence = "<EXPANSIONS>: expected NUMMODES of 4 or more for u on composite 0, found 2"
    outcome = strict()
    assert outcome.exception is None
    assert outcome.stdout.startswith("recommended, but not required by programs of the format:\n")
    assert f"\n  {sentence}\n" in outcome.stdout
    assert {each["required"] for each in json.loads(strict("--json").stdout)["findings"]} == {False}

    # what is required comes first
    (tmp_path / "a.xml").write_text(
        text.replace('DIM="3"', 'DIM="3" COLOUR="red"').replace('NUMMODES="4"', 'NUMMODES="2"')
    )
    outcome = strict()
    assert isinstance(outcome.exception, ElvisError)
    assert "all required rules, found 1 broken" in str(outcome.exception)
    required, advised = outcome.stdout.split("recommended, but not required by programs of the format:\n")
    assert required.startswith("required by programs of the format:\n  a.xml, line 3, <GEOMETRY>: expected only DIM")
    assert sentence in advised


def test_findings_take_one_line_for_every_file(tmp_path):
    files = [tmp_path / "a.xml", tmp_path / "a.fld"]
    write(approximated_plane(), files[0], mesh_format="compressed")
    text = files[1].read_text()
    assert 'COMPRESSED="B64Z-LittleEndian"' in text
    files[1].write_text(text.replace('COMPRESSED="B64Z-LittleEndian"', 'COMPRESSED="B64Z-LittleEndia&#10;n"', 1))
    lines = [str(found) for found in findings(*files) if "COMPRESSED" in str(found)]
    assert [line.split("found ")[1] for line in lines] == ["B64Z-LittleEndia n"]


def approximated_plane():
    """A plane mesh with a field."""
    whole = Dataset(mixed_plane(1))
    return replace(whole, fields=(approximated(whole, "u", lambda x: x[:, 0], 2),))


def torn_between_parts(count):
    """Squares in ``count`` parts, which have edges of their own between the same vertices where two of them meet."""
    dataset = with_fields(replace(grid(Shape.QUADRILATERAL, 4), space=3))
    mesh = dataset.mesh
    edges, squares = mesh.of(Shape.SEGMENT), mesh.of(Shape.QUADRILATERAL)
    members, ends, seen = squares.members.copy(), [edges.members], set()
    for ids in along_curve(dataset, count):
        rows = squares.rows_of(ids)
        own = set(np.unique(members[rows]).tolist())
        for edge in sorted(own & seen):
            members[rows] = np.where(members[rows] == edge, sum(map(len, ends)), members[rows])
            ends.append(edges.members[[edge]])
        seen |= own
    ends = np.concatenate(ends)
    entities = {
        Shape.SEGMENT: replace(edges, ids=np.arange(len(ends)), members=ends),
        Shape.QUADRILATERAL: replace(squares, members=members),
    }
    return replace(dataset, mesh=replace(mesh, entities=entities))


def pages(count):
    """Squares at one edge, which begin far from one another."""
    turns = np.linspace(0, 5, count)
    far = np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    up = np.array([[0.0, 0, 1]])
    vertices = np.concatenate([0 * up, up, far, far + up])
    first = 2 + np.arange(count)
    squares = np.stack([first, first + count, np.ones(count, int), np.zeros(count, int)], axis=1)
    return with_fields(connected(vertices, {Shape.QUADRILATERAL: squares}))


@pytest.mark.parametrize("size", [2, 3, 5])
@pytest.mark.parametrize(
    ("made", "sentence"),
    [(torn_between_parts, "edges: expected each once"), (pages, "edges: expected at most two elements on each")],
)
def test_errors_between_parts_are_found(made, sentence, size, tmp_path):
    """Each part is sound by itself."""
    write(made(max(size, 3) if made is pages else size), tmp_path / "a.xml", mesh_format="hdf5", field_format="hdf5")
    files = tmp_path / "a.xml", tmp_path / "a.fld"
    if made is torn_between_parts or size > 2:
        assert not any(any(mesh_findings(read_part(number, size, *files).dataset)) for number in range(size))
    found = findings(*files)
    assert any(sentence in str(each) for each in found)
    assert findings_of_ranks(*files, size=size) == found
