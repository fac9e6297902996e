"""Streamlines against closed forms and another library's integrator; how they end; where they begin."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from made_fields import constant
from scipy.integrate import solve_ivp
from scipy.integrate._ivp import dop853_coefficients
from scipy.linalg import expm

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset, Field, Homogeneous
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape
from elvis.core.streamlines import dop853
from elvis.core.streamlines.clipped_lines import clipped_lines
from elvis.core.streamlines.first_roots import bernstein_at, first_roots
from elvis.core.streamlines.streamlines import trace
from elvis.core.streamlines.tracer import Tracer
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, ripple


def data(mesh, functions, modes=3):
    """A dataset with the fields u, v, …"""
    bare = Dataset(mesh)
    return Dataset(mesh, tuple(approximated(bare, name, own, modes) for name, own in functions.items()))


#: rigid rotation about (0.5, 0.5), a little way up each turn
ROTATION = {"u": lambda p: 0.5 - p[:, 1], "v": lambda p: p[:, 0] - 0.5, "w": constant(0.001)}


def of_dimension(functions, dimension):
    return {name: functions[name] for name in "uvw"[:dimension]}


def turned(seed, time):
    """Where rotation takes a seed (3,)."""
    x, y = seed[0] - 0.5, seed[1] - 0.5
    c, s = np.cos(time), np.sin(time)
    return np.array([0.5 + c * x - s * y, 0.5 + s * x + c * y, seed[2]])


def test_coefficients_match_those_of_another_library():
    assert (dop853_coefficients.A[1:] == dop853.STAGES).all()
    assert (dop853.ERRORS[:, :13] == [dop853_coefficients.E5, dop853_coefficients.E3]).all()
    assert (dop853.DENSE == dop853_coefficients.D).all()


def test_dense_output_has_order_seven():
    def errors(width):
        def derivative(states):
            return states[:, ::-1] * (-1, 1)

        start = np.array([[1.0, 0.0]])
        nets = dop853.step(derivative, start, derivative(start), np.array([width])).dense(derivative)
        places = np.linspace(0, 1, 9)
        found = np.array([bernstein_at(nets, np.array([t]))[0] for t in places])
        return np.abs(found - np.stack([np.cos(width * places), np.sin(width * places)], axis=1)).max()

    assert errors(0.4) < 1e-9
    assert errors(0.4) > 120 * errors(0.2) > 0


def test_first_roots_of_random_polynomials():
    nets = np.random.default_rng(3).normal(0.4, 1, (300, 8))
    nets[:, 0] = np.abs(nets[:, 0])
    found = first_roots(nets)
    assert 30 < np.isinf(found).sum() < 270
    places = np.linspace(0, 1, 2001)
    for net, root in zip(nets, found, strict=True):
        values = bernstein_at(np.tile(net, (len(places), 1)), places)
        below = np.flatnonzero(values < -1e-13)
        assert (values[places < root] > -1e-13).all()
        assert np.isinf(root) == (not len(below))
        if len(below):
            assert abs(bernstein_at(net[None], np.array([root]))[0]) < 1e-13
            assert root <= places[below[0]]


def test_first_roots_behind_a_slow_rise():
    """As heights over a side on which a line begins, which it leaves at a flat angle and comes back to."""
    rng = np.random.default_rng(4)
    rise, fall = 10.0 ** rng.uniform(-9, -1, 100), rng.uniform(0.1, 1.0, 100)
    room = 1e-13
    # room + rise t - fall t^2, in the Bernstein basis of degree 7
    powers = np.arange(8)
    nets = room + rise[:, None] * powers / 7 - fall[:, None] * powers * (powers - 1) / 42
    expected = (rise + np.sqrt(rise**2 + 4 * fall * room)) / (2 * fall)
    found = first_roots(nets)
    inside = expected < 1
    assert inside.all()
    assert found == pytest.approx(expected, abs=1e-15, rel=1e-7)


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1])
@pytest.mark.parametrize(("tolerance", "bound"), [(None, 3e-10), (1e-13, 4e-13)])
@pytest.mark.sampled(free=("shape", "tolerance", "bound"))
def test_three_turns_in_curved_elements(shape, tolerance, bound):
    d = shape.dimension
    mesh = curved(grid(shape, 2 if d == 2 else 1), ripple(0.05), 3)
    seeds = np.array([[0.75, 0.5, 0.45], [0.55, 0.45, 0.55]])
    found = trace(data(mesh, of_dimension(ROTATION, d), 5), seeds[:, :d], duration=6 * np.pi, tolerance=tolerance)
    assert found.counts() == {"duration": 2}
    for line, seed in enumerate(seeds):
        climb = np.array([0, 0, 0.006 * np.pi]) if d == 3 else 0
        assert np.linalg.norm(found[line][-1, :d] - (seed + climb)[:d]) < bound
    length = 6 * np.pi * np.hypot(0.25, 0.001 * (d == 3))
    assert found.length[found.offsets[1] - 1] == pytest.approx(length, rel=bound)


@pytest.mark.parametrize("turns", range(3))
@pytest.mark.sampled(free=("turns",))
def test_a_helix_passes_through_elements_of_every_shape(turns):
    mesh = curved(mixed_volume(turns), ripple(0.02), 3)
    helix = {"u": constant(0.3), "v": lambda p: 0.5 - p[:, 2], "w": lambda p: p[:, 1] - 0.5}
    seeds = np.array([[0.2, 0.8, 0.5], [0.2, 0.23, 0.4]])
    time = 2.6 / 0.3
    found = trace(data(mesh, helix, 5), seeds, duration=time, fields=["x*u"])
    for line, seed in enumerate(seeds):
        points = found[line]
        ends = [seed[0] + 2.6, *turned([*seed[1:], 0], time)[:2]]
        assert np.abs(points[-1] - ends).max() < 1e-11
        assert np.abs(np.hypot(*(points[:, 1:] - 0.5).T) - np.hypot(*(seed[1:] - 0.5))).max() < 1e-11
    shapes = {shape for shape, own in mesh.elements.items() if np.isin(own.ids, found.element).any()}
    assert shapes == set(mesh.elements)
    assert found.values["x*u"] == pytest.approx(0.3 * found.points[:, 0], abs=1e-11)
    assert found.velocity[:, 0] == pytest.approx(0.3, abs=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1])
@pytest.mark.sampled(free=("shape",))
def test_errors_fall_with_the_tolerance_down_to_rounding(shape):
    d = shape.dimension
    dataset = data(curved(grid(shape, 1), ripple(0.05), 3), of_dimension(ROTATION, d), 5)
    seed = [0.6, 0.5, 0.45][:d]
    errors = []
    for tolerance in (1e-4, 1e-8, 1e-13):
        found = trace(dataset, [seed], duration=2 * np.pi, tolerance=tolerance)
        climb = [0, 0, 0.002 * np.pi][:d]
        errors.append(np.linalg.norm(found[0][-1, :d] - seed - climb))
    assert all(10 * later < earlier for earlier, later in pairwise(errors))
    assert errors[-1] < 2e-13
    # a tolerance below rounding makes it no worse, and lines still end
    end = trace(dataset, [seed], duration=0.5, tolerance=1e-16).points[-1]
    assert np.abs(end[:2] - turned(np.array([*seed, 0]), 0.5)[:2]).max() < 1e-13


@pytest.mark.thorough
@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1])
@pytest.mark.parametrize("modes", range(2, 8))
@pytest.mark.sampled(least=2, free=("shape", "modes"))
def test_lines_stay_straight_if_the_speed_jumps_at_every_border(shape, modes):
    """Of the orders 1 to 6: a rotation, by a factor of its own in each element, after two turns by its length."""
    d = shape.dimension
    mesh = grid(shape, 2 if d == 2 or shape is Shape.HEXAHEDRON else 1)
    mesh = mesh if modes == 2 else curved(mesh, ripple(0.04), modes)
    dataset = Dataset(mesh, (approximated(Dataset(mesh), "c", constant(1.0), modes),))
    for element in mesh.elements[shape].ids:
        dataset = altered(dataset, "c", element, 1 + element % 3)
    seed = np.array([0.75, 0.5, 0.45])[:d]
    velocity = ["c*(0.5-y)", "c*(x-0.5)", "0"][:d]
    found = trace(dataset, [seed], velocity, length=np.pi, fields=["c"])
    assert found.counts() == {"length": 1}
    assert np.linalg.norm(found[0][-1, :d] - seed) < 1e-10
    assert len(set(np.round(found.values["c"]))) > 1
    assert np.abs(np.hypot(*(found.points[:, :2] - 0.5).T) - 0.25).max() < 1e-10
    # as long as the way through each element takes at the speed there
    ways = np.diff(found.length)
    assert found.time[-1] == pytest.approx((ways / (0.25 * found.values["c"][1:])).sum(), rel=1e-10)


def hill(t, p):
    """The inner flow of Hill's vortex (Philosophical Transactions A 185, 1894), about (0.5, 0.5, 0.5)."""
    x, y, z = np.asarray(p).T - 0.5
    return np.stack([x * z, y * z, 0.1 - 2 * (x * x + y * y) - z * z], axis=-1)


def test_hills_vortex_matches_another_integrator():
    mesh = curved(grid(Shape.TETRAHEDRON, 1), ripple(0.03), 2)
    fields = {name: lambda p, axis=axis: hill(0, p)[:, axis] for axis, name in enumerate("uvw")}
    seed, time = [0.62, 0.53, 0.5], 12.0
    found = trace(data(mesh, fields, 3), [seed], duration=time)
    truth = solve_ivp(hill, (0, time), seed, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    assert found[0][-1] == pytest.approx(truth, abs=2e-11)


def test_closed_orbits_of_a_stream_function_stay_closed():
    def stream(p):
        return p[:, 0] * (1 - p[:, 0]) * p[:, 1] * (1 - p[:, 1])

    mesh = curved(grid(Shape.QUADRILATERAL, 1), lambda p: p, 2)
    fields = {
        "u": lambda p: p[:, 0] * (1 - p[:, 0]) * (1 - 2 * p[:, 1]),
        "v": lambda p: -(1 - 2 * p[:, 0]) * p[:, 1] * (1 - p[:, 1]),
    }
    found = trace(data(mesh, fields), [[0.5, 0.6], [0.5, 0.8]], duration=25)
    assert found.counts() == {"duration": 2}
    for line in range(2):
        values = stream(found[line])
        assert np.abs(values - values[0]).max() < 1e-11


def test_lines_against_the_stream_return():
    dataset = data(curved(mixed_plane(1), ripple(0.05), 3), {"u": constant(1), "v": lambda p: 0.1 * p[:, 0]}, 4)
    there = trace(dataset, [[0.2, 0.4]], length=1.5)
    back = trace(dataset, there[0][-1:, :2], length=1.5, direction="backward")
    assert back[0][-1] == pytest.approx([0.2, 0.4, 0], abs=1e-11)
    assert back.time[-1] == pytest.approx(-there.time[-1], abs=1e-11)
    both = trace(dataset, [[1.0, 0.4]], direction="both")
    assert both.seed.tolist() == [0, 0]
    assert (both.time.min(), both.time.max()) == (both[1][-1, 0] - 1, both[0][-1, 0] - 1) or both.time.min() < 0


def altered(dataset, name, element, factor):
    """The dataset with a field of one element multiplied."""
    blocks = []
    for block in dataset.field(name).blocks:
        factors = np.where(block.element_ids == element, factor, 1.0)
        blocks.append(replace(block, coefficients=block.coefficients * factors[:, None]))
    others = (field for field in dataset.fields if field.name != name)
    return replace(dataset, fields=(Field(name, tuple(blocks)), *others))


RIGHT = {"u": constant(1), "v": constant(0)}


@pytest.mark.parametrize(("factor", "end"), [(-1.0, "jump"), (np.nan, "nan"), (2.0, "boundary")])
def test_jumps_and_nan(factor, end):
    found = trace(altered(data(mixed_plane(), RIGHT), "u", 1, factor), [[0.1, 0.3]])
    assert found.counts() == {end: 1}
    assert found[0][-1, 0] == pytest.approx(3 if end == "boundary" else 1, abs=1e-13)


def test_lines_along_sides_and_through_vertices():
    dataset = data(mixed_plane(1), RIGHT)
    seeds = [[0, 0], [0, 1], [0, 0.5], [1, 0.5], [1.5, 0.5]]
    found = trace(dataset, seeds)
    assert found.counts() == {"boundary": 5}
    assert all(found[line][-1] == pytest.approx([3, seed[1], 0], abs=1e-12) for line, seed in enumerate(seeds))
    diagonal = trace(data(grid(Shape.TETRAHEDRON, 2), dict.fromkeys("uvw", constant(1))), [[0, 0, 0]])
    assert diagonal[0][-1] == pytest.approx([1, 1, 1], abs=1e-12)


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.TETRAHEDRON, Shape.PYRAMID])
@pytest.mark.sampled(free=("shape",))
def test_circles_that_touch_sides_between_elements_continue(shape):
    """Seeds are the points of contact, in planes of the mesh; lines ended as jumps there."""
    d = shape.dimension
    still = {**ROTATION, "w": constant(0)}
    seeds = [[0.25, 0.25, 0.25], [0.75, 0.75, 0.25], [0.25, 0.5, 0.25], [0.5, 0.75, 0.5]]
    seeds = np.array(seeds)[:, :d]
    dataset = data(grid(shape, 2), of_dimension(still, d), 2 if shape is not Shape.PYRAMID else 3)
    found = trace(dataset, seeds, duration=2 * np.pi)
    assert found.counts() == {"duration": len(seeds)}
    for line, seed in enumerate(seeds):
        times = found.time[found.offsets[line] : found.offsets[line + 1]]
        expected = np.array([turned(np.append(seed, 0.0)[:3], time)[:2] for time in times])
        assert np.abs(found[line][:, :2] - expected).max() < 1e-11


def linear(matrix, centre):
    """The components of the velocity A (x - c)."""
    d = len(centre)
    return {name: lambda p, row=row: (p[:, :d] - centre) @ row for name, row in zip("uvw", matrix, strict=False)}


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.sampled(least=3, free=("seed",))
def test_lines_that_begin_at_vertices_of_curved_elements(seed):
    """Short lines of random linear fields, at all their points, against the exponential of the matrix."""
    rng = np.random.default_rng(seed)
    shape = [shape for shape in Shape if shape.dimension > 1][seed % 6]
    d = shape.dimension
    order = int(rng.integers(1, 4))
    mesh = curved(grid(shape, 2 if d == 2 else 1), ripple(0.1, seed), order + 1)
    matrix = rng.normal(size=(d, d))
    matrix = matrix - matrix.T if seed % 2 else matrix - np.eye(d) * np.trace(matrix) / d
    centre = rng.uniform(0.3, 0.7, d)
    dataset = data(mesh, linear(matrix, centre), order + 1 + 2 * (shape is Shape.PYRAMID))
    seeds = np.concatenate([mesh.vertices, mesh.vertices[:-1] / 2 + mesh.vertices[1:] / 2])[:, :d]
    found = trace(dataset, seeds, duration=0.5)
    assert "jump" not in found.counts()
    for line in np.flatnonzero(np.diff(found.offsets)):
        times = found.time[found.offsets[line] : found.offsets[line + 1]]
        points = found[line][:, :d]
        expected = centre + np.array([expm(matrix * time) @ (points[0] - centre) for time in times])
        assert np.abs(points - expected).max() < 1e-10


def test_a_step_is_accepted_only_if_its_dense_output_follows_the_velocity(monkeypatch):
    """Even if the embedded methods find no error at all in the widest steps."""
    monkeypatch.setattr(Tracer, "_error", lambda self, active, taken: np.zeros(len(active)))
    mesh = curved(grid(Shape.QUADRILATERAL, 1), ripple(0.1), 4)
    found = trace(data(mesh, of_dimension(ROTATION, 2), 4), [[0.5, 0.8]], duration=4 * np.pi)
    assert found[0][-1] == pytest.approx([0.5, 0.8, 0], abs=1e-10)


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.TETRAHEDRON, Shape.PRISM, Shape.HEXAHEDRON])
def test_the_first_step_is_as_wide_as_bounds_of_its_element_allow(shape, monkeypatch):
    """Even if no step is found to err at all; steps that follow are judged by their errors."""
    monkeypatch.setattr(Tracer, "_error", lambda self, active, taken: np.zeros(len(active)))
    monkeypatch.setattr(Tracer, "_defect", lambda self, lines, taken, nets: np.zeros(len(lines)))
    d = shape.dimension
    mesh = curved(grid(shape, 1), ripple(0.05), 3)
    seeds = 0.5 + 0.6 * (mesh.vertices[:, :d] - 0.5)
    found = trace(data(mesh, of_dimension(ROTATION, d), 5), seeds, duration=9.0, steps=1)
    ends = found.offsets[1:] - 1
    times, firsts = found.time[ends], found.points[found.offsets[:-1]]
    expected = [turned(first, time) for first, time in zip(firsts, times, strict=True)]
    assert times.max() > 1e-3
    assert found.points[ends][:, :2] == pytest.approx(np.array(expected)[:, :2], abs=1e-11)


def test_rest_focus_circle_and_limits():
    square = grid(Shape.QUADRILATERAL, 1)
    still = trace(data(square, dict.fromkeys("uv", constant(0))), [[0.3, 0.3], [7, 7]])
    assert still.counts() == {"stagnation": 1, "outside": 1}
    assert (still.offsets.tolist(), len(still[1])) == ([0, 1, 1], 0)
    focus = {
        "u": lambda p: 4 * (0.5 - p[:, 0]) - (p[:, 1] - 0.5),
        "v": lambda p: 4 * (0.5 - p[:, 1]) + (p[:, 0] - 0.5),
    }
    dataset = data(square, focus)
    slow = trace(dataset, [[0.8, 0.5]], speed=0.5)
    assert slow.counts() == {"speed": 1}
    assert trace(dataset, [[0.8, 0.5]]).counts() == {"stagnation": 1}
    circle = data(square, of_dimension(ROTATION, 2))
    assert trace(circle, [[0.8, 0.5]], steps=5).counts() == {"steps": 1}
    arc = trace(circle, [[0.8, 0.5]], length=0.7)
    assert arc.counts() == {"length": 1}
    assert arc[0][-1] == pytest.approx(turned([0.8, 0.5, 0], 0.7 / 0.3), abs=1e-11)
    assert arc.length[-1] == pytest.approx(0.7, abs=1e-14)
    assert np.diff(arc.length).max() <= 0.005 * np.sqrt(2) * (1 + 1e-6)


def test_an_inverted_element_ends_lines():
    mesh = grid(Shape.QUADRILATERAL, 2)
    vertices = np.array(mesh.vertices)
    vertices[4] = 1.2, 0.5, 0
    found = trace(data(replace(mesh, vertices=vertices), RIGHT), [[0.1, 0.6], [0.1, 0.1]])
    assert [found.ends[end] for end in found.end] == ["inverted", "boundary"]


def test_lines_in_quasi_3d_data_cross_the_period():
    mesh = curved(grid(Shape.QUADRILATERAL, 1), ripple(0.04), 3)
    plane = data(mesh, of_dimension(ROTATION, 2), 5)
    waves = Homogeneous((Basis.FOURIER,), (0.5,), (0, 1))
    fields = []
    for name, own, factor in (("u", "u", 1), ("v", "v", 1), ("w", "u", 0)):
        (block,) = plane.field(own).blocks
        first = factor * block.coefficients
        both = np.hstack([first, 0 * first])
        fields.append(
            Field(name, (replace(block, expansion=replace(block.expansion, homogeneous=waves), coefficients=both),))
        )
    found = trace(Dataset(mesh, tuple(fields)), [[0.75, 0.5, 0.2]], ["u", "v", "0.3"], duration=np.pi)
    assert found[0][-1] == pytest.approx([0.25, 0.5, 0.2 + 0.3 * np.pi], abs=1e-10)


def test_velocities_that_are_guessed():
    functions = {"rho": constant(2), "rhou": constant(3), "rhov": constant(0)}
    found = trace(data(mixed_plane(), functions), [[0.1, 0.3]], duration=1)
    assert found[0][-1] == pytest.approx([1.6, 0.3, 0], abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"velocity": "u,v,u"}, "expected a velocity of 2 components, as the data have the coordinates x, y, found 3"),
        ({"velocity": "u,vel"}, "there is no 'vel'"),
        ({"direction": "up"}, "expected a direction, one of forward, backward, both, found 'up'"),
        ({"length": 0.0}, "length: expected a positive number, found 0"),
        ({"tolerance": float("nan")}, "tolerance: expected a positive number"),
        ({"steps": 0}, "steps: expected at least 1"),
        ({"seeds": "line:0,0:1"}, "expected seeds as line:P:Q:N, found 'line:0,0:1'"),
        ({"seeds": "lin:0,0:1,1:3"}, "expected seeds as one of .* found 'lin:0,0:1,1:3' .perhaps line."),
        ({"seeds": "plane:0,0:0,0:4"}, "expected seeds as plane:POINT:NORMAL:N, found 'plane:0,0:0,0:4'"),
        ({"seeds": "plane:0,0,9:0,0,1:4"}, "expected elements on the plane, found none"),
        ({"seeds": "elements:3"}, "expected seeds as elements, found 'elements:3'"),
        ({"seeds": "boundary:inlet"}, "there is no boundary 'inlet'; there are all, boundary"),
        ({"seeds": "random:4:10,10:11,11"}, "expected elements in the box, found 0 of 4"),
        ({"seeds": []}, "expected at least one seed"),
    ],
)
def test_invalid_input_is_rejected(arguments, match):
    with pytest.raises(ElvisError, match=match):
        trace(data(mixed_plane(), RIGHT), **{"seeds": [[0.1, 0.3]], **arguments})


def test_one_dimensional_data_have_no_streamlines():
    with pytest.raises(ElvisError, match="the data lack a velocity: u, v, w"):
        trace(data(mixed_plane(), {"p": constant(1)}), [[0.1, 0.3]])
    with pytest.raises(ElvisError, match="expected 2D or 3D data"):
        trace(Dataset(grid(Shape.SEGMENT, 1)), [[0.1]])


@pytest.mark.parametrize(
    ("text", "count"),
    [("point:1,0.5", 1), ("line:0.1,0.1:0.1,0.9:5", 5), ("disc:1,0.5:0,0,1:0.3:7", 7), ("grid:0,0:3,1:4,3", 12),
     ("plane:0,0:0,0,1:6", 12), ("elements", 4), ("boundary:all:2", 16), ("random:10", 10), ("random:3:0,0:1,1", 3)],
)  # fmt: skip
def test_seeds_from_texts(text, count):
    dataset = data(mixed_plane(), RIGHT)
    first, again = (trace(dataset, text, length=1e-3) for _ in range(2))
    assert len(first) == count
    assert first.counts().get("outside", 0) == 0
    assert (first.points == again.points).all()


def test_seeds_from_tables(tmp_path):
    (tmp_path / "seeds.csv").write_text("x,y\n0.1,0.2\n9,9\n", encoding="utf-8")
    found = trace(data(mixed_plane(), RIGHT), [tmp_path / "seeds.csv", "point:1,0.5"])
    assert found.counts() == {"outside": 1, "boundary": 2}
    assert found.seed.tolist() == [0, 1, 2]


def test_a_lattice_on_a_cut_lies_on_it_in_elements():
    dataset = data(curved(mixed_volume(0), ripple(0.02), 2), {name: constant(1) for name in "uvw"})
    normal = np.array([1.0, 2.0, 3.0])
    found = trace(dataset, "plane:1,0.5,0.5:1,2,3:12", length=1e-3)
    starts = found.points[found.offsets[:-1]]
    assert found.counts().get("outside", 0) == 0
    assert len(found) > 20
    assert np.abs((starts - [1, 0.5, 0.5]) @ normal).max() < 1e-13
    gaps = np.linalg.norm(starts[:, None] - starts[None], axis=2)[np.triu_indices(len(starts), 1)]
    assert gaps.min() == pytest.approx(np.sort(gaps)[len(starts) - 1], rel=1e-9)


def test_many_lines_are_announced(monkeypatch):
    from elvis.core.streamlines import course

    bare = Dataset(grid(Shape.QUADRILATERAL, 1))
    data = Dataset(bare.mesh, tuple(approximated(bare, name, lambda p: 1 + 0 * p[:, 0], 2) for name in "uv"))
    said = []
    monkeypatch.setattr(course, "announce", said.append)
    monkeypatch.setattr(course, "MANY_LINES", 3)
    for count in (3, 4):
        course.Flow.of(data, course.Course((f"random:{count}",), length=0.1))
    assert said == ["following 4 lines; Ctrl-C stops"]


def test_a_clip_cuts_a_circle_where_the_surface_is():
    """One turn about (0.5, 0.5), cut at x = 0.6: from the seed to there, and from there on again."""
    dataset = data(grid(Shape.QUADRILATERAL, 3), of_dimension(ROTATION, 2), 2)
    seed, radius = [0.8, 0.5], 0.3
    lines = trace(dataset, [seed], duration=2 * np.pi)
    found = clipped_lines(lines, dataset, "plane:0.6,0,0:1,0,0")
    assert [found.ends[code] for code in found.end] == ["clip", "duration"]
    assert (found.seed == 0).all()
    angle = np.arccos(0.1 / radius)
    first, second = found[0], found[1]
    cuts = np.array([first[-1], second[0]])
    assert np.abs(cuts - [[0.6, 0.5 + 0.1 * s, 0] for s in (np.sqrt(8), -np.sqrt(8))]).max() < 1e-8
    times = found.time[[found.offsets[1] - 1, found.offsets[1]]]
    assert times == pytest.approx([angle, 2 * np.pi - angle], abs=1e-3)
    assert (found.points[:, 0] > 0.6 - 1e-12).all()
    whole = clipped_lines(lines, dataset, "plane:5,0,0:-1,0,0")
    assert np.array_equal(whole.points, lines.points)
    with pytest.raises(ElvisError, match="expected some of the lines to be left"):
        clipped_lines(lines, dataset, "sphere:0.5,0.5,0:3")
