"""Automatic cameras: what a plane meets of the boxes of elements, and a view that shows all of it.  Needs no device."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.core.mapping.boxes import Boxes
from elvis.core.mapping.orientation import chunks
from elvis.scene import Camera, CutSurface, Faces, Glyphs, Implicit, Plane, Scene, Streamlines
from elvis.scene.cameras.view import MARGIN, fit_camera, named_camera
from elvis.scene.model.errors import AbsentError, SceneError

#: width and height of automatic pictures in pixels, and the minimum of either
LARGEST, LEAST = (1000, 800), 160
#: a preview has this many times fewer pixels in each direction, and more if it would exceed GLANCE_PIXELS; it has at
#: least LEAST in each direction, or for elements, which are not thin lines, as many as a smaller picture
GLANCE, GLANCE_PIXELS = 4, 1 << 21
#: most previews
GLANCES = 4
#: how far ends that a preview has cut are moved away from the middle, as a part of the distance
GROWTH = 2.0
#: extent of objects relative to the domain's below which a picture does not hold all of its outline
SMALL = 0.3
#: boxes whose corners are taken together
BOXES_AT_ONCE = 1 << 15
#: pairs of corners k = x + 2 y + 4 z of a box that an edge joins
_EDGES = np.array([(k, k + step) for step in (1, 2, 4) for k in range(8) if not k & step])


def automatic(
    scene: Scene,
    boxes: Sequence[Boxes],
    glance: Callable[[Scene], Bools],
    together: Callable[[Floats], Floats] = lambda own: own,
) -> Scene:
    """The scene with a size, and with a camera of known field of view or height, which is fitted if it has neither.

    boxes   (n, 6) arrays: low and high corners of boxes that contain the elements
    glance  draws a small picture: (h, w) true where something is visible.  Boxes are larger than the elements.
    together  combines the visible extent (2, 2) of these boxes with that of boxes elsewhere: minimum coordinates, then
            maximum ones, infinite if nothing is visible
    Raises SceneError if there is no box, or if the view must be fitted but a plane misses every box.
    """
    if not sum(map(len, boxes)):
        raise SceneError("nothing to draw: no element has the field")
    camera, plane = scene.camera, faced_plane(scene)
    if scene.region is not None and plane is None:
        raise SceneError("region: expected 2D data or a single plane, found other objects: choose a camera for these")
    if is_given(camera):
        return scene if scene.size else replace(scene, size=LARGEST)
    if isinstance(camera, str):
        camera = named_camera(camera, plane)

    box = surrounding(boxes)
    is_framed = bool(scene.box or (scene.axes and plane is None))
    extent = together(_extent_of_boxes(scene, camera, [box.reshape(1, 6).astype(np.float32)] if is_framed else boxes))
    if not np.isfinite(extent).all():
        raise AbsentError(empty_picture_remark(scene.only_plane, box))
    if scene.region is not None:
        left, right, low, high = scene.region
        extent = np.array([[left, low], [right, high]])
    elif not is_framed:
        extent = _extent_by_glances(scene, camera, extent, box, glance)
    if scene.shows_domain and not (is_framed or scene.region):
        extent = _with_domain(extent, camera, box)

    size = scene.size or proportionate(extent)
    # by what zooming adds, so that without it not a bit changes
    shown = extent + (extent - extent.mean(axis=0)) * (1.0 / scene.zoom - 1.0)
    margin = 1.0 if scene.region else MARGIN
    return replace(scene, size=size, camera=fit_camera(camera, size, shown, box, margin))


def is_of_elements(scene: Scene) -> bool:
    """Whether the view depends only on scene and elements: field values don't affect where something is visible."""
    surfaces = [clip.surface for clip in scene.clip]
    surfaces += [item.surface for item in scene.every_object if isinstance(item, CutSurface)]
    others = [item for item in scene.every_object if not isinstance(item, CutSurface | Faces)]
    return is_given(scene.camera) or not (others or any(isinstance(surface, Implicit) for surface in surfaces))


def is_given(camera: Camera | str | None) -> bool:
    """Whether nothing of a camera is to be fitted."""
    return isinstance(camera, Camera) and (camera.fov is not None or camera.height is not None)


def faced_plane(scene: Scene) -> Plane | None:
    """The plane that a fitted camera faces: a plane that is the only object, or a region with lines and glyphs."""
    if scene.region is None:
        return scene.only_plane
    solid = [item for item in scene.every_object if not isinstance(item, Streamlines | Glyphs)]
    surfaces = [item.surface if isinstance(item, CutSurface) else None for item in solid]
    first = surfaces[0] if surfaces else None
    return first if isinstance(first, Plane) and all(own == first for own in surfaces) else None


def _extent_of_boxes(scene: Scene, camera: Camera, boxes: Sequence[Boxes]) -> Floats:
    """Visible extent (2, 2) of boxes: minimum and maximum coordinates along the camera's right and up axes.

    The extent is infinite if nothing is visible.
    """
    axes = np.array(camera.basis()[:2]).T
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for points in _points_of_boxes(scene, boxes):
        places = points[np.isfinite(points).all(axis=1)] @ axes
        low = np.minimum(low, places.min(axis=0, initial=np.inf))
        high = np.maximum(high, places.max(axis=0, initial=-np.inf))
    return np.array([low, high])


def _points_of_boxes(scene: Scene, boxes: Sequence[Boxes]) -> Iterator[Floats]:
    """Points (n, 3) that may be visible, some boxes' after another: their corners, or those on the only plane."""
    plane = None if scene.box else scene.only_plane
    for some in boxes:
        for part in chunks(len(some), BOXES_AT_ONCE):
            yield crossings(some[part], plane) if plane else _corners(some[part])


def _extent_by_glances(
    scene: Scene, camera: Camera, extent: Floats, box: Floats, glance: Callable[[Scene], Bools]
) -> Floats:
    """The extent of the visible objects within that of the boxes; if it is small, further glances refine it."""
    whole = extent
    for _ in range(GLANCES):
        size = scene.size or proportionate(extent)
        fewer = max(GLANCE, int(np.ceil(np.sqrt(size[0] * size[1] / GLANCE_PIXELS))))
        width, height = (max(min(LEAST, side) if is_of_elements(scene) else LEAST, -(-side // fewer)) for side in size)
        small = replace(scene, size=(width, height), camera=fit_camera(camera, (width, height), extent, box))
        mask = glance(small)
        if not mask.any():
            break
        wide = extent
        extent = _extent(mask, small)
        is_cut = _is_cut(mask, extent, whole)
        if is_cut.any():
            # the glance before saw no pixel of a thin end
            extent = np.where(is_cut, extent + GROWTH * (extent - extent.mean(axis=0)), extent)
            continue
        if (extent[1] - extent[0]).max() > 0.3 * (wide[1] - wide[0]).max():
            break
    return extent


def _with_domain(extent: Floats, camera: Camera, box: Floats) -> Floats:
    """The visible extent (2, 2) of objects and of the domain in its box (2, 3), unless objects are small in it."""
    points = _corners(box.reshape(1, 6).astype(np.float32)) @ np.array(camera.basis()[:2]).T
    whole = np.array([points.min(axis=0), points.max(axis=0)])
    is_small = np.ptp(extent, axis=0).max() < SMALL * np.ptp(whole, axis=0).max()
    return extent if is_small else whole


def _corners(boxes: Boxes) -> Floats:
    """(8 n, 3) the corners of boxes (n, 6), first the first corner of all."""
    corners = []
    for k in range(8):
        columns = [3 * (k >> axis & 1) + axis for axis in range(3)]
        corners.append(boxes[:, columns])
    return np.concatenate(corners).astype(np.float64)


def _is_cut(mask: Bools, extent: Floats, whole: Floats) -> Bools:
    """(2, 2) ends of an extent at which objects reach the border of a picture though the boxes (2, 2) go on."""
    at_border = np.array([[mask[:, 0].any(), mask[-1].any()], [mask[:, -1].any(), mask[0].any()]])
    is_inside = np.array([extent[0] > whole[0], extent[1] < whole[1]])
    return np.asarray(at_border & is_inside)


def _extent(mask: Bools, scene: Scene) -> Floats:
    """(2, 2) minimum and maximum coordinates of the pixels of a mask along the camera's right and up axes."""
    camera = scene.camera
    assert isinstance(camera, Camera)
    assert camera.height is not None
    height, width = mask.shape
    columns = np.flatnonzero(mask.any(axis=0))
    rows = np.flatnonzero(mask.any(axis=1))

    # borders of the pixels, and one pixel more on each side; rows count downwards
    low = [columns[0] - 1, height - rows[-1] - 1]
    high = [columns[-1] + 2, height - rows[0] + 1]

    # from the middle of the picture, where the eye looks
    pixel = camera.height / height
    away = (np.array([low, high]) - np.array([width, height]) / 2) * pixel
    return np.asarray(away + np.array(camera.basis()[:2]) @ camera.eye)


def proportionate(extent: Floats) -> tuple[int, int]:
    """Pixels of a picture that shows an extent (2, 2) without wide margins: LARGEST or less, at least LEAST a side."""
    width, height = np.maximum(extent[1] - extent[0], 1e-300)
    scale = min(LARGEST[0] / width, LARGEST[1] / height)
    return max(LEAST, round(width * scale)), max(LEAST, round(height * scale))


def crossings(boxes: Boxes, plane: Plane) -> Floats:
    """(k, 3) points in which the plane meets the edges of boxes (n, 6)."""
    normal = plane.basis()[2]
    boxes = boxes.astype(np.float64)
    slack = 1e-12 * float(np.abs(boxes).max(initial=0.0) + np.abs(plane.point).max())

    # a box reaches as far from its middle, along the normal, as its half sides do together
    middle = 0.5 * (boxes[:, 3:] + boxes[:, :3])
    half = 0.5 * (boxes[:, 3:] - boxes[:, :3])
    height = np.abs((middle - plane.point) @ normal)
    met = boxes[height <= half @ np.abs(normal) + slack]

    # the ends of all edges and their distances from the plane
    corners = _corners(met).reshape(8, -1, 3).swapaxes(0, 1)
    ends = corners[:, _EDGES].reshape(-1, 2, 3)
    a, b = ((ends - plane.point) @ normal).T
    cut = (np.minimum(a, b) <= slack) & (np.maximum(a, b) >= -slack)
    a, b, ends = a[cut], b[cut], ends[cut]

    # an edge within the plane meets it in all its points; its ends also belong to other edges
    share = np.divide(a, a - b, out=np.zeros_like(a), where=a != b)
    share = np.clip(share, 0.0, 1.0)[:, None]
    return np.asarray((1 - share) * ends[:, 0] + share * ends[:, 1])


def surrounding(boxes: Sequence[Boxes]) -> Floats:
    """(2, 3) low and high corner of a box that holds all boxes."""
    low = np.min([some[:, :3].min(axis=0) for some in boxes if len(some)], axis=0)
    high = np.max([some[:, 3:].max(axis=0) for some in boxes if len(some)], axis=0)
    return np.stack([low, high]).astype(np.float64)


def empty_picture_remark(plane: Plane | None, box: Floats) -> str:
    """The sentence for an empty picture of a domain within ``box`` (2, 3)."""
    low, high = (", ".join(f"{x:g}" for x in v) for v in box)
    what = "any object"
    if plane is not None:
        point, normal = (", ".join(f"{x:g}" for x in v) for v in (plane.point, plane.normal))
        what = f"the plane through ({point}) with normal ({normal})"
    return f"the picture is empty: nothing of {what} is visible; the domain lies between ({low}) and ({high})"
