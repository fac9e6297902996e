"""The last sharp picture, moved with the camera by its depths: where its points are seen from the moved camera."""

from base64 import b64decode
from itertools import pairwise

import numpy as np
import pytest
from driving import change, settled

from elvis import Camera, Plane, Sphere, read, render
from elvis.renderer.device.drafts import drafted
from elvis.scene import Contours, CutSurface, MeshLines, Style
from elvis.viewer.depths import PARTS_OF_PIXEL, STEPS, depths_of, motion_of

#: size and colours, in base64, of the moved picture, of the one that it is made of, or of the picture itself
COLOURS = """(name) => {
  const [left, top, width, height] = elvis.picture.image;
  const canvas = new OffscreenCanvas(width, height).getContext("2d");
  if (name === "lifted") canvas.drawImage(elvis.warp.source.canvas, 0, 0);
  else if (name === "warp") canvas.drawImage(elvis.warp.canvas, 0, 0, width, height);
  else canvas.drawImage(elvis.canvas, left, top, width, height, 0, 0, width, height);
  const bytes = canvas.getImageData(0, 0, width, height).data;
  const rows = Array.from({length: height}, (_, row) => bytes.subarray(4 * width * row, 4 * width * (row + 1)));
  return [width, height, btoa(rows.map((row) => String.fromCharCode(...row)).join(""))];
}"""
FIRST = {"eye": [2, 1.5, 3], "at": [0.5, 0.5, 0.4], "up": [0, 1, 0]}


def colours(page, name):
    width, height, content = page.evaluate(COLOURS, name)
    return np.frombuffer(b64decode(content), np.uint8).reshape(height, width, 4)[..., :3].astype(float)


@pytest.mark.parametrize("lens", [{"fov": 30}, {"height": 1.8}])
def test_points_move_as_they_are_seen(page, viewer, lens):
    """On a cut, colours change smoothly: the moved picture differs little from the exact one, the first one much."""
    change(page, {"camera": {**FIRST, **lens}, "range": [-1, 2]})
    settled(page, viewer)
    page.wait_for_function("elvis.warp.source.parts")
    before = colours(page, "exact")
    moved = {**FIRST, **lens, "eye": [2.4, 1.2, 2.8], "at": [0.55, 0.45, 0.4]}
    page.evaluate("(camera) => elvis.warp.show(camera)", moved)
    warped = colours(page, "warp")
    change(page, {"camera": moved})
    settled(page, viewer)
    page.wait_for_function("elvis.warp.source.parts")
    exact = colours(page, "exact")
    assert warped.shape == exact.shape
    seen = (np.ptp(warped, axis=2) > 8) & (np.ptp(exact, axis=2) > 8)
    assert seen.mean() > 0.1
    wrong, unmoved = (np.abs(one - exact)[seen].mean() for one in (warped, before))
    assert wrong < 0.25 * unmoved
    assert wrong < 8
    # it gives way to the next picture
    assert page.locator(".elvis-warp:visible").count() == 0


def test_parallel_views_of_one_direction_are_shifted(page, viewer):
    """After a shift by 30 columns and 12 rows, all pixels that stay in the picture are the same."""
    camera = {**FIRST, "height": 1.8}
    change(page, {"camera": camera, "range": [-1, 2], "domain_outline": False})
    settled(page, viewer)
    before = colours(page, "exact")
    eye, at, up = (np.array(camera[key], float) for key in ("eye", "at", "up"))
    right = np.cross(at - eye, up)
    above = np.cross(right, at - eye)
    step = (12 * above / np.linalg.norm(above) - 30 * right / np.linalg.norm(right)) * 1.8 / len(before)
    moved = {**camera, "eye": [*(eye + step)], "at": [*(at + step)]}
    page.evaluate("(camera) => elvis.warp.show(camera)", moved)
    warped = colours(page, "warp")
    # the arrows along the axes stay in their corner, on a canvas of their own
    left, top, side = page.evaluate("elvis.picture.arrows")
    before[top : top + side, left : left + side] = 255
    assert np.abs(warped[12:, 30:] - before[:-12, :-30]).max() <= 1
    page.evaluate("elvis.warp.hide()")


def test_depths_are_stored_in_sixteen_bits(scene):
    import zlib

    objects = (CutSurface(Sphere((0.5, 0.5, 0.5), 0.3)), CutSurface(Plane((0, 0, 0.2), (0, 0, 1))))
    camera = Camera((3.0, 2.0, 4.0), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0), fov=25.0)
    frame = render(read(*scene.data), "u", objects=objects, camera=camera, size=(900, 500), domain_outline=False)
    found = depths_of(frame)
    parts = np.frombuffer(zlib.decompress(b64decode(found["data"])), "<u2").reshape(found["size"][::-1])
    depth = frame.depth[:: found["step"], :: found["step"]]
    assert max(found["size"]) <= 400
    assert np.array_equal(parts > 0, np.isfinite(depth))
    shown = found["low"] + (parts[parts > 0] - 1.0) * (found["high"] - found["low"]) / STEPS
    assert np.abs(shown - depth[parts > 0]).max() <= (found["high"] - found["low"]) / STEPS


def test_lines_of_drafts_are_segments(scene, tmp_path):
    """On a plane, borders of the mesh of a draft lie where the curves of a vector figure of the same view do."""
    import zlib

    cut = CutSurface(Plane((0, 0, 0.4), (0, 0, 1)), Style(mesh_lines=MeshLines(width=2.0)))
    camera = Camera((0.5, 0.4, 4.0), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0), height=1.4)
    how = {"objects": (cut,), "camera": camera, "size": (160, 120), "domain_outline": False}
    data = read(*scene.data)
    figure = render(data, "u", **how, outputs=(str(tmp_path / "figure.svg"),))
    with drafted(segments=True):
        draft = render(data, "u", **how, outputs=(str(tmp_path / "draft.png"),))
    facts, numbers = motion_of(draft)
    numbers = np.frombuffer(zlib.decompress(numbers), "<u2")
    columns, rows = facts["size"]
    (line,) = facts["lines"]
    assert line["width"] == 2.0
    x, y, depth = numbers[columns * rows :].reshape(6, line["count"])[:3].astype(float)
    places = np.stack([x, y], axis=1) / PARTS_OF_PIXEL - facts["margin"]
    (stroke,) = figure.drawing.strokes
    fine = [np.linspace(one, other, 40) for own in stroke.lines for one, other in pairwise(own)]
    gaps = np.linalg.norm(places[:, None] - np.concatenate(fine), axis=2).min(axis=1)
    assert np.percentile(gaps, 95) < 0.15
    assert gaps.max() < 1.0
    # pixels under them have no lines, and a plane has depths everywhere
    shown = facts["low"] + (depth - 1.0) * (facts["high"] - facts["low"]) / STEPS
    assert np.ptp(shown) > 0.0
    assert (
        np.abs(draft.rgb.astype(int) - render(data, "u", **{**how, "objects": (CutSurface(cut.surface),)}).rgb).max()
        <= 1
    )
    parts = np.cumsum(numbers[: columns * rows].reshape(rows, columns), axis=1, dtype=np.uint16)
    step = facts["step"]
    assert np.array_equal(parts > 0, np.isfinite(draft.depth[::step, ::step]))


@pytest.mark.parametrize("style", [Style(contours=Contours(count=5)), Style(mesh_lines=MeshLines(width=2.0))])
def test_lines_of_drafts_have_finite_depths(scene, style):
    """Lines next to silhouettes, and of the surface that others do not cover, have depths within the data."""
    planes = (Plane((0.5, 0.5, 0.3), (0.1, 0.2, 1.0)), Plane((0.5, 0.5, 0.6), (-0.1, 0.3, 1.0)))
    cuts = tuple(CutSurface(plane, style) for plane in planes)
    with drafted(segments=True):
        draft = render(read(*scene.data), "u", objects=cuts, camera="iso", size=(32, 24), outline=True)
    facts, _ = motion_of(draft)
    assert facts["lines"]
    seen = draft.depth[np.isfinite(draft.depth)]
    room = 0.5 * np.ptp(seen)
    assert seen.min() - room <= facts["low"] < facts["high"] <= seen.max() + room


def test_the_outline_of_the_domain_moves_apart_from_the_picture(page, viewer):
    """The page takes its lines off the last picture, and draws them where the camera sees them."""
    change(page, {"camera": {**FIRST, "height": 1.8}, "range": [-1, 2], "domain_outline": False})
    settled(page, viewer)
    bare = colours(page, "exact")
    change(page, {"domain_outline": None})
    settled(page, viewer)
    page.wait_for_function("elvis.warp.source.lines.length === 1")
    assert (colours(page, "exact") != bare).any()
    lifted = colours(page, "lifted")
    left, top, side = page.evaluate("elvis.picture.arrows")
    is_own = np.ones(bare.shape[:2], bool)
    is_own[top : top + side, left : left + side] = False
    assert np.array_equal(lifted[is_own], bare[is_own])
