"""Copies of data in pictures equal files that hold the copied elements."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import (
    Camera,
    Copies,
    CutSurface,
    Dataset,
    Faces,
    Isosurface,
    Plane,
    Repeat,
    Scene,
    SceneError,
    Shape,
    Style,
    Transfer,
    Turn,
    VolumeRendering,
    from_arrays,
    integrate,
    render,
    sample,
    write,
)
from elvis.core.data.mesh import PERIODIC
from elvis.core.deformed.isometries import Isometry
from elvis.core.polynomials.quadrature import lobatto
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.moved_expressions import moved
from elvis.core.testing import approximated, grid
from elvis.plugins.command.command import elvis as group
from elvis.reference.study import compare_scene
from elvis.renderer.frame.rendering import Pictures
from elvis.scene.commandline.writing import option_words
from elvis.scene.model.tables import scene_of, table_of

ORDER = 3
LINE = lobatto(ORDER + 1)[0]
#: reference positions of the nodes of a hexahedron, first coordinate fastest
NODES = np.stack(np.meshgrid(LINE, LINE, LINE, indexing="ij"), axis=-1)[..., ::-1].reshape(-1, 3)
#: signs of fields beyond a mirror at x = c, and across its normal
SIGNS = {"u": -1, "v": 1, "w": 1, "p": 1}


def nodes():
    """(4, m, 3) nodes of four curved hexahedra between x = 0 and x = 1."""
    corners = [(0.5 * i, 0.5 * j, 0.0) for j in (0, 1) for i in (0, 1)]
    x = np.stack([np.array(corner) + 0.25 * (NODES + 1.0) * [1, 1, 2] for corner in corners])
    bump = x[..., 0] * (1.0 - x[..., 0])
    return x + bump[..., None] * np.array([0.0, 0.2, 0.3]) * (x[..., 1:2] - 0.3)


def values(x):
    u, v = 1.0 + x[..., 0] * x[..., 1] + 0.5 * x[..., 2] ** 2, x[..., 0] ** 2 - x[..., 2]
    return {"u": u, "v": v, "w": x[..., 1] * x[..., 0] + 0.3 * x[..., 2], "p": 1.0 + x[..., 0] - x[..., 1] ** 2}


def reversed_nodes(own):
    """Nodes or values of hexahedra with the first reference coordinate reversed."""
    shape = (len(own), ORDER + 1, ORDER + 1, ORDER + 1)
    return own.reshape(*shape, *own.shape[2:])[:, :, :, ::-1].reshape(own.shape)


def dataset(parts):
    """A dataset of several parts: nodes, and values by field."""
    x = np.concatenate([own for own, _ in parts])
    return from_arrays({"hexahedron": x}, {name: np.concatenate([f[name] for _, f in parts]) for name in SIGNS})


def halves(factor=1.0):
    """The elements and their mirror image at x = 0, turned so that their maps keep the orientation."""
    x, own = nodes(), {name: factor * field for name, field in values(nodes()).items()}
    image = {name: reversed_nodes(SIGNS[name] * field) for name, field in own.items()}
    return [(x, own), (reversed_nodes(x * [-1.0, 1.0, 1.0]), image)]


@pytest.fixture(scope="module")
def data():
    return dataset(halves()[:1])


@pytest.fixture(scope="module")
def mirrored():
    return dataset(halves())


def reflection(normal):
    """Householder's matrix of a mirror."""
    unit = np.array(normal) / np.linalg.norm(normal)
    return np.eye(3) - 2 * np.outer(unit, unit)


def rotation(axis, degrees):
    """Rodrigues' matrix of a turn."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.deg2rad(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


#: a mirror, four turns about an oblique axis, and two copies of all of these in a row
COMBINED = {"mirror": "-0.3,0,0:1,-0.2,0.1", "turn": "0,-2.5,-2.5:1,0.3,-0.2:4", "repeat": "4.5,1,0:2"}


def combined_maps():
    """Matrix and translation of each copy."""
    mirror, turns = reflection((1, -0.2, 0.1)), [rotation((1, 0.3, -0.2), 90 * number) for number in range(4)]
    on_mirror, on_axis = np.array([-0.3, 0, 0]), np.array([0, -2.5, -2.5])
    maps = [(np.eye(3), np.zeros(3)), (mirror, on_mirror - mirror @ on_mirror)]
    maps = [(turn @ own, turn @ (shift - on_axis) + on_axis) for turn in turns for own, shift in maps]
    return [(own, shift + step) for step in (np.zeros(3), np.array([4.5, 1, 0])) for own, shift in maps]


@pytest.fixture(scope="module")
def combined():
    """The elements of all copies, turned so that their maps keep the orientation."""
    x, own = nodes(), values(nodes())
    parts = []
    for matrix, shift in combined_maps():
        places, velocity = x @ matrix.T + shift, np.stack([own[name] for name in "uvw"], axis=-1) @ matrix.T
        fields = {**own, **{name: velocity[..., axis] for axis, name in enumerate("uvw")}}
        if np.linalg.det(matrix) < 0:
            places, fields = reversed_nodes(places), {name: reversed_nodes(field) for name, field in fields.items()}
        parts.append((places, fields))
    return dataset(parts)


#: components of a symmetric tensor
TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")
CAMERA = Camera((2.1, -3.3, 2.2), (0.0, 0.5, 0.4), fov=38.0)


def compare(ours, theirs, count):
    """A picture of copies, and one of a file that holds them as further elements, ``count`` for each copy."""
    differs = (ours.copy != np.where(theirs.element < 0, -1, theirs.element // count)) & (ours.status == 1)
    assert not (differs & (theirs.status == 1)).any()
    certain = (ours.status == 1) & (theirs.status == 1)
    assert certain.sum() > 0.95 * theirs.seen.sum() > 500
    assert np.array_equal(ours.element[certain], theirs.element[certain] % count)
    low, high = theirs.range
    assert np.abs(ours.field - theirs.field)[certain].max() < 1e-11 * (high - low)
    assert np.abs(ours.position - theirs.position)[certain].max() < 1e-10
    assert np.abs(ours.normal - theirs.normal)[certain].max() < 1e-9
    assert ours.range == pytest.approx(theirs.range, abs=1e-9)
    assert (np.abs(ours.rgb.astype(int) - theirs.rgb).max(axis=2) > 2).mean() < 0.003


DRAWN = {
    "faces": {"faces": "all", "mesh_lines": True, "lights": (1.0, -2.0, 3.0)},
    "cut and contours": {"plane": "0,0.4,0.3:0.3,0.2,1", "contours": 6},
    "clip": {"isosurface": "p=0.7,1.2", "plane": "y=0.3", "clip": "sphere:0.2,0,0.5:0.45"},
    "translucent": {"isosurface": "u=-1.3,1.3", "plane": "z=0.3", "opacity": 0.6},
}


@pytest.mark.sampled
@pytest.mark.parametrize("field", ["u", "vorticity_z"])
@pytest.mark.parametrize("drawn", DRAWN.values(), ids=DRAWN)
def test_the_mirror_image_is_that_of_a_mirrored_file(data, mirrored, drawn, field):
    options = {"camera": CAMERA, "size": 90, **drawn}
    compare(render(data, field, mirror="x=0", **options), render(mirrored, field, **options), 4)


@pytest.mark.parametrize("field", ["wall_shear_x(mu=1)", "wall_shear_z(mu=1)", "q_criterion"])
def test_shear_and_q_are_those_of_a_mirrored_file(data, mirrored, field):
    """The shear across the mirror changes its sign, the shear along it and Q do not."""
    # faces of the data on the mirror may be seen between both halves, where pixels are ambiguous
    options = {"camera": CAMERA, "size": 60, "faces": "all", "range": (-2.0, 2.0)}
    ours, theirs = render(data, field, mirror="x=0", **options), render(mirrored, field, **options)
    compare(ours, theirs, 4)
    assert np.ptp(ours.field[ours.copy == 1]) > 0.1


VOLUME = {"camera": CAMERA, "size": 50, "volume": "-1.5:0,0:3,1.5:6"}


def test_volumes_in_copies_are_those_of_a_file(data, mirrored):
    """Their quantity has another sign beyond the mirror; a clip, a gate and a translucent cut are crossed."""
    for drawn in ({"clip": "implicit:u"}, {"clip": "sphere:0.2,0.3,0.5:0.45", "plane": "z=0.3", "opacity": 0.5}):
        ours, theirs = render(data, "u", mirror="x=0", **drawn, **VOLUME), render(mirrored, "u", **drawn, **VOLUME)
        assert np.abs(ours.color - theirs.color).max() < 1e-12
        assert np.array_equal(ours.status, theirs.status)
        assert ours.stats["volume"] == theirs.stats["volume"]
        assert (ours.status == 1).sum() > 300


def test_volumes_of_straight_copies_are_those_of_the_reference():
    data = Dataset(grid(Shape.TETRAHEDRON, 1))
    data = replace(data, fields=(approximated(data, "u", lambda x: x[:, 0] * x[:, 1] - x[:, 2] ** 2, 3),))
    options = {**VOLUME, "size": 30, "turn": "-0.5,-1.3,0:0.1,0,1:3"}
    ours, theirs = render(data, "u", **options), render(data, "u", device="reference", **options)
    assert np.abs(ours.color - theirs.color).max() < 1e-7
    assert np.array_equal(ours.status > 0, theirs.status > 0)
    assert (ours.status > 0).sum() > 100


def check_reference(data, field, **options):
    """The device and the reference agree on a picture with copies."""
    ours, theirs = render(data, field, **options), render(data, field, device="reference", **options)
    certain = (ours.status == 1) & (theirs.status == 1)
    assert certain.sum() > 0.9 * theirs.seen.sum() > 100
    for name in ("element", "copy"):
        assert np.array_equal(getattr(ours, name)[certain], getattr(theirs, name)[certain])
    low, high = theirs.range
    assert np.abs(ours.field - theirs.field)[certain].max() < 1e-11 * (high - low)
    assert np.abs(ours.position - theirs.position)[certain].max() < 1e-10
    assert np.abs(ours.normal - theirs.normal)[certain].max() < 1e-9


#: expressions of every kind: components, curls, symmetric parts, invariants, coordinates
FIELDS = ["u", "vorticity_y", "d(u,y)+d(v,x)", "q_criterion", "p", "x+2*y", "nx"]


@pytest.mark.sampled(least=3, free=("field",))
@pytest.mark.parametrize("field", FIELDS)
def test_turned_and_mirrored_copies_are_those_of_the_reference(data, field):
    options = {"mirror": "-0.3,0,0:1,-0.2,0.1", "turn": "-0.3,-1.3,0:0.1,0,1:3", "faces": "all", "size": 40}
    check_reference(data, field, camera="iso", **options)


@pytest.mark.parametrize(
    ("field", "drawn"),
    [
        ("v", {"faces": "all", "clip": "sphere:2,-2,-2:3.5"}),
        ("d(v,z)+d(w,y)", {"isosurface": "p=1.1", "plane": "2,-2,-2:0.2,1,0.4", "clip": "sphere:2.5,-2,-2:2.5"}),
    ],
)
def test_combined_copies_are_those_of_a_file(data, combined, field, drawn):
    options = {"camera": Camera((14, -12, 9), (2.5, -1.5, -2), fov=38.0), "size": 100}
    compare(render(data, field, **COMBINED, **options, **drawn), render(combined, field, **options, **drawn), 4)


def test_numbers_of_combined_copies_are_those_of_a_file(combined, files):
    words = [*(f"--{name}={own}" for name, own in COMBINED.items()), "--with-copies", "--json"]
    asked = [word for text in ("u", "vorticity_x", "d(u,y)") for word in ("--field", text)]
    points = np.array([np.array([0.3, 0.4, 0.5]) @ matrix.T + shift for matrix, shift in combined_maps()])
    places = [f"--point={','.join(map(repr, point))}" for point in points.tolist()]
    expected = sample(combined, asked[1::2], points)
    for row, *own in zip(json.loads(run("probe", *files, *places, *asked, *words)), *expected.values.T, strict=True):
        assert [row[text] for text in asked[1::2]] == pytest.approx(own, abs=1e-11)
    for row in json.loads(run("integrate", *files, *asked, "--field", "x", *words)):
        assert row["value"] == pytest.approx(integrate(combined, row["integrand"]).value, abs=1e-11)


def test_invariant_quantities_are_recognized():
    names = Names(("u", "v", "w", "p", "W_x", "W_y", "W_z", "uu", "uv", "vv"), dimension=3)
    mirror, turn = Isometry.mirror((0.3, 0, 0), (1, 0, 0)), Isometry.turn((0, 0, 0), (1, 2, 3), 50.0)
    for text, sign in {"p": 1, "u": -1, "v": 1, "W_x": 1, "W_y": -1, "vorticity_x": 1, "vorticity_y": -1}.items():
        own = Expression.parse(text, names)
        found = moved(own, mirror, names).root
        assert found is (own.root if sign > 0 else Expression.parse(f"-({text})", names).root)
    for text in ("p", "q_criterion", "speed", "lambda2", "grad(p)", "laplacian(p)"):
        own = Expression.parse(text, names)
        assert moved(own, turn, names) is own
    # thresholds may hide a difference from every sample
    assert moved(Expression.parse("max(u, -1000)", names), mirror, names).root.op == "max"


@pytest.mark.parametrize("pattern", ["E_{}_{}", "E_{1}_{0}"])
def test_parts_of_complex_vectors_have_the_signs_of_vectors(pattern):
    parts = [pattern.format(axis, part) for axis in "xyz" for part in ("re", "im")]
    velocity = [f"{name}_{part}" for name in "uvw" for part in ("real", "imag")]
    names = Names((*parts, *velocity, "p_re", "p_im"), dimension=3)
    mirror = Isometry.mirror((0.3, 0, 0), (1, 0, 0))
    for own, part in {**dict(zip(parts, parts, strict=True)), "u_imag": "u_imag", "v_real": "v_real"}.items():
        expected = f"-({part})" if part in (*parts[:2], "u_imag") else part
        assert moved(Expression.parse(own, names), mirror, names).root is Expression.parse(expected, names).root
    assert moved(Expression.parse("p_im", names), mirror, names).root is Expression.parse("p_im", names).root


def test_many_copies_take_no_memory(data):
    """The data of 64 copies are those of one; the pool of buffers does not grow from frame to frame."""
    repeat = tuple(Repeat(step, 4) for step in ((1.5, 0, 0), (0, 1.5, 0), (0, 0, 1.5)))
    volume = VolumeRendering(Transfer((0.5, 2.0), (0.0, 4.0)))
    scene = Scene("p", size=(24, 24), objects=(Faces(style=Style(opacity=0.5)), volume))
    with Pictures(data) as pictures:
        alone = pictures.draw(scene)
        many = [pictures.draw(replace(scene, copies=Copies(repeat=repeat))) for _ in range(2)]
        made = pictures.buffers_made
        many.append(pictures.draw(replace(scene, copies=Copies(repeat=repeat))))
        assert pictures.buffers_made == made
    assert [own.stats["bytes"]["volume"] for own in many] == 3 * [alone.stats["bytes"]["volume"]]
    assert len(np.unique(many[0].copy)) > 30
    assert np.array_equal(many[0].field, many[2].field, equal_nan=True)


def test_options_tables_and_words_are_one_scene():
    copies = Copies((Plane((0, 0, 0), (1, 0, 0)),), (Turn((0, 0, 1), 3, (1, 0, 0)),), (Repeat("x", 2),))
    scene = Scene("p", copies=copies)
    assert scene_of(table_of(scene)) == scene
    assert option_words(scene)[2:] == ["--mirror", "0,0,0:1,0,0", "--turn", "1,0,0:0,0,1:3", "--repeat", "x:2"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mirror": "x=0.5"}, r"mirror: the plane .* cuts the domain, which reaches from -0\.5 to 0\.5 across it"),
        ({"repeat": "0.7,0,0:3"}, "copies: copy 1 overlaps copy 0"),
        # no centre of an element lies in the overlap
        ({"repeat": "0.95,0,0:2"}, "copies: copy 1 overlaps copy 0"),
        ({"turn": "z:8"}, "copies: copy 1 overlaps copy 0"),
        ({"repeat": "x:2"}, "repeat: the data declare a period in no direction: expected a vector instead of x"),
        ({"mirror": "x=0", "memory": 1e9}, "copies: not available for data in parts or with a limit of memory"),
        ({"repeat": "1,0,0"}, "repeat: expected VECTOR:COUNT such as 1,0,0:4"),
        ({"repeat": "2,0,0:2000"}, "count of a repetition: expected 2 to 1024"),
    ],
)
def test_bad_input_gives_one_line_error(data, options, message):
    with pytest.raises(SceneError, match=message) as raised:
        render(data, "p", size=20, **options)
    assert "\n" not in str(raised.value)


@pytest.fixture(scope="module")
def files(data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("copies")
    write(data, folder / "half.xml")
    return [str(folder / name) for name in ("half.xml", "half.fld")]


def run(*words):
    result = CliRunner().invoke(group, list(map(str, words)))
    assert result.exit_code == 0, result.output
    return result.stdout


def test_integrals_count_copies(data, mirrored, files):
    """Over a mirror image, as in a file that holds it, and over a row of copies: the volume and the moment of x."""
    words = ("--mirror", "x=0", "--with-copies", "--json")
    fields = ("u", "v", "vorticity_x", "vorticity_z", "q_criterion")
    asked = [word for field in fields for word in ("--field", field)]
    for row in json.loads(run("integrate", *files, *asked, *words)):
        expected = integrate(mirrored, row["integrand"]).value
        assert row["value"] == pytest.approx(expected, abs=1e-11)
    # outward normals: what acts along x on one half, acts against x on the other
    forces = json.loads(run("integrate", *files, "--field", "p*nx", "--field", "p*ny", "--over", "all", *words))
    along, across = (row["value"] for row in forces)
    half = integrate(data, "p*ny", "all").value
    assert abs(half) > 0.1
    assert (along, across) == pytest.approx((0.0, 2.0 * half), abs=1e-12)
    words = ("--field", "x", "--field", "volume", "--repeat", "1,0,0:3", "--with-copies", "--json")
    moment, volume = (row["value"] for row in json.loads(run("integrate", *files, *words)))
    alone = integrate(data, ["x", "volume"])
    assert volume == pytest.approx(3.0 * alone.of("volume").value, rel=1e-13)
    assert moment == pytest.approx(3.0 * alone.of("x").value + 3.0 * alone.of("volume").value, rel=1e-12)


def test_a_range_over_all_steps_is_that_of_copies_in_a_file(tmp_path):
    ends = []
    for count, words in ((1, ("--mirror", "x=0")), (2, ())):
        paths = [tmp_path / f"{count}.xml", *(tmp_path / f"{count}_{step}.fld" for step in range(2))]
        for step, path in enumerate(paths[1:]):
            own = replace(dataset(halves(1.0 + step)[:count]), time=float(step))
            write(own, None if step else paths[0], path)
        look = ("--field", "u", "--range", "series", "--faces", "all", "--size", "16", "--plain")
        run("animate", *paths, *words, *look, "-o", tmp_path / str(count))
        records = json.loads((tmp_path / str(count) / "film.json").read_text())["frames"]
        ends.append([record["range"] for record in records])
    assert np.allclose(*ends, rtol=0, atol=1e-9)
    low, high = ends[0][0]
    assert low == -high < -4


def test_points_in_copies_have_values(files):
    points = [word for x in (0.3, -0.3, 2.0) for word in ("--point", f"{x},0.4,0.5")]
    words = ("--field", "u", "--field", "vorticity_x", "--mirror", "x=0", "--with-copies", "--json")
    here, there, outside = json.loads(run("probe", *files, *points, *words))
    assert (here["copy"], there["copy"], outside["copy"]) == (0, 1, -1)
    assert here["element"] == there["element"]
    assert there["x"] == -0.3
    assert there["u"] == pytest.approx(-here["u"], rel=1e-12)
    assert there["vorticity_x"] == pytest.approx(here["vorticity_x"], rel=1e-12)
    refused = CliRunner().invoke(group, ["probe", *files, "--point", "0,0,0", "--mirror", "x=0"])
    assert refused.exit_code == 2
    assert "expected --mirror, --turn or --repeat together with --with-copies" in " ".join(refused.output.split())


@pytest.mark.parametrize("field", ["u", "S_xx", "S_xz"])
def test_components_are_read_with_those_that_copies_need(data, tmp_path, field):
    """Only the fields that a quantity needs are read; which vector or tensor it belongs to depends on others."""
    scalars = replace(data.field("p"), name="p"), *(replace(data.field("p"), name=f"S_{own}") for own in TENSOR)
    write(replace(data, fields=(*(own for own in data.fields if own.name != "p"), *scalars)), tmp_path / "half.xml")
    files = [str(tmp_path / name) for name in ("half.xml", "half.fld")]
    words = ("--field", field, "--mirror", "x=0", "--with-copies", "--json")
    here, there = json.loads(run("probe", *files, "--point=0.3,0.4,0.5", "--point=-0.3,0.4,0.5", *words))
    # each axis of the mirror in the name of a component changes the sign
    sign = {"u": -1, "S_xx": 1, "S_xz": -1}[field]
    assert there[field] == pytest.approx(sign * here[field], rel=1e-12)
    (row,) = json.loads(run("integrate", *files, *words))
    assert row["value"] == pytest.approx((1 + sign) * integrate(data, field if field == "u" else "p").value, abs=1e-12)
    run("render", *files, *words[:4], "--faces", "all", "--size", "20", "-o", tmp_path / "half.npz")
    with np.load(tmp_path / "half.npz") as picture:
        means = [picture["field"][picture["copy"] == copy].mean() for copy in (0, 1)]
    assert np.sign(means[1]) == sign * np.sign(means[0])


def test_linear_pictures_of_copies_are_those_of_a_file(data, mirrored):
    objects = Faces(style=Style(opacity=0.5)), Isosurface((0.9,), "p"), CutSurface(Plane((0, 0, 0.3), (0, 0, 1)))
    scene = Scene("u", size=(40, 40), camera=CAMERA, objects=objects)
    copies = Copies(mirror=(Plane((0, 0, 0), (1, 0, 0)),))
    ours = compare_scene(data, replace(scene, copies=copies), (0, 1), validation_size=40)
    theirs = compare_scene(mirrored, scene, (0, 1), validation_size=0)
    assert ours.validation.passed
    assert ours.stored == theirs.stored // 2
    for own, other in zip(ours.rivals[:2], theirs.rivals, strict=False):
        assert own.counts == other.counts
        assert np.array_equal(own.record.element, np.where(other.record.element < 0, -1, other.record.element % 4))
        found, expected = ([each.value_max, each.value_mean, each.position_max] for each in (own.errors, other.errors))
        assert found == pytest.approx(expected, rel=1e-9)
        assert min(found) > 1e-4
        (away,), (expected,) = (each.surfaces.values() for each in (own, other))
        assert away.hausdorff == pytest.approx(expected.hausdorff, rel=1e-9)
    assert ours.rivals[2].skipped == "its cells are those of the data, without copies"


def test_declared_periods_are_known(tmp_path):
    mesh = grid(Shape.HEXAHEDRON, 1)
    sides = replace(mesh.composites[1], name=PERIODIC)
    data = Dataset(replace(mesh, composites=(mesh.composites[0], sides)))
    write(data, tmp_path / "box.xml")
    assert "1 along x, 1 along y, 1 along z (--repeat x:COUNT draws several)" in run("info", str(tmp_path / "box.xml"))
    frame = render(data, "x", repeat=["x:3", "y:2"], size=30, camera=CAMERA, faces="element:0")
    assert frame.scene.copies.repeat == (Repeat((1.0, 0.0, 0.0), 3), Repeat((0.0, 1.0, 0.0), 2))
    assert set(np.unique(frame.copy)) <= set(range(-1, 6))
    # a quantity of coordinates is that of the places of the copies
    assert np.abs(frame.field - frame.position[..., 0])[frame.seen].max() < 1e-12
