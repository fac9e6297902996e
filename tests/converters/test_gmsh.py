"""Gmsh files: the library's own values are reproduced, for files of ours and for meshes that it makes in the test."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from archives import arrays_of
from source_blocks import where

from elvis.converters.gmsh.gmsh import Gmsh
from elvis.core.base.errors import ElvisError, FormatError
from elvis.plugins.conversion.converting import convert
from elvis.plugins.testing import check, positions_at, values_at, values_found

gmsh = pytest.importorskip("gmsh")

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "solvers" / "gmsh"
shared = pytest.mark.skipif(not DATA.exists(), reason="needs the shared data")

#: files of version 2.2 were renumbered when they were saved: tags of the truth less those of the file
RENUMBERED = {"tet": 126, "hex": -12, "prism": -12, "pyr": 86}


@pytest.fixture
def session():
    """The library, silent and with nothing in it."""
    gmsh.initialize(["test"], readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.AbortOnError", 0)
    yield gmsh
    gmsh.finalize()


def linear(x):
    return 1 + x[:, 0] - 2 * x[:, 1] + 0.5 * x[:, 2]


def wave(x):
    return np.sin(x[:, 0] + 0.5 * x[:, 1]) + np.cos(x[:, 2])


def mixed(order, incomplete=False):
    """A cube with a pyramid on it: hexahedra next to a pyramid and tetrahedra, or prisms; curved by a map."""
    model = gmsh.model
    model.add("mixed")
    base = model.occ.addRectangle(0, 0, 0, 1, 1)
    model.occ.synchronize()
    for _, curve in model.getEntities(1):
        model.mesh.setTransfiniteCurve(curve, 3)
    model.mesh.setTransfiniteSurface(base)
    model.mesh.setRecombine(2, base)
    body = [d[1] for d in model.occ.extrude([(2, base)], 0, 0, 0.5, [1], recombine=True) if d[0] == 3]
    triangle = model.occ.addPlaneSurface([model.occ.addCurveLoop(_triangle(model))])
    model.occ.synchronize()
    wedge = [d[1] for d in model.occ.extrude([(2, triangle)], 0, 0, 0.5, [1], recombine=True) if d[0] == 3]
    model.occ.synchronize()
    model.addPhysicalGroup(3, body, name="block")
    model.addPhysicalGroup(3, wedge, name="wedge")
    model.addPhysicalGroup(2, [base], name="floor")
    model.mesh.generate(3)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", int(incomplete))
    model.mesh.setOrder(order)
    bend(model)


def _triangle(model):
    points = [model.occ.addPoint(*x) for x in ((2, 0, 0), (3, 0, 0), (2, 1, 0))]
    return [model.occ.addLine(points[i], points[(i + 1) % 3]) for i in range(3)]


def bend(model):
    tags, places, _ = model.mesh.getNodes()
    x = places.reshape(-1, 3)
    for tag, place in zip(tags, x + 0.05 * np.sin(2 * x[:, [1, 2, 0]]), strict=True):
        model.mesh.setNode(tag, place, [])


def elements():
    """Of the elements of the highest dimension: type, tags, places (n, k, 3) of the nodes."""
    tags, places, _ = gmsh.model.mesh.getNodes()
    place = dict(zip(tags.tolist(), places.reshape(-1, 3), strict=True))
    for kind, own, nodes in zip(*gmsh.model.mesh.getElements(3), strict=True):
        table = nodes.reshape(len(own), -1)
        yield kind, own, np.array([[place[node] for node in row] for row in table.tolist()])


def add_view(name, function, offset=False):
    """Values at the nodes of every element; with an offset that differs by element they jump."""
    view = gmsh.view.add(name)
    tags, values = [], []
    for _, own, places in elements():
        tags += own.tolist()
        values += [(function(x) + (0.1 * i if offset else 0)).tolist() for i, x in enumerate(places)]
    gmsh.view.addModelData(view, 0, gmsh.model.getCurrent(), "ElementNodeData", tags, values, 0.25, 1)
    return view


def save(path, version=4.1, binary=0, views=()):
    gmsh.option.setNumber("Mesh.MshFileVersion", version)
    gmsh.option.setNumber("Mesh.Binary", binary)
    gmsh.write(str(path))
    for view in views:
        gmsh.view.write(view, str(path), append=True)
    return path


@shared
@pytest.mark.parametrize(
    ("file", "truth"),
    [
        ("mixed_o3", "mixed_o3"),
        ("mixed_o3", "mixed_o3_w"),
        ("mixed_o2_v22", "mixed_o2_v22"),
        ("mixed_o2_v22", "mixed_o2_v22_w"),
        ("ball_tet_o2_p5", "ball_tet_o2_p5"),
    ],
)
def test_agrees_with_the_library(file, truth):
    path, truth = DATA / f"{file}.msh", arrays_of(DATA / f"{truth}.truth.npz")
    done = check(Gmsh, [path])
    shift = np.array([RENUMBERED[str(shape)] if "v22" in file else 0 for shape in truth["shape"]])
    blocks, rows = where(Gmsh([path]), truth["elem"] - shift)
    key = next(key for key in truth if key.startswith("f_"))
    for i, values in enumerate(truth[key].T):
        name, bound = key[2:] + (f"_{'xyz'[i]}" if truth[key].shape[1] > 1 else ""), 1e-10 * np.ptp(values)
        for block in np.unique(blocks):
            here = blocks == block
            at = (block, rows[here], truth["ref"][here])
            assert np.abs(values_at(done, name, *at) - values[here]).max() < bound
            assert np.abs(positions_at(done, *at) - truth["xyz"][here]).max() < 1e-11
        assert np.abs(values_found(done.dataset, name, truth["xyz"]) - values).max() < bound


@shared
def test_groups_become_composites():
    done = convert(Gmsh([DATA / "mixed_o2_v22.msh"]))
    names = {}
    for each in done.dataset.mesh.composites:
        names[each.name] = names.get(each.name, 0) + sum(len(ids) for _, ids in each.parts)
    assert names == {"fluid": 142, "wall": 128}
    assert done.report.elements["pyramid"] == 4
    continuity = {field.name: field.is_continuous for field in done.report.fields}
    assert continuity == {"u_dg": False, "w_cg_x": True, "w_cg_y": True, "w_cg_z": True}


@pytest.mark.thorough
@pytest.mark.parametrize(("version", "binary"), [(2.2, 0), (2.2, 1), (4.1, 0), (4.1, 1)])
def test_every_version_contains_the_same(session, tmp_path, version, binary):
    mixed(3)
    views = [add_view("smooth", wave), add_view("rough", wave, offset=True)]
    path = save(tmp_path / "mixed.msh", version, binary, views)
    done = check(Gmsh, [path])
    assert {each.name for each in done.dataset.mesh.composites} == {"block", "wedge", "floor", "boundary"}
    assert set(done.report.elements) == {"hexahedron", "prism"}
    assert all(field.is_exact and field.order == 3 for field in done.report.fields)
    assert done.dataset.time == 0.25
    places = np.concatenate([nodes.mean(axis=1) for _, _, nodes in elements()])
    found = values_found(done.dataset, "smooth", places)
    assert np.nanmax(np.abs(found - wave(places))) < 2e-3
    again = convert(Gmsh([path]))
    assert gmsh.isInitialized()
    assert gmsh.model.getCurrent() == "mixed"
    assert [field.max for field in again.report.fields] == [field.max for field in done.report.fields]


@pytest.mark.parametrize("binary", [0, 1])
def test_nodes_with_parameters_are_nodes(session, tmp_path, binary):
    mixed(2)
    gmsh.option.setNumber("Mesh.SaveParametric", 1)
    path = save(tmp_path / "parameters.msh", 2.2, binary)
    gmsh.option.setNumber("Mesh.SaveParametric", 0)
    assert b"$ParametricNodes" in path.read_bytes()
    plain = save(tmp_path / "plain.msh", 2.2, binary)
    one, other = (convert(Gmsh([each])).dataset for each in (path, plain))
    assert one.mesh.counts == other.mesh.counts
    assert np.array_equal(one.mesh.corners, other.mesh.corners)


def test_version_1_contains_the_same_mesh(session, tmp_path):
    mixed(2)
    paths = [save(tmp_path / f"{version}.msh", version, 0) for version in (1.0, 2.2)]
    old, new = (check(Gmsh, [path]) for path in paths)
    assert old.report.geometry.is_exact
    assert old.report.elements == new.report.elements
    sizes = [[sum(len(ids) for _, ids in c.parts) for c in each.dataset.mesh.composites] for each in (old, new)]
    assert sizes[0] == sizes[1]
    assert np.abs(old.dataset.mesh.vertices - new.dataset.mesh.vertices).max() < 1e-15
    for share in (0.2, 0.6, 0.95):
        path, raw = tmp_path / "cut.msh", paths[0].read_bytes()
        path.write_bytes(raw[: int(share * len(raw))])
        with pytest.raises(FormatError, match=r"expected .*, found the end"):
            Gmsh([path])


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
def test_meshes_without_fields_of_every_order(session, tmp_path, order):
    mixed(order)
    done = check(Gmsh, [save(tmp_path / "mesh.msh")])
    assert done.report.geometry.is_exact
    assert done.report.geometry.order == order
    assert not done.report.fields


def test_serendipity_elements(session, tmp_path):
    mixed(2, incomplete=True)
    kinds = {gmsh.model.mesh.getElementProperties(kind)[0] for kind, _, _ in elements()}
    assert kinds == {"Hexahedron 20", "Prism 15"}
    path = save(tmp_path / "twenty.msh", views=[add_view("u", linear)])
    done = check(Gmsh, [path])
    assert done.report.geometry.is_exact
    places = np.concatenate([nodes[:, :4].mean(axis=1) for _, _, nodes in elements()])
    found = values_found(done.dataset, "u", places)
    assert np.nanmax(np.abs(found - linear(places))) < 1e-11


@pytest.mark.parametrize(("kind", "count"), [(7, 5), (14, 14), (19, 13), (118, 30), (119, 55)])
def test_pyramids(session, tmp_path, kind, count):
    """A linear function of the coordinates is reproduced on curved pyramids of every order."""
    gmsh.model.add("pyramid")
    gmsh.model.addDiscreteEntity(3, 1)
    nodes = np.asarray(gmsh.model.mesh.getElementProperties(kind)[4]).reshape(-1, 3)
    nodes = nodes + 0.03 * np.random.default_rng(3).uniform(-1, 1, nodes.shape)
    gmsh.model.mesh.addNodes(3, 1, range(1, count + 1), nodes.reshape(-1))
    gmsh.model.mesh.addElements(3, 1, [kind], [[1]], [range(1, count + 1)])
    done = check(Gmsh, [save(tmp_path / "pyramid.msh", views=[add_view("u", linear)])])
    assert done.report.geometry.is_exact
    assert all(field.is_exact for field in done.report.fields)
    inside = np.random.default_rng(4).uniform(-0.3, 0.3, (20, 3)) * [1, 1, 0.5] + [0, 0, 0.3]
    assert np.abs(values_found(done.dataset, "u", inside) - linear(inside)).max() < 1e-11


def test_values_of_elements_and_of_two_files(session, tmp_path):
    mixed(2)
    mesh = save(tmp_path / "mesh.msh")
    tags = np.concatenate([own for _, own, _ in elements()]).astype(int)
    view = gmsh.view.add("part")
    gmsh.view.addModelData(view, 0, "mixed", "ElementData", tags, [[float(tag)] for tag in tags], 0.5, 1)
    gmsh.view.addModelData(view, 1, "mixed", "ElementData", tags, [[-float(tag)] for tag in tags], 1.5, 1)
    data = tmp_path / "data.msh"
    gmsh.option.setNumber("PostProcessing.SaveMesh", 0)
    gmsh.view.write(view, str(data))
    places = np.concatenate([nodes.mean(axis=1) for _, _, nodes in elements()])
    for step, time, sign in ((None, 1.5, -1), ("0", 0.5, 1)):
        done = check(Gmsh, [mesh, data], **({} if step is None else {"step": step}))
        assert done.dataset.time == time
        found = values_found(done.dataset, "part", places)
        assert np.nanmax(np.abs(found - sign * tags)) < 1e-9
    assert Gmsh.times([mesh, data]) == [0.5, 1.5]
    with pytest.raises(FormatError, match="expected also a file with a mesh, found only data"):
        Gmsh([data])
    with pytest.raises(FormatError, match="expected a step from 0 to 1, found 5"):
        Gmsh([mesh, data], step="5")
    with pytest.raises(ElvisError, match="expected a number for the option step"):
        Gmsh([mesh], step="first")


TEXT = """$MeshFormat
2.2 0 8
$EndMeshFormat
$Nodes
4
1 0 0 0
2 1 0 0
3 0 1 0
4 0 0 1
$EndNodes
$Elements
1
7 4 2 0 1 1 2 3 4
$EndElements
$InterpolationScheme
"own"
1
5
2
4 4
1 -1 -1 -1
0 1 0 0
0 0 1 0
0 0 0 1
4 3
0 0 0
1 0 0
0 1 0
0 0 1
$EndInterpolationScheme
$ElementNodeData
2
"u"
"own"
1
0.5
3
0
1
1
7 4 1 2 3 4
$EndElementNodeData
"""


def test_a_scheme_defines_the_coefficients(tmp_path):
    path = tmp_path / "own.msh"
    path.write_text(TEXT.replace("4 4\n1 -1 -1 -1", "4 4\n1 0 0 0"))
    done = check(Gmsh, [path])
    x = np.array([[0.2, 0.3, 0.1]])
    assert np.isclose(values_found(done.dataset, "u", x)[0], 1 + 2 * 0.2 + 3 * 0.3 + 4 * 0.1)


def test_each_field_has_the_functions_of_its_own_scheme(tmp_path):
    """Whichever comes first."""
    scheme = TEXT[TEXT.index("$InterpolationScheme") : TEXT.index("$ElementNodeData")]
    data = TEXT[TEXT.index("$ElementNodeData") :]
    monomials = "4 4\n1 0 0 0"
    other = [part.replace('"own"', '"other"').replace('"u"', '"v"') for part in (scheme, data)]
    text = TEXT.replace("4 4\n1 -1 -1 -1", monomials).replace(data, "") + other[0]
    x = np.array([[0.2, 0.3, 0.1]])
    monomial, nodal = 1 + 2 * 0.2 + 3 * 0.3 + 4 * 0.1, 1 * 0.4 + 2 * 0.2 + 3 * 0.3 + 4 * 0.1
    for number, fields in enumerate(((data, other[1]), (other[1], data))):
        path = tmp_path / f"{number}.msh"
        path.write_text(text + "".join(fields))
        done = convert(Gmsh([path])).dataset
        assert [values_found(done, name, x)[0] for name in "uv"] == pytest.approx([monomial, nodal], abs=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("7 4 1 2 3 4", "7 4 1 2 3", "expected as many values as declared, found fewer"),
        ("7 4 1 2 3 4", "7 3 1 2 3", "expected 4 values in a tetrahedron 4, found 3"),
        ("7 4 1 2 3 4", "7 4 1 2 x 4", "expected numbers, found something else"),
        ("7 4 1 2 3 4", "8 4 1 2 3 4", "expected values on elements of the mesh, found 1 of 1 on others"),
        ('"own"\n1\n0.5', '"other"\n1\n0.5', "expected an interpolation scheme 'other', found none"),
        ("1\n5\n2\n4 4", "1\n5\n2\n4 9", "expected matrices of coefficients and exponents, found others"),
        ("\n1\n7 4 1 2", "\n2\n7 4 1 2", "expected values for 2 of them, found values for 1"),
        ("$EndElementNodeData\n", "", r"expected \$EndElementNodeData, found the end"),
        ("2.2 0 8", "two", "expected version, type and size after"),
        ("7 4 2 0 1 1 2 3 4", "7 4 2 0 1 1 2 3 9", "mesh|nodes"),
        ("\n7 4 2 0 1 1 2 3 4", "\n7 15 2 0 1 1", "expected elements, found none"),
        ("7 4 2 0 1 1 2 3 4", "7 444 2 0 1 1 2 3 4", "expected"),
    ],
)
def test_bad_files_give_a_one_line_error(tmp_path, old, new, message, capfd):
    assert old in TEXT
    path = tmp_path / "bad.msh"
    path.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(FormatError, match=message) as caught:
        Gmsh([path])
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("binary", [0, 1])
def test_truncated_files_are_rejected(session, tmp_path, binary, share):
    mixed(2)
    path = save(tmp_path / "cut.msh", binary=binary, views=[add_view("u", wave)])
    raw = path.read_bytes()
    path.write_bytes(raw[: int(share * len(raw))])
    with pytest.raises(FormatError, match="expected"):
        Gmsh([path])


@pytest.mark.parametrize("version", [2.2, 4.1])
@pytest.mark.parametrize("section", [b"$Nodes", b"$Elements"])
def test_binary_sections_of_wrong_length_are_rejected(session, tmp_path, version, section):
    """The library doesn't survive some of them."""
    mixed(2)
    path = save(tmp_path / "cut.msh", version, 1)
    raw = path.read_bytes()
    start = raw.index(section) + 400
    for length in (1, 8, 536):
        path.write_bytes(raw[:start] + raw[start + length :])
        with pytest.raises(FormatError, match="expected"):
            Gmsh([path])
    path.write_bytes(raw)
    assert sum(map(len, Gmsh([path]).blocks))


@pytest.mark.parametrize("recombine", [False, True])
def test_plane_meshes_with_named_edges(session, tmp_path, recombine):
    model = gmsh.model
    model.add("plane")
    disk = model.occ.addDisk(0, 0, 0, 1, 1)
    model.occ.synchronize()
    model.addPhysicalGroup(2, [disk], 7)
    model.addPhysicalGroup(1, [tag for _, tag in model.getEntities(1)], name="rim")
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.6)
    gmsh.option.setNumber("Mesh.RecombineAll", int(recombine))
    model.mesh.generate(2)
    model.mesh.setOrder(3)
    tags, places, _ = model.mesh.getNodes()
    view = gmsh.view.add("u")
    values = linear(places.reshape(-1, 3))[:, None]
    gmsh.view.addModelData(view, 0, "plane", "NodeData", tags, values.tolist(), 0.0, 1)
    done = check(Gmsh, [save(tmp_path / "plane.msh", views=[view])])
    assert done.dataset.mesh.space == 2
    assert all(field.is_exact and field.is_continuous for field in done.report.fields)
    assert {each.name for each in done.dataset.mesh.composites} == {"physical7", "rim"}
    x = np.random.default_rng(0).uniform(-0.6, 0.6, (30, 3)) * [1, 1, 0]
    assert np.abs(values_found(done.dataset, "u", x) - linear(x)).max() < 1e-11


@pytest.mark.parametrize("kind", ["NodeData", "ElementData", "ElementNodeData"])
def test_fields_on_a_part_exist_only_there(session, tmp_path, kind):
    """Values on the elements of one type, or on some of these: elsewhere there are none."""
    mixed(2)
    _, tags, places = next(iter(elements()))
    if kind == "NodeData":
        held = np.unique([session.model.mesh.getElement(tag)[1] for tag in tags])
        values = [[linear(session.model.mesh.getNode(node)[0][None])[0]] for node in held]
    else:
        tags = held = tags[: len(tags) // 2]
        values = [[7.0] if kind == "ElementData" else linear(x).tolist() for x in places[: len(tags)]]
    view = gmsh.view.add("part")
    gmsh.view.addModelData(view, 0, "mixed", kind, held.tolist(), values, 0.0, 1)
    numbers = np.concatenate([each for _, each, _ in elements()])
    done = check(Gmsh, [save(tmp_path / "part.msh", views=[view])])
    inside = np.array([x.mean(axis=0) for _, _, own in elements() for x in own])
    found, is_held = values_found(done.dataset, "part", inside), np.isin(numbers, tags)
    wanted = 7.0 if kind == "ElementData" else linear(inside[is_held])
    assert np.isnan(found[~is_held]).all()
    assert np.abs(found[is_held] - wanted).max() < 1e-11


def test_contradicting_values_are_reported(session, tmp_path):
    mixed(1)
    one, other = add_view("same", linear), add_view("same", wave)
    first = convert(Gmsh([save(tmp_path / "one.msh", views=[one])]))
    both = convert(Gmsh([save(tmp_path / "two.msh", views=[one, other])]))
    twice = convert(Gmsh([save(tmp_path / "twice.msh", views=[one, one])]))
    assert "several values" in " ".join(both.report.notes)
    assert "several values" not in " ".join((*first.report.notes, *twice.report.notes))
    assert both.dataset.field("same").blocks[0].coefficients == pytest.approx(
        first.dataset.field("same").blocks[0].coefficients, abs=0
    )


def test_other_files_are_rejected(tmp_path):
    path = tmp_path / "other.msh"
    for text in ("", "neither"):
        path.write_text(text)
        assert not Gmsh.opens([path])
        with pytest.raises(FormatError, match=r"expected \$MeshFormat at the beginning"):
            Gmsh([path])


COMMENTS = b"\n$Comments\nmade by hand\n$Nodes\nof no account\n$EndComments\n$Author\n$EndAuthor\n\n"


@pytest.mark.parametrize(
    ("version", "binary", "name"),
    [(1, 0, "mesh.mesh"), (2.2, 0, "mesh.mesh"), (2.2, 1, "mesh.msh"), (4.1, 0, "mesh"), (4.1, 1, "mesh")],
)
def test_comments_and_other_names(session, tmp_path, version, binary, name):
    """Sections of unknown names are comments (Gmsh reference manual); a file is known by what it holds."""
    mixed(1)
    raw = save(tmp_path / "plain.msh", version, binary).read_bytes()
    path = tmp_path / name
    path.write_bytes(COMMENTS + raw)
    assert Gmsh.opens([path])
    plain, source = Gmsh([tmp_path / "plain.msh"]), Gmsh([path])
    assert [len(block) for block in source.blocks] == [len(block) for block in plain.blocks]
    for own, wanted in zip(source.blocks, plain.blocks, strict=True):
        at = own.frame
        assert np.array_equal(source.positions(own, at), plain.positions(wanted, at))


def test_a_damaged_file_with_another_suffix_is_named(session, tmp_path):
    path = tmp_path / "bad.mesh"
    path.write_text(TEXT.replace("7 4 2 0 1 1 2 3 4", "7 444 2 0 1 1 2 3 4"))
    with pytest.raises(FormatError, match=r"bad\.mesh"):
        Gmsh([path])


def test_the_mesh_of_a_miniapp(findings, session, tmp_path):
    """MFEM's squircle has the suffix of another format; its places are those that the library itself reads."""
    path = findings / "sq_2D_9_quad.mesh"
    done = check(Gmsh, [path])
    shutil.copy(path, tmp_path / "named.msh")
    session.open(str(tmp_path / "named.msh"))
    kind, (own,) = session.model.mesh.getElementTypes(2)[0], session.model.mesh.getElements(2)[1]
    points = session.model.mesh.getIntegrationPoints(kind, "Gauss4")[0]
    places = session.model.mesh.getJacobians(kind, points)[2].reshape(len(own), -1, 3)
    blocks, rows = where(Gmsh([path]), own)
    for at in range(places.shape[1]):
        local = np.tile(points.reshape(-1, 3)[at, :2], (len(own), 1))
        assert np.abs(positions_at(done, blocks[0], rows, local) - places[:, at]).max() < 1e-13


def test_a_file_that_takes_more_memory_than_allowed_is_rejected(tmp_path):
    """A point of a small file declares 2^27 physical groups, for which the library takes 512 MiB."""
    import struct

    one, point = struct.pack("<i", 1), struct.pack("<4Qi3dQ", 1, 0, 0, 0, 1, 0.0, 0.0, 0.0, 1 << 27)
    head = b"$MeshFormat\n4.1 1 8\n" + one + b"\n$EndMeshFormat\n"
    none = b"$Nodes\n" + bytes(32) + b"\n$EndNodes\n$Elements\n" + bytes(32) + b"\n$EndElements\n"
    file = tmp_path / "many.msh"
    file.write_bytes(head + b"$Entities\n" + point + b"\n$EndEntities\n" + none)
    with pytest.raises(FormatError, match=r"many\.msh: .*more than the library has memory for"):
        Gmsh([file])
