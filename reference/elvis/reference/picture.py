"""Pictures of plane cuts and plane data in NumPy: the device ``reference``; `scenes` draws other scenes.

Every pixel's plane point is located among the elements, and the field's modal expansion is summed there in collapsed
coordinates.  It uses no kernel, Bernstein form or bound of the renderer; only the scene, the view and the palette are
shared with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.boxes import element_boxes
from elvis.core.mapping.inverse import Status as InverseStatus
from elvis.core.mapping.locate import Location
from elvis.core.mapping.margins import TOLERANCE
from elvis.core.mapping.patch import Patch, patches
from elvis.core.mapping.pointwise import values
from elvis.core.summary.picturing import Kind
from elvis.plugins.runtime.opening import PluginData
from elvis.reference.locating import Locator
from elvis.reference.places import owners, polish, within_periods
from elvis.reference.scenes.drawing import render as draw
from elvis.reference.settling import settle_range, supersample
from elvis.reference.sources import DatasetSource, Source
from elvis.scene import Faces, Scene
from elvis.scene.cameras.fitting import automatic, empty_picture_remark, surrounding
from elvis.scene.cameras.view import PlaneView, view_of
from elvis.scene.model.errors import SceneError
from elvis.scene.model.time_limit import check_time, limited
from elvis.scene.record.frame import Frame, Status


def render(data: Dataset | PluginData, scene: Scene) -> Frame:
    """A picture of 2D data in the plane, or of a plane cut through 3D or quasi-3D data; the scene must have a plane.

    Quasi-3D data (plane elements with a Fourier series along z) are shown over one period, from z = 0.  A point within
    1e-10 of the border of elements (`elvis.core.mapping.margins`) is ambiguous and goes to the one of lowest id.  Data
    opened by a plugin are drawn if it describes its elements in NumPy.  Raises SceneError if nothing is visible or the
    scene's time has passed, and ElvisError for data that can't be drawn.
    """
    source = Source.of(data)
    with limited(scene.timeout):
        frame = _render(source, scene)
        if scene.box or scene.axes:
            frame = replace(frame, box=source.domain())
        check_time()
    return frame


def _render(source: Source, scene: Scene) -> Frame:
    """`render` without the time."""
    scene = settle_range(source, scene)
    if scene.samples > 1:
        return supersample(_render, source, scene)
    if not isinstance(source, DatasetSource):
        return draw(source, scene)
    dataset = source.dataset
    _check(dataset, scene)
    if not scene.is_plain or scene.field not in [field.name for field in dataset.fields]:
        return draw(source, scene)
    return _plain(dataset, scene)


def _plain(dataset: Dataset, scene: Scene) -> Frame:
    """One of the dataset's fields on a plane, unlit: points are located, and the field is evaluated there."""
    start, chosen = perf_counter(), _patches(dataset, scene.field)
    boxes = [element_boxes(patch) for patch in chosen]
    locator = Locator(chosen)
    view = view_of(automatic(scene, boxes, partial(glance, locator)))
    assert isinstance(view, PlaneView)
    pixels, points = points_of_pixels(chosen, view)
    found = owners(locator, points)
    polish(chosen, found, points)
    located = perf_counter()
    margin = _margins(found, dataset.mesh.dimension)
    frame = _frame(scene, view, pixels, replace(found, margin=margin), field_of(chosen, found))
    if not frame.seen.any():
        raise SceneError(empty_picture_remark(view.plane, surrounding(boxes)))
    frame.stats.update(
        device={"name": "reference", "label": "NumPy"},
        elements=sum(map(len, chosen)),
        pixels=frame.counts(),
        seconds={"locate": located - start, "frame": perf_counter() - start},
    )
    return frame


def glance(locator: Locator, scene: Scene) -> Bools:
    """(h, w) whether an element is visible."""
    view = view_of(scene)
    assert isinstance(view, PlaneView)
    pixels, points = points_of_pixels(locator.patches, view)
    mask = np.zeros(view.width * view.height, bool)
    mask[pixels] = locator.locate(points).status == InverseStatus.INSIDE
    return mask.reshape(view.height, view.width)


def points_of_pixels(patches: Sequence[Patch], view: PlaneView) -> tuple[Ints, Floats]:
    """Numbers (n,) and plane points (n, 3) of the pixels that may show something."""
    points = view.points().reshape(-1, 3)
    pixels = within_periods(patches, points)
    return pixels, points[pixels]


def field_of(patches: Sequence[Patch], found: Location) -> Floats:
    """(n,) the first field of the patches where each point was found, NaN if it was not."""
    result = np.full(len(found), np.nan)
    for number, patch in enumerate(patches):
        here = found.patch == number
        result[here] = values(patch, 0, found.row[here], found.reference[here])
    return result


def _check(dataset: Dataset, scene: Scene) -> None:
    """Raise ElvisError for data that there are no pictures of."""
    mesh = dataset.mesh
    if Kind.of(dataset) is Kind.LINE:
        raise ElvisError(
            "1D data are drawn on the host from points a quarter of a pixel apart, with any device but the reference, "
            "which would have no exact reference: omit --device reference"
        )
    faces = bool(scene.every_object) and all(isinstance(shown, Faces) for shown in scene.every_object)
    if mesh.dimension < 2 or (mesh.space != mesh.dimension and not faces):
        raise ElvisError(f"expected 2D data in the plane or 3D data, found DIM={mesh.dimension} SPACE={mesh.space}")


def _patches(dataset: Dataset, field: str) -> list[Patch]:
    """The patches that have the field; raises ElvisError for data of too many dimensions."""
    found = [patch for patch in patches(dataset, [field]) if patch.fields[0] is not None]
    if any(patch.dimension > 3 for patch in found):
        raise ElvisError(f"pictures of data of more than three dimensions can't be made, as of field {field!r}")
    return found


def _margins(found: Location, dimension: int) -> Floats:
    """(n,) margins in elements with this many dimensions of their own, ends of Fourier directions counted in."""
    ends = 0.5 - 0.5 * np.abs(found.reference[:, dimension:])
    return np.asarray(np.minimum(found.margin, ends.min(axis=1, initial=np.inf)))


def _frame(scene: Scene, view: PlaneView, pixels: Ints, found: Location, field: Floats) -> Frame:
    """The results for some pixels as a picture; all others are misses."""
    count, shape = view.width * view.height, (view.height, view.width)
    values, element, status = np.full(count, np.nan), np.full(count, -1), np.zeros(count, np.uint8)
    reference = np.full((count, 3), np.nan)
    inside = found.status == InverseStatus.INSIDE
    values[pixels], element[pixels] = field, found.element_id

    # plane elements lie at 0 in the third coordinate
    reference[pixels[inside]] = 0.0
    reference[pixels, : found.reference.shape[1]] = found.reference
    certain = np.where(found.margin > TOLERANCE, Status.CERTAIN, Status.AMBIGUOUS)
    status[pixels] = np.select([inside, found.status == InverseStatus.FAILED], [certain, Status.FAILED], Status.MISS)
    return Frame(
        scene, view, values.reshape(shape), element.reshape(shape), reference.reshape(*shape, 3), status.reshape(shape)
    )
