"""Views of a page that ``elvis render`` writes: a scene from several directions and at several times of a series."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from elvis.core.base.errors import ElvisError
from elvis.core.data.arguments import times_option_for

if TYPE_CHECKING:
    from elvis.renderer.parts.bricks import PictureData
    from elvis.scene.model.whole import Camera, Scene


@dataclass(frozen=True)
class PageViews:
    """Views of one page, in the order of times, then of directions.

    directions  number of directions around the up axis, at least 1
    times       ``all`` steps of a series, or first time, last time and number of times; None for the scene's own time
    """

    directions: int
    times: tuple[float, float, int] | str | None

    @property
    def are_several(self) -> bool:
        """Whether the scene is drawn from several directions or at several times."""
        return self.directions > 1 or self.times is not None

    def check(self, scene: Scene, ranks: int) -> None:
        """ElvisError if a scene can't be drawn in several views."""
        from elvis.scene.model.permissions import HTML

        if not self.are_several:
            return
        option = "--directions" if self.directions > 1 else "--times"
        if ranks > 1:
            raise ElvisError(f"{option}: expected one process, found {ranks}")
        if scene.scenes:
            raise ElvisError(f"{option}: expected one scene, found --panels")
        for output in scene.outputs:
            if Path(output).suffix.lower() != HTML:
                raise ElvisError(f"{option}: expected outputs that end in {HTML}, found {output}")

    def in_time(self, scene: Scene, is_kept: bool) -> tuple[Scene, ...]:
        """The scene at each time; ElvisError if the data are not a series.

        is_kept  whether conversions are cached
        """
        if self.times is None:
            return (scene,)
        from elvis.plugins.series.series import series_in
        from elvis.renderer.asking.request import reading_for

        series = series_in(tuple(map(Path, scene.data)), reading_for([scene], is_kept))
        if series is None:
            raise ElvisError("--times: expected several steps of a series, found one state")
        times = series.times if isinstance(self.times, str) else _even_times(*self.times)
        return tuple(replace(scene, step=None, time=float(time)) for time in times)

    def seen(self, scenes: tuple[Scene, ...], opened: PictureData) -> tuple[Scene, ...]:
        """All views of scenes at different times, with the cameras that fit the first.

        opened  data of the first scene
        """
        if not self.are_several:
            return scenes
        from elvis.scene.cameras.fitting import LARGEST

        sized = [replace(scene, size=scene.size or LARGEST) for scene in scenes]
        cameras = self.cameras(sized[0], opened)
        return tuple(replace(scene, camera=camera) for scene in sized for camera in cameras)

    def cameras(self, scene: Scene, opened: PictureData) -> list[Camera]:
        """Cameras around the up axis; fitted ones have one scale, at which everything is visible."""
        from elvis.renderer.film.animation import orbited
        from elvis.renderer.frame.rendering import Pictures
        from elvis.scene.cameras.fitting import is_given
        from elvis.scene.cameras.view import named_camera

        if self.directions == 1:
            with Pictures(opened, scene.device) as pictures:
                return [pictures.camera(scene)]
        # cameras that face a plane would see it edge-on: fit is iso here
        start = named_camera(scene.camera, None) if isinstance(scene.camera, str) else scene.camera
        cameras = [orbited(start, 360.0 * number / self.directions) for number in range(self.directions)]
        if is_given(scene.camera):
            return cameras
        free = [replace(camera, height=None) for camera in cameras]
        with Pictures(opened, scene.device) as pictures:
            fitted = [pictures.camera(replace(scene, camera=camera)) for camera in free]
        height = max(camera.height or 0.0 for camera in fitted)
        return [replace(camera, height=height) for camera in fitted]

    @property
    def angles(self) -> list[str]:
        """Names of the directions; none for a single one."""
        count = self.directions
        return [f"{360.0 * number / count:.4g}°" for number in range(count)] if count > 1 else []


def page_options(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameter ``views`` combines the options for views of a page."""

    @click.option("--directions", type=click.IntRange(2, 360), metavar="N", help="Views around the up axis, for .html.")
    @times_option_for("Views at every step, or at N times, for .html.")
    @wraps(command)
    def parsed(directions: int | None, times: tuple[float, float, int] | str | None, **rest: Any) -> None:
        command(views=PageViews(directions or 1, times), **rest)

    return parsed


def _even_times(first: float, last: float, count: int) -> list[float]:
    import numpy as np

    return [float(time) for time in np.linspace(first, last, count)]
