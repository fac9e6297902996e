"""Where rays meet levels of the distance to a cube: its sides moved outwards, with rounded edges, or inwards."""

import numpy as np
import pytest
import trimesh

from elvis.core.distances import surface_of
from elvis.plugins.runtime.distances import buffers_of

HALF = 0.5
SIDE = 20
#: how near hits are to one another at least
APART = 1e-9
BOX = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 0.9]])


@pytest.fixture(scope="module")
def surface(tmp_path_factory):
    """Buffers of the cube."""
    name = tmp_path_factory.mktemp("cube") / "cube.ply"
    trimesh.creation.box(extents=[2 * HALF] * 3).export(name)
    return buffers_of([surface_of(None, str(name))])


def distance_of(points):
    """Distances (n,), negative inside, and their gradients (n, 3)."""
    away = np.abs(points) - HALF
    outside = np.maximum(away, 0.0)
    own = np.linalg.norm(outside, axis=1)
    inside = np.eye(3)[away.argmax(axis=1)]
    gradient = np.where(own[:, None] > 0, outside / np.maximum(own, 1e-300)[:, None], inside) * np.sign(points)
    return np.where(own > 0, own, away.max(axis=1)), gradient


@pytest.fixture(scope="module")
def rays():
    """Parallel rays, with a slant, of which each meets the cube's surroundings."""
    origin = np.array([-0.83, 0.81, 3.0])
    column, row, forward = np.array([0.087, 0, 0]), np.array([0, -0.0853, 0]), np.array([0.03, -0.02, -0.7])
    places = np.array([[x, y] for y in range(SIDE) for x in range(SIDE)])
    return origin, column, row, forward, origin + places @ np.stack([column, row])


@pytest.fixture(scope="module")
def meet(functions, surface):
    """Where the rays of a camera meet a level in a box, by pixel and depth."""
    kernel = functions("iso_distance")

    def meet(level, side, **camera):
        view = kernel.records("rays", 1)
        for name, value in {"width": side, "height": side, **camera}.items():
            view["camera"][name] = value
        view["level"], view["apart"], view["count"] = level, APART, side**2
        given = {"rays": view, "box": np.concatenate(BOX), **surface}
        met, count = kernel.records("met", 8 * side**2), np.zeros(1, np.uint32)
        found = kernel.results(side**2, ["met", "count"], met=met, count=count, **given)
        found = found["met"][: found["count"][0]]
        return found[np.lexsort([found["depth"], found["pixel"]])]

    return meet


def crossings(rays, level):
    """Pixels, depths and gradients of all places on rays at a level, in a box."""
    *_, forward, origins = rays
    z = np.linspace(0, 6, 1201)
    pixel, depth = [], []
    for k, origin in enumerate(origins):
        points = origin + z[:, None] * forward
        is_within = ((points >= BOX[0]) & (points <= BOX[1])).all(axis=1)
        side = distance_of(points)[0] > level
        for at in np.flatnonzero((side[1:] != side[:-1]) & is_within[1:] & is_within[:-1]):
            low, high = z[at], z[at + 1]
            for _ in range(60):
                middle = 0.5 * (low + high)
                is_before = (distance_of(origin[None] + middle * forward)[0][0] > level) == side[at]
                low, high = (middle, high) if is_before else (low, middle)
            pixel.append(k)
            depth.append(high)
    pixel, depth = np.array(pixel), np.array(depth)
    return pixel, depth, distance_of(origins[pixel] + depth[:, None] * forward)[1]


@pytest.mark.parametrize("level", [0.1, -0.2, 0.31])
def test_rays_meet_each_level_where_its_sides_lie(meet, rays, level):
    origin, column, row, forward, _ = rays
    found = meet(level, SIDE, eye=origin, column=column, row=row, forward=forward)
    pixel, depth, gradient = crossings(rays, level)
    assert len(pixel) > 100
    clear = (found["unseen"] == 0) & (found["doubtful"] == 0)
    assert np.array_equal(found["pixel"][clear], pixel)
    off = np.abs(found["depth"][clear] - depth)
    assert (off <= found["uncertainty"][clear]).all()
    assert found["uncertainty"][clear].max() <= 32 * APART / np.linalg.norm(rays[3])
    steep = np.abs(found["normal"][clear] - gradient).max(axis=1)
    assert np.median(steep) < 1e-7
    assert (~clear).sum() < 5


def test_rays_along_a_level_are_doubtful(meet):
    """Next to a side of the cube: along the level, just off it, and where its edges are rounded."""
    level, forward = 0.1, [0.0, 0.0, -1.0]
    for shift in (0.0, 1e-4, 0.05, -1e-4, -0.05):
        found = meet(level, 1, eye=[0.1, HALF + level + shift, 2.0], forward=forward)
        if shift == 0:
            assert (found["doubtful"] != 0).any()
        elif shift > 0:
            assert not len(found)
        else:
            # around the edges are circles of the level's radius
            half = HALF + np.sqrt(level**2 - (level + shift) ** 2)
            assert found["depth"] == pytest.approx([2 - half, 2 + half], abs=1e-7)
            assert not found["doubtful"].any()
