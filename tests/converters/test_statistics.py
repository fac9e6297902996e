"""Statistics of series: means and covariances."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import Dataset, ElvisError, open_series, read, sample, write
from elvis.core.data.dataset import Homogeneous
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape
from elvis.core.testing.fields import approximated
from elvis.core.testing.meshes import grid, mixed_plane, mixed_volume
from elvis.plugins.command.command import elvis as group
from elvis.plugins.series.series import Series
from elvis.plugins.series.statistics import average
from elvis.plugins.testing.steps import polynomial, steps_of

POINTS = np.array([[0.31, 0.22, 0.0], [0.55, 0.71, 0.0], [0.83, 0.4, 0.0]])


def chaos(points, number):
    """Fields of degree 2 whose coefficients are those of a fixed series of random numbers."""
    a, b, c = np.random.default_rng(number).normal(size=3)
    x, y, z = points.T
    return {"u": 5 + a * x + b * y * z, "v": b - c * x * y + a * z**2}


@pytest.fixture
def chaotic(tmp_path):
    """Seven steps on all shapes of volumes, pyramids among them; the times."""
    dataset = Dataset(mixed_volume(seed=2))
    times = [0.0, 0.5, 1.0, 1.5, 2.5, 3.0, 4.0]
    for number, time in enumerate(times):
        made = [approximated(dataset, name, lambda p, name=name, n=number: chaos(p, n)[name], 3) for name in "uv"]
        write(replace(dataset, fields=tuple(made), time=time), tmp_path / "m.xml", tmp_path / f"m_{number}.fld")
    return tmp_path, times


def test_means_and_covariances_match_those_of_values(chaotic, elvis):
    folder, times = chaotic
    elvis("average", folder / "m.xml", folder / "m_*.fld", "--covariances", "-o", folder / "mean.fld")
    found = read(folder / "m.xml", folder / "mean.fld")
    assert list(found) == ["u", "v", "u_u", "u_v", "v_v"]
    points = np.random.default_rng(4).uniform(0.02, 0.98, (40, 3))
    values = sample(found, list(found), points)
    inside = values.location.status == 1
    assert inside.sum() > 10
    steps = [chaos(points[inside], number) for number in range(len(times))]
    own = {name: np.array([step[name] for step in steps]) for name in "uv"}
    for name in "uv":
        assert np.abs(values[name][inside] - own[name].mean(axis=0)).max() < 1e-12
    for pair in ("u_u", "u_v", "v_v"):
        a, b = (own[name] - own[name].mean(axis=0) for name in pair.split("_"))
        assert np.abs(values[pair][inside] - (a * b).mean(axis=0)).max() < 1e-12
    assert found.metadata["AveragedSteps"] == "7"
    assert found.time is None


def test_means_over_time_are_integrals(tmp_path, elvis):
    times = [0.0, 0.3, 1.0, 1.2, 2.0]
    files = steps_of(tmp_path, times, lambda p, t: polynomial(p, t, 1))
    elvis("average", *files, "--over", "time", "--covariances", "-o", tmp_path / "mean.fld")
    found = sample(read(files[0], tmp_path / "mean.fld"), ["u", "u_u"], POINTS)
    assert np.abs(found["u"] - polynomial(POINTS, 1.0, 1)).max() < 1e-12
    slope = polynomial(POINTS, 1.0, 1) - polynomial(POINTS, 0.0, 1)
    assert np.abs(found["u_u"] - slope**2 * 2.0**2 / 12).max() < 1e-12  # that of a line over [0, 2]


def test_extrema_match_those_of_steps_with_their_times(tmp_path, elvis):
    """Exact where one step holds them throughout an element, else as near as is told."""
    times = [0.0, 0.5, 1.0, 1.5, 2.5]
    files = steps_of(tmp_path, times, lambda p, t: p[:, 1] + (t - 1) ** 2 * (1 + p[:, 0]))
    elvis("average", *files, "--extrema", "--over", "time", "-o", tmp_path / "ends.fld")
    names = ["u_min", "u_min_time", "u_max", "u_max_time"]
    found = sample(read(files[0], tmp_path / "ends.fld"), names, POINTS)
    x, y = POINTS[:, 0], POINTS[:, 1]
    for name, truth in zip(names, (y, 1.0, y + 2.25 * (1 + x), 2.5), strict=True):
        assert np.abs(found[name] - truth).max() < 1e-12
    files = steps_of(tmp_path, times, lambda p, t: (t - 1) * (p[:, 0] - 0.6) + 0 * p[:, 1])
    told = average(open_series(*files), with_extrema=True)
    assert 0.0 < told.errors["u_min"].estimate < 0.3
    least = np.min([(t - 1) * (x - 0.6) for t in times], axis=0)
    off = np.abs(sample(told.dataset, "u_min", POINTS)["u_min"] - least).max()
    assert off <= told.errors["u_min"].bound * 0.9  # the minimum of all is -0.9


def test_extrema_are_within_their_bounds(chaotic):
    """At points that no fit has seen, on all shapes; the points of the fits alone tell a part of it."""
    folder, times = chaotic
    command = ["average", folder / "m.xml", folder / "m_*.fld", "--extrema", "-o", folder / "ends.fld"]
    said = CliRunner().invoke(group, [str(word) for word in command])
    assert said.exit_code == 0
    assert "of its largest value (" in said.stderr
    told = average(open_series(folder / "m.xml", *sorted(folder.glob("m_*.fld"))), with_extrema=True)
    points = np.random.default_rng(5).uniform(0.0, 1.0, (3000, 3)) * np.ptp(mixed_volume(seed=2).vertices, axis=0)
    names = [f"{name}_{end}{ending}" for name in "uv" for end in ("min", "max") for ending in ("", "_time")]
    values = sample(told.dataset, names, points)
    inside = values.location.status == 1
    steps = [chaos(points[inside], number) for number in range(len(times))]
    for name in "uv":
        own = np.array([step[name] for step in steps])
        for end, ends, steps_of_ends in (("min", own.min(0), own.argmin(0)), ("max", own.max(0), own.argmax(0))):
            for label, truth in ((f"{name}_{end}", ends), (f"{name}_{end}_time", np.array(times)[steps_of_ends])):
                off = np.abs(values[label][inside] - truth).max() / np.abs(truth).max()
                error = told.errors[label]
                assert off <= error.bound
                assert error.estimate <= error.bound < 8.0


def test_the_first_of_equal_extrema_counts(tmp_path):
    """A cosine in time comes back each period, off in its last digits: elsewhere in others."""
    times = [0.1, 0.6, 1.1, 1.6, 2.1, 2.6, 3.1, 3.6]
    files = steps_of(tmp_path, times, lambda p, t: p[:, 1] + (1 + p[:, 0]) * np.cos(2 * np.pi * t))
    told = average(open_series(*files), with_extrema=True)
    found = sample(told.dataset, ["u_min", "u_min_time", "u_max", "u_max_time"], POINTS)
    swing = (1 + POINTS[:, 0]) * np.cos(0.2 * np.pi)
    assert np.abs(found["u_max"] - (POINTS[:, 1] + swing)).max() < 1e-12
    assert np.abs(found["u_min"] - (POINTS[:, 1] - swing)).max() < 1e-12
    assert np.abs(found["u_max_time"] - 0.1).max() < 1e-12
    assert np.abs(found["u_min_time"] - 0.6).max() < 1e-12
    assert max(error.bound for error in told.errors.values()) < 1e-12


def test_a_step_beyond_by_more_than_rounding_counts(tmp_path):
    files = steps_of(tmp_path, [0.0, 1.0, 2.0], lambda p, t: 1 + p[:, 0] + 1e-11 * (t == 1.0))
    found = sample(average(open_series(*files), with_extrema=True).dataset, ["u_min_time", "u_max_time"], POINTS)
    assert np.abs(found["u_max_time"] - 1.0).max() < 1e-12
    assert np.abs(found["u_min_time"]).max() < 1e-12


def test_steps_that_are_not_finite_are_excluded_from_means(tmp_path, elvis):
    """But where there are no others."""
    files = steps_of(tmp_path, [0.0, 0.5, 1.0], lambda p, t: polynomial(p, t, 1) * (np.nan if t == 0.5 else 1.0))
    for over in ("steps", "time"):
        told = average(open_series(*files), over, with_covariances=True, with_extrema=True)
        assert np.abs(sample(told.dataset, "u", POINTS)["u"] - polynomial(POINTS, 0.5, 1)).max() < 1e-12
        assert told.dataset.metadata["AveragedSteps"] == "2"
        assert told.dataset.remarks[-1] == "means are of the steps whose values are finite"
    files[1].write_bytes(files[2].read_bytes().replace(b"<Time>0.5<", b"<Time>0.25<"))
    assert np.isnan(sample(average(open_series(*files[:3])).dataset, "u", POINTS)["u"]).all()


def test_quantities_without_a_mean_are_rejected(tmp_path, squares, elvis):
    steps = squares(True)
    with pytest.raises(ElvisError, match=r"expected one mesh at all steps, found another at time 0\.25"):
        elvis("average", steps, "--no-cache", "-o", tmp_path / "mean.xml")
    with pytest.raises(ElvisError, match=r"expected a name ending in \.xml, as the mesh is converted"):
        elvis("average", steps, "-o", tmp_path / "mean.fld")
    assert not list(tmp_path.glob("mean*"))


#: Fourier directions: bases, lengths, numbers of the planes along y and z
WAVES = {
    "planes": Homogeneous((Basis.FOURIER,), (2.0,), (0, 1, 2, 3, 4, 5)),
    "some planes": Homogeneous((Basis.FOURIER,), (2.0,), (0, 4, 3)),
    "one wave": Homogeneous((Basis.FOURIER_SINGLE_MODE,), (2.0,), (2, 3)),
    "half a wave": Homogeneous((Basis.FOURIER_HALF_MODE_RE,), (2.0,), (0,)),
    "lines": Homogeneous((Basis.FOURIER,) * 2, (2.0, 3.0), (0, 0, 1, 1, 2, 2), (0, 2, 0, 2, 3, 2)),
}


@pytest.mark.parametrize("name", WAVES)
def test_statistics_along_fourier_directions_match_those_of_values(tmp_path, name):
    """Of random coefficients on triangles and quadrilaterals, or on lines."""
    waves = WAVES[name]
    mesh = mixed_plane(seed=3) if len(waves.bases) == 1 else grid(Shape.SEGMENT, 3)
    flat = approximated(Dataset(mesh), "u", lambda p: p[:, 0], 3)
    random = np.random.default_rng(7)

    def at(time):
        fields = []
        for name in "uv":
            blocks = []
            for block in flat.blocks:
                size = len(block), block.coefficients.shape[1] * len(waves.z_ids)
                expansion = replace(block.expansion, homogeneous=waves)
                blocks.append(replace(block, expansion=expansion, coefficients=random.normal(size=size)))
            fields.append(replace(flat, name=name, blocks=tuple(blocks), continuous=False))
        return replace(Dataset(mesh), fields=tuple(fields), time=time)

    for number in range(4):
        write(at(float(number)), tmp_path / "m.xml", tmp_path / f"m_{number}.fld")
    series = open_series(tmp_path / "m.xml", tmp_path / "m_*.fld")
    told = average(series, with_covariances=True, with_extrema=True)
    write(told.dataset, field_path=tmp_path / "mean.fld")
    mean = read(tmp_path / "m.xml", tmp_path / "mean.fld")
    points = random.uniform(0.02, 0.98, (40, 3)) * (1.0, 1.0, 2.0)
    own = {}
    for name in "uv":
        steps = [sample(step, name, points) for step in series]
        own[name] = np.array([step[name][step.location.status == 1] for step in steps])
    assert own["u"].shape[1] > 10
    inside = steps[0].location.status == 1
    for name in "uv":
        assert np.abs(sample(mean, name, points)[name][inside] - own[name].mean(axis=0)).max() < 1e-12
    for pair in ("u_u", "u_v", "v_v"):
        a, b = (own[name] - own[name].mean(axis=0) for name in pair.split("_"))
        assert np.abs(sample(mean, pair, points)[pair][inside] - (a * b).mean(axis=0)).max() < 1e-12
        assert told.errors[pair].estimate < 1e-13
    lower = average(series, with_covariances=True, order=2)
    assert 1e-3 < lower.errors["u_u"].estimate < 1.0


def test_extrema_along_fourier_directions_match_those_of_steps(tmp_path):
    """Exact where one step holds them on the whole period."""
    waves = WAVES["planes"]
    dataset = Dataset(mixed_plane(seed=3))
    flat = approximated(dataset, "u", lambda p: 1 + p[:, 0] * p[:, 1], 3)
    factors = np.array([1.0, 0.0, 0.2, 0.1, -0.1, 0.3])  # of positive values: the waves' sum stays below 1
    for number, scale in enumerate((2.0, 1.0, 3.0)):
        blocks = [
            replace(
                block,
                expansion=replace(block.expansion, homogeneous=waves),
                coefficients=scale * (factors[:, None] * block.coefficients[:, None]).reshape(len(block), -1),
            )
            for block in flat.blocks
        ]
        field = replace(flat, blocks=tuple(blocks), continuous=False)
        write(replace(dataset, fields=(field,), time=float(number)), tmp_path / "m.xml", tmp_path / f"m_{number}.fld")
    series = open_series(tmp_path / "m.xml", tmp_path / "m_*.fld")
    told = average(series, with_extrema=True)
    points = np.random.default_rng(1).uniform(0.02, 0.98, (30, 3)) * (1.0, 1.0, 2.0)
    names = ["u_min", "u_max", "u_min_time", "u_max_time"]
    found = sample(told.dataset, names, points)
    inside = found.location.status == 1
    one = sample(series[1], "u", points)["u"]
    for name, truth in zip(names, (one, 3 * one, 1.0, 2.0), strict=True):
        assert np.abs(found[name] - truth)[inside].max() < 1e-12
    assert max(error.estimate for error in told.errors.values()) < 1e-13


def test_each_step_is_read_once(chaotic, monkeypatch):
    folder, times = chaotic
    series = open_series(folder / "m.xml", folder / "m_*.fld")
    found = []
    read_step = Series._read
    monkeypatch.setattr(Series, "_read", lambda self, step: found.append(step.name) or read_step(self, step))
    for over in ("steps", "time"):
        found.clear()
        average(series, over, with_covariances=True)
        series = open_series(folder / "m.xml", folder / "m_*.fld")
        assert found == [f"m_{number}.fld" for number in range(len(times))]


def test_covariances_of_a_lower_degree_state_their_error(tmp_path):
    # the covariance is s^4 times a number; 35 s^4 = 8 P4 + 20 P2 + 7: without P4 the ends are off by most
    dataset = Dataset(grid(Shape.QUADRILATERAL, 1))
    for number in range(4):
        field = approximated(dataset, "u", lambda p, n=number: (2 * p[:, 0] - 1) ** 2 * np.sin(n), 3)
        write(replace(dataset, fields=(field,), time=float(number)), tmp_path / "m.xml", tmp_path / f"m_{number}.fld")
    series = open_series(tmp_path / "m.xml", tmp_path / "m_*.fld")
    whole, lower = (average(series, with_covariances=True, order=order) for order in (None, 2))
    assert whole.errors["u_u"].estimate < 1e-14
    greatest = np.polynomial.legendre.leggauss(6)[0].max() ** 4  # of the samples, parts of which errors are
    assert lower.errors["u_u"].estimate == pytest.approx(8 / 35 / greatest, rel=1e-9)
    points = np.array([[0.9, 0.4, 0.0], [0.3, 0.7, 0.0]])
    ours, best = (sample(own.dataset, "u_u", points)["u_u"] for own in (whole, lower))
    s = 2 * points[:, 0] - 1
    variance = np.var(np.sin(range(4)))
    assert np.allclose(ours, s**4 * variance, rtol=0, atol=1e-14)
    assert np.allclose(best, (6 * s**2 / 7 - 3 / 35) * variance, rtol=0, atol=1e-14)
