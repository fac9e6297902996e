"""Writes docs/scene.md and docs/scene.schema.json from the models of `elvis.scene`; `make pages` runs it."""

from __future__ import annotations

import json
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, get_args

from elvis.scene import scene_schema
from elvis.scene.model.convolution import Lic
from elvis.scene.model.copies import Copies, Repeat, Turn
from elvis.scene.model.objects import SceneObject, Transfer
from elvis.scene.model.settings import Setting, choices, default_of, is_free, settings, type_words, types
from elvis.scene.model.style import ColorBar, Contours, MeshLines, Style
from elvis.scene.model.surfaces import Surface
from elvis.scene.model.whole import Camera, Caption, Clip, Deform, Light, Reference, Scene

DOCS = Path(__file__).parents[1] / "docs"
#: titles of the page, and the models under each
CHAPTERS = {
    "Scene": (Scene,),
    "Camera": (Camera,),
    "Objects": get_args(SceneObject),
    "Styles": (Style, ColorBar, Contours, MeshLines, Lic),
    "Transfer": (Transfer,),
    "Surfaces": get_args(Surface),
    "Lights, clips and texts": (Light, Clip, Caption),
    "Reference": (Reference,),
    "Deform": (Deform,),
    "Copies": (Copies, Repeat, Turn),
}
HEAD = """<!-- made by tools/scene_page.py from the models in renderer/elvis/scene -->

# Scene files

A scene file describes the objects and the appearance of a picture, in TOML, YAML or JSON. Use it as
in `elvis render wing.toml` or `elvis compare wing.toml`. The option `--save-scene` writes the scene
of a picture to a file. The dataclasses in Python (`elvis.scene`) have settings of the same names.

Many keys also have an option on the command line; the last column of the tables names it. Options
override the file. For any other key, use `--set`, as in `--set objects[0].style.opacity=0.5`.

File names are relative to the scene file. Unknown keys and invalid values are errors. The message
names the key, its place, the expected value and the value found.

Editors that support JSON schemas complete and check scenes with
[scene.schema.json](scene.schema.json); in Python, `elvis.scene.scene_schema()` returns the schema.
Write `#:schema scene.schema.json` in the first line of a TOML file, or
`# yaml-language-server: $schema=scene.schema.json` in the first line of a YAML file.

```toml
data = ["wing.xml", "wing.fld"]
field = "p"
camera = "iso"                              # or {eye = [3, -4, 2], at = [0, 0, 0], fov = 30}
size = [1200, 900]
samples = 2
range = "all"                               # or [-1, 1]
outputs = ["wing.png"]

[[lights]]
direction = [1, -1, 2]
intensity = 0.7

[[objects]]
kind = "faces"
select = ["wall"]
style = {mesh_lines = {width = 1}, contours = {count = 10}, opacity = 0.8, lit = true}

[[objects]]
kind = "cut"
surface = {kind = "sphere", center = [0, 0, 0], radius = 1}
style = {quantity = "sqrt(u^2+v^2+w^2)", palette = "elvis:diverging", range = [0, 2]}

[[objects]]
kind = "isosurface"
quantity = "q_criterion"
values = [0.5, 1.0]

[[objects]]
kind = "volume"
transfer = {values = [0, 0.5, 1], densities = [0, 2, 8]}

[[clip]]
surface = {kind = "plane", point = [0, 0, 0], normal = [0, 1, 0]}
away = "inside"
```

A scene file may come from an untrusted source, so its rights are limited:

- It reads data, triangles and colour maps, and names only installed plugins.
- It writes only `outputs` (`.png`, `.html`, `.npz` and others) and `stats` (`.json`), next to the
  scene file or in folders below it. Links do not extend this limit.
- An existing file that ElVis did not write is replaced only with `--overwrite`.

The options `--plugin`, `--output` and `--stats` have no such limits and override the scene.
`--save-scene` omits settings that a scene file may not contain, and prints a warning.

Lists are written as `[…]`, tables as `{key = value}` or under a heading. A default in *italics* is
a description, not a value: to get this default, leave the key out.
"""


def page() -> str:
    """The reference page."""
    parts = [HEAD]
    for title, models in CHAPTERS.items():
        parts.append(f"## {title}\n")
        parts += [_model(model, len(models) > 1) for model in models]
    return "\n".join(parts)


def schema_text() -> str:
    """The JSON schema of scene files."""
    return json.dumps(scene_schema(), indent=1, ensure_ascii=False, sort_keys=True) + "\n"


def _model(model: Any, is_one_of_many: bool) -> str:
    """Title, sentence and settings of a model."""
    lines = [f"### {_title(model)}\n"] if is_one_of_many else []
    lines += [f"{_sentence(model)}\n", "| key | value | default | meaning | option |", "|---|---|---|---|---|"]
    if hasattr(model, "kind"):
        lines.append(f"| `kind` | `{model.kind}` | must be given | Kind of the model. | {_option(model)} |")
    for field in fields(model):
        setting = settings(model).get(field.name)
        if setting:
            lines.append(_row(field.name, setting, types(model)[field.name], default_of(field)))
    return "\n".join(lines) + "\n"


def _row(name: str, setting: Setting, hint: Any, default: Any) -> str:
    """A line of the table of a model."""
    value, allowed = _value(hint), setting.values_text
    if allowed.startswith("a "):
        value = value.replace("number", allowed.removeprefix("a "))
    elif allowed not in ("", "finite numbers"):
        value += f", {allowed}"
    return f"| `{name}` | {value} | {_default(setting, default)} | {setting.help} | {_names(setting)} |"


def _option(model: Any) -> str:
    """The option that adds an object."""
    return _names(model.option) if hasattr(model, "option") else ""


def _names(setting: Setting) -> str:
    return ", ".join(f"`{name}`" for name in setting.option.split())


def _default(setting: Setting, default: Any) -> str:
    """What holds where the key is left out."""
    if default is MISSING:
        return "must be given"
    if is_dataclass(default):
        return "*all its defaults*"
    if default is None or default in ("", ()) or (setting.default and isinstance(default, tuple)):
        return f"*{setting.default or 'none'}*"
    return f"`{json.dumps(default)}`"


def _value(hint: Any) -> str:
    """What stands in the place of a type."""
    own = choices(hint)
    if len(own) > 1 or is_dataclass(own[0]):
        return " or ".join(
            f"[{_title(each)}](#{_anchor(each)})" if is_dataclass(each) else _value(each) for each in own
        )
    if is_free(own[0]):
        return f"list of: {_value(get_args(own[0])[0])}"
    if own[0] is not hint and not is_text(hint):
        return _value(own[0])
    return type_words(hint).removeprefix("a ").replace("finite number", "number")


def is_text(hint: Any) -> bool:
    """Whether it is a text, whose words say what it names."""
    return choices(hint)[0] is str


def _title(model: Any) -> str:
    return getattr(model, "kind", model.__name__)


def _anchor(model: Any) -> str:
    return _title(model).lower()


def _sentence(model: Any) -> str:
    return " ".join((model.__doc__ or "").split())


if __name__ == "__main__":
    (DOCS / "scene.md").write_text(page(), encoding="utf-8")
    (DOCS / "scene.schema.json").write_text(schema_text(), encoding="utf-8")
