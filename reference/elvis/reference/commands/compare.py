"""``elvis compare``: the accuracy report, and records against one another."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from elvis.core.base.errors import ElvisError
from elvis.core.data.arguments import cache_option, overwrite_option, scheduler_option, workers_option
from elvis.scene.commandline.command import FIGURE, SceneCommand

if TYPE_CHECKING:
    from elvis.plugins.command.workers import Workers
    from elvis.reference.study import Study

EPILOG = """\b
Examples:
  elvis compare wing.xml wing.fld --field p --plane 0,0,0.2:0,0,1 -o report/
  elvis compare wing.toml -o report/ --refinements 0,1,2
  elvis compare wing.toml -o report/ --require pixel-exact
  elvis compare wing-*.toml -o reports/ --workers 4
  elvis compare exact.npz other.npz --json
  elvis compare exact.npz other.npz -o difference/

The exit status is 1 if --require pixel-exact is not met; the report is still written.
"""
_UNITS = {"k": 10**3, "M": 10**6, "G": 10**9, "T": 10**12, "": 1}


def _levels(context: click.Context, parameter: click.Parameter, value: str) -> tuple[int, ...]:
    """``0,1,2``: numbers of refinements, each once, in ascending order."""
    parts = [part.strip() for part in value.split(",")]
    if not all(part.isdecimal() and int(part) <= 10 for part in parts):
        raise click.BadParameter(f"expected numbers from 0 to 10 with commas between them, found {value!r}")
    return tuple(sorted({int(part) for part in parts}))


def _bytes(context: click.Context, parameter: click.Parameter, value: str | None) -> int | None:
    """``4G``, ``500M``: a number of bytes."""
    if value is None:
        return None
    text = value.removesuffix("B").strip()
    number, unit = (text[:-1], text[-1]) if text[-1:] in _UNITS and not text[-1:].isdigit() else (text, "")
    try:
        found = float(number) * _UNITS[unit.replace("K", "k")]
    except ValueError:
        found = -1.0
    if not 0 <= found < float("inf"):
        raise click.BadParameter(f"expected bytes such as 500M or 4G, found {value!r}")
    return int(found)


def _formats(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[str, ...]:
    """``ply,vtu``: formats of meshes."""
    from elvis.reference.baseline.saving import FORMATS

    found = tuple(part.strip().lower() for part in value.split(",")) if value else ()
    if not set(found) <= set(FORMATS):
        raise click.BadParameter(f"expected some of {', '.join(FORMATS)} with commas between them, found {value!r}")
    return found


@click.command(
    cls=SceneCommand,
    leaving=("outputs", "stats", "plain", "samples", *FIGURE),
    epilog=EPILOG,
    short_help="Report how exact a picture is, and how linear elements differ.",
)
@click.argument(
    "data", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="[SCENE]... DATA...|A.npz B.npz"
)
@click.option("--output", "-o", type=click.Path(path_type=Path), metavar="FOLDER", help="Folder of the report.")
@click.option(
    "--refinements", default="0,1,2,3", show_default=True, callback=_levels, help="Levels of linear pictures."
)
@click.option(
    "--memory-limit",
    metavar="BYTES",
    callback=_bytes,
    help="Memory limit of a linear mesh, such as 4G.  [default: half of the free memory]",
)
@click.option("--validate", type=click.IntRange(0, 4096), default=300, show_default=True, metavar="PIXELS",
              help="Longest side of the picture that the reference checks; 0 for no check.")  # fmt: skip
@click.option("--meshes", metavar="FORMATS", callback=_formats, help="Keep the meshes in the report: ply, glb, vtu.")
@click.option("--require", type=click.Choice(["pixel-exact"]), help="Fail if a tolerance is exceeded.")
@click.option("--json", "as_json", is_flag=True, help="Print the numbers of summary.json.")
@workers_option
@scheduler_option
@overwrite_option
@cache_option
def compare(
    data: tuple[Path, ...],
    output: Path | None,
    as_json: bool,
    workers: int,
    scheduler: str,
    **options: Any,
) -> None:
    """Report how exact the picture of a scene is, and what linear elements would have shown instead.

    The scene is given as for elvis render: a scene file, or DATA and options.  With several scene files each gets a
    report in a folder of its name below that of -o, and --workers write them in parallel.  Two records (.npz) of elvis
    render are compared with each other, with the first as the reference.
    """
    from elvis.core.base.terminal import note, print_json, say, stage
    from elvis.plugins.command.workers import Workers

    crew = Workers.of(workers, scheduler)
    tasks = _tasks(data, output, options)
    if crew is not None and len(tasks) == 1:
        raise click.UsageError("--workers: expected several scene files for them, found one picture")
    with stage("comparing"):
        found = list(map(made, tasks)) if crew is None else _made_by(crew, tasks)
    for remark in dict.fromkeys(remark for one in found for remark in one.remarks):
        note(remark)
    if as_json:
        numbers = {task.name: one.numbers for task, one in zip(tasks, found, strict=True)}
        print_json(numbers if len(tasks) > 1 else found[0].numbers)
    failed = [f"{task.name}: {one.failure}" for task, one in zip(tasks, found, strict=True) if one.failure]
    if failed:
        others = f" ({len(failed)} pictures fail)" if len(failed) > 1 else ""
        raise ElvisError(f"{failed[0] if len(tasks) > 1 else found[0].failure}{others}")
    if not as_json:
        for task, one in zip(tasks, found, strict=True):
            say(f"{task.name}: {one.numbers['conclusion']}" if len(tasks) > 1 else one.numbers["conclusion"])


@dataclass(frozen=True)
class Task:
    """A comparison to be made.

    name     of its scene
    data     files: a scene's, or records
    output   the folder of its report
    options  of the command, by name
    """

    name: str
    data: tuple[Path, ...]
    output: Path | None
    options: dict[str, Any]


@dataclass(frozen=True)
class Made:
    """The result of a comparison: numbers of the summary, remarks about the data, and the failed requirement."""

    numbers: dict[str, Any]
    remarks: tuple[str, ...]
    failure: str


def _tasks(data: tuple[Path, ...], output: Path | None, options: dict[str, Any]) -> list[Task]:
    """One for each scene file, with all other files; raises ElvisError if a report can't be written."""
    from elvis.core.files.output import check_folder_place
    from elvis.reference.report.writing import check_folder
    from elvis.scene.model.files import is_scene_file

    scenes = list(filter(is_scene_file, data))
    if len(scenes) < 2:
        tasks = [Task("", data, output, options)]
    else:
        others = tuple(path for path in data if path not in scenes)
        places = [None if output is None else output / scene.stem for scene in scenes]
        tasks = [Task(s.stem, (s, *others), place, options) for s, place in zip(scenes, places, strict=True)]
        if len({task.name for task in tasks}) < len(tasks):
            raise ElvisError(f"expected scene files of different names, found {', '.join(map(str, scenes))}")
        if output is not None:
            check_folder_place(output)
            output.mkdir(exist_ok=True)
    for task in tasks:
        if task.output is not None:
            check_folder(task.output, task.data, options["overwrite"])
    return tasks


def _made_by(crew: Workers, tasks: list[Task]) -> list[Made]:
    """The results of all tasks, computed by workers."""
    from elvis.plugins.command.workers import begun, results

    crew.prepare("elvis.reference.commands.compare")
    with crew.client() as client:
        return results(client, begun(client, made, ((task,) for task in tasks)), "finished reports remain")


def made(task: Task) -> Made:
    """Compare, and write the report."""
    from elvis.reference.report.summary import summary
    from elvis.reference.report.writing import plain, write_report
    from elvis.scene.model.tables import input_files

    options = dict(task.options)
    meshes, require, overwrite = (options.pop(name) for name in ("meshes", "require", "overwrite"))
    try:
        study = _study(task.data, {**options, "meshes": bool(meshes and task.output)}, task.output)
    except ElvisError as error:
        if not task.name:
            raise
        raise ElvisError(f"{task.name}: {error}") from error
    if task.output is not None:
        inputs = [*task.data, *(input_files(study.scene) if study.scene else ())]
        write_report(study, task.output, meshes, inputs, overwrite)
    told = study.dataset.remarks if study.dataset is not None else ()
    return Made(plain(summary(study)), tuple(told), _failure(require, study))


def _study(data: tuple[Path, ...], options: dict[str, Any], output: Path | None) -> Study:
    """The comparison of two records, or of a scene with its linear pictures."""
    records = [path for path in data if path.suffix.lower() == ".npz"]
    if not records:
        return _of_scene(data, options, output)
    if len(data) != 2 or len(records) != 2:
        raise click.UsageError("expected two records (.npz), or data and a scene, found both or another number")
    from elvis.reference.record import Record
    from elvis.reference.study import compare_records

    return compare_records(Record.load(records[0]), Record.load(records[1]), records[1].name)


def _of_scene(data: tuple[Path, ...], options: dict[str, Any], output: Path | None) -> Study:
    """The exact picture of a scene against linear ones; ``output`` is to hold the scene."""
    from elvis.plugins.data.data import Reading, dataset_of, pairs
    from elvis.reference.study import compare_scene
    from elvis.scene.commandline.composing import composed
    from elvis.scene.model.errors import SceneError
    from elvis.scene.model.files import scene_text

    own = ("refinements", "memory_limit", "validate", "meshes", "no_cache")
    levels, limit, validation_size, meshes, no_cache = (options.pop(name) for name in own)
    scene = composed(data, options, (), unused=("outputs", "stats"))
    if not scene.data:
        raise SceneError("the scene names no data; also give the mesh and field files")
    if scene.plugin is not None:
        raise SceneError("linear meshes need data of the native format: omit the plugin")
    if output is not None:
        scene_text(scene, output / "scene.toml")
    if scene.range == "series":
        raise SceneError("range: series is for animations: expected visible, all or two values")
    reading = Reading(None, pairs(scene.reader), not no_cache, scene.moment, scene.others)
    deformation = None if scene.deform is None else scene.deform.deformation
    reference, complexes = scene.reference.values, scene.complexes
    reading = replace(reading, reference=reference, deformation=deformation, complexes=complexes)
    dataset = dataset_of(tuple(map(Path, scene.data)), reading)
    return compare_scene(dataset, scene, levels, limit, validation_size=validation_size, meshes=meshes)


def _failure(require: str | None, study: Study) -> str:
    """A message if the picture misses the requirement, or nothing was checked; empty on success."""
    from elvis.reference.report.conclusion import failure

    if require is None:
        return ""
    if study.validation is None:
        return (
            "--require pixel-exact: nothing was validated: draw on a device other than the reference, with --validate"
        )
    failed = (check for check in study.validation.checks if not check.passed)
    return next((f"--require pixel-exact: {failure(check)}" for check in failed), "")
