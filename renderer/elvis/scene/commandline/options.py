"""The options that say what a scene holds, for every command that draws, made of the settings of the models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import is_dataclass
from functools import partial
from typing import Any, get_args

import click

from elvis.core.data.arguments import with_fields
from elvis.scene.commandline.command import FIGURE, text_type
from elvis.scene.model.copies import Copies
from elvis.scene.model.objects import SceneObject, Streamlines
from elvis.scene.model.settings import Setting, choices, settings, text_of, types
from elvis.scene.model.style import Style
from elvis.scene.model.whole import Deform, Scene

#: keys of a scene whose options stand before all others in the help
FIRST = ("field", "plugin", "reader", "others", "plane", "objects")
#: options of the style of every object, by the key of Style
STYLES = tuple(name for name, setting in settings(Style).items() if setting.option)
#: options that add objects, by the key ``kind``
OBJECTS = tuple(cls.kind for cls in get_args(SceneObject))

#: options of a deformed geometry, in addition to its displacement, by the key of Deform
DEFORM = tuple(name for name, setting in settings(Deform).items() if setting.option)
#: options of copies, by the key of Copies
COPIES = tuple(settings(Copies))
#: options of tables in a scene that have several, by the key of the scene
PARTS = {"deform": (Deform, DEFORM), "copies": (Copies, COPIES)}

#: what streamlines follow, as pictures and `elvis trace` have it
COURSE = ("seeds", "random", "velocity", "direction", "length", "duration", "speed", "steps", "tolerance", "wall")

#: keys of the options that the short help explains; it only names the others
COMMON = {
    *("field", "others", "step", "time", "device"),
    *("plane", *OBJECTS, "clip"),
    *("palette", "range", "contours", "mesh_lines", "opacity", "bar"),
    *("camera", "size", "samples"),
    *("title", "axes", "plain", "outputs"),
}

#: chapters of the help, and what stands in each by its key; all else stands in the last
CHAPTERS = {
    "Data": (
        "field",
        "plugin",
        "reader",
        "fields",
        "others",
        "step",
        "time",
        "between",
        "deform",
        *(f"{key}_{name}" for key, (_, names) in PARTS.items() for name in names),
        "complex",
        "phase",
        "device",
        "memory",
    ),
    "Objects": ("plane", *OBJECTS, "clip"),
    "Colours and lines": ("palette", "range", "bar", *STYLES, "background", "lights", "ambient"),
    "Camera": ("camera", "region", "zoom", "size", "samples"),
    "Figure": (*FIGURE, "plain"),
    "Output": (),
}


def chapter_of(key: str) -> str:
    """The chapter of the help in which an option stands."""
    return next((title for title, keys in CHAPTERS.items() if key in keys), "Output")


def scene_options(leaving: Sequence[str]) -> list[click.Option]:
    """The options of a scene in the order of the help, except for the keys in ``leaving``."""
    found = []
    others = [key for key in settings(Scene) if key not in FIRST]
    for key in (*FIRST, *others):
        if key == "objects":
            found += [_option(cls.kind, cls.option, str) for cls in get_args(SceneObject)]
            found += [_option(name, settings(Style)[name], types(Style)[name]) for name in STYLES]
        elif settings(Scene)[key].option and key not in leaving:
            found.append(_option(key, settings(Scene)[key], types(Scene)[key]))
        if key in PARTS and key not in leaving:
            model, names = PARTS[key]
            parts = [name for name in names if f"{key}_{name}" not in leaving]
            found += [_option(f"{key}_{name}", settings(model)[name], types(model)[name]) for name in parts]
    return found


def course_options() -> list[click.Parameter]:
    """The options of `COURSE`, by the same names."""
    found: list[click.Parameter] = []
    for name in COURSE:
        found.append(_option(name, settings(Streamlines)[name], types(Streamlines)[name]))
    return found


def _option(name: str, setting: Setting, hint: Any) -> click.Option:
    """The option of a setting, by the type of its place; without it the value is None, or nothing where it repeats."""
    only: Any = choices(hint)[0]
    text = text_of(hint)
    is_file = text is not None and text.kind == "file"
    rest: dict[str, Any] = {"help": setting.option_words, "metavar": setting.metavar, "multiple": setting.repeatable}
    if name == "reader":
        rest["callback"] = with_fields
    if setting.names or name == "palette":
        rest["shell_complete"] = partial(_completions, setting.names)
    if setting.parse:
        rest["type"] = text_type(setting.parse)
    elif only is bool:
        rest |= {"is_flag": True, "default": None}
    elif is_dataclass(only):
        default_table: Any = only
        rest |= {"flag_value": default_table(), "default": None, "type": click.UNPROCESSED}
    elif is_file:
        rest["type"] = click.Path(dir_okay=False)
    else:
        rest["type"] = only if only in (int, float) else str
    return click.Option([*(setting.option or f"--{name}").split(), name], **rest)


def _completions(names: tuple[str, ...], context: Any, parameter: Any, incomplete: str) -> list[str]:
    """Completions that a shell offers for the beginning of a name of a setting, or of a colour map."""
    if not names:
        import cmap

        names = tuple(sorted(cmap.Colormap.catalog().short_keys()))
    return [name for name in names if name.startswith(incomplete)]
