"""What converters write keeps every rule of the format, but for elements that the report lists as inverted; and it is
the same every time."""

import re

import corpus
import numpy as np
import pytest

from elvis import write
from elvis.core.shapes import Shape
from elvis.formats.strict import findings
from elvis.plugins.conversion.converting import convert
from elvis.plugins.conversion.discovery import choose_converter, installed_converters, with_defaults

#: cases of shared data by converter; those of `MADE` are made here
CASES = [
    ("gmsh", "gmsh/ball_tet_o2_p5.msh"),
    ("gmsh", "gmsh/mixed_o3.msh"),
    ("gmsh", "gmsh/mixed_o2_v22.msh"),
    ("vtk", "vtk/mfem_fichera_mixed_p2.vtu"),
    ("vtk", "vtk/mfem_fichera_q3.vtu"),
    ("vtk", "vtk/dealii_shell_p4.vtu"),
    ("hopr", "hopr_flexi/convcurved_N4_State.h5"),
    ("hopr", "hopr_flexi/pyhope_1-11-cartbox_mixed_mesh.h5"),
    ("pyfr", "pyfr/mixed3d_p3.pyfrm", "pyfr/mixed3d_p3-01.pyfrs"),
    ("mfem", "mfem/escher_p3.mesh", "mfem/escher_p3.u.gf"),
    ("mfem", "mfem/tinyzoo.mesh", "mfem/tinyzoo.u.gf", "mfem/tinyzoo.w.gf"),
    ("cgns", "cgns/gmsh_mixed_o2.cgns"),
    ("exodus", "exodus/simple-cube-multi-element-order2.e"),
    ("gmf", "gmf/ball_tetP3_sol4.meshb", "gmf/ball_tetP3_sol4.solb"),
    ("gmf", "gmf/ball_tetP3_sol4_ascii.mesh", "gmf/ball_tetP3_sol4_ascii.sol"),
    ("ngsolve", "ngsolve/ballbox_p4.elems.npz"),
    ("ngsolve", "ngsolve/hexprism_p3_prism.elems.npz"),
    ("nek", "nek5000/ethier0.f00001", "nek5000/ethier.re2"),
    ("native", "../nektar/gen_allelem_n4/"),
    ("elvisdat", "volume.dat"),
    ("trixi", "s_TreeMesh.h5"),
    ("horses", "two.hsol"),
    ("vtx", "u.bp"),
]

FORMS = ("compressed", "text", "hdf5")


def volume(path):
    """A row of three skewed elements with random coefficients, as the first ElVis kept them."""
    rng = np.random.default_rng(3)
    raw = b"a row of elements".ljust(24) + np.array([1, 3], ">i4").tobytes()
    for number, (kind, shape, count) in enumerate(
        ((1, Shape.HEXAHEDRON, 27), (3, Shape.PRISM, 18), (1, Shape.HEXAHEDRON, 27))
    ):
        corners = np.zeros((8, 3))
        corners[: len(shape.vertices)] = shape.vertices + rng.uniform(-0.1, 0.1, shape.vertices.shape)
        corners[:, 0] += 3 * number
        raw += np.array([kind, 0], ">i4").tobytes() + np.zeros(2).tobytes() + corners.astype(">f8").tobytes()
        raw += np.array([2, 2, 2], ">i4").tobytes() + rng.uniform(-1, 1, count).astype(">f8").tobytes()
    path.write_bytes(raw)


MADE = {"volume.dat": volume}
#: makers of the fuzz harness, of which the first files are taken, by converter
SMALL = {"trixi": corpus.trixi, "horses": corpus.horses, "vtx": corpus.vtx}


@pytest.fixture
def conversion(solvers, tmp_path, request):
    """``conversion(case)`` converts it afresh; skips where the library of its converter isn't there."""

    def found(case):
        name, *files = case
        candidate = next(each for each in installed_converters() if each.name == name)
        if candidate.missing:
            pytest.skip("its library is not installed")
        for made in (file for file in files if file in MADE):
            MADE[made](tmp_path / made)
        paths = [tmp_path / file if file in MADE else solvers / file for file in files]
        if name in SMALL:
            folder = tmp_path / f"{name} {len(list(tmp_path.iterdir()))}"
            folder.mkdir()
            paths = [*next(SMALL[name](folder)).files]
            paths = [folder / files[0]] if (folder / files[0]).is_dir() else paths
        if paths[0].is_dir() and name == "native":
            paths = sorted(path for path in paths[0].iterdir() if path.suffix in (".xml", ".fld"))
        converter = choose_converter([each for each in installed_converters() if not each.missing], paths).converter
        assert converter is candidate.converter
        return convert(converter(paths, **with_defaults(converter, {})), files=paths)

    return found


def written(dataset, folder, form):
    """The files of a dataset in one of the forms."""
    folder.mkdir()
    return write(dataset, folder / "a.xml", mesh_format=form, field_format="hdf5" if form == "hdf5" else "xml")


def test_every_converter_has_a_case():
    assert {case[0] for case in CASES} == {candidate.name for candidate in installed_converters()}


@pytest.mark.sampled(least=10, free=("case",))
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case[1])
def test_converted_files_pass_the_strict_checks_and_are_reproducible(conversion, tmp_path, case, form):
    first, second = conversion(case), conversion(case)
    inverted = first.report.listed["inverted"]
    expected = rf"elements: expected positive Jacobians of .*, found others in {len(inverted)}: .*"
    files, again = (written(each.dataset, tmp_path / str(i), form) for i, each in enumerate((first, second)))
    found = [str(each) for each in findings(*[path for path in files if path.suffix != ".nekg"])]
    assert all(re.fullmatch(expected, each) for each in found)
    assert bool(found) == bool(inverted)
    assert [path.name for path in files] == [path.name for path in again]
    assert all(one.read_bytes() == other.read_bytes() for one, other in zip(files, again, strict=True))
