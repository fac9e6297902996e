"""Scenes as tables of plain values, and back: what scene files hold."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import is_dataclass, replace
from pathlib import Path
from typing import Any, get_args

from elvis.scene.model.objects import SceneObject
from elvis.scene.model.settings import given_values, text_of, types
from elvis.scene.model.surfaces import Surface
from elvis.scene.model.whole import Scene

Table = dict[str, Any]
#: what stands between the steps of a key
_BETWEEN_STEPS = re.compile(r"[.\[\]]+")
#: what the key ``kind`` says where several tables are possible
KINDS: dict[type, str] = {cls: cls.kind for cls in (*get_args(SceneObject), *get_args(Surface))}


def scene_of(table: Table, folder: str = "") -> Scene:
    """The scene of a table; file names in it are relative to ``folder``.

    Raises SceneError that names the key and its place (``objects[2].style.opacity``).
    """
    from elvis.scene.model.validation import scene_from

    scene: Scene = with_files(scene_from(table), lambda name: os.path.normpath(os.path.join(folder, name)))
    return scene


def table_of(item: Any, folder: str | None = None) -> Table:
    """The table of a scene or of a part of it, without defaults, with file names relative to ``folder``."""
    if folder is not None:
        item = with_files(item, lambda name: os.path.relpath(name, folder or "."))
    given = {name: _plain(value) for name, value in given_values(item).items() if value is not None}
    return {"kind": item.kind, **given} if type(item) in KINDS else given


def steps_of(key: str) -> list[int | str]:
    """The steps of a key such as ``objects[0].style.opacity`` from a scene's table to a value."""
    return [int(step) if step.isdecimal() else step for step in _BETWEEN_STEPS.split(key.rstrip("]"))]


def input_files(scene: Scene) -> list[Path]:
    """The input files of a scene: data, triangles, colour maps."""
    found: list[Path] = []

    def note(name: str) -> str:
        found.append(Path(name))
        return name

    with_files(replace(scene, outputs=(), stats=None), note)
    return found


def with_files(item: Any, change: Callable[[str], str]) -> Any:
    """A scene or a part of it with other names of files."""
    cls: Any = type(item)
    changed = {name: _changed(getattr(item, name), hint, change) for name, hint in types(cls).items()}
    return replace(item, **changed)


def _changed(value: Any, hint: Any, change: Callable[[str], str]) -> Any:
    """A value in a place of some type, with other names of files."""
    if is_dataclass(value):
        return with_files(value, change)
    if isinstance(value, tuple):
        return tuple(_changed(item, hint, change) for item in value)
    text = text_of(hint) if isinstance(value, str) else None
    return text.changed(value, change) if text else value


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return table_of(value)
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return value.tolist() if hasattr(value, "tolist") else value
