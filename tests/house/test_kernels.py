"""What kernels and Python agree on is written down once in each."""

import re

import pytest


@pytest.fixture
def renderer(root):
    """Text of each file of the renderer, by path."""
    files = (root / "renderer" / "elvis" / "renderer").rglob("*")
    return {path: path.read_text(encoding="utf-8") for path in files if path.suffix in (".py", ".slang")}


@pytest.mark.parametrize(
    ("shader", "module", "pattern"),
    [
        ("pixels.slang", "pixels.py", r"\b(?:nobody|NOBODY) = (\w+)"),
        ("pixels.slang", "tiles.py", r"\b(?:tile_size|TILE) = (\w+)"),
    ],
)
def test_constants_have_one_place_and_one_value(renderer, shader, module, pattern):
    places = {path.name: re.findall(pattern, text) for path, text in renderer.items() if re.search(pattern, text)}
    assert places.keys() == {shader, module}
    first, second = places.values()
    assert len(first) == len(second) == 1
    assert int(first[0], 0) == int(second[0], 0)


def test_no_element_has_one_encoding(renderer):
    names = [path.name for path, text in renderer.items() if re.search("0xf{8}", text, re.IGNORECASE)]
    assert sorted(names) == ["pixels.py", "pixels.slang"]


def test_there_is_one_camera_record(renderer):
    """Records that need a camera hold it: no other has an eye, or the way from world points to pixels, of its own."""
    shaders = {path.name: text for path, text in renderer.items() if path.suffix == ".slang"}
    assert [name for name, text in shaders.items() if "struct Camera" in text] == ["camera.slang"]
    fields = re.compile(r"^ *(?:public )?double[34] (?:\w+, )*(?:eye|to_column|to_weight)\b", re.MULTILINE)
    assert [name for name, text in shaders.items() if fields.search(text)] == ["camera.slang"]
    filled = [path.name for path, text in renderer.items() if re.search(r"\[\"(?:eye|to_column)\"\]", text)]
    assert filled == ["camera.py"]


def test_layouts_come_from_reflection(renderer):
    typed = [path.name for path, text in renderer.items() if re.search(r"np\.dtype\(\s*\[", text)]
    assert typed == []
