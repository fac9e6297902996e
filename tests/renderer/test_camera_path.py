"""Paths of cameras: through the keys, smooth, along the shortest turn, the same however the world is turned."""

import numpy as np
import pytest

from elvis import Camera, SceneError
from elvis.scene.cameras.camera_path import CameraPath

KEYS = (
    Camera((4.0, 0.0, 1.0), (0.0, 0.0, 0.0), fov=30.0),
    Camera((0.0, 6.0, 2.0), (1.0, 0.0, 0.5), fov=20.0),
    Camera((-3.0, -1.0, 0.5), (0.0, 1.0, 0.0), (0.0, 0.2, 1.0), fov=40.0),
    Camera((0.0, -9.0, -2.0), (0.0, 0.0, 1.0), fov=30.0),
)


def described(camera):
    """Eye, place, axes and field of view as numbers."""
    return np.concatenate([camera.eye, camera.at, np.ravel(camera.basis()), [camera.fov or camera.height]])


def test_paths_pass_through_keys_and_are_smooth():
    path = CameraPath.of(KEYS)
    for number, key in enumerate(KEYS):
        assert path.at(number / 3) == key
    # at a key the velocities on both sides are the same
    for key in (1 / 3, 2 / 3):
        step = 1e-5
        places = [described(path.at(key + k * step)) for k in (-2, -1, 0, 1, 2)]
        before, after = 3 * places[2] - 4 * places[1] + places[0], -3 * places[2] + 4 * places[3] - places[4]
        assert np.abs(before - after).max() / (2 * step) < 1e-3
        assert np.abs(before).max() / (2 * step) > 0.1


def test_two_keys_are_a_steady_turn_and_steady_zoom():
    path = CameraPath.of(
        [Camera((2.0, 0.0, 0.0), (0.0, 0.0, 0.0), fov=30.0), Camera((0.0, 8.0, 0.0), (0.0, 0.0, 0.0), fov=30.0)]
    )
    for share in (0.1, 0.5, 0.7):
        angle, distance = share * np.pi / 2, 2 * 4**share
        found = path.at(share)
        assert np.allclose(found.eye, [distance * np.cos(angle), distance * np.sin(angle), 0], rtol=0, atol=1e-14)
        assert np.allclose(found.up, [0, 0, 1], rtol=0, atol=1e-15)
        assert found.fov == pytest.approx(30.0, abs=1e-13)


def test_paths_turn_with_the_world():
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    moved = [Camera(*(tuple(turn @ v) for v in (key.eye, key.at, key.up)), key.fov) for key in KEYS]
    one, other = CameraPath.of(KEYS), CameraPath.of(moved)
    for share in np.linspace(0, 1, 17):
        own, wanted = other.at(share), one.at(share)
        for name in ("eye", "at"):
            assert np.allclose(getattr(own, name), turn @ getattr(wanted, name), rtol=0, atol=1e-13)
        assert np.allclose(own.basis(), np.array(wanted.basis()) @ turn.T, rtol=0, atol=1e-13)


def test_parallel_views_keep_their_heights():
    path = CameraPath.of([Camera((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), height=h) for h in (1.0, 4.0)])
    assert path.at(0.5).height == pytest.approx(2.0, abs=1e-14)
    assert path.at(0.5).fov is None
    with pytest.raises(SceneError, match="all in perspective, or none, found some of each"):
        CameraPath.of([*path.cameras, KEYS[0]])
    with pytest.raises(SceneError, match="successive cameras less than 180 degrees apart"):
        CameraPath.of([Camera((x, 0.0, 0.0), (0.0, 0.0, 0.0)) for x in (1.0, -1.0)])
    with pytest.raises(SceneError, match="expected two or more cameras of a path, found 1"):
        CameraPath.of(KEYS[:1])
