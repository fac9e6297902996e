"""``elvis convert``: options, reports, refusals."""

import gzip
import json
import re
from pathlib import Path

import click
import numpy as np
import pytest

from elvis import ElvisError, FormatError, read
from elvis.core.polynomials.quadrature import gll
from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.plugins.command.registry import PluginError
from elvis.plugins.conversion.discovery import Candidate, choose_converter, in_file, installed_converters
from elvis.plugins.conversion.nodal import tensor_nodes
from elvis.plugins.testing import check, values_found

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "howto" / "converter.md"


@pytest.fixture
def pyfr(solvers):
    return solvers / "pyfr" / "mixed3d_p3-01.pyfrs"


@pytest.fixture
def plugin(tmp_path):
    """The converter of the page, as a file."""
    (source,) = [
        text for text in re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.M | re.S) if "(Converter)" in text
    ]
    assert source.count("\n") < 60
    path = tmp_path / "my_solver.py"
    path.write_text(source)
    return path


@pytest.fixture
def case(tmp_path):
    """A file of the solver that the page speaks of: eight curved hexahedra of order 3."""
    from elvis.core.mapping.orientation import local_vertices

    mesh = grid(Shape.HEXAHEDRON, 2)
    corners = local_vertices(mesh, Shape.HEXAHEDRON)
    t = (1 + tensor_nodes(Shape.HEXAHEDRON, tuple(gll(4)[0].tolist()))) / 2
    weights = [
        np.prod([t[:, i] if v > 0 else 1 - t[:, i] for i, v in enumerate(c)], axis=0) for c in Shape.HEXAHEDRON.vertices
    ]
    places = np.einsum("vn,evc->enc", weights, mesh.vertices[corners])
    nodes = places + 0.05 * np.stack(
        [places[..., 1] ** 3, places[..., 2] * places[..., 0], places[..., 0] ** 2], axis=-1
    )
    wall = np.array([[0, 1, 4, 3]])
    path = tmp_path / "case.npz"
    np.savez(path, nodes=nodes, corners=corners, wall=wall, time=2.5, value_p=(places**2).sum(axis=-1))
    return path


def test_the_converter_of_the_page_works(plugin, case):
    (candidate,) = in_file(plugin)
    conversion = check(candidate.converter, [case])
    assert {measure.state for measure in (conversion.report.geometry, *conversion.report.fields)} == {"exact"}
    assert conversion.dataset.time == 2.5
    assert [(c.name, len(c.parts[0][1])) for c in conversion.dataset.mesh.composites][1:] == [
        ("wall", 1),
        ("boundary", 23),
    ]


def test_a_converter_is_used_from_a_file(elvis, plugin, case, tmp_path):
    said = elvis("convert", case, "-o", tmp_path / "out.xml", "--plugin", plugin)
    assert "8 hexahedron" in said
    dataset = read(tmp_path / "out.xml", tmp_path / "out.fld")
    assert values_found(dataset, "p", np.array([[0.0, 0.0, 0.0]])) == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize("kind", ["compressed", "text", "hdf5"])
def test_every_format_contains_the_same(elvis, pyfr, tmp_path, truth, near, kind):
    elvis("convert", pyfr, "-o", tmp_path / "out.xml", "--format", kind)
    assert (tmp_path / "out.nekg").exists() is (kind == "hdf5")
    dataset = read(tmp_path / "out.xml", tmp_path / "out.fld")
    own = truth(pyfr.with_suffix(".truth.npz"))
    near(own.found(dataset, "rho"), own.column("soln", 0))


def test_the_report_is_json(elvis_json, pyfr, tmp_path):
    facts = elvis_json("convert", pyfr, "-o", tmp_path / "out.xml")
    assert facts["geometry"]["state"] == "exact"
    assert facts["geometry"]["map"] == "fields"
    assert list(facts["fields"]) == ["rho", "rhou", "rhov", "rhow", "E"]
    for measure in (facts["geometry"], *facts["fields"].values()):
        assert {"max", "L2", "exact", "relative", "element"} <= measure.keys()
    stored = json.loads(read(tmp_path / "out.xml", tmp_path / "out.fld").metadata["ConversionReport"])
    assert stored["fields"] == facts["fields"]


def test_an_error_beyond_the_tolerance_fails_and_writes_nothing(elvis, pyfr, tmp_path):
    with pytest.raises(ElvisError, match="expected errors up to 1e-06, found"):
        elvis("convert", pyfr, "-o", tmp_path / "out.xml", "--order", 1, "--max-error", 1e-6)
    assert not list(tmp_path.iterdir())
    elvis("convert", pyfr, "-o", tmp_path / "out.xml", "--max-error", 1e-10)


def test_fields_and_order_are_chosen(elvis_json, pyfr, tmp_path):
    facts = elvis_json("convert", pyfr, "-o", tmp_path / "out.xml", "--fields", "rho,E", "--tolerance", "0.05")
    assert list(facts["fields"]) == ["rho", "E"]
    assert max(measure["relative"] for measure in facts["fields"].values()) <= 0.05


def test_options_of_converters_are_options_of_the_command(elvis_json, elvis, pyfr, tmp_path):
    facts = elvis_json("convert", pyfr, "-o", tmp_path / "out.xml", "--primitive")
    assert "p" in facts["fields"]
    assert "--primitive" in elvis("convert", "--help")
    state = pyfr.parents[1] / "hopr_flexi" / "convcurved_N4_State.h5"
    with pytest.raises(ElvisError, match="Hopr has no option 'primitive'"):
        elvis("convert", state, "-o", tmp_path / "out.xml", "--primitive")


def test_the_list_contains_all_converters(elvis):
    said = elvis("convert", "--list")
    for candidate in installed_converters():
        assert candidate.converter, candidate.fault
        assert candidate.name in said
        assert candidate.converter.format
        assert candidate.converter.keeps


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "expected FILES to convert"),
        (["absent.msh", "-o", "out.xml"], "absent.msh: there is no such file"),
        (["{text}", "-o", "{out}.xml"], "expected a file of a known format"),
        (["{text}", "-o", "{out}.xml", "--from", "nobody"], "there is no converter 'nobody'; there are"),
        (["{text}", "-o", "{out}.png"], "expected a name ending in .xml"),
        (["{text}", "-o", "{out}.xml", "--set", "nodes"], "expected NAME=VALUE"),
        (["{text}", "-o", "{out}.xml", "--plugin", "{text}"], "expected a Python file, found none"),
    ],
)
def test_failures_give_one_line_errors(elvis, tmp_path, arguments, sentence):
    (tmp_path / "notes.txt").write_text("nothing\n")
    given = [a.format(text=tmp_path / "notes.txt", out=tmp_path / "out") for a in arguments]
    with pytest.raises((ElvisError, click.UsageError)) as caught:
        elvis("convert", *given)
    message = caught.value.message if isinstance(caught.value, click.UsageError) else str(caught.value)
    assert sentence in message
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(("given", "written"), [(None, "dealii_shell_p4"), ("shell", "shell"), ("a.xml", "a")])
def test_names_of_outputs(solvers, elvis, tmp_path, monkeypatch, given, written):
    monkeypatch.chdir(tmp_path)
    elvis("convert", solvers / "vtk" / "dealii_shell_p4.vtu", *(["-o", given] if given else []))
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"{written}.fld", f"{written}.xml"]
    if given is None:
        with pytest.raises(ElvisError, match=r"dealii_shell_p4\.xml: not written: it is an input"):
            elvis("convert", "dealii_shell_p4.xml", "dealii_shell_p4.fld")


def test_a_missing_library_is_named_with_the_package_that_provides_it(case, plugin):
    (candidate,) = in_file(plugin)
    candidate.converter.needs = ("no_such_library",)
    assert candidate.missing == ("no_such_library",)
    with pytest.raises(ElvisError, match="needs no_such_library, which is not installed; pip install no_such_library"):
        choose_converter([candidate], [case])
    own = type("Own", (candidate.converter,), {"__module__": "elvis.converters.own"})
    with pytest.raises(ElvisError, match=r"the converter mfem needs .*; pip install 'elvis-viz\[mfem\]' installs it"):
        choose_converter([Candidate("mfem", own)], [case])


def test_every_library_belongs_to_the_extra_of_its_converter():
    text = (ROOT / "pyproject.toml").read_text()
    for candidate in installed_converters():
        for need in candidate.converter.needs:
            assert re.search(rf'^{candidate.name} = \[.*"{need}[>=]', text, re.M)


def test_several_matching_converters_require_a_choice(case, plugin):
    (candidate,) = in_file(plugin)
    both = [Candidate("one", candidate.converter), Candidate("two", candidate.converter)]
    with pytest.raises(ElvisError, match="one and two can open them; choose one with --from"):
        choose_converter(both, [case])
    assert choose_converter(both, [case], "two").name == "two"


@pytest.mark.parametrize(
    ("source", "sentence"),
    [("import nothing_like_this", "does not load: ModuleNotFoundError"), ("x = 1", "expected a subclass of")],
)
def test_files_without_a_converter_are_reported(tmp_path, source, sentence):
    path = tmp_path / "broken.py"
    path.write_text(source)
    with pytest.raises(PluginError, match=sentence):
        in_file(path)


def test_the_kit_finds_a_converter_that_ignores_pieces(plugin, case):
    (candidate,) = in_file(plugin)

    class Careless(candidate.converter):
        def positions(self, block, points):
            return np.einsum("pn,eni->epi", self.basis.at(points), self.nodes[: len(block)])

    with pytest.raises(AssertionError, match=r"is block\.rows used"):
        check(Careless, [case])


def test_mismatched_nodes_are_reported(plugin, case):
    (candidate,) = in_file(plugin)
    np.savez(case, nodes=np.zeros((2, 7, 3)), corners=np.zeros((2, 8), int), wall=np.zeros((0, 4), int), time=0.0)
    with pytest.raises(FormatError, match=r"expected nodes \(n, \(p\+1\)\^3, 3\), found \(2, 7, 3\)"):
        candidate.converter([case])


@pytest.fixture
def native(tmp_path):
    """The mesh and the field of a small native case, in a folder of their own, with links to the mesh."""
    from dataclasses import replace

    from elvis import Dataset, write
    from elvis.core.testing import approximated

    bare = Dataset(grid(Shape.QUADRILATERAL, 2))
    folder = tmp_path / "native"
    folder.mkdir()
    write(replace(bare, fields=(approximated(bare, "u", lambda x: x[:, 0], 3),)), folder / "m.xml", mesh_format="hdf5")
    (folder / "soft.xml").symlink_to("m.xml")
    (folder / "hard.xml").hardlink_to(folder / "m.xml")
    return folder


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("name", ["m.xml", "soft.xml", "hard.xml", "../native/m.xml"])
def test_inputs_are_not_overwritten(elvis, native, name):
    before = contents(native)
    with pytest.raises(ElvisError, match=r"not written: it is (an|the) input.*--overwrite"):
        elvis("convert", native / "m.xml", native / "m.fld", "-o", native / name)
    assert contents(native) == before


def test_inputs_are_overwritten_on_request(elvis, native):
    elvis("convert", native / "m.xml", native / "m.fld", "-o", native / "m.xml", "--format", "text", "--overwrite")
    assert not (native / "m.nekg").exists()
    assert [field.name for field in read(native / "m.xml", native / "m.fld").fields] == ["u"]


@pytest.mark.parametrize("name", ["m.xml", "m.xml.gz"])
def test_the_hdf5_file_of_a_mesh_is_also_an_input(elvis, native, tmp_path, monkeypatch, name):
    """It may lie in the working folder, where a new file of that name would go."""
    (native / "m.xml.gz").write_bytes(gzip.compress((native / "m.xml").read_bytes()))
    (native / "m.nekg").rename(tmp_path / "m.nekg")
    (tmp_path / "m.xml").write_text("of something else")
    monkeypatch.chdir(tmp_path)
    before = (tmp_path / "m.nekg").read_bytes()
    with pytest.raises(ElvisError, match=r"m\.nekg: not written: it is an input"):
        elvis("convert", native / name, "-o", "m.xml", "--format", "hdf5")
    assert (tmp_path / "m.nekg").read_bytes() == before


def test_fields_of_an_earlier_mesh_are_removed_with_it(elvis, native, tmp_path):
    elvis("convert", native / "m.xml", native / "m.fld", "-o", tmp_path / "out.xml")
    before = {name: (tmp_path / name).read_bytes() for name in ("out.xml", "out.fld")}
    with pytest.raises(ElvisError, match=r"out\.fld: it belongs to the existing out\.xml, .*--overwrite"):
        elvis("convert", native / "m.xml", "-o", tmp_path / "out.xml")
    assert {name: (tmp_path / name).read_bytes() for name in before} == before
    elvis("convert", native / "m.xml", "-o", tmp_path / "out.xml", "--overwrite")
    assert not (tmp_path / "out.fld").exists()
    assert (tmp_path / "out.xml").exists()


@pytest.mark.parametrize("kind", ["compressed", "hdf5"])
def test_unnamed_files_are_not_overwritten(elvis, native, tmp_path, kind):
    """A file of fields, or of HDF5 data, of which the mesh isn't there belongs to something else."""
    (tmp_path / "out.fld").write_text("a restart")
    (tmp_path / "out.nekg").write_text("data")
    with pytest.raises(ElvisError, match=r"out\.fld: not written: it exists without out\.xml"):
        elvis("convert", native / "m.xml", native / "m.fld", "-o", tmp_path / "out.xml", "--format", kind)
    (tmp_path / "out.fld").unlink()
    if kind == "hdf5":
        with pytest.raises(ElvisError, match=r"out\.nekg: not written: it exists without out\.xml"):
            elvis("convert", native / "m.xml", native / "m.fld", "-o", tmp_path / "out.xml", "--format", kind)
    else:
        elvis("convert", native / "m.xml", native / "m.fld", "-o", tmp_path / "out.xml", "--overwrite")
    assert (tmp_path / "out.nekg").read_text() == "data"


@pytest.mark.parametrize("suffix", ["vtu", "msh"])
def test_an_export_does_not_overwrite_its_input(elvis, native, suffix):
    link = native / f"out.{suffix}"
    link.symlink_to("m.xml")
    before = contents(native)
    with pytest.raises(ElvisError, match=r"not written: it is the input .*m\.xml"):
        elvis("export", native / "m.xml", "-o", link)
    assert contents(native) == before
