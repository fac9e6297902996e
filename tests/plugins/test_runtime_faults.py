"""Runtime plugins that are broken in one way each: the fault is found, and has the plugin's name."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from elvis import DeviceError, Plane, render
from elvis.core.base.errors import ElvisError
from elvis.core.shapes import Shape
from elvis.plugins.command.registry import PluginError
from elvis.plugins.faces import faces_of
from elvis.plugins.runtime import opening
from elvis.plugins.runtime.opening import PluginData, open_files
from elvis.plugins.runtime.source import VolumeSource
from elvis.plugins.runtime.volume import PartsVolume, basis_part, boxes_between
from elvis.plugins.testing import check_volume

MODULE = """module cubes;
import differentiated;
public StructuredBuffer<double> corners;
public struct Cube : IBasis
{
    uint element;
    public __init(uint element) { this.element = element; }
    [ForwardDifferentiable]
    public double3 world(double3 r) { return r + double3(corners[element], 0.0lf, 0.0lf); }
    [ForwardDifferentiable]
    public double value(double3 r) { return r.x; }
    public static double margin(double3 r) { return min(min3(r), min3(1.0lf - r)); }
    public static double3 center() { return 0.5lf; }
    public static double3 nearest(double3 r) { return clamp(r, 0.0lf, 1.0lf); }
    static double min3(double3 r) { return min(r.x, min(r.y, r.z)); }
}
"""
LYING = """
import differentiated; import volume;
struct Lying : IVolume
{
    static const bool affine = false;
    Differentiated<Cube> honest;
    __init(uint element) { honest = Differentiated<Cube>(element); }
    Frame frame(double3 r) { Frame f = honest.frame(r); f.dx = 1.01lf * f.dx; return f; }
    double value(double3 r) { return honest.value(r); }
    double3 gradient(double3 r) { return honest.gradient(r); }
    static double margin(double3 r) { return Cube.margin(r); }
    static double3 center() { return Cube.center(); }
    static uint hull_count() { return 8; }
    static double3 hull(uint element, uint k) { return Differentiated<Cube>.hull(element, k); }
}
"""
PLANE = Plane((0.5, 0.5, 0.5), (0, 0, 1))


class Cubes(VolumeSource):
    """Three unit cubes in a row, with a field that counts from 0 to 1 in each."""

    folder = Path()
    changes: ClassVar[dict] = {}
    fields = ("u",)

    @classmethod
    def opens(cls, paths):
        return paths[0].suffix == ".cubes"

    def __init__(self, paths):
        pass

    def volume(self, field):
        low = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
        boxes = boxes_between(low, low + 1)
        part = basis_part("cubes", "Cube", boxes, {"corners": low[:, 0]}, evaluate=lambda e, r: (low[e] + r, r[:, 0]))
        return PartsVolume([replace(part, **self.changes)], self.folder)


@pytest.fixture
def cubes(tmp_path):
    """A plugin with changes to its part, and replacements in its module."""

    def make(changes=None, old="", new=""):
        assert old in MODULE
        (tmp_path / "cubes.slang").write_text(MODULE.replace(old, new) if old else MODULE)
        source = type("Cubes", (Cubes,), {"folder": tmp_path, "changes": changes or {}})([])
        return PluginData("cubes", source)

    return make


def test_a_sound_plugin_is_drawn_without_remarks(cubes, renderer):
    frame = render(cubes(), field="u", plane=PLANE, device="cpu", size=(90, 30))
    assert frame.counts()["certain"] > 2000
    assert frame.stats["remarks"] == []
    check_volume(cubes().volume("u"), renderer("cpu"))


def test_plane_elements_are_drawn_without_a_plane(cubes, renderer):
    opened = cubes({}, "clamp(r, 0.0lf, 1.0lf)", "double3(clamp(r.xy, 0.0lf, 1.0lf), r.z)")
    source = (opened.source.folder / "cubes.slang").read_text()
    source = source.replace("center() { return 0.5lf; }", "center() { return double3(0.5lf, 0.5lf, 0.0lf); }")
    source = source.replace("return min(r.x, min(r.y, r.z));", "return min(r.x, r.y);")
    (opened.source.folder / "cubes.slang").write_text(source)
    volume = replace(opened.source.volume("u"), dimension=2)
    low = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    part = replace(volume.parts[0], boxes=boxes_between(low, low + np.array([1, 1, 0])))
    flat = replace(volume, parts=[replace(part, buffers={**part.buffers, "element_boxes": part.boxes})])
    check_volume(flat, renderer("cpu"))
    type(opened.source).volume = lambda self, field: flat
    frame = render(opened, field="u", device="cpu", size=(90, 30))
    assert frame.counts()["certain"] > 2000


def test_modules_of_one_name_in_two_folders_are_two(cubes, renderer, tmp_path):
    drawing, values = renderer("cpu"), []
    for scale in (1, 3):
        folder = tmp_path / str(scale)
        folder.mkdir()
        (folder / "cubes.slang").write_text(MODULE.replace("return r.x;", f"return {scale}.0lf * r.x;"))
        drawing.show(replace(cubes().volume("u"), shader_folder=folder))
        values.append(drawing.probe(np.array([[0.5, 0.5, 0.5]])).field[0])
    assert values == pytest.approx([0.5, 1.5])


BOXES = boxes_between(np.zeros((3, 3)), np.ones((3, 3)))


@pytest.mark.parametrize(
    ("changes", "old", "new", "sentence"),
    [
        ({"boxes": BOXES}, "", "", "plugin cubes: .*Cube.*: expected points within the box of their element"),
        ({}, "return r + ", "return sqrt(-1.0lf - r) + ", "plugin cubes: .*: expected a finite position, found NaN"),
        ({"boxes": BOXES[:2]}, "", "", r"plugin cubes: part 0 .*: expected float32 boxes \(3, 6\)"),
        ({"boxes": -BOXES}, "", "", "plugin cubes: part 0 .*: expected a box with its low corner first"),
        ({"module": "spheres"}, "", "", r"plugin cubes: part 0 .*: expected spheres\.slang in"),
        ({"buffers": {"corners": np.array(["a"])}}, "", "", "plugin cubes: .* buffer corners: expected float64"),
    ],
)
def test_errors_of_a_plugin_are_reported_with_its_name(cubes, changes, old, new, sentence):
    with pytest.raises(PluginError, match=sentence):
        render(cubes(changes, old, new), field="u", plane=PLANE, device="cpu")


def test_values_that_are_not_numbers_are_remarked_on(cubes):
    opened = cubes({}, "return r.x;", "return sqrt(r.x - 0.5lf);")
    frame = render(opened, field="u", plane=PLANE, device="cpu", size=(90, 30))
    where = f"plugin cubes: {opened.volume('u').parts[0].type}"
    assert frame.stats["remarks"] == [f"{where}: the field is NaN in element 0 and 2 others of those sampled"]


@pytest.mark.parametrize("device", ["vulkan", "cpu"])
def test_a_compile_error_quotes_the_compiler(cubes, renderer, device):
    opened = cubes({}, "return r.x;", "return r.foo;")
    renderer(device)
    with pytest.raises(DeviceError) as failure:
        render(opened, field="u", plane=PLANE, device=device)
    lines = str(failure.value).splitlines()
    line = MODULE[: MODULE.index("return r.x")].count("\n") + 1
    assert lines[0].startswith("error[")
    assert f"{opened.source.folder / 'cubes.slang'}:{line}:" in lines[1]
    assert "'foo' is not a member" in lines[-1]
    assert len(lines) == 5


def test_the_kit_finds_faces_that_are_not_on_their_elements(cubes, renderer):
    volume = cubes({"shape": Shape.HEXAHEDRON, "unit": True}).volume("u")
    check_volume(volume, renderer("cpu"))
    faces = faces_of(None, volume)
    (block,) = faces.blocks
    lies = {
        "border of the reference shape": replace(block, frames=0.9 * block.frames),
        "where the map has them": replace(block, nets=lambda rows: block.nets(rows) * [1.1, 1, 1, 1]),
        "two elements at most": replace(block, entity=0 * block.entity),
        "coincident sides of a face": replace(block, entity=np.roll(block.entity, 1)),
    }
    for sentence, lie in lies.items():
        with pytest.raises(AssertionError, match=sentence):
            check_volume(replace(volume, faces=lambda lie=lie: replace(faces, blocks=(lie,))), renderer("cpu"))


def test_the_kit_draws_a_small_picture(cubes, renderer, tmp_path):
    check_volume(cubes().volume("u"), renderer("cpu"), picture=tmp_path / "cut.npz")
    with np.load(tmp_path / "cut.npz") as record:
        seen = record["status"] == 1
        assert np.abs(record["field"] - record["position"][..., 0] % 1)[seen].max() < 1e-12


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"evaluate": lambda e, r: (0 * r, r[:, 0])}, "expected the positions that NumPy gives"),
        ({"evaluate": lambda e, r: (r + e[:, None] * [1, 0, 0], r[:, 1])}, "expected the values that NumPy gives"),
        ({"type": "Lying", "source": LYING}, r"expected d\(position\)/d\(r\.x\) to be that of the positions"),
    ],
)
def test_the_kit_finds_lies(cubes, renderer, changes, sentence):
    with pytest.raises(AssertionError, match=sentence):
        check_volume(cubes(changes).volume("u"), renderer("cpu"))


# plugins side by side


class Throwing(Cubes):
    """Raises wherever it is asked."""

    @classmethod
    def opens(cls, paths):
        raise KeyError("magic")


class Failing(Cubes):
    """Opens, then raises."""

    def __init__(self, paths):
        raise ZeroDivisionError("no elements")


@pytest.fixture
def opened(tmp_path, monkeypatch):
    """An empty file that the plugins here open, in the working folder."""
    monkeypatch.chdir(tmp_path)
    for name in ("a.cubes", "a.txt"):
        Path(name).touch()
    return Path("a.cubes")


def test_a_plugin_that_throws_is_skipped_with_a_warning(opened, monkeypatch):
    monkeypatch.setattr(opening, "installed_plugins", lambda: {"throwing": Throwing, "cubes": Cubes})
    said = []
    assert open_files([opened], report=said.append).name == "cubes"
    assert said == ["plugin throwing is skipped: for a.cubes it raises KeyError: 'magic'"]
    assert open_files([Path("a.txt")]) is None


def test_a_plugin_that_throws_when_it_opens_is_named(opened, monkeypatch):
    monkeypatch.setattr(opening, "installed_plugins", lambda: {"failing": Failing})
    with pytest.raises(PluginError, match=r"plugin failing: opening a\.cubes: ZeroDivisionError: no elements"):
        open_files([opened])


def test_the_user_chooses_among_several_plugins(opened, monkeypatch):
    monkeypatch.setattr(opening, "installed_plugins", lambda: {"cubes": Cubes, "dice": Cubes})
    with pytest.raises(ElvisError, match=r"a\.cubes: cubes and dice can open them; choose one with --plugin"):
        open_files([opened])


def test_plugins_that_do_not_load_do_not_affect_others(miniature):
    assert {"fourier", "nurbs"} <= set(opening.installed_plugins())


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("import nothing_at_all", "does not load: ModuleNotFoundError"),
        ("x = 1", "expected one subclass of elvis.plugins.runtime.source.VolumeSource, found 0"),
    ],
)
def test_a_file_without_a_plugin_is_rejected(opened, tmp_path, text, sentence):
    path = tmp_path / "mine.py"
    path.write_text(text)
    with pytest.raises(PluginError, match=sentence):
        open_files([opened], str(path))


def test_the_command_shows_file_and_line_of_a_compile_error(tmp_path):
    (tmp_path / "cubes.slang").write_text(MODULE.replace("return r.x;", "return r.foo;"))
    own = Path(__file__).read_text(encoding="utf-8")
    source = own[own.index("class Cubes") : own.index("@pytest.fixture")]
    imports = [line for line in own.splitlines() if line.startswith(("import numpy", "from"))]
    (tmp_path / "mine.py").write_text("\n".join(imports) + "\n" + source.replace("Path()", "Path(__file__).parent"))
    command = "from elvis.plugins.command.command import main; main()"
    arguments = ["render", "mine.py", "--plugin", "mine.py", "--plane", "0,0,0.5:0,0,1", "-o", "p.png"]
    process = subprocess.run(
        [sys.executable, "-c", command, *arguments, "--device", "cpu"], cwd=tmp_path, capture_output=True, text=True
    )
    assert process.returncode == 1
    (line,) = process.stderr.splitlines()
    assert line.startswith("elvis: error: error[")
    assert "cubes.slang:11:" in line
    assert not (tmp_path / "p.png").exists()
