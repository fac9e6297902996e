"""Which device draws, among adapters that are made up: GPUs with and without what kernels need, drivers, compilers."""

import ctypes
import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import DeviceError
from elvis.core.base.arrays import frozen_floats
from elvis.renderer.commands.devices import devices
from elvis.renderer.device import adapters
from elvis.renderer.device.adapters import Adapter, UnfitError, first_fit, lacking, limited
from elvis.renderer.device.device import _as_writeable
from elvis.renderer.device.pacing import Watch

XE = Adapter("vulkan:0", "Intel(R) Iris(R) Xe Graphics", False)
CARD = Adapter("vulkan:1", "a card", False)
CUDA = Adapter("cuda:0", "a card", False)
SOFT = Adapter("vulkan:2", "llvmpipe", True)
CPU = Adapter("cpu", "slang's CPU target, one thread", True)
ALL = {"double", "pointer", "wave_ops", "half"}
#: what a device has where it isn't everything
FEATURES = {XE: {"pointer", "wave_ops", "half"}}


def open_made_up(adapter):
    """The name of the device; UnfitError as from one that is requested its features."""
    if reason := lacking(FEATURES.get(adapter, ALL).__contains__):
        raise UnfitError(adapter, reason)
    return adapter.name


@pytest.mark.parametrize(
    ("name", "every", "taken"),
    [
        ("auto", [XE, CARD, SOFT, CPU], CARD),
        ("auto", [XE, SOFT, CPU], SOFT),
        ("auto", [XE, CPU], CPU),
        ("auto", [XE, CUDA, SOFT], CUDA),
        ("auto", [CUDA, CARD, SOFT], CARD),
        ("auto", [CPU], CPU),
        ("vulkan", [CARD, SOFT, CPU], CARD),
        ("cuda", [CUDA, CARD], CUDA),
        ("vulkan:2", [CARD, SOFT, CPU], SOFT),
        ("cpu", [XE, SOFT, CPU], CPU),
    ],
)
def test_the_best_device_that_can_draw_is_taken(name, every, taken):
    choice = first_fit(name, every, open_made_up)
    assert (choice.adapter, choice.device) == (taken, taken.name)
    passed = name == "auto" and XE in every
    assert choice.passed == (f"{XE.label} is skipped: it {NO_DOUBLES}",) * passed


NO_DOUBLES = "has no 64-bit floats, which the kernels need"


@pytest.mark.parametrize(
    ("name", "every", "words"),
    [
        ("vulkan:0", [XE, SOFT], rf"^the device vulkan:0 \({XE.label[:5]}.*\) {NO_DOUBLES}$".replace("(R)", ".R.")),
        ("vulkan", [CPU], "^no device 'vulkan': found cpu; install a Vulkan driver"),
        ("cpu", [SOFT], r"^no device 'cpu': found vulkan:2; install a C\+\+ compiler"),
        ("cuda", [SOFT], "^no device 'cuda': found vulkan:2$"),
        ("auto", [], r"^no device can draw here; install a Vulkan driver .*, or install a C\+\+ compiler .*reference$"),
        ("auto", [XE], rf"^no device can draw here; Intel.* is skipped: it {NO_DOUBLES}; install"),
        ("gpu", [], "^no device 'gpu': found none at all$"),
    ],
)
def test_unusable_devices_give_a_reason_and_advice(name, every, words):
    with pytest.raises(DeviceError, match=words):
        first_fit(name, every, open_made_up)


def test_all_missing_features_are_named():
    assert lacking(ALL.__contains__) == ""
    assert lacking({"double", "wave_ops"}.__contains__) == "has no addresses of buffers, which the kernels need"
    assert lacking({"pointer"}.__contains__) == (
        "has no 64-bit floats and no operations across a wave, which the kernels need"
    )


def test_insufficient_device_limits_are_named():
    enough = {limit: least for limit, (least, _) in adapters.LIMITS.items()}
    assert limited(enough.__getitem__) == ""
    few = enough | {"max_compute_threads_per_group": 32}
    assert limited(few.__getitem__) == "grants 32 threads in a group, but the kernels need 64"
    few = enough | {adapters.REACH: 1 << 20}
    assert limited(few.__getitem__) == "grants 1048576 bytes of a bound buffer, but the kernels need 134217728"


def test_bound_buffers_are_used_up_to_the_vulkan_limit():
    """The place of a number in Vulkan's own structure, by the rules of C; no more is asked of software than all has."""

    class Limits(ctypes.Structure):
        names = ("1d", "2d", "3d", "cube", "layers", "texels", "uniform", "storage")
        _fields_ = (*((name, ctypes.c_uint32) for name in names), ("granularity", ctypes.c_uint64))

    class Properties(ctypes.Structure):
        names = ("api", "driver", "vendor", "device", "type")
        _fields_ = (
            *((name, ctypes.c_uint32) for name in names),
            ("name", ctypes.c_char * 256),
            ("cache", ctypes.c_uint8 * 16),
            ("limits", Limits),
        )

    place = Properties.limits.offset + Limits.storage.offset
    assert place == ctypes.sizeof(ctypes.c_uint32) * adapters._REACH_PLACE
    for adapter in adapters.adapters():
        if adapter.kind == "vulkan":
            opened = adapters.open_adapter(adapter)
            told = adapters._granted(opened, adapters.REACH)
            assert 1 << 27 <= told < 1 << 32
            assert adapters.reach_of(adapter, opened) == (np.inf if adapter.software else told)
            assert adapters.reach_of(replace(adapter, software=False), opened) == told
            opened.close()


def test_the_cpu_is_offered_only_with_a_compiler(monkeypatch):
    monkeypatch.setattr(adapters, "_enumerate", lambda kind: [])
    for compiler, expected in (("clang", []), ("g++", ["cpu"]), ("gcc", []), ("", [])):
        monkeypatch.setattr(adapters, "which", lambda name, found=compiler: "/bin/" + name if name == found else None)
        assert [adapter.name for adapter in adapters.adapters()] == expected


@pytest.fixture
def listed(monkeypatch):
    """What ``elvis devices`` says of made-up adapters."""

    def run(every, *options):
        monkeypatch.setattr(adapters, "adapters", lambda: every)
        monkeypatch.setattr(adapters, "unfit", lambda adapter: NO_DOUBLES if adapter == XE else "")
        result = CliRunner().invoke(devices, options)
        assert result.exit_code == 0
        return result.stdout, result.stderr

    return run


def test_the_list_names_skipped_devices(listed):
    out, err = listed([XE, SOFT, CPU])
    first, second = out.splitlines()[1:3]
    assert first.endswith(f"skipped: it {NO_DOUBLES}")
    assert second.endswith("auto")
    assert err == ""
    rows = json.loads(listed([XE, SOFT, CPU], "--json")[0])
    assert [(row["name"], row["auto"], row["problem"]) for row in rows[:2]] == [
        ("vulkan:0", False, NO_DOUBLES),
        ("vulkan:2", True, ""),
    ]


def test_the_list_gives_installation_advice(listed):
    out, err = listed([CPU])
    assert "vulkan" not in out
    assert "no Vulkan device was found: install a Vulkan driver" in err
    out, err = listed([SOFT])
    assert "cpu " not in out
    assert "the device cpu is not available: install a C++ compiler" in err


def test_a_device_that_cannot_be_opened_is_skipped():
    def open_(adapter):
        if adapter == CARD:
            raise UnfitError(adapter, "can't be opened")
        return adapter.name

    choice = first_fit("auto", [CARD, SOFT], open_)
    assert choice.adapter == SOFT
    assert choice.passed == ("a card is skipped: it can't be opened",)


def test_read_only_arrays_are_uploaded_without_a_copy():
    frozen = frozen_floats(np.arange(3.0)).view(np.uint8)
    own = _as_writeable(frozen)
    assert own.flags.writeable
    assert np.shares_memory(own, frozen)
    assert not frozen.flags.writeable
    fixed = np.frombuffer(b"abc", np.uint8)
    assert (_as_writeable(fixed) == fixed).all()


def test_one_core_is_announced_once(monkeypatch, capfd):
    """If nothing but the CPU target can draw, a line says what to install; not if it is requested."""
    cpu = Adapter("cpu", "slang's CPU target, one thread", True)
    monkeypatch.setattr(adapters, "adapters", lambda: [cpu])
    monkeypatch.setattr(adapters, "open_adapter", lambda adapter: adapter.name)
    monkeypatch.setattr(adapters.sys, "platform", "linux")
    adapters._tell_of_one_core.cache_clear()
    assert adapters.open_device("cpu").device == "cpu"
    assert capfd.readouterr().err == ""
    for _ in range(2):
        assert adapters.open_device("auto").device == "cpu"
    said = capfd.readouterr().err
    assert said.count("one CPU core") == 1
    assert "mesa-vulkan-drivers" in said


def test_slangpy_waits_only_for_finished_work():
    """Its wait holds the interpreter, so that no other thread runs, nor Ctrl-C is noticed."""
    calls = []

    def is_finished(submission):
        calls.append(submission)
        return len(calls) > 20

    Watch(is_finished, lambda: calls.append("retired"), lambda seconds: None).wait(7)
    assert calls == [7] * 21 + ["retired"]
