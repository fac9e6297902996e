"""How often surfaces wind around points, by rays, against the solid angle of all triangles."""

import numpy as np
import pytest
import trimesh

from elvis import Dataset
from elvis.core.distances import crossings, surface_of
from elvis.core.distances.crossings import by_solid_angle, crossings_in_plane, windings
from elvis.core.testing import curved, mixed_volume, ripple


def bodies(random):
    """Triangles (n, 3, 3) of some bodies: thin, hollow, touching, with spikes that cross one another, some turned."""
    every = []
    for _ in range(random.integers(2, 6)):
        kind = random.integers(5)
        if kind == 0:
            body = trimesh.creation.icosphere(2, radius=random.uniform(0.2, 1))
        elif kind == 1:
            body = trimesh.creation.torus(1, random.choice([0.05, 0.9]), 24, 12)
        elif kind == 2:
            body = trimesh.creation.box(random.choice([1e-5, 1e-2, 2], 3)).subdivide()
        elif kind == 3:
            body = trimesh.creation.box((1, 1, 1)).subdivide()
            body.apply_translation(random.integers(-1, 2, 3))
        else:
            body = trimesh.creation.icosphere(2)
            body.vertices += random.normal(size=body.vertices.shape) * 0.3
        if kind != 3:
            body.apply_translation(random.uniform(-0.5, 0.5, 3))
        corners = np.asarray(body.triangles)
        every.append(corners[:, ::-1] if random.random() < 0.4 else corners)
    return np.concatenate(every) * random.choice([1e-6, 1, 1e6])


def around(corners, random):
    """Points just before triangles, and anywhere near them."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.sqrt(np.linalg.norm(normal, axis=1, keepdims=True))
    before = corners.mean(axis=1) + 1e-6 * normal / size
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    return np.concatenate([before, random.uniform(low, high, (200, 3))])


@pytest.mark.parametrize("seed", range(12))
def test_winding_numbers_of_rays_match_solid_angles(seed):
    random = np.random.default_rng(seed)
    corners = bodies(random)
    places = around(corners, random)
    found, rest = windings(corners, np.zeros((len(corners), 3)), places)
    assert not len(rest)
    assert (found == by_solid_angle(corners, places)).all()
    assert len(np.unique(found)) > 1


def test_points_on_triangles_are_decided_by_solid_angles():
    corners = np.asarray(trimesh.creation.box((1, 1, 1)).triangles)
    found, rest = windings(corners, np.zeros((12, 3)), np.array([[0.5, 0.1, 0.2], [0.4, 0.1, 0.2], [0.5, 0.5, 0.5]]))
    assert rest.tolist() == [0, 2]
    assert found.tolist() == [0, 1, 0]


@pytest.mark.parametrize(("part", "is_on"), [(0.5, True), (-0.5, True), (2.0, False), (-2.0, False)])
def test_points_are_on_triangles_to_rounding_of_the_largest_coordinate(part, is_on):
    corners = 4.0 * (1 + np.asarray(trimesh.creation.box((2, 2, 2)).triangles))
    place = np.array([[3.0, 2.0, part * crossings._ON * 8.0]])
    found, rest = windings(corners, np.zeros((12, 3)), place)
    assert len(rest) == is_on
    assert found[0] == (part > 0 and not is_on)


@pytest.mark.parametrize(("part", "is_open"), [(0.9, True), (1.1, False)])
@pytest.mark.parametrize("side", range(3))
def test_rays_through_the_gap_of_one_side_decide_nothing(monkeypatch, side, part, is_open):
    monkeypatch.setattr(crossings, "_WAYS", 1)
    along = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    along[:, 2] *= np.linalg.det(along)
    corners = np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]]) @ along[:, :2].T
    gaps = np.where(np.arange(3) == side, 0.5, 0.0)[None]
    outwards = np.array([[0.0, -1.0], [np.sqrt(0.5), np.sqrt(0.5)], [-1.0, 0.0]])[side]
    middle = np.array([[0.5, 0.0], [0.5, 0.5], [0.0, 0.5]])[side]
    place = along[:, :2] @ (middle + part * 0.5 * outwards) - along[:, 2]
    found, rest = windings(corners, gaps, place[None])
    assert found[0] == 0
    assert len(rest) == is_open


@pytest.mark.parametrize("bend", [0.05, 0.2])
def test_sides_of_curved_faces_match_solid_angles(monkeypatch, bend):
    # maps of order 4, whose patches are cut more finely on one side than on the other
    dataset = Dataset(curved(mixed_volume(), ripple(bend), 4))
    sure = []

    def noted(corners, gaps, places):
        found, rest = windings(corners, gaps, places)
        sure.append((len(places), len(rest), (gaps > 0).mean()))
        return found, rest

    monkeypatch.setattr("elvis.core.distances.sides.windings", noted)
    by_rays = surface_of(dataset, "all").sides
    monkeypatch.setattr(crossings, "_WAYS", 0)
    by_angles = surface_of(dataset, "all").sides
    assert by_rays.tobytes() == by_angles.tobytes()
    assert [rest for _, rest, _ in sure] == [0, sure[0][0]]
    assert 0.02 < sure[0][2] < 0.5


def test_a_ray_through_a_gap_is_not_counted(monkeypatch):
    # eight parts of a box apart by as much as gaps may be: rays that leave through one cross one triangle less
    corners = np.asarray(trimesh.creation.box((1, 1, 1)).subdivide().triangles).copy()
    corners += 0.02 * (corners.mean(axis=1) > 0)[:, None]
    places = np.random.default_rng(3).uniform(-0.45, 0.45, (2000, 3))
    monkeypatch.setattr(crossings, "_WAYS", 1)
    careless, none = windings(corners, np.zeros((len(corners), 3)), places)
    found, rest = windings(corners, np.full((len(corners), 3), 0.03), places)
    assert not len(none)
    assert (careless != 1).any()
    assert set(np.flatnonzero(careless != 1)) <= set(rest)
    assert (np.delete(found, rest) == 1).all()
    assert len(rest) < 1000


def test_rays_in_the_plane_cross_the_same_lines_with_a_tree():
    random = np.random.default_rng(4)
    ends = np.concatenate([random.uniform(-1, 1, (300, 2, 2)), np.zeros((300, 2, 1))], axis=2)
    ends[:50] = np.round(ends[:50])
    places = np.concatenate([random.uniform(-1, 1, (200, 2)), np.zeros((200, 1))], axis=1)
    places[:20] = np.round(places[:20])
    (x0, y0), (x1, y1) = ends[:, 0, :2].T, ends[:, 1, :2].T
    x, y = places[:, 0, None], places[:, 1, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossed = ((y0 > y) != (y1 > y)) & (x0 + (y - y0) / (y1 - y0) * (x1 - x0) > x)
    assert (crossings_in_plane(ends, places) == crossed.sum(axis=1)).all()
