"""The report as a folder: index.html, pictures, plots, records of numbers; whole, or not there at all."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from elvis.core.base.errors import ElvisError
from elvis.core.files.output import Outputs, check_folder_place, check_inputs
from elvis.reference.baseline.saving import FORMATS, save_mesh
from elvis.reference.report.page import page
from elvis.reference.report.summary import summary, times
from elvis.reference.study import Study

#: the file that makes a folder a report: which files are its own
MARK = "report.json"
KIND, VERSION = "ElVis accuracy report", 1
#: bytes of a mark that is read, at most
_LARGEST = 1 << 22


def write_report(
    study: Study,
    folder: Path,
    formats: Sequence[str] = (),
    inputs: Iterable[Path] = (),
    overwrite: bool = False,
) -> None:
    """Write the report, with the study's meshes in some formats; an earlier one in its place is replaced.

    Raises ElvisError as `check_folder` does.  Until all is written the earlier report stands.
    """
    with report_folder(folder, inputs, overwrite) as temporary:
        text, files = page(study, _scene(study, temporary, folder))
        put(temporary / "index.html", text)
        for name, content in files.items():
            put(temporary / name, content)
        _put_meshes(study, temporary / "meshes", formats)
        put(temporary / "summary.json", json_text(summary(study)))
        put(temporary / "times.json", json_text(times(study)))


@contextmanager
def report_folder(folder: Path, inputs: Iterable[Path], overwrite: bool) -> Iterator[Path]:
    """A folder to be filled, which takes its place once it is whole; raises ElvisError as `check_folder` raises it."""
    read = tuple(inputs)
    check_folder(folder, read, overwrite)
    with Outputs() as outputs, outputs.folder(folder) as temporary:
        yield temporary
        own = sorted([*_files_in(temporary), MARK])
        put(temporary / MARK, json_text({"kind": KIND, "version": VERSION, "files": own}))

        # something may have come into the folder while this one was made
        check_folder(folder, read, overwrite)


def check_folder(folder: Path, inputs: Iterable[Path] = (), overwrite: bool = False) -> None:
    """Raise ElvisError if a report cannot be written to this folder; call this before long work.

    The folder may be missing, empty, or hold a report and nothing else; unless ``overwrite``, none of its files may be
    an input.
    """
    check_folder_place(folder)
    if not folder.is_dir():
        return
    present = _files_in(folder)
    if not overwrite:
        check_inputs([folder / name for name in present], inputs)
    if not any(folder.iterdir()):
        return
    own = _own_files(folder)
    if own is None:
        raise ElvisError(
            f"{folder}: cannot be written: it is a folder of other things, without a report's {MARK}; name a new one"
        )
    foreign = sorted(present - own)
    if foreign:
        several = f" and {len(foreign) - 1} more" if len(foreign) > 1 else ""
        raise ElvisError(
            f"{folder}: cannot be written: the report in it did not write {foreign[0]}{several}; name a new folder, or "
            "move that"
        )


def _own_files(folder: Path) -> set[str] | None:
    """The files that the report in a folder has written; None without a report, or for another version."""
    mark = folder / MARK
    try:
        if mark.is_symlink() or not mark.is_file() or mark.stat().st_size > _LARGEST:
            return None
        found = json.loads(mark.read_bytes())
        is_report = (found["kind"], found["version"]) == (KIND, VERSION)
        return {str(name) for name in found["files"]} if is_report else None
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None


def _files_in(folder: Path) -> set[str]:
    """The names of all files and links below a folder, and of folders that hold nothing."""
    found = set()
    for place, folders, names in os.walk(folder):
        below = [name for name in folders if Path(place, name).is_symlink()]
        empty = [] if folders or names or Path(place) == folder else [""]
        found |= {os.path.relpath(Path(place, name), folder) for name in (*names, *below, *empty)}
    return found


def _scene(study: Study, folder: Path, final: Path) -> str:
    """The text of the scene's file, which is written to ``folder``; its file names hold from the ``final`` place."""
    from elvis.scene.model.files import scene_text

    if study.scene is None:
        return ""
    text = scene_text(study.scene, Path(os.path.realpath(final)) / "scene.toml")
    put(folder / "scene.toml", text)
    return text


def _put_meshes(study: Study, folder: Path, formats: Sequence[str]) -> None:
    """Write all meshes that were retained, in the formats that can hold them."""
    every = {**study.meshes, **{name: mesh for rival in study.rivals for name, mesh in rival.meshes.items()}}
    for suffix in formats:
        folder.mkdir(exist_ok=True)
        for name, mesh in every.items():
            if mesh.simplices.shape[1] in FORMATS[suffix] and len(mesh):
                save_mesh(mesh, folder / f"{name}.{suffix}")


def put(path: Path, content: Any) -> None:
    """A picture, a text or bytes."""
    path.parent.mkdir(exist_ok=True)
    if isinstance(content, np.ndarray):
        Image.fromarray(content).save(path, format="PNG", optimize=False)
    else:
        # names of files that are not text are shown with question marks
        path.write_bytes(content.encode(errors="replace"))


def json_text(value: Any) -> str:
    """The structure as JSON, what `plain` makes of it."""
    return json.dumps(plain(value), indent=2, allow_nan=False) + "\n"


def plain(value: Any) -> Any:
    """The structure without values that JSON does not support: numbers that aren't finite become null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (bool, np.bool_)) or value is None or isinstance(value, str):
        return bool(value) if isinstance(value, np.bool_) else value
    if isinstance(value, (int, np.integer)):
        return int(value)
    return float(value) if np.isfinite(value) else None
