"""What isosurfaces of distances call certain, against dense samples of the distance and closed forms."""

import numpy as np
import pytest
import trimesh

from elvis import Camera, Status
from elvis.core.distances import nearest, surface_of
from elvis.core.numbers.sampling import sample
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, ripple, with_field
from elvis.plugins.runtime.serving import volume_of
from elvis.renderer.raster.pixels import NOBODY
from elvis.scene import unit
from elvis.scene.cameras.view import View

SIZE, COUNT = (28, 22), 90


@pytest.fixture(scope="module")
def level(renderer):
    """The drawer of distances to what a text says, in a dataset."""

    def drawer(dataset, text):
        drawing = renderer("vulkan")
        drawing.show(volume_of(dataset, [text]))
        assert drawing.stages.distances.knows(None)
        return drawing.stages.distances.draw

    return drawer


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A closed body with spikes, and the same without some of its triangles."""
    folder = tmp_path_factory.mktemp("bodies")
    ball = trimesh.creation.icosphere(1, radius=0.35)
    ball.vertices *= 1 + 0.8 * (np.arange(len(ball.vertices)) % 4 == 0)[:, None]
    ball.apply_translation((0.5, 0.5, 0.5))
    ball.export(folder / "spikes.ply")
    trimesh.Trimesh(ball.vertices, ball.faces[::3]).export(folder / "open.ply")
    return folder


def view_of(seed):
    rng = np.random.default_rng(seed)
    eye = 0.5 + 2.6 * unit(rng.normal(size=3), "eye")
    lens = {"fov": 36.0} if seed % 2 else {"height": 1.7}
    return View.through(Camera(tuple(eye), (0.5, 0.5, 0.5), **lens), SIZE)


def bodies(files):
    """Name to a dataset, a text, and values."""
    wavy = with_field(curved(grid(Shape.HEXAHEDRON, 2), ripple(0.06), n=4), lambda p: p[:, 0])
    pyramids = with_field(curved(grid(Shape.PYRAMID, 2), ripple(0.05, seed=3), n=3), lambda p: p[:, 0])
    return {
        "inside of curved faces": (wavy, "distance(all)", (-0.06, -0.2)),
        "pyramids": (pyramids, "distance(all)", (-0.13,)),
        "spikes": (wavy, f"distance('{files / 'spikes.ply'}')", (0.07, -0.05, 0.0)),
        "open": (pyramids, f"distance('{files / 'open.ply'}')", (0.09,)),
    }


@pytest.mark.sampled(least=2, free=("body",))
@pytest.mark.parametrize("body", ["inside of curved faces", "pyramids", "spikes", "open"])
def test_dense_samples_never_refute_certain_pixels(level, files, body):
    dataset, text, values = bodies(files)[body]
    draw, surface = level(dataset, text), surface_of(dataset, text[9:-1].strip("'"))
    for seed, value in enumerate(values):
        view = view_of(seed)
        hits = draw(view, None, value)
        hit, sure = hits.owner != NOBODY, hits.status != Status.AMBIGUOUS
        assert hit.mean() > 0.05
        assert sure.mean() > 0.99
        origins, ways = view.every_ray()
        there = nearest(surface, (origins + hits.depth[:, None] * ways)[hit])
        assert np.abs(there.distance - value).max() < 1e-10

        # gradients lead from the nearest place to the hit, or away from it
        away = (origins + hits.depth[:, None] * ways)[hit] - there.place
        size = np.linalg.norm(away, axis=1, keepdims=True)
        far = size[:, 0] > 1e-3
        turned = np.abs((away / np.maximum(size, 1e-3) * hits.normal[hit]).sum(axis=1))
        assert np.abs(turned - 1)[far].max(initial=0.0) < 1e-9

        # nowhere before them does the distance cross the value within the domain
        depths = np.linspace(0.9, 4.4, COUNT)
        points = origins[:, None] + depths[:, None] * ways[:, None]
        inside = held(dataset, points.reshape(-1, 3)).reshape(-1, COUNT)
        above = np.full(inside.shape, np.nan)
        above[inside] = nearest(surface, points[inside]).distance - value
        crosses = above[:, 1:] * above[:, :-1] < 0
        first = np.where(crosses.any(axis=1), depths[1 + crosses.argmax(axis=1)], np.inf)
        assert crosses.any()
        assert (hits.depth[sure] <= first[sure]).all()


def held(dataset, points):
    """(n,) whether points lie in some element."""
    return sample(dataset, ["u"], points).location.element_id >= 0


def test_a_ball_around_a_corner_in_closed_form(level, tmp_path):
    """The distance to a triangle far longer than wide: rays meet rounded edges, sides, and nothing else."""
    corners = np.array([[0.2, 0.2, 0.4], [0.8, 0.25, 0.4], [0.3, 0.7, 0.4]])
    trimesh.Trimesh(corners, [[0, 1, 2]]).export(tmp_path / "one.obj")
    dataset = with_field(grid(Shape.TETRAHEDRON, 1), lambda p: p[:, 0])
    view = View.through(Camera((0.5, 0.5, 4.0), (0.5, 0.5, 0.0), (0.0, 1.0, 0.0), height=1.0), (60, 60))
    hits = level(dataset, f"distance('{tmp_path / 'one.obj'}')")(view, None, 0.15)
    origins = view.every_ray()[0]
    flat = nearest(surface_of(None, str(tmp_path / "one.obj")), origins * [1, 1, 0] + [0, 0, 0.4]).distance
    with np.errstate(invalid="ignore"):
        truth = np.where(flat < 0.15, 4.0 - 0.4 - np.sqrt(0.15**2 - flat**2), np.inf)
    assert np.array_equal(np.isfinite(truth), hits.owner != NOBODY)
    hit = np.isfinite(truth)
    assert np.abs(hits.depth[hit] - truth[hit]).max() < 1e-10
    assert (hits.status[hit] == Status.CERTAIN).mean() > 0.98
    assert (hits.status[~hit] == Status.MISS).all()


def test_all_layers_are_found_and_clear_misses_are_misses(level, tmp_path):
    """Balls around two points: four places along rays through both."""
    dots = [trimesh.creation.icosphere(0, radius=1e-3).apply_translation((x, 0.5, 0.5)) for x in (0.25, 0.75)]
    trimesh.util.concatenate(dots).export(tmp_path / "dots.ply")
    dataset = with_field(grid(Shape.PRISM, 2), lambda p: p[:, 0])
    draw = level(dataset, f"distance('{tmp_path / 'dots.ply'}')")
    view = View.through(Camera((5.0, 0.5, 0.5), (0.5, 0.5, 0.5), height=0.1), (9, 9))
    beyond = np.zeros(view.count)
    for expected in (4.05, 4.45, 4.55, 4.95):
        hits = draw(view, None, 0.2, beyond)
        assert (hits.owner != NOBODY).all()
        assert np.abs(hits.depth - expected).max() < 0.01
        beyond = hits.depth
    assert not (draw(view, None, 0.2, beyond).owner != NOBODY).any()


@pytest.fixture(scope="module")
def expressed(renderer):
    """The hits of a value of an expression in a dataset."""

    def draw(dataset, text, view, value):
        drawing = renderer("vulkan")
        drawing.show(volume_of(dataset, [text]))
        return drawing.stages.isosurfaces.draw(view, None, value)

    return draw


@pytest.mark.thorough
def test_dense_samples_never_refute_certain_pixels_of_expressions_with_distances(expressed, files):
    """Whatever a distance does to them: samples before a certain hit, or on a certain miss, are on one side."""
    dataset = bodies(files)["spikes"][0]
    distance = f"distance('{files / 'spikes.ply'}')"
    text = f"max({distance}, exp({distance})*abs(0.4*u - 0.2) - {distance}^2/(2 + u) + 0.02*x)"
    value, view = 0.15, view_of(3)
    hits = expressed(dataset, text, view, value)
    hit, sure = hits.owner != NOBODY, hits.status != Status.AMBIGUOUS
    assert 0.05 < hit.mean() < 0.9
    assert sure.mean() > 0.97
    assert (hits.status[hit] == Status.CERTAIN).mean() > 0.9

    # from where a ray enters to its hit, or to its end, values are on one side in each element
    origins, ways = view.every_ray()
    at_hits = sample(dataset, text, (origins + hits.depth[:, None] * ways)[hit & sure]).values[:, 0]
    assert np.abs(at_hits - value).max() < 1e-11
    ends = np.where(hit, hits.depth * (1 - 1e-6), 5.0)
    steps = ends[:, None, None] * np.linspace(0.0, 1.0, COUNT)[:, None]
    points = origins[:, None] + steps * ways[:, None]
    beyond = sample(dataset, text, points.reshape(-1, 3)).values.reshape(-1, COUNT) - value
    crossed = (np.fmin.reduce(beyond, axis=1) < -1e-9) & (np.fmax.reduce(beyond, axis=1) > 1e-9)
    assert not crossed[sure].any()


@pytest.mark.thorough
def test_distances_to_a_plane_are_polynomials(expressed, tmp_path):
    """Hits and misses are those of the polynomial that the expression is, to a bracket of the search."""
    corners = np.array([[-9.0, -9.0, -1.0], [9.0, -9.0, -1.0], [0.0, 15.0, -1.0]])
    trimesh.Trimesh(corners, [[0, 1, 2]]).export(tmp_path / "plane.ply")
    dataset = with_field(curved(grid(Shape.PRISM, 1), ripple(0.05), n=3), lambda p: p[:, 0] + 0.3 * p[:, 2] ** 2)
    view = view_of(4)
    found = expressed(dataset, f"y^2 - u*distance('{tmp_path / 'plane.ply'}')", view, -0.5)
    truth = expressed(dataset, "y^2 - u*(z + 1)", view, -0.5)
    both = (found.status != Status.AMBIGUOUS) & (truth.status != Status.AMBIGUOUS)
    assert both.mean() > 0.97
    assert np.array_equal(found.status[both], truth.status[both])
    hit = both & (truth.owner != NOBODY)
    assert hit.mean() > 0.05
    assert np.abs(found.depth[hit] - truth.depth[hit]).max() < 1e-10
