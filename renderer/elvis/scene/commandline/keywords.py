"""Scenes from Python keywords named like options and keys of scene files: ``contours=10, plane=(p, n)``.

Names, checks and messages come from the models.  A value may be a model (``Plane(p, n)``), plain numbers and names
(``(p, n)``, ``10``, ``"turbo"``), or the text that the option accepts (``"0,0,0:0,0,1"``).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, get_args

import click
import numpy as np

from elvis.core.base.hints import nearest
from elvis.scene import (
    Camera,
    Caption,
    Clip,
    ColorBar,
    Contours,
    Copies,
    CutSurface,
    Deform,
    Faces,
    Glyphs,
    Isosurface,
    Lic,
    Light,
    MeshLines,
    Plane,
    Repeat,
    Scene,
    SceneObject,
    Streamlines,
    Surface,
    Turn,
)
from elvis.scene.commandline import parameters
from elvis.scene.commandline.composing import composed
from elvis.scene.commandline.options import PARTS, STYLES
from elvis.scene.commandline.other_programs import SAME, advice
from elvis.scene.model.errors import KeywordError, SceneError
from elvis.scene.model.settings import Setting, settings
from elvis.scene.model.style import Style
from elvis.scene.model.tables import scene_of, table_of

#: keys of a scene that say nothing of one picture in Python, and what to do instead
ELSEWHERE = {
    "stats": "numbers are in .stats of the picture",
    "data": "data come first, without a keyword",
    "scenes": "several scenes are drawn one by one",
    "panels": "several scenes are drawn one by one",
    "fields": 'reader={"fields": "u,p"} reads some of the fields',
}
_SURFACES = get_args(Surface)


@dataclass(frozen=True)
class Keyword:
    """Target of a keyword: a key of the scene or of its style, or a kind of object."""

    key: str
    setting: Setting


@cache
def keywords() -> dict[str, Keyword]:
    """All names that are known: keys of a scene and of its styles, kinds of objects, and the options of these."""
    found: dict[str, Keyword] = {}
    entries = [(key, setting) for key, setting in settings(Scene).items() if key not in ELSEWHERE]
    entries += [(key, settings(Style)[key]) for key in STYLES]
    entries += [(f"{key}_{name}", settings(model)[name]) for key, (model, names) in PARTS.items() for name in names]
    entries += [(cls.kind, cls.option) for cls in get_args(SceneObject)]
    for key, setting in entries:
        options = (option.partition("/")[0] for option in setting.option.split())
        for name in (key, *(option[2:].replace("-", "_") for option in options if option.startswith("--"))):
            found[name] = Keyword(key, setting)
    return found


def scene_of_keywords(given: Mapping[str, Any], base: Scene | None = None, files: Sequence[Path] = ()) -> Scene:
    """The scene of keywords, based on ``base`` or on the scene file among ``files``; the other files are its data.

    KeywordError with a similar name for an unknown keyword, SceneError for an invalid value.
    """
    options: dict[str, Any] = {}
    for name, value in given.items():
        keyword = _keyword(name)
        if keyword.key in options:
            raise KeywordError(f"{name}: given twice, under two names")
        if value is not None:
            options[keyword.key] = _meaning(name, keyword, value)
    base = base or Scene()
    objects = tuple(options.pop("objects", base.objects))
    planes = options.get("plane", ())
    if len(planes) == 1 and isinstance(planes[0], Plane):
        options.pop("plane")
        base = replace(base, plane=planes[0])
    scene = composed(tuple(files), options, (), base=replace(base, objects=objects))
    return scene_of(table_of(scene)) if given else scene


def _keyword(name: str) -> Keyword:
    """The target of a name; KeywordError for an unknown name."""
    known = keywords()
    own = name if name in known else SAME.get(name, name)
    if own in known:
        return known[own]
    if advice(name):
        raise KeywordError(f"unknown keyword {name!r}: {advice(name)}")
    if name in ELSEWHERE:
        raise KeywordError(f"unknown keyword {name!r}: {ELSEWHERE[name]}")
    near = nearest(name, known)
    told = f"did you mean {near}?" if near else f"there are {', '.join(sorted(known))}"
    raise KeywordError(f"unknown keyword {name!r}: {told}")


def _meaning(name: str, keyword: Keyword, value: Any) -> Any:
    """The value of an option: of repeatable ones a tuple."""
    form = FORMS.get(keyword.key, lambda plain: plain)
    try:
        if not keyword.setting.repeatable or keyword.key in ("reader", "others"):
            return _one(keyword.setting, form, value)
        several = value if _is_several(keyword.key, value) else [value]
        return tuple(_one(keyword.setting, form, each) for each in several)
    except click.BadParameter as error:
        raise SceneError(f"{name}: {error.message}") from error
    except SceneError as error:
        raise error if str(error).startswith(name) else SceneError(f"{name}: {error}") from error
    except (TypeError, ValueError, IndexError, AttributeError) as error:
        expected = keyword.setting.metavar or "another value"
        raise SceneError(f"{name}: expected {expected}, or its parts, found {value!r:.60}") from error


def _one(setting: Setting, form: Callable[[Any], Any], value: Any) -> Any:
    """A single value from a text of the command line or from plain values; instances of models remain unchanged."""
    if isinstance(value, str) and setting.parse:
        return getattr(parameters, setting.parse)(value)
    return form(value)


def _is_several(key: str, value: Any) -> bool:
    """Whether a value holds several of what may be repeated, rather than the parts of one."""
    if isinstance(value, str) or not isinstance(value, Sequence) or not len(value):
        return False
    if key in ("copies_repeat", "copies_turn"):
        return _depth(value) > 2 or all(isinstance(each, (str, Mapping)) or is_dataclass(each) for each in value)
    if key in ("plane", "copies_mirror"):
        return _depth(value) > 2 or all(isinstance(each, (str, Plane)) for each in value)
    if key == "faces":
        return all(isinstance(each, Faces) for each in value)
    if key == "lights":
        return all(isinstance(each, (str, Light)) or _depth(each) for each in value)
    return all(isinstance(each, (str, Path, Mapping)) or is_dataclass(each) for each in value)


def _depth(value: Any) -> int:
    """How deep lists lie in one another: 0 of a number."""
    if isinstance(value, np.ndarray):
        return value.ndim
    if isinstance(value, Sequence) and not isinstance(value, str):
        return 1 + max(map(_depth, value), default=0)
    return 1 if is_dataclass(value) else 0


def _floats(values: Any) -> tuple[float, ...]:
    return tuple(float(value) for value in np.ravel(values))


def _plane(value: Any) -> Plane:
    if isinstance(value, Plane):
        return value
    if isinstance(value, Mapping):
        ((axis, place),) = value.items()
        return parameters.plane(f"{axis}={place!r}")
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        raise SceneError(f"plane: expected an axis with the value, such as 'z={value:g}', found {value!r}")
    point, normal = map(_floats, value)
    if len(point) != 3 or len(normal) != 3:
        raise ValueError
    return Plane(point, normal)


def _camera(value: Any) -> Any:
    if isinstance(value, Camera):
        return value
    if isinstance(value, Mapping):
        return Camera(**value)
    eye, at, *rest = value
    return Camera(_floats(eye), _floats(at), *rest)  # type: ignore[arg-type]


def _contours(value: Any) -> Contours:
    if isinstance(value, Contours):
        return value
    if isinstance(value, Mapping):
        return Contours(**value)
    if isinstance(value, bool):
        raise TypeError
    value = value.item() if isinstance(value, np.integer) else value
    return Contours(count=value) if isinstance(value, int) else Contours(_floats(value))


def _mesh_lines(value: Any) -> Any:
    if isinstance(value, Mapping):
        return MeshLines(**value)
    if isinstance(value, bool):
        return MeshLines() if value else None
    if not isinstance(value, MeshLines):
        raise TypeError
    return value


def _lic(value: Any) -> Any:
    if isinstance(value, Mapping):
        return Lic(**value)
    if isinstance(value, bool):
        return Lic() if value else None
    return _of(Lic, value)


def _isosurface(value: Any) -> Isosurface:
    if isinstance(value, Mapping):
        ((quantity, values),) = value.items()
        return Isosurface(_floats(values), quantity)
    return value if isinstance(value, Isosurface) else Isosurface(_floats(value))


def _faces(value: Any) -> Faces:
    if isinstance(value, bool):
        raise TypeError
    return value if isinstance(value, Faces) else Faces(tuple(map(str, value)))


def _streamlines(value: Any) -> Streamlines:
    """The object itself, its settings by name, how many, or points (n, 3) that lines begin at."""
    found: Streamlines = _from_places(Streamlines, value)
    return found


def _glyphs(value: Any) -> Glyphs:
    """The same of points (n, 3) that they stand at."""
    found: Glyphs = _from_places(Glyphs, value)
    return found


def _from_places(cls: Any, value: Any) -> Any:
    if isinstance(value, (cls, Mapping)):
        return value if isinstance(value, cls) else cls(**value)
    if isinstance(value, int) and not isinstance(value, bool):
        return cls((str(value),))
    points = np.atleast_2d(np.asarray(value, np.float64))
    return cls(tuple(f"point:{','.join(map(repr, point))}" for point in points.tolist()))


def _cut(value: Any) -> CutSurface:
    return CutSurface(value) if isinstance(value, _SURFACES) else _of(CutSurface, value)


def _clip(value: Any) -> Clip:
    return Clip(value) if isinstance(value, _SURFACES) else _of(Clip, value)


def _light(value: Any) -> Light:
    return value if isinstance(value, Light) else Light(tuple(_floats(value)))  # type: ignore[arg-type]


def _caption(value: Any) -> Caption:
    """Itself, its settings by name, or a point and a text."""
    if isinstance(value, Mapping):
        return Caption(**value)
    if isinstance(value, Caption):
        return value
    at, text = value
    return Caption(text, _floats(at))  # type: ignore[arg-type]


def _row(kind: Any, value: Any) -> Any:
    """A repetition or a turn: itself, its settings by name, or a direction and a number."""
    if isinstance(value, Mapping):
        return kind(**value)
    if isinstance(value, kind):
        return value
    along, count = value
    return kind(along if isinstance(along, str) else _floats(along), count)


def _of(kind: type, value: Any) -> Any:
    if not isinstance(value, kind):
        raise TypeError
    return value


def _reader(value: Any) -> tuple[str, ...]:
    if isinstance(value, Mapping):
        return tuple(f"{name}={text}" for name, text in value.items())
    return (value,) if isinstance(value, str) else tuple(value)


def _others(value: Any) -> tuple[str, ...]:
    """``{"ref": ["b.xml", "b.fld"]}``, or texts NAME=FILE,FILE."""
    if not isinstance(value, Mapping):
        return _reader(value)
    files = {name: [own] if isinstance(own, (str, os.PathLike)) else own for name, own in value.items()}
    return tuple(f"{name}={','.join(map(str, own))}" for name, own in files.items())


#: plain values of keys that hold models, or lists of numbers in lists
FORMS: dict[str, Callable[[Any], Any]] = {
    "plane": _plane,
    "camera": _camera,
    "contours": _contours,
    "mesh_lines": _mesh_lines,
    "lic": _lic,
    "isosurface": _isosurface,
    "faces": _faces,
    "streamlines": _streamlines,
    "glyphs": _glyphs,
    "cut": _cut,
    "clip": _clip,
    "lights": _light,
    "texts": _caption,
    "bar": lambda value: ColorBar(**value) if isinstance(value, Mapping) else _of(ColorBar, value),
    "deform": lambda value: Deform(**value) if isinstance(value, Mapping) else _of(Deform, value),
    "copies": lambda value: Copies(**value) if isinstance(value, Mapping) else _of(Copies, value),
    "copies_mirror": _plane,
    "copies_repeat": lambda value: _row(Repeat, value),
    "copies_turn": lambda value: _row(Turn, value),
    "region": _floats,
    "reader": _reader,
    "others": _others,
    "outputs": str,
    "size": lambda value: (value, value) if isinstance(value, int) else tuple(int(side) for side in value),
    "color": _floats,
    "background": _floats,
    "range": lambda value: value if isinstance(value, str) else _floats(value),
}
