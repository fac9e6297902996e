"""Which device draws, among adapters that are made up: GPUs with and without what kernels need, drivers, compilers."""

import json

import pytest
from click.testing import CliRunner

from elvis.renderer import DeviceError, adapters
from elvis.renderer.adapters import Adapter, UnfitError, first_fit, lacking, limited
from elvis.renderer.commands.devices import devices

XE = Adapter("vulkan:0", "Intel(R) Iris(R) Xe Graphics", False)
CARD = Adapter("vulkan:1", "a card", False)
CUDA = Adapter("cuda:0", "a card", False)
SOFT = Adapter("vulkan:2", "llvmpipe", True)
CPU = Adapter("cpu", "slang's CPU target, one thread", True)
ALL = {"double", "pointer", "wave_ops", "half"}
#: what a device has where it isn't everything
FEATURES = {XE: {"pointer", "wave_ops", "half"}}


def open_made_up(adapter):
    """The name of the device; UnfitError as from one that is asked for its features."""
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
    assert choice.passed == (f"{XE.label} is passed over: it {NO_DOUBLES}",) * passed


NO_DOUBLES = "has no 64-bit floats, which the kernels need"


@pytest.mark.parametrize(
    ("name", "every", "words"),
    [
        ("vulkan:0", [XE, SOFT], rf"^the device vulkan:0 \({XE.label[:5]}.*\) {NO_DOUBLES}$".replace("(R)", ".R.")),
        ("vulkan", [CPU], "^no device 'vulkan': found cpu; install a Vulkan driver"),
        ("cpu", [SOFT], r"^no device 'cpu': found vulkan:2; install a C\+\+ compiler"),
        ("cuda", [SOFT], "^no device 'cuda': found vulkan:2$"),
        ("auto", [], r"^nothing can draw here; install a Vulkan driver .*, or install a C\+\+ compiler .*reference$"),
        ("auto", [XE], rf"^nothing can draw here; Intel.* is passed over: it {NO_DOUBLES}; install"),
        ("gpu", [], "^no device 'gpu': found none at all$"),
    ],
)
def test_what_can_not_draw_says_why_and_what_to_install(name, every, words):
    with pytest.raises(DeviceError, match=words):
        first_fit(name, every, open_made_up)


def test_everything_that_is_missing_is_named():
    assert lacking(ALL.__contains__) == ""
    assert lacking({"double", "wave_ops"}.__contains__) == "has no addresses of buffers, which the kernels need"
    assert lacking({"pointer"}.__contains__) == (
        "has no 64-bit floats and no operations across a wave, which the kernels need"
    )


def test_limits_below_what_kernels_need_are_named():
    assert limited(lambda limit: 65535) == ""
    few = {"max_compute_threads_per_group": 32, "max_compute_dispatch_thread_groups": 65535}
    assert limited(few.__getitem__) == "grants 32 threads in a group, of which the kernels need 64"


def test_the_cpu_is_offered_only_where_a_compiler_is_found(monkeypatch):
    monkeypatch.setattr(adapters, "_enumerate", lambda kind: [])
    for compiler, expected in (("clang", ["cpu"]), ("g++", ["cpu"]), ("gcc", []), ("", [])):
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


def test_the_list_says_what_is_passed_over(listed):
    out, err = listed([XE, SOFT, CPU])
    first, second = out.splitlines()[1:3]
    assert first.endswith(f"passed over: it {NO_DOUBLES}")
    assert second.endswith("auto")
    assert err == ""
    rows = json.loads(listed([XE, SOFT, CPU], "--json")[0])
    assert [(row["name"], row["auto"], row["unfit"]) for row in rows[:2]] == [
        ("vulkan:0", False, NO_DOUBLES),
        ("vulkan:2", True, ""),
    ]


def test_the_list_says_what_to_install(listed):
    out, err = listed([CPU])
    assert "vulkan" not in out
    assert "no Vulkan device was found: install a Vulkan driver" in err
    out, err = listed([SOFT])
    assert "cpu " not in out
    assert "the device cpu is not offered: install a C++ compiler" in err


def test_a_device_that_can_not_be_opened_is_passed_over():
    def open_(adapter):
        if adapter == CARD:
            raise UnfitError(adapter, "can't be opened")
        return adapter.name

    choice = first_fit("auto", [CARD, SOFT], open_)
    assert choice.adapter == SOFT
    assert choice.passed == ("a card is passed over: it can't be opened",)
