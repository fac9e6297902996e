"""Distances to curved boundaries and triangle files against analytic expressions, subdivision, libigl, one another."""

from dataclasses import replace

import igl
import numpy as np
import pytest
import trimesh

from elvis import Dataset, read
from elvis.core.base.errors import ElvisError
from elvis.core.bounds.bounding import quantity_range
from elvis.core.data.mesh import Composite
from elvis.core.distances import nearest, surface_of
from elvis.core.distances.boundaries import bodies
from elvis.core.mapping.inverse import Status
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.elements.sides import places_on_sides
from elvis.core.quantities.evaluator import Evaluator, Sampler
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, with_field
from elvis.plugins.samples.sample import write_sample

LINEAR = {2: [(0, 1, 1)], 3: [(0, 1, 2)], 4: [(0, 1, 2), (0, 2, 3)]}


def wavy(points):
    """Points moved along by waves, in the plane where they are."""
    x, y, z = points.T
    return points + 0.08 * np.stack([np.sin(3 * y), np.cos(x + 2 * y), z * np.sin(3 * x * y)], axis=1)


def to_triangles(corners, point):
    """(n,) distances of a point to triangles (n, 3, 3): to their planes above and below them, else to their edges."""
    found, inside = np.full(len(corners), np.inf), np.full(len(corners), True)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for a, b in ((0, 1), (1, 2), (2, 0)):
        way, gap = corners[:, b] - corners[:, a], point - corners[:, a]
        square = (way**2).sum(axis=1)
        part = np.clip((gap * way).sum(axis=1) / np.where(square > 0, square, 1.0), 0, 1)
        found = np.minimum(found, np.linalg.norm(gap - part[:, None] * way, axis=1))
        inside &= (np.cross(normal, way) * gap).sum(axis=1) > 0
    size = np.linalg.norm(normal, axis=1)
    height = np.abs((normal * (point - corners[:, 0])).sum(axis=1)) / np.where(size > 0, size, 1.0)
    return np.where(inside & (size > 0), height, found)


def subdivided(surface, point, goal=1e-13):
    """The distance by cutting alone: pieces go that are farther, by their linear part less their bend, than corners."""
    best, waiting = np.inf, list(surface.groups)
    for _ in range(40):
        least = []
        for group in waiting:
            best = min(best, np.linalg.norm(group.vertices - point, axis=2).min())
            own = group.coefficients
            across = own[:, 1, 0] if group.corners > 2 else 0 * own[:, 0, 0]
            ways = {2: [(-1, 0), (1, 0)], 3: [(-1, -1), (1, -1), (-1, 1)], 4: [(-1, -1), (1, -1), (1, 1), (-1, 1)]}
            flat = np.stack([own[:, 0, 0] + s * own[:, 0, 1] + t * across for s, t in ways[group.corners]], axis=1)
            near = [to_triangles(flat[:, list(of)], point) for of in LINEAR[group.corners]]
            least.append(np.min(near, axis=0) - group.bounds[:, 9])
        if best - min(map(np.min, least)) < goal:
            return best
        kept = [group.part(np.flatnonzero(low <= best)) for group, low in zip(waiting, least, strict=True)]
        waiting = [group.parts() for group in kept if len(group)]
    raise AssertionError("expected subdivision to settle")


def with_points(mesh, seed, beyond, count):
    """A wavy dataset, all its boundary, and points in the box of that and as far as ``beyond`` around it."""
    dataset = Dataset(curved(mesh(seed=seed), wavy, 4))
    surface = surface_of(dataset, "all")
    boxes = np.concatenate(list(surface.boxes()))
    low, high = boxes[:, :3].min(axis=0) - beyond, boxes[:, 3:].max(axis=0) + beyond
    points = np.random.default_rng(seed + 1).uniform(low, high, (count, 3))
    points[:, dataset.mesh.dimension :] = 0.0
    return dataset, surface, points


@pytest.mark.thorough
@pytest.mark.parametrize("mesh", [mixed_volume, mixed_plane])
def test_distances_to_curved_boundaries_match_those_of_subdivision(mesh):
    _, surface, points = with_points(mesh, seed=1, beyond=0.5, count=25)
    found = nearest(surface, points)
    truth = [subdivided(surface, point) for point in points]
    boxes = np.concatenate(list(surface.boxes()))
    size = np.linalg.norm(boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0))
    assert np.abs(np.abs(found.distance) - truth).max() < 1e-11 * size
    gap = np.linalg.norm(points - found.place, axis=1)
    assert np.abs(gap - np.abs(found.distance)).max() < 1e-15


@pytest.mark.parametrize("mesh", [mixed_volume, mixed_plane])
def test_distances_to_closed_boundaries_are_negative_inside(mesh):
    dataset, surface, points = with_points(mesh, seed=3, beyond=0.3, count=1500)
    inside = Sampler(dataset, []).sample(points).location.status == Status.INSIDE
    assert surface.is_closed
    assert 100 < inside.sum() < 1400
    assert ((nearest(surface, points).distance < 0) == inside).all()


@pytest.mark.parametrize("mesh", [mixed_volume, mixed_plane])
def test_gradients_of_distances_are_limits_of_differences(mesh):
    dataset, surface, points = with_points(mesh, seed=5, beyond=0.0, count=60)
    axes = "xyz"[: dataset.mesh.dimension]
    found = evaluated(dataset, points, [f"d(distance(all),{axis})" for axis in axes])
    inside = np.isfinite(found).all(axis=1)
    assert inside.sum() > 20
    step = 1e-6 * np.eye(3)
    ends = [[nearest(surface, points + sign * own).distance for sign in (1, -1)] for own in step[: len(axes)]]
    truth = np.stack([(one - other) / 2e-6 for one, other in ends], axis=1)
    # where two places are equally near, the difference is none
    assert np.quantile(np.abs(found - truth)[inside].max(axis=1), 0.8) < 1e-8
    assert np.abs(np.linalg.norm(found[inside], axis=1) - 1).max() < 1e-14


def evaluated(dataset, points, texts):
    """(n, k) values of expressions at points."""
    return Sampler(dataset, [Expression.of(dataset, text) for text in texts]).sample(points).values


@pytest.mark.parametrize("mesh", [mixed_volume, mixed_plane])
def test_the_direction_away_from_a_wall_is_its_inward_normal_there(mesh):
    """The normals come from the elements' maps, the directions from the surface."""
    dataset = Dataset(curved(mesh(seed=7), wavy, 4))
    axes = "xyz"[: dataset.mesh.dimension]
    names = [f"bfc_dir1_{axis}(all)" for axis in axes]
    expressions = [Expression.of(dataset, text) for text in (*names, *(f"n{axis}" for axis in axes), "distance(all)")]
    evaluator = Evaluator(dataset, expressions)
    for patch in evaluator.patches:
        places = places_on_sides(patch.shape)
        rows = np.repeat(np.arange(len(patch)), len(places))
        points = ElementPoints(patch, rows, np.tile(places, (len(patch), 1)))
        values = np.stack([*evaluator.values_at(expressions, points)])
        on_wall = np.abs(values[-1]) < 1e-13
        assert on_wall.any()
        assert np.abs(values[: len(axes)] + values[len(axes) : -1])[:, on_wall].max() < 1e-11


def test_the_velocity_fitted_to_a_flat_wall_has_the_cartesian_components():
    """Of the unit cube's floor z = 0: dir1 is z, and with the assisting vector y dir0 is z x y = -x, dir2 = y."""
    functions = {"u": lambda p: 1 + p[:, 0], "v": lambda p: 2 - p[:, 1] * p[:, 2], "w": lambda p: p[:, 0] ** 2}
    mesh = grid(Shape.HEXAHEDRON, 2)
    floor = Composite(9, (("F", floor_of(mesh)),), "floor")
    bare = Dataset(replace(mesh, composites=(*mesh.composites, floor)))
    dataset = replace(bare, fields=tuple(approximated(bare, name, own, 3) for name, own in functions.items()))
    points = np.random.default_rng(2).uniform(0, 1, (30, 3)) * (1, 1, 0.4)
    points[:5, 2] = 0.0
    texts = [f"{name}(floor, 0, 1, 0)" for name in ("u_bfc", "v_bfc", "w_bfc")]
    u, v, w = (own(points) for own in functions.values())
    truth = np.stack([-u, w, v], axis=1)
    assert np.abs(evaluated(dataset, points, texts) - truth).max() < 1e-12
    # the z axis is along the normal, which leaves no direction in the wall
    assert np.isnan(evaluated(dataset, points, ["u_bfc(floor)"])).all()


def test_the_indicator_of_a_box(tmp_path):
    """Distances to the faces of a box of half the cube's size, in closed form; without a face it isn't closed."""
    box = trimesh.creation.box((0.5, 0.5, 0.5), trimesh.transformations.translation_matrix((0.5, 0.5, 0.5)))
    box.export(tmp_path / "box.stl")
    box.update_faces(np.arange(10))
    box.export(tmp_path / "open.stl")
    dataset = Dataset(grid(Shape.HEXAHEDRON, 1))
    points = np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 0.75], [0.5, 0.95, 0.5], [0.3, 0.5, 0.5]])
    found = evaluated(dataset, points, [f"indicator('{tmp_path / 'box.stl'}', 0.1)"])[:, 0]
    distances = np.array([-0.25, 0, 0.2, -0.05])
    assert found == pytest.approx((1 - np.tanh(distances / 0.1)) / 2, abs=1e-12)
    for scale, file, sentence in ((0.1, "open.stl", "expected a closed surface"), (0, "box.stl", "a positive scale")):
        with pytest.raises(ElvisError, match=sentence):
            Expression.of(dataset, f"indicator('{tmp_path / file}', {scale})")


def floor_of(mesh):
    """Ids of the faces in the plane z = 0."""
    faces, edges = mesh.of(Shape.QUADRILATERAL), mesh.of(Shape.SEGMENT)
    heights = mesh.vertices[edges.members[faces.members]][..., 2]
    return faces.ids[(heights == 0).all(axis=(1, 2))]


def shell(points):
    """The unit cube as a part of a shell, from radius 1 to 2."""
    r, a, b = 1 + points[:, 0], points[:, 1] - 0.5, points[:, 2] - 0.5
    return r[:, None] * np.stack([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)], axis=1)


@pytest.mark.parametrize("shape", [Shape.HEXAHEDRON, Shape.TETRAHEDRON, Shape.PRISM])
def test_the_distance_to_a_sphere_is_as_accurate_as_the_mesh(shape):
    mesh = with_sphere(curved(grid(shape, 2), shell, 6))
    surface = surface_of(Dataset(mesh), "sphere")
    spots = np.random.default_rng(5).uniform(-1, 1, (200, 2))
    off = 0.0
    for group in surface.groups:
        inner = spots if group.corners == 4 else spots[spots.sum(axis=1) <= 0]
        radii = [
            np.linalg.norm(group.at(np.tile(spot, (len(group), 1)), np.arange(len(group))), axis=1) for spot in inner
        ]
        off = max(off, np.abs(np.array(radii) - 1).max())
    points = shell(np.random.default_rng(6).uniform([0, 0.1, 0.1], [1, 0.9, 0.9], (500, 3)))
    error = np.abs(nearest(surface, points).distance - (np.linalg.norm(points, axis=1) - 1)).max()
    assert off < 1e-4
    assert error < 1.5 * off
    assert not surface.is_closed


def with_sphere(mesh):
    """The mesh with its faces of radius 1 as a boundary."""
    (outer,) = (own for own in mesh.composites if own.name == "boundary")
    chosen = []
    for tag, ids in outer.parts:
        own = [i for i in ids if np.allclose(np.linalg.norm(face_points(mesh, i), axis=1), 1)]
        chosen.append((tag, np.array(own, dtype=np.int64)))
    return replace(mesh, composites=(*mesh.composites, Composite(7, tuple(chosen), "sphere")))


def face_points(mesh, face):
    """The vertices of the face with this id."""
    for shape in (Shape.TRIANGLE, Shape.QUADRILATERAL):
        rows = np.flatnonzero(mesh.of(shape).ids == face)
        if len(rows):
            edges = mesh.of(shape).members[rows[0]]
            return mesh.vertices[np.unique(mesh.of(Shape.SEGMENT).members[edges])]
    raise AssertionError(face)


def test_distances_to_planes_are_coordinates():
    dataset = Dataset(grid(Shape.PRISM, 2))
    points = np.random.default_rng(7).uniform(0, 1, (300, 3))
    truth = -np.minimum(points, 1 - points).min(axis=1)
    for name in ("all", "boundary", "1"):
        assert np.abs(nearest(surface_of(dataset, name), points).distance - truth).max() < 1e-15
    outside = 1 + np.random.default_rng(8).uniform(0, 1, (300, 3))
    assert np.allclose(
        nearest(surface_of(dataset, "all"), outside).distance, np.linalg.norm(outside - 1, axis=1), rtol=1e-14
    )


def saved(folder, mesh, name="surface.stl"):
    """The name of a file with a mesh."""
    mesh.export(folder / name)
    return str(folder / name)


def test_the_distance_to_a_cube_is_known(tmp_path):
    surface = surface_of(None, saved(tmp_path, trimesh.creation.box((2, 2, 2))))
    points = np.random.default_rng(1).uniform(-2, 2, (2000, 3))
    points[:300] = np.round(points[:300])
    beyond = np.abs(points) - 1
    truth = np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)
    assert np.abs(nearest(surface, points).distance - truth).max() < 1e-15


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "glb"])
def test_distances_to_files_match_those_of_libigl(tmp_path, suffix):
    ball = trimesh.creation.icosphere(2)
    spikes = ball.copy()
    spikes.vertices *= 1 + 0.9 * (np.arange(len(ball.vertices)) % 5 == 0)[:, None]
    file = saved(tmp_path, spikes, f"spikes.{suffix}")
    surface, points = surface_of(None, file), np.random.default_rng(2).uniform(-2, 2, (3000, 3))
    read = trimesh.load_mesh(file)
    vertices, faces = np.asarray(read.vertices, np.float64), np.asarray(read.faces, np.int64)
    truth = igl.signed_distance(points, vertices, faces, sign_type=igl.SIGNED_DISTANCE_TYPE_WINDING_NUMBER)[0]
    found = nearest(surface, points).distance
    assert surface.is_closed
    assert np.abs(found - truth).max() < 1e-13


def test_hollow_inverted_and_crossing_bodies_have_the_sign_of_the_winding_number(tmp_path):
    ball, small = trimesh.creation.icosphere(2), trimesh.creation.icosphere(2, radius=0.5)
    hollow = trimesh.util.concatenate([ball, trimesh.Trimesh(small.vertices, small.faces[:, ::-1])])
    turned = trimesh.Trimesh(ball.vertices, ball.faces[:, ::-1])
    confused = trimesh.Trimesh(ball.vertices, np.where(np.arange(320)[:, None] % 3, ball.faces, ball.faces[:, ::-1]))
    pair = trimesh.util.concatenate([ball, ball.copy().apply_translation((1, 0, 0))])
    points = np.random.default_rng(3).uniform(-1.4, 2.4, (3000, 3))
    radius = np.linalg.norm(points, axis=1)
    clear = (np.abs(radius - 1) > 0.03) & (np.abs(radius - 0.5) > 0.03)
    clear &= np.abs(np.linalg.norm(points - (1, 0, 0), axis=1) - 1) > 0.03
    for name, mesh, inside in (
        ("hollow", hollow, (radius < 1) & (radius > 0.5)),
        ("turned", turned, radius < 1),
        ("confused", confused, radius < 1),
        ("pair", pair, (radius < 1) | (np.linalg.norm(points - (1, 0, 0), axis=1) < 1)),
    ):
        found = nearest(surface_of(None, saved(tmp_path, mesh, f"{name}.stl")), points).distance
        assert ((found < 0) == inside)[clear].all(), name


def test_open_surfaces_have_no_sign(tmp_path):
    box = trimesh.creation.box((2, 2, 2))
    surface = surface_of(None, saved(tmp_path, trimesh.Trimesh(box.vertices, box.faces[1:])))
    assert not surface.is_closed
    assert (nearest(surface, np.random.default_rng(1).uniform(-2, 2, (200, 3))).distance >= 0).all()


def test_bounds_contain_all_distances_and_are_tight():
    dataset = with_field(curved(mixed_plane(seed=1), wavy, 4), lambda p: p[:, 0])
    for text in ("distance(all)", "min(distance(all) + 0.2, u) - 0.06"):
        expression = Expression.of(dataset, text)
        found = quantity_range(dataset, expression)
        points = np.random.default_rng(3).uniform(-0.5, 3.5, (3000, 3)) * (1, 1, 0)
        values = Sampler(dataset, [expression]).sample(points).values[:, 0]
        assert found.lower <= np.nanmin(values)
        assert np.nanmax(values) <= found.upper
        assert found.upper - found.lower < 1.3 * (found.maximum - found.minimum)
        assert np.isfinite(values).any()


def test_distances_are_lipschitz_continuous():
    surface = surface_of(Dataset(curved(mixed_volume(seed=1), wavy, 4)), "all")
    points = np.random.default_rng(9).uniform(-0.5, 3.5, (400, 3))
    step = 1e-3 * np.random.default_rng(10).normal(size=points.shape)
    change = nearest(surface, points + step).distance - nearest(surface, points).distance
    assert (np.abs(change) <= np.linalg.norm(step, axis=1) + 1e-14).all()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("distance(wng)", "there is no boundary 'wng'; there are all, boundary, 1; files of triangles end in .stl"),
        ("distance('none.stl')", "none.stl: there is no such file"),
        ("distance(none.stl)", "there is no boundary 'none'"),
        ("distance('a.vtk')", "there is no boundary 'a.vtk'"),
        ("distance()", "expected a boundary, or a file in quotes, found ')'"),
        ("distance(u, 2)", "there is no boundary 'u'"),
        ("distance(all, 2)", "expected ) after a boundary"),
        ("d(d(distance(all), x), y)", "there is no derivative of d(distance(all),x)"),
        ("u_bfc(all)", "the data lack a velocity"),
        ("bfc_dir0_x(all, 0, 1)", "expected three numbers after all, such as bfc_dir0_x(all, 0, 1, 0)"),
        ("indicator(all, 0.1)", "expected a file of triangles in quotes, found the boundary all"),
        ("indicator(all)", "expected one number after all, such as indicator(all, 0.1)"),
        ("bfc_dir0_x(all, 0, 0, 0)", "expected a vector across the plane or, in 3D, any but zero"),
    ],
)
def test_invalid_distances_are_rejected(text, sentence):
    with pytest.raises(ElvisError) as found:
        Expression.of(with_field(grid(Shape.HEXAHEDRON, 1), lambda p: p[:, 0]), text)
    assert sentence in str(found.value)


@pytest.mark.parametrize("content", ["", "solid\nendsolid\n", "another type", "solid x\n facet normal"])
def test_files_without_triangles_give_a_one_line_error(tmp_path, content):
    file = tmp_path / "broken.stl"
    file.write_text(content)
    with pytest.raises(ElvisError, match=r"broken\.stl: expected"):
        surface_of(None, str(file))


def test_a_field_named_distance_remains_a_field():
    mesh = grid(Shape.HEXAHEDRON, 1)
    field = approximated(Dataset(mesh), "distance", lambda p: p[:, 0], 3)
    names = Names.of(Dataset(mesh, (field,)))
    assert Expression.parse("distance", names).is_field
    assert Expression.parse("distance + distance(all)", names).fields == ("distance",)


def test_points_that_are_not_finite_have_no_distance():
    surface = surface_of(Dataset(grid(Shape.HEXAHEDRON, 1)), "all")
    found = nearest(surface, np.array([[np.nan, 0, 0], [np.inf, 0, 0], [2.0, 0.5, 0.5]])).distance
    assert np.isnan(found[:2]).all()
    assert found[2] == 1.0


#: sides of a box of 4 x 4 x 4 cubes, by which a cell of the middle, or one on the floor, differs from its neighbours
BODIES = {
    "in the middle": ((1, 1, 1), (3, 2, 2), ["body"], 0.5),
    "on the floor": ((1, 1, 0), (2, 3, 1), ["body"], 0.5),
    "from floor to lid": ((1, 1, 0), (2, 2, 4), ["body"], 1.0),
    "through a channel": ((0, 1, 0), (4, 2, 4), [], 0.0),
    "a hole in a side": ((0, 1, 1), (0, 2, 2), [], 0.0),
    "alone": (None, None, [], 0.0),
}


@pytest.mark.parametrize("name", BODIES)
def test_bodies_are_enclosed_by_other_boundaries(name):
    low, high, wanted, size = BODIES[name]
    mesh = grid(Shape.HEXAHEDRON, 4)
    faces, edges = mesh.of(Shape.QUADRILATERAL), mesh.of(Shape.SEGMENT)
    corners = np.rint(4 * mesh.vertices[edges.members[faces.members]].reshape(len(faces), -1, 3))
    (_, own) = mesh.composites
    composites = [replace(own, name="far")]
    if low is not None:
        inside = ((corners >= low) & (corners <= high)).all(axis=(1, 2))
        on_side = np.zeros(len(faces), bool)
        for axis in range(3):
            for place in {low[axis], high[axis]}:
                on_side |= (corners[..., axis] == place).all(axis=1)
        composites.append(Composite(2, (("F", faces.ids[inside & on_side]),), "body"))
    found = bodies(replace(mesh, composites=tuple(composites)))
    assert (list(found.names), found.size) == (wanted, pytest.approx(size))
    if wanted:
        assert found.box == pytest.approx(np.array([low, high]) / 4)


def test_a_cylinder_is_a_body_of_2d_data(tmp_path):
    write_sample("cylinder", tmp_path)
    found = bodies(read(tmp_path / "cylinder.xml").mesh)
    assert found.names == ("cylinder",)
    # a circle of radius 1, with nodes on the axes, in one of radius 5
    assert found.box == pytest.approx(np.array([[-1, -1, 0], [1, 1, 0]]))
    assert found.size == pytest.approx(1 / 5)
