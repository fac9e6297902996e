"""Paths and streaks of particles in series: against closed forms and another library's integrator."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from elvis import ElvisError, open_series, pathlines, streaklines, write
from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, ripple

TIMES = (0.0, 0.4, 0.7, 1.3, 2.0)
VOLUMES = [shape for shape in Shape if shape.dimension == 3]
PLANES = [shape for shape in Shape if shape.dimension == 2]


def bent(shape, cells=2):
    return curved(grid(shape, cells), ripple(0.03), 3)


def moving(folder, mesh, functions, times=TIMES, modes=3):
    """A series of fields by name, functions of points (n, 3) and a time, on a mesh."""
    folder.mkdir(exist_ok=True)
    write(Dataset(mesh), folder / "mesh.xml")
    (folder / "mesh.fld").unlink(missing_ok=True)
    files = [folder / "mesh.xml"]
    for number, time in enumerate(times):
        fields = tuple(
            approximated(Dataset(mesh), name, lambda p, own=own, t=time: own(p, t), modes)
            for name, own in functions.items()
        )
        files.append(folder / f"run_{number}.chk")
        write(Dataset(mesh, fields, time), field_path=files[-1])
    return open_series(*files, cache=False)


def turning(rate):
    """A rotation about the axis x = y = 1/2 whose rate depends on time, and a way up that does, too."""
    return {
        "u": lambda p, t: rate(t) * (0.5 - p[:, 1]),
        "v": lambda p, t: rate(t) * (p[:, 0] - 0.5),
        "w": lambda p, t: np.full(len(p), 0.05 * rate(t)),
    }


def turned(seed, angle):
    """Where such a rotation by angles (k,) takes a seed (d,): (k, d)."""
    x, y = seed[0] - 0.5, seed[1] - 0.5
    c, s = np.cos(angle), np.sin(angle)
    columns = [0.5 + c * x - s * y, 0.5 + s * x + c * y, *(axis + 0.05 * angle for axis in seed[2:])]
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("between", ["linear", "cubic"])
@pytest.mark.parametrize("shape", [*PLANES, *VOLUMES])
@pytest.mark.sampled(least=4, free=("shape",))
def test_polynomials_in_time_cost_no_digits(shape, between, tmp_path):
    d = shape.dimension
    rate = (lambda t: 1 + 2 * t) if between == "linear" else (lambda t: 1 - t + 3 * t**3)
    angle = (lambda t: t + t**2) if between == "linear" else (lambda t: t - t**2 / 2 + 3 * t**4 / 4)
    series = moving(tmp_path, bent(shape), dict(list(turning(rate).items())[:d]))
    seed = np.array([0.62, 0.55, 0.31])[:d]
    found = pathlines(series, [seed], start=0.2, duration=0.7, between=between, fields=["u", "t*x"])
    assert found.counts() == {"duration": 1}
    assert (found.time[0], found.time[-1]) == pytest.approx((0.2, 0.9), abs=1e-15)
    truth = turned(seed, angle(found.time) - angle(0.2))
    assert np.abs(found.points[:, :d] - truth).max() < 3e-11
    assert np.abs(found.values["u"] - rate(found.time) * (0.5 - truth[:, 1])).max() < 1e-9
    assert np.abs(found.values["t*x"] - found.time * truth[:, 0]).max() < 1e-10
    back = pathlines(series, [found[0][-1, :d]], start=0.9, duration=0.7, direction="backward", between=between)
    assert np.abs(back[0][-1, :d] - seed).max() < 3e-11
    assert back.time[-1] == pytest.approx(0.2, abs=1e-14)


@pytest.mark.parametrize("mesh", [mixed_plane, mixed_volume])
def test_momentum_over_density_is_evaluated_at_the_same_time(mesh, tmp_path):
    mesh = curved(mesh(), ripple(0.02), 3)
    d = mesh.dimension
    density = lambda p, t: 1 + 0.3 * t + 0.2 * p[:, 0]  # noqa: E731
    momenta = [
        lambda p, t: 0.3 - 0.1 * t + 0.2 * p[:, 1],
        lambda p, t: 0.1 * t - 0.1 * p[:, 0],
        lambda p, t: 0.05 + 0 * p[:, 0],
    ]
    names = dict(zip(("rhou", "rhov", "rhow"), momenta, strict=True))
    series = moving(tmp_path, mesh, {"rho": density, **dict(list(names.items())[:d])})

    def right(t, x):
        point = np.array([[*x, 0.0][:3]])
        return np.array([own(point, t)[0] for own in momenta[:d]]) / density(point, t)[0]

    seed = np.array([0.21, 0.43, 0.37])[:d]
    found = pathlines(series, [seed])
    truth = solve_ivp(right, (0, 2), seed, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    assert found.counts() == {"duration": 1}
    assert np.abs(found.points[-1, :d] - truth).max() < 1e-10


@pytest.mark.thorough
@pytest.mark.parametrize(("between", "order"), [("linear", 2), ("cubic", 4)])
def test_order_of_convergence_in_the_step_distance(between, order, tmp_path):
    errors = []
    for count in (8, 16, 32):
        times = np.linspace(0, 2, count + 1)
        flow = dict(list(turning(lambda t: np.exp(-2 * t)).items())[:2])
        series = moving(tmp_path / str(count), grid(Shape.QUADRILATERAL, 1), flow, times, 2)
        # away from the ends of the series, where the four steps lie to one side
        end = pathlines(series, [(0.7, 0.6)], start=0.5, duration=1.0, between=between).points[-1, :2]
        truth = turned((0.7, 0.6), np.array([(np.exp(-1) - np.exp(-3)) / 2]))[0]
        errors.append(np.linalg.norm(end - truth))
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(order, abs=0.3)


def test_particles_pause_and_continue(tmp_path):
    flow = {"u": lambda p, t: np.full(len(p), 0.2 * t), "v": lambda p, t: 0 * p[:, 0]}
    series = moving(tmp_path, bent(Shape.TRIANGLE), flow)
    found = pathlines(series, [(0.3, 0.4), (3.0, 3.0), (0.9, 0.4)], "u-0.1,v", length=10.0)
    x = lambda t: 0.3 - 0.1 * t + 0.1 * t**2  # noqa: E731
    assert np.abs(found[0][:, 0] - x(found.time[: len(found[0])])).max() < 1e-12
    assert found.counts() == {"duration": 1, "outside": 1, "boundary": 1}
    assert len(found[1]) == 0


@pytest.mark.thorough
@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.HEXAHEDRON])
def test_streaklines_join_particles_of_all_releases(shape, tmp_path):
    d = shape.dimension
    flow = {
        "u": lambda p, t: np.full(len(p), 0.3),
        "v": lambda p, t: np.full(len(p), 0.4 * t - 0.2),
        "w": lambda p, t: 0 * p[:, 0],
    }
    series = moving(tmp_path, bent(shape), dict(list(flow.items())[:d]))
    seeds = np.array([[0.15, 0.3, 0.4], [0.1, 0.45, 0.6], [0.8, 0.4, 0.5]])[:, :d]
    found = streaklines(series, seeds, start=0.25, duration=1.5, releases=31, fields=["t"])
    for seed, own in zip(seeds[:2], (0, 1), strict=True):
        part = slice(found.offsets[own], found.offsets[own + 1])
        release = np.linspace(1.75, 0.25, 31)
        assert found.time[part] == pytest.approx(release, abs=1e-14)
        x = seed[0] + 0.3 * (1.75 - release)
        y = seed[1] + 0.2 * (1.75**2 - release**2) - 0.2 * (1.75 - release)
        assert np.abs(found[own][:, :2] - np.stack([x, y], axis=1)).max() < 1e-12
        assert found.values["t"][part] == pytest.approx(1.75, abs=1e-14)
        assert found.element[part].min() >= 0
    assert 0 < len(found[2]) < 31


@pytest.mark.parametrize("shape", [Shape.QUADRILATERAL, Shape.TETRAHEDRON])
def test_exponents_over_time(shape, tmp_path):
    d = shape.dimension
    flow = {
        "u": lambda p, t: t * (p[:, 0] - 0.5),
        "v": lambda p, t: -t * (p[:, 1] - 0.5),
        "w": lambda p, t: 0 * p[:, 0],
    }
    series = moving(tmp_path, bent(shape), dict(list(flow.items())[:d]))
    seed = np.full((1, d), 0.5) + 0.03
    found = pathlines(series, seed, start=0.3, duration=1.2, ftle=True)
    assert found.counts() == {"duration": 1}
    assert found.ftle[0] == pytest.approx((1.5**2 - 0.3**2) / 2 / 1.2, abs=1e-11)


def test_the_double_gyre_in_time_against_another_integrator(tmp_path):
    """Shadden's double gyre on a square with a boundary that moves, as an expression of t."""
    pi = repr(float(np.pi))
    shift, amplitude = "(0.1*sin(2*t))", "1.5"
    place = f"({shift}*x^2+(1-{shift})*x)"
    slope = f"(2*{shift}*x+1-{shift})"
    velocity = [f"-{amplitude}*sin({pi}*{place})*cos({pi}*y)", f"{amplitude}*cos({pi}*{place})*sin({pi}*y)*{slope}"]

    def right(t, state):
        (x, y), gradient = state[:2], state[2:].reshape(2, 2)
        a = 0.1 * np.sin(2 * t)
        f, g, h = a * x**2 + (1 - a) * x, 2 * a * x + 1 - a, 2 * a
        sf, cf, sy, cy = np.sin(np.pi * f), np.cos(np.pi * f), np.sin(np.pi * y), np.cos(np.pi * y)
        u, v = -1.5 * sf * cy, 1.5 * cf * sy * g
        matrix = 1.5 * np.array(
            [[-np.pi * cf * g * cy, np.pi * sf * sy], [-np.pi * sf * g**2 * sy + cf * sy * h, np.pi * cf * cy * g]]
        )
        return np.concatenate([[u, v], (matrix @ gradient).reshape(-1)])

    series = moving(tmp_path, bent(Shape.QUADRILATERAL), {"c": lambda p, t: 0 * p[:, 0]})
    seeds = [(0.2, 0.3), (0.45, 0.8), (0.7, 0.55)]
    found = pathlines(series, seeds, velocity, ftle=True)
    assert found.counts() == {"duration": 3}
    for line, seed in enumerate(seeds):
        truth = solve_ivp(right, (0, 2), [*seed, 1, 0, 0, 1], "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
        assert found[line][-1, :2] == pytest.approx(truth[:2], abs=1e-9)
        assert found.ftle[line] == pytest.approx(np.log(np.linalg.norm(truth[2:].reshape(2, 2), 2)) / 2, abs=1e-8)


def test_unsupported_paths_are_rejected(tmp_path):
    flow = dict(list(turning(lambda t: 1 + t).items())[:2])
    series = moving(tmp_path, grid(Shape.TRIANGLE, 1), flow)
    seeds = [(0.6, 0.5)]
    for settings, sentence in (
        ({"between": "nearest"}, "paths: expected linear or cubic between steps, found 'nearest'"),
        ({"start": 3.0}, "expected a time from 0 to 2, found 3"),
        ({"start": 2.0}, "expected steps after time 2, found none"),
        ({"start": 1.0, "duration": 1.5}, "duration: expected at most 1, up to time 2, found 1.5"),
        ({"velocity": "u"}, "expected a velocity of 2 components"),
        ({"velocity": ["u", "d(v,t)"]}, "there is no derivative of v in time along paths"),
        ({"velocity": "u,q"}, "there is no 'q'"),
    ):
        with pytest.raises(ElvisError, match=sentence):
            pathlines(series, seeds, **settings)
    with pytest.raises(ElvisError, match="releases: expected at least 2, found 1"):
        streaklines(series, seeds, releases=1)


@pytest.mark.thorough
def test_the_command(tmp_path, elvis):
    flow = dict(list(turning(lambda t: 1 + 2 * t).items())[:2])
    moving(tmp_path, bent(Shape.TRIANGLE), flow)
    files = [tmp_path / "mesh.xml", *(tmp_path / f"run_{number}.chk" for number in range(len(TIMES)))]
    seeds = ["--seeds", "point:0.62,0.55", "--field", "u"]
    elvis(
        "trace", *files, "--kind", "pathlines", *seeds, "--time", "0.2", "--duration", "0.7", "-o", tmp_path / "p.npz"
    )
    with np.load(tmp_path / "p.npz") as found:
        angle = found["time"] + found["time"] ** 2 - 0.24
        assert np.abs(found["points"][:, :2] - turned((0.62, 0.55), angle)).max() < 3e-11
    elvis("trace", *files, "--kind", "streaklines", *seeds, "--releases", "11", "-o", tmp_path / "s.csv")
    rows = (tmp_path / "s.csv").read_text().splitlines()
    assert len(rows) == 12
    step = [*files, "--kind", "pathlines", "--step", "1", "--between", "cubic", *seeds, "-o", tmp_path / "q.vtp"]
    elvis("trace", *step)
    assert (tmp_path / "q.vtp").stat().st_size > 1000
    for given, sentence in (
        ((*files[:2], "--kind", "pathlines"), "expected the steps of a series, found one state"),
        ((*files, "--kind", "pathlines", "--wall", "all"), "--wall: expected streamlines, found pathlines"),
        ((*files, "--kind", "streaklines", "--ftle"), "streaklines: expected no --ftle"),
        ((*files, "--kind", "pathlines", "--releases", "5"), "--releases: expected --kind streaklines with it"),
        ((*files, "--kind", "pathlines", "--step", "9"), "expected a step from 0 to 4, found 9"),
    ):
        with pytest.raises(ElvisError, match=sentence):
            elvis("trace", *given, *seeds)
