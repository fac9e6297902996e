"""Cameras and scenes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from elvis.core.arrays import Floats
from elvis.scene.errors import SceneError
from elvis.scene.objects import CutSurface, SceneObject, check_color, check_range
from elvis.scene.surfaces import FilePath, PaletteName, Plane, Surface, Vector, check, unit


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

    def __post_init__(self) -> None:
        check(self.fov is None or 0.0 < self.fov < 180.0, "fov", "degrees between 0 and 180", self.fov)
        check(self.height is None or 0.0 < self.height < np.inf, "height of the view", "a length", self.height)

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
class Light:
    """A light from far away, in the ``direction`` from the data to the lamp; None is behind the eye."""

    direction: Vector | None = None
    intensity: float = 0.75

    def __post_init__(self) -> None:
        if self.direction is not None:
            unit(self.direction, "the direction of a light")
        check(0.0 <= self.intensity < np.inf, "intensity of a light", "0 or more", self.intensity)


@dataclass(frozen=True)
class Clip:
    """A region from which nothing is shown: the inside or the outside of a surface."""

    surface: Surface
    away: Literal["inside", "outside"] = "inside"

    def __post_init__(self) -> None:
        check(self.away in ("inside", "outside"), "away of a clip", "inside or outside", self.away)


@dataclass(frozen=True)
class Scene:
    """One picture.

    field       what colours the picture: a field, an expression, a ready-made name; empty takes the first field
    plane       a cut, the same as CutSurface(plane) before all objects; None for 2D data, drawn in its own plane
    objects     what is shown
    camera      a camera, or the name of a view (``fit`` looks straight at the plane; see NAMED_VIEWS) that is fitted
                to what is seen
    size        width and height in pixels; None takes the proportions of what is seen
    samples     n: colours are means over n x n points of each pixel
    palette     name of a colour map, or an .xml file with one
    range       values at the two ends of the colour map; ``seen`` and None take them from the picture, ``all`` from
                certified bounds of the whole field
    ambient     part of its colour that a lit surface shows without any light
    clip        regions from which nothing is shown
    time        what ``t`` stands for in expressions; None takes the time of the data
    timeout     seconds after which an unfinished picture is given up
    title       above the picture; None takes the field's name
    data        files of the dataset; with ``plugin`` the runtime plugin that opens them
    device, outputs, plain, stats   as the options of ``elvis render``
    """

    field: str = ""
    plane: Plane | None = None
    camera: Camera | str = "fit"
    size: tuple[int, int] | None = None
    palette: PaletteName = "viridis"
    range: tuple[float, float] | Literal["seen", "all"] | None = None
    background: Vector = (1.0, 1.0, 1.0)
    objects: tuple[SceneObject, ...] = ()
    samples: int = 1
    lights: tuple[Light, ...] = (Light(),)
    ambient: float = 0.3
    clip: tuple[Clip, ...] = ()
    title: str | None = None
    time: float | None = None
    timeout: float | None = None
    data: tuple[FilePath, ...] = ()
    plugin: str | None = None
    device: str = "auto"
    outputs: tuple[FilePath, ...] = ()
    plain: bool = False
    stats: FilePath | None = None

    def __post_init__(self) -> None:
        width, height = self.size or (1, 1)
        if not (1 <= width <= 32768 and 1 <= height <= 32768):
            raise SceneError(f"the size of a picture is 1 to 32768 pixels a side, found {width} x {height}")
        if isinstance(self.camera, str) and self.camera != "fit" and self.camera not in NAMED_VIEWS:
            raise SceneError(f"unknown view {self.camera!r}: expected fit, {', '.join(NAMED_VIEWS)} or a camera")
        if isinstance(self.range, str):
            check(self.range in ("seen", "all"), "range", "seen, all or two values", self.range)
        else:
            check_range(self.range)
        check_color(self.background, "background")
        check(1 <= self.samples <= 16, "samples", "1 to 16", self.samples)
        check(self.time is None or np.isfinite(self.time), "time", "a finite number", self.time)
        check(self.timeout is None or self.timeout > 0.0, "timeout", "seconds above 0", self.timeout)
        check(0.0 <= self.ambient <= 1.0, "ambient", "0 to 1", self.ambient)

    @property
    def every_object(self) -> tuple[SceneObject, ...]:
        """The objects, the shortcut ``plane`` first."""
        return self.objects if self.plane is None else (CutSurface(self.plane), *self.objects)

    @property
    def only_plane(self) -> Plane | None:
        """The plane where a cut by it is all that is shown."""
        objects = self.every_object
        only = objects[0] if len(objects) == 1 else None
        return only.surface if isinstance(only, CutSurface) and isinstance(only.surface, Plane) else None

    @property
    def is_plain(self) -> bool:
        """Whether the colours of one unlit plane are all that is shown, one sample a pixel."""
        usual = None if self.only_plane is None else (CutSurface(self.only_plane),)
        return self.every_object == usual and not self.clip and self.samples == 1
