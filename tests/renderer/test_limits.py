"""What ends a picture early, and what a user is told: memory, time, lost devices, objects that aren't there."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from elvis import (
    Camera,
    Contours,
    CutSurface,
    DeviceError,
    Faces,
    Isosurface,
    Plane,
    Renderer,
    Scene,
    SceneError,
    Sphere,
    Style,
    render,
)
from elvis.core.data.dataset import Field
from elvis.plugins.command import command
from elvis.renderer.device import device, persistence
from elvis.renderer.device.errors import DeviceLostError
from elvis.renderer.frame import canvas
from elvis.scene.cameras.view import view_of
from elvis.scene.record.palette import NOT_A_NUMBER

NEAR = Camera((2.0, -1.6, 1.7), (0.5, 0.5, 0.5), fov=35.0)
PLANE = Plane((0.5, 0.5, 0.4), (0.1, 0.2, 1.0))


def test_pictures_larger_than_memory_are_rejected(draw, cube, monkeypatch):
    monkeypatch.setattr(canvas, "_free_memory", lambda second: 1e7)
    for scene in ({"objects": (Faces(),)}, {"plane": PLANE}):
        words = r"200 x 100 pixels takes \d\d\.\d MiB of memory, .*; reduce its size, or write only a \.png"
        with pytest.raises(SceneError, match=words):
            draw(cube, camera=NEAR, size=(200, 100), **scene)
        assert draw(cube, camera=NEAR, size=(70, 60), **scene).seen.any()


def test_the_memory_estimate_covers_record_and_concurrent_work(monkeypatch):
    """400 million pixels: some gigabytes without a record, 80 with one."""
    view = view_of(Scene("u", camera=NEAR, size=(20000, 20000)))
    monkeypatch.setattr(canvas, "_free_memory", lambda second: 6e9)
    canvas.check_memory(view, False, canvas.BAND)
    with pytest.raises(SceneError, match=r"20000 x 20000 pixels takes 8\d\.\d GiB of memory, 5\.59 GiB are free"):
        canvas.check_memory(view, True, canvas.BAND)


def test_free_memory_is_some_but_not_all():
    assert 1e6 < canvas.free_memory() < 1e15


def test_large_pictures_store_only_colours(renderer, cube, monkeypatch):
    """Beyond a band of pixels without exact outputs; the colours and counts are the same."""
    drawing = renderer("vulkan")
    drawing.load(cube, "u")
    scene = Scene("u", objects=(Faces(), CutSurface(PLANE)), camera=NEAR, size=(60, 50), samples=2)
    whole = drawing.render(scene)
    monkeypatch.setattr(persistence, "BAND", 60 * 20)
    lean = drawing.render(scene, references=False)
    assert lean.field.strides == lean.drawing.normal.strides[:2] == (0, 0)
    assert np.abs(lean.rgb.astype(int) - whole.rgb).max() <= 1
    assert lean.counts() == whole.counts()
    assert np.allclose(lean.range, whole.range, rtol=1e-12)


def test_time_limits(draw, cube):
    with pytest.raises(SceneError, match=r"exceeded the time limit of 1e-06 s: no file is written"):
        draw(cube, objects=(Faces(),), camera=NEAR, size=(40, 30), timeout=1e-6)
    assert draw(cube, objects=(Faces(),), camera=NEAR, size=(40, 30), timeout=1e3).seen.any()
    with pytest.raises(SceneError, match=r"exceeded the time limit of .*: no file is written"):
        draw(cube, plane=PLANE, size=(40, 30), timeout=1e-6)
    with pytest.raises(SceneError, match="timeout: expected seconds above 0, found 0"):
        Scene("u", timeout=0.0)


@pytest.mark.parametrize("scene", [{"plane": PLANE}, {"objects": (CutSurface(PLANE), Faces())}], ids=["one", "many"])
@pytest.mark.own_devices
def test_a_lost_device_is_reopened_for_smaller_parts(cube, renderer, monkeypatch, scene):
    """A device that fails whenever it has many pixels to draw at once."""
    renderer("vulkan")
    made = device.Device._filled

    def fails(self, count, itemsize, data):
        if itemsize == 8 and count in (80 * 90, 3 * 80 * 24, 3 * 80 * 90):
            raise DeviceLostError("the device failed: ERROR_DEVICE_LOST")
        return made(self, count, itemsize, data)

    with Renderer("vulkan") as drawing:
        drawing.load(cube, "u")
        whole = drawing.render(Scene("u", **scene, camera=NEAR, size=(80, 90)))
        first = drawing.device
        monkeypatch.setattr(device.Device, "_filled", fails)
        monkeypatch.setattr(persistence, "BAND", 80 * 90 // 3)
        monkeypatch.setattr(persistence, "FEWEST", 80 * 90 // 40)
        again = drawing.render(Scene("u", **scene, camera=NEAR, size=(80, 90)))
        assert drawing.device is not first
    assert np.array_equal(whole.element, again.element)
    assert np.array_equal(whole.field, again.field, equal_nan=True)


@pytest.mark.own_devices
def test_a_list_beyond_kernel_limits_is_drawn_in_parts(cube, renderer, monkeypatch):
    renderer("vulkan")
    scene = Scene("u", objects=(Faces(style=Style(contours=Contours(count=3))),), camera=NEAR, size=(40, 30))
    with Renderer("vulkan") as drawing:
        drawing.load(cube, "u")
        whole = drawing.render(scene)
        first = drawing.device
        first.reach = 1 << 16
        with monkeypatch.context() as patch:
            patch.setattr(persistence, "FEWEST", persistence.BAND)
            with pytest.raises(DeviceError, match=r"addresses 64 KiB of a bound .* takes [\d.]+ [KM]iB, even"):
                drawing.render(scene)

        # the device that is opened in its place is as it should be
        assert np.array_equal(drawing.render(scene).color, whole.color)
        assert drawing.device is not first


@pytest.mark.own_devices
def test_a_device_that_always_fails_is_given_up(cube, renderer, monkeypatch):
    renderer("vulkan")

    def fails(self, *_):
        raise DeviceLostError("the device failed: ERROR_DEVICE_LOST")

    with Renderer("vulkan") as drawing:
        drawing.load(cube, "u")
        monkeypatch.setattr(device.Device, "read", fails)
        with pytest.raises(DeviceError, match="ERROR_DEVICE_LOST, even if it draws a few rows") as raised:
            drawing.render(Scene("u", plane=PLANE, camera=NEAR, size=(40, 30)))
    assert not isinstance(raised.value, DeviceLostError)


def test_driver_errors_give_one_line():
    with pytest.raises(DeviceLostError, match="the device failed: vkQueueSubmit: lost"), device.WORKING:
        raise RuntimeError("vkQueueSubmit:\n  lost")


def test_objects_that_show_nothing_are_reported(draw, cube):
    far = CutSurface(Sphere((9.0, 9.0, 9.0), 0.5))
    frame = draw(cube, plane=PLANE, objects=(far,), camera=NEAR, size=(30, 20))
    assert frame.stats["remarks"] == ["objects[0] is not visible"]
    assert draw(cube, plane=PLANE, objects=(Faces(),), camera=NEAR, size=(30, 20)).stats["remarks"] == []


def test_values_outside_the_range_are_reported_with_the_range(draw, cube):
    """The field runs from -3 to 3."""
    styled = Faces(style=Style(contours=Contours(values=(-9.0, 0.0, 7.5))))
    (remark,) = draw(cube, objects=(styled,), camera=NEAR, size=(40, 30)).stats["remarks"]
    assert remark.startswith("objects[0] has no contour at -9, 7.5: u lies between -3")
    with pytest.raises(SceneError, match=r"'u' lies between -3\S* and 3\S*, found 5"):
        draw(cube, objects=(Isosurface((0.5, 5.0)),), camera=NEAR, size=(16, 12))


def test_constant_fields_have_colours_but_no_contours(draw, cube):
    blocks = [replace(block, coefficients=0.0 * block.coefficients) for block in cube.fields[0].blocks]
    flat = replace(cube, fields=(Field("u", tuple(blocks)),))
    style = Style(contours=Contours(count=4), lit=False)
    constant = draw(flat, objects=(Faces(style=style),), camera=NEAR, size=(40, 30))
    assert (constant.field[constant.seen] == 0.0).all()
    assert constant.range[0] < 0.0 < constant.range[1]
    assert len(np.unique(constant.color[constant.seen], axis=0)) == 1


def test_undefined_values_have_a_separate_colour(draw, cube):
    frame = draw(cube, field="0/(x-x)", objects=(Faces(style=Style(lit=False)),), camera=NEAR, size=(40, 30))
    assert frame.counts()["not_a_number"] == frame.seen.sum() > 0
    assert (frame.color[frame.seen] == NOT_A_NUMBER).all()


@pytest.fixture
def run(cube, tmp_path, capfd, renderer):
    """``elvis render`` of the cube; status, what was said, what is there afterwards."""
    from elvis import write

    renderer("vulkan")
    files = (tmp_path / "cube.xml", tmp_path / "cube.fld")
    write(cube, *files)

    def run(*options):
        with pytest.raises(SystemExit) as ended:
            command.main(["render", *map(str, (*files, *options))])
        names = sorted(path.name for path in tmp_path.iterdir() if not path.name.startswith("cube."))
        return ended.value.code or 0, capfd.readouterr().err, names

    return run


def test_an_interrupted_picture_leaves_no_file(run, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(canvas.Canvas, "_draw_hit_buffers", interrupted)
    status, err, names = run("--faces", "all", "-o", tmp_path / "a.png", "--save-scene", tmp_path / "s.toml")
    assert (status, names) == (130, [])
    assert "interrupted" in err


def test_remarks_are_warnings(run, tmp_path):
    cut = ("--cut", "sphere:9,9,9:1", "--size", "30x20", "--camera", "2,-2,2:0.5,0.5,0.5:0,0,1:30")
    status, err, names = run("--plane", "0.5,0.5,0.5:0,0,1", *cut, "-o", tmp_path / "a.png")
    assert (status, names) == (0, ["a.png"])
    # the plane lies between elements, which is said as well
    ambiguous, shown = err.splitlines()
    words = " pixels are ambiguous, 100 % of the visible pixels: they lie within rounding of an element border"
    assert words in ambiguous
    assert shown == "elvis: warning: objects[1] is not visible"


def test_a_saved_scene_makes_the_same_bytes(run, tmp_path):
    options = ("--contours", "5", "--mesh-lines", "--opacity", "0.7", "--light", "1,-1,1:0.5", "--samples", "2")
    first = ("--faces", "all", "--cut", "sphere:0.5,0.5,0.5:0.4", *options, "--size", "50x40", "--camera", "iso")
    status, err, _ = run(
        *first, "-o", tmp_path / "a.png", "-o", tmp_path / "a.npz", "--save-scene", tmp_path / "s.toml"
    )
    assert (status, err) == (0, "")
    outputs = ("-o", str(tmp_path / "b.png"), "-o", str(tmp_path / "b.npz"))
    with pytest.raises(SystemExit) as ended:
        command.main(["render", str(tmp_path / "s.toml"), *outputs])
    assert not ended.value.code
    for suffix in ("png", "npz"):
        assert (tmp_path / f"a.{suffix}").read_bytes() == (tmp_path / f"b.{suffix}").read_bytes()


def test_a_terminal_gets_a_summary_of_pixels(run, tmp_path, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    status, err, _ = run("--faces", "all", "--size", "30x20", "-o", tmp_path / "a.png")
    assert status == 0
    assert " pixels certain, " in err
    assert " pixels failed" in err


def test_every_key_of_a_scene_has_an_option_and_every_option_a_key():
    from dataclasses import fields

    from elvis.scene.commandline.options import OBJECTS, STYLES, scene_options
    from elvis.scene.model.copies import Copies
    from elvis.scene.model.whole import Deform

    # files are arguments: those of the data, and scenes where there are several; --set takes reference values
    keys = {field.name for field in fields(Scene)} - {"data", "scenes", "objects", "reference", "copies"}
    names = [option.name for option in scene_options(())]
    of_deform = [f"deform_{field.name}" for field in fields(Deform) if field.name != "displacement"]
    of_copies = [f"copies_{field.name}" for field in fields(Copies)]
    assert sorted(names) == sorted([*keys, *OBJECTS, *STYLES, *of_deform, *of_copies])


@pytest.mark.parametrize(("own", "asked", "time"), [(3.0, None, 3.0), (3.0, 0.5, 0.5), (None, -2.0, -2.0)])
def test_the_time_is_that_of_the_scene_or_of_the_data(cube, own, asked, time):
    frame = render(replace(cube, time=own), field="x + t", plane=PLANE, size=(20, 16), time=asked)
    assert np.abs(frame.field - frame.position[..., 0] - time)[frame.seen].max() < 1e-12
    with pytest.raises(SceneError, match="time: expected a finite number, found nan"):
        Scene("u", time=np.nan)


def test_settings_change_any_key(run, tmp_path):
    cut = ("--faces", "all", "--size", "20x16")
    assert (
        run(*cut, "--set", "objects[0].style.color=[1, 0, 0]", "--set", "ambient=0.5", "-o", tmp_path / "a.png")[0] == 0
    )
    for setting, sentence in (
        ("objects[7].style.opacity=1", "--set objects[7].style.opacity: the scene has no such key"),
        ("objects[0].style.opacty=1", "unknown key 'objects[0].style.opacty', did you mean opacity?"),
        ("ambient=bright", "ambient: expected a finite number, found 'bright'"),
    ):
        status, err, _ = run(*cut, "--set", setting, "-o", tmp_path / "b.png")
        assert status == 1
        assert sentence in err
    assert run(*cut, "--set", "ambient", "-o", tmp_path / "b.png")[0] == 2
