"""Values at scattered points on a mesh: exact for the functions that each interpolation contains."""

import numpy as np
import pytest

from elvis import Dataset, ElvisError, Shape, read, sample, write
from elvis.core.numbers.queries import points_in_table, values_in_table
from elvis.core.testing import curved, grid, scattered
from elvis.plugins.transfers.scattered_points import points_onto_mesh

LINEAR = {Shape.SEGMENT: lambda x: 2 - 3 * x[:, 0], Shape.TRIANGLE: lambda x: 1 + 2 * x[:, 0] - x[:, 1]}
LINEAR[Shape.TETRAHEDRON] = lambda x: 1 + 2 * x[:, 0] - x[:, 1] + 0.5 * x[:, 2]


def table(path, axes, function, count=200, low=-0.1, high=1.1):
    """Points in a box with its corners, and a function there."""
    rng = np.random.default_rng(5)
    corners = np.stack(np.meshgrid(*[[low, high]] * len(axes)), axis=-1).reshape(-1, len(axes))
    points = np.concatenate([corners, rng.uniform(low, high, (count, len(axes)))])
    lines = [
        ",".join(map(repr, [*row.tolist(), float(value)])) for row, value in zip(points, function(points), strict=True)
    ]
    path.write_text("\n".join([f"# {', '.join(axes)}, u", *lines]) + "\n")
    return path


def error(dataset, shape, function):
    places = 0.05 + 0.9 * (scattered(Shape.HEXAHEDRON, 50) + 1) / 2
    places[:, shape.dimension :] = 0
    return np.abs(sample(dataset, ["u"], places).values[:, 0] - function(places)).max()


@pytest.mark.parametrize("kind", ["linear", "spline"])
@pytest.mark.parametrize("shape", list(LINEAR))
def test_linear_functions_are_exact(tmp_path, shape, kind):
    file = table(tmp_path / "p.csv", "xyz"[: shape.dimension], LINEAR[shape])
    found, report = points_onto_mesh(file, Dataset(grid(shape, 2)), 2, "error", kind)
    assert error(found, shape, LINEAR[shape]) < 1e-11
    assert report.fields[0].is_exact
    assert "at points left out of the interpolation: off by up to" in report.notes[-1]


def test_a_profile_holds_along_other_coordinates(tmp_path):
    """A cubic spline through a cubic polynomial is this polynomial; on curved elements its error is measured."""
    file = table(tmp_path / "p.csv", "y", lambda y: y[:, 0] ** 3, count=20)
    mesh = curved(grid(Shape.QUADRILATERAL, 2), lambda x: x + 0.04 * np.sin(3 * x[..., [1, 0, 2]]) * [1, 1, 0], 3)
    found, report = points_onto_mesh(file, Dataset(mesh), 9, "error", "spline")
    assert error(found, Shape.QUADRILATERAL, lambda x: x[:, 1] ** 3) < 1e-11
    assert report.fields[0].is_exact


def test_smooth_functions_converge_and_the_estimate_is_of_their_error(tmp_path):
    errors, estimates = [], []
    for count in (400, 1600):
        file = table(tmp_path / "p.csv", "xy", lambda x: np.sin(3 * x[:, 0] + x[:, 1]), count)
        found, report = points_onto_mesh(file, Dataset(grid(Shape.QUADRILATERAL, 8)), 3, "error", "linear")
        errors.append(error(found, Shape.QUADRILATERAL, lambda x: np.sin(3 * x[:, 0] + x[:, 1])))
        estimates.append(float(report.notes[-1].split("off by up to ")[1].split(",")[0]))
    assert errors[1] < errors[0] / 2
    assert all(0.1 < estimate / own < 10 for estimate, own in zip(estimates, errors, strict=True))


def test_places_outside_the_hull(tmp_path):
    file = table(tmp_path / "p.csv", "xy", lambda x: 1 + 0 * x[:, 0], low=0.0, high=0.5)
    target = Dataset(grid(Shape.QUADRILATERAL, 2))
    with pytest.raises(ElvisError, match=r"p.csv don't cover the mesh, as at 0\..*use --outside nearest"):
        points_onto_mesh(file, target, 1, "error", "linear")
    near, report = points_onto_mesh(file, target, 1, "nearest", "spline")
    assert error(near, Shape.QUADRILATERAL, lambda x: 1 + 0 * x[:, 0]) < 1e-12
    assert "of the places on the mesh lie outside the hull of the points" in report.notes[0]
    far, _ = points_onto_mesh(file, target, 1, "3", "linear")
    assert sample(far, ["u"], np.array([[0.25, 0.25, 0], [0.75, 0.75, 0]])).values[:, 0] == pytest.approx([1, 3])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x,y,u\n0,0,1\n1,1,2\n2,2,3\n", "expected points that span x and y"),
        ("x,y,u\n0,0,1\n1,a,2\n", "line 3: expected 3 numbers, found 1,a,2"),
        ("0,0,1\n1,1,2\n", "expected columns x, y or z and values"),
        ("x,y,u\n0,0,nan\n", "expected at least one row of finite numbers"),
        ("x,y,z,u\n0,0,0,1\n1,1,1,2\n", "expected coordinates of the mesh, found z"),
        ("", "found an empty file"),
        ('<POINTS DIM="2" FIELDS="u"> 1 2 3 4 </POINTS>', "expected a multiple of 3 numbers in POINTS, found 4"),
        ('<POINTS DIM="5" FIELDS="u"> 1 2 3 4 </POINTS>', "expected DIM from 1 to 3, found '5'"),
    ],
)
def test_unusable_tables_are_reported(tmp_path, text, expected):
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(ElvisError, match=expected):
        points_onto_mesh(tmp_path / "p.csv", Dataset(grid(Shape.TRIANGLE, 1)), 1, "nearest", "linear")


def test_the_command_reads_what_export_writes(tmp_path, elvis, elvis_json):
    """Gauss points of every element in a .pts file, back onto the mesh, and as points of a probe."""
    file = table(tmp_path / "p.csv", "xy", LINEAR[Shape.TRIANGLE])
    mesh = write(Dataset(grid(Shape.TRIANGLE, 2)), tmp_path / "b.xml")
    elvis("convert", file, "--onto", *mesh, "--order", "2", "-o", tmp_path / "u.fld")
    elvis("export", *mesh, tmp_path / "u.fld", "-o", tmp_path / "q.pts")
    report = elvis_json(
        "convert", tmp_path / "q.pts", "--onto", f"{mesh[0]},{tmp_path / 'u.fld'}", "--outside", "nearest", "-o",
        tmp_path / "v.fld", "--interpolation", "spline",
    )  # fmt: skip
    assert report["fields"]["u"]["order"] == 2
    assert error(read(mesh[0], tmp_path / "v.fld"), Shape.TRIANGLE, LINEAR[Shape.TRIANGLE]) < 0.2
    points, values = points_in_table(tmp_path / "q.pts"), values_in_table(tmp_path / "q.pts")
    assert np.array_equal(points[:, :2], values.points)
    assert values.values[:, 0] == pytest.approx(LINEAR[Shape.TRIANGLE](points), abs=1e-12)
