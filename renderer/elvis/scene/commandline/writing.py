"""A scene as the words of a command, and as lines of Python, that reproduce the same picture.

Common options come first; ``--set KEY=VALUE`` expresses the remaining settings.  The words are parsed again for
verification before they are returned.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

import click

from elvis.core.base.errors import ElvisError
from elvis.scene.commandline.command import SceneCommand, text_type
from elvis.scene.commandline.composing import composed
from elvis.scene.commandline.options import OBJECTS, STYLES
from elvis.scene.model.copies import Copies
from elvis.scene.model.errors import SceneError
from elvis.scene.model.files import toml_text
from elvis.scene.model.objects import VolumeRendering
from elvis.scene.model.settings import Setting, default_of, given_values, settings
from elvis.scene.model.style import Style
from elvis.scene.model.tables import Table, table_of
from elvis.scene.model.whole import Scene

#: keys of a scene without an option of their own: data and outputs
APART = ("data", "objects", "plane", "outputs", "stats")
PICTURE = "picture.png"


def command_of(scene: Scene) -> str:
    """The ``elvis render`` command of a scene whose data are files; SceneError where they aren't."""
    if not scene.data:
        raise SceneError("the data come from Python; copy the Python lines instead of the command")
    # a leading minus sign would mark an option
    data = [os.path.join(".", name) if name.startswith("-") else name for name in scene.data]
    return shlex.join(["elvis", "render", *data, *option_words(scene), "-o", PICTURE])


def option_words(scene: Scene) -> list[str]:
    """The words of options that make a scene out of its data, shortest first; SceneError where none do."""
    wanted = replace(scene, plane=None, objects=scene.every_object, outputs=(), stats=None, data=())
    plain = [word for words in _plain_options(wanted) for word in words]
    for words in _object_options(wanted):
        found = _completed([*plain, *words], wanted)
        if found is not None and _normal(_read(found)) == _normal(wanted):
            return found
    raise SceneError("no command line can express this scene; save it and draw the saved file")


def python_of(scene: Scene) -> str:
    """Lines of Python that draw a scene; data that came from Python are called ``dataset`` in them."""
    names = sorted({"render", *(type(part).__name__ for part in _parts(scene))})
    given = [f"    {name}={value!r}," for name, value in given_values(replace(scene, outputs=(), stats=None)).items()]
    plain = ", plain=True" if scene.plain else ""
    lines = [f"from elvis import {', '.join(names)}", "", "scene = Scene(", *given, ")"]
    data = "" if scene.data else "dataset, "
    return "\n".join([*lines, f'render({data}scene=scene).save("{PICTURE}"{plain})', ""])


def _parts(item: Any) -> Iterator[Any]:
    """A model and all models in it that differ from their defaults."""
    if is_dataclass(item):
        yield item
        for value in given_values(item).values():
            yield from _parts(value)
    elif isinstance(item, tuple):
        for each in item:
            yield from _parts(each)


def _normal(scene: Scene) -> Table:
    """The table of the objects drawn: equal for the shortcut ``plane`` and for an equivalent object."""
    return table_of(replace(scene, plane=None, objects=scene.every_object))


def _read(words: list[str]) -> Scene:
    """The scene that words of options make; ElvisError or an error of usage where they make none."""
    setting = click.Option(["--set", "settings"], multiple=True, type=text_type("setting"))
    with SceneCommand("render", params=[setting]).make_context("render", list(words)) as context:
        options = dict(context.params)
    return composed((), options, options.pop("settings"))


def _completed(words: list[str], wanted: Scene) -> list[str] | None:
    """The words, and ``--set`` for all that they leave; None where they say something else."""
    try:
        found = _read(words)
    except (ElvisError, click.ClickException):
        return None
    if found.plane is not None and wanted.only_plane is not None and wanted.objects[0] == found.every_object[0]:
        wanted = replace(wanted, plane=found.plane, objects=())
    missing = _missing(table_of(wanted), table_of(found))
    if missing is None:
        return None
    settings_ = [word for key, value in missing for word in ("--set", f"{key}={toml_text(value)}")]
    return [*words, *settings_]


def _missing(wanted: Any, found: Any, place: str = "") -> list[tuple[str, Any]] | None:
    """Keys and values by which one table becomes another; None where that has keys too many."""
    if found == wanted:
        return []
    if isinstance(wanted, dict) and isinstance(found, dict) and wanted.get("kind") == found.get("kind"):
        if found.keys() - wanted.keys():
            return None
        dot = f"{place}." if place else ""
        parts = [_missing(value, found.get(key), f"{dot}{key}") for key, value in wanted.items()]
    elif isinstance(wanted, list) and isinstance(found, list) and len(wanted) == len(found) and _holds_tables(wanted):
        parts = [_missing(value, found[number], f"{place}[{number}]") for number, value in enumerate(wanted)]
    else:
        return [(place, wanted)]
    return None if None in parts else [pair for part in parts for pair in part or ()]


def _holds_tables(values: list[Any]) -> bool:
    return all(isinstance(value, dict) for value in values)


# options


def _plain_options(scene: Scene) -> Iterator[list[str]]:
    """The options of single keys that say what the scene has, or a part of it."""
    usual = {field.name: default_of(field) for field in fields(Scene)}
    bare = Scene(**{key: usual[key] for key in APART if key != "data"})
    for key, value in given_values(scene).items():
        setting = settings(Scene)[key]
        if key in APART or not (setting.option or key == "copies"):
            continue
        words = _copies(value) if key == "copies" else _words(setting, value)
        if _completed(words, replace(bare, **{key: value})) is not None:
            yield words


def _object_options(scene: Scene) -> Iterator[list[str]]:
    """Ways to say the objects: with the style of all, without styles, not at all."""
    kinds = [OBJECTS.index(item.kind) for item in scene.objects]
    if kinds == sorted(kinds):
        words = [word for item in scene.objects for word in _object_words(item)]
        yield [*words, *_style_words(scene)]
        yield words
    yield []


def _object_words(item: Any) -> list[str]:
    """The option that adds an object, without its style."""
    if item.kind == "cut" and item.surface.kind == "plane":
        return ["--plane", _plane(item.surface)]
    return [item.option.option, _OBJECTS[item.kind](item)]


def _style_words(scene: Scene) -> list[str]:
    """The options of the style that all objects have."""
    styles = [item.style for item in scene.objects if not isinstance(item, VolumeRendering)]
    words = []
    for key in STYLES:
        values = [getattr(style, key) for style in styles]
        if values and values[0] not in (getattr(Style(), key),) and values.count(values[0]) == len(values):
            words += _words(settings(Style)[key], values[0])
    return words


def _words(setting: Setting, value: Any) -> list[str]:
    """The words of an option with a value."""
    name = setting.option.split()[0]
    if isinstance(value, bool):
        positive, _, negative = name.partition("/")
        return [positive if value else negative]
    write = _WRITERS.get(setting.parse, str)
    if setting.repeatable and isinstance(value, tuple):
        return [word for each in value for word in (name, write(each))]
    # a table with nothing in it but defaults is a flag
    return [name] if is_dataclass(value) and not setting.parse else [name, write(value)]


def _copies(copies: Copies) -> list[str]:
    """The words of the options of copies."""
    return [word for key, value in given_values(copies).items() for word in _words(settings(Copies)[key], value)]


def _number(value: float) -> str:
    short = f"{value:g}"
    return short if float(short) == value else repr(value)


def _list(values: Any) -> str:
    return ",".join(map(_number, values))


def _plane(plane: Any) -> str:
    return f"{_list(plane.point)}:{_list(plane.normal)}"


def _surface(surface: Any) -> str:
    model: Any = type(surface)
    values = (getattr(surface, name) for name in settings(model))
    return ":".join([surface.kind, *map(_value, values)])


def _value(value: Any) -> str:
    if isinstance(value, tuple):
        return _list(value)
    return value if isinstance(value, str) else _number(value)


def _clip(clip: Any) -> str:
    return f"outside:{_surface(clip.surface)}" if clip.away == "outside" else _surface(clip.surface)


def _camera(camera: Any) -> str:
    if isinstance(camera, str):
        return camera
    parts = [camera.eye, camera.at, camera.up, *([] if camera.fov is None else [camera.fov])]
    return ":".join(map(_value, parts))


def _caption(caption: Any) -> str:
    shift = f"@{_list(caption.shift)}" if any(caption.shift) else ""
    return f"{_list(caption.at)}{shift}:{caption.text}"


def _light(light: Any) -> str:
    direction = "eye" if light.direction is None else _list(light.direction)
    return f"{direction}:{_number(light.intensity)}"


def _contours(contours: Any) -> str:
    # values without a decimal point would be a count
    values = ",".join(map(repr, map(float, contours.values)))
    how = {"even": not (values or contours.round), "labels": contours.labels}
    return ":".join([values or str(contours.count), *(word for word, is_given in how.items() if is_given)])


def _bar(bar: Any) -> str:
    given = given_values(bar)
    return ",".join(f"{key}={_list(v).replace(',', ' ') if key == 'ticks' else _value(v)}" for key, v in given.items())


def _quantity(item: Any, text: str) -> str:
    return text if item.quantity is None else f"{item.quantity}={text}"


def _volume(item: Any) -> str:
    pairs = zip(item.transfer.values, item.transfer.densities, strict=True)
    return _quantity(item, ",".join(f"{_number(value)}:{_number(density)}" for value, density in pairs))


def _from_places(item: Any, name: str) -> str:
    given = {key: value for key, value in given_values(item).items() if key not in (name, "style")}
    return ";".join([*getattr(item, name), *(f"{key}={_value(value)}" for key, value in given.items())])


_OBJECTS: dict[str, Callable[[Any], str]] = {
    "cut": lambda item: _surface(item.surface),
    "faces": lambda item: ",".join(item.select),
    "isosurface": lambda item: _quantity(item, _list(item.values)),
    "volume": _volume,
    "streamlines": lambda item: _from_places(item, "seeds"),
    "glyphs": lambda item: _from_places(item, "points"),
}
#: by the function of `parameters` that reads the text
_WRITERS: dict[str, Callable[[Any], str]] = {
    "clip": _clip,
    "camera": _camera,
    "caption": _caption,
    "light": _light,
    "contours": _contours,
    "bar": _bar,
    "background": _list,
    "color": _list,
    "deform": lambda deform: deform.displacement,
    "plane": _plane,
    "cutting_plane": _plane,
    "repeat": lambda repeat: f"{_value(repeat.step)}:{repeat.count}",
    "turn": lambda turn: f"{_list(turn.point)}:{_list(turn.axis)}:{turn.count}",
    "color_range": lambda ends: ends if isinstance(ends, str) else ":".join(map(_number, ends)),
    "region": lambda ends: "{}:{},{}:{}".format(*map(_number, ends)),
    "size": lambda sides: "{}x{}".format(*sides),
}
