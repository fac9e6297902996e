"""Damaged files of every converter: cut, with other bytes and numbers.  What can't be read is said in a sentence."""

import random
import re
import shutil

import pytest

from elvis import ElvisError
from elvis.plugins.conversion.converting import convert
from elvis.plugins.conversion.discovery import choose_converter, installed_converters, with_defaults
from elvis.plugins.conversion.report import Report

CASES = {
    "cgns": ["cgns/gmsh_mixed_o2.cgns"],
    "exodus": ["exodus/simple-cube-hex27.e"],
    "gmf": ["gmf/ball_tetP3_sol4.meshb", "gmf/ball_tetP3_sol4.solb"],
    "gmf text": ["gmf/ball_tetP3_sol4_ascii.mesh", "gmf/ball_tetP3_sol4_ascii.sol"],
    "gmsh": ["gmsh/mixed_o2_v22.msh"],
    "hopr": ["hopr_flexi/cavity4x4x4_mesh.h5", "hopr_flexi/reggie_cavity_Re100_State_0000001.000000000.h5"],
    "mfem": ["mfem/tinyzoo.mesh", "mfem/tinyzoo.u.gf"],
    "native": ["../nektar/tet_small/"],
    "nek": ["nek5000/nek_io_test_m12io_test0.f00001"],
    "ngsolve": ["ngsolve/hexprism_p3_prism.elems.npz"],
    "pyfr": ["pyfr/mixed3d_p3.pyfrm", "pyfr/mixed3d_p3-01.pyfrs"],
    "vtk": ["vtk/dealii_shell_p4.vtu"],
}

#: converters of files that the fuzz harness makes and damages
MADE_BY_THE_HARNESS = {"elvisdat", "horses", "trixi", "vtx"}

SHARES = (0.01, 0.3, 0.7, 0.99)

#: what takes the place of a number
NUMBERS = (b"-1", b"0", b"99999999999", b"1e308", b"nan", b"x", b"")


def cut(raw, rng):
    return raw[: int(rng.choice(SHARES) * len(raw))]


def changed(raw, rng):
    found = bytearray(raw)
    for _ in range(4):
        found[rng.randrange(min(len(found), 4000))] = rng.randrange(256)
    return bytes(found)


def shortened(raw, rng):
    start = rng.randrange(len(raw))
    return raw[:start] + raw[start + rng.choice([1, 8, 64]) :]


def renumbered(raw, rng):
    found = list(re.finditer(rb"-?\d+(\.\d+)?([eE][+-]?\d+)?", raw[:100000]))
    one = rng.choice(found)
    return raw[: one.start()] + rng.choice(NUMBERS) + raw[one.end() :]


DAMAGES = (cut, changed, shortened, renumbered)


def converted(paths):
    """The report on files, or the sentence why there is none."""
    try:
        converter = choose_converter([each for each in installed_converters() if not each.missing], paths).converter
        return convert(converter(paths, **with_defaults(converter, {})), files=paths).report
    except ElvisError as error:
        return str(error)


def test_every_converter_has_a_case():
    names = {candidate.name for candidate in installed_converters()}
    assert {name.split()[0] for name in CASES} | MADE_BY_THE_HARNESS == names


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # numbers as large as they come
@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("name", CASES)
@pytest.mark.sampled
def test_damaged_files_are_read_or_give_a_one_line_error(solvers, tmp_path, name, damage):
    if next(each for each in installed_converters() if each.name == name.split()[0]).missing:
        pytest.skip("its library is not installed")
    whole = [path for file in CASES[name] for path in found(solvers / file)]
    rng = random.Random(f"{name} {DAMAGES.index(damage)}")
    paths = [tmp_path / path.name for path in whole]
    for one, path in zip(whole, paths, strict=True):
        shutil.copyfile(one, path)
    spoilt = rng.choice(paths)
    spoilt.write_bytes(damage(spoilt.read_bytes(), rng))
    outcome = converted(paths)
    if isinstance(outcome, Report):
        outcome.metadata()
    else:
        assert "\n" not in outcome
        assert len(outcome) > 20


def found(path):
    return sorted(p for p in path.iterdir() if p.suffix in (".xml", ".fld")) if path.is_dir() else [path]
