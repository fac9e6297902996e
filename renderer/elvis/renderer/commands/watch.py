"""``elvis watch``: a picture of the newest step of a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from elvis.core.data.arguments import cache_option, overwrite_option
from elvis.scene.commandline.command import SceneCommand, setting_option

if TYPE_CHECKING:
    from elvis.core.data.dataset import Dataset
    from elvis.scene import Scene

EPILOG = """\b
Examples:
  elvis watch run/ --field p -o latest.png
  elvis watch wing.xml 'wing_*.chk' --field p --plane 0,0,0.2:0,0,1 -o latest.png
  elvis watch wing.toml run/ --every 10 --idle 3600 -o latest.png
  elvis watch run/ --field p -o latest.png -o 'p_{step:04}.png'
"""


@click.command(
    cls=SceneCommand,
    leaving=("stats", "panels", "scenes", "time", "step", "between", "plugin"),
    epilog=EPILOG,
    short_help="Follow a run and draw each new step.",
)
@click.argument("data", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="[SCENE] DATA...")
@setting_option
@click.option(
    "--every",
    type=click.FloatRange(0.05),
    default=2.0,
    show_default=True,
    metavar="SECONDS",
    help="Time between checks for a new step.",
)
@click.option("--idle", type=click.FloatRange(0), metavar="SECONDS", help="Exit if no new step appears for this time.")
@overwrite_option
@cache_option
def watch(
    data: tuple[Path, ...],
    settings: tuple[tuple[str, str], ...],
    every: float,
    idle: float | None,
    overwrite: bool,
    no_cache: bool,
    **options: Any,
) -> None:
    """Draw each new step of DATA, which is a folder in which a solver writes, or file names with * in them.

    A step is drawn when its files are complete and no longer change.  Each picture replaces the previous one
    atomically; a name with {step} (the number that --step counts) or {time} keeps a picture for each step.  The folder
    may be empty at first.  Ctrl-C ends the command.
    """
    from time import monotonic, sleep

    from elvis.core.base.errors import ElvisError
    from elvis.core.base.terminal import note
    from elvis.plugins.series.following import SOON, Following
    from elvis.renderer.asking.request import reading_for
    from elvis.renderer.frame.rendering import Pictures
    from elvis.scene.commandline.composing import composed, outputs_of_file

    scene = composed(data, options, settings, unused=("stats", "panels", "scenes"))
    _check(scene, overwrite)
    is_from_file = bool(outputs_of_file(scene, data, options, settings)) and not overwrite
    following = Following([Path(file) for file in scene.data], reading_for([scene], not no_cache))
    pictures: Pictures | None = None
    last, told, fault, is_drawn = monotonic(), "", "", False
    looks = 0
    try:
        while idle is None or looks < 2 or monotonic() - last <= idle:
            found = following.look()
            if found is not None:
                pictures = _shown(pictures, found, scene)
                before, fault = fault, _draw(pictures, scene, found, following.number, is_from_file)
                is_drawn |= not fault
                if fault not in ("", before):
                    note(fault)
                last = monotonic()
            if following.waiting not in ("", told):
                note(following.waiting)
            told = following.waiting
            looks += 1
            sleep(min(every, SOON) if looks == 1 else every)
    finally:
        if pictures is not None:
            pictures.close()
    if not is_drawn:
        raise ElvisError(f"no step was drawn in {idle:g} s: {following.waiting or fault or 'no step was complete'}")


def _check(scene: Scene, overwrite: bool) -> None:
    """ElvisError for invalid data or outputs, before waiting starts."""
    from elvis.core.files.output import check_places
    from elvis.scene.figure.step_outputs import first_outputs
    from elvis.scene.model.errors import SceneError

    if not scene.data:
        raise SceneError("the scene names no data: give the folder of a run, or its mesh and field files")
    if not scene.outputs:
        raise SceneError("expected -o, the name of the picture")
    check_places(first_outputs(scene), [Path(file) for file in scene.data if Path(file).is_file()], overwrite)
    for file in map(Path, scene.data):
        if not file.exists() and "*" not in file.name:
            raise SceneError(f"{file}: there is no such file or folder")


def _shown(pictures: Any, found: Dataset, scene: Scene) -> Any:
    """Pictures of a dataset, by the device that is open already."""
    from elvis.renderer.frame.rendering import Pictures

    if pictures is None:
        return Pictures(found, scene.device)
    pictures.show(found)
    return pictures


def _draw(pictures: Any, scene: Scene, found: Dataset, number: int, is_from_file: bool) -> str:
    """Write the picture of a step to all files and report it; the reason if there is none, else empty.

    SceneError for errors that do not concern only this step.
    """
    from math import nan

    from elvis.core.base.errors import ElvisError
    from elvis.core.base.terminal import say
    from elvis.scene.figure.step_outputs import save_step
    from elvis.scene.model.errors import AbsentError, SceneError

    try:
        frame = pictures.draw(scene)
        outputs = save_step(frame, number, nan if found.time is None else found.time, is_from_file)
    except ElvisError as error:
        if isinstance(error, SceneError) and not isinstance(error, AbsentError):
            raise
        return str(error)
    place = "" if found.time is None else f"time {found.time:.10g}"
    say(f"{', '.join(outputs)}: {place or 'the data as they are'}")
    return ""
