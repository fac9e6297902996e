"""Each setting of a scene is described once: options, checks, errors, schema and page are made of it."""

import json
import re
import runpy
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import get_args

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import settings as settings_of_hypothesis
from hypothesis import strategies as st

from elvis import Camera, Faces, Scene, SceneError, Sphere, Style
from elvis.core.streamlines.seed_forms import FORMS
from elvis.plugins.command.help_topics import GEOMETRY
from elvis.renderer.commands.render import render
from elvis.scene import scene_schema
from elvis.scene.commandline.options import scene_options
from elvis.scene.model.files import read_scene
from elvis.scene.model.settings import Model, settings
from elvis.scene.model.surfaces import Surface
from elvis.scene.model.tables import scene_of, table_of

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

REPOSITORY = Path(__file__).parents[2]


def models():
    """Every model of a scene."""
    return Model.__subclasses__()


@pytest.fixture(scope="module")
def page(made):
    """The reference page."""
    return made["page"]()


@pytest.fixture(scope="module")
def made():
    """What writes the pages."""
    return runpy.run_path(str(REPOSITORY / "tools" / "scene_page.py"))


def test_every_setting_is_described():
    assert len(models()) > 15
    for model in models():
        assert [field.name for field in fields(model) if field.name not in settings(model)] in ([], ["kind"])
        assert all(setting.help.endswith(".") for setting in settings(model).values())


def test_the_page_and_the_schema_match_the_models(made):
    """Else: make pages."""
    assert (REPOSITORY / "docs" / "scene.md").read_text(encoding="utf-8") == made["page"]()
    assert json.loads((REPOSITORY / "docs" / "scene.schema.json").read_text(encoding="utf-8")) == scene_schema()


def test_the_page_has_every_key_and_valid_links(made):
    text = made["page"]()
    for model in models():
        assert all(f"| `{name}` |" in text for name in settings(model))
    headings = {line.lstrip("# ").lower().replace(" ", "-") for line in text.splitlines() if line.startswith("#")}
    assert {part.split(")")[0] for part in text.split("](#")[1:]} <= headings


def test_the_scene_of_the_page_is_read(made, tmp_path):
    (tmp_path / "s.toml").write_text(made["page"]().split("```toml")[1].split("```")[0])
    assert len(read_scene(tmp_path / "s.toml").objects) == 4


def test_the_schema_has_names_bounds_and_descriptions():
    """Against JSON Schema's own words, not ours."""
    found = scene_schema()
    style = found["$defs"]["Style"]
    assert style["additionalProperties"] is False
    assert style["properties"]["opacity"].items() >= {"type": "number", "exclusiveMinimum": 0, "maximum": 1}.items()
    assert found["properties"]["samples"].items() >= {"type": "integer", "minimum": 1, "maximum": 16}.items()
    assert {"enum": ["visible", "all", "series"], "type": "string"} in found["properties"]["range"]["anyOf"][0]["oneOf"]
    assert found["properties"]["objects"]["items"]["required"] == ["kind"]
    for name, definition in found["$defs"].items():
        told = [part.get("description") for key, part in definition["properties"].items() if key != "kind"]
        assert all(told), name


def test_every_setting_with_an_option_is_in_the_help():
    text = " ".join(CliRunner().invoke(render, ["--help-all"]).output.split())
    for option in scene_options(()):
        assert " ".join(option.help.split()) in text
    assert "Isosurface(s) of quantity Q at value(s) V; Q defaults to --field." in text
    assert "Opacity of all objects. [a number above 0 and at most 1; default: 1]" in text


def test_the_short_help_fits_120_lines_and_names_every_option():
    text = CliRunner().invoke(render, ["--help"], terminal_width=80).output
    assert len(text.splitlines()) <= 120
    words = set(text.replace(",", " ").replace(":", " ").split())
    for option in scene_options(()):
        assert option.opts[0] in words or option.opts[-1] in words


def test_the_help_on_geometry_describes_every_surface_and_seed():
    for cls in get_args(Surface):
        assert f"\n  {cls.kind}:" in GEOMETRY
    for form in FORMS:
        assert re.search(rf"\b{form}\b", GEOMETRY.partition("Seeds")[2])
    assert all(len(line) <= 80 for line in GEOMETRY.splitlines())


@pytest.mark.parametrize("cls", models())
def test_a_bound_rejects_values_beyond_it(cls):
    for name, setting in settings(cls).items():
        beyond = [bound for bound in (setting.gt, setting.lt) if bound is not None]
        beyond += [setting.ge - 1] if setting.ge is not None else []
        beyond += [setting.le + 1] if setting.le is not None and setting.le < float("inf") else []
        for value in beyond:
            with pytest.raises(SceneError, match=f"^{name}: expected "):
                setting.check(value, name)


def test_a_value_out_of_bounds_is_an_error_of_its_model():
    for make in (lambda: Style(opacity=0.0), lambda: Style(opacity=float("nan")), lambda: Style(color=(0, 0, 1.5))):
        with pytest.raises(SceneError, match=r"^(opacity|color): expected "):
            make()
    with pytest.raises(SceneError, match=r"^radius of a sphere: expected a positive number, found -1"):
        Sphere((0, 0, 0), -1)


def test_models_are_plain_frozen_dataclasses():
    assert Sphere((0, 0, 0), 1.0) == Sphere((0, 0, 0), 1.0)
    assert hash(Style(opacity=0.5)) == hash(Style(opacity=0.5))
    assert all(is_dataclass(model) and model.__dataclass_params__.frozen for model in models())


def test_a_scene_prints_nondefault_values():
    scene = Scene("u", objects=(Faces(("wall",)),), camera=Camera((0, 0, 1), (0, 0, 0), fov=30.0))
    shown = "Scene(field='u', camera=Camera(eye=(0, 0, 1), at=(0, 0, 0), fov=30.0), objects=(Faces(select=('wall',)),))"
    assert repr(scene) == shown
    assert repr(Scene()) == "Scene()"


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("s.json", '{"objects": ' + "[" * 2000 + "]" * 2000 + "}", "nested"),
        ("s.toml", "samples = 0x" + "f" * 5000, "samples: expected a finite number, found one of 20000 bits"),
        ("s.yaml", "range: [0x" + "f" * 5000 + ", 1]", "range[0]: expected a finite number, found one of 20000 bits"),
        ("s.yaml", "data: !!set {a, b}", "data: expected a list, found a set"),
        ("s.toml", "range = {low = 1}", "range: expected a list of 2 or visible or all or series, found {'low': 1}"),
        ("s.toml", "camera = [1, 2]", "camera: expected a table or a text, found [1, 2]"),
        (
            "s.toml",
            "plane = {kind='sphere', point=[0,0,0], normal=[0,0,1]}",
            "plane.kind: expected plane, found 'sphere'",
        ),
        ("s.toml", "[[objects]]\nkind='cut'\nsurfce={}", "unknown key 'objects[0].surfce', did you mean surface?"),
    ],
)
def test_further_faults_are_also_named(tmp_path, name, content, sentence):
    (tmp_path / name).write_text(content)
    with pytest.raises(SceneError) as raised:
        read_scene(tmp_path / name)
    assert sentence in str(raised.value)
    assert "\n" not in str(raised.value)


plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3) | st.sampled_from(["cut", "sphere"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(["kind", "eye", "x", 1]), inner),
    max_leaves=6,
)


@given(data=st.data())
@settings_of_hypothesis(max_examples=150)
def test_every_table_is_a_scene_or_a_one_line_error(page, data):
    """The scene of the page with one value replaced by any other, wherever it stands."""
    table = tomllib.loads(page.split("```toml")[1].split("```")[0])
    node, place = table, []
    while isinstance(node, dict | list) and node and (not place or data.draw(st.booleans())):
        key = data.draw(st.sampled_from(sorted(node) if isinstance(node, dict) else range(len(node))))
        holder, node = node, node[key]
        place.append(key)
    holder[key] = data.draw(plain)
    try:
        scene, told = scene_of(table), ""
    except SceneError as error:
        scene, told = None, str(error)
    assert "\n" not in told
    if scene is None:
        assert str(place[0]) in told or "unknown view" in told
    else:
        assert scene_of(table_of(scene)) == scene
