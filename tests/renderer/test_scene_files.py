"""Scene files: equal to the Python object, in three languages; what is wrong is named by its key."""

from dataclasses import fields, is_dataclass
from itertools import pairwise
from pathlib import Path
from typing import get_args, get_type_hints

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elvis import (
    Camera,
    Clip,
    Cone,
    Contours,
    CutSurface,
    Cylinder,
    Faces,
    Implicit,
    Isosurface,
    Light,
    MeshLines,
    Plane,
    Scene,
    SceneError,
    Sphere,
    Style,
    Transfer,
    TriangleMesh,
    VolumeRendering,
)
from elvis.core.base.errors import FormatError
from elvis.scene.model.files import SUFFIXES, read_scene, write_scene
from elvis.scene.model.tables import KINDS, scene_of, table_of

number = st.floats(-1e300, 1e300)
positive = st.floats(1e-300, 1e300)
part = st.floats(0.0, 1.0)
vector = st.tuples(number, number, number)
direction = st.tuples(st.floats(0.1, 9.0), number.filter(lambda x: abs(x) < 1e100), part)
color = st.tuples(part, part, part)
text = st.text(st.characters(codec="utf-8", exclude_categories=("Cs", "Cc")), min_size=1, max_size=8)
file = st.from_regex(r"[a-z]{1,5}/[a-z]{1,5}\.stl", fullmatch=True)
ends = st.tuples(number, number).filter(lambda pair: pair[0] < pair[1])
surfaces = st.one_of(
    st.builds(Plane, vector, direction),
    st.builds(Sphere, vector, positive),
    st.builds(Cylinder, vector, direction, positive),
    st.builds(Cone, vector, direction, st.floats(1.0, 89.0)),
    st.builds(Implicit, text),
    st.builds(TriangleMesh, file),
)
contours = st.builds(Contours, values=st.lists(number, min_size=1, max_size=3).map(tuple), quantity=st.none() | text)
styles = st.builds(
    Style,
    quantity=st.none() | text,
    color=st.none() | color,
    range=st.none() | ends,
    opacity=st.floats(0.01, 1.0),
    lit=st.none() | st.booleans(),
    contours=st.none() | contours | st.just(Contours(count=7)),
    mesh_lines=st.none() | st.builds(MeshLines, positive, color),
)
transfers = st.just(Transfer((0.0, 0.5, 1e9), (0.0, 1.0, 2.0), ((0.0, 0.5, 1.0),) * 3))
objects = st.one_of(
    st.builds(CutSurface, surfaces, styles),
    st.builds(Faces, st.lists(text, min_size=1, max_size=3).map(tuple), styles),
    st.builds(Isosurface, st.tuples(number), st.none() | text, styles),
    st.builds(VolumeRendering, transfers, st.none() | text, positive),
)
cameras = st.sampled_from(["fit", "+x", "iso"]) | st.builds(Camera, vector, vector, direction, st.none(), positive)
scenes = st.builds(
    Scene,
    field=text,
    plane=st.none() | st.builds(Plane, vector, direction),
    camera=cameras,
    size=st.none() | st.tuples(st.integers(1, 32768), st.integers(1, 32768)),
    range=st.sampled_from([None, "visible", "all", "series"]) | ends,
    objects=st.lists(objects, max_size=4).map(tuple),
    samples=st.integers(1, 16),
    lights=st.lists(st.builds(Light, st.none() | direction, part), max_size=2).map(tuple),
    clip=st.lists(st.builds(Clip, surfaces, st.sampled_from(["inside", "outside"])), max_size=2).map(tuple),
    title=st.none() | text,
    data=st.lists(file, max_size=2).map(tuple),
    plain=st.booleans(),
)


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(scene=scenes)
@settings(max_examples=20)
def test_a_scene_file_is_the_python_object(monkeypatch_here, suffix, scene):
    write_scene(scene, f"scene{suffix}")
    assert read_scene(f"scene{suffix}") == scene


@pytest.fixture(scope="module")
def monkeypatch_here(tmp_path_factory):
    """An empty working folder, where relative names stay what they are."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("scenes"))
        yield patch


@given(scene=scenes)
@settings(max_examples=60)
def test_tables_and_scenes_are_the_same(scene):
    assert scene_of(table_of(scene)) == scene


def test_every_class_of_a_scene_can_be_written():
    """Guard: alternatives that a file must tell apart have a name."""
    for cls in (Scene, *KINDS):
        for hint in get_type_hints(cls).values():
            choices = [choice for choice in get_args(hint) if is_dataclass(choice)]
            assert len(choices) < 2 or all(choice in KINDS for choice in choices)
    assert {field.name for field in fields(Scene)} >= {"objects", "clip", "lights", "data"}


def test_names_of_files_are_relative_to_the_scene(tmp_path, monkeypatch):
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "s.toml").write_text('data = ["../a.xml", "/b.fld"]\nobjects = []\nstats = "c.json"\n')
    scene = read_scene(tmp_path / "deep" / "s.toml")
    assert scene.data == (str(tmp_path / "a.xml"), "/b.fld")
    assert scene.stats == str(tmp_path / "deep" / "c.json")
    write_scene(scene, tmp_path / "t.json")
    assert '"a.xml"' in (tmp_path / "t.json").read_text()
    assert read_scene(tmp_path / "t.json") == scene
    monkeypatch.chdir(tmp_path / "deep")
    assert read_scene("s.toml").data == ("../a.xml", "/b.fld")


CUT = 'objects = [{{kind = "cut", surface = {}}}]'


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("palete = 'x'", "unknown key 'palete', did you mean palette?"),
        (
            "[[objects]]\nkind='faces'\nstyle={colour=[0,0,0]}",
            "unknown key 'objects[0].style.colour', did you mean color",
        ),
        ("wombat = 1", "unknown key 'wombat': expected field, plane, camera"),
        ("size = [1]", "size: expected a list of 2, found 1"),
        ("size = [1, 2.5]", "size[1]: expected a whole number, found 2.5"),
        ("size = [0, 5]", "the size of a picture is 1 to 32768 pixels a side"),
        ("samples = 0", "samples: expected 1 to 16, found 0"),
        ("samples = true", "samples: expected a whole number, found True"),
        ("plain = 1", "plain: expected true or false, found 1"),
        ("range = 'al'", "range: expected visible or all or series, found 'al'"),
        ("range = [2, 1]", "range: expected a colour range from a smaller to a greater value, found 2 to 1"),
        ("camera = 'aslant'", "unknown view 'aslant'"),
        ("camera = {eye = [0, 0, inf], at = [0, 0, 0]}", "camera.eye[2]: expected a finite number, found inf"),
        ("camera = {eye = [0, 0, 1]}", "camera: expected the key 'at', found none"),
        ("camera = {eye = [0, 0, 1], at = [0, 0, 0], fov = 180}", "camera: fov: expected degrees between 0 and 180"),
        ("background = [0, 0, 2]", "background: expected red, green, blue and opacity from 0 to 1"),
        ("lights = [{intensity = -1}]", "lights[0]: intensity of a light: expected 0 or more, found -1"),
        ("objects = 3", "objects: expected a list of at most 10000, found 3"),
        ("objects = [3]", "objects[0]: expected a table, found 3"),
        (
            "objects = [{kind = 'cutt'}]",
            "objects[0].kind: expected cut, faces, isosurface, volume, streamlines, glyphs, found 'cutt'",
        ),
        (
            "objects = [{surface = 1}]",
            "objects[0].kind: expected cut, faces, isosurface, volume, streamlines, glyphs, found None",
        ),
        ("objects = [{kind = 'cut'}]", "objects[0]: expected the key 'surface', found none"),
        (
            CUT.format("{kind='sphere',center=[0,0,0],radius=0}"),
            "objects[0].surface: radius of a sphere: expected a pos",
        ),
        (CUT.format("{kind='cone',apex=[0,0,0],axis=[0,0,1],angle=90}"), "angle of a cone: expected degrees between 0"),
        (CUT.format("{kind='cylinder',point=[0,0,0],axis=[0,0,0],radius=1}"), "the axis of the cylinder must be"),
        (CUT.format("{kind='mesh',file=''}"), "objects[0].surface.file: expected a file name, found ''"),
        ("objects = [{kind='faces', style={opacity=0}}]", "objects[0].style: opacity: expected a number above 0"),
        (
            "objects = [{kind='faces', style={contours={}}}]",
            "objects[0].style.contours: contours: expected values or a",
        ),
        ("objects = [{kind='faces', select=[]}]", "objects[0]: select of faces"),
        ("objects = [{kind='isosurface', values=[]}]", "objects[0]: values of an isosurface"),
        (
            "objects = [{kind='volume', transfer={values=[1,0], densities=[1,1]}}]",
            "ascending finite numbers, found (1.0",
        ),
        ("objects = [{kind='volume', transfer={values=[0], densities=[]}}]", "a finite number of 0 or more for each"),
        (
            "clip = [{surface={kind='plane',point=[0,0,0],normal=[0,0,1]},away='left'}]",
            "clip[0].away: expected inside or",
        ),
        ("field", "cannot be read as TOML: "),
        ("x = " + "[" * 3000, "cannot be read as TOML: "),
    ],
)
def test_faults_are_named(tmp_path, content, sentence):
    path = tmp_path / "s.toml"
    path.write_text(content)
    with pytest.raises(SceneError) as raised:
        read_scene(path)
    assert str(raised.value).startswith(f"{path}: ")
    assert sentence in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("s.json", b"[1, 2]"),
        ("s.json", b"{"),
        ("s.json", b'{"size": ' + b"9" * 5000 + b"}"),
        ("s.json", b'{"ambient": 1' + b"0" * 400 + b"}"),
        ("s.json", b"[" * 100_000),
        ("s.yaml", b"- 1"),
        ("s.yaml", b"a: [1"),
        ("s.yaml", b"field: !!python/object/apply:os.getcwd []"),
        ("s.yaml", b"a: &a [1]\nb: &b [*a,*a]\nfield: *b"),
        ("s.yaml", b""),
        ("s.toml", b"\xff\xfe"),
        ("s.toml", b"#" * (1 << 20) + b"#"),
        ("s.json", b'{"data": [' + b'"a",' * 10_000 + b'"a"]}'),
    ],
)
def test_files_without_a_scene(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SceneError, match=r"s\.(json|yaml|toml): "):
        read_scene(tmp_path / name)


def test_aliases_of_yaml_are_rejected_at_once(tmp_path):
    lines = ['a: &a ["lol"]', *(f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]" for a, b in pairwise("abcdefghijklmn"))]
    (tmp_path / "laugh.yaml").write_text("\n".join([*lines, "background: *n"]))
    with pytest.raises(
        SceneError, match=r"laugh\.yaml: cannot be read as YAML: expected no aliases, found \*a in line 2"
    ):
        read_scene(tmp_path / "laugh.yaml")


def test_a_missing_file_and_an_unknown_format(tmp_path):
    with pytest.raises(FormatError, match=r"none\.toml: there is no such file"):
        read_scene(tmp_path / "none.toml")
    with pytest.raises(SceneError, match=r"expected a scene's name that ends in \.toml"):
        write_scene(Scene("u"), tmp_path / "s.ini")


def test_yaml_reads_common_number_formats(tmp_path):
    (tmp_path / "s.yaml").write_text("ambient: 1e-3\nrange: [-1e5, 2.5E+3]\n")
    scene = read_scene(tmp_path / "s.yaml")
    assert (scene.ambient, scene.range) == (1e-3, (-1e5, 2500.0))


def test_scenes_of_the_examples_are_read():
    files = sorted((Path(__file__).parents[2] / "examples" / "scenes").glob("*.toml"))
    assert len(files) > 3
    for path in files:
        assert read_scene(path).every_object
