"""Zones of CGNS files that are written here, in both containers and the conventions of versions 2.5 to 4.5.

A cube is filled with elements of every type and sheared: volumes and areas are known.
"""

import cgns_writing as writing
import numpy as np
import pytest
from cgns_blocks import Block
from cgns_reader import patches_by_vtk
from cgns_writing import base, condition, conditions, elements, node, section, unstructured

from elvis import FormatError, write
from elvis.converters.cgns.cgns import Cgns
from elvis.converters.cgns.elements import _TYPES, AMBIGUOUS, nodes_of_type
from elvis.core.data.mesh import NON_CONFORMING
from elvis.core.integrals import integrate
from elvis.formats.strict import findings
from elvis.plugins.conversion.converting import convert
from elvis.plugins.testing import check, values_found

#: of coordinates up to 2, by all that is added up
ROUNDING = 1e-12

#: how boundary conditions name sides, of unstructured zones
WAYS = [
    ("PointList", "FaceCenter"),
    ("PointRange", "FaceCenter"),
    ("PointRange", "CellCenter"),
    ("ElementRange", None),
    ("ElementList", None),
    ("PointList", "Vertex"),
    ("PointList", None),
]
VERSIONS = [2.5, 3.0, 3.11, 3.2, 3.3, 3.4, 4.0, 4.2, 4.5]
CASES = [number for number, (_, shape, _, _) in _TYPES.items() if shape.dimension > 1]


def old(number, version):
    """The number of a type in files of a version."""
    if version < 3:
        return number - 1 if number > 20 else number
    if version < 3.1 and 12 < number < 22:
        return 13 if number == 21 else number + 1
    return number


def zone(block, way, version, is_mixed, integer):
    """The zone of a block with a boundary condition on each side."""
    how, location = way
    location = "EdgeCenter" if location == "FaceCenter" and block.dimension == 2 else location
    count, first, named, parts = len(block.table), len(block.table) + 1, [], [(block.number, block.table)]
    for name, sides in block.sides.items():
        numbers = np.arange(first, first + len(sides))
        axis, end = "ijk".index(name[0]), float(name.endswith("max"))
        if location == "Vertex" or (how.startswith("Point") and location is None):
            own = 1 + np.flatnonzero(np.abs(block.straight[:, axis] - end) < 1e-9)
        else:
            own = numbers[[0, -1]] if how.endswith("Range") else numbers
        named.append(condition(name, how, own[:, None], location, name))
        for kind in dict.fromkeys(kind for kind, _ in sides):
            parts.append((kind, [nodes for each, nodes in sides if each == kind]))
        first += len(sides)
    parts = [(old(kind, version), table) for kind, table in parts]
    if is_mixed:
        held = [writing.mixed("All", 1, parts, version >= 4, integer)]
        held[0][2][0] = old(20, version)
    else:
        starts = (1 + np.cumsum([0, *(len(table) for _, table in parts)])).tolist()
        whole = zip(range(len(parts)), parts, starts, strict=False)
        held = [section(f"S{i}", kind, start, table, integer) for i, (kind, table), start in whole]
    values = block.points @ np.arange(1.0, 1 + block.dimension)
    flow = writing.solution("Flow", None, {"u": values})
    return unstructured("Zone", block.points, count, *held, conditions(*named), flow, integer=integer)


@pytest.mark.parametrize(
    "number", [pytest.param(own, marks=pytest.mark.thorough if k % 2 else ()) for k, own in enumerate(CASES)]
)
def test_every_type_fills_a_cube(tmp_path, number):
    """Volume, area of each side, and a field, against closed forms."""
    block, turn = Block(number), CASES.index(number)
    is_new = _TYPES[number][2] > 2
    versions = [v for v in VERSIONS if v >= 3.3] if is_new else VERSIONS if number != 21 else VERSIONS[1:]
    version = versions[turn % len(versions)]
    ways = [way for way in WAYS if way[0].startswith("Point") or version < 3.1]
    way, is_mixed = ways[turn % len(ways)], turn % 3 == 1
    tree = [base(zone(block, way, version, is_mixed, [np.int32, np.int64][turn % 2]), dimension=block.dimension)]
    if turn % 4 == 3:
        path = writing.write_adf(tmp_path / "a.cgns", tree, version, turn % 8 == 3, ">" if turn % 8 == 3 else "<")
    else:
        path = writing.write_hdf5(tmp_path / "a.cgns", tree, version)
    done = check(Cgns, [path])
    assert done.report.geometry.is_exact
    assert findings(*write(done.dataset, tmp_path / "b.xml")) == ()
    assert {measure.state for measure in done.report.fields} == {"exact"}
    measured = measures(done.dataset)
    wanted = {name: block.area(name) for name in block.sides}
    assert measured == pytest.approx(wanted | {"domain": 1.0}, abs=ROUNDING)
    inside = np.array([[0.3, 0.45, 0.6], [0.7, 0.6, 0.2]])[:, : block.dimension]
    places = np.zeros((2, 3))
    places[:, : block.dimension] = inside
    found = values_found(done.dataset, "u", places)
    assert np.abs(found - inside @ np.arange(1.0, 1 + block.dimension)).max() < ROUNDING


def measures(dataset):
    """Volume, and area of each boundary, by name."""
    tags = {2: "ES", 3: "FTQ"}[dataset.mesh.dimension]
    found = [c.name for c in dataset.mesh.composites if c.parts[0][0] in tags]
    names = [name for name in found if not name.startswith("(")]  # sides inside that meet parts of others
    return {name: integrate(dataset, "1", over=name, error=1e-10)[0].value for name in ["domain", *names]}


@pytest.mark.parametrize("number", sorted(AMBIGUOUS))
def test_inner_nodes_lie_where_the_standard_places_them(tmp_path, number):
    """They are told from evenly spaced ones by the edges; the map is the same."""
    block = Block(number, by_notes=True)
    count = len(block.table)
    own = unstructured("Zone", block.points, count, section("Cells", number, 1, block.table))
    source = Cgns([writing.write_hdf5(tmp_path / "a.cgns", [base(own)], 4.0)])
    assert any("lie where notes in the standard define them" in note for note in source.notes)
    dataset = convert(source).dataset
    assert integrate(dataset, "1")[0].value == pytest.approx(1, abs=ROUNDING)
    wanted = 4 + 2 * block.area("jmin")
    assert integrate(dataset, "1", over="all", error=1e-13)[0].value == pytest.approx(wanted, abs=ROUNDING)


#: elements of zones that VTK's reader reads with their patches; 0 for a structured zone of two blocks
BODIES = {"structured": 0, "tetrahedra": 10, "pyramids": 12, "prisms": 14, "hexahedra": 17}
#: versions of CGNS, without those of 3.0, whose numbers of types VTK does not know
READABLE = [2.5, 3.11, 3.2, 3.3, 3.4, 4.0, 4.2, 4.5]


@pytest.mark.sampled
@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("version", READABLE)
def test_patches_of_every_version_agree_with_another_reader(tmp_path, version, body):
    """Forty files: areas of all patches, and the volume."""
    if BODIES[body]:
        block = Block(BODIES[body])
        names, own = block.sides, zone(block, ("PointRange", "FaceCenter"), version, False, np.int32)
    else:
        points = writing.grid(3, 4, 5) @ np.array([[1, 0.2, 0.1], [0, 1, 0.3], [0, 0, 1]]) * [1, 2, version]
        names = {"low": [(1, 1, 1), (1, 3, 5)], "high": [(1, 4, 1), (3, 4, 5)], "inner": [(1, 2, 3), (3, 4, 3)]}
        named = conditions(*(condition(name, "PointRange", span, None, name) for name, span in names.items()))
        own = writing.structured("Zone", points, named)
    families = [writing.node(name, "Family_t") for name in names]
    path = writing.write_hdf5(tmp_path / "a.cgns", [base(*families, own)], version)
    dataset = convert(Cgns([path])).dataset
    wanted, volume = patches_by_vtk(path)
    found = measures(dataset)
    assert found["domain"] == pytest.approx(volume, rel=1e-12)
    assert set(wanted) == set(names)
    assert {name: found[name] for name in wanted} == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("pieces", [(17, 17), (17, 10)])
def test_zones_without_interfaces_are_joined_by_place(tmp_path, pieces):
    """Hexahedra in one zone, and in the next hexahedra that match them, or tetrahedra that don't."""
    zones = []
    for i, number in enumerate(pieces):
        block = Block(number)
        parts = [section("cells", number, 1, block.table)]
        zones.append(unstructured(f"Zone{i}", np.array([i, 0, 0]) + block.straight, len(block.table), *parts))
    dataset = convert(Cgns([writing.write_hdf5(tmp_path / "a.cgns", [base(*zones)], 4.2)])).dataset
    assert integrate(dataset, "1")[0].value == pytest.approx(2, rel=1e-12)
    assert integrate(dataset, "1", over="all").value == pytest.approx(10, rel=1e-12)
    names = [composite.name for composite in dataset.mesh.composites]
    assert (NON_CONFORMING in names) == (pieces[0] != pieces[1])


#: sides of elements of order 1 as the standard numbers them (SIDS, "Unstructured Grid Element Numbering Conventions")
NUMBERED_SIDES = {
    10: ["132", "124", "234", "314"],
    12: ["1432", "125", "235", "345", "415"],
    14: ["1254", "2365", "3146", "132", "456"],
    17: ["1432", "1265", "2376", "3487", "1584", "5678"],
    5: ["12", "23", "31"],
    7: ["12", "23", "34", "41"],
}


@pytest.mark.parametrize("number", NUMBERED_SIDES)
def test_sides_may_be_named_by_cells_and_their_numbers(tmp_path, number):
    """Files of IOSS: sections of sides whose vertices are all 0, with parents, name the same sides as vertices do."""
    corners = nodes_of_type(number)
    rng = np.random.default_rng(number)
    points = np.asarray(corners, np.float64) + rng.uniform(-0.1, 0.1, corners.shape)
    table = np.arange(len(points))[None]
    found = []
    for is_by_parents in (False, True):
        sections, named = [section("cells", number, 1, table)], []
        for place, side in enumerate(NUMBERED_SIDES[number], start=1):
            own, first = np.array([[int(c) - 1 for c in side]]), 1 + place
            kind = {2: 3, 3: 5, 4: 7}[len(side)]
            if is_by_parents:
                parents = node("ParentElements", "DataArray_t", np.array([[1, 0]], np.int32))
                places = node("ParentElementsPosition", "DataArray_t", np.array([[place, 0]], np.int32))
                zeros = np.zeros(len(side), np.int32)
                sections.append(elements(f"s{place}", kind, np.array([first, first], np.int32), zeros, parents, places))
            else:
                sections.append(section(f"s{place}", kind, first, own))
            named.append(condition(f"side{place}", "PointList", [[first]], "FaceCenter"))
        path = tmp_path / f"{number}{is_by_parents}.cgns"
        tree = [base(unstructured("zone", points, 1, *sections, conditions(*named)), dimension=points.shape[1])]
        writing.write_hdf5(path, tree, 4.2)
        dataset = convert(Cgns([path])).dataset
        what = "area" if points.shape[1] == 3 else "length"
        rows = integrate(dataset, [what, "x", "y"], [f"side{k + 1}" for k in range(len(named))])
        found.append([row.value for row in rows])
    # the last rows are totals
    assert len(found[0]) == 3 * (len(NUMBERED_SIDES[number]) + 1)
    assert found[1] == pytest.approx(found[0], rel=0, abs=1e-12)


def test_parents_without_such_sides_are_refused(tmp_path):
    parents = node("ParentElements", "DataArray_t", np.array([[1, 0]], np.int32))
    places = node("ParentElementsPosition", "DataArray_t", np.array([[5, 0]], np.int32))
    side = elements("s", 5, np.array([2, 2], np.int32), np.zeros(3, np.int32), parents, places)
    zone_of = unstructured("zone", nodes_of_type(10), 1, section("cells", 10, 1, np.arange(4)[None]), side)
    path = tmp_path / "a.cgns"
    writing.write_hdf5(path, [base(zone_of)], 4.2)
    with pytest.raises(FormatError, match="/Base/zone/s: expected cells and numbers of their sides, found 1 others"):
        convert(Cgns([path]))
