"""Scenes as tables of plain values, and back: what scene files hold, checked against the dataclasses themselves."""

from __future__ import annotations

import os
from dataclasses import MISSING, fields, is_dataclass
from difflib import get_close_matches
from pathlib import Path
from sys import float_info
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from elvis.core.distances.triangle_files import named_files, renamed
from elvis.scene.errors import SceneError
from elvis.scene.objects import CutSurface, Faces, Isosurface, VolumeRendering
from elvis.scene.surfaces import (
    Cone,
    Cylinder,
    FilePath,
    Implicit,
    PaletteName,
    Plane,
    Sphere,
    TriangleMesh,
    check,
)
from elvis.scene.whole import Scene

Table = dict[str, Any]
#: what the key ``kind`` says where several tables are possible
KINDS: dict[type, str] = {CutSurface: "cut", Faces: "faces", Isosurface: "isosurface", VolumeRendering: "volume"} | {
    Plane: "plane", Sphere: "sphere", Cylinder: "cylinder", Cone: "cone", Implicit: "implicit", TriangleMesh: "mesh"
}  # fmt: skip
LONGEST = 10_000
#: keys of files that are written
WRITTEN = ("outputs", "stats")
#: keys of expressions, in which files may be named
EXPRESSIONS = ("field", "quantity", "expression")


def scene_of(table: Table, folder: str = "") -> Scene:
    """The scene of a table; file names in it are relative to ``folder``.

    Raises SceneError that names the key and its place (``objects[2].style.opacity``).
    """
    scene: Scene = _made(Scene, table, "", folder)
    return scene


def table_of(item: Any, folder: str | None = None) -> Table:
    """The table of a scene or of a part of it, without what has its default; file names relative to ``folder``."""
    table: Table = {"kind": KINDS[type(item)]} if type(item) in KINDS else {}
    hints = _hints(type(item))
    for field in fields(item):
        value = getattr(item, field.name)
        default = field.default_factory() if field.default_factory is not MISSING else field.default
        if value is not None and (default is MISSING or value != default):
            table[field.name] = _plain(value, hints[field.name], folder)
            if folder is not None and field.name in EXPRESSIONS:
                table[field.name] = renamed(str(value), lambda file: os.path.relpath(file, folder or "."))
    return table


def input_files(item: Any) -> list[Path]:
    """The files that a scene or a part of it reads: data, triangles, colour maps; not those that it writes."""
    hints = _hints(type(item))
    found: list[Path] = []
    for field in fields(item):
        value = getattr(item, field.name)
        if value is None or field.name in WRITTEN:
            continue
        if field.name in EXPRESSIONS:
            found += named_files(value)
        hint = hints[field.name]
        for part in value if isinstance(value, tuple) else (value,):
            if is_dataclass(part):
                found += input_files(part)
            elif _is_file({hint, *get_args(hint)}, part):
                found.append(Path(part))
    return found


def _plain(value: Any, hint: Any, folder: str | None) -> Any:
    if is_dataclass(value):
        return table_of(value, folder)
    if isinstance(value, tuple):
        return [_plain(item, (get_args(hint) or (None,))[0], folder) for item in value]
    if folder is not None and _is_file({hint, *get_args(hint)}, value):
        return os.path.relpath(value, folder or ".")
    return value.tolist() if hasattr(value, "tolist") else value


def _is_file(hints: set[Any], value: Any) -> bool:
    """Whether a value in a place of some types is the name of a file."""
    return FilePath in hints or (PaletteName in hints and str(value).lower().endswith(".xml"))


def _hints(cls: Any) -> dict[str, Any]:
    return get_type_hints(cls, include_extras=True)


def _made(cls: type, raw: Any, place: str, folder: str) -> Any:
    """An instance of a dataclass from its table."""
    check(isinstance(raw, dict), place or "scene", "a table", _shown(raw))
    known = {field.name: field for field in fields(cls)}
    table = {key: value for key, value in raw.items() if not (key == "kind" and cls in KINDS)}
    for key in table:
        if key not in known:
            near = get_close_matches(str(key), known, 1)
            hint = f", did you mean {near[0]}?" if near else f": expected {', '.join(known)}"
            raise SceneError(f"unknown key {_joined(place, str(key))!r}{hint}")
    needed = (f.name for f in known.values() if f.default is MISSING and f.default_factory is MISSING)
    missing = [name for name in needed if name not in table]
    check(not missing, place or "scene", f"the key {missing and missing[0]!r}", "none")
    hints = _hints(cls)
    values = {key: _value(hints[key], value, _joined(place, key), folder) for key, value in table.items()}
    try:
        return cls(**values)
    except SceneError as error:
        raise SceneError(f"{place}: {error}" if place else str(error)) from error


def _value(hint: Any, raw: Any, place: str, folder: str) -> Any:
    """What stands for ``raw`` in a place of a type: optional values, alternatives, tuples, tables, plain values."""
    origin, choices = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        if raw is None and NoneType in choices:
            return None
        return _value(_choice([own for own in choices if own is not NoneType], raw, place), raw, place, folder)
    if is_dataclass(hint):
        return _made(hint, raw, place, folder)  # type: ignore[arg-type]
    if origin is tuple:
        return _tuple(choices, raw, place, folder)
    if origin is Literal:
        check(raw in choices, place, " or ".join(map(str, choices)), _shown(raw))
        return raw
    if origin is Annotated:
        check(isinstance(raw, str) and raw, place, f"a {choices[1]} name", _shown(raw))
        return os.path.normpath(os.path.join(folder, raw)) if _is_file({hint}, raw) else raw
    if isinstance(raw, str) and place.endswith(EXPRESSIONS):
        return renamed(raw, lambda file: os.path.normpath(os.path.join(folder, file)))
    expected, kinds = _PLAIN[hint]
    check(type(raw) in kinds and (hint is not float or abs(raw) <= float_info.max), place, expected, _shown(raw))
    return hint(raw)


def _choice(choices: list[Any], raw: Any, place: str) -> Any:
    """Which of several types a table, a list or a plain value is of; the key ``kind`` tells tables apart."""
    tables: list[Any] = [choice for choice in choices if is_dataclass(choice)]
    if isinstance(raw, dict) and tables:
        named, kind = {KINDS.get(choice, ""): choice for choice in tables}, raw.get("kind")
        check(len(tables) == 1 or str(kind) in named, _joined(place, "kind"), ", ".join(named), _shown(kind))
        return named.get(str(kind), tables[0])
    others = [choice for choice in choices if choice not in tables] or tables
    fitting = [choice for choice in others if isinstance(raw, list | tuple) == (get_origin(choice) is tuple)]
    return (fitting or others)[0]


def _tuple(items: tuple[Any, ...], raw: Any, place: str, folder: str) -> tuple[Any, ...]:
    """A tuple of a fixed length, or of any up to LONGEST."""
    free = items[-1] is Ellipsis
    expected = f"a list of at most {LONGEST}" if free else f"a list of {len(items)}"
    check(isinstance(raw, list | tuple), place, expected, _shown(raw))
    check(len(raw) <= LONGEST if free else len(raw) == len(items), place, expected, f"{len(raw)}")
    hints = [items[0]] * len(raw) if free else items
    return tuple(_value(h, value, f"{place}[{n}]", folder) for n, (h, value) in enumerate(zip(hints, raw, strict=True)))


#: what plain values of a type are called, and the types that are taken for it
_PLAIN: dict[Any, tuple[str, tuple[type, ...]]] = {
    float: ("a finite number", (int, float)),
    int: ("a whole number", (int,)),
    str: ("a text", (str,)),
    bool: ("true or false", (bool,)),
}


def _joined(place: str, key: str) -> str:
    return f"{place}.{key}" if place else key


def _shown(raw: Any) -> str:
    text = repr(raw)
    return text if len(text) <= 60 else f"{text[:57]}..."
