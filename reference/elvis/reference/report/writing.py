"""The report as a folder: index.html, pictures, plots, records of numbers; whole, or not there at all."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from elvis.formats.errors import ElvisError
from elvis.reference.baseline.saving import FORMATS, save_mesh
from elvis.reference.report.page import page
from elvis.reference.report.summary import summary, times
from elvis.reference.study import Study

#: marks a folder as a report, so that only reports are ever replaced
MARK = "summary.json"


def write_report(study: Study, folder: Path, formats: Sequence[str] = ()) -> None:
    """Write the report, with the study's meshes in some formats; an earlier one in its place is replaced.

    Raises ElvisError where something else stands there, or the folder above doesn't exist.
    """
    with replacing_folder(folder) as beside:
        text, files = page(study, _scene(study, beside))
        (beside / "index.html").write_text(text, encoding="utf-8")
        for name, content in files.items():
            _put(beside / name, content)
        _put_meshes(study, beside / "meshes", formats)
        _put(beside / MARK, _json(summary(study)))
        _put(beside / "times.json", _json(times(study)))


def check_folder(folder: Path) -> None:
    """ElvisError where a report cannot stand in this place; to be asked before long work."""
    if not Path(os.path.realpath(folder)).parent.is_dir():
        raise ElvisError(f"{folder}: cannot be written: there is no folder {Path(os.path.realpath(folder)).parent}")
    if folder.exists() and not folder.is_dir():
        raise ElvisError(f"{folder}: cannot be written: it is a file; a report is a folder")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / MARK).is_file():
        raise ElvisError(f"{folder}: cannot be written: it is a folder of other things; name a new one")


@contextmanager
def replacing_folder(folder: Path) -> Iterator[Path]:
    """A folder to fill in place of ``folder``: it takes that name when the block ends well, and vanishes otherwise."""
    check_folder(folder)
    target = Path(os.path.realpath(folder))
    beside = target.with_name(f".{target.name}.{os.getpid()}.{os.urandom(3).hex()}")
    beside.mkdir()
    try:
        yield beside
        if target.exists():
            old = target.with_name(f"{beside.name}.old")
            target.rename(old)
            beside.rename(target)
            shutil.rmtree(old)
        else:
            beside.rename(target)
    except BaseException:
        shutil.rmtree(beside, ignore_errors=True)
        raise


def _scene(study: Study, folder: Path) -> str:
    """The text of the scene's file, which is written; its files are named from the folder of the report."""
    from elvis.renderer.scene.files import write_scene

    if study.scene is None:
        return ""
    write_scene(study.scene, folder / "scene.toml")
    return (folder / "scene.toml").read_text(encoding="utf-8")


def _put_meshes(study: Study, folder: Path, formats: Sequence[str]) -> None:
    """All meshes that were kept, in the formats that can hold them."""
    every = {**study.meshes, **{name: mesh for rival in study.rivals for name, mesh in rival.meshes.items()}}
    for suffix in formats:
        folder.mkdir(exist_ok=True)
        for name, mesh in every.items():
            if mesh.simplices.shape[1] in FORMATS[suffix] and len(mesh):
                save_mesh(mesh, folder / f"{name}.{suffix}")


def _put(path: Path, content: Any) -> None:
    """A picture, a text or bytes."""
    path.parent.mkdir(exist_ok=True)
    if isinstance(content, np.ndarray):
        Image.fromarray(content).save(path, format="PNG", optimize=False)
    else:
        path.write_text(content, encoding="utf-8")


def _json(value: Any) -> str:
    return json.dumps(plain(value), indent=2, allow_nan=False) + "\n"


def plain(value: Any) -> Any:
    """The same structure without what JSON does not know: numbers that aren't finite become null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (bool, np.bool_)) or value is None or isinstance(value, str):
        return bool(value) if isinstance(value, np.bool_) else value
    if isinstance(value, (int, np.integer)):
        return int(value)
    return float(value) if np.isfinite(value) else None
