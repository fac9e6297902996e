"""Elements of Gmsh files: each arrives, and counts once, whatever groups, partitions and orders there are."""

from types import SimpleNamespace

import numpy as np
import pytest

from elvis import FormatError, integrate, read
from elvis.converters.gmsh.gmsh import Gmsh
from elvis.converters.gmsh.joining import joined
from elvis.converters.gmsh.mesh import Group, Mesh
from elvis.core.shapes import Shape

gmsh = pytest.importorskip("gmsh")


@pytest.fixture
def session():
    """The library, silent and with nothing in it."""
    gmsh.initialize(["test"], readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    yield gmsh
    gmsh.finalize()


@pytest.mark.parametrize("has_topology", [0, 1])
@pytest.mark.parametrize("is_split", [0, 1])
@pytest.mark.parametrize(("version", "is_binary"), [(2.2, 0), (2.2, 1), (4.1, 0)])
def test_ghost_cells_count_once(session, tmp_path, version, is_binary, is_split, has_topology):
    """Three partitions, which hold copies of others' elements, in one file or three.

    With a topology the library adds elements between partitions to what a file of version 2 lists.
    """
    model = session.model
    model.occ.addRectangle(0, 0, 0, 2, 1)
    model.occ.synchronize()
    session.option.setNumber("Mesh.MeshSizeMax", 0.5)
    model.mesh.generate(2)
    model.mesh.setOrder(2)
    options = {"MshFileVersion": version, "Binary": is_binary, "PartitionCreateGhostCells": 1}
    options |= {"PartitionSplitMeshFiles": is_split, "PartitionCreateTopology": has_topology}
    for name, value in options.items():
        session.option.setNumber(f"Mesh.{name}", value)
    model.mesh.partition(3)
    session.write(str(tmp_path / "ghosts.msh"))
    for name in ("Binary", "PartitionSplitMeshFiles"):
        session.option.setNumber(f"Mesh.{name}", 0)
    files = sorted(tmp_path.glob("*.msh"))
    assert len(files) == (3 if is_split else 1)
    dataset = read(*files)
    assert integrate(dataset, "area")[0].value == pytest.approx(2, abs=1e-12)
    assert integrate(dataset, "1", "all")[-1].value == pytest.approx(6, abs=1e-12)


def test_values_on_elements_need_unique_numbers(tmp_path):
    """Two triangles of one number in two files of version 2, and a value on one of them."""
    head = (
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 1 1 0\n$EndNodes\n$Elements\n1\n"
    )
    files = [tmp_path / f"p_{number}.msh" for number in (1, 2)]
    for number, (file, nodes) in enumerate(zip(files, ("1 2 3", "2 4 3"), strict=True), 1):
        file.write_text(f"{head}1 2 4 0 1 1 {number} {nodes}\n$EndElements\n")
    assert integrate(read(*files), "area")[0].value == pytest.approx(1, abs=1e-14)
    data = '$ElementData\n1\n"c"\n1\n0\n3\n0\n1\n1\n1 5\n$EndElementData\n'
    files[0].write_text(files[0].read_text() + data)
    with pytest.raises(
        FormatError, match=r"p_2\.msh: expected parts of one mesh, found other elements of equal numbers"
    ):
        read(*files)


@pytest.mark.parametrize("version", [1, 2.2, 4.1])
@pytest.mark.parametrize("is_binary", [False, True])
def test_elements_of_several_groups_count_once(session, tmp_path, version, is_binary):
    """Old versions list an element once for each of its groups."""
    model = session.model
    first, second = model.occ.addRectangle(0, 0, 0, 1, 1), model.occ.addRectangle(1, 0, 0, 1, 1)
    model.occ.fragment([(2, first)], [(2, second)])
    model.occ.synchronize()
    model.addPhysicalGroup(2, [first, second], name="all")
    model.addPhysicalGroup(2, [first], name="left")
    model.mesh.generate(2)
    session.option.setNumber("Mesh.MshFileVersion", version)
    session.option.setNumber("Mesh.Binary", int(is_binary and version > 1))
    session.write(str(tmp_path / "groups.msh"))
    session.option.setNumber("Mesh.Binary", 0)
    assert integrate(read(tmp_path / "groups.msh"), "area")[0].value == pytest.approx(2, abs=1e-12)


#: how high the squares of orders 2 and 3 bulge at the top
_BULGE = 0.25


def squares():
    """Nodes (n, 3), and type and nodes of each element: the squares [i, i + 1] x [0, 1]."""
    places: list[tuple[float, float, float]] = []
    elements = []
    for i, (kind, order) in enumerate(((3, 1), (10, 2), (3, 1), (36, 3))):
        grid = np.linspace(0, 1, order + 1)
        corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
        edges = [(grid[1:-1], 0), (1, grid[1:-1]), (grid[1:-1][::-1], 1), (0, grid[1:-1][::-1])]
        own = corners + [p for x, y in edges for p in np.stack(np.broadcast_arrays(x, y), axis=1).tolist()]
        inside = {1: [], 2: [(1, 1)], 3: [(1, 1), (2, 1), (2, 2), (1, 2)]}
        own += [(grid[x], grid[y]) for x, y in inside[order]]
        nodes = []
        for x, y in own:
            lift = 4 * _BULGE * x * (1 - x) * y if order > 1 else 0
            places.append((i + x, y + lift, 0))
            nodes.append(len(places))
        elements.append((kind, nodes))
    return np.array(places, float), elements


def mixed_text(version, places, elements):
    """A file with one entity of these elements."""
    lines = ["$MeshFormat", f"{version} 0 8", "$EndMeshFormat"]
    if version == 4.1:
        count = len(places)
        lines += ["$Entities", "0 0 1 0", "1 0 0 0 9 9 0 0 0", "$EndEntities"]
        lines += ["$Nodes", f"1 {count} 1 {count}", f"2 1 0 {count}", *map(str, range(1, count + 1))]
        lines += [" ".join(map(repr, place)) for place in places.tolist()]
        lines += ["$EndNodes", "$Elements", f"{len(elements)} {len(elements)} 1 {len(elements)}"]
        for number, (kind, nodes) in enumerate(elements, 1):
            lines += [f"2 1 {kind} 1", " ".join(map(str, (number, *nodes)))]
        return "\n".join([*lines, "$EndElements", ""])
    start, end = ("$NOD", "$ENDNOD") if version == 1 else ("$Nodes", "$EndNodes")
    lines = [] if version == 1 else lines
    lines += [start, str(len(places))]
    lines += [f"{i} " + " ".join(map(repr, place)) for i, place in enumerate(places.tolist(), 1)]
    lines += [end, "$ELM" if version == 1 else "$Elements", str(len(elements))]
    for number, (kind, nodes) in enumerate(elements, 1):
        head = (number, kind, 1, 1, len(nodes)) if version == 1 else (number, kind, 2, 1, 1)
        lines.append(" ".join(map(str, (*head, *nodes))))
    return "\n".join([*lines, "$ENDELM" if version == 1 else "$EndElements", ""])


@pytest.mark.parametrize("version", [2.2, 4.1])
@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 1, 0, 2), (1, 2, 3, 0)])
def test_orders_may_differ_within_an_entity(tmp_path, version, order):
    places, elements = squares()
    path = tmp_path / "orders.msh"
    path.write_text(mixed_text(version, places, [elements[i] for i in order]))
    dataset = read(path)
    assert len(dataset.mesh.elements[Shape.QUADRILATERAL]) == 4
    # the area under the arc 4 b x (1 - x) is 2/3 b
    assert integrate(dataset, "area")[0].value == pytest.approx(4 + 2 * 2 / 3 * _BULGE, abs=1e-12)
    if version == 2.2:
        gmsh_binary = tmp_path / "binary.msh"
        gmsh_binary.write_bytes(binary_of_2(places, [elements[i] for i in order]))
        assert integrate(read(gmsh_binary), "area")[0].value == pytest.approx(4 + 4 / 3 * _BULGE, abs=1e-12)


def binary_of_2(places, elements):
    """The same in the binary form of version 2.2."""
    data = b"$MeshFormat\n2.2 1 8\n" + np.int32(1).tobytes() + b"\n$EndMeshFormat\n$Nodes\n%d\n" % len(places)
    for number, place in enumerate(places, 1):
        data += np.int32(number).tobytes() + place.tobytes()
    data += b"\n$EndNodes\n$Elements\n%d\n" % len(elements)
    for number, (kind, nodes) in enumerate(elements, 1):
        data += np.array([kind, 1, 2, number, 1, 1, *nodes], np.int32).tobytes()
    return data + b"\n$EndElements\n"


def test_a_single_partition_is_reported_as_one(session, tmp_path):
    session.model.occ.addBox(0, 0, 0, 1, 1, 1)
    session.model.occ.synchronize()
    session.model.mesh.generate(3)
    session.option.setNumber("Mesh.PartitionSplitMeshFiles", 1)
    session.model.mesh.partition(2)
    session.write(str(tmp_path / "split.msh"))
    remarks = read(tmp_path / "split_2.msh").remarks
    assert "split_2.msh: these are partitions 2 of 2, without the others" in remarks


@pytest.mark.parametrize("kind", [9, 10, 21])
def test_values_only_at_corners_are_linear(tmp_path, kind):
    """Fields of order 1 on curved elements of higher order."""
    corners = 4 if kind == 10 else 3
    nodes = {9: 6, 10: 9, 21: 10}[kind]
    gmsh.initialize(["test"], readConfigFiles=False, interruptible=False)
    try:
        local = np.array(gmsh.model.mesh.getElementProperties(kind)[4]).reshape(nodes, -1)
    finally:
        gmsh.finalize()
    places = np.zeros((nodes, 3))
    places[:, :2] = local[:, :2]
    places[corners:, :2] += 0.05
    text = mixed_text(2.2, places, [(kind, range(1, nodes + 1))])
    data = "".join(f"{i} {i}\n" for i in range(1, corners + 1))
    (tmp_path / "p1.msh").write_text(f'{text}$NodeData\n1\n"T"\n1\n0\n3\n0\n1\n{corners}\n{data}$EndNodeData\n')
    source = Gmsh([tmp_path / "p1.msh"])
    block, field = source.blocks[0], source.fields[0]
    assert field.order_on(0) == 1
    assert source.sample(block, field, local[:corners, :2])[0] == pytest.approx(range(1, corners + 1), abs=1e-12)
    middle = local[:corners, :2].mean(axis=0)[None]
    assert source.sample(block, field, middle)[0, 0] == pytest.approx((corners + 1) / 2, abs=1e-12)


def test_parts_have_the_partitions_of_the_whole():
    """Some files state fewer: those without elements of the last ones."""
    parts = []
    for number, count in ((2, 3), (1, 2)):
        tags, point = (
            np.array([number]),
            Group(SimpleNamespace(name="point"), [], np.array([number]), np.zeros((1, 1), int)),
        )
        parts.append(Mesh(tags, np.zeros((1, 3)), [point], partitions=[number], partition_count=count))
    whole = joined(parts, [], has_element_data=False)
    assert (whole.partitions, whole.partition_count) == ([1, 2], 3)
