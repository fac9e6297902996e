"""1D data as curves, drawn on the host: lines in the plane or in space, else values over x as in a plot."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, joined_columns
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.boxes import Boxes
from elvis.core.mapping.pointwise import positions
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Evaluator
from elvis.scene import Faces, Plane, Scene, Style
from elvis.scene.cameras.fitting import automatic, empty_picture_remark, surrounding
from elvis.scene.cameras.view import View, space_view
from elvis.scene.model.errors import AbsentError, SceneError
from elvis.scene.record.frame import Drawing, Frame, Legend, Ordinate, Status
from elvis.scene.record.line_coverage import line_coverage
from elvis.scene.record.palette import Palette, automatic_range

#: default width of a curve in pixels, without mesh lines; height of a plot relative to its width
WIDTH, HEIGHT = 2.5, 0.6
#: pixels between the points that stand for a curve, and the most of them
STEP, MOST = 0.25, 1 << 22


class Curves:
    """The elements of 1D data: at `count` even reference points of each, arrays by point."""

    def __init__(self, dataset: Dataset, quantity: str) -> None:
        self.quantity, self.is_plot = quantity, dataset.mesh.space == 1
        self.expression = Expression.of(dataset, quantity)
        self.evaluator = Evaluator(dataset, [self.expression])
        self.scale, self.base = 1.0, 0.0
        self.sample(33)
        if self.is_plot:
            self.base, high = automatic_range(self.value)
            self.scale = HEIGHT * float(np.ptp(self.place[:, 0])) / (high - self.base)
            self.sample(33)

    def sample(self, count: int) -> None:
        """Set element ids, references, positions (n, 3) in the picture, and values (n,)."""
        found: list[tuple[Floats | Ints, ...]] = []
        for patch in self.evaluator.patches:
            rows, points = np.repeat(np.arange(len(patch)), count), np.tile(np.linspace(-1.0, 1.0, count), len(patch))
            value = self.evaluator.values(self.expression, patch, rows, points[:, None])
            found.append((patch.element_ids[rows], points, positions(patch, rows, points[:, None]), value))
        self.element, self.reference, self.place, self.value = joined_columns(found)
        self.count = count
        if self.is_plot:
            self.place[:, 1] = self.scale * (np.nan_to_num(self.value) - self.base)

    @property
    def ordinate(self) -> Ordinate | None:
        """The meaning of y in a plot."""
        return Ordinate(self.quantity, self.base, self.scale) if self.is_plot else None

    def boxes(self) -> Boxes:
        """(k, 6) boxes around the elements."""
        points = self.place.reshape(-1, self.count, 3)
        return np.concatenate([points.min(axis=1), points.max(axis=1)], axis=1).astype(np.float32)

    def visible_points(self, view: View) -> Floats:
        """(n, 2) columns and rows of points close enough together for a view, NaN behind the eye."""
        while True:
            rows = view.projected(self.place)
            with np.errstate(divide="ignore", invalid="ignore"):
                seen = np.where(rows[:, 2:] > 0.0, rows[:, :2] / rows[:, 2:], np.nan)
            steps = np.diff(seen.reshape(-1, self.count, 2), axis=1)
            if len(seen) > MOST or not (np.abs(steps) > STEP).any():
                return seen
            self.sample(2 * self.count - 1)

    def nearest(self, view: View, radius: float) -> tuple[Floats, Ints]:
        """By pixel (n,): the distance in pixels of the nearest point within ``radius``, and its number."""
        seen, size = self.visible_points(view), np.array([view.width, view.height])
        distance, number = np.full(view.count, np.inf), np.zeros(view.count, np.int64)
        around = range(-int(np.ceil(radius)), int(np.ceil(radius)) + 1)
        for offset in product(around, around):
            pixel = np.rint(np.nan_to_num(seen, nan=-1e6)) + offset
            away = np.linalg.norm(pixel - seen, axis=1)
            held = np.flatnonzero(((pixel >= 0) & (pixel < size)).all(axis=1) & (away <= radius))
            held = held[np.argsort(-away[held], kind="stable")]
            own = (pixel[held, 1] * view.width + pixel[held, 0]).astype(np.int64)
            nearer = away[held] < distance[own]
            distance[own[nearer]], number[own[nearer]] = away[held[nearer]], held[nearer]
        return distance, number


def draw_curves(dataset: Dataset, scene: Scene) -> Frame:
    """A picture of 1D data, coloured by the scene's field; only faces of the scene's objects are used, for their style.

    If the data lie on the x axis, their values become y, scaled to a plot with axes; positions refer to the plot.
    """
    if any(not isinstance(item, Faces) for item in scene.every_object):
        raise SceneError("1D data are drawn as curves: remove cuts, isosurfaces and volumes")
    curves = Curves(dataset, scene.field)
    style = scene.objects[0].style if scene.objects and isinstance(scene.objects[0], Faces) else Style()
    width = style.mesh_lines.width if style.mesh_lines else WIDTH
    view = _view(curves, scene, dataset.mesh.space < 3, width)
    distance, number = curves.nearest(view, 0.5 * width + 0.5)
    if not np.isfinite(distance).any():
        raise AbsentError(empty_picture_remark(None, surrounding([curves.boxes()])))
    asked = style.range or scene.range
    name = style.palette or scene.palette
    ends = asked if isinstance(asked, tuple) else automatic_range(curves.value, name)
    palette = Palette.of_name(name, *ends).over_range(scene.bar)
    return _frame(scene, view, curves, line_coverage(distance, width), number, palette, style)


def _view(curves: Curves, scene: Scene, is_flat: bool, width: float) -> View:
    """The view of a scene, perpendicular to flat data."""
    ground = Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)) if is_flat else None

    def glance(small: Scene) -> Bools:
        view = space_view(small)
        near = np.isfinite(curves.nearest(view, 0.5 * width)[0])
        return np.asarray(near.reshape(view.height, view.width))

    return space_view(automatic(replace(scene, plane=ground, objects=()), [curves.boxes()], glance))


def _frame(
    scene: Scene, view: View, curves: Curves, coverage: Floats, number: Ints, palette: Palette, style: Style
) -> Frame:
    """Pixels that are covered half or more show the nearest point of a curve."""
    shape, seen = (view.height, view.width), coverage >= 0.5
    line_color = palette.colors(curves.value[number]) if style.color is None else np.tile(style.color, (view.count, 1))
    part = (style.opacity * coverage)[:, None]
    color = (1.0 - part) * np.asarray(scene.backdrop) + part * line_color
    depth = np.where(seen, view.depth_of(curves.place[number]), np.inf)
    reference = np.where(seen[:, None], np.pad(curves.reference[number, None], ((0, 0), (0, 2))), np.nan)
    drawing = Drawing(
        depth.reshape(shape),
        np.full((*shape, 3), np.nan),
        color.reshape(*shape, 3),
        (Legend(scene.field, palette, bar=scene.bar),) if style.color is None else (),
    )
    frame = Frame(
        scene,
        view,
        np.where(seen, curves.value[number], np.nan).reshape(shape),
        np.where(seen, curves.element[number], -1).reshape(shape),
        reference.reshape(*shape, 3),
        np.where(seen, Status.CERTAIN, Status.MISS).astype(np.uint8).reshape(shape),
        drawing=drawing,
        ordinate=curves.ordinate,
    )
    frame.stats.update(device={"name": "host", "label": "NumPy"}, elements=len(curves.boxes()), pixels=frame.counts())
    return frame
