"""MFEM: the library's own values are reproduced, for files of ours and for those that it writes in the test."""

from pathlib import Path

import numpy as np
import pytest
from source_blocks import where

from elvis import read, sample
from elvis.converters.mfem.mfem import Mfem, _numbered
from elvis.core.base.errors import FormatError
from elvis.core.integrals import integrate
from elvis.plugins.conversion.converting import Settings, convert
from elvis.plugins.testing import check, positions_at, values_at, values_found

mfem = pytest.importorskip("mfem.ser")

#: meshes that come with the library
MESHES = Path(mfem.__file__).parents[1] / "mfem" / "external" / "ser" / "data"

CASES = [
    ("fichera_mixed_p2", "uvw", True),
    ("escher_p3", "uvw", False),
    ("fichera_q3", "uvw", True),
    ("tinyzoo", "uvw", False),
    ("stream_laghos", "f", None),
]


def by_element(conversion, source, evaluate, elements, ref):
    blocks, rows = where(source, elements)
    found = None
    for block in np.unique(blocks):
        here = blocks == block
        values = evaluate(int(block), rows[here], ref[here])
        found = np.empty((len(ref), *values.shape[1:])) if found is None else found
        found[here] = values
    return found


def columns(own, names):
    for name in names:
        count = own.data[f"f_{name}"].shape[1]
        yield from ((name if count == 1 else f"{name}_{'xyz'[i]}", own.column(name, i)) for i in range(count))


@pytest.mark.parametrize(("name", "fields", "has_map"), CASES)
def test_agrees_with_the_library(solvers, truth, near, name, fields, has_map):
    folder = solvers / "mfem"
    files = [folder / f"{name}.mesh", *(folder / f"{name}.{field}.gf" for field in fields)]
    conversion, source, own = check(Mfem, files), Mfem(files), truth(folder / f"{name}.truth.npz")
    assert {measure.state for measure in (conversion.report.geometry, *conversion.report.fields)} == {"exact"}
    assert has_map is None or conversion.report.has_map is has_map
    near(by_element(conversion, source, lambda *at: positions_at(conversion, *at), own.elem, own.ref), own.xyz, 1e-12)
    for field, wanted in columns(own, fields):
        at = lambda *place, field=field: values_at(conversion, field, *place)  # noqa: E731
        near(by_element(conversion, source, at, own.elem, own.ref), wanted)
        near(own.found(conversion.dataset, field), wanted)


def test_rational_geometry_has_the_stated_error(solvers, truth, near):
    folder = solvers / "mfem"
    files = [folder / f"pipe_nurbs.{end}" for end in ("mesh", "u.gf", "w.gf")]
    conversion, source, own = check(Mfem, files), Mfem(files), truth(folder / "pipe_nurbs.truth.npz")
    places = by_element(conversion, source, lambda *at: positions_at(conversion, *at), own.elem, own.ref)
    announced = conversion.report.geometry.max
    assert np.linalg.norm(places - own.xyz, axis=1).max() <= 1.5 * announced < 2e-3
    for field in "uw":
        at = lambda *place, field=field: values_at(conversion, field, *place)  # noqa: E731
        near(by_element(conversion, source, at, own.elem, own.ref), own.column(field))
        (measure,) = (each for each in conversion.report.fields if each.name == field)
        off = np.abs(own.found(conversion.dataset, field) - own.column(field)).max()
        assert 1e-8 * measure.range < off <= 1.5 * measure.max


def function(mesh, collection, components=1, by_vector=False, seed=1):
    """A function with random coefficients, with what it needs to live."""
    space = mfem.FiniteElementSpace(mesh, collection, components, int(by_vector))
    made = mfem.GridFunction(space)
    if space.GetTrueVSize() == space.GetVSize():
        made.Assign(mfem.Vector(np.random.default_rng(seed).uniform(-1, 1, made.Size())))
    else:
        values = mfem.Vector(np.random.default_rng(seed).uniform(-1, 1, space.GetTrueVSize()))
        made.SetFromTrueDofs(values)
    return space, made


def save(folder, mesh, **functions):
    mesh.Save(str(folder / "case.mesh"), 17)
    for name, made in functions.items():
        made.Save(str(folder / f"case.{name}.gf"), 17)
    return [folder / "case.mesh", *(folder / f"case.{name}.gf" for name in functions)]


def agree(files, made, name, points=5, tolerance=1e-10):
    """Values of the library at random points of every element, by element; returns the conversion."""
    conversion, source = check(Mfem, files), Mfem(files)
    mesh, rng = made.FESpace().GetMesh(), np.random.default_rng(5)
    ref = rng.uniform(0.05, 0.3, (points, mesh.Dimension()))
    wanted = []
    for element in range(mesh.GetNE()):
        for point in ref.tolist():
            place = mfem.IntegrationPoint()
            place.Set3(*point, *(0.0,) * (3 - len(point)))
            wanted.append(made.GetValue(element, place))
    elements = np.repeat(np.arange(mesh.GetNE()), points)
    at = lambda *place: values_at(conversion, name, *place)  # noqa: E731
    found = by_element(conversion, source, at, elements, np.tile(ref, (mesh.GetNE(), 1)))
    assert np.abs(found - wanted).max() <= tolerance * np.ptp(wanted)
    return conversion


BASES = {"legendre": 0, "lobatto": 1, "positive": 2}


@pytest.mark.sampled(least=12)
@pytest.mark.parametrize("mesh", ["tinyzoo-3d", "star-mixed-p2", "inline-segment", "square-disc-p3", "toroid-wedge"])
@pytest.mark.parametrize(("family", "order"), [("H1", 1), ("H1", 3), ("H1Pos", 3), ("L2", 0), ("L2", 3)])
def test_spaces_of_every_shape(tmp_path, mesh, family, order):
    mesh = mfem.Mesh(str(MESHES / f"{mesh}.mesh"), 1, 0, False)
    kind = {"H1": mfem.H1_FECollection, "H1Pos": mfem.H1Pos_FECollection, "L2": mfem.L2_FECollection}[family]
    if family == "H1Pos" and mesh.Dimension() == 3 and mesh.GetNE() == 4:
        pytest.skip("the library has no positive functions on pyramids")
    collection = kind(order, mesh.Dimension())
    _, made = function(mesh, collection)
    conversion = agree(save(tmp_path, mesh, u=made), made, "u")
    assert conversion.report.fields[0].is_exact
    assert conversion.report.fields[0].is_continuous is (family != "L2")


@pytest.mark.parametrize("basis", BASES.values(), ids=BASES)
def test_bases_of_discontinuous_fields(tmp_path, basis):
    mesh = mfem.Mesh(str(MESHES / "escher-p2.mesh"), 1, 0, False)
    collection = mfem.L2_FECollection(2, 3, basis)
    _, made = function(mesh, collection)
    assert agree(save(tmp_path, mesh, u=made), made, "u").report.fields[0].is_exact


@pytest.mark.parametrize("by_vector", [False, True])
def test_vectors_in_both_orders(tmp_path, by_vector):
    mesh = mfem.Mesh(str(MESHES / "fichera-mixed-p2.mesh"), 1, 0, False)
    collection = mfem.H1_FECollection(2, 3)
    _, made = function(mesh, collection, 3, by_vector)
    conversion, source = check(Mfem, save(tmp_path, mesh, v=made)), Mfem(save(tmp_path, mesh, v=made))
    place = mfem.IntegrationPoint()
    place.Set3(0.2, 0.1, 0.3)
    for i, axis in enumerate("xyz"):
        at = lambda *place, axis=axis: values_at(conversion, f"v_{axis}", *place)  # noqa: E731
        found = by_element(conversion, source, at, np.arange(mesh.GetNE()), np.tile([0.2, 0.1, 0.3], (mesh.GetNE(), 1)))
        wanted = [made.GetValue(element, place, i + 1) for element in range(mesh.GetNE())]
        assert np.abs(found - wanted).max() < 1e-11


@pytest.mark.sampled
@pytest.mark.parametrize("family", ["RT", "ND"])
@pytest.mark.parametrize(("mesh", "is_exact"), [("escher", True), ("fichera", True), ("escher-p2", False)])
def test_vector_spaces_by_components(tmp_path, family, mesh, is_exact):
    mesh = mfem.Mesh(str(MESHES / f"{mesh}.mesh"), 1, 1)
    collection = mfem.RT_FECollection(1, 3) if family == "RT" else mfem.ND_FECollection(2, 3)
    _, made = function(mesh, collection)
    files = save(tmp_path, mesh, b=made)
    conversion, source = check(Mfem, files), Mfem(files)
    assert [measure.name for measure in conversion.report.fields] == ["b_x", "b_y", "b_z"]
    ref, count = np.array([0.2, 0.1, 0.3]), mesh.GetNE()
    place, value, wanted = mfem.IntegrationPoint(), mfem.Vector(), []
    place.Set3(*ref.tolist())
    for element in range(count):
        made.GetVectorValue(element, place, value)
        wanted.append(np.array(value.GetDataArray()))
    for i, measure in enumerate(conversion.report.fields):
        assert measure.is_exact is is_exact
        at = lambda *place, name=measure.name: values_at(conversion, name, *place)  # noqa: E731
        found = by_element(conversion, source, at, np.arange(count), np.tile(ref, (count, 1)))
        error = np.abs(found - np.array(wanted)[:, i]).max()
        assert error <= (1e-10 * measure.range if is_exact else 1.5 * measure.max)


@pytest.mark.parametrize("name", ["amr-hex", "amr-quad", "fichera-amr"])
def test_hanging_nodes_make_fields_discontinuous(tmp_path, name):
    mesh = mfem.Mesh(str(MESHES / f"{name}.mesh"), 1, 0, False)
    collection = mfem.H1_FECollection(2, mesh.Dimension())
    _, made = function(mesh, collection)
    files = save(tmp_path, mesh, u=made)
    assert not Mfem(files).is_conforming
    conversion = agree(files, made, "u")
    assert conversion.report.fields[0].is_exact
    assert not conversion.report.fields[0].is_continuous
    assert conversion.report.notes


@pytest.mark.parametrize("name", ["periodic-cube", "periodic-hexagon", "cube-nurbs", "beam-hex-nurbs", "klein-bottle"])
def test_other_meshes_of_the_library(name):
    conversion = check(Mfem, [MESHES / f"{name}.mesh"])
    assert conversion.report.geometry.is_exact


@pytest.mark.parametrize("name", ["star-q2", "square-nurbs"])
def test_numbers_may_follow_a_heading_on_its_line(tmp_path, name):
    text = (MESHES / f"{name}.mesh").read_text()
    path = tmp_path / "line.mesh"
    path.write_text(text.replace("dimension\n2\n", "dimension 2\n").replace("vertices\n", "vertices "))
    assert path.read_text() != text
    one, other = (integrate(read(each), "1")[0].value for each in (path, MESHES / f"{name}.mesh"))
    assert one == other > 0.5


def test_spaces_that_the_library_lacks_are_rejected(tmp_path):
    mesh = mfem.Mesh(str(MESHES / "ref-prism.mesh"), 1, 1)
    collection = mfem.H1Ser_FECollection(2, 3)
    space = mfem.FiniteElementSpace(mesh, collection)
    function = mfem.GridFunction(space)
    function.Assign(1.0)
    files = save(tmp_path, mesh, u=function)
    with pytest.raises(FormatError, match="as many functions as values, found 18 for 15 on element 0"):
        convert(Mfem(files))


@pytest.mark.parametrize("name", ["ball-nurbs", "disc-nurbs", "pipe-nurbs-2d"])
def test_rational_meshes_are_measured(name):
    report = check(Mfem, [MESHES / f"{name}.mesh"]).report
    assert not report.geometry.is_exact
    assert report.geometry.max < 2e-3 * report.geometry.range


def test_rational_fields_are_measured(tmp_path):
    mesh = mfem.Mesh(str(MESHES / "disc-nurbs.mesh"), 1, 0, False)
    made = mfem.GridFunction(mesh.GetNodes().FESpace())
    made.Assign(mfem.Vector(np.random.default_rng(2).uniform(-1, 1, made.Size())))
    measures = check(Mfem, save(tmp_path, mesh, d=made)).report.fields
    assert [measure.name for measure in measures] == ["d_x", "d_y"]
    assert all(0 < measure.max < 0.05 for measure in measures)


def test_names_of_attributes(tmp_path):
    conversion = convert(Mfem([MESHES / "compass.mesh"]))
    text = (MESHES / "compass.mesh").read_text()
    assert "attribute_sets" in text
    names = {composite.name for composite in conversion.dataset.mesh.composites}
    assert any(f'"{name}"' in text for name in names)
    conversion = convert(Mfem([MESHES / "beam-hex.mesh"]))
    names = {composite.name for composite in conversion.dataset.mesh.composites}
    assert {"attribute1", "attribute2", "boundary1", "boundary2", "boundary3"} <= names


def test_values_by_place_on_a_cube(tmp_path):
    mesh = mfem.Mesh(str(MESHES / "inline-hex.mesh"), 1, 0, False)
    collection = mfem.H1_FECollection(2, 3)
    space = mfem.FiniteElementSpace(mesh, collection)
    made = mfem.GridFunction(space)
    places = mfem.FiniteElementSpace(mesh, collection, 3)
    nodes = mfem.GridFunction(places)
    mesh.GetNodes(nodes)
    x = nodes.GetDataArray().reshape(3, -1)
    made.Assign(mfem.Vector(x[0] * x[1] - x[2] ** 2))
    conversion = check(Mfem, save(tmp_path, mesh, sol=made))
    points = np.random.default_rng(1).uniform(0, 1, (20, 3))
    found = values_found(conversion.dataset, "sol", points)
    assert np.abs(found - (points[:, 0] * points[:, 1] - points[:, 2] ** 2)).max() < 1e-12


def test_streams_print_nothing(solvers, capfd):
    Mfem([solvers / "mfem" / "escher_p3.mesh"])
    assert capfd.readouterr().out == ""


BAD = [
    ("mesh", "\n42\n", "\n43\n", "expected"),
    ("mesh", "\n1 4 ", "\n1 9 ", "expected an element, found unknown geometry 9"),
    ("mesh", "\n1 4 ", "\n1 4 4000 ", "expected"),
    ("mesh", "Cubic", "Cubist", "expected data that MFEM reads, found"),
    ("mesh", "vertices", "vertebrae", "expected a number of vertices, found none"),
    ("u.gf", "H1_3D_P5", "H7_3D_P5", "expected data that MFEM reads, found"),
    ("u.gf", "H1_3D_P5", "H1_3D_P4", "expected .* numbers, found"),
    ("u.gf", "-0.74224637729461129", "", "expected .* numbers, found"),
    ("u.gf", "-0.74224637729461129", "much", "expected numbers, found something else"),
]


@pytest.mark.parametrize(("which", "old", "new", "message"), BAD)
def test_bad_files_give_a_one_line_error(solvers, tmp_path, which, old, new, message):
    files = []
    for end in ("mesh", "u.gf"):
        text = (solvers / "mfem" / f"escher_p3.{end}").read_text()
        if end == which:
            assert old in text
            text = text.replace(old, new, 1)
        files.append(tmp_path / f"escher_p3.{end}")
        files[-1].write_text(text)
    with pytest.raises(FormatError, match=message) as caught:
        Mfem(files)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize("share", [0.02, 0.1, 0.2, 0.5, 0.99])
@pytest.mark.parametrize("name", ["escher_p3", "pipe_nurbs", "tinyzoo"])
def test_truncated_meshes_are_rejected(solvers, tmp_path, name, share):
    text = (solvers / "mfem" / f"{name}.mesh").read_text().rstrip()
    path = tmp_path / "cut.mesh"
    path.write_text(text[: int(share * len(text))].rsplit(maxsplit=1)[0])
    with pytest.raises(FormatError, match="expected"):
        Mfem([path])


def test_a_file_that_crashes_the_library_is_rejected(tmp_path):
    text = (MESHES / "fichera-amr.mesh").read_text()
    path = tmp_path / "bad.mesh"
    start = text.index("elements")
    path.write_text(text[:start] + text[start:].replace(" 5 0 ", " 5 0 99999", 3))
    with pytest.raises(FormatError, match="expected data that MFEM reads, found"):
        Mfem([path])


def test_files_that_do_not_belong_together(solvers, tmp_path):
    folder = solvers / "mfem"
    with pytest.raises(FormatError, match=r"expected \d+ numbers, found"):
        Mfem([folder / "escher_p3.mesh", folder / "tinyzoo.u.gf"])
    with pytest.raises(FormatError, match="expected also a mesh, found only grid functions"):
        Mfem([folder / "tinyzoo.u.gf"])


class Wave(mfem.PyCoefficient):
    """Something smooth."""

    def EvalValue(self, x):  # noqa: N802
        return np.sin(x[0] + 2 * x[1]) * (1 + x[-1])


class Interpolated:
    """Of that, the interpolant by continuous cubics, with all that it needs to live."""

    def __init__(self, mesh):
        self.mesh, self.wave, self.collection = mesh, Wave(), mfem.H1_FECollection(3, mesh.Dimension())
        self.space = mfem.FiniteElementSpace(mesh, self.collection)
        self.made = mfem.GridFunction(self.space)
        self.made.ProjectCoefficient(self.wave)


def parted(folder, mesh, count):
    """Pieces of a mesh in the form for parallel runs, as the library writes them, each with its own interpolant."""
    partitioner = mfem.MeshPartitioner(mesh, count, mesh.CartesianPartitioning([count] + [1] * (mesh.Dimension() - 1)))
    for number in range(count):
        part = mfem.MeshPart()
        partitioner.ExtractPart(number, part)
        path = folder / f"mesh.{number:06d}"
        part.Print(str(path))
        own = Interpolated(mfem.Mesh(str(path), 1, 0, False))
        own.made.Save(str(folder / f"u.{number:06d}"), 17)


def cut(folder, mesh, count):
    """Pieces of a mesh in the form for one process, shared faces among the borders, with a part of the interpolant."""
    for element in range(mesh.GetNE()):
        mesh.SetAttribute(element, 1 + element % count)
    mesh.SetAttributes()
    whole = Interpolated(mesh)
    for number in range(count):
        part = mfem.SubMesh.CreateFromDomain(mesh, mfem.intArray([number + 1]))
        space = mfem.FiniteElementSpace(part, whole.collection)
        own = mfem.GridFunction(space)
        mfem.SubMesh.Transfer(whole.made, own)
        part.Save(str(folder / f"mesh.{number:06d}"), 17)
        own.Save(str(folder / f"u.{number:06d}"), 17)


@pytest.mark.sampled
@pytest.mark.parametrize("form", [parted, cut])
@pytest.mark.parametrize("name", ["fichera-mixed-p2", "escher-p2", "star-mixed-p2", "inline-hex"])
def test_parts_of_parallel_runs_are_joined(tmp_path, near, form, name):
    mesh = mfem.Mesh(str(MESHES / f"{name}.mesh"), 1, 0, False)
    form(tmp_path, mesh, 2)
    conversion = check(Mfem, [tmp_path / "mesh.000000", tmp_path / "u.000001"])
    (measure,) = conversion.report.fields
    assert measure.is_exact
    assert measure.is_continuous
    assert sum(conversion.report.elements.values()) == mesh.GetNE()
    own = Interpolated(mesh)
    whole = convert(Mfem(save(tmp_path, mesh, u=own.made))).dataset
    points = inner(conversion)
    found, wanted = (values_found(each, "u", points) for each in (conversion.dataset, whole))
    near(found, wanted, 1e-12 if form is cut else 1e-10)
    sizes = [_border_size(each) for each in (conversion.dataset, whole)]
    assert sizes[0] == sizes[1]


def inner(conversion):
    """A point in every element."""
    blocks = enumerate(conversion.blocks)
    places = ((i, np.arange(len(b)), np.full((len(b), b.shape.dimension), 0.22)) for i, b in blocks)
    return np.concatenate([positions_at(conversion, *each) for each in places])


def _border_size(dataset):
    domain = set(dataset.mesh.domains[0])
    return sum(len(ids) for c in dataset.mesh.composites if c.id not in domain for _, ids in c.parts)


def test_missing_pieces_are_named(tmp_path):
    mesh = mfem.Mesh(str(MESHES / "inline-hex.mesh"), 1, 0, False)
    parted(tmp_path, mesh, 3)
    (tmp_path / "u.000002").unlink()
    with pytest.raises(FormatError, match="expected a piece of u for every piece of the mesh, found 2 of the 3"):
        Mfem([tmp_path / "mesh.000000", tmp_path / "u.000000"])
    (tmp_path / "mesh.000002").unlink()
    with pytest.raises(FormatError, match="expected the pieces of processes 0 to 2, found 0, 1"):
        Mfem([tmp_path / "mesh.000000"])


def stream(solvers, name, field):
    return "".join((solvers / "mfem" / f"{name}.{end}").read_text() for end in ("mesh", f"{field}.gf"))


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "field"), [("stream_laghos", "f"), ("escher_p3", "v"), ("pipe_nurbs", "u")])
def test_streams_contain_the_same_as_files(solvers, tmp_path, name, field):
    path = tmp_path / "case.saved"
    path.write_text(f"solution\n{stream(solvers, name, field)}keys RRj\nwindow_title 'case'\n")
    assert Mfem.opens([path])
    settings = Settings(order=1, geometry="curves")
    found = convert(Mfem([path]), settings)
    whole = [solvers / "mfem" / f"{name}.{suffix}" for suffix in ("mesh", f"{field}.gf")]
    wanted = convert(Mfem(whole), settings)
    assert np.array_equal(found.dataset.mesh.vertices, wanted.dataset.mesh.vertices)
    for one, other in zip(found.dataset.fields, wanted.dataset.fields, strict=True):
        assert one.name == other.name.replace(field, "solution", 1)
        for mine, its in zip(one.blocks, other.blocks, strict=True):
            assert np.array_equal(mine.coefficients, its.coefficients)


def test_streams_of_several_processes(solvers, tmp_path):
    mesh = mfem.Mesh(str(MESHES / "fichera-mixed-p2.mesh"), 1, 0, False)
    cut(tmp_path, mesh, 2)
    texts = [
        f"parallel 2 {n}\nsolution\n" + "".join((tmp_path / f"{what}.{n:06d}").read_text() for what in ("mesh", "u"))
        for n in range(2)
    ]
    path = tmp_path / "case.saved"
    path.write_text("".join(texts))
    report = check(Mfem, [path]).report
    assert [measure.is_continuous for measure in report.fields] == [True]
    assert sum(report.elements.values()) == mesh.GetNE()
    path.write_text(texts[1])
    with pytest.raises(FormatError, match="expected the pieces of 2 processes, found those of 1"):
        Mfem([path])


def test_the_last_of_several_streams_counts(solvers, tmp_path):
    first, second = (stream(solvers, name, "u") for name in ("escher_p3", "tinyzoo"))
    path = tmp_path / "case.saved"
    path.write_text(f"solution\n{first}solution\n{second}")
    assert sum(map(len, Mfem([path]).blocks)) == 4
    path.write_text("mesh\n" + (solvers / "mfem" / "pipe_nurbs.mesh").read_text())
    assert not Mfem([path]).fields


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("FiniteElementSpace\n", "ComplexGridFunction\nFiniteElementSpace\n", "real and imaginary parts, found 119"),
        ("solution\n", "parallel 1 0\n", "expected a mesh and a function, found 'parallel 1 0'"),
        ("FiniteElementCollection: H1_3D_P3", "FiniteElementCollection: H1_3D_P2", "expected .* numbers, found"),
        ("Ordering: 0", "", "expected the description of a space, found none that ends"),
    ],
)  # fmt: skip
def test_bad_streams_give_a_one_line_error(solvers, tmp_path, old, new, message):
    text = "solution\n" + stream(solvers, "tinyzoo", "u")
    assert old in text
    path = tmp_path / "case.saved"
    path.write_text(text.replace(old, new, 1))
    assert Mfem.opens([path])
    with pytest.raises(FormatError, match=message) as caught:
        Mfem([path])
    assert str(path) in str(caught.value)


def saved(folder, mesh, name, function):
    """The files of a mesh and of a function."""
    mesh.Print(str(folder / "m.mesh"), 17)
    function.Save(str(folder / name), 17)
    return [folder / "m.mesh", folder / name]


def check_stream(word, paths):
    """Check that a stream of a mesh and a function has the fields of their files, but for the names."""
    stream = paths[0].parent / "case.saved"
    stream.write_text(f"{word}\n" + "".join(path.read_text() for path in paths) + "keys RRj\n")
    assert Mfem.opens([stream])
    found, wanted = (convert(Mfem(of)).dataset.fields for of in ([stream], paths))
    assert {field.name.rpartition("_")[0] for field in found} == {"solution"}
    for mine, its in zip(found, wanted, strict=True):
        assert mine.name.rpartition("_")[2] == its.name.rpartition("_")[2]
        for one, other in zip(mine.blocks, its.blocks, strict=True):
            assert np.array_equal(one.coefficients, other.coefficients)


def test_complex_functions_are_two_fields(tmp_path):
    mesh = mfem.Mesh(2, 2, "QUADRILATERAL")
    collection = mfem.H1_FECollection(2, 2)
    space = mfem.FiniteElementSpace(mesh, collection)
    function = mfem.ComplexGridFunction(space)
    places = np.array([[0.5 * (i % 3), 0.5 * (i // 3)] for i in range(9)])
    size = space.GetVSize()
    data = np.zeros(2 * size)
    data[:size], data[size:] = 3.0, -2.0
    data[: len(places)] += places[:, 0]
    function.Assign(mfem.Vector(data))
    paths = saved(tmp_path, mesh, "m.wave.gf", function)
    dataset = check(Mfem, paths).dataset
    assert [field.name for field in dataset.fields] == ["wave_re", "wave_im"]
    real = mfem.GridFunction(space)
    real.Assign(mfem.Vector(data[:size]))
    real.Save(str(tmp_path / "m.real.gf"), 17)
    alone = convert(Mfem([paths[0], tmp_path / "m.real.gf"])).dataset
    for one, other in zip(dataset.fields[0].blocks, alone.fields[0].blocks, strict=True):
        assert np.array_equal(one.coefficients, other.coefficients)
    assert integrate(dataset, "wave_im")[0].value == pytest.approx(-2, rel=1e-12)
    check_stream("solution", paths)


@pytest.mark.parametrize(("kind", "order"), [("QUADRILATERAL", 3), ("TRIANGLE", 2), ("TRIANGLE", 5)])
def test_functions_at_quadrature_points(tmp_path, kind, order):
    """At the points of the rule the values are those of the file; x + 2 y arrives as it is."""
    mesh = mfem.Mesh(2, 1, kind)
    space = mfem.QuadratureSpace(mesh, order)
    values, places = [], []
    for element in range(mesh.GetNE()):
        rule, move = space.GetIntRule(element), mesh.GetElementTransformation(element)
        for i in range(rule.GetNPoints()):
            place = np.array(move.Transform(rule.IntPoint(i)))[:2]
            places.append(place)
            values += [place[0] + 2 * place[1], np.cos(9 * place[0]) * place[1]]
    function = mfem.QuadratureFunction(space, 2)
    function.Assign(mfem.Vector(values))
    paths = saved(tmp_path, mesh, "m.q.qf", function)
    dataset = check(Mfem, paths).dataset
    first, second = (field.name for field in dataset.fields)
    assert integrate(dataset, first)[0].value == pytest.approx(1.5, rel=1e-12)
    found = sample(dataset, second, np.array(places))[second]
    assert np.allclose(found, values[1::2], rtol=0, atol=1e-12)
    check_stream("quadrature", paths)
    (tmp_path / "m.q.qf").write_text((tmp_path / "m.q.qf").read_text().rsplit(maxsplit=1)[0])
    with pytest.raises(FormatError, match=r"m\.q\.qf: values: expected \d+ numbers, found"):
        Mfem(paths)


def test_vertices_of_several_parts_are_numbered_together():
    places = [
        np.array([[0.0, 0.0], [1.0, 0.0]]),
        np.array([[1.0, 0.0], [2.0, 0.0]]),
        np.array([[5.0, 0.0], [0.0, 0.0]]),
    ]
    one, two, three = _numbered(places)
    assert one[1] == two[0]
    assert one[0] == three[1]
    assert len({*one, *two, *three}) == 4


def test_files_are_joined_if_all_are_pieces_or_functions_of_different_spaces(tmp_path):
    names = {}
    for name, space in {"a.gf": "H1_2D_P2", "b.gf": "H1_2D_P2", "c.gf": "L2_2D_P1"}.items():
        text = f"FiniteElementSpace\nFiniteElementCollection: {space}\nVDim: 1\nOrdering: 0\n\n0\n"
        names[name] = tmp_path / name
        names[name].write_text(text)
    pieces = [tmp_path / f"box.{number:06d}" for number in range(2)]
    for piece in pieces:
        piece.write_text("MFEM mesh v1.0\n")
    assert Mfem.joins(pieces)
    assert not Mfem.joins([pieces[0], names["a.gf"]])
    assert Mfem.joins([names["a.gf"], names["c.gf"]])
    assert not Mfem.joins([names["a.gf"], names["b.gf"]])
