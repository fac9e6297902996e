"""Which elements a picture depends on, by their boxes."""

import numpy as np

from elvis.renderer.parts.near_boxes import meets
from elvis.scene import Cone


def test_a_cone_meets_few_boxes():
    """Of boxes of a grid all that hold a point of it, and others near by."""
    cone = Cone((0.4, 0.5, 0.1), (0.0, 0.0, 2.0), 25.0)
    low = np.stack(np.meshgrid(*[np.arange(20) / 20.0] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    found = meets(cone, np.hstack([low, low + 0.05]).astype(np.float32))
    turn, height = np.random.default_rng(0).uniform((0.0, 0.001), (2.0 * np.pi, 0.89), (20000, 2)).T
    away = height * np.tan(np.radians(25.0))
    points = np.stack([0.4 + away * np.cos(turn), 0.5 + away * np.sin(turn), 0.1 + height], axis=1)
    cells = np.ravel_multi_index(np.floor(20.0 * points).astype(int).clip(0, 19).T, (20, 20, 20))
    assert found[cells].all()
    assert found.mean() < 4.0 * len(np.unique(cells)) / len(found) < 0.8
