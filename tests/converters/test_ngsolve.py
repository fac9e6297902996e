"""NGSolve: the library's own values are reproduced, from stored samples and from those exported in the test."""

import gzip
import shutil

import numpy as np
import pytest

from elvis import from_ngsolve, sample
from elvis.converters.ngsolve.export import _rule, export
from elvis.converters.ngsolve.ngsolve import NGSolve
from elvis.converters.shared.unit import UNIT
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.integrals import integrate
from elvis.core.shapes import Shape
from elvis.plugins.conversion.converting import convert
from elvis.plugins.conversion.nodal import NodalBasis, native_points
from elvis.plugins.conversion.plugin import PyramidSpace
from elvis.plugins.projection.checking import check_points
from elvis.plugins.testing import check, values_found

ngsolve = pytest.importorskip("ngsolve")

CASES = [
    ("ballbox_p4", "tet", Shape.TETRAHEDRON, {"u": True, "v": True, "w": False}),
    ("hexprism_p3_hex", "hex", Shape.HEXAHEDRON, {"u": True, "w": False}),
    ("hexprism_p3_prism", "prism", Shape.PRISM, {"u": True, "w": False}),
]


@pytest.mark.parametrize(("name", "label", "shape", "fields"), CASES)
def test_agrees_with_the_library(solvers, truth, near, name, label, shape, fields):
    folder = solvers / "ngsolve"
    conversion = check(NGSolve, [folder / f"{name}.elems.npz"])
    report = conversion.report
    assert all(measure.is_exact for measure in (report.geometry, *report.fields))
    assert {measure.name[0]: measure.is_continuous for measure in report.fields} == fields
    own = truth(folder / f"{name}.truth.npz")
    places = lambda block, ref: native_points(shape, UNIT[shape].frame, ref)  # noqa: E731
    near(own.positions_at(conversion, {label: 0}, places), own.xyz, 1e-11)
    for measure in report.fields:
        wanted = own.column(measure.name[0], "xyz".index(measure.name[2]) if len(measure.name) > 1 else 0)
        near(own.at(conversion, measure.name, {label: 0}, places), wanted)
        near(own.found(conversion.dataset, measure.name), wanted)


def cube(curve=1):
    csg = pytest.importorskip("netgen.csg")
    mesh = ngsolve.Mesh(csg.unit_cube.GenerateMesh(maxh=0.5))
    mesh.Curve(curve)
    return mesh


def ball():
    csg = pytest.importorskip("netgen.csg")
    geometry = csg.CSGeometry()
    geometry.Add(csg.Sphere(csg.Pnt(0, 0, 0), 1).bc("skin").mat("core"))
    mesh = ngsolve.Mesh(geometry.GenerateMesh(maxh=0.7))
    mesh.Curve(3)
    return mesh


def structured(**kinds):
    meshes = pytest.importorskip("ngsolve.meshes")
    return meshes.MakeStructured3DMesh(nx=2, ny=2, nz=2, **kinds)


def flat():
    geom2d = pytest.importorskip("netgen.geom2d")
    mesh = ngsolve.Mesh(geom2d.unit_square.GenerateMesh(maxh=0.4, quad_dominated=True))
    mesh.Curve(2)
    return mesh


MESHES = {
    "cube": cube,
    "ball": ball,
    "hexahedra": lambda: structured(hexes=True),
    "prisms": lambda: structured(hexes=False, prism=True),
    "flat": flat,
}


def agree(conversion, mesh, name, field, component=0, tolerance=1e-10):
    """The library's values at points of every element, searched for by place."""
    at = 0.1 if mesh.dim == 2 else 0.15
    rule = ngsolve.IntegrationRule([(at, 0.2, 0.3)[: mesh.dim]], [1.0])
    axes = (ngsolve.x, ngsolve.y, ngsolve.z)[: mesh.dim]
    places, wanted = [], []
    for element in mesh.Elements(ngsolve.VOL):
        mapped = mesh.GetTrafo(element)(rule)
        places.append(np.pad(ngsolve.CoefficientFunction(axes)(mapped)[0], (0, 3 - mesh.dim)))
        wanted.append(np.asarray(field(mapped)).reshape(-1)[component])
    found = values_found(conversion.dataset, name, np.array(places))
    assert np.abs(found - wanted).max() < tolerance * max(np.ptp(wanted), 1e-3)


def random(space, seed=4):
    field = ngsolve.GridFunction(space)
    field.vec.FV().NumPy()[:] = np.random.default_rng(seed).uniform(-1, 1, len(field.vec))
    return field


@pytest.mark.sampled
@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("name", MESHES)
def test_session_exports_are_read(tmp_path, name, bent):
    mesh = MESHES[name]()
    if bent:
        shift = ngsolve.GridFunction(ngsolve.VectorH1(mesh, order=3))
        axes = (ngsolve.x, ngsolve.y, ngsolve.z)[: mesh.dim]
        shift.Set(ngsolve.CoefficientFunction(tuple(0.1 * ngsolve.sin(2 * axis) for axis in axes[1:] + axes[:1])))
        mesh.SetDeformation(shift)
    fields = {"u": random(ngsolve.H1(mesh, order=4)), "w": random(ngsolve.L2(mesh, order=2))}
    fields["v"] = random(ngsolve.VectorH1(mesh, order=3))
    path = tmp_path / "case.elems.npz"
    export(path, mesh, fields, time=0.5)
    conversion = check(NGSolve, [path])
    report = conversion.report
    assert all(measure.is_exact for measure in (report.geometry, *report.fields))
    orders = {measure.name: (measure.order, measure.is_continuous) for measure in report.fields}
    wanted = {"u": (4, True), "w": (2, False)} | {f"v_{axis}": (3, True) for axis in "xyz"[: mesh.dim]}
    assert orders == wanted
    assert conversion.dataset.time == 0.5
    agree(conversion, mesh, "u", fields["u"])
    agree(conversion, mesh, "w", fields["w"])
    agree(conversion, mesh, "v_y", fields["v"], 1)


@pytest.mark.parametrize("space", ["H1", "L2"])
@pytest.mark.parametrize("order", [1, 2, 4])
def test_pyramids_are_as_accurate_as_the_library_defines_them(tmp_path, space, order):
    netgen = pytest.importorskip("netgen.meshing")
    own = netgen.Mesh(dim=3)
    places = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0.5, 1), (2, 0.5, 0.7)]
    points = [own.Add(netgen.MeshPoint(netgen.Pnt(*place))) for place in places]
    side = own.Add(netgen.FaceDescriptor(surfnr=1, domin=1, domout=0, bc=1))
    for corners in ((0, 1, 2, 3, 4), (1, 5, 2, 4)):
        own.Add(netgen.Element3D(1, [points[i] for i in corners]))
    for corners in ((0, 1, 2, 3), (0, 1, 4), (2, 3, 4), (3, 0, 4), (1, 5, 2), (5, 2, 4), (1, 5, 4)):
        own.Add(netgen.Element2D(side, [points[i] for i in corners]))
    mesh = ngsolve.Mesh(own)
    field = random(getattr(ngsolve, space)(mesh, order=order))
    export(tmp_path / "two.elems.npz", mesh, {"u": field})
    conversion = check(NGSolve, [tmp_path / "two.elems.npz"])
    agree(conversion, mesh, "u", field, tolerance=1e-7)
    assert any("1e-7" in note for note in conversion.report.notes)


def test_regions_have_names(tmp_path):
    mesh = ball()
    export(tmp_path / "ball.elems.npz", mesh, {})
    conversion = check(NGSolve, [tmp_path / "ball.elems.npz"])
    assert {composite.name for composite in conversion.dataset.mesh.composites} >= {"core", "skin"}
    assert conversion.report.geometry.order == 3


def test_functions_without_a_space_need_an_order(tmp_path):
    mesh = cube()
    with pytest.raises(ElvisError, match="expected an order for f, which is not a grid function, found none"):
        export(tmp_path / "a.elems.npz", mesh, {"f": ngsolve.x * ngsolve.y})
    assert not list(tmp_path.iterdir())
    export(tmp_path / "a.elems.npz", mesh, {"f": ngsolve.x * ngsolve.y}, order=2)
    conversion = check(NGSolve, [tmp_path / "a.elems.npz"])
    points = np.random.default_rng(1).uniform(0, 1, (20, 3))
    assert np.abs(values_found(conversion.dataset, "f", points) - points[:, 0] * points[:, 1]).max() < 1e-12


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape is not Shape.SEGMENT])
def test_interpolation_through_the_points_of_samples_is_stable(shape):
    """Lebesgue constants: how much an error of the samples may grow between them."""
    for order in range(1, 9):
        points = native_points(shape, UNIT[shape].frame, _rule(shape, order))
        basis = NodalBasis(shape, order, points, PyramidSpace.RATIONAL)
        inside = check_points(shape, 200)[:200]
        assert np.abs(basis.at(inside)).sum(axis=1).max() < 100


def replaced(name, change):
    return lambda data: {key: change(value) if key == name else value for key, value in data.items()}


BAD = [
    (lambda data: {k: v for k, v in data.items() if k != "order"}, "expected an array order, found none"),
    (lambda data: {k: v for k, v in data.items() if k != "tet_elem"}, "expected an array tet_elem, found none"),
    (replaced("order", lambda v: v * 100), "expected orders from 0 to 30"),
    (replaced("order", lambda v: v + 3), "expected samples of order 7, found those of order 5"),
    (replaced("tet_f_u", lambda v: v[:-1]), r"tet_f_u: expected \(701, 56, 1\) numbers, found \(700, 56, 1\)"),
    (replaced("tet_ref", lambda v: np.zeros_like(v)), "expected nodes that determine a tetrahedron of order 5"),
    (replaced("tet_verts", lambda v: v[:, :3]), r"expected \(701, 4\) numbers"),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_bad_files_give_a_one_line_error(solvers, tmp_path, change, message):
    with np.load(solvers / "ngsolve" / "ballbox_p4.elems.npz") as file:
        data = dict(file)
    path = tmp_path / "bad.elems.npz"
    np.savez(path, **change(data))
    with pytest.raises(FormatError, match=message) as caught:
        NGSolve([path])
    assert str(path) in str(caught.value)


def test_other_archives_are_for_others(solvers, tmp_path):
    whole = (solvers / "ngsolve" / "hexprism_p3_hex.elems.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[: len(whole) // 2])
    assert not NGSolve.opens([tmp_path / "cut.npz"])
    assert not NGSolve.opens([solvers / "ngsolve" / "ballbox_p4.truth.npz"])
    assert not NGSolve.opens([solvers / "ngsolve" / "ballbox_p4.pickle"])


def test_native_files_of_ngsolve_agree_with_the_library(solvers, truth, near):
    """The mesh file has a few digits less than the session had."""
    folder = solvers / "ngsolve"
    files = [folder / f"ballbox_p4.{end}" for end in ("vol", "u.gfu", "w.gfu", "v.gfu")]
    assert NGSolve.opens(files)
    conversion = check(NGSolve, files, spaces="H1:5,L2:4,VectorH1:4")
    report = conversion.report
    assert all(measure.is_exact for measure in (report.geometry, *report.fields))
    assert [measure.name for measure in report.fields] == ["u", "w", "v_x", "v_y", "v_z"]
    own = truth(folder / "ballbox_p4.truth.npz")
    places = lambda block, ref: ref  # noqa: E731
    near(own.positions_at(conversion, {"tet": 0}, places), own.xyz, 1e-9)
    for measure in report.fields:
        wanted = own.column(measure.name[0], "xyz".index(measure.name[2]) if len(measure.name) > 1 else 0)
        near(own.at(conversion, measure.name, {"tet": 0}, places), wanted)
        near(own.found(conversion.dataset, measure.name), wanted, 1e-8)


@pytest.mark.parametrize("name", ["ball", "flat", "prisms"])
def test_saved_files_equal_session_exports(tmp_path, near, name):
    mesh = MESHES[name]()
    mesh.ngmesh.Save(str(tmp_path / "case.vol"))
    mesh = ngsolve.Mesh(str(tmp_path / "case.vol"))
    function = ngsolve.GridFunction(ngsolve.H1(mesh, order=3))
    function.Set(ngsolve.sin(ngsolve.x) * (1 + ngsolve.y))
    function.Save(str(tmp_path / "case.u.gfu"))
    export(tmp_path / "case.elems.npz", mesh, {"u": function})
    ours = check(NGSolve, [tmp_path / "case.vol", tmp_path / "case.u.gfu"], spaces="H1:3").dataset
    theirs = check(NGSolve, [tmp_path / "case.elems.npz"]).dataset
    near(ours.mesh.vertices, theirs.mesh.vertices, 1e-14)
    for one, other in zip(ours.fields[0].blocks, theirs.fields[0].blocks, strict=True):
        near(one.coefficients, other.coefficients, 1e-12)


@pytest.mark.parametrize(
    ("spaces", "change", "message"),
    [
        (None, lambda text: text, r"expected a space for each of 1 .gfu files, .*, found 0"),
        ("H1:5,L2:4", lambda text: text, r"expected a space for each of 1 .gfu files, .*, found 2"),
        ("H1:999", lambda text: text, "expected a space among H1, .*, found 'H1:999'"),
        ("Fancy:3", lambda text: text, "expected a space among H1, .*, found 'Fancy:3'"),
        ("H1:4", lambda text: text, r"u.gfu: expected \d+ numbers of H1 of order 4, found 16462"),
        ("H1:5", lambda text: text[: len(text) // 2], "expected a complete mesh, found no endmesh"),
        ("H1:5", lambda text: text.replace("\n701\n", "\n799999999\n"), "expected a number of volumeelements"),
        ("H1:5", lambda text: text.replace("1 4 104 106", "1 4 104 999"), "expected points 1 to 200, found 999"),
        ("H1:5", lambda text: text.replace("1 4 104 106", "1 4 104 x"), "expected an element and its points"),
        ("H1:5", lambda text: text.replace("curvedelements\n1044", "curvedelements\n10440000"), "fails|expected"),
    ],
)  # fmt: skip
def test_bad_native_files_of_ngsolve_give_a_one_line_error(solvers, tmp_path, spaces, change, message):
    paths = [tmp_path / "ballbox_p4.vol", solvers / "ngsolve" / "ballbox_p4.u.gfu"]
    text = (solvers / "ngsolve" / paths[0].name).read_text()
    paths[0].write_text(change(text))
    with pytest.raises(ElvisError, match=message) as caught:
        NGSolve(paths, spaces=spaces)
    assert "\n" not in str(caught.value)


def test_a_compressed_mesh_is_read_like_the_plain_one(tmp_path):
    mesh = ball()
    for name in ("case.vol", "case.vol.gz"):
        mesh.ngmesh.Save(str(tmp_path / name))
    assert (tmp_path / "case.vol.gz").read_bytes()[:2] == b"\x1f\x8b"
    function = random(ngsolve.H1(ngsolve.Mesh(str(tmp_path / "case.vol")), order=3))
    function.Save(str(tmp_path / "case.u.gfu"))
    shutil.copy(tmp_path / "case.vol.gz", tmp_path / "other")
    plain, *others = (
        check(NGSolve, [tmp_path / name, tmp_path / "case.u.gfu"], spaces="H1:3")
        for name in ("case.vol", "case.vol.gz", "other")
    )
    assert plain.report.geometry.order == 3
    for each in others:
        assert np.array_equal(each.dataset.mesh.vertices, plain.dataset.mesh.vertices)
        assert np.array_equal(
            each.dataset.fields[0].blocks[0].coefficients, plain.dataset.fields[0].blocks[0].coefficients
        )
    assert [each.report.fields[0].name for each in (plain, *others)] == ["u", "u", "case.u"]
    raw = (tmp_path / "case.vol.gz").read_bytes()
    for cut in (b"", b"\0" * 40):
        (tmp_path / "cut.vol.gz").write_bytes(raw[: len(raw) * 2 // 3] + cut)
        with pytest.raises(FormatError, match=r"cut\.vol\.gz: expected a complete compressed file"):
            NGSolve([tmp_path / "cut.vol.gz"])
    with gzip.open(tmp_path / "bomb.vol.gz", "wb") as file:
        file.write(b"mesh3d\n" + b"\n" * (3 * 10**7))
    with pytest.raises(FormatError, match=r"bomb\.vol\.gz: expected at most \d+ bytes in the compressed file"):
        NGSolve([tmp_path / "bomb.vol.gz"])


def test_a_mesh_without_an_end_mark_is_read_if_its_sections_are_complete(tmp_path):
    mesh = cube()
    mesh.ngmesh.Save(str(tmp_path / "whole.vol"))
    text = (tmp_path / "whole.vol").read_text()
    text = text[: text.index("endmesh")]
    path = tmp_path / "open.vol"
    path.write_text(text)
    (note,) = [note for note in check(NGSolve, [path]).report.notes if "endmesh" in note]
    assert "whatever followed its section" in note
    assert NGSolve([path]).summary() == NGSolve([tmp_path / "whole.vol"]).summary()
    for broken in (
        text.rstrip(),
        text.rstrip()[:-8],
        text.rstrip().rpartition("\n")[0] + "\n",
        text + "curvedelements\n3\n",
    ):
        path.write_text(broken)
        with pytest.raises(
            FormatError, match=r"open\.vol: (expected a complete mesh, found no endmesh|.*as many lines)"
        ):
            NGSolve([path])


def test_a_plane_mesh_without_elements_is_named(tmp_path):
    netgen = pytest.importorskip("netgen.meshing")
    own = netgen.Mesh(dim=2)
    points = [own.Add(netgen.MeshPoint(netgen.Pnt(x, 0, 0))) for x in (0.0, 1.0)]
    own.Add(netgen.Element1D(points, index=1))
    own.Save(str(tmp_path / "empty.vol"))
    with pytest.raises(FormatError, match=r"empty\.vol: expected elements, found none"):
        NGSolve([tmp_path / "empty.vol"])


def reloaded(folder, mesh):
    """A mesh as its file holds it."""
    mesh.ngmesh.Save(str(folder / "case.vol"))
    return ngsolve.Mesh(str(folder / "case.vol"))


def saved(folder, function):
    """The files of a mesh, which is there, and of a function."""
    function.Save(str(folder / "case.u.gfu"))
    return [folder / "case.vol", folder / "case.u.gfu"]


def two_squares():
    """The squares ``left`` and ``right`` of a rectangle."""
    from netgen.occ import Glue, OCCGeometry, WorkPlane

    faces = [WorkPlane().MoveTo(start, 0).Rectangle(1, 1).Face() for start in (0, 1)]
    for face, name in zip(faces, ("left", "right"), strict=True):
        face.faces.name = name
    return ngsolve.Mesh(OCCGeometry(Glue(faces), dim=2).GenerateMesh(maxh=0.6))


def value(dataset, quantity, over="domain"):
    return integrate(dataset, quantity, over=over)[-1].value


def test_complex_functions_products_and_parts_of_the_mesh(tmp_path):
    mesh = reloaded(tmp_path, two_squares())
    x, y = ngsolve.x, ngsolve.y
    wave = ngsolve.GridFunction(ngsolve.H1(mesh, order=3, complex=True))
    wave.Set(x**2 * y + 1j * (x - y))
    dataset = check(NGSolve, saved(tmp_path, wave), spaces="H1:3:complex").dataset
    assert value(dataset, "u_re") == pytest.approx(4 / 3, rel=1e-12)
    assert value(dataset, "u_im") == pytest.approx(1, rel=1e-12)

    product = ngsolve.GridFunction(ngsolve.FESpace([ngsolve.VectorH1(mesh, order=2), ngsolve.L2(mesh, order=1)]))
    velocity, pressure = product.components
    velocity.Set((x * y, y))
    pressure.Set(x + y)
    dataset = convert(NGSolve(saved(tmp_path, product), spaces="VectorH1:2*L2:1")).dataset
    assert value(dataset, "u_1_x") == pytest.approx(1, rel=1e-12)
    assert value(dataset, "u_2") == pytest.approx(3, rel=1e-12)

    part = ngsolve.GridFunction(ngsolve.H1(mesh, order=2, definedon=mesh.Materials("right")))
    part.Set(x)
    dataset = convert(NGSolve(saved(tmp_path, part), spaces="H1:2@right")).dataset
    assert value(dataset, "u", "region:right") == pytest.approx(1.5, rel=1e-12)
    assert np.isnan(sample(dataset, "u", (0.5, 0.5))["u"]).all()
    with pytest.raises(FormatError, match="expected parts of the mesh among left, right, found 'middle'"):
        NGSolve(saved(tmp_path, part), spaces="H1:2@middle")
    with pytest.raises(FormatError, match="complex numbers of H1 of order 2"):
        NGSolve(saved(tmp_path, part), spaces="H1:2:complex")


@pytest.mark.parametrize("order", [1, 2, 3])
def test_functions_at_quadrature_points(tmp_path, order):
    """They have their own values at these, and the integrals of linear functions; between, the library has none."""
    mesh = reloaded(tmp_path, two_squares())
    space = ngsolve.comp.IntegrationRuleSpace(mesh, order=order)
    function = ngsolve.GridFunction(space)
    function.Interpolate(1 + ngsolve.x - 2 * ngsolve.y)
    dataset = convert(NGSolve(saved(tmp_path, function), spaces=f"IntegrationRuleSpace:{order}")).dataset
    wanted = ngsolve.Integrate(1 + ngsolve.x - 2 * ngsolve.y, mesh)
    assert value(dataset, "u") == pytest.approx(wanted, rel=1e-12)

    function.Interpolate(ngsolve.sin(9 * ngsolve.x) + ngsolve.y**5)
    live = from_ngsolve(mesh, {"u": function})
    rule = space.GetIntegrationRules()
    places = mesh.MapToAllElements({kind: rule[kind] for kind in (ngsolve.ET.TRIG, ngsolve.ET.QUAD)}, ngsolve.VOL)
    points = np.column_stack([np.ravel(own(places)) for own in (ngsolve.x, ngsolve.y)])
    assert np.allclose(sample(live, "u", points)["u"], np.array(function.vec), rtol=0, atol=1e-13)


def test_other_functions_at_points_are_rejected(tmp_path):
    mesh = two_squares()
    waves = ngsolve.GridFunction(ngsolve.comp.IntegrationRuleSpace(mesh, order=2, complex=True))
    with pytest.raises(ElvisError, match="u: expected real values at quadrature points, found complex ones"):
        from_ngsolve(mesh, {"u": waves})
    solid = ngsolve.Mesh(ngsolve.unit_cube.GenerateMesh(maxh=2))
    outside = ngsolve.GridFunction(ngsolve.comp.IntegrationRuleSpaceSurface(solid, order=2))
    with pytest.raises(ElvisError, match="u: expected a function inside of elements, found one at points of surfaces"):
        from_ngsolve(solid, {"u": outside})


def test_surfaces_without_a_volume(tmp_path):
    from netgen.meshing import MeshingStep
    from netgen.occ import OCCGeometry, Pnt, Sphere

    geometry = OCCGeometry(Sphere(Pnt(0, 0, 0), 1))
    mesh = ngsolve.Mesh(geometry.GenerateMesh(maxh=1, perfstepsend=MeshingStep.MESHSURFACE))
    mesh.Curve(3)
    mesh = reloaded(tmp_path, mesh)
    function = ngsolve.GridFunction(ngsolve.H1(mesh, order=3))
    function.Set(ngsolve.z**2, definedon=mesh.Boundaries(".*"))
    conversion = check(NGSolve, saved(tmp_path, function), spaces="H1:3")
    assert set(conversion.report.elements) == {"triangle"}
    for quantity, own in (("1", ngsolve.CoefficientFunction(1)), ("u", function)):
        wanted = ngsolve.Integrate(own, mesh, ngsolve.BND, order=20)
        assert integrate(conversion.dataset, quantity, error=1e-10)[0].value == pytest.approx(wanted, rel=1e-8)
