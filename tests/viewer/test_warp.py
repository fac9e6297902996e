"""The last sharp picture, moved with the camera by its depths: where its points are seen from the moved camera."""

import numpy as np
import pytest
from driving import change, settled

from elvis import Camera, Plane, Sphere, read, render
from elvis.scene import CutSurface
from elvis.viewer.depths import STEPS, depths_of

#: colours of the warped picture, or of the picture at its pixels, as a list of rows
COLOURS = """(name) => {
  const { size: [width, height], step } = elvis.warp.sharp, [left, top] = elvis.picture.image;
  const canvas = new OffscreenCanvas(width, height).getContext("2d");
  canvas.imageSmoothingEnabled = false;
  if (name === "warp") canvas.drawImage(elvis.warp.canvas, 0, 0);
  else canvas.drawImage(elvis.canvas, left, top, width * step, height * step, 0, 0, width, height);
  return [width, height, ...canvas.getImageData(0, 0, width, height).data];
}"""
FIRST = {"eye": [2, 1.5, 3], "at": [0.5, 0.5, 0.4], "up": [0, 1, 0]}


def colours(page, name):
    width, height, *values = page.evaluate(COLOURS, name)
    return np.array(values, float).reshape(height, width, 4)[..., :3]


@pytest.mark.parametrize("lens", [{"fov": 30}, {"height": 1.8}])
def test_points_move_as_they_are_seen(page, viewer, lens):
    """On a cut, colours change smoothly: the moved picture differs little from the exact one, the first one much."""
    change(page, {"camera": {**FIRST, **lens}, "range": [-1, 2]})
    settled(page, viewer)
    page.wait_for_function("elvis.warp.sharp")
    before = colours(page, "exact")
    moved = {**FIRST, **lens, "eye": [2.4, 1.2, 2.8], "at": [0.55, 0.45, 0.4]}
    page.evaluate("(camera) => elvis.warp.show(camera)", moved)
    warped = colours(page, "warp")
    change(page, {"camera": moved})
    settled(page, viewer)
    page.wait_for_function("elvis.warp.sharp")
    exact = colours(page, "exact")
    assert warped.shape == exact.shape
    seen = (np.ptp(warped, axis=2) > 8) & (np.ptp(exact, axis=2) > 8)
    assert seen.mean() > 0.1
    wrong, unmoved = (np.abs(one - exact)[seen].mean() for one in (warped, before))
    assert wrong < 0.25 * unmoved
    assert wrong < 8
    # it gives way to the next picture
    assert page.locator(".elvis-warp").is_hidden()


def test_depths_are_stored_in_sixteen_bits(scene):
    import base64
    import zlib

    objects = (CutSurface(Sphere((0.5, 0.5, 0.5), 0.3)), CutSurface(Plane((0, 0, 0.2), (0, 0, 1))))
    camera = Camera((3.0, 2.0, 4.0), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0), fov=25.0)
    frame = render(read(*scene.data), "u", objects=objects, camera=camera, size=(900, 500))
    found = depths_of(frame)
    parts = np.frombuffer(zlib.decompress(base64.b64decode(found["data"])), "<u2").reshape(found["size"][::-1])
    depth = frame.depth[:: found["step"], :: found["step"]]
    assert max(found["size"]) <= 400
    assert np.array_equal(parts > 0, np.isfinite(depth))
    shown = found["low"] + (parts[parts > 0] - 1.0) * (found["high"] - found["low"]) / STEPS
    assert np.abs(shown - depth[parts > 0]).max() <= (found["high"] - found["low"]) / STEPS
