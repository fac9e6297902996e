"""Between the steps of series: what is interpolated, and its derivatives in time."""

import numpy as np
import pytest
from click import UsageError

from elvis import ElvisError, open_series, read, render, sample
from elvis.core.data.dataset import Dataset
from elvis.core.data.moments import Moment
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid
from elvis.plugins.series.between import sum_of, weights, window
from elvis.plugins.testing.steps import polynomial, steps_of, waves

POINTS = np.array([[0.31, 0.22, 0.0], [0.55, 0.71, 0.0], [0.83, 0.4, 0.0]])


@pytest.mark.parametrize(("between", "degree", "form"), [("linear", 1, "xml"), ("cubic", 3, "hdf5")])
def test_polynomials_in_time_are_reproduced(between, degree, form, tmp_path):
    times = [0.0, 0.5, 0.8, 1.7, 2.0, 2.9]
    series = open_series(*steps_of(tmp_path, times, lambda p, t: polynomial(p, t, degree), field_format=form))
    assert series.times.tolist() == times
    for time in (0.0, 0.1, 0.65, 1.7, 1.9, 2.6, 2.9):
        dataset = series.at(time, between)
        assert dataset.time == time
        assert np.abs(sample(dataset, "u", POINTS)["u"] - polynomial(POINTS, time, degree)).max() < 1e-12
        assert dataset.mesh is series[0].mesh


@pytest.mark.parametrize(("count", "name"), [(2, "linear"), (3, "quadratic"), (4, "cubic")])
def test_cubic_interpolation_of_fewer_steps_has_lower_degree(count, name, tmp_path, elvis):
    """And is called so; one step is all that there is."""
    degree = count - 1
    files = steps_of(tmp_path, [0.0, 0.5, 0.8, 1.7][:count], lambda p, t: polynomial(p, t, degree))
    dataset = open_series(*files).at(0.3, "cubic")
    assert np.abs(sample(dataset, "u", POINTS)["u"] - polynomial(POINTS, 0.3, degree)).max() < 1e-12
    assert str(dataset.instant) == f"time 0.3 ({name})"
    assert f"interpolated in time ({name}) between steps 0 to {degree}" in dataset.remarks[0]
    files[2].write_bytes(files[2].read_bytes()[:-60])
    table = elvis("probe", *files[:3], "--time", "0", "--between", "cubic", "--point", "0.31,0.22", "--field", "u")
    assert float(table.split(",")[-1]) == pytest.approx(polynomial(POINTS[:1], 0.0, degree)[0], abs=1e-12)
    with pytest.raises(ElvisError, match=r"expected a time from 0 to 0, found 0\.3 \(run_1\.chk: the file ends before"):
        open_series(*files[:3]).at(0.3, "cubic")


def test_cubic_interpolation_exceeds_the_range_of_even_steps_by_an_eighth(tmp_path):
    """In the first and the last interval by a third: half of what its weights' magnitudes are beyond one."""
    times = np.arange(6.0)
    for interval, most in ((0, 0.3156), (1, 0.125), (2, 0.125), (4, 0.3156)):
        numbers = window(times, interval + 0.5, 4)
        sums = [np.abs(weights(times[numbers], interval + part)).sum() for part in np.linspace(0, 1, 401)]
        assert (max(sums) - 1) / 2 == pytest.approx(most, abs=1e-4)


@pytest.mark.parametrize(("between", "degree"), [("linear", 1), ("cubic", 3)])
def test_derivatives_in_time_match_those_of_the_polynomial(between, degree, tmp_path):
    times = [0.0, 0.5, 0.8, 1.7, 2.0]
    series = open_series(*steps_of(tmp_path, times, lambda p, t: polynomial(p, t, degree)))
    for moment in (Moment(time=0.65, between=between), Moment(step=2, between=between), Moment(between=between)):
        dataset = series.at_moment(moment)
        t, (x, y) = dataset.time, POINTS[:, :2].T
        rate = sum((1 + k * x - x * y) * k * t ** (k - 1) / (1 + k) for k in range(1, degree + 1))
        along = sum((k - y) * k * t ** (k - 1) / (1 + k) for k in range(1, degree + 1))
        u = polynomial(POINTS, t, degree)
        wanted = {
            "d(u,t)": rate,
            "d(t^2*u,t)/t": 2 * u + t * rate,
            "d(d(u,t),x)": along,
            "d(d(u,x),t)": along,
            "d(sin(u)+t*x,t)": np.cos(u) * rate + x,
            "d(d(t^3,t),t)": 6 * t,
        }
        found = sample(dataset, list(wanted), POINTS)
        for text, values in wanted.items():
            assert np.abs(found[text] - values).max() < 1e-11, (text, moment)


def test_missing_time_derivatives(tmp_path, elvis):
    files = steps_of(tmp_path, [0.0, 0.5, 1.0], lambda p, t: polynomial(p, t, 1))
    for given, text, sentence in (
        (files[:2], "d(u,t)", "there is no derivative of u in time: expected a series, found one state"),
        ((*files, "--between", "nearest"), "d(u,t)", "the nearest step has no derivative in time"),
        (files, "d(d(u,t),t)", r"expected one derivative in time, found another one of d\(u,t\)"),
        (files, "d(element,t)", "there is no derivative of element in time"),
    ):
        with pytest.raises(ElvisError, match=sentence):
            elvis("norms", *given, "--field", text)


def test_pictures_of_time_derivatives_are_labelled(tmp_path):
    files = steps_of(tmp_path, [0.0, 0.5, 1.0], lambda p, t: polynomial(p, t, 1))
    frame = render(*files, "d(u,t)", step=0, size=(12, 9), device="reference")
    told = "derivatives in time are difference quotients of coefficients of steps 0 to 1, times 0 to 0.5"
    assert told in frame.remarks
    x, y = frame.position[frame.seen].T[:2]
    assert np.abs(frame.field[frame.seen] - (1 + x - x * y) / 2).max() < 1e-12


@pytest.mark.parametrize(("between", "order"), [("linear", 2), ("cubic", 4)])
def test_orders_of_convergence(between, order, tmp_path):
    errors = []
    for count in (8, 16, 32):
        (folder := tmp_path / str(count)).mkdir()
        series = open_series(*steps_of(folder, np.linspace(0, 3, count + 1), waves))
        middles = (series.times[1:] + series.times[:-1])[2:-2] / 2
        found = [sample(series.at(t, between), "u", POINTS)["u"] - waves(POINTS, t) for t in middles]
        errors.append(np.abs(found).max())
    rates = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.abs(rates - order).max() < 0.15


@pytest.mark.parametrize("moves", [True, False])
def test_meshes_that_move_snap_to_steps(moves, squares):
    series = open_series(squares(moves), cache=False)
    assert series.times.tolist() == [0.0, 0.25, 0.5]
    found = series.at(0.3)
    assert found.time == (0.25 if moves else 0.3)
    assert ("the mesh changes between steps, which are not interpolated" in found.remarks) == moves
    assert np.isclose(sample(found, "u", [(0.5, 0.5, 0.0)])["u"][0], found.time, rtol=0, atol=1e-14)
    if moves:
        with pytest.raises(ElvisError, match="the mesh changes between steps 1 and 2: there is no d"):
            sample(found, "d(u,t)", [(0.5, 0.5, 0.0)])
    else:
        assert np.isclose(sample(found, "d(u,t)", [(0.5, 0.5, 0.0)])["d(u,t)"][0], 1, rtol=0, atol=1e-13)


@pytest.mark.parametrize("moves", [True, False])
def test_values_over_time_on_meshes_that_move(moves, squares, tmp_path, elvis):
    elvis("probe", squares(moves), "--no-cache", "--point", "0.5,0.5", "--times", "all", "-o", tmp_path / "t.npz")
    with np.load(tmp_path / "t.npz") as found:
        assert found["time"].tolist() == [0.0, 0.25, 0.5]
        assert np.abs(found["u"] - found["time"]).max() < 1e-14


def test_values_over_time(tmp_path, elvis):
    files = steps_of(tmp_path, [0.0, 0.5, 1.2], lambda p, t: polynomial(p, t, 1))
    for times, wanted in (("all", [0.0, 0.5, 1.2]), ("0:1:5", np.linspace(0, 1, 5))):
        points = ["--point", "0.31,0.22", "--point", "0.55,0.71"]
        elvis("probe", *files, *points, "--times", times, "-o", tmp_path / "t.npz")
        with np.load(tmp_path / "t.npz") as found:
            assert np.array_equal(found["time"], np.repeat(wanted, 2))
            own = np.concatenate([polynomial(POINTS[:2], t, 1) for t in wanted])
            assert np.abs(found["u"] - own).max() < 1e-12
    elvis("probe", *files, *points, "--times", "all", "--plot", tmp_path / "t.svg", "-o", tmp_path / "t.csv")
    text = (tmp_path / "t.svg").read_text()
    assert all(label in text for label in ("0.31, 0.22, 0", "0.55, 0.71, 0", ">time<", ">u<"))
    assert len((tmp_path / "t.csv").read_text().splitlines()) == 7
    assert elvis("probe", *files, *points, "--times", "all", "--plot", tmp_path / "t.png") == ""
    with pytest.raises(ElvisError, match=r"t\.jpg: expected a name that ends in \.svg, \.pdf, \.png for a plot"):
        elvis("probe", *files, *points, "--times", "all", "--plot", tmp_path / "t.jpg")
    with pytest.raises(UsageError, match="expected --plot with --times, --along or --line, and without --all"):
        elvis("probe", *files, *points, "--plot", tmp_path / "t.svg")
    with pytest.raises(ElvisError, match="--times: expected a series, without --step and --time, found one state"):
        elvis("probe", *files[:2], "--point", "0,0", "--times", "all")


def test_pictures_between_steps_are_labelled(tmp_path):
    files = steps_of(tmp_path, [0.0, 0.5, 1.0], lambda p, t: polynomial(p, t, 1))
    frame = render(*files, "u+t", time=0.3, size=(12, 9), device="reference")
    assert any("interpolated in time (linear)" in remark for remark in frame.remarks)
    seen = frame.seen
    wanted = polynomial(frame.position[seen], 0.3, 1) + 0.3
    assert np.abs(frame.field[seen] - wanted).max() < 1e-12


@pytest.mark.parametrize(
    ("asked", "title", "record"),
    [
        ({"time": 0.3}, "u+t, time 0.3 (linear)", (0.3, [0, 1], "linear")),
        ({"time": 0.3, "between": "cubic"}, "u+t, time 0.3 (cubic)", (0.3, [0, 3], "cubic")),
        ({"time": 0.3, "between": "nearest"}, "u+t, time 0.5 (nearest)", (0.5, [1, 1], "nearest")),
        ({"step": 2, "title": "Wave"}, "Wave, time 1", (1.0, [2, 2], "")),
    ],
)
def test_titles_and_records_state_the_time(asked, title, record, tmp_path):
    files = steps_of(tmp_path, [0.0, 0.5, 1.0, 2.0], lambda p, t: polynomial(p, t, 1))
    frame = render(*files, "u+t", **asked, size=(12, 9), device="reference")
    assert frame.title == title
    frame.save(tmp_path / "u.npz")
    with np.load(tmp_path / "u.npz") as file:
        assert (file["time"], file["steps"].tolist(), file["between"]) == record
    # t is the time of what is shown
    own = polynomial(frame.position[frame.seen], record[0], 1) + record[0]
    assert np.abs(frame.field[frame.seen] - own).max() < 1e-12


@pytest.mark.parametrize(("between", "degree"), [("linear", 1), ("cubic", 3)])
def test_an_interpolated_time_is_converted(between, degree, tmp_path, elvis):
    files = steps_of(tmp_path, [0.0, 0.5, 1.2, 1.9], lambda p, t: polynomial(p, t, degree))
    elvis("convert", *files, "--time", "0.8", "--between", between, "-o", tmp_path / "moment.xml")
    found = read(tmp_path / "moment.xml", tmp_path / "moment.fld")
    assert found.time == 0.8
    assert np.abs(sample(found, "u", POINTS)["u"] - polynomial(POINTS, 0.8, degree)).max() < 1e-12
    with pytest.raises(ElvisError, match=r"expected a time from 0 to 1\.9, found 7"):
        elvis("convert", *files, "--time", "7", "-o", tmp_path / "none.xml")
    assert not (tmp_path / "none.xml").exists()


def test_fields_are_summed_if_all_steps_are_alike():
    bare = Dataset(grid(Shape.QUADRILATERAL, 1))
    fields = [approximated(bare, "u", lambda p: p[:, 0], modes) for modes in (3, 3, 4)]
    total = sum_of(fields[:2], np.array([2.0, 3.0]))
    assert np.allclose(total.blocks[0].coefficients, 5 * fields[0].blocks[0].coefficients, rtol=1e-15)
    assert sum_of([fields[0], fields[2], fields[1]], np.ones(3)) is None
