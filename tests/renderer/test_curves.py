"""1D data as curves: where they run, what they show, against analytic expressions."""

import numpy as np
import pytest
from archives import arrays_of

from elvis import Camera, Faces, MeshLines, SceneError, Style, render
from elvis.core.shapes import Shape
from elvis.core.testing import with_field
from elvis.core.testing.meshes import connected
from elvis.scene.figure.rulers import sides


def chain(points, function):
    """Straight segments from point to point (n, 3) with a field of degree 6."""
    ends = np.stack([np.arange(len(points) - 1), np.arange(1, len(points))], axis=1)
    space = int(np.flatnonzero(np.abs(points).max(axis=0)).max()) + 1
    mesh = connected(points, {Shape.SEGMENT: ends}, space)
    return with_field(mesh, function, 7)


def axis(count):
    return np.stack([np.linspace(0.0, 2.0, count), np.zeros(count), np.zeros(count)], axis=1)


def test_plots_show_values_over_x():
    """A cubic from 0 to 8: columns are places, rows are values."""
    frame = render(chain(axis(4), lambda p: p[:, 0] ** 3), size=(300, 200))
    rows, columns = np.nonzero(frame.seen)
    x = np.interp(columns, [columns.min() + 1, columns.max() - 1], [0.0, 2.0])
    y = np.interp(rows, [rows.min() + 1, rows.max() - 1], [8.0, 0.0])
    assert np.abs(y - x**3).max() < 0.5
    assert np.abs(frame.field[frame.seen] - x**3).max() < 0.2
    assert set(np.unique(frame.element)) == {-1, 0, 1, 2}
    assert frame.range == pytest.approx((0.0, 8.0))
    assert len(np.unique(columns)) == np.ptp(columns) + 1


def test_axes_of_plots_show_the_quantity():
    """Values between -3 and 5: rows of ticks are where the curve has their values."""
    frame = render(chain(axis(4), lambda p: 5.0 - 2.0 * p[:, 0] ** 2), size=(300, 200))
    _, upright = sides(frame.view, (5, 5), frame.ordinate)
    assert (upright.name, frame.has_rulers) == ("u", True)
    rows, columns = np.nonzero(frame.seen)
    told = np.interp(rows, upright.places[::-1, 1], [float(text) for text in upright.texts[::-1]], -np.inf, np.inf)
    known = np.isfinite(told)
    assert known.mean() > 0.5
    assert np.abs(told[known] - frame.field[rows, columns][known]).max() < 0.15
    axes = frame.plot().axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x", "u")
    bottom, top = axes.get_ylim()
    assert -4.0 < bottom < -3.0
    assert 5.0 < top < 6.0


def test_jumps_leave_gaps():
    frame = render(chain(axis(3), lambda p: p[:, 0] + 5.0 * (p[:, 0] > 1.0)), size=(200, 160))
    gap = frame.seen.any(axis=1)
    middle = np.flatnonzero(gap)[[0, -1]].sum() // 2
    assert not gap[middle - 20 : middle + 20].any()


@pytest.mark.parametrize("width", [1.0, 3.0, 6.0])
def test_curves_in_space_have_the_requested_width(width):
    """A straight line askew, which is not opaque: its area in pixels is length times width."""
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.4, 0.3]])
    camera = Camera((0.5, 0.2, 3.0), (0.5, 0.2, 0.0), (0, 1, 0), height=1.0)
    color = np.array([0.0, 0.3, 0.6])
    style = Style(color=tuple(color), opacity=0.7, mesh_lines=MeshLines(width=width))
    frame = render(chain(points, lambda p: p[:, 2]), objects=(Faces(style=style),), camera=camera, size=(300, 200))
    covered = (1.0 - frame.color).sum(axis=(0, 1)) / 0.7 / (1.0 - color)
    assert covered == pytest.approx(np.full(3, 200 * np.hypot(1.0, 0.4) * width), rel=0.03)
    assert np.abs(frame.field[frame.seen] - 0.3 * frame.position[frame.seen][:, 0]).max() < 0.3 * (width + 2) / 200
    assert np.abs(frame.depth[frame.seen] - (3.0 - frame.field[frame.seen])).max() < 1e-12


def test_views_of_curves_are_fitted_and_files_written(tmp_path):
    angle = np.linspace(0.0, 2.0 * np.pi, 13)
    ring = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    frame = render(chain(ring, lambda p: p[:, 1]))
    rows, columns = np.nonzero(frame.seen)
    assert np.ptp(rows) > 0.9 * frame.view.height or np.ptp(columns) > 0.9 * frame.view.width
    for name in ("a.png", "a.npz", "a.exr"):
        frame.save(tmp_path / name)
    record = arrays_of(tmp_path / "a.npz")
    assert np.abs(record["reference"][frame.seen][:, 0]).max() <= 1.0


def test_curves_outside_the_picture_are_reported():
    camera = Camera((9.0, 9.0, 3.0), (9.0, 9.0, 0.0), (0, 1, 0), height=1.0)
    with pytest.raises(SceneError, match="the picture is empty: nothing of any object is visible"):
        render(chain(axis(3), lambda p: p[:, 0]), camera=camera, size=(30, 20))
