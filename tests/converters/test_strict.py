"""What converters write keeps every rule of the format, but for elements that the report lists as inverted."""

import re

import pytest

from elvis.formats import write
from elvis.formats.strict import findings
from elvis.plugins.converting import convert
from elvis.plugins.discovery import chosen, installed, with_defaults

CASES = [
    ("gmsh/ball_tet_o2_p5.msh",),
    ("gmsh/mixed_o3.msh",),
    ("gmsh/mixed_o2_v22.msh",),
    ("vtk/mfem_fichera_mixed_p2.vtu",),
    ("vtk/mfem_fichera_q3.vtu",),
    ("vtk/dealii_shell_p4.vtu",),
    ("hopr_flexi/convcurved_N4_State.h5",),
    ("hopr_flexi/pyhope_1-11-cartbox_mixed_mesh.h5",),
    ("pyfr/mixed3d_p3.pyfrm", "pyfr/mixed3d_p3-01.pyfrs"),
    ("mfem/escher_p3.mesh", "mfem/escher_p3.u.gf"),
    ("cgns/gmsh_mixed_o2.cgns",),
    ("exodus/simple-cube-multi-element-order2.e",),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case[0])
@pytest.mark.parametrize("form", ["compressed", "text", "hdf5"])
def test_converted_files_keep_all_rules(solvers, tmp_path, case, form):
    paths = [solvers / name for name in case]
    candidate = next((c for c in installed() if c.converter and not c.missing and c.converter.opens(paths)), None)
    if candidate is None:
        pytest.skip("its library is not installed")
    converter = chosen([candidate], paths).converter
    conversion = convert(converter(paths, **with_defaults(converter, {})), files=paths)
    written = write(
        conversion.dataset, tmp_path / "a.xml", mesh_format=form, field_format="hdf5" if form == "hdf5" else "xml"
    )
    found = [str(each) for each in findings(*[path for path in written if path.suffix != ".nekg"])]
    inverted = conversion.report.listed["inverted"]
    expected = rf"elements: expected positive Jacobians of .*, found others in {len(inverted)}: .*"
    assert all(re.fullmatch(expected, each) for each in found)
    assert bool(found) == bool(inverted)
