"""Solutions, steps, families and what is rejected of CGNS files that are written here."""

from contextlib import suppress

import cgns_writing as writing
import h5py
import numpy as np
import pytest
from cgns_blocks import SIDES, Block
from cgns_writing import base, condition, conditions, grid, node, section, solution, structured, unstructured

from elvis import FormatError
from elvis.converters.cgns.cgns import Cgns
from elvis.converters.cgns.elements import _TYPES, element_type
from elvis.converters.cgns.solutions import pascal_powers, reference_corners
from elvis.core.integrals import integrate
from elvis.core.polynomials.quadrature import gauss, lobatto
from elvis.core.shapes import Shape
from elvis.plugins.conversion.converting import Settings, convert
from elvis.plugins.conversion.nodal import tensor_nodes
from elvis.plugins.testing import check, values_found

HEXA_8, TETRA_4, PENTA_6, PYRA_5 = 17, 10, 14, 12
INSIDE = np.array([[0.31, 0.42, 0.53], [0.72, 0.61, 0.18], [0.2, 0.15, 0.05]])


def written(tmp_path, *children, version=4.5, is_adf=False, **options):
    write = writing.write_adf if is_adf else writing.write_hdf5
    return write(tmp_path / "a.cgns", [base(*children, **options)], version)


def filled(number, *more):
    """A zone filled with linear elements, straight."""
    block = Block(number)
    return block, unstructured(
        "Zone", block.straight, len(block.table), section("Cells", number, 1, block.table), *more
    )


def polynomial(x, degree):
    return (0.3 + x[..., 0] - 0.5 * x[..., 1] + 0.25 * x[..., 2]) ** degree


def interpolation(number, degree, kind, points=None, temporal=0):
    own = [node("InterpolationType", "InterpolationType_t", kind)]
    own += [] if points is None else [node("LagrangeControlPoints", "DataArray_t", points.T)]
    return node(
        f"Way{number}_{degree}", "SolutionInterpolation_t", np.array([number, degree, temporal], np.int32), *own
    )


def degrees(space, name="InterpolationDegrees", temporal=0):
    return node(name, "IndexArray_t", np.array([space, temporal], np.int32))


def control_points(shape, degree):
    """Points of CPEX 0045's reference elements: products of Gauss-Lobatto ones, else an even lattice, shuffled."""
    rng = np.random.default_rng(4)
    if shape is Shape.HEXAHEDRON:
        own = tensor_nodes(shape, tuple(lobatto(degree + 1)[0].tolist()))
    elif shape is Shape.PRISM:
        line = gauss(degree + 1)[0]
        flat = lattice(2, degree)
        own = np.array([(u, v, w) for w in line for u, v in flat])
    elif shape is Shape.PYRAMID:
        own = np.array(
            [
                (*(((2 * np.array(ij) - k) / degree) if k else (0, 0)), 1 - 2 * k / degree)
                for k in range(degree + 1)
                for ij in np.ndindex(k + 1, k + 1)
            ]
        )
    else:
        own = lattice(3, degree)
    return rng.permutation(own)


def lattice(dimension, degree):
    steps = np.array([i for i in np.ndindex(*[degree + 1] * dimension) if sum(i) <= degree])
    return 2 * steps / degree - 1


def mapped(block, points, shape):
    """(n, k, 3) where points of CPEX 0045's reference element lie in each element."""
    frame = reference_corners(shape)
    affine = np.linalg.lstsq(np.column_stack([frame, np.ones(len(frame))]), np.eye(len(frame)), rcond=None)[0]
    corners = block.straight[block.table]
    if shape in (Shape.TETRAHEDRON,):
        return np.einsum("kc,ncd->nkd", np.column_stack([points, np.ones(len(points))]) @ affine, corners)
    # the cube's elements are affine images of their reference elements: three corners and the first tell the map
    first, others = corners[:, 0], corners[:, {8: [1, 3, 4], 6: [1, 2, 3], 5: [1, 3, 4]}[len(frame)]]
    own = frame[{8: [1, 3, 4], 6: [1, 2, 3], 5: [1, 3, 4]}[len(frame)]] - frame[0]
    steps = np.linalg.solve(own.T, (points - frame[0]).T).T
    return first[:, None] + np.einsum("ki,nid->nkd", steps, others - first[:, None])


@pytest.mark.parametrize("number", [HEXA_8, TETRA_4, PENTA_6, PYRA_5])
@pytest.mark.parametrize("location", ["InterpolationPoints", "ElementBased"])
def test_values_at_control_points(tmp_path, number, location):
    shape, degree = _TYPES[number][1], 5
    points = control_points(shape, degree)
    block = Block(number)
    values = polynomial(mapped(block, points, shape), degree)
    name = "InterpolationDegrees" if location == "InterpolationPoints" else "InterpolationOrders"
    flow = solution("High", location, {"u": values.reshape(-1)}, None, degrees(degree, name))
    family = node("Fluid", "Family_t", None, interpolation(number, degree, "ParametricLagrange", points))
    _, zone = filled(number, node("FamilyName", "FamilyName_t", "Fluid"), flow)
    done = check(Cgns, [written(tmp_path, family, zone)])
    assert {measure.state for measure in done.report.fields} == {"exact"}
    assert np.abs(values_found(done.dataset, "u", INSIDE) - polynomial(INSIDE, degree)).max() < 1e-12
    assert {c.name for c in done.dataset.mesh.composites} >= {"Fluid"}


@pytest.mark.parametrize("number", [HEXA_8, TETRA_4, PENTA_6, PYRA_5])
def test_coefficients_of_monomials(tmp_path, number):
    """Coefficients that no symmetry hides, evaluated in reference coordinates by the loops of the proposal."""
    shape, degree = _TYPES[number][1], 3
    block = Block(number)
    count = len(pascal_powers(3, degree))
    assert count == 20
    values = np.random.default_rng(2).uniform(-1, 1, (len(block.table), count))
    flow = solution("High", "InterpolationPoints", {"u": values.reshape(-1)}, None, degrees(degree))
    family = node("F", "Family_t", None, interpolation(number, degree, "ParametricMonomialsPascal"))
    source = Cgns([written(tmp_path, family, filled(number, flow)[1])])
    check(Cgns, [tmp_path / "a.cgns"])
    theirs = reference_corners(shape).mean(axis=0) + np.array([0.1, -0.05, 0.15])
    frame, ours = reference_corners(shape), element_type(number).nodes
    affine = np.linalg.lstsq(np.column_stack([frame, np.ones(len(frame))]), ours, rcond=None)[0]
    found = source.sample(source.blocks[0], source.fields[0], (np.array([*theirs, 1]) @ affine)[None])[:, 0]
    u, v, w = theirs
    table = [u ** (i - j - k) * v**k * w**j for i in range(degree + 1) for j in range(i + 1) for k in range(i - j + 1)]
    assert np.abs(found - values @ table).max() < 1e-13


def test_coefficients_in_space(tmp_path):
    """Monomials of places relative to the corners' mean; lengths of all axes, and of each."""
    block = Block(HEXA_8)
    corners = block.straight[block.table]
    middle, lengths = corners.mean(axis=1), np.array([[0.5, 2.0, 3.0], [0.25, 1.5, 2.0]])
    for scale in (lengths, np.repeat(lengths[:, :1], 3, axis=1)):
        values = np.zeros((2, 10))
        # 1 + 2 x + 3 y^2 - z x about the middle; order of monomials: 1, x, y, z, x^2, xy, y^2, xz, yz, z^2
        values[:, [0, 1, 6, 7]] = [1, 2, 3, -1]
        stored = values * [[h[0] ** a * h[1] ** b * h[2] ** c for a, b, c in pascal_powers(3, 2)] for h in scale]
        recorded = scale if scale is lengths else scale[:, 0]
        length = node("CharacteristicLength", "DataArray_t", np.ascontiguousarray(recorded.T))
        flow = solution("High", "InterpolationPoints", {"u": stored.reshape(-1)}, None, degrees(2), length)
        family = node("F", "Family_t", None, interpolation(HEXA_8, 2, "CartesianMonomialsPascal"))
        done = check(Cgns, [written(tmp_path, family, filled(HEXA_8, flow)[1])])
        assert [measure.name for measure in done.report.fields] == ["u"]
        x = INSIDE - middle[(INSIDE[:, 0] > 0.5).astype(int)]
        wanted = 1 + 2 * x[:, 0] + 3 * x[:, 1] ** 2 - x[:, 2] * x[:, 0]
        assert np.abs(values_found(done.dataset, "u", INSIDE) - wanted).max() < 1e-12


def test_degrees_of_each_cell(tmp_path):
    """Solutions of one name on parts of the zone make one field; values of cells that are named lie there alone."""
    ways, flows = [], []
    block = Block(HEXA_8)
    for i, degree in enumerate((2, 4)):
        points = control_points(Shape.HEXAHEDRON, degree)
        ways.append(interpolation(HEXA_8, degree, "ParametricLagrange", points))
        values = polynomial(mapped(block, points, Shape.HEXAHEDRON)[i], 2)
        named = node("PointList", "IndexArray_t", np.array([[i + 1]], np.int32))
        flows.append(solution(f"High{i}", "InterpolationPoints", {"u": values}, None, degrees(degree), named))
    flows.append(solution("Part", "CellCenter", {"c": np.array([7.0])}, None, named))
    family = node("F", "Family_t", None, *ways)
    source = Cgns([written(tmp_path, family, filled(HEXA_8, *flows)[1])])
    done = convert(source, Settings(fields=("u",)))
    assert np.abs(values_found(done.dataset, "u", INSIDE) - polynomial(INSIDE, 2)).max() < 1e-12
    (_, part) = source.fields
    assert (part.name, part.order) == ("c", [None, 0])
    assert source.sample(source.blocks[1], part, np.zeros((1, 3))).tolist() == [[7]]


def test_nodes_at_nonstandard_positions(tmp_path):
    """A family that gives HEXA_27 its nodes row by row, at other places than the standard."""
    line = np.array([-1, 0.2, 1])
    points = tensor_nodes(Shape.HEXAHEDRON, tuple(line.tolist()))
    places = (points + 1) / 2
    places[:, 1] += 0.3 * places[:, 0] ** 2
    values = polynomial(places, 2)
    way = node(
        "Nodes",
        "ElementInterpolation_t",
        np.array([19], np.int32),
        node("LagrangeControlPoints", "DataArray_t", points.T),
    )
    zone = unstructured(
        "Zone", places, 1, section("Cells", 19, 1, np.arange(27)[None]), solution("F", None, {"u": values})
    )
    done = check(Cgns, [written(tmp_path, node("F", "Family_t", None, way), zone)])
    assert integrate(done.dataset, "1")[0].value == pytest.approx(1, abs=1e-12)
    inside = INSIDE + [0, 0.3, 0] * INSIDE[:, :1] ** 2
    assert np.abs(values_found(done.dataset, "u", inside)).max() > 0


def test_unsupported_solutions_are_named(tmp_path):
    block, zone = filled(
        HEXA_8,
        solution("Faces", "FaceCenter", {"f": np.zeros(3)}),
        solution("Time", "InterpolationPoints", {"t": np.zeros(4)}, None, degrees(0, temporal=1)),
        solution("None", "InterpolationPoints", {"n": np.zeros(2)}, None, degrees(0)),
    )
    source = Cgns([written(tmp_path, zone)])
    assert not source.fields
    assert len(source.warnings) == 3
    short = solution("F", "CellCenter", {"u": np.zeros(len(block.table) + 1)})
    with pytest.raises(FormatError, match=r"F/u: expected numbers of shape \(2\), found float64 of shape \(3,\)"):
        Cgns([written(tmp_path, filled(HEXA_8, short)[1])])


@pytest.mark.parametrize("is_adf", [False, True])
def test_steps(tmp_path, is_adf):
    """Solutions and moved grids by step; a zone that comes later."""
    points = grid(3, 3)
    moved = points * [1.0, 2.0]
    flows = [solution(f"S{i}", None, {"u": np.full((3, 3), float(i))}) for i in range(3)]
    names = node("FlowSolutionPointers", "DataArray_t", ["S1", "S2"])
    grids = node("GridCoordinatesPointers", "DataArray_t", ["GridCoordinates", "Moved"])
    iterative = node("ZoneIterativeData", "ZoneIterativeData_t", None, names, grids)
    zone = structured("Zone", points, writing.coordinates(moved, "Moved"), *flows, iterative)
    later = structured("Later", grid(2, 2, low=(1, 0), high=(2, 1)))
    steps = node(
        "BaseIterativeData", "BaseIterativeData_t", np.array([2], np.int32),
        node("TimeValues", "DataArray_t", np.array([0.5, 1.5])),
    )  # fmt: skip
    path = written(tmp_path, steps, zone, dimension=2, is_adf=is_adf)
    assert Cgns.times([path]) == [0.5, 1.5]
    first, last = convert(Cgns([path], step="0")), convert(Cgns([path]))
    assert (first.dataset.time, last.dataset.time) == (0.5, 1.5)
    assert [integrate(each.dataset, "u")[0].value for each in (first, last)] == pytest.approx([1, 4], abs=1e-12)
    with pytest.raises(FormatError, match="expected a step from 0 to 1, found 2"):
        Cgns([path], step="2")
    assert len(Cgns([written(tmp_path, steps, zone, later, dimension=2)]).blocks) == 2


def test_names(tmp_path):
    """Families, those above them, several of a condition; sections without a condition; regions; units."""
    block = Block(HEXA_8)
    count = len(block.table)
    tables = {name: [nodes for _, nodes in sides] for name, sides in block.sides.items()}
    sections, first = (
        [section("Fluid", HEXA_8, 1, block.table[:1]), section("Solid", HEXA_8, 2, block.table[1:])],
        count + 1,
    )
    numbers = {}
    for name in SIDES:
        sections.append(section(name, 7, first, tables[name]))
        numbers[name] = [[first], [first + len(tables[name]) - 1]]
        first += len(tables[name])
    more = node("Additional", "AdditionalFamilyName_t", "Heated")
    own = [
        condition("BC1", "PointRange", numbers["imin"], "FaceCenter", "Inlet"),
        condition("BC2", "PointRange", numbers["imax"], "FaceCenter", "Base/Outlet", more),
        condition("BC3", "PointRange", numbers["jmin"], "FaceCenter"),
    ]
    families = [node("Inlet", "Family_t", None, node("Group", "FamilyName_t", "Open")), node("Outlet", "Family_t")]
    units = node("DimensionalUnits", "DimensionalUnits_t", ["Kilogram", "Meter", "Second", "Kelvin", "Radian"])
    zone = unstructured("Zone", block.straight, count, *sections, conditions(*own))
    done = convert(Cgns([written(tmp_path, units, *families, zone)]))
    names = {c.name for c in done.dataset.mesh.composites}
    assert names == {"Fluid", "Solid", "Open", "Outlet", "Heated", "BC3", "jmax", "kmin", "kmax"}
    assert done.dataset.metadata["unit of length"] == "Meter"


def test_counts_are_checked(tmp_path):
    block = Block(HEXA_8)
    zone = unstructured("Zone", block.straight, 3, section("Cells", HEXA_8, 1, block.table))
    assert Cgns([written(tmp_path, zone)]).warnings == ["the zone Zone declares 3 cells and holds 2"]
    surface = unstructured("Zone", grid(2, 2, 1).reshape(-1, 3), 0, section("Skin", 7, 1, [[0, 2, 3, 1]]))
    source = Cgns([written(tmp_path, surface)])
    assert source.blocks[0].shape is Shape.QUADRILATERAL
    assert source.warnings == ["the zone Zone has no cells of dimension 3, but of 2"]


def test_elements_beyond_the_zone_are_skipped(tmp_path):
    """Rind elements and points of unstructured zones."""
    block = Block(HEXA_8)
    cells = section("Cells", HEXA_8, 1, block.table[[1, 0, 1]])
    cells[3].append(node("Rind", "Rind_t", np.array([1, 0], np.int32)))
    zone = unstructured("Zone", block.straight, 2, cells)
    done = convert(Cgns([written(tmp_path, zone)]))
    assert integrate(done.dataset, "1")[0].value == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize(
    ("number", "words"), [(22, "found NGON_n: polygons"), (23, "found NFACE_n"), (57, "found type 57")]
)
def test_polyhedra_have_no_functions(tmp_path, number, words):
    flat = np.array([4, 1, 2, 4, 3], np.int32)
    own = writing.elements("Cells", number, np.array([1, 1], np.int32), flat)
    with pytest.raises(FormatError, match=rf"Base/Zone/Cells: expected elements with functions.*{words}"):
        Cgns([written(tmp_path, unstructured("Zone", grid(2, 2, 2).reshape(-1, 3), 1, own))])
    mixed = writing.mixed("Cells", 1, [(number, [[0, 1, 2]])], True)
    with pytest.raises(FormatError, match=words):
        Cgns([written(tmp_path, unstructured("Zone", grid(2, 2, 2).reshape(-1, 3), 1, mixed))])


TWO, MANY = np.array([1, 2], np.int32), np.array([1, 2**30], np.int32)
FEW, ONE = np.arange(8, dtype=np.int32), np.array([17, *range(8)], np.int32)
BAD = [
    (section("Cells", HEXA_8, 1, [[0, 1, 2, 3, 4, 5, 6, 99]]), "expected vertices 1 to 8, found 1 to 100"),
    (section("Cells", HEXA_8, 0, [range(8)]), "expected numbers of elements from 1, found 0 to 0"),
    (writing.elements("Cells", HEXA_8, TWO, FEW), "expected 16 vertices"),
    (writing.elements("Cells", 20, TWO, ONE), "expected 2 elements"),
    (writing.elements("Cells", 20, MANY, ONE), "elements in 9"),
]


@pytest.mark.parametrize(("cells", "words"), BAD)
@pytest.mark.parametrize("is_adf", [False, True])
def test_bad_sections(tmp_path, cells, words, is_adf):
    zone = unstructured("Zone", grid(2, 2, 2).reshape(-1, 3), 1, cells)
    with pytest.raises(FormatError, match=words):
        Cgns([written(tmp_path, zone, is_adf=is_adf)])


def test_links(tmp_path):
    """Links inside a file lead on; those to other files, which may be anything, are not followed."""
    path = written(tmp_path, filled(HEXA_8)[1])
    with h5py.File(path, "r+") as file:
        zone = file["Base/Zone"]
        zone.move("GridCoordinates", "Elsewhere")
        link = zone.create_group("GridCoordinates")
        for key, value in (("name", "GridCoordinates"), ("label", ""), ("type", "LK")):
            link.attrs.create(key, np.array(value.encode(), "S33"))
        link[" path"] = np.frombuffer(b"/Base/Zone/Elsewhere\0", np.int8)
    assert integrate(convert(Cgns([path])).dataset, "1")[0].value == pytest.approx(1, abs=1e-12)
    with h5py.File(path, "r+") as file:
        file["Base/Zone/GridCoordinates"][" file"] = np.frombuffer(b"grid.cgns\0", np.int8)
    with pytest.raises(FormatError, match=r"GridCoordinates: expected data in the file .*'grid\.cgns'"):
        Cgns([path])
    with h5py.File(path, "r+") as file:
        del file["Base/Zone/GridCoordinates"][" file"]
        del file["Base/Zone/GridCoordinates"][" path"]
        file["Base/Zone/GridCoordinates"][" path"] = np.frombuffer(b"/Base/Zone/GridCoordinates\0", np.int8)
    with pytest.raises(FormatError, match="expected a node"):
        Cgns([path])


@pytest.mark.parametrize("is_text", [False, True])
def test_damaged_files_of_the_older_container(tmp_path, is_text):
    """Every number of a small file is changed in turn: it is read, or rejected with a one-line error."""
    tree = [base(filled(HEXA_8)[1])]
    whole = writing.write_adf(tmp_path / "a.cgns", tree, 2.5, is_text).read_bytes()
    rng = np.random.default_rng(1)
    for _ in range(300):
        raw = bytearray(whole)
        raw[rng.integers(len(raw))] = rng.integers(256)
        (tmp_path / "b.cgns").write_bytes(raw[: rng.integers(len(raw)) if rng.random() < 0.1 else len(raw)])
        with suppress(FormatError):
            Cgns([tmp_path / "b.cgns"])


def test_nodes_that_contain_themselves(tmp_path):
    """A table of children that names a node above: nodes below are only read where they are requested."""
    path = writing.write_adf(tmp_path / "a.cgns", [base(filled(HEXA_8)[1])], 3.4, False)
    raw = bytearray(path.read_bytes())
    entry = raw.rfind(b"ZoneType".ljust(32), 0, len(raw))
    raw[entry + 32 : entry + 44] = raw[134:146]
    path.write_bytes(raw)
    with pytest.raises(FormatError, match=r"a\.cgns"):
        Cgns([path])


@pytest.mark.parametrize("version", [np.nan, np.inf, -1.0])
def test_invalid_versions(tmp_path, version):
    path = written(tmp_path, filled(HEXA_8)[1], version=version)
    with pytest.raises(FormatError, match="CGNSLibraryVersion: expected a version from 1 to 100, found"):
        Cgns([path])
