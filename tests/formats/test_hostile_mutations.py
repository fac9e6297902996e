"""A thousand damaged files are read and evaluated, or rejected with a one-line error; no other exception, no hang."""

import shutil
import time
import warnings

import numpy as np
import pytest
from mutations import damage

from elvis import ElvisError
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.evaluation import evaluate
from elvis.formats.reading import read

ROUNDS = 24
SECONDS_EACH = 10.0
XML_CASES = ["chan3d_tet", "prismhex_wss", "gen_pyr_curved", "quad4", "chan3dh1d", "naca_h1d_line", "scale_compressed"]
XML_CASES += ["triquad_h1d", "hex_chk", "line_1d", "gen_quadface_2d"]
HDF5_CASES = ["kova_varp", "gen_hex_xscale", "interptest_hdf5", "triquad_h5", "gen_allelem_var_h5"]
SUFFIXES = (".xml", ".fld", ".nekg", ".rst", ".chk")


def attempt(paths, what, seconds):
    """Read the files, and let nothing but an ElvisError of one sentence out."""
    start, message = time.process_time(), "read and evaluated"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            dataset = read(*paths)
        with np.errstate(all="ignore"):
            for patch in patches(dataset, [field.name for field in dataset.fields]):
                evaluate(patch.geometry, patch.geometry_coefficients, patch.shape.vertices / 3)
    except ElvisError as error:
        message = str(error)
    except Exception as error:
        raise AssertionError(f"{what}: {type(error).__name__}: {error}") from error
    assert "\n" not in message, what
    assert 10 < len(message) < 1000, what
    assert time.process_time() - start < seconds, what


@pytest.mark.parametrize("case", [*XML_CASES, *HDF5_CASES])
def test_damaged_files_are_read_or_rejected(case, nektar, tmp_path, slowness):
    files = sorted(path for path in (nektar / case).iterdir() if path.suffix in SUFFIXES)
    for seed in range(ROUNDS):
        for path in files:
            shutil.copyfile(path, tmp_path / path.name)
        target = tmp_path / files[seed % len(files)].name
        done = damage(target, np.random.default_rng([seed, len(case), *case.encode()]))
        given = [tmp_path / path.name for path in files if path.suffix != ".nekg"]
        attempt(given, f"{case}, {target.name}, round {seed}, {done}", slowness * SECONDS_EACH)
