"""Curves on boundaries: lengths, places, normals and values against closed forms and the theorem of Stokes."""

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import Dataset, ElvisError, Shape, integrate, write
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities import Expression
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple
from elvis.core.wall_curves import on_walls, wall_curves

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


def test_a_section_along_edges_of_elements_is_there_once():
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


def sector(points):
    """The unit cube onto a part of a ball between the radii 1 and 2."""
    radius, height, angle = 1 + points[..., 2], 1.2 + 0.4 * points[..., 1], 0.5 * points[..., 0]
    flat = radius * np.sin(height)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), radius * np.cos(height)], axis=-1)


def test_arcs_of_spheres_have_their_length():
    data = Dataset(curved(grid(Shape.HEXAHEDRON, 1), sector, 10))
    curves, _ = wall_curves(data, plane_name((0, 0, 0.2), (0, 0, 1)))
    (curve,) = curves
    radii = np.linalg.norm(curve.curve.evenly(400)[0][:, :2], axis=1)
    outer, inner = np.sqrt(4 - 0.04), np.sqrt(1 - 0.04)
    assert curve.length == pytest.approx(0.5 * (outer + inner) + 2 * (outer - inner), abs=1e-11)
    assert [radii.max(), radii.min()] == pytest.approx([outer, inner], abs=1e-11)


def test_walls_of_plane_data_in_order():
    """The outline of a square, counter-clockwise from the greatest x, and values there."""
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


def test_bent_walls_are_as_long_as_their_integral():
    data = Dataset(curved(grid(Shape.TRIANGLE, 3), ripple(0.05), 4))
    (curve,), _ = wall_curves(data, "boundary:all")
    assert curve.length == pytest.approx(integrate(data, "1", over="all", error=1e-12).value, rel=1e-11)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("boundary:all", "expected 2D data, found 3D; section:NAME:plane:P:N"),
        ("section:all", "expected section:NAME:plane:P:N, such as"),
        ("section:all:plane:0,0,0:0,0,0", "expected section:NAME:plane:P:N"),
        ("section:all:plane:0,0,9:0,0,1", "the plane does not meet all"),
        ("section:all:plane:0,0,1:0,0,1", "the plane holds .* sides of all"),
        ("section:wng:plane:0,0,1:0,0,1", "there is no boundary 'wng'"),
    ],
)
def test_what_is_no_curve_is_said(name, reason):
    with pytest.raises(ElvisError, match=reason):
        wall_curves(Dataset(mixed_volume(0)), name)


def test_a_plane_that_touches_a_side_is_said():
    def bulge(points):
        return points + np.stack(
            [0 * points[..., 0], 0 * points[..., 0], 0.5 * points[..., 0] * (1 - points[..., 0])], -1
        )

    data = Dataset(curved(grid(Shape.HEXAHEDRON, 1), bulge, 3))
    with pytest.raises(ElvisError, match=r"the plane touches a side of all near \(0.5, .*move it a little"):
        wall_curves(data, plane_name((0, 0, 1.125), (0, 0, 1)))


def test_the_command(tmp_path, monkeypatch):
    from elvis.plugins.command import elvis

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
    plot = ["--plot", "p.svg", "--x", "x/c", "--reverse", "--overlay", "measured.csv:where,what"]
    assert CliRunner().invoke(elvis, [*words, *plot]).exit_code == 0
    text = (tmp_path / "p.svg").read_text()
    assert ">measured.csv<" in text
    assert ">x/c<" in text
    for wrong, reason in [
        (["--plot", "q.svg", "--x", "xc"], "there is no column 'xc'"),
        (["--x", "x"], "expected --x, --reverse and --overlay with --plot"),
        (["--all"], "without --all and --clip"),
        (["--plot", "q.svg", "--overlay", "measured.csv:where,who"], "expected a column, one of where, what"),
    ]:
        done = CliRunner().invoke(elvis, [*words, *wrong])
        assert done.exit_code != 0
        assert reason in f"{done.output}{done.exception}", wrong
    assert not (tmp_path / "q.svg").exists()
