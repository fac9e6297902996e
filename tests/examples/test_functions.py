"""Each public function has an example in its docstring, and what the example shows is what the function returns."""

import doctest
import inspect
from importlib.util import find_spec

import numpy as np
import pytest
from click.testing import CliRunner

import elvis

FUNCTIONS = sorted(name for name in elvis.__all__ if inspect.isfunction(getattr(elvis, name)))
#: libraries that examples with these names need
LIBRARIES = ("mfem", "netgen", "meshio", "pyvista", "xarray")
NEEDED = {"to_meshio": "meshio", "to_pyvista": "pyvista", "to_xarray": "xarray", "view": "anywidget"}
#: examples on data that no sample contains, and those that open a window
SHOWN = {"draw", "wall_points"}
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    """A folder with the samples that the examples read."""
    from elvis.plugins.command.command import elvis as group

    folder = tmp_path_factory.mktemp("samples")
    for name in ("wing", "wave"):
        assert CliRunner().invoke(group, ["sample", name, "-o", str(folder)]).exit_code == 0
    return folder


@pytest.mark.parametrize("name", FUNCTIONS)
def test_examples_show_results(name, samples, monkeypatch):
    monkeypatch.chdir(samples)
    function = inspect.unwrap(getattr(elvis, name))
    test = doctest.DocTestParser().get_doctest(inspect.getdoc(function), {"elvis": elvis, "np": np}, name, None, 0)
    assert test.examples, f"{name} has no example"
    is_shown = any(doctest.SKIP in example.options for example in test.examples)
    assert is_shown == (name in SHOWN)
    needed = NEEDED.get(name) or next((each for each in LIBRARIES if f"import {each}" in test.docstring), None)
    if "netgen" in test.docstring:
        needed = "netgen"
    if needed and find_spec(needed) is None:
        pytest.skip(f"needs {needed}")
    told = []
    doctest.DocTestRunner(optionflags=OPTIONS).run(test, out=told.append)
    assert not told, "".join(told)
