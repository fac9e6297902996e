"""What drawing alone needs is missed by drawing alone: all else works where slangpy is not installed, or is too old."""

import json
import subprocess
import sys

import pytest

from elvis import DeviceError
from elvis.renderer.device import drawing

POINTS = ("--line", "0.4,0.5,0.4:0.5,0.5,0.4", "-n", "2")
#: a process in which a module can't be imported; runs commands, prints the status and the words of each
WITHOUT = """
import contextlib, io, json, sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in %r:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Absent())
import elvis.core, elvis.formats, elvis.renderer
from elvis.plugins.command.command import main

found = []
for command in json.loads(sys.argv[1]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main(command)
            status = 0
        except SystemExit as ended:
            status = ended.code or 0
    found.append((status, out.getvalue(), err.getvalue()))
assert not set(%r) & set(sys.modules)
print(json.dumps(found))
"""


def without(modules, commands, folder):
    """(status, standard output, standard error) of commands in a process that lacks modules."""
    code = WITHOUT % (modules, modules)
    words = json.dumps([[str(word) for word in command] for command in commands])
    process = subprocess.run([sys.executable, "-c", code, words], capture_output=True, text=True, cwd=folder)
    assert process.returncode == 0, process.stderr
    return json.loads(process.stdout)


def test_all_but_drawing_works_without_slangpy(shared_files, tmp_path):
    """So do libraries that only some quantities, files and figures need."""
    data = shared_files("gen_allelem_n4")
    commands = [
        ("info", *data),
        ("norms", *data),
        ("probe", *data, *POINTS),
        ("convert", *data, "-o", "copy.xml"),
        ("devices",),
        ("plugins",),
        ("render", *data, "--size", "20x20", "--plane", "0.5,0.5,0.4:0.1,0.2,1", "--device", "reference"),
        ("render", *data, "--size", "20x20", "--plane", "0.5,0.5,0.4:0.1,0.2,1"),
    ]
    modules = ("slangpy", "scipy", "igl", "trimesh", "matplotlib", "vtkmodules", "gmsh", "mfem", "ngsolve")
    *work, drawn = without(modules, commands, tmp_path)
    assert [status for status, _, _ in work] == [0] * len(work), work
    assert (tmp_path / "copy.xml").is_file()
    assert "reference" in work[4][1]
    status, _, words = drawn
    assert status == 1
    for part in ("drawing needs slangpy 0.42 or later, which is not installed", "elvis-viz[draw]", "glibc 2.34"):
        assert part in words
        assert part in work[4][2]


def test_a_distance_names_its_requirement(shared_files, tmp_path):
    data = shared_files("gen_allelem_n4")
    ((status, _, words),) = without(("igl",), [("probe", *data, *POINTS, "--field", "distance(all)")], tmp_path)
    assert status == 1
    assert "pip install 'elvis-viz[distances]' installs it" in words


@pytest.mark.parametrize("version", ["0.30.0", "0.41.2", "0.9"])
def test_an_old_slangpy_is_reported(monkeypatch, version):
    monkeypatch.setattr(drawing, "version", lambda name: version)
    drawing._slangpy.cache_clear()
    try:
        with pytest.raises(DeviceError, match=rf"drawing needs slangpy 0\.42 or later, and {version} is installed"):
            drawing.slangpy_module()
    finally:
        drawing._slangpy.cache_clear()


@pytest.mark.parametrize("version", ["0.42", "0.42.0", "0.43.1", "1.0", "0.100.dev3"])
def test_a_new_slangpy_is_taken(monkeypatch, version):
    monkeypatch.setattr(drawing, "version", lambda name: version)
    drawing._slangpy.cache_clear()
    assert drawing.slangpy_module().__name__ == "slangpy"
    drawing._slangpy.cache_clear()
