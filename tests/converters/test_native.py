"""Native to native: exact where contained, at other orders, merged, in parts, in every form of file."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elvis import Basis, ElvisError, Shape, read, write
from elvis.converters.native import Native
from elvis.core.data.dataset import Block, Dataset, Expansion, Field, Homogeneous
from elvis.core.numbers.norms import norms
from elvis.core.numbers.sampling import sample
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, ripple, shuffled
from elvis.formats.strict import findings
from elvis.plugins.conversion.converting import Settings, convert
from elvis.plugins.conversion.plugin import PyramidSpace
from elvis.plugins.testing import check

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "nektar"
CASES = (
    "gen_allelem_n4",
    "gen_allelem_ortho",
    "gen_allelem_var_h5",
    "kova_varp",
    "hex_gll8",
    "sphere_manifold",
    "tet_small",
)


def files(case):
    found = sorted(DATA.joinpath(case).iterdir())
    meshes = [path for path in found if path.suffix == ".xml"]
    return [*meshes, *[path for path in found if path.suffix in (".fld", ".rst", ".chk")][:1]]


def same_values(one, other, points):
    """Values of u and v, at all points that both have inside."""
    old, new = (sample(each, ["u", "v"], points).values for each in (one, other))
    assert np.isfinite(old).all(axis=0 if old.shape[0] == 2 else 1).mean() > 0.9
    assert np.array_equal(np.isfinite(old), np.isfinite(new))
    assert np.nanmax(np.abs(old - new)) < 1e-11


@pytest.fixture
def volume(tmp_path):
    dataset = Dataset(curved(shuffled(mixed_volume(3), 1), ripple(0.05), 3))
    functions = {"u": lambda x: x[:, 0] ** 2 + x[:, 1] * x[:, 2], "v": lambda x: np.sin(x[:, 0] - x[:, 2])}
    fields = tuple(approximated(dataset, name, function, 5) for name, function in functions.items())
    return write(replace(dataset, fields=fields, time=0.5, metadata={"Kinvis": "2"}), tmp_path / "volume.xml")


@pytest.mark.parametrize("case", CASES)
def test_real_files_survive_a_round_trip_exactly(case, tmp_path):
    if not DATA.is_dir():
        pytest.skip(f"there is no {DATA}")
    conversion = check(Native, files(case))
    assert {measure.state for measure in (conversion.report.geometry, *conversion.report.fields)} == {"exact"}
    written = write(conversion.dataset, tmp_path / "a.xml")
    assert [str(each) for each in findings(*written) if "Jacobian" not in each.sentence] == []


def sizes(field):
    """Elements of each shape and number of modes."""
    found = Counter()
    for block in field.blocks:
        found[block.expansion.shape.label, block.expansion.modes] += len(block)
    return found


@pytest.mark.parametrize("case", ["gen_allelem_var_h5", "gen_quadface_2d", "cyl_mixorder", "kova_varp"])
def test_orders_of_each_direction_are_preserved(case):
    if not DATA.is_dir():
        pytest.skip(f"there is no {DATA}")
    before, after = read(*files(case)), convert(Native(files(case))).dataset
    assert [sizes(field) for field in after.fields] == [sizes(field) for field in before.fields]
    # values are compared, as coefficients of many modes are not told as well by them
    random = np.random.default_rng(3)
    places = {shape: uncollapse(shape, random.uniform(-1, 1, (200, shape.dimension))) for shape in Shape}
    for one, other in zip(before.fields, after.fields, strict=True):
        own = {id: row for block in one.blocks for id, row in zip(block.element_ids, block.coefficients, strict=True)}
        for block in other.blocks:
            for id, row in zip(block.element_ids, block.coefficients, strict=True):
                changes = evaluate(block.expansion, (row - own[id])[None], places[block.expansion.shape])
                assert np.abs(changes).max() < 1e-12 * max(1, np.abs(own[id]).max())


@pytest.mark.parametrize("basis", [Basis.MODIFIED_A, Basis.GLL_LAGRANGE, Basis.ORTHO_A])
def test_orders_of_each_direction_are_preserved_for_every_basis(tmp_path, basis):
    """Polynomials of degrees 1, 4, 2 of hexahedra, given by coefficients at random."""
    mesh = grid(Shape.HEXAHEDRON, 2)
    expansion = Expansion(Shape.HEXAHEDRON, (basis,) * 3, (2, 5, 3))
    ids = mesh.of(Shape.HEXAHEDRON).ids
    coefficients = np.random.default_rng(8).uniform(-1, 1, (len(ids), 30))
    before = Dataset(mesh, (Field("u", (Block(expansion, ids, coefficients),)),))
    written = write(before, tmp_path / "a.xml")
    after = check(Native, written).dataset
    assert [block.expansion.modes for block in after.fields[0].blocks] == [(2, 5, 3)]
    points = np.random.default_rng(9).uniform(0, 1, (50, 3))
    old, new = (sample(each, ["u"], points).values for each in (before, after))
    assert np.abs(old - new).max() < 1e-12
    raised = convert(Native(written), Settings(order=6)).dataset
    assert [block.expansion.modes for block in raised.fields[0].blocks] == [(7, 7, 7)]


def test_values_at_points_are_preserved(volume):
    conversion = check(Native, volume)
    points = np.random.default_rng(1).uniform([0, 0.1, 0.1], [3, 0.9, 0.9], (200, 3))
    same_values(read(*volume), conversion.dataset, points)
    assert conversion.dataset.time == 0.5
    assert conversion.dataset.metadata["Kinvis"] == "2"


@pytest.mark.parametrize("order", [4, 6])
def test_higher_orders_are_exact(volume, order):
    report = convert(Native(volume), Settings(order=order)).report
    assert {measure.name: measure.state for measure in report.fields} == {"u": "exact", "v": "exact"}


def test_lower_orders_are_measured(volume):
    reports = [convert(Native(volume), Settings(order=order)).report for order in (1, 2, 3)]
    assert {measure.state for report in reports for measure in report.fields} == {"projected"}
    errors = np.array([[measure.relative for measure in report.fields] for report in reports])
    assert (errors[1:] < 0.6 * errors[:-1]).all()


def test_files_are_merged(volume, tmp_path):
    dataset = read(*volume)
    parts = []
    for field in dataset.fields:
        parts += write(
            replace(dataset, fields=(field,)), field_path=tmp_path / f"{field.name}.fld", field_format="hdf5"
        )
    merged = convert(Native([volume[0], *parts])).dataset
    assert [field.name for field in merged.fields] == ["u", "v"]
    same_values(dataset, merged, np.random.default_rng(2).uniform(0.1, 0.9, (50, 3)))


@pytest.mark.thorough
@pytest.mark.parametrize("form", ["text", "compressed", "hdf5"])
def test_the_command_accepts_parts_and_forms(elvis, volume, tmp_path, form):
    elvis("convert", *volume, "-o", tmp_path / "part.xml", "--fields", "v", "--format", form, "--max-error", "1e-12")
    written = [tmp_path / "part.xml", tmp_path / "part.fld"]
    assert [field.name for field in read(*written).fields] == ["v"]
    assert findings(*written) == ()
    first = [path.read_bytes() for path in written]
    elvis("convert", *volume, "-o", tmp_path / "part.xml", "--fields", "v", "--format", form)
    assert [path.read_bytes() for path in written] == first


def arrays(mesh):
    """All that a mesh holds."""
    yield from (mesh.vertex_ids, mesh.vertices)
    for shape in mesh.entities:
        yield from (mesh.of(shape).ids, mesh.of(shape).members)
    for curves in (mesh.edge_curves, mesh.face_curves):
        yield from (curves.rows, curves.kinds, curves.offsets, curves.points)
    for composite in mesh.composites:
        yield from (np.array([composite.id]), *(ids for _, ids in composite.parts))


@pytest.mark.parametrize("case", CASES)
def test_the_mesh_is_unchanged(case):
    if not DATA.is_dir():
        pytest.skip(f"there is no {DATA}")
    before = read(*files(case)).mesh
    conversion = convert(Native(files(case)), Settings(order=3))
    after = conversion.dataset.mesh
    assert all(np.array_equal(one, other) for one, other in zip(arrays(before), arrays(after), strict=True))
    assert [(c.id, c.name) for c in after.composites] == [(c.id, c.name) for c in before.composites]
    assert (after.domains, after.dimension, after.space) == (before.domains, before.dimension, before.space)
    assert not conversion.report.has_map


def test_blends_of_strongly_curved_elements_are_preserved(tmp_path):
    """Of tetrahedra the blend of curves depends on the order of vertices, which stays."""
    mesh = curved(shuffled(mixed_volume(2), 1), ripple(0.1), 6)
    conversion = check(Native, write(Dataset(mesh), tmp_path / "a.xml"))
    assert conversion.report.geometry.max < 1e-14
    assert not conversion.report.has_map


def test_composites_can_be_chosen(tmp_path, elvis):
    mesh = mixed_plane(2)
    named = tuple(replace(c, name=f"part {c.id}") for c in mesh.composites)
    plane = replace(mesh, composites=named)
    field = approximated(Dataset(plane), "u", lambda x: x[:, 0] - x[:, 1], 2)
    paths = write(Dataset(plane, (field,)), tmp_path / "plane.xml")
    for choice in (["part 0"], ["0"], ["part 1"], ["part 0", "1"]):
        elvis("convert", *paths, "-o", tmp_path / "some.xml", "--composites", ",".join(choice))
        found = read(tmp_path / "some.xml", tmp_path / "some.fld")
        ids = {int(name.removeprefix("part ")) for name in choice}
        wanted = [ids_ for c in named if c.id in ids for _, ids_ in c.parts]
        assert sum(map(len, found.mesh.elements.values())) == sum(map(len, wanted))
        same_values_of(Dataset(plane, (field,)), found, "u")
    with pytest.raises(ElvisError, match="there is no composite 'wing' in the domain; there are: 0 part 0"):
        Native(paths, composites="wing")


def same_values_of(whole, part, name):
    """Values of a field, wherever the part has any."""
    points = np.random.default_rng(4).uniform(*(end(whole.mesh.vertices, axis=0) for end in (np.min, np.max)), (200, 3))
    found, wanted = (sample(each, [name], points).values.reshape(-1) for each in (part, whole))
    inside = np.isfinite(found)
    assert inside.any()
    assert np.abs(found - wanted)[inside].max() <= 1e-12 * np.nanmax(np.abs(wanted))


FOURIER = [("triquad_h1d", "*.fld"), ("chan3dh1d", "chan3DH1D.fld"), ("naca_h1d_line", "*.fld")]


@pytest.mark.parametrize(("case", "pattern"), FOURIER)
def test_fourier_planes_survive_a_round_trip(tmp_path, case, pattern):
    if not DATA.is_dir():
        pytest.skip(f"there is no {DATA}")
    paths = [path for end in ("*.xml", pattern) for path in sorted(DATA.joinpath(case).glob(end))]
    before = read(*paths)
    conversion = convert(Native(paths))
    assert {measure.state for measure in (conversion.report.geometry, *conversion.report.fields)} == {"exact"}
    assert [measure.name for measure in conversion.report.fields] == [field.name for field in before.fields]
    highest = max(max(b.expansion.modes) for field in before.fields for b in field.blocks)
    for order in (None, highest + 1):
        written = write(convert(Native(paths), Settings(order=order)).dataset, tmp_path / f"{order}.xml")
        assert findings(*written) == ()
        after = read(*written)
        waves = [{b.expansion.homogeneous for f in each.fields for b in f.blocks} for each in (before, after)]
        assert waves[0] == waves[1] != {None}
        if order is None:  # at another order other quadrature points hold
            found, wanted = ({name: norm.l2 for name, norm in norms(each).items()} for each in (after, before))
            assert found == pytest.approx(wanted, rel=1e-12, abs=1e-13)


def test_tolerances_of_fourier_planes_match_those_of_the_field(tmp_path):
    mesh = mixed_plane(2)
    wave = Homogeneous((Basis.FOURIER,), (2.0,), (0, 1, 2, 3))
    planes = [approximated(Dataset(mesh), "u", lambda x, k=k: np.sin(x[:, 0] * k) * 10.0**-k, 7) for k in range(4)]
    blocks = tuple(
        replace(
            each[0],
            expansion=replace(each[0].expansion, homogeneous=wave),
            coefficients=np.concatenate([b.coefficients for b in each], axis=1),
        )
        for each in zip(*(plane.blocks for plane in planes), strict=True)
    )
    paths = write(Dataset(mesh, (Field("u", blocks),)), tmp_path / "a.xml")
    report = convert(Native(paths), Settings(tolerance=1e-3)).report
    (measure,) = report.fields
    assert measure.order < 6
    assert 0 < measure.relative <= 1e-3


def test_a_geometry_map_is_preserved(solvers, tmp_path):
    from elvis.converters.hopr import Hopr

    source = convert(Hopr([solvers / "hopr_flexi" / "convcurved_N4_State.h5"]))
    assert source.report.has_map
    paths = write(source.dataset, tmp_path / "a.xml")
    again = check(Native, paths)
    assert again.report.geometry.state == "exact"
    assert {field.name for field in again.dataset.fields} == {field.name for field in source.dataset.fields}


def test_pyramids_keep_their_family():
    if not DATA.is_dir():
        pytest.skip(f"there is no {DATA}")
    spaces = {b.pyramid for b in Native(files("gen_allelem_ortho")).blocks if b.shape.label == "Pyramid"}
    assert spaces == {PyramidSpace.POLYNOMIAL}


def test_unsupported_input_is_rejected(tmp_path):
    (tmp_path / "other.xml").write_text("<VTKFile/>")
    assert not Native.opens([tmp_path / "other.xml"])
    assert not Native.opens([tmp_path / "missing.xml"])
