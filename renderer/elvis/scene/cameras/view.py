"""Numerical cameras: from pixels to rays and plane points, and from world points to pixels.

Pixel (i, j) is column i from the left and row j from the top; integer coordinates are pixel centres.  In windows of a
picture, pixels keep their columns and rows, so that computed values are equal to the last bit.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.deformed.isometries import Isometry
from elvis.scene import NAMED_VIEWS, Camera, Plane, Scene, Vector, unit
from elvis.scene.model.errors import SceneError
from elvis.scene.model.whole import ALONG_UP

#: numbers (n,) of columns or rows, whole or not
Pixels: TypeAlias = NDArray[np.int64] | Floats
#: a view, or one of a plane
Shown = TypeVar("Shown", bound="View")

#: cosine between a view and the plane's normal below which the plane is a line
EDGE_ON = 1e-9
MARGIN = 1.04  # size of a fitted view relative to its contents


@dataclass(frozen=True, eq=False)
class View:
    """A camera, for a picture of ``width`` by ``height`` pixels, or for a window of one.

    left, top            column and row of the first pixel
    part_of              the picture that it is a window of; None where it is the whole
    corner, column, row  (3,) offset of pixel (0, 0) from the axis of the view, and steps to the next column and row; at
                         depth 1 in perspective, at any depth in parallel views
    to_pixel             (3, 4) rows for column, row and weight of a homogeneous world point; the weight is positive in
                         front
    """

    camera: Camera
    width: int
    height: int
    corner: Floats
    column: Floats
    row: Floats
    to_pixel: Floats
    left: int = field(default=0, kw_only=True)
    top: int = field(default=0, kw_only=True)
    part_of: View | None = field(default=None, kw_only=True)

    @staticmethod
    def through(camera: Camera, size: tuple[int, int]) -> View:
        """The view of a camera with a height or a field of view."""
        width, height = size
        right, up, _ = camera.basis()

        # a pixel step on the screen, which stands at distance 1 in perspective
        half = 0.5 * (camera.height or 1.0) if camera.fov is None else float(np.tan(0.5 * np.deg2rad(camera.fov)))
        step = 2.0 * half / height
        column, row = step * right, -step * up
        corner = -0.5 * (width - 1) * column - 0.5 * (height - 1) * row
        eye = np.asarray(camera.eye, dtype=np.float64)
        return View(camera, width, height, corner, column, row, _to_pixel(camera, eye, step, size))

    def with_margin(self: Shown, margin: int) -> Shown:
        """The picture with pixels around it."""
        if not margin:
            return self
        wide, high = self.width + 2 * margin, self.height + 2 * margin
        return replace(self, left=self.left - margin, top=self.top - margin, width=wide, height=high)

    def rows(self: Shown, first: int, last: int) -> Shown:
        """The rows of the picture from one to before another, as far as there are any."""
        first, last = max(first, self.top), min(last, self.top + self.height)
        if (first, last) == (self.top, self.top + self.height):
            return self
        return replace(self, top=first, height=last - first, part_of=self.whole)

    def shifted(self, x: float, y: float) -> View:
        """The view with rays through points shifted by x columns and y rows from the pixel centres."""
        shift = np.array([x, y, 0.0])[:, None] * self.to_pixel[2]
        corner = self.corner + x * self.column + y * self.row
        part_of = None if self.part_of is None else self.part_of.shifted(x, y)
        rays = corner, self.column, self.row, self.to_pixel - shift
        return View(self.camera, self.width, self.height, *rays, left=self.left, top=self.top, part_of=part_of)

    def before(self, isometry: Isometry) -> View:
        """The view that sees x as this one sees R x + s."""
        camera = self.camera
        points = np.array([camera.eye, camera.at], np.float64)
        eye, at = (_vector(point + 0.0) for point in isometry.points_before(points))
        up = _vector(isometry.directions_before(np.asarray(camera.up, np.float64)) + 0.0)
        corner, column, row = (isometry.directions_before(own) for own in (self.corner, self.column, self.row))
        homogeneous = np.eye(4)
        homogeneous[:3, :3] = isometry.matrix
        homogeneous[:3, 3] = isometry.vector
        part_of = None if self.part_of is None else self.part_of.before(isometry)
        moved = replace(camera, eye=eye, at=at, up=up)
        rays = corner, column, row, self.to_pixel @ homogeneous
        return View(moved, self.width, self.height, *rays, left=self.left, top=self.top, part_of=part_of)

    @property
    def whole(self) -> View:
        """The picture that this is a window of."""
        return self if self.part_of is None else self.part_of

    @property
    def first(self) -> Ints:
        """(2,) the least column and row."""
        return np.array([self.left, self.top])

    @property
    def last(self) -> Ints:
        """(2,) the greatest column and row."""
        return np.array([self.left + self.width - 1, self.top + self.height - 1])

    def places(self, pixel: Ints) -> tuple[Ints, Ints]:
        """Columns and rows (n,) of pixels (n,), which are numbered row by row."""
        rows, columns = np.divmod(pixel, self.width)
        return columns + self.left, rows + self.top

    def numbers(self, columns: Ints, rows: Ints) -> Ints:
        """Numbers (n,) of the pixels in columns and rows (n,)."""
        return np.asarray((rows - self.top) * self.width + (columns - self.left))

    def shows_same(self, other: View) -> bool:
        """Whether the rays of all pixels equal those of another view."""
        if self is other:
            return True
        if any(getattr(self, name) != getattr(other, name) for name in ("camera", "width", "height", "left", "top")):
            return False
        return all(
            np.array_equal(getattr(self, name), getattr(other, name))
            for name in ("corner", "column", "row", "to_pixel")
        )

    @property
    def count(self) -> int:
        """Number of pixels."""
        return self.width * self.height

    @property
    def perspective(self) -> bool:
        """Whether rays part from the eye; else they are parallel."""
        return self.camera.fov is not None

    @property
    def faces_ground(self) -> bool:
        """Whether it is a parallel view straight down z with y upwards, as of 2D data: axes go without saying."""
        _, up, forward = self.camera.basis()
        return not self.perspective and bool(forward[2] == -1.0 and up[1] == 1.0)

    def rays(self, columns: Pixels, rows: Pixels) -> tuple[Floats, Floats]:
        """Origins and directions (n, 3) of pixels' rays: the point at depth d is origin + d direction."""
        aside = self.corner + columns[:, None] * self.column + rows[:, None] * self.row
        eye, forward = np.asarray(self.camera.eye, dtype=np.float64), self.camera.basis()[2]
        still = np.zeros_like(aside)
        return (eye + still, forward + aside) if self.perspective else (eye + aside, forward + still)

    def every_ray(self) -> tuple[Floats, Floats]:
        """The rays of all pixels, row by row."""
        return self.rays_of(np.arange(self.count))

    def rays_of(self, pixel: Ints) -> tuple[Floats, Floats]:
        """The rays of pixels (n,), as rays()."""
        return self.rays(*self.places(pixel))

    def projected(self, points: Floats) -> Floats:
        """(..., 3) column and row, both times the weight, and the weight of world points (..., 3)."""
        return np.asarray(points @ self.to_pixel[:, :3].T + self.to_pixel[:, 3])

    def is_in_picture(self, points: Floats) -> Bools:
        """(n,) whether world points (n, 3) lie in front of the eye, and in the picture."""
        placed = self.projected(points)
        with np.errstate(divide="ignore", invalid="ignore"):
            image = placed[:, :2] / placed[:, 2:]
        inside = (image > self.first - 0.5).all(axis=1) & (image < self.last + 0.5).all(axis=1)
        found: Bools = inside & (placed[:, 2] > 0.0)
        return found

    def depth_of(self, points: Floats) -> Floats:
        """Distance of world points (…, 3) from the eye's plane, along the view."""
        forward = self.camera.basis()[2]
        return np.asarray((points - np.asarray(self.camera.eye)) @ forward)


@dataclass(frozen=True, eq=False)
class PlaneView(View):
    """A view of a plane.

    plane_point    (4, 3)  origin, column, row of the plane point's numerator; last row its weight (constant, column,
                           row): point of pixel (i, j) = (origin + i column + j row) / (w0 + i w1 + j w2)
    """

    plane: Plane
    plane_point: Floats

    @staticmethod
    def of(camera: Camera, plane: Plane, size: tuple[int, int]) -> PlaneView:
        """The view of a camera with a height or a field of view."""
        return PlaneView.on(View.through(camera, size), plane)

    @staticmethod
    def on(view: View, plane: Plane) -> PlaneView:
        """A view, with a plane in it."""
        own = {field.name: getattr(view, field.name) for field in fields(View)}
        return PlaneView(**own, plane=plane, plane_point=_plane_point(view, plane))

    @property
    def edge_on(self) -> bool:
        """Whether parallel rays run along the plane, so that nothing of it can be seen."""
        return not self.perspective and bool(abs(self.across @ self.camera.basis()[2]) < EDGE_ON)

    @cached_property
    def across(self) -> Floats:
        """(3,) the plane's unit normal."""
        return self.plane.basis()[2]

    def points(self) -> Floats:
        """(height, width, 3) the plane point of every pixel; NaN where the ray misses the plane or it lies behind."""
        return self.points_of(*self.places(np.arange(self.count))).reshape(self.height, self.width, 3)

    def points_of(self, columns: Pixels, rows: Pixels) -> Floats:
        """(n, 3) the plane points of some pixels, as points()."""
        pixel = np.stack([np.ones(len(columns)), columns, rows], axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            points = (pixel @ self.plane_point[:3]) / (pixel @ self.plane_point[3])[:, None]
            behind = ~(points @ self.to_pixel[2, :3] + self.to_pixel[2, 3] > 0.0)
        points[behind] = np.nan
        return np.asarray(points)

    def depths(self) -> Floats:
        """(n,) the depth of the plane under every pixel, row by row; not finite or negative where the ray misses it."""
        eye, forward = np.asarray(self.camera.eye, dtype=np.float64), self.camera.basis()[2]

        # a ratio of functions that are linear in column and row
        numerators = (self.plane_point[:3] @ forward) - (forward @ eye) * self.plane_point[3]
        across = np.arange(self.left, self.left + self.width)
        down = np.arange(self.top, self.top + self.height)[:, None]
        top, weight = (row[0] + row[1] * across + row[2] * down for row in (numerators, self.plane_point[3]))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(top / weight).reshape(-1)

    def normal(self) -> Floats:
        """(3,) the plane's unit normal, turned to the viewer."""
        towards = np.subtract(self.plane.point, self.camera.eye) if self.perspective else self.camera.basis()[2]
        return np.asarray(-self.across if self.across @ towards > 0 else self.across)


def space_view(scene: Scene) -> View:
    """The view of a scene whose camera and size are known, without its plane."""
    assert isinstance(scene.camera, Camera)
    assert scene.size is not None
    return View.through(scene.camera, scene.size)


def view_of(scene: Scene) -> View:
    """The view of a scene whose camera and size are known (see fitting.automatic).

    A view of a single plane contains the plane.  Raises SceneError if the camera looks along it.
    """
    view = space_view(scene)
    if scene.only_plane is None:
        return view
    view = PlaneView.on(view, scene.only_plane)
    if view.edge_on:
        raise SceneError("the camera looks along the plane, so it is not visible: choose another view")
    return view


def _plane_point(view: View, plane: Plane) -> Floats:
    """Numerators and weights of plane points: ray o + d w meets the plane through p in o - w n.(o - p) / n.w.

    One of o and w, which are functions of a pixel, is constant, so numerators are linear in column and row.
    """
    normal, point = unit(plane.normal, "the normal of the plane"), np.asarray(plane.point, dtype=np.float64)
    from_point, forward = view.camera.eye - point, view.camera.basis()[2]
    aside, still = np.array([view.corner, view.column, view.row]), np.zeros((3, 3))
    origins, ways = (still, aside) if view.perspective else (aside, still.copy())
    origins[0] += from_point
    ways[0] += forward
    heights, rates = origins @ normal, ways @ normal
    if not view.perspective and abs(rates[0]) <= EDGE_ON:
        rates[:] = 0.0
    numerators = np.outer(rates, origins[0]) - np.outer(heights, ways[0])
    numerators[1:] += rates[0] * origins[1:] - heights[0] * ways[1:]
    return np.array([*(numerators + np.outer(rates, point)), rates])


def _to_pixel(camera: Camera, eye: Floats, step: float, size: tuple[int, int]) -> Floats:
    """Homogeneous rows that give column, row and weight of a world point."""
    right, up, forward = camera.basis()
    middle = 0.5 * (size[0] - 1), 0.5 * (size[1] - 1)
    weight = np.append(forward, -forward @ eye)
    if camera.fov is None:
        weight = np.array([0.0, 0.0, 0.0, 1.0])
    columns = np.append(right, -right @ eye) / step + middle[0] * weight
    rows = -np.append(up, -up @ eye) / step + middle[1] * weight
    return np.array([columns, rows, weight])


def face_on(plane: Plane) -> Camera:
    """An orthographic camera of height 1 that looks straight at the plane's point, against its normal."""
    _, up, normal = plane.basis()
    return Camera(_vector(np.add(plane.point, normal)), plane.point, _vector(up), height=1.0)


def named_camera(name: str, plane: Plane | None) -> Camera:
    """The orthographic camera of a named view (see NAMED_VIEWS), height 1; ``fit`` without a plane is ``iso``."""
    if name == "fit" and plane is not None:
        return face_on(plane)
    forward, up = NAMED_VIEWS["iso" if name == "fit" else name]
    at = (0.0, 0.0, 0.0) if plane is None else plane.point
    return Camera(_vector(np.subtract(at, forward)), at, up, height=1.0)


def fit_camera(camera: Camera, size: tuple[int, int], extent: Floats, box: Floats, margin: float = MARGIN) -> Camera:
    """An orthographic camera along the same axes that shows all of ``extent``.

    It has the same upward direction, so that turns about this one stay level; one that looks along it has its own.
    size    width and height in pixels
    extent  (2, 2) least and greatest coordinates along the camera's right and up axes
    box     (2, 3) of the domain; the eye is set before it
    margin  how many times larger the view is than that
    """
    right, up, forward = camera.basis()
    sides = np.maximum(extent[1] - extent[0], 1e-300)
    height = margin * max(sides[1], sides[0] * size[1] / size[0])
    across, along = 0.5 * (extent[0] + extent[1])
    middle = forward @ (0.5 * (box[0] + box[1]))
    at = across * right + along * up + middle * forward
    eye = at - (0.6 * np.linalg.norm(box[1] - box[0]) + height) * forward
    sine = np.abs(np.cross(forward, camera.up)).max() / np.linalg.norm(camera.up)
    upward = _vector(up) if sine < ALONG_UP else camera.up
    return Camera(_vector(eye), _vector(at), upward, height=float(height))


def _vector(array: Floats) -> Vector:
    x, y, z = (float(value) for value in array)
    return x, y, z
