"""Scenes as the words of a command, and as lines of Python."""

import pytest

from elvis.scene import (
    Camera,
    Clip,
    ColorBar,
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
    VolumeRendering,
)
from elvis.scene.commandline.writing import _normal, _read, command_of, option_words, python_of

PLANE = Plane((0.5, -0.5, 1 / 3), (0.1, 0.2, 1.0))
VOLUME = VolumeRendering(Transfer((0.0, 1e-20), (0.0, 2.0)), "v")
BAR = {"scale": "log", "ticks": (1.0, 2.5), "bands": 4}
OBJECTS = (CutSurface(Sphere((0.0, 0.0, 1.0), 0.5)), Faces(("all", "wall 2")), Isosurface((3.0, 4.0), "w"), VOLUME)

#: scenes, and words of which the command consists besides those of others
SCENES = {
    "a plane": (Scene("u", plane=PLANE, size=(20, 10)), ["--plane", "0.5,-0.5,0.3333333333333333:0.1,0.2,1"]),
    "another style": (Scene(objects=(CutSurface(PLANE, Style(palette="magma")),)), ["--set"]),
    "one style": (
        Scene(objects=(Faces(style=Style(mesh_lines=MeshLines(), lit=False, opacity=0.5)), VOLUME)),
        ["--mesh-lines", "--unlit", "--opacity", "0.5"],
    ),
    "lines": (
        Scene(objects=(Faces(style=Style(contours=Contours((3.0,), labels=True))),)),
        ["--contours", "3.0:labels"],
    ),
    "all kinds": (Scene(plane=PLANE, objects=OBJECTS), ["--isosurface", "w=3,4", "--volume", "v=0:0,1e-20:2"]),
    "another order": (Scene(objects=(Isosurface((1.0,)), Faces())), ["--set"]),
    "single styles": (
        Scene(objects=(Faces(), Isosurface((1.0,), style=Style(color=(1.0, 0.0, 0.0))))),
        ["--set", "objects[1].style={color = [1.0, 0.0, 0.0]}"],
    ),
    "a camera": (Scene(camera=Camera((1.0, 2.0, 3.0), (0.0, 0.0, 0.1), height=2.0)), ["--set", "camera.height=2.0"]),
    "a perspective": (Scene(camera=Camera((-1.0, 2.0, 3.0), (0.0, 0.0, 0.0), fov=30.0)), ["-1,2,3:0,0,0:0,0,1:30"]),
    "colours": (Scene(range=(-1.0, 1e300), bar=ColorBar(**BAR), palette="x y"), ["scale=log,bands=4,ticks=1 2.5"]),
    "a hard title": (Scene(bar=ColorBar(title="a, b=c", unit="é'\""), title=""), ["--set", "--title", ""]),
    "lights": (Scene(lights=(Light((1.0, 0.0, 0.0)), Light(intensity=0.1))), ["--light", "eye:0.1"]),
    "no lights": (Scene(lights=()), ["--set", "lights=[]"]),
    "clips": (
        Scene(clip=(Clip(Cylinder((0.0,) * 3, (0.0, 0.0, 1.0), 0.1), "outside"), Clip(Implicit("x:y")))),
        ["--clip", "outside:cylinder:0,0,0:0,0,1:0.1", "implicit:x:y"],
    ),
    "the rest": (
        Scene(background=(1.0, 1.0, 1.0, 0.0), region=(0.0, 1.0, 0.0, 2.0), axes=True, plain=True, reader=("step=3",)),
        ["--axes", "--plain", "--background", "1,1,1,0", "--reader", "step=3", "--region", "0:1,0:2"],
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_copied_commands_recreate_the_scene(name):
    scene, some = SCENES[name]
    words = option_words(scene)
    assert _normal(_read(words)) == _normal(scene)
    assert set(some) <= set(words)
    assert ("--set" in words) == ("--set" in some)


@pytest.mark.parametrize("name", SCENES)
def test_lines_of_python_make_the_scene_again(name):
    lines = python_of(SCENES[name][0]).splitlines()
    assert lines[-1].startswith("render(dataset, scene=scene).save(")
    found = {}
    exec("\n".join(lines[:-1]), found)
    assert found["scene"] == SCENES[name][0]


def test_data_keep_their_names():
    assert command_of(Scene(data=("-a.xml", "b c.fld"))) == "elvis render ./-a.xml 'b c.fld' -o picture.png"
    with pytest.raises(SceneError, match="come from Python"):
        command_of(Scene())
