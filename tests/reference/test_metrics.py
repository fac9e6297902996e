"""Numbers about two pictures, against what was put into them."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Camera, Dataset, Plane
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid
from elvis.reference.baseline.distances import surface_distance, topology
from elvis.reference.baseline.linear_drawing import Baseline
from elvis.reference.cameras import same_camera
from elvis.reference.contours import crossings, displacement
from elvis.reference.metrics import check_comparable, errors
from elvis.reference.quantities import Quantities
from elvis.reference.record import CHANNELS, Record
from elvis.reference.tolerances import check_tolerances
from elvis.scene import Isosurface
from elvis.scene.cameras.view import PlaneView

PARALLEL = Camera((0.5, 0.5, 3.0), (0.5, 0.5, 0.0), (0.0, 1.0, 0.0), height=1.2)
NEAR = Camera((0.4, -1.0, 2.0), (0.5, 0.5, 0.0), fov=40.0)
FLOOR = Plane((0, 0, 0), (0, 0, 1))


def picture(function, camera=PARALLEL, plane=FLOOR, size=(90, 80)):
    """The record of a function on the unit square of a plane."""
    view = PlaneView.of(camera, plane, size)
    points = view.points()
    seen = ((points[..., :2] > 0) & (points[..., :2] < 1)).all(axis=2)
    depth = np.where(seen, view.depth_of(points), np.inf)
    points = np.where(seen[..., None], points, np.nan)
    field = np.where(seen, function(points[..., 0], points[..., 1]), np.nan)
    normal = np.where(seen[..., None], view.normal(), np.nan)
    return Record(np.zeros((*seen.shape, 3)), depth, field, np.where(seen, 7, -1), points, points, normal, seen * 1)


def steep(x, y):
    return 2 * x + y


def changed(record, **pixels):
    """The record with some channels changed at (row, column)."""
    new = {name: getattr(record, name).copy() for name in CHANNELS}
    for name, ((row, column), value) in pixels.items():
        new[name][row, column] = value
    return Record(**new)


def test_a_picture_equals_itself():
    record = picture(steep)
    found = errors(record, record, contours=(1.0,))
    assert (found.value_max, found.off, found.missing, found.spurious, found.position_max) == (0, 0, 0, 0, 0)
    assert found.worst is None
    assert found.contour_max == 0
    assert all(check.passed for check in check_tolerances(record, record))


def test_one_wrong_value_is_located():
    record = picture(steep)
    low, high = np.nanmin(record.field), np.nanmax(record.field)
    wrong = changed(record, field=((30, 40), record.field[30, 40] + 0.25 * (high - low)))
    found = errors(record, wrong)
    assert found.value_max == pytest.approx(0.25)
    assert found.value_mean == pytest.approx(0.25 / record.seen.sum())
    assert found.off == pytest.approx(100 / record.seen.sum())
    assert (found.worst.row, found.worst.column, found.worst.element) == (30, 40, 7)
    assert found.worst.position == tuple(record.position[30, 40])

    # the numbers of the tolerances, and what they name
    by_name = {check.name: check for check in check_tolerances(record, wrong)}
    assert [name for name, check in by_name.items() if not check.passed] == ["field value"]
    assert (by_name["field value"].failed, by_name["field value"].worst) == (1, found.worst)


@pytest.mark.parametrize(("part", "passed"), [(0.9e-11, True), (1.1e-11, False)])
def test_the_tolerance_of_values_matches_the_design(part, passed):
    record = picture(lambda x, y: x, size=(60, 60))
    ends = (0.0, 1.0)
    other = changed(record, field=((30, 30), record.field[30, 30] + part))
    assert check_tolerances(record, other, ends)[0].passed == passed
    moved = changed(record, position=((30, 30), record.position[30, 30] + [0, 0, 10 * part]))
    assert check_tolerances(record, moved, ends, diagonal=1.0)[1].passed == passed


@pytest.mark.parametrize(("steps", "passed"), [(2, True), (200, False)])
def test_rounding_of_large_numbers_is_not_a_failure(steps, passed):
    """A field of 1e9 that varies by 1e2, 1e7 away: two steps of its numbers are more than 1e-11 of the range."""
    record = picture(lambda x, y: 1e9 + 100 * x, size=(60, 60))
    away = replace(record, position=record.position + 1e7)
    value, place = away.field[30, 30], away.position[30, 30]
    assert np.spacing(value) > 1e-11 * 100
    other = changed(away, field=((30, 30), value + steps * np.spacing(value)))
    assert check_tolerances(away, other)[0].passed == passed
    moved = changed(away, position=((30, 30), place + steps * np.spacing(place)))
    assert check_tolerances(away, moved)[1].passed == passed


def test_missing_spurious_and_foreign_pixels_are_counted():
    record = picture(steep)
    row, column = np.argwhere(~record.seen)[0]
    other = changed(record, element=((30, 40), -1), field=((30, 40), np.nan))
    other = changed(other, element=((30, 44), -1), field=((30, 44), np.nan))
    other = changed(other, element=((row, column), 9), field=((row, column), 1.0))
    other = changed(other, element=((31, 41), 8))
    found = errors(record, other)
    assert (found.missing, found.spurious, found.elements) == (2, 1, 1)
    assert {check.name: check.failed for check in check_tolerances(record, other) if not check.passed} == {
        "coverage": 3,
        "element": 1,
    }
    doubtful = changed(changed(other, status=((30, 40), 2)), status=((row, column), 2))
    doubtful = changed(doubtful, status=((30, 44), 2))
    doubtful = changed(doubtful, status=((31, 41), 2))
    assert all(check.passed for check in check_tolerances(record, doubtful))
    failed = changed(record, status=((5, 5), 3))
    assert [check.name for check in check_tolerances(record, failed) if not check.passed] == ["failed pixels"]


@pytest.mark.parametrize("shift", [0.0, 0.3, 2.5])
def test_contours_are_displaced_by_the_field_error(shift):
    """The contour of x at 1/2, moved by a part of a pixel or by several."""
    record = picture(lambda x, y: x, size=(120, 120))
    pixel = 1.2 / 120
    other = picture(lambda x, y: x - shift * pixel, size=(120, 120))
    found = displacement(record, other, 0.5)
    assert found.maximum == pytest.approx(shift, abs=1e-9)
    assert found.mean == pytest.approx(shift, abs=1e-9)
    at = crossings(record, 0.5)
    assert np.ptp(at[:, 1]) < 1e-9
    assert errors(record, other, pixel=pixel).value_mean == pytest.approx(
        shift * pixel / np.ptp(record.field[60][record.seen[60]])
    )


def test_a_contour_missing_in_one_picture_is_lost():
    record, other = picture(lambda x, y: x), picture(lambda x, y: 0.5 * x)
    found = errors(record, other, contours=(0.2, 0.8))
    assert found.lost == 1
    assert found.contours[1].maximum is None
    assert found.contour_max == found.contours[0].maximum
    assert found.contours[0].maximum * 1.2 / 80 == pytest.approx(0.2, rel=0.02)
    nowhere = errors(record, other, contours=(5.0,))
    assert (nowhere.lost, nowhere.contour_max) == (0, 0.0)


@pytest.mark.parametrize("camera", [PARALLEL, NEAR])
def test_cameras_are_determined_from_positions(camera):
    record = picture(steep, camera)
    raised = picture(steep, camera, Plane((0.3, 0.2, 0.1), (0.1, 0.3, 1.0)))
    assert same_camera(record, record)
    assert same_camera(record, raised)
    for other in (replace(camera, eye=(0.6, 0.4, 3.0)), PARALLEL if camera is NEAR else NEAR):
        away = picture(steep, other)
        assert not same_camera(record, away)
        with pytest.raises(ElvisError, match="expected records of one camera"):
            check_comparable(record, away)


def test_incomparable_pictures_are_rejected(tmp_path):
    record, small = picture(steep), picture(steep, size=(40, 30))
    with pytest.raises(ElvisError, match=r"expected records of one size, found 90 x 80 and 40 x 30 pixels"):
        check_comparable(record, small)
    empty = replace(record, element=np.full(record.shape, -1))
    with pytest.raises(ElvisError, match="found an empty picture"):
        check_comparable(empty, record)

    path = tmp_path / "record.npz"
    record.save(path)
    assert all(np.array_equal(getattr(Record.load(path), n), getattr(record, n), equal_nan=True) for n in CHANNELS)
    np.savez(path, field=record.field, color=record.color)
    with pytest.raises(FormatError, match=r"record\.npz: expected the channels .* found no depth, element"):
        Record.load(path)
    np.savez(path, **{**{n: getattr(record, n) for n in CHANNELS}, "depth": record.depth[:-1]})
    with pytest.raises(FormatError, match=r"record\.npz: depth: expected numbers at all pixels"):
        Record.load(path)
    path.write_text("nothing")
    with pytest.raises(FormatError, match=r"record\.npz: expected a record that elvis render writes"):
        Record.load(path)


def isosurface(function, value, level, cells=4):
    mesh = grid(Shape.TETRAHEDRON, cells)
    dataset = Dataset(mesh, (approximated(Dataset(mesh), "u", function, modes=5),))
    made = Baseline.of(Quantities(dataset, ["u"]), level)
    return made.triangles(Isosurface((value,)), "u")


def torus(x):
    """Zero at distance 0.15 from a circle of radius 0.3, of degree four."""
    x, y, z = (x - 0.5).T
    return (x**2 + y**2 + z**2 + 0.3**2 - 0.15**2) ** 2 - 4 * 0.3**2 * (x**2 + y**2)


def ball(x):
    return ((x - 0.5) ** 2).sum(axis=1)


def test_topology_counts_pieces_and_handles():
    assert topology(isosurface(ball, 0.1, 1)) == (1, 0)
    assert topology(isosurface(torus, 0.0, 2)) == (1, 1)
    assert topology(isosurface(lambda x: (x[:, 0] - 0.5) ** 2, 0.06, 1)) == (2, 0)


def test_distances_of_spheres():
    """Spheres of radius 0.3 and 0.35, cut finely, are 0.05 apart."""
    found = surface_distance(isosurface(ball, 0.3**2, 3), isosurface(ball, 0.35**2, 3))
    assert found.hausdorff == pytest.approx(0.05, abs=4e-3)
    assert found.chamfer == pytest.approx(0.05, abs=1e-3)
    assert found.components == (1, 1)
    assert surface_distance(isosurface(ball, 0.1, 0), isosurface(ball, 9.0, 0)) is None


def test_a_constant_field_is_measured_by_its_size():
    """Values on an isosurface differ by rounding: that is not an error of their range."""
    record = picture(lambda x, y: 0.2 + 1e-16 * x)
    other = picture(lambda x, y: 0.2 + 3e-16 * y)
    assert errors(record, other).value_max < 1e-14
    assert all(check.passed for check in check_tolerances(record, other))
    zero = picture(lambda x, y: 0 * x)
    assert errors(zero, zero).value_max == 0
