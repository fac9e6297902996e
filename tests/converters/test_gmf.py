"""GMF files: the solver's values are reproduced, and polynomials on elements of every shape, order and version."""

import struct
from pathlib import Path

import numpy as np
import pytest

from elvis.converters.gmf.files import ELEMENTS, KEYWORDS, section_name, solution_name
from elvis.converters.gmf.gmf import Gmf
from elvis.converters.gmf.nodes import Bernstein, lattice, unit_points
from elvis.converters.shared.unit import UNIT
from elvis.core.base.errors import FormatError
from elvis.core.shapes import Shape
from elvis.plugins.conversion.converting import convert
from elvis.plugins.conversion.nodal import native_points
from elvis.plugins.testing import check, positions_at, values_at, values_found

SHAPES = {
    "Tetrahedra": Shape.TETRAHEDRON,
    "Pyramids": Shape.PYRAMID,
    "Prisms": Shape.PRISM,
    "Hexahedra": Shape.HEXAHEDRON,
    "Triangles": Shape.TRIANGLE,
    "Quadrilaterals": Shape.QUADRILATERAL,
}
SOLID = tuple(SHAPES)[:4]


def ours(shape, points):
    return native_points(shape, UNIT[shape].frame, points)


@pytest.mark.parametrize("end", ["b", ""], ids=["binary", "text"])
def test_agrees_with_the_solver(solvers, truth, near, end):
    stem = solvers / "gmf" / ("ball_tetP3_sol4" + ("" if end else "_ascii"))
    conversion = check(Gmf, [f"{stem}.mesh{end}", f"{stem}.sol{end}"])
    assert all(measure.is_exact for measure in (conversion.report.geometry, *conversion.report.fields))
    own = truth(f"{stem}.truth.npz")
    places = lambda block, ref: ours(Shape.TETRAHEDRON, ref)  # noqa: E731
    near(own.positions_at(conversion, {"tet": 0}, places), own.xyz, 1e-12)
    for name, key, i in (("scalar", "s", 0), ("vector_x", "v", 0), ("vector_y", "v", 1), ("vector_z", "v", 2)):
        wanted = own.column(key, i)
        near(own.at(conversion, name, {"tet": 0}, places), wanted)
        near(own.found(conversion.dataset, name), wanted)


def test_the_mesh_is_found_next_to_the_solution(solvers):
    assert len(Gmf([solvers / "gmf" / "ball_tetP3_sol4.solb"]).fields) == 4


# sections: name -> (reals (n, a), integers (n, b), what a solution says of itself)


def text(sections, dimension=3, version=2):
    lines = [f"MeshVersionFormatted {version}", f"Dimension {dimension}  # a comment"]
    for name, (reals, integers, header) in sections.items():
        lines.append(name)
        if not KEYWORDS[name].is_single:
            lines.append(str(max(len(reals), len(integers))))
        lines += [" ".join(map(str, row)) for row in header]
        for row in range(max(len(reals), len(integers))):
            numbers = [*reals[row : row + 1].reshape(-1).tolist(), *integers[row : row + 1].reshape(-1).tolist()]
            lines.append(" ".join(map(repr, numbers)))
    return ("\n".join([*lines, "End"]) + "\n").encode()


def binary(sections, dimension=3, version=2, order="<"):
    position, count = "q" if version > 2 else "i", "q" if version == 4 else "i"
    raw = struct.pack(order + "2i", 1, version)
    after = len(raw) + 4 + struct.calcsize(order + position) + 4
    raw += struct.pack(f"{order}i{position}i", 3, after, dimension)
    for name, (reals, integers, header) in sections.items():
        rows = max(len(reals), len(integers))
        body = b"" if KEYWORDS[name].is_single else struct.pack(order + count, rows)
        body += b"".join(struct.pack(f"{order}{len(row)}i", *row) for row in header)
        for row in range(rows):
            body += reals[row : row + 1].astype(f"{order}f{4 if version == 1 else 8}").tobytes()
            body += integers[row : row + 1].astype(f"{order}i{8 if version == 4 else 4}").tobytes()
        after = len(raw) + 4 + struct.calcsize(order + position) + len(body)
        raw += struct.pack(f"{order}i{position}", KEYWORDS[name].code, after) + body
    return raw + struct.pack(f"{order}i{position}", 54, 0)


def none(count=0):
    return np.empty((count, 0))


def bend(points, order):
    """A map of that degree, for points (n, 3)."""
    bent = np.array(points)
    if order > 1:
        bent[:, 0] += 0.1 * points[:, 1] ** order
        bent[:, -1] += 0.08 * points[:, 0] * points[:, 1]
    return bent


def wave(points, degree):
    x = points @ np.array([1.0, 0.5, -0.7])[: points.shape[1]]
    return 1 + min(degree, 1) * x + x**degree


def entries_of(kind, order, seed=0):
    """A lattice in an order of its own, the vertices first as the format wants them."""
    whole = lattice(SHAPES[kind], order)
    corners = ELEMENTS[kind][0]
    rest = np.random.default_rng(seed).permutation(np.arange(corners, len(whole)))
    return whole[[*range(corners), *rest]]


def mesh_sections(kinds, order, is_bezier=False, has_tables=True):
    """One curved element of each kind, each at a place of its own."""
    places, sections = [], {}
    for number, kind in enumerate(kinds):
        shape, entries = SHAPES[kind], entries_of(kind, order)
        points = unit_points(shape, entries) / order
        nodes = bend(points, order)
        if is_bezier:
            nodes = np.linalg.solve(Bernstein(shape, order, entries).at(ours(shape, points)), nodes)
        nodes[:, 0] += 2 * number
        rows = 1 + sum(map(len, places)) + np.arange(len(nodes))[None]
        places.append(nodes)
        sections[section_name(kind, order)] = (none(1), np.column_stack([rows, [7 + number]]), ())
        if has_tables and order > 1:
            sections[f"{kind}{ELEMENTS[kind][2]}{order}Ordering"] = (none(len(entries)), entries, ())
    nodes = np.concatenate(places)
    first = {"Vertices": (nodes, np.zeros((len(nodes), 1), int), ())}
    if is_bezier:
        first["BezierBasis"] = (none(1), np.ones((1, 1), int), ())
    return {**first, **sections}


def solution_sections(kinds, order, degree):
    sections = {"Time": (np.array([[0.75]]), none(1), ())}
    for kind in kinds:
        shape, entries = SHAPES[kind], entries_of(kind, max(degree, 1), seed=3)
        points = unit_points(shape, entries) / max(degree, 1)
        at = (points if degree else UNIT[shape].own.mean(axis=0, keepdims=True)) + 0.0
        f = wave(at, degree)
        values = np.column_stack([f, f + 1, 2 * f, *([3 * f] if at.shape[1] == 3 else [])]).reshape(1, -1)
        name = solution_name(kind, order)
        sections[name] = (values, none(1), ((2, 1, 2), (degree, len(at))))
        if degree:
            positions = entries / degree
            sections[f"{name}NodesPositions"] = (positions, none(len(positions)), ())
    return sections


def agree(conversion, kinds, order, degree, tolerance=1e-11, has_solution=True):
    rng = np.random.default_rng(8)
    for number, kind in enumerate(kinds):
        shape = SHAPES[kind]
        weights = rng.dirichlet(np.ones(len(UNIT[shape].own)), 20)
        points = weights @ UNIT[shape].own
        at = (number, np.zeros(20, int), ours(shape, points))
        places = bend(points, order) + np.eye(points.shape[1])[0] * 2 * number
        assert np.abs(positions_at(conversion, *at)[:, : points.shape[1]] - places).max() < tolerance
        f = wave(points, degree)
        for name, wanted in (("scalar", f), ("vector_x", f + 1), ("vector_y", 2 * f)) if has_solution else ():
            assert np.abs(values_at(conversion, name, *at) - wanted).max() < tolerance
            padded = np.zeros((20, 3))
            padded[:, : points.shape[1]] = places
            assert np.abs(values_found(conversion.dataset, name, padded) - wanted).max() < max(tolerance, 1e-10)


@pytest.mark.parametrize("degree", [0, 1, 3])
@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.sampled
def test_every_shape_and_order(tmp_path, order, degree):
    mesh, solution = tmp_path / "case.mesh", tmp_path / "case.sol"
    mesh.write_bytes(text(mesh_sections(SOLID, order)))
    solution.write_bytes(text(solution_sections(SOLID, order, degree)))
    conversion = check(Gmf, [mesh, solution])
    assert all(measure.is_exact for measure in (conversion.report.geometry, *conversion.report.fields))
    assert conversion.dataset.time == 0.75
    agree(conversion, SOLID, order, degree)
    names = {composite.name for composite in conversion.dataset.mesh.composites}
    assert {"ref7", "ref8", "ref9", "ref10"} <= names


@pytest.mark.parametrize("order", [1, 2, 4])
def test_flat_meshes(tmp_path, order):
    kinds = ("Triangles", "Quadrilaterals")
    mesh, solution = tmp_path / "case.mesh", tmp_path / "case.sol"
    mesh.write_bytes(text(mesh_sections(kinds, order), 2))
    solution.write_bytes(text(solution_sections(kinds, order, 2), 2))
    conversion = check(Gmf, [mesh, solution])
    assert [measure.name for measure in conversion.report.fields] == ["scalar", "vector_x", "vector_y"]
    agree(conversion, kinds, order, 2)


@pytest.mark.parametrize("byte_order", ["<", ">"])
@pytest.mark.parametrize("version", [1, 2, 3, 4])
@pytest.mark.sampled
def test_every_binary_version(tmp_path, version, byte_order):
    mesh, solution = tmp_path / "case.meshb", tmp_path / "case.solb"
    mesh.write_bytes(binary(mesh_sections(SOLID, 2), 3, version, byte_order))
    solution.write_bytes(binary(solution_sections(SOLID, 2, 3), 3, version, byte_order))
    conversion = check(Gmf, [mesh, solution])
    agree(conversion, SOLID, 2, 3, 2e-6 if version == 1 else 1e-11)


@pytest.mark.parametrize("order", [2, 3, 4])
def test_control_points(tmp_path, order):
    kinds = ("Tetrahedra", "Prisms", "Hexahedra")
    mesh = tmp_path / "case.mesh"
    mesh.write_bytes(text(mesh_sections(kinds, order, is_bezier=True)))
    conversion = check(Gmf, [mesh])
    assert conversion.report.geometry.is_exact
    agree(conversion, kinds, order, 1, has_solution=False)


@pytest.mark.parametrize("order", [2, 3])
def test_nodes_without_a_table_are_matched_by_position(tmp_path, order):
    mesh = tmp_path / "case.mesh"
    mesh.write_bytes(text(mesh_sections(SOLID, order, has_tables=False)))
    conversion = check(Gmf, [mesh])
    agree(conversion, SOLID, order, 1, has_solution=False)
    assert sum("no table orders the nodes" in note for note in conversion.report.notes) == len(SOLID)


def test_values_at_vertices_and_references_of_faces(tmp_path):
    sections = mesh_sections(("Tetrahedra", "Hexahedra"), 2)
    nodes = sections["Vertices"][0]
    sections["Triangles"] = (none(1), np.array([[1, 2, 3, 5]]), ())
    mesh, solution = tmp_path / "case.mesh", tmp_path / "case.sol"
    mesh.write_bytes(text(sections))
    solution.write_bytes(text({"SolAtVertices": (nodes[:, [0, 1, 0, 1, 2, 2, 0]], none(len(nodes)), ((2, 1, 3),))}))
    conversion = check(Gmf, [mesh, solution])
    names = [measure.name for measure in conversion.report.fields]
    assert names == ["scalar", *(f"tensor_{ab}" for ab in ("xx", "xy", "yy", "xz", "yz", "zz"))]
    assert all(measure.is_exact and measure.is_continuous for measure in conversion.report.fields)
    points = bend(np.array([[0.2, 0.3, 0.1]]), 2)
    assert np.isclose(values_found(conversion.dataset, "tensor_xx", points)[0], points[0, 1])
    assert "boundary5" in {composite.name for composite in conversion.dataset.mesh.composites}


def test_values_of_elements(tmp_path):
    mesh, solution = tmp_path / "case.mesh", tmp_path / "case.sol"
    mesh.write_bytes(text(mesh_sections(("Tetrahedra",), 1)))
    solution.write_bytes(text({"SolAtTetrahedra": (np.array([[4.5]]), none(1), ((1, 1),))}))
    conversion = convert(Gmf([mesh, solution]))
    assert np.isclose(values_found(conversion.dataset, "scalar", np.array([[0.2, 0.2, 0.2]]))[0], 4.5)


def pair(tmp_path, mesh=None, solution=None):
    """A mesh and a solution of tetrahedra, after their sections were changed."""
    sections, values = mesh_sections(("Tetrahedra",), 3), solution_sections(("Tetrahedra",), 3, 2)
    for change, own in ((mesh, sections), (solution, values)):
        if change:
            change(own)
    (tmp_path / "case.mesh").write_bytes(text(sections))
    (tmp_path / "case.sol").write_bytes(text(values))
    return [tmp_path / "case.mesh", tmp_path / "case.sol"]


def put(name, row, column, value, part=1):
    def change(sections):
        sections[name][part][row, column] = value

    return change


def drop(name):
    return lambda sections: sections.pop(name)


HO = "HOSolAtTetrahedraP3"
BAD = [
    (put("TetrahedraP3", 0, 2, 99), None, "expected vertices 1 to 20, found 1 to 99"),
    (put("TetrahedraP3Ordering", 5, 0, 3), None, "expected every node of a tetrahedron of order 3 once"),
    (drop("TetrahedraP3"), None, "expected elements, found none"),
    (None, drop(f"{HO}NodesPositions"), f"expected a table {HO}NodesPositions, found none"),
    (None, put(f"{HO}NodesPositions", 4, slice(None), [1, 0, 0, 0], 0), "expected nodes that determine"),
    (None, drop(HO), "expected a solution on the elements of the mesh, found none"),
    (None, lambda s: s.update({HO: (s[HO][0], none(1), ((1, 9), (2, 40)))}), "expected fields of the types 1 to 4"),
    (None, lambda s: s.update({HO: (np.tile(s[HO][0], (2, 1)), none(2), s[HO][2])}), "expected values on 1 elements"),
    (None, lambda s: s.update({HO: (s[HO][0], none(1), ((2, 1, 2), (2, -10)))}), "expected 1 rows of"),
    (
        None,
        lambda s: s.update({HO: (s[HO][0], none(1), ((2, 1, 2), (900, 10)))}),
        "expected a degree from 0 to 30, found 900",
    ),
]


@pytest.mark.parametrize(("mesh", "solution", "message"), BAD)
def test_bad_files_give_a_one_line_error(tmp_path, mesh, solution, message):
    with pytest.raises(FormatError, match=message) as caught:
        Gmf(pair(tmp_path, mesh, solution))
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("share", [0.02, 0.2, 0.5, 0.8, 0.99])
@pytest.mark.parametrize("end", ["meshb", "solb", "mesh", "sol"])
def test_truncated_files_are_rejected(solvers, tmp_path, end, share):
    whole = {"b": "ball_tetP3_sol4", "h": "ball_tetP3_sol4_ascii", "l": "ball_tetP3_sol4_ascii"}[end[-1]]
    raw = (solvers / "gmf" / f"{whole}.{end}").read_bytes()
    path = tmp_path / f"case.{end}"
    path.write_bytes(raw[: int(share * len(raw))])
    other = "mesh" if end.startswith("sol") else "sol"
    files = [path, solvers / "gmf" / f"{whole}.{other}{'b' if end[-1] == 'b' else ''}"]
    with pytest.raises(FormatError, match="expected"):
        Gmf(files)


def test_texts_without_a_last_keyword(tmp_path):
    """SfePy writes no End: complete lines are read, with a remark; a line that was cut may hold a part of a number."""
    whole = text(mesh_sections(("Tetrahedra",), 1)).removesuffix(b"End\n")
    (tmp_path / "whole.mesh").write_bytes(whole)
    source = Gmf([tmp_path / "whole.mesh"])
    assert source.warnings == ["no keyword End: sections after Tetrahedra may be missing"]
    (tmp_path / "cut.mesh").write_bytes(whole[:-1])
    with pytest.raises(FormatError, match="expected the keyword End, found the end of the file in a line"):
        Gmf([tmp_path / "cut.mesh"])


def test_files_that_end_within_a_number_are_rejected(tmp_path):
    (tmp_path / "a.meshb").write_bytes(struct.pack("<iii", 1, 2, 3) + b"\0\0")
    with pytest.raises(FormatError, match="header: expected more bytes, found the end"):
        Gmf([tmp_path / "a.meshb"])


def test_files_that_do_not_belong_together(solvers, tmp_path):
    solution = Path(solvers / "gmf" / "ball_tetP3_sol4.solb")
    alone = tmp_path / "alone.solb"
    alone.write_bytes(solution.read_bytes())
    with pytest.raises(FormatError, match=r"expected its mesh alone.meshb or alone.mesh next to it, found none"):
        Gmf([alone])
    mesh = tmp_path / "case.mesh"
    mesh.write_bytes(text(mesh_sections(("Tetrahedra",), 3)))
    with pytest.raises(FormatError, match="expected values on 1 elements, found on 679"):
        Gmf([mesh, solution])
    with pytest.raises(FormatError, match="expected one mesh and at most one solution, found 2 and 0"):
        Gmf([mesh, mesh])


def test_codes_of_keywords():
    known = {"HOSolAtTetrahedraP3": 115, "HOSolAtHexahedraQ4": 162, "TetrahedraP3Ordering": 134, "EdgesP4Ordering": 142}
    known |= {
        "HOSolAtTetrahedraP3NodesPositions": 177,
        "HexahedraQ4Ordering": 154,
        "PrismsP3": 102,
        "SolAtPyramids": 26,
    }
    assert {name: KEYWORDS[name].code for name in known} == known
    assert len({keyword.code for keyword in KEYWORDS.values()}) == len(KEYWORDS)
