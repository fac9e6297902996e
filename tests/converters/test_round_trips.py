"""Every reader and every writer: names of boundaries and regions, time and metadata arrive, or a note names them.

The sizes of boundaries are compared as numbers of sides, for meshes are the same.
"""

import re
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from small_files import SMALL_FILES, sections

from elvis import integrate, write
from elvis.core.data.mesh import PERIODIC
from elvis.core.shapes import Shape
from elvis.plugins import read
from elvis.plugins.conversion.exporting import exporter
from elvis.plugins.conversion.report import CONVERTED, REPORT

NATIVE_FORMS = ("compressed", "text", "hdf5")
#: names of regions that only tell shapes apart
SHAPES = {shape.label.lower() for shape in Shape}


@cache
def source(name):
    """The dataset of the small file of a reader."""
    made, package = SMALL_FILES[name]
    if package:
        pytest.importorskip(package)
    with TemporaryDirectory() as folder:
        return read(*made(Path(folder)), reader={"from": name}, cache=False)


def names_of(mesh):
    """Numbers of sides or elements by each name of a set."""
    return {word: sum(len(ids) for _, ids in parts) for word, parts in mesh.named_parts().items()}


def named(mesh):
    """The same, of names and labels alone."""
    numbers = {str(each.id) for each in mesh.composites}
    return {word: count for word, count in names_of(mesh).items() if word not in numbers and word != PERIODIC}


def own_metadata(dataset):
    return {key: text for key, text in dataset.metadata.items() if key not in (CONVERTED, REPORT, "Time")}


@pytest.mark.sampled
@pytest.mark.parametrize("form", NATIVE_FORMS)
@pytest.mark.parametrize("name", SMALL_FILES)
def test_native_files_are_lossless(name, form, tmp_path):
    before = source(name)
    paths = write(before, tmp_path / "b.xml", mesh_format=form, field_format="hdf5" if form == "hdf5" else "xml")
    after = read(*paths)
    assert named(before.mesh)
    assert named(after.mesh) == named(before.mesh)
    assert after.time == before.time
    assert own_metadata(after) == own_metadata(before)
    assert dict(after.session) == dict(before.session)
    if name == "native":
        assert {"inflow", "far field, & more", "out", "second half"} == named(after.mesh).keys()
        assert sections(paths[0]).keys() == {"CONDITIONS", "FORCING"}


@pytest.mark.sampled
@pytest.mark.parametrize("suffix", ["msh", "vtu"])
@pytest.mark.parametrize("name", SMALL_FILES)
def test_exports_name_what_they_omit(name, suffix, tmp_path):
    pytest.importorskip({"msh": "gmsh", "vtu": "vtkmodules"}[suffix])
    before, path = source(name), tmp_path / f"b.{suffix}"
    told = " ".join(exporter(suffix)(before, None, None, path, len))
    after = read(path, cache=False)
    found = named(after.mesh)
    for word, count in named(before.mesh).items():
        assert found.get(word) == count or word in told or word in SHAPES, word
    assert after.time == before.time or "time" in told
    assert all(key in told for key in (*own_metadata(before), *before.session))
    assert integrate(after, "1", "all").value == pytest.approx(integrate(before, "1", "all").value, rel=1e-12)


@pytest.mark.parametrize("name", ["gmf", "mfem", "ngsolve"])
def test_numbers_of_boundaries_match_those_of_the_source(name, tmp_path):
    """One region more moves no number; a number that several boundaries have names none of them."""
    made, package = SMALL_FILES[name]
    if package:
        pytest.importorskip(package)
    (path,) = made(tmp_path)
    if name == "mfem":
        path.write_text(path.read_text().replace("2 3 1 2 5 4", "5 3 1 2 5 4").replace("v1.3", "v1.0"))
        path.write_text(re.sub(r"\n(bdr_)?attribute_sets\n(.*\n)*?\n", "\n", path.read_text()))
    mesh = read(path, reader={"from": name}, cache=False).mesh
    wanted = {"gmf": {5: 1, 6: 2, 7: 1}, "mfem": {1: 2, 2: 1, 3: 2, 4: 1}, "ngsolve": {1: 1, 2: 1, 3: 1, 4: 1}}[name]
    assert {number: names_of(mesh)[str(number)] for number in wanted} == wanted
