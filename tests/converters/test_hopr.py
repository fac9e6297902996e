"""HOPR meshes and FLEXI states against FLEXI's own evaluation."""

import shutil

import h5py
import numpy as np
import pytest
from small_files import hopr as small_hopr

from elvis import FormatError, integrate
from elvis.converters.hopr import Hopr
from elvis.core.data.mesh import NON_CONFORMING, PERIODIC
from elvis.plugins.conversion.converting import convert
from elvis.plugins.testing import check, values_found

NAMES = ("Density", "MomentumX", "MomentumY", "MomentumZ", "EnergyStagnationDensity")
NACA = "NACA0012_Re5000_AoA8_3D_Referenz_0000010.000000000.h5"
CAVITY = "reggie_cavity_Re100_State_0000001.000000000.h5"

#: state, truth, whether the map needs fields, digits that the solver's float32 tool keeps of the largest value
CASES = [
    (NACA, "NACA0012_3D", False),
    ("convcurved_N4_State.h5", "convcurved_N4", True),
    (CAVITY, "cavity4x4x4", False),
]


@pytest.fixture
def folder(solvers):
    return solvers / "hopr_flexi"


@pytest.mark.parametrize(("state", "name", "has_map"), CASES)
def test_states_agree_with_the_solver(folder, truth, near, state, name, has_map):
    conversion = check(Hopr, [folder / state])
    assert {measure.state for measure in (conversion.report.geometry, *conversion.report.fields)} == {"exact"}
    assert conversion.report.has_map is has_map
    own = truth(folder / f"{name}.truth.npz")
    near(own.positions_at(conversion, {"hex": 0}), own.xyz, 1e-12)
    for column, field in enumerate(NAMES):
        wanted, visu = own.column("soln", column), own.column("soln_posti_visu", column)
        by_element, by_place = own.at(conversion, field, {"hex": 0}), own.found(conversion.dataset, field)
        near(by_element, wanted)
        near(by_place, wanted)
        assert np.abs(by_place - visu).max() <= 2e-7 * np.abs(visu).max()


def test_names_time_boundaries(folder):
    conversion = convert(Hopr([folder / NACA]))
    dataset = conversion.dataset
    assert tuple(field.name for field in dataset.fields) == NAMES
    assert dataset.time == 10.0
    assert dataset.metadata["Program"] == "Flexi"
    names = [composite.name for composite in dataset.mesh.composites]
    assert names == ["hexahedron", "BC_wall", "BC_inflow", "BC_outflow", "BC_zminus", "BC_zplus", PERIODIC]


def test_all_shapes_of_a_mesh_without_fields(folder):
    source = Hopr([folder / "pyhope_1-11-cartbox_mixed_mesh.h5"])
    assert [(len(block), block.order) for block in source.blocks] == [(48, 4), (48, 4), (32, 4), (8, 4)]
    conversion = check(Hopr, [folder / "pyhope_1-11-cartbox_mixed_mesh.h5"])
    assert conversion.report.geometry.state == "exact"

    # every side on the border has a name; the inner nodes of this file's pyramids are folded.  The sides of collapsed
    # hexahedra, which stand for pyramids, are quadrilaterals next to the triangles of tetrahedra
    names = {c.name for c in conversion.dataset.mesh.composites[3:]}
    assert names == {NON_CONFORMING, "bc_x-", "bc_x+", "bc_y-", "bc_y+", "bc_z-", "bc_z+"}
    pyramids = source.blocks[1].ids
    assert set(conversion.report.listed["inverted"]) == set(pyramids.tolist())


def test_sides_lie_at_their_named_positions(folder):
    dataset = convert(Hopr([folder / "cavity4x4x4_mesh.h5"])).dataset
    from elvis.core.mapping.orientation import polygon_vertices
    from elvis.core.shapes import Shape

    faces = dataset.mesh.vertices[polygon_vertices(dataset.mesh, Shape.QUADRILATERAL)]
    planes = {"BC_zminus": (2, 0), "BC_zplus": (2, 1), "BC_wall_left": (0, 0), "BC_wall_right": (0, 1)}
    low, high = dataset.mesh.vertices.min(axis=0), dataset.mesh.vertices.max(axis=0)
    for composite in dataset.mesh.composites:
        if composite.name in planes:
            axis, end = planes[composite.name]
            assert faces[composite.parts[0][1], :, axis] == pytest.approx((low, high)[end][axis])


@pytest.fixture
def copied(folder, tmp_path):
    """A state and its mesh, to be damaged."""
    for name in (CAVITY, "cavity4x4x4_mesh.h5"):
        shutil.copy(folder / name, tmp_path / name)
        (tmp_path / name).chmod(0o644)
    return tmp_path


def test_gauss_lobatto_nodes(copied):
    with h5py.File(copied / CAVITY, "r+") as file:
        file.attrs["NodeType"] = b"GAUSS-LOBATTO"
        line = np.array([-1.0, 0.0, 1.0])
        file["DG_Solution"][...] = (line**2)[:, None]
    conversion = convert(Hopr([copied / CAVITY]))
    found = check(Hopr, [copied / CAVITY]).report.fields[0]
    assert found.state == "exact"
    assert found.range == pytest.approx(1, abs=1e-3)
    assert conversion.report.fields[0].order == 2


def without_mesh(folder):
    (folder / "cavity4x4x4_mesh.h5").unlink()


def on_another_mesh(folder):
    with h5py.File(folder / CAVITY, "r+") as file:
        short = file["DG_Solution"][:10]
        del file["DG_Solution"]
        file["DG_Solution"] = short


def with_other_nodes(folder):
    with h5py.File(folder / CAVITY, "r+") as file:
        file.attrs["NodeType"] = b"CHEBYSHEV"


def with_subcells(folder, marks=slice(5), widths=None):
    with h5py.File(folder / CAVITY, "r+") as file:
        file.attrs["VarNamesAdd"] = np.array([b"myRank", b"FV_Elems", b"dt"])
        file["ElemData"][:, 1] = 0
        file["ElemData"][marks, 1] = 1
        if widths is not None:
            file.attrs["FV_w"] = widths


def with_too_little_element_data(folder):
    with_subcells(folder)
    with h5py.File(folder / CAVITY, "r+") as file:
        short = file["ElemData"][:3]
        del file["ElemData"]
        file["ElemData"] = short


@pytest.mark.parametrize("widths", [None, [0.25, 1.25, 0.5]])
def test_sub_cells_become_elements(copied, widths):
    """A mean in every box of five elements; the others keep their polynomials."""
    before = convert(Hopr([copied / CAVITY])).dataset
    with_subcells(copied, slice(5), widths)
    with h5py.File(copied / CAVITY) as file:
        means = np.asarray(file["DG_Solution"])
    with h5py.File(copied / "cavity4x4x4_mesh.h5") as file:
        info, nodes = np.asarray(file["ElemInfo"]), np.asarray(file["NodeCoords"])
    conversion = check(Hopr, [copied / CAVITY])
    assert conversion.report.elements == {"hexahedron": 59 + 5 * 27}
    assert all(measure.is_exact for measure in (conversion.report.geometry, *conversion.report.fields))

    # points of boxes (i, j, k) in element 3, which is a brick
    corners = nodes[info[3, 4] : info[3, 5]]
    low, high = corners.min(axis=0), corners.max(axis=0)
    ends = np.cumsum([0, *(widths or [2 / 3] * 3)]) / 2
    rng = np.random.default_rng(1)
    for i, j, k in np.ndindex(3, 3, 3):
        share = [rng.uniform(ends[n] + 0.01, ends[n + 1] - 0.01) for n in (i, j, k)]
        found = values_found(conversion.dataset, "Density", (low + (high - low) * share)[None])
        assert found == pytest.approx(means[3, k, j, i, 0], rel=1e-13)
    inside = nodes[info[40, 4] : info[40, 5]].mean(axis=0, keepdims=True) + 0.01
    after, wanted = (values_found(each, "Density", inside) for each in (conversion.dataset, before))
    assert after == pytest.approx(wanted, rel=1e-13)


def test_sides_of_sub_cells_keep_their_names(copied):
    sizes = []
    for marks in (slice(0), slice(None)):
        with_subcells(copied, marks)
        mesh = convert(Hopr([copied / CAVITY])).dataset.mesh
        sizes.append({c.name: sum(len(ids) for _, ids in c.parts) for c in mesh.composites[1:]})
    assert sizes[1] == {name: 9 * size for name, size in sizes[0].items()}


def truncated(folder):
    path = folder / CAVITY
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (without_mesh, "expected its mesh cavity4x4x4_mesh.h5 next to it"),
        (on_another_mesh, "expected values on the 64 elements of the mesh, found an array of shape"),
        (with_other_nodes, "expected GAUSS or GAUSS-LOBATTO nodes"),
        (with_too_little_element_data, r"ElemData: expected \(64, 3\) numbers, found \(3, "),
        (lambda folder: with_subcells(folder, widths=[1.0, 2.0, -1.0]), "FV_w: expected 3 widths with sum 2, found"),
    ],
)
def test_bad_input_gives_a_one_line_error(copied, spoil, sentence):
    spoil(copied)
    with pytest.raises(FormatError, match=sentence):
        Hopr([copied / CAVITY])


def test_a_truncated_file_is_rejected(copied, elvis, tmp_path):
    truncated(copied)
    with pytest.raises(Exception, match=CAVITY):
        elvis("convert", copied / CAVITY, "-o", tmp_path / "out.xml")
    assert not (tmp_path / "out.xml").exists()


@pytest.mark.parametrize("has_types", [True, False])
def test_periodic_sides_are_not_outer_boundaries_and_keep_their_names(tmp_path, has_types):
    """Of two cubes in a row, the first and the last side are one; of others that have such a type no neighbour."""
    (path,) = small_hopr(tmp_path)
    with h5py.File(path, "r+") as file:
        sides = np.asarray(file["SideInfo"])
        sides[4, 2:4], sides[8, 2:4] = (2, 30), (1, 50)
        file["SideInfo"][...] = sides
        types = np.asarray(file["BCType"])
        types[:, 0] = 1
        del file["BCType"]
        if has_types:
            file["BCType"] = types
    dataset = convert(Hopr([path])).dataset
    assert integrate(dataset, "1", "all").value == pytest.approx(8, rel=1e-12)
    assert [integrate(dataset, "1", name).value for name in ("in", "out")] == pytest.approx([1, 1], rel=1e-12)
    assert {c.name: len(c.parts[0][1]) for c in dataset.mesh.composites}[PERIODIC] == 2
