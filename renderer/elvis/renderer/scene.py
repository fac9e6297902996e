"""What is to be drawn, as plain Python: planes, cameras and scenes.  Needs no device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from elvis.formats.arrays import Floats
from elvis.renderer.errors import SceneError

Vector: TypeAlias = tuple[float, float, float]


def unit(vector: Vector | Floats, what: str) -> Floats:
    """``vector`` at length 1; SceneError naming ``what`` where it has no direction."""
    array = np.asarray(vector, dtype=np.float64)
    length = float(np.linalg.norm(array))
    if not np.isfinite(length) or length == 0.0:
        raise SceneError(f"{what} must be a direction, found {', '.join(f'{x:g}' for x in array)}")
    return np.asarray(array / length)


@dataclass(frozen=True)
class Plane:
    """A plane through ``point``, perpendicular to ``normal`` (of any length)."""

    point: Vector
    normal: Vector

    def basis(self) -> tuple[Floats, Floats, Floats]:
        """Unit vectors right, up and normal, right-handed; up is as near to z (else y) as the plane allows."""
        normal = unit(self.normal, "the normal of the plane")
        towards = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
        right = unit(np.cross(towards, normal), "right")
        return right, np.cross(normal, right), normal


@dataclass(frozen=True)
class Camera:
    """Where a picture is taken from.

    eye, at, up  world coordinates; ``up`` need not be perpendicular to the view
    fov          vertical field of view in degrees (0, 180) of a perspective camera
    height       height of the view in world units of an orthographic camera, where ``fov`` is None
    """

    eye: Vector
    at: Vector
    up: Vector = (0.0, 0.0, 1.0)
    fov: float | None = None
    height: float | None = None

    def basis(self) -> tuple[Floats, Floats, Floats]:
        """Unit vectors right, up and forward.

        Raises SceneError where the camera has no direction, or looks along ``up``.
        """
        forward = unit(np.subtract(self.at, self.eye), "the view of the camera (at - eye)")
        right = unit(np.cross(forward, self.up), "up × view of the camera")
        return right, np.cross(right, forward), forward


#: the direction that a named view looks along, and its upward direction
NAMED_VIEWS: dict[str, tuple[Vector, Vector]] = {
    "+x": ((1, 0, 0), (0, 0, 1)),
    "-x": ((-1, 0, 0), (0, 0, 1)),
    "+y": ((0, 1, 0), (0, 0, 1)),
    "-y": ((0, -1, 0), (0, 0, 1)),
    "+z": ((0, 0, 1), (0, 1, 0)),
    "-z": ((0, 0, -1), (0, 1, 0)),
    "iso": ((-1, -1, -1), (0, 0, 1)),
}


@dataclass(frozen=True)
class Scene:
    """One picture.

    field    name of the field that colours the picture
    plane    the cut; None for 2D data, which is drawn in its own plane
    camera   a camera, or the name of a view (``fit`` looks straight at the plane; see NAMED_VIEWS) that is fitted to
             what is seen
    size     width and height in pixels; None takes the proportions of what is seen
    palette  name of a colour map
    range    values at the two ends of the colour map; None takes them from what is seen
    """

    field: str
    plane: Plane | None = None
    camera: Camera | str = "fit"
    size: tuple[int, int] | None = None
    palette: str = "viridis"
    range: tuple[float, float] | None = None
    background: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        width, height = self.size or (1, 1)
        if not (1 <= width <= 32768 and 1 <= height <= 32768):
            raise SceneError(f"the size of a picture is 1 to 32768 pixels a side, found {width} x {height}")
        if isinstance(self.camera, str) and self.camera != "fit" and self.camera not in NAMED_VIEWS:
            raise SceneError(f"unknown view {self.camera!r}: expected fit, {', '.join(NAMED_VIEWS)} or a camera")
        if self.range is not None and not (np.isfinite(self.range).all() and self.range[0] < self.range[1]):
            low, high = self.range
            raise SceneError(f"a colour range runs from a smaller to a greater value, found {low:g} to {high:g}")
