"""Writes renderer/elvis/scene/render_keywords.py, the types of the keywords of `render` and `view`."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from elvis.scene import Deform, Scene
from elvis.scene.commandline.keywords import FORMS, Keyword, keywords
from elvis.scene.commandline.other_programs import SAME
from elvis.scene.model.style import Style

OUTPUT = Path(__file__).parents[1] / "renderer" / "elvis" / "scene" / "render_keywords.py"
#: types of keywords that take models or their parts, by key
_MODELS = {
    "plane": "Plane | Mapping[str, float] | ArrayLike | Sequence[Plane | str]",
    "camera": "Camera | str | Mapping[str, Any] | ArrayLike",
    "contours": "Contours | Mapping[str, Any] | ArrayLike",
    "mesh_lines": "MeshLines | Mapping[str, Any] | bool",
    "lic": "Lic | Mapping[str, Any] | bool",
    "isosurface": "Isosurface | Mapping[str, Any] | ArrayLike | Sequence[Isosurface | str]",
    "faces": "Faces | str | Sequence[Faces | str]",
    "volume": "VolumeRendering | str | Sequence[VolumeRendering | str]",
    "streamlines": "Streamlines | str | Mapping[str, Any] | ArrayLike | Sequence[Streamlines | str]",
    "glyphs": "Glyphs | str | Mapping[str, Any] | ArrayLike | Sequence[Glyphs | str]",
    "cut": "CutSurface | Surface | str | Sequence[CutSurface | Surface | str]",
    "clip": "Clip | Surface | str | Sequence[Clip | Surface | str]",
    "lights": "Light | str | ArrayLike | Sequence[Light | str]",
    "bar": "ColorBar | str | Mapping[str, Any]",
    "deform": "Deform | str | Mapping[str, Any]",
    "copies": "Copies | Mapping[str, Any]",
    "copies_mirror": "Plane | str | Mapping[str, float] | ArrayLike | Sequence[Plane | str]",
    "copies_turn": "Turn | str | Sequence[Any]",
    "copies_repeat": "Repeat | str | Sequence[Any]",
    "reader": "str | Mapping[str, Any] | Sequence[str]",
    "others": "str | Mapping[str, Any] | Sequence[str]",
    "outputs": "str | Path | Sequence[str | Path]",
    "range": "str | ArrayLike",
    "objects": "Sequence[SceneObject]",
    "reference": "Reference | Mapping[str, float]",
    "memory": "float | str",
    "complex": "str | Sequence[str]",
}
#: keywords that are parameters of their own in each function
_OWN = {"RenderKeywords": ("device", "scene", "progress"), "ViewKeywords": ("height", "scene")}
_HEAD = '''"""Types of the keywords of `elvis.render` and `elvis.view`, for editors and type checkers.

Made by tools/keyword_types.py from the models of scenes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypedDict

from numpy.typing import ArrayLike

from elvis.scene.model.convolution import Lic
from elvis.scene.model.copies import Copies, Repeat, Turn
from elvis.scene.model.objects import (
    CutSurface,
    Faces,
    Glyphs,
    Isosurface,
    SceneObject,
    Streamlines,
    VolumeRendering,
)
from elvis.scene.model.style import ColorBar, Contours, MeshLines
from elvis.scene.model.surfaces import Plane, Surface
from elvis.scene.model.whole import Camera, Clip, Deform, Light, Reference
'''


def text_of_module() -> str:
    """The module, formatted."""
    known = {**keywords(), **{name: keywords()[own] for name, own in SAME.items()}}
    own = {name for names in _OWN.values() for name in names}
    classes = [_class("SharedKeywords", "TypedDict", {name: each for name, each in known.items() if name not in own})]
    for title, excluded in _OWN.items():
        rest = {name: each for name, each in known.items() if name in own and name not in excluded}
        classes.append(_class(title, "SharedKeywords", rest))
    text = "\n\n".join([_HEAD, *classes])
    command = [sys.executable, "-m", "ruff", "format", "--quiet", "--stdin-filename", str(OUTPUT), "-"]
    return subprocess.run(command, input=text, capture_output=True, text=True, check=True, cwd=OUTPUT.parents[3]).stdout


def _class(title: str, base: str, known: dict[str, Keyword]) -> str:
    """A class of typed keys, each with its help."""
    meaning = {
        "SharedKeywords": "Keywords of both functions, all optional.",
        "RenderKeywords": "Keywords of `elvis.render`.",
        "ViewKeywords": "Keywords of `elvis.view`.",
    }
    lines = [f"class {title}({base}, total=False):", f'    """{meaning[title]}"""', ""]
    for name, keyword in known.items():
        help_text = (keyword.setting.option_help or keyword.setting.help).split("  ")[0]
        lines += [f"    {name}: {_type(keyword.key)} | None", *_docstring(help_text)]
    return "\n".join(lines)


def _docstring(text: str) -> list[str]:
    """The help below a key, in lines of 120 characters."""
    wrapped = textwrap.wrap(text, 110)
    if len(wrapped) == 1:
        return [f'    """{wrapped[0]}"""']
    return [f'    """{wrapped[0]}', *(f"    {line}" for line in wrapped[1:-1]), f'    {wrapped[-1]}"""']


def _type(key: str) -> str:
    """The type of a keyword's value."""
    if key in _MODELS:
        return _MODELS[key]
    return "ArrayLike" if key in FORMS else _words(_annotation(key))


def _annotation(key: str) -> Any:
    """The annotation of a key of a scene, its style or its deformation."""
    for owner, prefix in ((Scene, ""), (Style, ""), (Deform, "deform_")):
        hints = get_type_hints(owner)
        name = key.removeprefix(prefix)
        if key.startswith(prefix) and name in {own.name for own in fields(owner)}:
            return hints[name]
    raise KeyError(key)


def _plain(kind: Any) -> Any:
    """A type without None."""
    parts = [own for own in get_args(kind) if own is not type(None)]
    return parts[0] if type(None) in get_args(kind) and len(parts) == 1 else kind


def _words(kind: Any) -> str:
    """A plain type as text."""
    kind = _plain(kind)
    if get_origin(kind) is Annotated:
        return _words(get_args(kind)[0])
    if get_origin(kind) is Literal:
        return f"Literal[{', '.join(map(repr, get_args(kind)))}]"
    return str(kind.__name__)


if __name__ == "__main__":
    OUTPUT.write_text(text_of_module())
    print(OUTPUT)
