"""Curves on boundaries: lengths, places, normals and values against closed forms and the theorem of Stokes."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from warps import sector

from elvis import Dataset, ElvisError, Shape, from_arrays, integrate, write
from elvis.core.data.mesh import Composite
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Locator
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Sampler
from elvis.core.streamlines.seeds import SeedPlaces, seed_points
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple
from elvis.core.wall_curves import at_walls, on_walls, wall_curves

SOLIDS = [shape for shape in Shape if shape.dimension == 3]


def plane_name(point, normal):
    return "section:all:plane:" + ":".join(",".join(map(repr, map(float, own))) for own in (point, normal))


def enclosed(curve, normal):
    """Area that a closed curve goes around, and its length: half the integral of normal . (r x dr)."""
    nodes, weights = gauss(12)
    t = np.arange(len(curve.row))[:, None] + (1 + nodes) / 2
    places, slopes = curve.curve.at(t.reshape(-1))
    weights = np.tile(weights / 2, len(curve.row))
    return weights @ (np.cross(places, slopes) @ normal) / 2, weights @ np.linalg.norm(slopes, axis=1)


@pytest.mark.parametrize("shape", SOLIDS)
def test_sections_enclose_the_area_of_the_cut(shape):
    data = Dataset(curved(grid(shape, 2), ripple(0.04), 3))
    point, normal = np.array([0.5, 0.45, 0.52]), np.array([0.3, 0.2, 1.0])
    (curve,), _ = wall_curves(data, plane_name(point, normal))
    assert curve.is_closed
    unit = normal / np.linalg.norm(normal)
    area, length = enclosed(curve, unit)
    name = plane_name(point, normal).removeprefix("section:all:")
    assert area == pytest.approx(integrate(data, "1", over=name).value, rel=1e-10)
    assert curve.length == pytest.approx(length, rel=1e-11)
    assert np.abs((curve.curve.evenly(200)[0] - point) @ unit).max() < 1e-14


def test_a_section_along_edges_of_elements_appears_once():
    """The plane z = 1/2 holds edges of all elements, whose sides meet it nowhere else."""
    for data in (Dataset(grid(Shape.HEXAHEDRON, 2)), Dataset(grid(Shape.TETRAHEDRON, 2))):
        (curve,), _ = wall_curves(data, plane_name((0, 0, 0.5), (0, 0, 1)))
        assert curve.is_closed
        assert curve.length == pytest.approx(4, abs=1e-13)


def test_a_plane_close_to_a_bulge_finds_a_loop_within_one_side():
    """The face z = 1 of one element is a paraboloid, whose tip a plane cuts off: a curve without ends on edges."""

    def bulge(points):
        lifted = points[..., 2] * (
            1 + 0.5 * points[..., 0] * (1 - points[..., 0]) * points[..., 1] * (1 - points[..., 1])
        )
        return np.stack([points[..., 0], points[..., 1], lifted], axis=-1)

    data = Dataset(curved(grid(Shape.HEXAHEDRON, 1), bulge, 3))
    (curve,), _ = wall_curves(data, plane_name((0, 0, 1.03), (0, 0, 1)))
    assert curve.is_closed
    area, _ = enclosed(curve, np.array([0.0, 0.0, 1.0]))
    assert area == pytest.approx(integrate(data, "1", over="plane:0,0,1.03:0,0,1").value, rel=1e-9)


def test_arcs_of_spheres_have_their_length():
    data = Dataset(curved(grid(Shape.HEXAHEDRON, 1), sector, 10))
    curves, _ = wall_curves(data, plane_name((0, 0, 0.2), (0, 0, 1)))
    (curve,) = curves
    radii = np.linalg.norm(curve.curve.evenly(400)[0][:, :2], axis=1)
    outer, inner = np.sqrt(4 - 0.04), np.sqrt(1 - 0.04)
    assert curve.length == pytest.approx(0.5 * (outer + inner) + 2 * (outer - inner), abs=1e-11)
    assert [radii.max(), radii.min()] == pytest.approx([outer, inner], abs=1e-11)


def torus_part(points):
    """The unit cube onto a part of the space between two tori of radius 3, whose tubes have radii from 1 to 1.5."""
    tube, height, angle = 1 + points[..., 2] / 2, 0.6 * points[..., 1], 0.5 * points[..., 0]
    radius = 3 + tube * np.cos(height)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), tube * np.sin(height)], axis=-1)


def test_arcs_of_tori_have_their_length():
    data = Dataset(curved(grid(Shape.HEXAHEDRON, 1), torus_part, 10))
    (curve,), _ = wall_curves(data, plane_name((0, 0, 0.3), (0, 0, 1)))
    inner, outer = (3 + np.sqrt(tube**2 - 0.09) for tube in (1, 1.5))
    assert curve.length == pytest.approx(0.5 * (outer + inner) + 2 * (outer - inner), abs=1e-11)


def with_wall(mesh, at_wall):
    """A mesh with the boundary ``wall`` of those faces, edges in 2D, all of whose vertices are among some."""
    if mesh.dimension == 2:
        sides, letter = mesh.of(Shape.SEGMENT), "E"
        rows = np.flatnonzero(at_wall(mesh.vertices[sides.members]).all(axis=1))
    else:
        sides, letter = mesh.of(Shape.QUADRILATERAL), "F"
        corners = mesh.of(Shape.SEGMENT).members[sides.members].reshape(len(sides.ids), -1)
        rows = np.flatnonzero(at_wall(mesh.vertices[corners]).all(axis=1))
    return replace(mesh, composites=(*mesh.composites, Composite(100, ((letter, sides.ids[rows]),), "wall")))


def test_pressure_coefficients_along_a_cylinder():
    """Potential flow about the unit circle: Cp = 1 - 4 sin^2 at the angle from the axis of the flow."""
    mesh = with_wall(grid(Shape.QUADRILATERAL, 3), lambda p: p[..., 0] == 0)

    def ring(points):
        radius, angle = 1 + points[..., 0], np.pi * points[..., 1]
        return np.stack([-radius * np.cos(angle), radius * np.sin(angle), 0 * radius], axis=-1)

    def pressure(points):
        inverse = 1 / (points[:, 0] + 1j * points[:, 1]) ** 2
        return 0.5 - 0.5 * np.abs(1 - inverse) ** 2

    data = Dataset(curved(mesh, ring, 16))
    data = Dataset(data.mesh, (approximated(data, "p", pressure, 18),))
    table = on_walls(data, "boundary:wall", [Expression.of(data, "2*p")], 300)
    sine = np.sin(table["length"])
    assert np.abs(table["2*p"] - (1 - 4 * sine**2)).max() <= 1e-10
    assert table["x/c"] == pytest.approx((1 - np.cos(table["length"])) / 2, abs=1e-11)


def test_forces_of_sections_add_up_to_the_force():
    """Walls lean, so that strips between sections are wider than their distance."""

    def leaning(points):
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        return np.stack([x + 0.3 * z**2, y - 0.4 * z * (1 - x) + 0.1 * x**2, z], axis=-1)

    def is_lateral(corners):
        return ((corners[..., :2] == 0) | (corners[..., :2] == 1)).any(axis=-1) & ~_is_flat(corners)

    mesh = curved(with_wall(grid(Shape.HEXAHEDRON, 1), is_lateral), leaning, 3)
    data = Dataset(mesh)
    data = Dataset(mesh, (approximated(data, "p", lambda p: p[:, 0] ** 2 + p[:, 1] * p[:, 2], 6),))
    nodes, weights = gauss(5)
    names = [f"section:wall:plane:0,0,{(1 + node) / 2!r}:0,0,2" for node in nodes.tolist()]
    wanted = ["pressure_force", "moment", "length"]
    found = integrate(data, wanted, names, coefficients="2,1,0.5,xy")
    whole = integrate(data, wanted[:2], "wall", coefficients="2,1,0.5,xy")
    for row in whole:
        sections = [found.of(row.integrand, name).value for name in names]
        assert weights @ sections / 2 == pytest.approx(row.value, abs=1e-11), row.integrand
    assert found.of("length", names[0]).measure == pytest.approx(wall_curves(data, names[0])[0][0].length, rel=1e-12)
    # all else is an integral by length
    assert integrate(data, "nx^2+ny^2+nz^2", names[0]).value == pytest.approx(found.of("length", names[0]).value)
    assert integrate(data, "area", "boundary:wall").value == integrate(data, "area", "wall").value


def test_seeds_along_curves():
    data = Dataset(curved(grid(Shape.HEXAHEDRON, 1), sector, 10))
    places = SeedPlaces.of(data, Locator(patches(data)))
    circle = seed_points(places, "circle:0,0,1.2:0,0,1:0.2:9")
    assert len(circle) == 9
    assert np.linalg.norm(circle[:, :2], axis=1) == pytest.approx(0.2)
    section = seed_points(places, plane_name((0, 0, 0.2), (0, 0, 1)) + ":60")
    assert len(section) == 60
    assert section[:, 2] == pytest.approx(0.2, abs=1e-13)
    assert (places.locator.locate(section).status == Status.INSIDE).all()
    for wrong in ("circle:0,0,0:0,0,1:1", "section:all:plane:0,0,0.2:0,0,1:1", "spline:0,0:1,1:x"):
        with pytest.raises(ElvisError, match=r"expected seeds as .*, N from 2 to"):
            seed_points(places, wrong)


def _is_flat(corners):
    """Whether all corners (n, k, 3) of a face have the same z."""
    return np.repeat(np.ptp(corners[..., 2], axis=-1)[:, None] == 0, corners.shape[1], axis=1)


def test_walls_of_plane_data_in_order():
    """The outline of a square, counter-clockwise from the largest x, and values there."""
    data = Dataset(grid(Shape.QUADRILATERAL, 2))
    field = approximated(data, "u", lambda p: p[:, 0] ** 2 - p[:, 1], 3)
    data = Dataset(data.mesh, fields=(field,))
    table = on_walls(data, "boundary:all", [Expression.of(data, text) for text in ("u", "d(u,x)*nx+d(u,y)*ny")], 401)
    places = np.column_stack([table[axis] for axis in "xyz"])
    assert table["length"][-1] == pytest.approx(4, abs=1e-14)
    assert places[0] == pytest.approx([1, 0, 0], abs=1e-15)
    assert places[100] == pytest.approx([1, 1, 0], abs=1e-14)
    assert table["u"] == pytest.approx(places[:, 0] ** 2 - places[:, 1], abs=1e-13)
    right = slice(1, 99)
    assert table["nx"][right] == pytest.approx(1, abs=1e-14)
    assert table["d(u,x)*nx+d(u,y)*ny"][right] == pytest.approx(2, abs=1e-12)
    assert table["d(u,x)*nx+d(u,y)*ny"][101:199] == pytest.approx(-1, abs=1e-12)
    # the chord is a diagonal
    assert table["x/c"].min() == pytest.approx(0, abs=1e-14)
    assert table["x/c"].max() == pytest.approx(1, abs=1e-14)


def test_curved_walls_have_the_length_of_their_integral():
    data = Dataset(curved(grid(Shape.TRIANGLE, 3), ripple(0.05), 4))
    (curve,), _ = wall_curves(data, "boundary:all")
    assert curve.length == pytest.approx(integrate(data, "1", over="all", error=1e-12).value, rel=1e-11)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("boundary:all", "expected 2D data, found 3D; section:NAME:plane:P:N"),
        ("section:all", "expected section:NAME:plane:P:N, such as"),
        ("section:all:plane:0,0,0:0,0,0", "expected section:NAME:plane:P:N"),
        ("section:all:plane:0,0,9:0,0,1", "the plane does not intersect all"),
        ("section:all:plane:0,0,1:0,0,1", "the plane holds .* sides of all"),
        ("section:wng:plane:0,0,1:0,0,1", "there is no boundary 'wng'"),
    ],
)
def test_invalid_curves_are_reported(name, reason):
    with pytest.raises(ElvisError, match=reason):
        wall_curves(Dataset(mixed_volume(0)), name)


def test_a_plane_that_touches_a_side_is_reported():
    def bulge(points):
        return points + np.stack(
            [0 * points[..., 0], 0 * points[..., 0], 0.5 * points[..., 0] * (1 - points[..., 0])], -1
        )

    data = Dataset(curved(grid(Shape.HEXAHEDRON, 1), bulge, 3))
    with pytest.raises(ElvisError, match=r"the plane touches a side of all near \(0.5, .*move it a little"):
        wall_curves(data, plane_name((0, 0, 1.125), (0, 0, 1)))


def test_the_command(tmp_path, monkeypatch):
    from elvis.plugins.command.command import elvis

    monkeypatch.chdir(tmp_path)
    data = Dataset(grid(Shape.HEXAHEDRON, 1))
    write(Dataset(data.mesh, fields=(approximated(data, "p", lambda x: x[:, 0] * x[:, 1], 3),)), "a.xml")
    (tmp_path / "measured.csv").write_text("where,what\n0.2,0.1\n0.8,0.4\n")
    words = ["probe", "a.xml", "a.fld", "--along", "section:all:plane:0,0,0.25:0,0,1", "--field", "p", "-n", "41"]
    found = CliRunner().invoke(elvis, [*words, "--chord", "0,0:1,0"])
    assert found.exit_code == 0, found.output
    rows = [line.split(",") for line in found.output.splitlines()]
    assert rows[0] == ["point", "length", "x/c", "x", "y", "z", "nx", "ny", "nz", "element", "status", "p"]
    assert len(rows) == 42
    values = np.array(rows[1:], float)
    assert values[:, 11] == pytest.approx(values[:, 3] * values[:, 4], abs=1e-13)
    assert values[:, 2] == pytest.approx(values[:, 3], abs=1e-13)
    found = CliRunner().invoke(elvis, [*words, "--chord", "0,0:0,0", "-o", "a.csv"])
    assert found.exit_code == 1
    assert "expected a chord with two different ends" in str(found.exception)
    assert not (tmp_path / "a.csv").exists()
    plot = ["--plot", "p.svg", "--x", "x/c", "--reverse", "--overlay", "measured.csv:where,what"]
    assert CliRunner().invoke(elvis, [*words, *plot]).exit_code == 0
    text = (tmp_path / "p.svg").read_text()
    assert ">measured.csv<" in text
    assert ">x/c<" in text
    # the axis may be named
    named = [own.replace("p.svg", "q.svg") for own in plot]
    named.insert(named.index("--reverse") + 1, "y")
    assert CliRunner().invoke(elvis, [*words, *named]).exit_code == 0
    (tmp_path / "q.svg").unlink()
    both = [*words, "--along", "section:all:plane:0,0,0.75:0,0,1", "--plot", "both.svg"]
    assert CliRunner().invoke(elvis, [*both, "-o", "both.csv"]).exit_code == 0
    with (tmp_path / "both.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [row["curve"] for row in table] == ["0"] * 41 + ["1"] * 41
    assert [int(row["point"]) for row in table] == list(range(82))
    assert [float(row["z"]) for row in table] == pytest.approx([0.25] * 41 + [0.75] * 41)
    assert (tmp_path / "both.svg").read_text().count(">section:all:plane:0,0,0.") == 2
    data = Dataset(grid(Shape.HEXAHEDRON, 2))
    write(Dataset(data.mesh, fields=(approximated(data, "p", lambda x: 2 * x[:, 0] * x[:, 1], 3),)), "b.xml")
    two = [*words, "--other", "ref=b.xml,b.fld", "--along", "ref:section:all:plane:0,0,0.25:0,0,1", "-o", "two.csv"]
    assert CliRunner().invoke(elvis, two).exit_code == 0
    with (tmp_path / "two.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [row["along"].partition(":")[0] for row in table] == ["section"] * 41 + ["ref"] * 41
    factors = np.repeat([1, 2], 41)
    products = np.array([float(row["x"]) * float(row["y"]) for row in table])
    # places are known to 1e-13, and the larger of both fields changes by up to 4 a unit
    assert np.array([float(row["p"]) for row in table]) == pytest.approx(factors * products, abs=4e-13)
    for wrong, reason in [
        (["--along", "line:0,0,0:1,1,1"], "expected only curves on boundaries, or none of them, found both"),
        (["--layers", "p"], "expected --layers with --along normal:"),
        (["--snap", "all"], "expected --snap without --along"),
        (["--plot", "q.svg", "--x", "xc"], "there is no column 'xc'"),
        (["--x", "x"], "expected --x, --reverse, --overlay and --profiles with --plot"),
        (["--plot", "q.svg", "--profiles", "1"], "expected --profiles with --along normal:"),
        (["--plot", "q.svg", "--profiles", "0"], "expected auto or a positive number"),
        (["--all"], "without --all and --clip"),
        (["--point", "0,0,0"], "expected --along without other points"),
        (["--plot", "q.svg", "--overlay", "measured.csv:where,who"], "expected a column, one of where, what"),
    ]:
        done = CliRunner().invoke(elvis, [*words, *wrong])
        assert done.exit_code != 0
        assert reason in f"{done.output}{done.exception}", wrong
    assert not (tmp_path / "q.svg").exists()


def test_profiles_stand_at_their_stations(tmp_path, monkeypatch):
    """The profile of u = x + y over the floor y = 0 of a square at x = 0.2 and 0.6, from a table, in one call."""
    from elvis.renderer.commands.probe.curves import ProbeCurves
    from elvis.renderer.commands.probe.look import Look

    monkeypatch.chdir(tmp_path)
    bare = Dataset(with_wall(grid(Shape.QUADRILATERAL, 2), lambda corners: corners[..., 1] == 0))
    data = Dataset(bare.mesh, fields=(approximated(bare, "u", lambda x: x[:, 0] + x[:, 1], 2),))
    (tmp_path / "stations.csv").write_text("x,y\n0.2,0\n0.6,0\n")
    own = ProbeCurves(("normal:wall:stations.csv:0.5",), None, None, Look(profiles=0.1))
    table = own.table(
        data,
        ["u"],
        11,
        lambda dataset, points: Sampler(dataset, [Expression.of(dataset, "u")]).sample(points).columns(),
    )
    plot = own.look.along(table)
    figure = plot._figure()
    curves = [line.get_xydata() for line in figure.axes[0].lines[1::2]]
    for station, curve in zip((0.2, 0.6), curves, strict=True):
        assert curve[:, 1] == pytest.approx(np.linspace(0, 0.5, 11), abs=1e-14)
        assert curve[:, 0] == pytest.approx(station + 0.1 * (station + curve[:, 1]), abs=1e-14)


def test_points_snap_to_walls_at_the_analytic_distance(tmp_path, monkeypatch):
    """Points around a part of a ball, which come to the sphere along its normals."""
    from elvis.plugins.command.command import elvis

    monkeypatch.chdir(tmp_path)
    mesh = with_wall(grid(Shape.HEXAHEDRON, 1), lambda corners: corners[..., 2] == 1)
    data = Dataset(curved(mesh, sector, 7))
    data = Dataset(data.mesh, (approximated(data, "p", lambda x: x[:, 0] * x[:, 1] - x[:, 2], 7),))
    rng = np.random.default_rng(3)
    towards = sector(np.column_stack([rng.uniform(0, 1, (40, 2)), np.ones(40)])) / 2
    radii = rng.uniform(1.6, 2.3, 40)
    texts = ("p", "nx*x+ny*y+nz*z", "d(p,x)*nx+d(p,y)*ny+d(p,z)*nz")
    table = at_walls(data, "wall", radii[:, None] * towards, [Expression.of(data, text) for text in texts])
    places = np.column_stack([table[axis] for axis in "xyz"])
    assert np.abs(places - 2 * towards).max() < 1e-7
    assert np.abs(np.linalg.norm(places, axis=1) - 2).max() < 1e-8
    assert table["distance"] == pytest.approx(np.abs(radii - 2), abs=1e-7)
    assert table["p"] == pytest.approx(places[:, 0] * places[:, 1] - places[:, 2], abs=1e-7)
    assert table[texts[1]] == pytest.approx(2, abs=1e-7)
    assert (table["status"] == Status.INSIDE).all()
    # the element behind the wall, not one next to it
    assert table[texts[2]] == pytest.approx((2 * places[:, 0] * places[:, 1] - places[:, 2]) / 2, abs=1e-5)
    write(data, "ball.xml")
    found = CliRunner().invoke(elvis, ["probe", "ball.xml", "ball.fld", "--point", "2.4,0.6,0.4", "--snap", "wall"])
    assert found.exit_code == 0, found.output
    assert found.output.startswith("point,distance,x,y,z,nx,ny,nz,element,status,p\n0,0.505992")
    missing = CliRunner().invoke(elvis, ["probe", "ball.xml", "ball.fld", "--point", "1,0,2", "--snap", "wal"])
    assert missing.exit_code != 0
    assert "there is no boundary 'wal'" in f"{missing.output}{missing.exception}"


def test_boundary_layers_at_stations(tmp_path, monkeypatch):
    """u = U (2 s - s^2), s = y/d, up to the height d = 0.1 (1 + x): delta99 = 0.9 d, delta* = d/3, theta = 2 d/15."""
    from elvis.plugins.command.command import elvis

    monkeypatch.chdir(tmp_path)
    mesh = with_wall(grid(Shape.QUADRILATERAL, 2), lambda p: p[..., 1] == 0)

    def stretched(points):
        return np.stack([points[..., 0], points[..., 1] * 0.1 * (1 + points[..., 0]), 0 * points[..., 0]], axis=-1)

    mesh = curved(mesh, stretched, 2)
    height = lambda p: p[:, 1] / (0.1 * (1 + p[:, 0]))  # noqa: E731
    speed = approximated(Dataset(mesh), "u", lambda p: 3 * (2 * height(p) - height(p) ** 2), 3)
    write(Dataset(mesh, (speed,)), "plate.xml")
    (tmp_path / "stations.csv").write_text("x,y\n0.25,0.01\n0.75,0.01\n")
    words = ["probe", "plate.xml", "plate.fld", "--layers", "u", "--along"]
    rows = []
    for x in (0.25, 0.75):
        found = CliRunner().invoke(elvis, [*words, f"normal:wall:{x},0.01:{0.1 * (1 + x)}", "--json"])
        assert found.exit_code == 0, found.output
        rows += json.loads(found.output)
    for row in rows:
        d = 0.1 * (1 + row["x"])
        assert row["edge"] == pytest.approx(3, rel=1e-12)
        assert [row["delta99"], row["displacement"], row["momentum"]] == pytest.approx([0.9 * d, d / 3, 2 * d / 15])
        assert row["shape"] == pytest.approx(2.5, rel=1e-9)
    both = CliRunner().invoke(elvis, [*words, "normal:wall:stations.csv:0.12", "--plot", "d.svg", "-o", "d.csv"])
    assert both.exit_code == 0, both.output
    assert len((tmp_path / "d.csv").read_text().splitlines()) == 3
    assert ">momentum<" in (tmp_path / "d.svg").read_text()
    wrong = CliRunner().invoke(elvis, [*words, "normal:wall:0.5,0.01:9"])
    assert wrong.exit_code != 0
    assert "expected a speed at the end of the curve" in f"{wrong.output}{wrong.exception}"


def test_boundaries_called_boundary_have_normals_too(tmp_path, monkeypatch):
    from elvis.plugins.command.command import elvis

    monkeypatch.chdir(tmp_path)
    data = from_arrays({"quadrilateral": [[[0, 0], [1, 0], [0, 1], [1, 1]]]}, u=[[0, 0, 1, 1]])
    write(data, "a.xml")
    words = ["probe", "a.xml", "a.fld", "--field", "twice=2*u", "-n", "3", "--json", "--along"]
    found = CliRunner().invoke(elvis, [*words, "normal:boundary:0.5,0.1:1"])
    assert found.exit_code == 0, found.output
    assert [row["twice"] for row in json.loads(found.output)] == pytest.approx([0, 1, 2])
    found = CliRunner().invoke(elvis, [*words, "normal:boundary:0.5,0.1:1", "--field", "twice=u"])
    assert "expected each name once, found 'twice' again" in str(found.exception)
