"""``elvis animate``: moving pictures from the command line."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import ALONE, Ranks, is_idle, of_first
from elvis.core.data.arguments import (
    TextType,
    cache_option,
    evenly,
    overwrite_option,
    scheduler_option,
    workers_option,
)
from elvis.plugins.command.running import shared
from elvis.scene.commandline.command import SceneCommand, setting_option, text_type

if TYPE_CHECKING:
    from collections.abc import Callable

    from elvis.core.data.moments import Moment
    from elvis.renderer.film.animation import Film
    from elvis.renderer.film.files import FrameFolder
    from elvis.renderer.film.motions import Motion
    from elvis.renderer.film.workers import Team
    from elvis.scene import Camera, Scene

#: frames of an animation whose number nothing says
FRAMES = 60
#: options of a scene that may also move, by their keys in the scene
MOVING = {"deform_scale": "deform.scale", "phase": "phase"}
EPILOG = """\b
Examples:
  elvis animate wing.xml wing_*.chk --field p --range series -o wing.webp
  elvis animate wing.xml wing_*.chk --times 0:2:100 --between cubic -o wing.mp4
  elvis animate wing.xml wing.fld --faces all --camera iso --orbit 360 --frames 90 -o frames/ -o around.webp
  elvis animate wing.xml wing.fld --faces all --path iso --path 3,-4,2:0,0,0:0,0,1 --frames 90 -o flight.mp4
  elvis animate wing.xml wing.fld --cut sphere:0,0,0:1 --key objects[0].surface.radius=0.1:0.9 -o grow.webp
  elvis animate beam.xml beam.fld --deform u,v,w --scale mode:50 --camera 3,-3,2:0.5,0.5,0.5:0,0,1:30 -o mode.webp
"""


@click.command(
    cls=SceneCommand,
    leaving=("outputs", "stats", "panels", "scenes", "time", "step", *MOVING),
    epilog=EPILOG,
    short_help="Draw an animation over the steps of a series, keys of a scene or a camera path.",
)
@click.argument("data", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="[SCENE] DATA...")
@click.option(
    "--output",
    "-o",
    "outputs",
    multiple=True,
    required=True,
    type=click.Path(path_type=Path),
    help="Animation to write, .webp, .mp4 or .gif, or a folder for its frames; without a folder the frames go into one "
    "named after the animation, ending in -frames.  Repeatable.",
)
@click.option("--times", metavar="A:B:N", type=TextType(evenly), help="N times from A to B.  [default: every step]")
@click.option(
    "--frames",
    type=click.IntRange(1, 100_000),
    help="Number of frames, without --times: at even times from the first step of a series to the last, or along the "
    f"motion of --key, --path and --orbit.  [default: every step of a series, else {FRAMES}]",
)
@click.option(
    "--key",
    "keys",
    multiple=True,
    metavar="KEY=V:V...",
    type=text_type("setting"),
    help="Key of the scene, as for --set, with its values at equal intervals of the animation, linear in between; or "
    "mode:S for S sin(2 pi t), with t from 0 to 1.  Repeatable.",
)
@click.option(
    "--scale",
    "deform_scale",
    metavar="S|A:B|mode:S",
    help="Factor of the displacement: constant, from A to B, or the oscillation S sin(2 pi t) of a mode.  [default: 1]",
)
@click.option(
    "--phase",
    metavar="DEGREES|A:B",
    help="Phase of complex fields, constant or from A to B; a film over whole turns, such as 0:360, is a loop without "
    "a seam.",
)
@click.option("--orbit", type=float, metavar="DEGREES", help="Total angle by which the camera turns about its up axis.")
@click.option(
    "--path",
    multiple=True,
    metavar="CAMERA",
    type=text_type("camera"),
    help="Camera that the view passes through, as for --camera; two or more, at equal intervals of the animation.  "
    "Repeatable.",
)
@click.option("--rate", type=click.FloatRange(0.1, 240), default=25.0, show_default=True, help="Frames per second.")
@workers_option
@scheduler_option
@setting_option
@overwrite_option
@cache_option
@shared
def animate(
    ranks: Ranks,
    data: tuple[Path, ...],
    outputs: tuple[Path, ...],
    times: tuple[float, float, int] | None,
    frames: int | None,
    keys: tuple[tuple[str, str], ...],
    deform_scale: str | None,
    phase: str | None,
    orbit: float | None,
    path: tuple[Camera | str, ...],
    rate: float,
    workers: int,
    scheduler: str,
    settings: tuple[tuple[str, str], ...],
    overwrite: bool,
    no_cache: bool,
    **options: Any,
) -> None:
    """Draw an animation of DATA; each frame equals the picture of elvis render at that time, byte for byte.

    Frames follow the steps of a series, or --times; --orbit, --path and --key also animate data of a single time.
    Existing frames of the same scene that are newer than the data are reused, so an interrupted run continues where it
    stopped.
    """
    from contextlib import ExitStack

    from elvis.core.base.terminal import say
    from elvis.plugins.command.workers import Workers
    from elvis.renderer.asking.completing import other_device
    from elvis.renderer.film.animation import Film, scenes_of
    from elvis.renderer.film.files import FrameFolder, write_film
    from elvis.renderer.film.motions import motion_of
    from elvis.renderer.film.workers import Team
    from elvis.scene.commandline.composing import composed
    from elvis.scene.model.tables import table_of

    if orbit and path:
        raise click.UsageError("expected --orbit or --path, found both", click.get_current_context())
    moving = [motion_of(*key) for key in keys]
    moving += _moving_options({"deform_scale": deform_scale, "phase": phase}, options)
    scene = composed(data, options, settings, unused=("outputs", "stats"))
    crew = Workers.of(workers, scheduler)
    if crew is not None or other_device(scene.device) is not None:
        if is_idle(ranks):
            return
        ranks = ALONE
    folder, films = of_first(ranks, lambda: _places(outputs, data, overwrite), "the outputs of an animation")
    is_new = not any(folder.glob("frame-*.png"))
    with ExitStack() as until_end:
        team = None if crew is None else until_end.enter_context(Team(crew, scene, not no_cache))
        if team is not None and is_new:
            team.begin()
        film = until_end.enter_context(Film(scene, not no_cache, ranks))
        moments = _moments(film, times, frames, bool(moving or orbit or path))
        scene, coloured = _coloured(film, scene, folder, not no_cache)
        # data that workers read are not read here
        reader = team if team is not None and is_new else film
        scenes = _filmed(reader.first_camera, scenes_of(scene, moments, moving), orbit, path)
        reader.open()
        place = FrameFolder(folder, [table_of(scene) for scene in scenes], film.files, coloured)
        try:
            found = _draw(film, scenes, place, team)
        finally:
            if not ranks.rank:
                place.drop_empty()
    if ranks.rank:
        return
    for path_of_film in films:
        write_film(found, path_of_film, rate)
    say(f"{len(found.paths())} frames: {', '.join(map(str, films or [folder]))}")


def _moving_options(texts: dict[str, str | None], options: dict[str, Any]) -> list[Motion]:
    """The motions that options of the scene say; their first value, or a constant, goes to the other options."""
    from elvis.core.data.arguments import numbers
    from elvis.renderer.film.motions import motion_of

    found: list[Motion] = []
    for name, text in texts.items():
        if text is None:
            continue
        option = f"--{name.rpartition('_')[2]}"
        if ":" not in text:
            options[name] = numbers(text, 1)[0]
            continue
        motion = motion_of(MOVING[name], text, option)
        options[name] = float(motion.of_frame(0, 1)[1])
        found.append(motion)
    return found


def _places(outputs: tuple[Path, ...], data: tuple[Path, ...], overwrite: bool) -> tuple[Path, list[Path]]:
    """The folder of frames and the animations; ElvisError for invalid outputs."""
    from elvis.core.files.output import check_folder_place, check_places
    from elvis.renderer.film.files import FILMS, check_film

    films = [path for path in outputs if path.suffix.lower() in FILMS]
    folders = [path for path in outputs if path not in films]
    if len(folders) > 1 or any(path.suffix and not path.is_dir() for path in folders):
        found = next((path for path in folders if path.suffix), folders[-1])
        raise ElvisError(f"expected animations, .webp, .mp4 or .gif, and one folder for frames, found {found}")
    for path in films:
        check_film(path)
    check_places(films, data, overwrite)
    folder = folders[0] if folders else films[0].with_name(f"{films[0].stem}-frames")
    check_folder_place(folder)
    return folder, films


def _moments(film: Film, times: tuple[float, float, int] | None, frames: int | None, moves: bool) -> list[Moment]:
    """The moment of each frame."""
    import numpy as np

    from elvis.core.data.moments import Moment

    if times is not None and frames is not None:
        raise click.UsageError("expected --times A:B:N or --frames N, found both", click.get_current_context())
    if times is not None:
        if film.series is None:
            raise ElvisError("--times: expected several steps of a series, found one state; --frames counts frames")
        film.series.check_within(times[0])
        film.series.check_within(times[1])
        return [Moment(time=float(time)) for time in np.linspace(*times)]
    if film.series is not None and frames is None:
        return [Moment(step=number) for number in range(len(film.series))]
    if film.series is not None and not moves:
        own = film.series.times
        return [Moment(time=float(time)) for time in np.linspace(own[0], own[-1], frames or FRAMES)]
    if not moves:
        motions = "--key, --path, --orbit, --scale A:B or --phase A:B"
        raise ElvisError(f"expected something that moves: a series, {motions}; found one state")
    return [Moment()] * (frames or FRAMES)


def _filmed(
    camera_of: Callable[[list[Scene]], Camera],
    scenes: list[Scene],
    orbit: float | None,
    path: tuple[Camera | str, ...],
) -> list[Scene]:
    """The scenes, seen by a camera that goes around, or along a path through others; fitted ones are of the first.

    camera_of  the camera of the first of some scenes that can be drawn
    """
    from dataclasses import replace

    from elvis.renderer.film.animation import orbited
    from elvis.scene.cameras.camera_path import CameraPath

    def fitted(camera: Camera | str) -> Camera:
        if isinstance(camera, str) or (camera.fov is None and camera.height is None):
            return camera_of([replace(scene, camera=camera) for scene in scenes])
        return camera

    count = len(scenes)
    if orbit:
        start = fitted(scenes[0].camera)
        cameras = [orbited(start, orbit * number / count) for number in range(count)]
    elif path:
        whole = CameraPath.of([fitted(camera) for camera in path])
        cameras = [whole.at(number / max(1, count - 1)) for number in range(count)]
    else:
        return scenes
    return [replace(scene, camera=camera) for scene, camera in zip(scenes, cameras, strict=True)]


def _coloured(film: Film, scene: Scene, folder: Path, is_kept: bool) -> tuple[Scene, dict[str, Any] | None]:
    """The scene with its range, and what the record of its frames says of one over all steps: that is found once."""
    from dataclasses import replace

    from elvis.renderer.asking.series_range import with_range
    from elvis.renderer.film.files import known_range

    if scene.range != "series":
        return scene, None
    files = [[str(path), path.stat().st_mtime_ns] for path in film.files if path.exists()]
    of = {"field": scene.field, "between": scene.between, "files": files}
    of |= {"reader": list(scene.reader), "others": list(scene.others)}
    of |= {"reference": [f"{name}={value!r}" for name, value in scene.reference.values.items()]}
    of |= {"moved": [repr(own) for own in (scene.deform, scene.copies, scene.complex, scene.phase)]}
    known = of_first(film.ranks, lambda: known_range(folder, of, film.files), "the range of an animation")
    found = with_range(scene, is_kept, film.series, film.ranks) if known is None else replace(scene, range=known)
    return found, {"of": of, "range": found.range}


def _draw(film: Film, scenes: list[Scene], frames: FrameFolder, team: Team | None) -> FrameFolder:
    """Draw the missing frames, and report the remarks of the series."""
    from dataclasses import replace

    from elvis.core.base.terminal import note, track
    from elvis.renderer.parts.bricks import peak_note

    missing = of_first(film.ranks, frames.begin, "the frames of an animation")
    shots = [(replace(scenes[number], outputs=(str(frames.path(number)),)), frames.path(number)) for number in missing]
    told: list[str] = []
    drawn = film.write(shots) if team is None or not shots else team.write(shots, told)
    for _ in track(drawn, f"drawing {len(missing)} of {len(scenes)} frames", len(missing)):
        pass
    for remark in dict.fromkeys([*film.told, *told, peak_note(scenes[0])]):
        if remark:
            note(remark)
    if not film.ranks.rank and not frames.paths():
        raise ElvisError(f"expected a step that can be drawn, found none among {len(scenes)}")
    return frames
