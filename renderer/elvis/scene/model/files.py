"""Scene files: TOML, YAML and JSON.  File names in them are relative to the file.

A scene may come from an untrusted source, so its rights are limited: it reads data but runs no code, and writes only
pictures and statistics, next to itself or below.  Everything else must be given on the command line.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from elvis.core.files.output import Outputs, write_text
from elvis.core.files.plain import check_plain
from elvis.scene.model.errors import SceneError
from elvis.scene.model.permissions import check_permitted, check_texts, forbidden
from elvis.scene.model.tables import Table, scene_of, table_of
from elvis.scene.model.whole import Scene

SUFFIXES = (".toml", ".yaml", ".yml", ".json")
LARGEST = 1 << 20  # bytes


def is_scene_file(path: Path) -> bool:
    """Whether the name has the suffix of a scene file."""
    return path.suffix.lower() in SUFFIXES


def read_scene(path: str | Path, given: Iterable[str] = ()) -> Scene:
    """The scene in a file; SceneError names the file, the key, the expected value and the value found.

    given  keys that the caller sets otherwise: their values in the file are ignored
    FormatError if the path is not a plain file
    """
    path = Path(path)
    check_plain(path)
    try:
        with path.open("rb") as stream:
            content = stream.read(LARGEST + 1)
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from error
    if len(content) > LARGEST:
        raise SceneError(f"{path}: expected a scene of at most {LARGEST} bytes, found more")
    try:
        table = _parse(content.decode(), path.suffix.lower())
    except (ValueError, RecursionError) as error:
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else " ".join(str(error).split())
        raise SceneError(f"{path}: cannot be read as {path.suffix[1:].upper()}: {reason}") from error
    for key in given:
        table.pop(key, None)
    try:
        scene = scene_of(table, str(path.parent))
        check_texts(table)
        check_permitted(table, path.parent)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from error
    return scene


def write_scene(scene: Scene, path: str | Path, outputs: Outputs | None = None) -> tuple[str, ...]:
    """Write a scene file in the language of its suffix; the keys that it may not have, and so has not.

    outputs  with which the file takes its place, where it is one of several
    """
    path = Path(path)
    check_scene_suffix(path)
    write_text(path, scene_text(scene, path), outputs)
    return forbidden(scene, path.parent)


def scene_text(scene: Scene, path: Path) -> str:
    """The text of a scene file of that name, without defaults and without settings that a file may not contain.

    SceneError if the format can't store file names, which need not be valid text.
    """
    usual: dict[str, Any] = {field.name: field.default for field in fields(Scene)}
    permitted = replace(scene, **{key: usual[key] for key in forbidden(scene, path.parent)})
    table = table_of(permitted, str(path.parent))
    try:
        check_texts(table)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from error
    match path.suffix.lower():
        case ".toml":
            return _toml(table)
        case ".json":
            return json.dumps(table, indent=2, ensure_ascii=False) + "\n"
        case _:
            import yaml

            return str(yaml.dump(table, Dumper=_with_exponents(yaml.SafeDumper), sort_keys=False, allow_unicode=True))


def check_scene_suffix(path: Path) -> None:
    """Raise SceneError if the suffix belongs to no scene language."""
    if not is_scene_file(path):
        raise SceneError(f"{path}: expected a scene's name that ends in {', '.join(SUFFIXES)}")


def _parse(text: str, suffix: str) -> Table:
    """The table in a text; ValueError where it is none."""
    readers: dict[str, Callable[[str], Any]] = {".json": json.loads, ".toml": _read_toml}
    table = readers.get(suffix, _yaml)(text)
    if not isinstance(table, dict):
        raise ValueError("expected a table of keys at the top")
    return dict(table)


def _read_toml(text: str) -> Table:
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib
    return tomllib.loads(text)


def toml_value(text: str) -> Any:
    """The value of a TOML text, or the text itself if it is not valid TOML."""
    try:
        return _read_toml(f"value = {text}")["value"]
    except ValueError:
        return text


def _yaml(text: str) -> Any:
    """The contents of a YAML text, by the safe loader; ValueError for invalid YAML."""
    import yaml

    try:
        return yaml.load(text, _without_aliases(_with_exponents(yaml.SafeLoader)))
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from error


def _without_aliases(base: Any) -> Any:
    """A loader of YAML that refuses aliases, by which a short text can say more than any memory holds."""

    def compose_node(loader: Any, parent: Any, index: Any) -> Any:
        event = loader.peek_event()
        if type(event).__name__ == "AliasEvent":
            raise ValueError(f"expected no aliases, found *{event.anchor} in line {event.start_mark.line + 1}")
        return base.compose_node(loader, parent, index)

    return type("Plain", (base,), {"compose_node": compose_node})


def _with_exponents(base: Any) -> Any:
    """A loader or dumper of YAML that takes 1e-3 for a number."""
    better: Any = type("Better", (base,), {})
    number = re.compile(r"[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+$")
    better.add_implicit_resolver("tag:yaml.org,2002:float", number, list("-+0123456789"))
    return better


def _toml(table: Table) -> str:
    """A table as TOML: plain keys first, lists of tables after them."""
    listed = {k: v for k, v in table.items() if isinstance(v, list) and v and isinstance(v[0], dict)}
    lines = [f"{key} = {toml_text(value)}" for key, value in table.items() if key not in listed]
    for key, items in listed.items():
        for item in items:
            lines += ["", f"[[{key}]]", *(f"{name} = {toml_text(value)}" for name, value in item.items())]
    return "\n".join([*lines, ""])


def toml_text(value: Any) -> str:
    """A plain value, as `toml_value` reads it."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml_text(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml_text, value)) + "]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
