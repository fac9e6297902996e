"""Pages for colleagues that the viewer saves: a scene from several directions and at all steps, in one file."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from elvis.scene.model.errors import SceneError

if TYPE_CHECKING:
    from elvis.renderer.commands.page_views import PageViews
    from elvis.scene.model.whole import Camera, Scene
    from elvis.scene.record.frame import Frame

#: directions of a page
MAX_DIRECTIONS = 360


def views_of(how: Mapping[str, Any]) -> dict[str, int]:
    """The views that a request for a page names, ``directions`` and ``all_steps``; SceneError for too many."""
    views = {key: int(how[key]) for key in ("directions", "all_steps") if key in how}
    if not 1 <= views.get("directions", 1) <= MAX_DIRECTIONS:
        raise SceneError(f"directions: expected 1 to {MAX_DIRECTIONS}, found {views['directions']}")
    return views


def page_file(
    scene: Scene,
    directions: int,
    times: Sequence[float],
    cameras: Callable[[PageViews, Scene], list[Camera]],
    draw: Callable[[Scene], Frame],
) -> bytes:
    """The contents of an HTML file.

    directions  number of views around the up axis
    times       of all steps; none for the scene's own time
    cameras     finds the cameras of the views of the first scene
    draw        draws a scene at its time
    """
    from elvis.renderer.commands.page_views import PageViews
    from elvis.scene.commandline.composing import in_one_range
    from elvis.scene.figure.saving import save_views

    views = PageViews(directions, "all" if times else None)
    moments = [replace(scene, step=None, time=time) for time in times] or [scene]
    chosen = cameras(views, moments[0])
    scenes = [replace(moment, camera=camera) for moment in moments for camera in chosen]
    frames = [draw(each) for each in scenes]
    shared = in_one_range(frames)
    if shared is not None:
        frames = [draw(replace(each, range=shared)) for each in scenes]
    with tempfile.TemporaryDirectory(prefix="elvis-") as folder:
        path = Path(folder, "page.html")
        save_views(frames, views.angles, path, plain=scene.plain)
        return path.read_bytes()
