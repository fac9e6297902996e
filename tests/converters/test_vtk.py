"""VTK files: solvers' own values are reproduced; every kind of cell; the traps of the format."""

import json
from pathlib import Path

import numpy as np
import pytest
from archives import arrays_of
from source_blocks import where
from vtk_writer import NODES, cube, grid, linear, one, write

from elvis import integrate, open_series, read, sample
from elvis.converters.vtk.cells import BEZIER, FIXED, LAGRANGE, Cell, Kind, _instance
from elvis.converters.vtk.functions import moved
from elvis.converters.vtk.vtk import Vtk
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.quadrature import gauss, lobatto
from elvis.core.shapes import Shape
from elvis.plugins.conversion.converting import convert
from elvis.plugins.testing import check, positions_at, values_at, values_found

pytest.importorskip("vtk")

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "solvers"
shared = pytest.mark.skipif(not DATA.exists(), reason="needs the shared data")


#: nodes of order 5 that lie at (2, 1)/5 and (1, 2, 1)/5 where they are evenly spaced
BASIX_TRIANGLE = [0.4142052527467741, 0.17158949450645158]
BASIX_TETRAHEDRON = [0.18579474725322576, 0.44261575824032257, 0.18579474725322576]


def inside(source, block, count=40):
    """World coordinates of some places in a block."""
    from elvis.plugins.testing.kit import _points

    piece = source.blocks[block]
    return source.positions(piece, _points(piece)).reshape(-1, 3)[:count]


@shared
@pytest.mark.parametrize(
    ("file", "truth", "bound"),
    [
        ("mfem_escher_p3", "mfem_escher_p3", 1e-10),
        ("mfem_fichera_mixed_p2", "mfem_fichera_mixed_p2", 1e-10),
        ("mfem_fichera_q3", "mfem_fichera_q3", 1e-10),
        ("dealii_shell_p4", "dealii_shell_p4", 2e-7),
        ("dolfinx_tet_o3_u_p0_000000", "dolfinx_tet_o3", 1e-10),
        ("dolfinx_tet_o3_w_p0_000000", "dolfinx_tet_o3", 1e-10),
    ],
)
def test_agrees_with_the_solver(file, truth, bound):
    path, truth = DATA / "vtk" / f"{file}.vtu", arrays_of(DATA / "vtk" / f"{truth}.truth.npz")
    done, (blocks, rows) = check(Vtk, [path]), where(Vtk([path]), truth["elem"])
    names = {f"{n}_{a}": ("f_" + n, i) for n in "v" for i, a in enumerate("xyz")} | {n: ("f_" + n, 0) for n in "uw"}
    compared = [each.name for each in done.report.fields if each.name in names]
    assert compared
    for block in np.unique(blocks):
        here = blocks == block
        at = (block, rows[here], truth["ref"][here])
        assert np.abs(positions_at(done, *at) - truth["xyz"][here]).max() < bound * 4
        for name in compared:
            key, column = names[name]
            wanted = truth[key][:, column]
            assert np.abs(values_at(done, name, *at) - wanted[here]).max() < bound * np.ptp(wanted)
    for name in compared:
        key, column = names[name]
        found = values_found(done.dataset, name, truth["xyz"])
        assert np.abs(found - truth[key][:, column]).max() < bound * np.ptp(truth[key][:, column])


@shared
def test_agrees_with_pyfr_where_its_export_keeps_the_elements():
    """Pyramids come as linear pieces; every other element holds the solution as it was."""
    truth = arrays_of(DATA / "pyfr" / "mixed3d_p3-01.truth.npz")
    done = check(Vtk, [DATA / "vtk" / "pyfr_mixed3d_p3.vtu"])
    key = next(key for key in truth if key.startswith("f_"))
    kept = truth["shape"] != "pyr"
    wanted = truth[key][:, 0][kept]
    found = values_found(done.dataset, "Density", truth["xyz"][kept])
    assert np.nanmax(np.abs(found - wanted)) < 1e-10 * np.ptp(wanted)
    assert np.isfinite(found).mean() > 0.9


@shared
def test_nodes_at_nonstandard_positions_are_detected():
    path = DATA / "vtk" / "dolfinx_tet_o3_u_p0_000000.vtu"
    truth = arrays_of(DATA / "vtk" / "dolfinx_tet_o3.truth.npz")
    errors = {}
    for nodes in ("auto", "gll", "equispaced"):
        done = convert(Vtk([path], nodes=nodes))
        errors[nodes] = np.abs(values_at(done, "u", 0, truth["elem"], truth["ref"]) - truth["f_u"][:, 0]).max()
        assert any("Gauss-Lobatto" in note for note in done.report.notes) == (nodes != "gll")
    assert errors["auto"] == errors["gll"] < 1e-12
    assert errors["equispaced"] > 1e-2


@shared
def test_fields_of_one_mesh_in_two_files():
    files = [DATA / "vtk" / f"dolfinx_tet_o3_{name}_p0_000000.vtu" for name in "wu"]
    truth = arrays_of(DATA / "vtk" / "dolfinx_tet_o3.truth.npz")
    done = check(Vtk, files)
    assert done.report.elements == {"tetrahedron": 679}
    assert {field.name: field.is_continuous for field in done.report.fields} == {"w": False, "u": True}
    for name in "uw":
        wanted = truth[f"f_{name}"][:, 0]
        found = values_at(done, name, 0, truth["elem"], truth["ref"])
        assert np.abs(found - wanted).max() < 1e-10 * np.ptp(wanted)


@shared
def test_hexahedra_of_the_wrong_version_are_renumbered(tmp_path):
    raw = (DATA / "vtk" / "dealii_shell_p4.vtu").read_bytes()
    path = tmp_path / "relabelled.vtu"
    path.write_bytes(raw.replace(b'version="0.1"', b'version="2.2"'))
    with pytest.raises(FormatError, match=r"6 with the nodes of two edges exchanged, .*option hexahedra"):
        Vtk([path], hexahedra="as-read")
    truth = arrays_of(DATA / "vtk" / "dealii_shell_p4.truth.npz")
    wanted = truth["f_u"][:, 0]
    for option in ("auto", "exchanged"):
        done = convert(Vtk([path], hexahedra=option))
        assert np.abs(values_found(done.dataset, "u", truth["xyz"]) - wanted).max() < 2e-7 * np.ptp(wanted)
    assert "relabelled.vtu: edges of hexahedra are numbered as before version 2.1" in read(path).remarks[1]


@pytest.mark.parametrize("kind", sorted(FIXED))
def test_cells_with_a_fixed_number_of_nodes(tmp_path, kind):
    shape, _, nodes = FIXED[kind]
    path = write(tmp_path / "one.vtu", one(kind, nodes))
    done = check(Vtk, [path])
    assert all(field.is_exact for field in done.report.fields)
    assert done.report.geometry.is_exact
    if shape.dimension == 3:
        x = inside(Vtk([path]), 0)
        assert np.abs(values_found(done.dataset, "u", x) - linear(x)).max() < 1e-11


@pytest.mark.sampled(least=18)
@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("kind", sorted({**LAGRANGE, **BEZIER}))
def test_cells_of_any_order(tmp_path, kind, order):
    shape = {**LAGRANGE, **BEZIER}[kind]
    path = write(tmp_path / "one.vtu", one(kind, NODES[shape](order)))
    done = check(Vtk, [path])
    assert all(field.is_exact for field in done.report.fields)
    if shape.dimension == 3:
        x = inside(Vtk([path]), 0)
        assert np.abs(values_found(done.dataset, "u", x) - linear(x)).max() < 1e-11


def of_the_library(kind, points):
    """(nodes, 3) the nodes of a kind of cells, (n, nodes) their functions at points (n, 3), as the library has them."""
    cell = _instance(kind)
    nodes, weights, found = np.reshape(cell.GetParametricCoords(), (-1, 3)), [0.0] * kind.nodes, []
    for point in points.tolist():
        cell.InterpolateFunctions(point, weights)
        found.append(list(weights))
    return nodes, np.array(found)


GRADED = [Kind(70, 15, (4, 2, 0)), Kind(77, 15, (4, 2, 0)), Kind(72, 60, (2, 3, 4)), Kind(79, 60, (2, 3, 4))]
GRADED += [Kind(73, 45, (4, 4, 2)), Kind(80, 45, (4, 4, 2))]
EVEN = [Kind(kind, NODES[shape](order)) for kind, shape in (LAGRANGE | BEZIER).items() for order in (1, 3, 5, 8)]


@pytest.mark.parametrize("kind", [*(Kind(kind, nodes) for kind, (*_, nodes) in FIXED.items()), *EVEN, *GRADED], ids=str)
def test_nodes_and_functions_match_those_of_the_library(kind):
    cell = Cell(kind, "")
    points = np.random.default_rng(5).dirichlet(np.ones(4), 2)[:, :3]
    points[:, cell.shape.dimension :] = 0
    own = points[:, : cell.shape.dimension]
    nodes, functions = of_the_library(kind, points)
    if cell.frame is None:  # these take points in reference coordinates
        own = uncollapse(cell.shape, 2 * points - 1)
    assert np.abs(cell.nodes - nodes).max() < 1e-13
    assert np.abs(cell.at(own) - functions).max() < 1e-12


@pytest.mark.parametrize("kind", sorted(BEZIER))
def test_bezier_cells_are_evaluated_without_pointwise_library_calls(kind):
    """Its recursion takes 20 ms a point on tetrahedra of order 8, and of those a conversion has thousands."""
    cell = Cell(Kind(kind, NODES[BEZIER[kind]](8)), "")
    assert cell._cell is None
    points = np.random.default_rng(5).dirichlet(np.ones(4), 3000)[:, : cell.shape.dimension]
    table = cell.at(points)
    assert np.abs(table.sum(axis=1) - 1).max() < 1e-13
    assert np.abs(table @ cell.nodes[:, : cell.shape.dimension] - points).max() < 1e-13


@pytest.mark.parametrize(("kind", "degrees"), [(70, (3, 2, 0)), (72, (1, 3, 2)), (73, (3, 3, 1)), (79, (2, 1, 3))])
def test_cells_whose_degree_depends_on_the_direction(tmp_path, kind, degrees):
    i, j, k = degrees
    nodes = (i + 1) * (i + 2) // 2 * (k + 1) if kind == 73 else (i + 1) * (j + 1) * (k + 1)
    done = check(Vtk, [write(tmp_path / "one.vtu", one(kind, nodes, degrees))])
    assert all(field.is_exact for field in done.report.fields)


@pytest.mark.sampled
@pytest.mark.parametrize("order", [3, 4, 5, 6])
@pytest.mark.parametrize("kind", [69, 70, 71, 72, 73])
def test_gauss_lobatto_nodes_reproduce_polynomials(tmp_path, kind, order):
    cell = Cell(Kind(kind, NODES[LAGRANGE[kind]](order)), "")
    x = moved(cell.shape, order, cell.nodes, "gll") @ np.array([[1, 0.2, 0], [0.1, 1, 0], [0, 0, 1]])
    x[:, cell.shape.dimension :] = 0
    path = write(tmp_path / "one.vtu", grid(x, [(kind, range(len(x)))], {"u": (linear(x) / 2) ** order}))
    source = Vtk([path])
    assert any("Gauss-Lobatto" in note for note in source.notes)
    done = check(Vtk, [path])
    places = inside(source, 0)
    if cell.shape.dimension == 3:
        wanted = (linear(places) / 2) ** order
        assert np.abs(values_found(done.dataset, "u", places) - wanted).max() < 1e-11


def test_gauss_lobatto_places_inside_match_those_of_basix():
    """Two inner nodes of order 5 as fenics-basix 0.11 has them."""
    triangle = moved(Shape.TRIANGLE, 5, np.array([[0.4, 0.2, 0.0]]), "gll")[0, :2]
    assert np.allclose(triangle, BASIX_TRIANGLE, rtol=0, atol=1e-14)
    tetrahedron = moved(Shape.TETRAHEDRON, 5, np.array([[0.2, 0.4, 0.2]]), "gll")[0]
    assert np.allclose(tetrahedron, BASIX_TETRAHEDRON, rtol=0, atol=1e-14)


def test_rational_cells_are_projected_with_a_measured_error(tmp_path):
    x = np.array(
        [[1, 0, 0], [2, 0, 0], [0, 2, 0], [0, 1, 0], [1.5, 0, 0], [2, 2, 0], [0, 1.5, 0], [1, 1, 0], [1.5, 1.5, 0]]
    )
    w = np.array([1, 1, 1, 1, 1, 0.5**0.5, 1, 0.5**0.5, 0.5**0.5])
    data = grid(x, [(77, range(9))], {"u": linear(x)})
    from vtkmodules.util.numpy_support import numpy_to_vtk

    weights = numpy_to_vtk(w, deep=True)
    weights.SetName("RationalWeights")
    data.GetPointData().SetRationalWeights(weights)
    path = write(tmp_path / "arc.vtu", data)
    source = Vtk([path])
    edge = source.positions(source.blocks[0], np.array([[0.3, 0.0], [0.3, 1.0], [0.0, 0.4], [1.0, 0.4]]))
    assert np.allclose(np.linalg.norm(edge[0, 2:], axis=1), [1, 2], rtol=0, atol=1e-14)
    done = check(Vtk, [path])
    assert 1e-8 < done.report.geometry.max < 1e-5
    assert not done.report.geometry.is_exact


@pytest.mark.parametrize("suffix", [".vtk", ".vtu", ".vtm"])
def test_every_container(tmp_path, suffix):
    x, cells = cube()
    data = grid(x, cells, {"u": linear(x), "ids": np.arange(len(x))}, {"part": np.array([3.0, 7.0])})
    if suffix == ".vtm":
        from vtkmodules.vtkCommonDataModel import vtkMultiBlockDataSet

        tree = vtkMultiBlockDataSet()
        tree.SetBlock(0, data)
        tree.GetMetaData(0).Set(tree.NAME(), "steel")
        data = tree
    done = check(Vtk, [write(tmp_path / f"two{suffix}", data)])
    assert [field.name for field in done.report.fields] == ["u", "ids", "part"]
    assert [field.is_continuous for field in done.report.fields] == [True, False, False]
    assert np.isclose(values_found(done.dataset, "part", x[:10].mean(axis=0)[None])[0], 3.0)
    if suffix == ".vtm":
        assert done.dataset.mesh.composites[0].name == "steel"


@pytest.mark.thorough
def test_a_series_of_parts(tmp_path):
    for step in range(2):
        for part in range(2):
            x, cells = cube(shift=2.0 * part)
            write(tmp_path / f"s{step}p{part}.vtu", grid(x, cells, {"u": step + linear(x)}))
    entries = "".join(
        f'<DataSet timestep="{s / 4}" part="{p}" file="s{s}p{p}.vtu"/>' for s in range(2) for p in range(2)
    )
    index = tmp_path / "all.pvd"
    index.write_text(f'<?xml version="1.0"?><VTKFile type="Collection"><Collection>{entries}</Collection></VTKFile>')
    for step, time in ((None, 0.25), ("0", 0.0)):
        done = check(Vtk, [index], **({} if step is None else {"step": step}))
        assert done.dataset.time == time
        assert done.report.elements == {"tetrahedron": 4}
        places = x[:10].mean(axis=0)[None]
        assert np.isclose(values_found(done.dataset, "u", places)[0], 4 * time + linear(places)[0])
    series = open_series(index, cache=False)
    assert series.times.tolist() == [0.0, 0.25]
    assert np.isclose(values_found(series.at(0.125), "u", places)[0], 0.5 + linear(places)[0])
    listed = tmp_path / "all.vtu.series"
    names = [{"name": f"s{s}p1.vtu", "time": s / 4} for s in range(2)]
    listed.write_text(json.dumps({"file-series-version": "1.0", "files": names}))
    series = open_series(listed, cache=False)
    assert series.times.tolist() == [0.0, 0.25]
    assert np.isclose(values_found(series.at(0.125), "u", places)[0], 0.5 + linear(places)[0])
    listed.write_text(json.dumps({"file-series-version": "1.0", "files": [names[0]] * 100}))
    assert check(Vtk, [listed]).report.elements == {"tetrahedron": 2}
    (tmp_path / "s1p1.vtu").unlink()
    with pytest.raises(FormatError, match=r"expected a VTK file s1p1\.vtu next to it, found none"):
        Vtk([index])
    with pytest.raises(FormatError, match="expected a step from 0 to 1, found 7"):
        Vtk([index], step="7")
    with pytest.raises(ElvisError, match="expected a number for the option step, found 'last'"):
        Vtk([index], step="last")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda b: b[: len(b) // 2], "expected a complete VTK file, found"),
        (lambda b: b.replace(b'NumberOfCells="2"', b'NumberOfCells="0"'), "expected cells, found none"),
        (lambda b: b.replace(b'NumberOfPoints="20"', b'NumberOfPoints="999"'), "expected a complete VTK file, found"),
    ],
)
def test_bad_files_give_a_one_line_error(tmp_path, spoil, message, capfd):
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    x, cells = cube()
    writer, path = vtkXMLUnstructuredGridWriter(), tmp_path / "bad.vtu"
    writer.SetFileName(str(path))
    writer.SetDataModeToAscii()
    writer.SetInputData(grid(x, cells, {"u": linear(x)}))
    writer.Write()
    raw = path.read_bytes()
    assert spoil(raw) != raw
    path.write_bytes(spoil(raw))
    with pytest.raises(FormatError, match=message):
        Vtk([path])
    assert capfd.readouterr().err == ""


def test_cells_that_cannot_be_evaluated_are_named(tmp_path):
    x = np.random.default_rng(0).random((7, 3))
    with pytest.raises(FormatError, match=r"linear, quadratic, Lagrange or Bezier cells, found polygons \(type 7\)"):
        Vtk([write(tmp_path / "polygon.vtu", grid(x, [(7, range(5))]))])
    with pytest.raises(FormatError, match="expected cells, found none"):
        Vtk([write(tmp_path / "points.vtu", grid(x, [(1, [0])]))])
    with pytest.raises(FormatError, match="expected as many nodes as a tetrahedron of some order"):
        Vtk([write(tmp_path / "odd.vtu", grid(x, [(71, range(7))]))])


def test_cells_of_lower_dimension_are_skipped_and_counted(tmp_path):
    x, cells = cube(order=1)
    done = check(Vtk, [write(tmp_path / "mixed.vtu", grid(x, [*cells, (5, [0, 1, 2]), (3, [0, 1])]))])
    assert done.report.elements == {"tetrahedron": 2}
    assert "2 cells of lower dimension were skipped" in done.report.warnings


def test_other_files_are_rejected(tmp_path):
    path = tmp_path / "other"
    for text in ("", "neither"):
        path.write_text(text)
        assert not Vtk.opens([path])
        with pytest.raises(FormatError, match="expected an unstructured grid of VTK"):
            Vtk([path])


def lattice(kind, order, line):
    """The nodes of a cell, whose lines have nodes at (order + 1,) places in [0, 1]."""
    cell = Cell(Kind(kind, NODES[LAGRANGE[kind]](order)), "")
    return np.asarray(line)[np.rint(cell.nodes * order).astype(int)]


@pytest.mark.parametrize("order", [1, 2, 3, 5])
@pytest.mark.parametrize("kind", [70, 72])
def test_gauss_nodes_are_recognised_by_gaps_between_cells(tmp_path, kind, order):
    inside = lattice(kind, order, (gauss(order + 1)[0] + 1) / 2) * np.array([1, 1, kind == 72])
    x = np.concatenate([inside + shift for shift in ([0, 0, 0], [1, 0, 0], [1, 1, 0])])
    cells = [(kind, np.arange(len(inside)) + i * len(inside)) for i in range(3)]
    dataset = read(write(tmp_path / "cells.vtu", grid(x, cells, {"u": x[:, 0] ** order})), cache=False)
    found = sample(dataset, "u", [[0.02, 0.5, 0.5 * (kind == 72)], [1.99, 1.9, 0.01 * (kind == 72)]])
    assert np.abs(found.values[:, 0] - np.array([0.02, 1.99]) ** order).max() < 1e-11
    assert integrate(dataset, "1").value == pytest.approx(3, abs=1e-12)


@pytest.mark.sampled
@pytest.mark.parametrize("family", ["equispaced", "gll", "gauss"])
@pytest.mark.parametrize("order", [4, 5, 7])
def test_the_smoothest_map_identifies_the_nodes_if_all_edges_are_curved(tmp_path, family, order):
    lines = {"equispaced": np.linspace(-1, 1, order + 1), "gll": lobatto(order + 1)[0], "gauss": gauss(order + 1)[0]}
    r = lattice(72, order, (lines[family] + 1) / 2)
    # a polynomial of degree 2 in each coordinate bends all edges
    x = r + 0.1 * r[:, [1, 2, 0]] * (2 - r[:, [1, 2, 0]]) * (1 + r) + 0.08 * r * (1 - r)
    dataset = read(write(tmp_path / "bent.vtu", grid(x, [(72, np.arange(len(x)))])), cache=False)
    fine = np.polynomial.legendre.leggauss(8)
    t = np.stack(np.meshgrid(*[(fine[0] + 1) / 2] * 3, indexing="ij"), -1).reshape(-1, 3)
    weights = np.einsum("i,j,k->ijk", *[fine[1] / 2] * 3).ravel()
    a, b, c = t.T
    bend, slope = lambda s: 0.1 * s * (2 - s), lambda s: 0.2 * (1 - s)
    diagonal = [1 + bend(o) + 0.08 * (1 - 2 * own) for own, o in ((a, b), (b, c), (c, a))]
    across = [slope(o) * (1 + own) for own, o in ((a, b), (b, c), (c, a))]
    volume = (weights * (np.prod(diagonal, axis=0) + np.prod(across, axis=0))).sum()
    assert integrate(dataset, "1").value == pytest.approx(volume, abs=1e-12)


def test_every_command_warns_if_the_nodes_are_ambiguous(tmp_path):
    rng = np.random.default_rng(3)
    x = lattice(70, 4, np.linspace(0, 1, 5)) * np.array([1, 1, 0])
    x[:, :2] += 0.05 * rng.uniform(-1, 1, (len(x), 2))
    path = write(tmp_path / "rough.vtu", grid(x, [(70, np.arange(len(x)))]))
    assert "the nodes of cells can't be determined" in " ".join(read(path, cache=False).remarks)
    assert "can't be determined" not in " ".join(read(path, reader=["nodes=gll"], cache=False).remarks)


@pytest.mark.parametrize("entry", ["", '<DataSet timestep="nan" file="a.vtu"/>'])
def test_collections_without_times_are_rejected(tmp_path, entry):
    path = tmp_path / "all.pvd"
    path.write_text(f'<VTKFile type="Collection"><Collection>{entry}</Collection></VTKFile>')
    with pytest.raises(FormatError, match="expected a list of files with their times, found one without"):
        Vtk([path])
