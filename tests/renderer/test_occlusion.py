"""Things hidden by hits: against all pixels in which they may be visible."""

import numpy as np
import pytest

from elvis import Camera
from elvis.renderer.passes.isosurface.occlusion import Occlusion
from elvis.renderer.raster.pixels import NOBODY
from elvis.scene.cameras.view import View


@pytest.mark.parametrize("size", [(1, 1), (37, 22), (8, 64)])
def test_only_things_behind_all_their_pixels_are_hidden(size):
    rng = np.random.default_rng(4)
    view = View.through(Camera((0, 0, 5), (0, 0, 0), height=1.0), size).with_margin(3)
    depth = rng.uniform(1, 2, view.count)
    owner = np.where(rng.random(view.count) < 0.02, NOBODY, 7).astype(np.uint32)
    occlusion = Occlusion.of(view, owner, depth)
    ends = view.first + rng.integers(0, [view.width, view.height], (2, 300, 2))
    least, most = ends.min(axis=0), ends.max(axis=0)
    near = rng.uniform(1, 2.2, 300)
    opaque = np.where(owner == NOBODY, np.inf, depth).reshape(view.height, view.width)
    windows = zip(least - view.first, most - view.first + 1, strict=True)
    farthest = np.array([opaque[y0:y1, x0:x1].max() for (x0, y0), (x1, y1) in windows])
    hidden = occlusion.hides(least, most, near)
    assert not hidden[near < farthest].any()
    assert hidden[near > opaque.max()].all()
    assert size == (1, 1) or 0 < hidden.sum() < 300


def test_whole_squares_hide_what_is_just_behind():
    view = View.through(Camera((0, 0, 5), (0, 0, 0), height=1.0), (16, 16))
    depth = np.ones((16, 16))
    depth[8:, 8:] = 3.0
    occlusion = Occlusion.of(view, np.zeros(256, np.uint32), depth.reshape(-1))
    least, most = np.array([[0, 0], [8, 8], [0, 0]]), np.array([[7, 7], [15, 15], [15, 15]])
    assert occlusion.hides(least, most, np.array([2.0, 2.0, 2.0])).tolist() == [True, False, False]
