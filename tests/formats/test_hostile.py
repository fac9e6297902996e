"""Files that lie, break off or explode: each gets its sentence, within seconds and bounded memory."""

import base64
import gzip
import re
import shutil
import zlib

import numpy as np
import pytest

from elvis import Shape
from elvis.formats.reading import read
from elvis.formats.strict import findings

MEBIBYTE = 1 << 20


def change(path, *changes):
    text = path.read_text()
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    path.write_text(text)


def packed(raw):
    return base64.b64encode(zlib.compress(raw, 9)).decode()


def bomb(megabytes):
    """Base64 of a zlib stream of zeros, small itself."""
    compressor = zlib.compressobj(9)
    zeros = b"\0" * MEBIBYTE
    return base64.b64encode(
        b"".join(compressor.compress(zeros) for _ in range(megabytes)) + compressor.flush()
    ).decode()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "expected XML or HDF5, found an empty file"),
        (b" \n\t ", "found an empty file"),
        (b"\x89PNG\r\n\x1a\n1234", r"found 12 bytes that begin b'\\x89PNG"),
        ("<?xml version='1.0'?><NEKTAR/>".encode("utf-16"), "expected XML or HDF5, found"),
        (b"\x1f\x8b", "gzip data end early"),
        (gzip.compress(b"<NEKTAR/>", mtime=0)[:-9], "gzip data end early"),
        (gzip.compress(b"<NEKTAR/>", mtime=0)[:-8] + bytes(8), "gzip data are damaged"),
        (gzip.compress(b"\x89HDF\r\n\x1a\n", mtime=0), "expected XML in the gzip data"),
        (b"\x89HDF\r\n\x1a\n", "HDF5 data are damaged"),
        (b"\x89HDF\r\n\x1a\n" + bytes(4000), "HDF5 data are damaged"),
        (b"<VTKFile></VTKFile>", "expected a root <NEKTAR>, found <VTKFile>"),
        (b"<NEKTAR>", "expected </NEKTAR> for the <NEKTAR> that begins here, found the end of the file"),
        (
            b"<NEKTAR><GEOMETRY DIM='2'",
            "expected </NEKTAR> for the <NEKTAR> that begins here, found the end of the file",
        ),
        (b"<NEKTAR><!-- </NEKTAR>", "the file ends inside <!--"),
        (b"<NEKTAR", "expected the end of a tag, found none"),
        (b"<NEKTAR a='></NEKTAR>", "expected the end of a tag, found none"),
        (b"<NEKTAR>1 < 2</NEKTAR>", "expected an element, found '< 2"),
        (b"<NEKTAR></GEOMETRY></NEKTAR>", "expected an element, found </GEOMETRY> without its beginning"),
        (b"<?xml version='1.0'", r"expected \?>, found the end"),
        (b"<NEKTAR></NEKTAR>", "no geometry among .*; also give the mesh file"),
        (b"<NEKTAR><GEOMETRY/></NEKTAR>", "expected a section VERTEX, found nothing"),
        (b"<NEKTAR><GEOMETRY DIM='4'/></NEKTAR>", "expected 1 <= DIM <= SPACE <= 3, found DIM 4 and SPACE 3"),
        (b"<NEKTAR><GEOMETRY DIM='3' SPACE='2'/></NEKTAR>", "found DIM 3 and SPACE 2"),
        (b"<NEKTAR><GEOMETRY DIM='two'/></NEKTAR>", "expected DIM to be a number, found 'two'"),
        (b"<NEKTAR><GEOMETRY HDF5FILE='none.nekg'/></NEKTAR>", "expected the file none.nekg next to it"),
    ],
)
def test_empty_and_foreign_files(content, message, tmp_path, refused):
    (tmp_path / "wing.xml").write_bytes(content)
    refused(tmp_path / "wing.xml", match=message)


def test_unreadable_paths(tmp_path, refused):
    refused(tmp_path / "none.xml", match=r"none\.xml: there is no such file")
    refused(tmp_path, match="expected P0000000.xml, or Info.xml and P0000000.fld, found neither")
    refused("/dev/null", match="/dev/null: expected a file, found a device")
    refused(tmp_path / ("x" * 300), match="x: ")
    refused("a\0b", match="there is no such file")


def test_disabled_tags_are_skipped(copied):
    """The solver's parser knows no tag that begins with an exclamation mark, and goes on behind it."""
    mesh = copied("quad4") / "interpfield_4quad.xml"
    original = mesh.read_text()
    before = read(mesh)
    unknown = '<!I PROPERTY="a" VALUE="b" />\n<!P> <!-- <!Q> -->'
    mesh.write_text(
        original.replace("<GEOMETRY", f"{unknown}<GEOMETRY", 1).replace("<VERTEX>", f"<VERTEX>{unknown}", 1)
    )
    assert np.array_equal(read(mesh).mesh.vertices, before.mesh.vertices)


def test_two_vertices_may_coincide(copied, refused):
    mesh = copied("quad4") / "interpfield_4quad.xml"
    original = mesh.read_text()
    before = read(mesh).mesh
    vertex = re.search(r"<V ID.*?</V>", original)[0]
    mesh.write_text(original.replace("</VERTEX>", f"{vertex}</VERTEX>", 1))
    assert np.array_equal(read(mesh).mesh.vertices, before.vertices)
    moved = re.sub(r">\s*\S+", ">77", vertex, count=1)
    mesh.write_text(original.replace("</VERTEX>", f"{moved}</VERTEX>", 1))
    refused(mesh, match="expected every vertex once")


def test_entities_and_document_types_are_never_expanded(copied, refused):
    mesh = copied("quad4") / "interpfield_4quad.xml"
    original = mesh.read_text()
    laughs = "".join(f"<!ENTITY a{i} '{f'&a{i - 1};' * 10 if i else 'ha'}'>" for i in range(10))
    for declaration in (f"<!DOCTYPE x [{laughs}]>", '<!DOCTYPE x SYSTEM "file:///etc/passwd">', "<!ENTITY a 'b'>"):
        mesh.write_text(original.replace("<NEKTAR>", declaration + "<NEKTAR>"))
        refused(mesh, match="line 2: declarations of document types and entities are not allowed")
    mesh.write_text(original.replace("<NEKTAR>", "<!-- <!DOCTYPE in a comment> --><NEKTAR>"))
    assert read(mesh)


def test_deep_and_wide_trees(copied, refused):
    mesh = copied("quad4") / "interpfield_4quad.xml"
    depth = 50_000
    change(mesh, ("<NEKTAR>", "<NEKTAR>" + "<a>" * depth + "</a>" * depth + "<b x='1'/>" * depth))
    assert len(read(mesh).mesh.domain_ids()) == 4
    change(mesh, ("</a>", ""))
    refused(mesh, match="expected </a> for the <a> that begins here, found </NEKTAR> in line")


@pytest.mark.parametrize("layers", [1, 2])
def test_gzip_bombs(layers, tmp_path, refused):
    content = b"<NEKTAR>" + b" " * (160 * MEBIBYTE)
    for _ in range(layers):
        content = gzip.compress(content, 6)
    (tmp_path / "bomb.xml").write_bytes(content)
    message = (
        r"expected at most \d+ bytes in the gzip data, found more" if layers == 1 else "expected XML in the gzip data"
    )
    refused(tmp_path / "bomb.xml", match=message, megabytes=120)


def test_payloads_that_expand_without_bound(copied, refused):
    folder = copied("chan3d_tet")
    explosive = bomb(400)
    mesh, field = folder / "chan3D.xml", folder / "chan3D.fld"
    payload = re.search(r"<ELEMENTS[^>]*>([^<]*)<", field.read_text())[1]
    change(field, (payload, explosive))
    refused(mesh, field, match=r"chan3D\.fld: line 14, <ELEMENTS>: expected 240 numbers, found more", megabytes=20)
    payload = re.search(r"<VERTEX[^>]*>([^<]*)<", mesh.read_text())[1]
    change(mesh, (payload, explosive))
    refused(mesh, match=r"line 4, <VERTEX>: expected at most \d+ bytes in \d+ packed ones, found more", megabytes=120)


FIELD_CHANGES = [
    ([('ID="1655-1658"', 'ID="1655-1657"')], "expected 75 numbers, found more"),
    ([('ID="1655-1658"', 'ID="1655-1659"')], "expected 125 numbers, found 100"),
    ([('ID="1655-1658"', 'ID="0-99999999999"')], "expected 2500000000000 numbers, found .* characters, which"),
    (
        [('ID="1655-1658"', 'ID="0-9223372036854775807"')],
        "expected coefficients within the limits of a file, found 2.31e",
    ),
    ([('ID="1655-1658"', 'ID="1655-1658,1655"')], "expected 125 numbers, found 100"),
    ([('ID="1655-1658"', 'ID="1655-"')], "expected ids separated by commas, found '1655-'"),
    ([('ID="1655-1658"', 'ID="A-Z"')], "expected a list of ids, found the character 'A'"),
    ([('ID="1655-1658"', "")], "expected an attribute ID, found none"),
    ([("UNIORDER:5,5", "UNIORDER:6,5")], "expected 120 numbers, found 100"),
    ([("UNIORDER:5,5", "UNIORDER:5")], "expected 2 numbers of modes, found 1"),
    ([("UNIORDER:5,5", "UNIORDER:0,5")], "expected 1 to 1024 modes in a direction, found 0"),
    ([("UNIORDER:5,5", "UNIORDER:-5,-5")], "expected 1 to 1024 modes in a direction, found -5"),
    ([("UNIORDER:5,5", "UNIORDER:1000000000,1000000000")], "expected 1 to 1024 modes in a direction, found 1000000000"),
    ([("UNIORDER:5,5", "UNIORDER:5.5,5")], "expected a number, found '5.5'"),
    ([("UNIORDER:5,5", "MIXORDER:1000000000")], "expected 2 numbers of modes, found 1"),
    ([("UNIORDER:5,5", "MIXORDER:5,5,5,5")], "expected orders of 4 elements, found 2"),
    ([("UNIORDER:5,5", "5,5")], "expected UNIORDER: or MIXORDER: in NUMMODESPERDIR, found '5,5'"),
    ([("Modified_A,Modified_A", "Modified_A")], "expected 1 numbers of modes, found 2"),
    ([("Modified_A,Modified_A", "Modified_A,Modified_Z")], "expected names of bases, found 'Modified_Z'"),
    ([("Modified_A,Modified_A", "Modified_A,Modified_B")], "expected 2 bases that fit a quadrilateral"),
    ([("Quadrilateral", "Pentagon")], "expected a shape, found 'Pentagon'"),
    ([("Quadrilateral", "Triangle"), ("Modified_A,Modified_A", "Modified_A,Modified_B")], "expected 60 numbers"),
    ([("Quadrilateral", "Quadrilateral-HomogenousExp1D")], "expected 3 bases for Quadrilateral-HomogenousExp1D"),
    ([('"rho"', '"rho,rho"')], "expected names of fields, each once, found rho,rho"),
    ([('"rho"', '""')], "expected names of fields, each once, found none"),
    ([("B64Z-LittleEndian", "B64Z-BigEndian")], "expected the encoding B64Z-LittleEndian, found 'B64Z-BigEndian'"),
    ([("</ELEMENTS>", "!</ELEMENTS>")], "expected base64, found the character '!'"),
]


@pytest.mark.parametrize(("changes", "message"), FIELD_CHANGES)
def test_fields_that_contradict_themselves(changes, message, copied, refused):
    folder = copied("quad4")
    change(folder / "interpfield_4quad.fld", *changes)
    files = folder / "interpfield_4quad.xml", folder / "interpfield_4quad.fld"
    refused(*files, match=rf"interpfield_4quad\.fld: line \d+, <ELEMENTS>: {message}")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ([('HOMOGENEOUSZIDS="0,1,2,3,4,5,6,7"', 'HOMOGENEOUSZIDS="0,1,2"')], "expected 768 numbers, found more"),
        ([('HOMOGENEOUSZIDS="0,1,2,3', 'HOMOGENEOUSZIDS="0,0,2,3')], "expected ids of Fourier modes, each once"),
        ([('HOMOGENEOUSZIDS="0,1,2,3', 'HOMOGENEOUSZIDS="0,9223372036854775807,2,3')], "from 0 to 65535, found 9223"),
        ([('LENGTHS="1"', 'LENGTHS="-1"')], r"expected 1 lengths above zero, found -1\.0"),
        ([('LENGTHS="1"', 'LENGTHS="1,2"')], "expected 1 lengths above zero, found 1.0, 2.0"),
        ([('HOMOGENEOUSLENGTHS="1"', "")], "expected 1 lengths above zero, found none"),
        ([("A,Fourier", "A,Chebyshev")], "expected Fourier bases in homogeneous directions, found Chebyshev"),
        ([("Exp1D", "Exp2D")], "expected 4 bases for Quadrilateral-HomogenousExp2D, found 3"),
    ],
)
def test_fourier_fields_that_contradict_themselves(changes, message, copied, refused):
    folder = copied("chan3dh1d")
    change(folder / "chan3DH1D.fld", *changes)
    refused(folder / "chan3DH1D.xml", folder / "chan3DH1D.fld", match=message)


def test_fourier_directions_beyond_three_coordinates(copied, refused):
    folder = copied("chan3dh1d")
    change(folder / "chan3DH1D.xml", ('SPACE="2"', 'SPACE="3"'))
    message = r"chan3DH1D\.fld: .*: expected a mesh of SPACE 2 at most for 1 Fourier directions, found 3"
    refused(folder / "chan3DH1D.xml", folder / "chan3DH1D.fld", match=message)


def test_lists_of_ids_are_expanded_after_their_data_are_checked(copied, refused):
    folder = copied("quad4")
    field, count = folder / "interpfield_4quad.fld", 4_000_000
    change(field, ('ID="1655-1658"', f'ID="1-{count}"'), ("UNIORDER:5,5", "UNIORDER:1,1"))
    payload = re.search(r"<ELEMENTS[^>]*>([^<]*)<", field.read_text())[1]
    change(field, (payload, bomb(8) + " " * (count // 100)))
    megabytes = 1.5 * 8 * count / MEBIBYTE  # the numbers that are requested, not the ids too
    refused(folder / "interpfield_4quad.xml", field, match=f"expected {count} numbers, found", megabytes=megabytes)


@pytest.mark.parametrize("name", ["plane_h/>\n    <E\n COMPOSITE=", "a\u2028b\r\nc", "long" * 2000])
def test_impossible_file_names(name, tmp_path, refused):
    head = f'<NEKTAR><GEOMETRY DIM="2" SPACE="2" HDF5FILE="{name.replace(">", "&gt;").replace("<", "&lt;")}"/></NEKTAR>'
    (tmp_path / "a.xml").write_text(head)
    refused(tmp_path / "a.xml", match="^[^\n]*: expected the file [^\n\u2028]{5,1000} found none$")
    assert all("\n" not in str(each) for each in findings(tmp_path / "a.xml"))


def test_missing_fourier_ids_of_old_files_are_generated(copied):
    folder = copied("chan3dh1d")
    change(folder / "chan3DH1D.fld", ('HOMOGENEOUSZIDS="0,1,2,3,4,5,6,7"', ""))
    (block,) = read(folder / "chan3DH1D.xml", folder / "chan3DH1D.fld").field("u").blocks
    assert block.expansion.homogeneous.z_ids == tuple(range(8))


def test_pyramids_before_version_5_are_rejected(copied, refused):
    folder = copied("gen_pyr_curved")
    change(folder / "gen_pyr_curved.fld", ("ModifiedPyr_C", "Modified_C"))
    message = "expected ModifiedPyr_C on pyramids, found Modified_C: written before version 5.0, in another layout"
    refused(folder / "Helmholtz3D_Pyr_Deformed.xml", folder / "gen_pyr_curved.fld", match=message)


MESH = """<NEKTAR> <GEOMETRY DIM="2" SPACE="2">
<VERTEX> <V ID="0">0 0 0</V> <V ID="1">1 0 0</V> <V ID="2">0 1 0</V> </VERTEX>
<EDGE> <E ID="0">0 1</E> <E ID="1">1 2</E> <E ID="2">2 0</E> </EDGE>
<ELEMENT> <T ID="0">0 1 2</T> </ELEMENT>
<CURVED>
<E ID="0" EDGEID="0" NUMPOINTS="3" TYPE="PolyEvenlySpaced">0 0 0 .5 0 0 1 0 0</E>
<F ID="1" FACEID="0" NUMPOINTS="6" TYPE="NodalTriElec">0 0 0 1 0 0 0 1 0 .5 0 0 .5 .5 0 0 .5 0</F>
</CURVED>
<COMPOSITE> <C ID="0"> T[0] </C> </COMPOSITE> <DOMAIN> C[0] </DOMAIN>
</GEOMETRY> </NEKTAR>"""

MESH_CHANGES = [
    (">0 1<", ">0 5<", "expected vertex ids that exist in the entries S, found vertex 5"),
    (">0 1<", ">0 -1<", "expected 2 numbers in <E ID=0>, found 1"),
    (">0 1<", ">0<", "expected 2 numbers in <E ID=0>, found 1"),
    (">0 1<", ">0 1 2<", "expected 2 numbers in <E ID=0>, found 3"),
    (">0 1<", ">0 x<", "line 3, <EDGE>: expected a number, found 'x'"),
    (">0 1<", ">0 1.5<", r"expected a number, found '1\.5'"),
    ('<E ID="1">1', '<E ID="0">1', "expected every edge once, found edge 0 twice"),
    ('<E ID="1">1', "<E>1", "expected entries with an ID, found '<E>1 2"),
    ('<E ID="1">1', '<B ID="1">1', "expected entries with an ID, found '<B ID="),
    ('<V ID="1">1 0 0<', '<V ID="1">1 0<', "line 2, <VERTEX>: expected 3 numbers in <V ID=1>, found 2"),
    ('<V ID="1">1 0 0<', '<V ID="1">1 nan 0<', "expected 3 numbers in"),
    ('<V ID="1">1 0 0<', '<V ID="1">1 inf 0<', "expected finite coordinates of vertices, found .* in row 1"),
    ('<V ID="1">1 0 0<', '<V ID="99999999999999999999">1 0 0<', r"expected ids below 2\^53"),
    ('<T ID="0">0 1 2<', '<T ID="0">0 1 7<', "expected edge ids that exist in the entries T, found edge 7"),
    ('<T ID="0">0 1 2</T>', "", "expected elements of dimension 2, found none"),
    ('EDGEID="0"', 'EDGEID="9"', "expected edge ids that exist in the curved edges, found edge 9"),
    ('FACEID="0"', 'FACEID="9"', "expected nodes of a triangle on triangles only, found 6 NodalTriElec on 9"),
    ('NUMPOINTS="3"', 'NUMPOINTS="4"', "expected 4 points on <E EDGEID=0>, found 9 numbers"),
    ('NUMPOINTS="3"', 'NUMPOINTS="6148914691236517208"', "expected 6148914691236517208 points on"),
    ('NUMPOINTS="3"', "", "expected an attribute NUMPOINTS in each of 1 entries <E …>, found 0"),
    ('NUMPOINTS="6"', 'NUMPOINTS="5"', "expected 5 points on <F FACEID=0>, found 18 numbers"),
    ("PolyEvenlySpaced", "Nonsense", "expected the name of a family of points, found b'Nonsense'"),
    ("PolyEvenlySpaced", "NoPointsType", "expected a known family of points"),
    ("NodalTriElec", "PolyEvenlySpaced", "expected a square number of points on a face, found 6 PolyEvenlySpaced on 0"),
    ("T[0] ", "T[0", r"expected tokens such as T\[0-9\], found 'T\[0'"),
    ("T[0] ", "Z[0] ", "expected one of the tags VESFTQAPRH, found Z"),
    ("T[0] ", "T[3-1] ", "expected ascending ranges, found '3-1'"),
    ("T[0] ", "T[" + "0-9999999999," * 9 + "0] " * 1, None),
    ("C[0] ", "C[1-99999999999999999] ", "expected a domain of composites that exist, found none of them"),
    ('<C ID="0">', '<C ID="-1">', "expected ID to be a number, found '-1'"),
    ('<C ID="0"> T[0] </C>', '<C ID="0"> T[0] </C> <C ID="0"> T[0] </C>', "expected every composite once"),
    (
        "<VERTEX>",
        '<VERTEX XSCALE="1/0">',
        r"expected an expression with a value, found '1/0' \(float division by zero\)",
    ),
    ("<VERTEX>", '<VERTEX YMOVE="__import__">', "expected a known name, found '__import__'"),
    ("<VERTEX>", '<VERTEX COMPRESSED="B64Z-LittleEndian">', "expected base64, found the character '<'"),
    ("<EDGE>", '<EDGE COMPRESSED="XZ">', "expected the encoding B64Z-LittleEndian, found 'XZ'"),
    ("</EDGE>", "</EDGE", "expected </GEOMETRY>|expected the end of a tag|expected </EDGE>"),
]


@pytest.mark.parametrize(("old", "new", "message"), MESH_CHANGES)
def test_meshes_that_contradict_themselves(old, new, message, tmp_path, refused):
    (tmp_path / "m.xml").write_text(MESH)
    assert read(tmp_path / "m.xml").mesh.of(Shape.TRIANGLE).ids.tolist() == [0]
    change(tmp_path / "m.xml", (old, new))
    if message is None:
        assert read(tmp_path / "m.xml").mesh.domain_ids().tolist() == [0]
    else:
        refused(tmp_path / "m.xml", match=message)


def test_records_that_contradict_themselves(copied, refused):
    mesh = copied("scale_compressed") / "scale_compressed_2D.xml"
    original = mesh.read_text()
    curve = re.search(r"<E>([^<]*)<", original)[1]
    index = re.search(r"<INDEX>([^<]*)<", original)[1]
    record = np.array([0, 0, 3, 0, 0, 17], np.int64)
    cases = {
        "expected curves of at most 5 points, found a longer one": [2**62, -1, 6],
        "expected at least 2 points on an edge, found 1 PolyEvenlySpaced on 0": [1],
    }
    for message, counts in cases.items():
        for count in counts:
            record[2] = count
            mesh.write_text(original.replace(curve, packed(record.tobytes())))
            refused(mesh, match=message)
    for places in ([0, 1, 99], [-1, 0, 1]):
        mesh.write_text(original.replace(index, packed(np.array(places, np.int64).tobytes())))
        refused(mesh, match="expected indices of 5 points, found a larger one")
    mesh.write_text(original.replace(curve, packed(record.tobytes()[:-3])))
    refused(mesh, match="expected records of 6 numbers, found 45 bytes in all")


def test_misleading_info_files(nektar, tmp_path, refused):
    mesh = nektar / "chan_parallel" / "chan_interpfield_nparts_xml"
    folder = shutil.copytree(nektar / "chan_parallel" / "chan_interpfield_nparts.fld", tmp_path / "x.fld")
    info = (folder / "Info.xml").read_text()
    for name, message in {
        "../x.fld/P0000000.fld": "expected the name of a file in the same folder",
        "/etc/passwd": "expected the name of a file in the same folder",
        "..": "expected the name of a file in the same folder",
        "Info.xml": "expected the name of a piece, found Info.xml, which names others",
        "P0000009.fld": "there is no such file",
    }.items():
        (folder / "Info.xml").write_text(info.replace("P0000000.fld", name))
        refused(mesh, folder, match=message)
    (folder / "P0000000.fld").write_text(info)
    (folder / "Info.xml").write_text(info)
    refused(mesh, folder, match="which names others")


def test_nan_and_infinity_in_fields_are_preserved(copied):
    folder = copied("quad4")
    field = folder / "interpfield_4quad.fld"
    values = np.resize([np.nan, np.inf, -np.inf, 1.0], 100)
    payload = re.search(r"<ELEMENTS[^>]*>([^<]*)<", field.read_text())[1]
    change(field, (payload, packed(values.tobytes())))
    (block,) = read(field, folder / "interpfield_4quad.xml").field("rho").blocks
    assert block.coefficients.tobytes() == values.tobytes()
