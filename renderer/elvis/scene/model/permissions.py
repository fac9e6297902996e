"""Limits of scene files, which may come from untrusted sources: code that runs, and files outside their folder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from elvis.scene.model.errors import SceneError
from elvis.scene.model.settings import settings
from elvis.scene.model.tables import Table
from elvis.scene.model.whole import Scene

#: suffixes of pictures and records
JPEG = (".jpg", ".jpeg")
#: formats that store only pixel colours
PIXELS = (".png", *JPEG)
#: pictures with the values of each pixel, for browsers
HTML = ".html"
PICTURES = (*PIXELS, ".svg", ".pdf", HTML, ".exr", ".npz")
#: suffixes of files that a scene may write, by key
SUFFIXES = {"outputs": PICTURES, "stats": (".json",)}


def check_permitted(table: Table, folder: Path) -> None:
    """SceneError if a scene file in ``folder`` names a plugin's file, or an output that it may not write.

    table  of a valid scene
    """
    if _is_plugin_file(table.get("plugin")):
        raise SceneError(
            f"plugin: expected the name of an installed plugin, found {table['plugin']!r}: a scene may not run files; "
            "name a trusted file with --plugin"
        )
    for key in SUFFIXES:
        for place, name in _file_names(key, table.get(key)):
            fault = fault_of(name, SUFFIXES[key], folder)
            if fault:
                option = settings(Scene)[key].option.split()[0]
                raise SceneError(f"{place}: expected {fault}, found {name!r}; use {option} for other folders")


def forbidden(scene: Scene, folder: Path) -> tuple[str, ...]:
    """The keys of a scene that a file in ``folder`` may not have."""
    keys = ["plugin"] if _is_plugin_file(scene.plugin) else []
    for key in SUFFIXES:
        names = [os.path.relpath(name, folder) for _, name in _file_names(key, getattr(scene, key))]
        if any(fault_of(name, SUFFIXES[key], folder) for name in names):
            keys.append(key)
    return tuple(keys)


def check_texts(item: Any, place: str = "") -> None:
    """SceneError where a text holds what names of files or UTF-8 can't, as escapes of JSON and YAML may."""
    if isinstance(item, dict):
        for key, value in item.items():
            check_texts(value, f"{place}.{key}" if place else str(key))
    elif isinstance(item, list):
        for number, value in enumerate(item):
            check_texts(value, f"{place}[{number}]")
    elif isinstance(item, str) and any(c == "\0" or "\ud800" <= c <= "\udfff" for c in item):
        raise SceneError(f"{place}: expected text in UTF-8 without zeros, found {item[:40]!r}")


def _is_plugin_file(plugin: Any) -> bool:
    """Whether a plugin is named by a file; names of installed ones are words."""
    return isinstance(plugin, str) and (Path(plugin).suffix.lower() == ".py" or Path(plugin).name != plugin)


def _file_names(key: str, value: Any) -> list[tuple[str, str]]:
    """The names of files under a key, each with its place in the scene."""
    if value is None or isinstance(value, str):
        return [(key, value)] if value else []
    return [(f"{key}[{number}]", str(name)) for number, name in enumerate(value)]


def fault_of(name: str, suffixes: tuple[str, ...], folder: Path) -> str:
    """The expected form of the name of an output of a scene in ``folder``; empty if the name is valid."""
    path = Path(name)
    if path.is_absolute() or ".." in path.parts:
        return "a name next to the scene or in a folder below"
    if not name.isprintable():
        return "a name without line breaks and other control characters"
    if any(part.startswith("-") for part in path.parts):
        return "a name that does not begin with '-', as options do"
    if path.suffix.lower() not in suffixes:
        return f"a name that ends in {', '.join(suffixes)}"
    home = Path(os.path.realpath(folder))
    if home not in Path(os.path.realpath(folder / path)).parents:
        return "a name without links out of the scene's folder"
    return ""
