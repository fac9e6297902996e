"""PyFR meshes and solutions against PyFR's own sampler."""

import shutil
from importlib.util import find_spec

import h5py
import numpy as np
import pytest

from elvis import Basis, ElvisError, FormatError, Shape
from elvis.converters.pyfr import old as pyfr_old
from elvis.converters.pyfr.pyfr import _KINDS, PyFR
from elvis.plugins.conversion.converting import convert
from elvis.plugins.conversion.nodal import native_points, space_size, space_values
from elvis.plugins.testing import check

NAMES = ("rho", "rhou", "rhov", "rhow", "E")
MESH, SOLUTION = "mixed3d_p3.pyfrm", "mixed3d_p3-01.pyfrs"

#: the source's blocks come in the order of the alphabet
KINDS = ("hex", "pri", "pyr", "tet")
BLOCKS = {kind: number for number, kind in enumerate(KINDS)}


@pytest.fixture
def folder(solvers):
    return solvers / "pyfr"


def ours(block, ref):
    """The solver's reference points in our coordinates."""
    shape, frame, _ = _KINDS[KINDS[block]]
    return native_points(shape, np.array(frame, float), ref)


@pytest.mark.parametrize("number", ["00", "01"])
def test_all_shapes_agree_with_the_solver(folder, truth, near, number):
    conversion = check(PyFR, [folder / f"mixed3d_p3-{number}.pyfrs"])
    assert {measure.state for measure in (conversion.report.geometry, *conversion.report.fields)} == {"exact"}
    assert conversion.report.elements == {"tetrahedron": 98, "pyramid": 4, "prism": 28, "hexahedron": 12}
    own = truth(folder / f"mixed3d_p3-{number}.truth.npz")
    near(own.positions_at(conversion, BLOCKS, ours), own.xyz, 1e-11)
    for column, field in enumerate(NAMES):
        wanted = own.column("soln", column)
        near(own.at(conversion, field, BLOCKS, ours), wanted)
        near(own.found(conversion.dataset, field), wanted)


def test_pyramids_remain_pyramids(folder):
    dataset = convert(PyFR([folder / MESH, folder / SOLUTION])).dataset
    blocks = {block.expansion.shape: block.expansion for block in dataset.field("rho").blocks}
    assert blocks[Shape.PYRAMID].bases == (Basis.ORTHO_A, Basis.ORTHO_A, Basis.ORTHO_PYR_C)
    assert dataset.time == pytest.approx(0.02)
    assert dataset.mesh.composites[-1].name == "wall"
    assert len(dataset.mesh.composites) == 5


def test_derived_quantities_state_their_error(folder, truth):
    conversion = check(PyFR, [folder / SOLUTION], primitive=True)
    own = truth(folder / "mixed3d_p3-01.truth.npz")
    rho, rhou, rhov, rhow, energy = (own.column("soln", i) for i in range(5))
    pressure = 0.4 * (energy - 0.5 * (rhou**2 + rhov**2 + rhow**2) / rho)
    measures = {measure.name: measure for measure in conversion.report.fields}
    for name, wanted in (("u", rhou / rho), ("v", rhov / rho), ("w", rhow / rho), ("p", pressure)):
        assert measures[name].state == "projected"
        assert 0 < np.abs(own.found(conversion.dataset, name) - wanted).max() <= 1.5 * measures[name].max


@pytest.fixture
def copied(folder, tmp_path):
    """The mesh and a solution, to be damaged."""
    for name in (MESH, SOLUTION):
        shutil.copy(folder / name, tmp_path / name)
        (tmp_path / name).chmod(0o644)
    return tmp_path


def as_subset(folder):
    with h5py.File(folder / SOLUTION, "r+") as file:
        for kind in ("hex", "pyr"):
            del file[f"soln/p3-{kind}"]
        data = file["soln/p3-tet"]
        values, points = data[::3], data.attrs["pts"]
        del file["soln/p3-tet"]
        file["soln/p3-tet"] = values
        file["soln/p3-tet"].attrs["pts"] = points
        file["soln/p3-tet-idxs"] = np.arange(0, 98, 3)


def test_a_part_of_the_mesh_is_converted_on_request(folder, copied, truth, near):
    whole = convert(PyFR([copied / SOLUTION])).dataset
    as_subset(copied)
    with pytest.raises(FormatError, match="expected values on all 142 elements of the mesh, found none on 81"):
        PyFR([copied / SOLUTION])
    conversion = check(PyFR, [copied / SOLUTION], subset=True)
    assert conversion.report.elements == {"tetrahedron": 33, "prism": 28}
    assert any("81 elements" in note for note in conversion.report.warnings)
    own = truth(folder / "mixed3d_p3-01.truth.npz")
    part, everything = own.found(conversion.dataset, "rho"), own.found(whole, "rho")
    inside = np.isfinite(part)
    assert inside[own.shape == "pri"].all()
    assert not inside[own.shape == "hex"].any()
    near(part[inside], everything[inside])


def without_mesh(folder):
    (folder / MESH).unlink()


def on_another_mesh(folder):
    with h5py.File(folder / SOLUTION, "r+") as file:
        del file["mesh-uuid"]
        file["mesh-uuid"] = np.bytes_("00000000-267e-c603-6803-3cdf733fa874")


def with_too_few_values(folder):
    with h5py.File(folder / SOLUTION, "r+") as file:
        data = file["soln/p3-hex"]
        values, points = data[:5], data.attrs["pts"]
        del file["soln/p3-hex"]
        file["soln/p3-hex"] = values
        file["soln/p3-hex"].attrs["pts"] = points


def with_unknown_elements(folder):
    with h5py.File(folder / MESH, "r+") as file:
        file.move("eles/hex", "eles/octahedron")


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (without_mesh, r"expected its mesh \(.pyfrm\) next to it, found none"),
        (with_too_few_values, r"soln/p3-hex: expected \(12, 5, 64\) values on 12 elements, found \(5, 5, 64\)"),
        (with_unknown_elements, "expected elements quad, tri, hex, pri, pyr, tet, found octahedron"),
    ],
)
def test_bad_input_gives_a_one_line_error(copied, spoil, sentence):
    spoil(copied)
    with pytest.raises(FormatError, match=sentence):
        PyFR([copied / SOLUTION])


def test_a_solution_on_another_mesh_is_rejected(copied):
    on_another_mesh(copied)
    with pytest.raises(FormatError, match="expected a solution on the mesh mixed3d_p3"):
        PyFR([copied / MESH, copied / SOLUTION])


def as_old(folder, target, kinds=KINDS, parts=1):
    """The same mesh and solution in the layout of before 2.1, their elements dealt to partitions in turn."""
    target.mkdir()
    with h5py.File(folder / MESH) as mesh, h5py.File(target / "old.pyfrm", "w") as file:
        file["mesh_uuid"] = np.bytes_("1234")
        places, codec = np.asarray(mesh["nodes"]["location"]), [name.decode() for name in mesh["codec"]]
        wall = codec.index("bc/wall")
        for part in range(parts):
            sides = []
            for kind in kinds:
                data = mesh["eles"][kind]
                numbers, links = np.asarray(data["nodes"])[part::parts], np.asarray(data["faces"]["cidx"])[part::parts]
                file[f"spt_{kind}_p{part}"] = places[numbers].transpose(1, 0, 2)
                sides += [(kind.encode(), row, face, 0) for row, face in np.argwhere(links == wall).tolist()]
            file[f"bcon_wall_p{part}"] = np.array(sides, dtype="S4,i4,i1,i2")
    with h5py.File(folder / SOLUTION) as solution, h5py.File(target / "old.pyfrs", "w") as file:
        file["mesh_uuid"] = np.bytes_("1234")
        for name in ("config", "stats"):
            file[name] = solution[name][()]
        for part in range(parts):
            for kind in kinds:
                file[f"soln_{kind}_p{part}"] = np.asarray(solution[f"soln/p3-{kind}"])[part::parts].transpose(2, 1, 0)
    return [target / "old.pyfrm", target / "old.pyfrs"]


def kinds_with_points():
    """Those whose solution points are known without the package, or all with it."""
    return KINDS if find_spec("pyfr") else ("hex",)


@pytest.mark.thorough
@pytest.mark.parametrize("parts", [1, 3])
def test_files_before_2_1_contain_the_same(folder, tmp_path, truth, near, parts):
    kinds = kinds_with_points()
    paths = as_old(folder, tmp_path / "old", kinds, parts)
    conversion = check(PyFR, paths)
    assert {measure.state for measure in (conversion.report.geometry, *conversion.report.fields)} == {"exact"}
    own = truth(folder / "mixed3d_p3-01.truth.npz")
    here = np.isin(own.shape, kinds)
    for column, field in enumerate(NAMES):
        wanted, found = own.column("soln", column)[here], own.found(conversion.dataset, field)[here]
        near(found, wanted)
    border = conversion.dataset.mesh.composites[-1]
    if kinds == KINDS:
        whole = convert(PyFR([folder / MESH, folder / SOLUTION])).dataset.mesh
        assert border.name == "wall"
        assert sum(map(len, (ids for _, ids in border.parts))) == sum(len(i) for _, i in whole.composites[-1].parts)
    assert conversion.dataset.time == pytest.approx(0.02)


def test_old_meshes_without_solutions_have_all_shapes(folder, tmp_path):
    conversion = check(PyFR, as_old(folder, tmp_path / "old", KINDS, 2)[:1])
    assert conversion.report.geometry.is_exact
    assert conversion.report.elements == {"tetrahedron": 98, "pyramid": 4, "prism": 28, "hexahedron": 12}
    whole = convert(PyFR([folder / MESH])).dataset.mesh
    names = [{c.name: sum(len(i) for _, i in c.parts) for c in m.composites} for m in (conversion.dataset.mesh, whole)]
    assert names[0] == names[1]


@pytest.mark.parametrize("kind", ["quad", "tri", "hex", "pri", "pyr", "tet"])
def test_shape_points_match_those_of_the_files(folder, kind):
    with h5py.File(folder / MESH) as mesh:
        if kind in mesh["eles"]:
            points = np.asarray(mesh["eles"][kind].attrs["pts"])
            assert np.abs(pyfr_old.shape_points(kind, len(points), "") - points).max() < 1e-15
    for order in (1, 2, 4):
        shape, frame, _ = _KINDS[kind]
        points = pyfr_old.shape_points(kind, space_size(shape, order), "")
        assert np.linalg.matrix_rank(space_values(shape, order, native_points(shape, np.array(frame, float), points)))


def spoilt(paths, which, change):
    with h5py.File(paths[which], "r+") as file:
        change(file)


def without_rule(file):
    config = file["config"][()].decode()
    del file["config"]
    file["config"] = np.bytes_(config.replace("soln-pts = gauss-legendre", "soln-pts = no-such-points"))


def with_a_short_partition(file):
    short = file["spt_hex_p1"][:8]
    del file["spt_hex_p1"]
    file["spt_hex_p1"] = short


def with_a_side_of_nothing(file):
    del file["bcon_wall_p0"]
    file["bcon_wall_p0"] = np.array([(b"hex", 999, 0, 0)], dtype="S4,i4,i1,i2")


@pytest.mark.parametrize(
    ("which", "change", "sentence"),
    [
        (1, without_rule, "the package pyfr"),
        (0, with_a_short_partition, r"spt_hex: expected partitions alike, found \(64, 6, 3\) and \(8, 6, 3\)"),
        (0, with_a_side_of_nothing, "bcon_wall_p0: expected a side of an element, found"),
        (1, lambda file: file.move("soln_hex_p0", "soln_tet_p0"), "expected|package pyfr"),
        (0, lambda file: file.move("spt_hex_p0", "spt_cow_p0"), "expected elements quad, tri, hex, .*, found cow"),
    ],
)  # fmt: skip
def test_bad_old_files_give_a_one_line_error(folder, tmp_path, which, change, sentence):
    paths = as_old(folder, tmp_path / "old", ("hex",), 2)
    spoilt(paths, which, change)
    with pytest.raises(ElvisError, match=sentence):
        PyFR(paths)
