"""Changes by dotted keys, and what a page may change."""

from dataclasses import replace

import pytest

from elvis.scene import Deform, Scene
from elvis.scene.model.errors import SceneError
from elvis.scene.model.tables import scene_of
from elvis.viewer.patches import FIXED, patched, placed, put_back, scene_of_page, without

TABLE = {"field": "u", "objects": [{"kind": "isosurface", "values": [1.0]}]}


def test_a_change_does_not_modify_the_table():
    found = patched(TABLE, {"objects[0].values[0]": 2.0, "objects[0].style.opacity": 0.5, "camera": "iso"})
    assert found == {
        "field": "u",
        "camera": "iso",
        "objects": [{"kind": "isosurface", "values": [2.0], "style": {"opacity": 0.5}}],
    }
    assert TABLE == {"field": "u", "objects": [{"kind": "isosurface", "values": [1.0]}]}


def test_objects_are_added_at_the_end_and_taken_away():
    added = patched(TABLE, {"objects[1]": {"kind": "faces"}})
    assert [item["kind"] for item in added["objects"]] == ["isosurface", "faces"]
    assert [item["kind"] for item in patched(added, {"objects[0]": None})["objects"]] == ["faces"]
    assert "field" not in patched(TABLE, {"field": None})
    assert patched({}, {"objects[0]": {"kind": "faces"}}) == {"objects": [{"kind": "faces"}]}


@pytest.mark.parametrize("key", ["plane", "objects[0]", "objects[1]", "clip[0]"])
def test_hidden_objects_are_restored_in_place(key):
    table = {
        "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]},
        "objects": [{"kind": "faces"}, {"kind": "isosurface", "values": [1.0]}],
        "clip": [{"surface": {"kind": "sphere", "center": [0, 0, 0], "radius": 1}}],
    }
    rest, hidden = without(table, key)
    assert rest != table
    assert put_back(rest, hidden) == table


def test_hidden_objects_are_restored_next_to_new_ones():
    plane = {"point": [0, 0, 0], "normal": [0, 0, 1]}
    found = put_back({"plane": plane}, {"key": "plane", "item": plane})
    assert found == {"plane": plane, "objects": [{"kind": "cut", "surface": {"kind": "plane", **plane}}]}
    assert put_back({}, {"key": "objects[3]", "item": {"kind": "faces"}}) == {"objects": [{"kind": "faces"}]}


@pytest.mark.parametrize("key", ["objects[7]", "clip[0]", "plane", "data", "objects", "objects[0].style"])
def test_only_objects_are_hidden(key):
    with pytest.raises(SceneError, match=r"no such object|expected plane"):
        without(TABLE, key)


@pytest.mark.parametrize("key", ["objects[7]", "objects[0].values.x", "field.x", "objects[x]", "title[0]", "axes", ""])
def test_missing_keys(key):
    with pytest.raises(SceneError, match="no such key"):
        patched(TABLE, {key: None})


@pytest.mark.parametrize("key", sorted(FIXED))
def test_paths_read_run_and_written_are_fixed(key):
    with pytest.raises(SceneError, match="cannot be changed"):
        patched(TABLE, {key: "x"})
    own = Scene(data=("mine.xml",))
    assert scene_of_page({"field": "u", key: "other"}, own) == replace(own, field="u")


def test_a_page_reads_only_files_next_to_the_data(tmp_path):
    own = Scene(data=(str(tmp_path / "data" / "mine.xml"),))

    def table(file):
        return {"objects": [{"kind": "cut", "surface": {"kind": "mesh", "file": str(file)}}]}

    inside = tmp_path / "data" / "body.stl"
    assert scene_of_page(table(inside), own).objects
    assert scene_of_page(table(inside), replace(own, data=(*own.data, str(tmp_path / "mesh" / "mine.fld")))).objects
    (tmp_path / "data").mkdir()
    (tmp_path / "secret.stl").touch()
    (tmp_path / "data" / "link.stl").symlink_to(tmp_path / "secret.stl")
    for outside in ("/etc/passwd", tmp_path / "data" / ".." / "secret.stl", tmp_path / "data" / "link.stl"):
        with pytest.raises(SceneError, match="folder of the data"):
            scene_of_page(table(outside), own)
    with pytest.raises(SceneError, match="folder of the data"):
        scene_of_page({"field": "distance('/etc/body.stl')"}, own)
    with pytest.raises(SceneError, match="folder of the data"):
        scene_of_page({"palette": "/etc/map.xml"}, own)


def test_only_the_scale_of_a_deformation_changes():
    own = Scene(deform=Deform("u,v", 2.0, undeformed="mesh"))
    assert scene_of_page({"field": "u"}, own).deform == own.deform
    table = patched({"deform": {"displacement": "u,v"}}, {"deform.scale": 3.0, "phase": 30.0})
    assert scene_of_page(table, own) == replace(own, deform=replace(own.deform, scale=3.0), phase=30.0)
    foreign = {"deform": {"displacement": "p,q", "scale": 5.0}}
    assert scene_of_page(foreign, own).deform == replace(own.deform, scale=5.0)
    # a link or a program changes the whole table
    assert patched(table, {"deform": {"displacement": "u,v", "scale": 4.0}})["deform"]["scale"] == 4.0
    with pytest.raises(SceneError, match="cannot be changed"):
        patched(table, {"deform": {"displacement": "u,w", "scale": 4.0}})
    for key, before in (("deform.displacement", table), ("deform", table), ("deform.scale", {})):
        with pytest.raises(SceneError, match="cannot be changed"):
            patched(before, {key: 2.0 if "." in key else None})


def test_planes_through_the_middle_get_a_point_once_the_data_are_known():
    table = {"field": "u", "objects": [{"kind": "cut", "surface": {"kind": "middle", "axis": "y"}}], "samples": 2}
    assert placed(table, scene_of(table), None) is table
    found = placed(table, scene_of(table), {"box": [[0, 0, 0], [2, 4, 6]]})
    plane = {"kind": "plane", "point": [1, 2, 3], "normal": [0, 1, 0]}
    assert found == {**table, "objects": [{"kind": "cut", "surface": plane}]}
    assert placed(found, scene_of(found), {"box": [[0, 0, 0], [9, 9, 9]]}) is found
    assert placed({"field": "u"}, Scene("u"), {"box": None}) == {"field": "u"}
