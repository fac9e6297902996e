"""Compiled kernels that are retained: found again, checked, shared by processes, and never in the way of a picture."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from elvis import Plane, render
from elvis.core.files.keeping import Store
from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.renderer.device.device import Device
from elvis.renderer.device.errors import DeviceError
from elvis.renderer.device.kernels import cache as kernel_cache
from elvis.renderer.device.kernels import elsewhere
from elvis.renderer.device.kernels.cache import KernelCache
from elvis.renderer.raster.compositing import FragmentLists
from elvis.viewer import drawing_process

COLOR = (0.25, 0.5, 0.75)
#: a process that compiles a kernel, and says how many were at hand
PROGRAM = """
import sys
from elvis.renderer.raster.compositing import FragmentLists
from elvis.renderer.device.device import Device
with Device("vulkan") as device:
    assert (FragmentLists.of(device, 5, [], (0.25, 0.5, 0.75)).compose().colors() == (0.25, 0.5, 0.75)).all()
    print(device._device.shader_cache_stats.hit_count)
"""


@pytest.fixture
def process(monkeypatch):
    """Begin again, as a new process does, with another folder where one is given."""

    def begin(home=None):
        for cache in kernel_cache._caches.values():
            cache.close()
        kernel_cache._caches.clear()
        if home is not None:
            monkeypatch.setenv("XDG_CACHE_HOME", str(home))

    monkeypatch.setattr(kernel_cache, "_caches", {})
    yield begin
    begin()


@pytest.fixture
def compose(renderer):
    """Draw nothing on a background; kernels that were at hand, those that were not, and remarks."""
    renderer("vulkan")

    def compose():
        with Device("vulkan") as device:
            assert (FragmentLists.of(device, 5, [], COLOR).compose().colors() == COLOR).all()
            stats = device._device.shader_cache_stats
            return stats.hit_count, stats.miss_count, device.cache.remarks

    return compose


def kept(home, suffix="kernel"):
    """The files that are retained."""
    return sorted((home / "elvis" / "kernels").glob(f"*.{suffix}"))


def test_kernels_are_found_again(process, compose, tmp_path):
    process(tmp_path)
    assert compose() == (0, 1, [])
    assert len(kept(tmp_path)) == 1
    assert compose() == (1, 0, [])
    private = kernel_cache.kernel_cache().private
    process()
    assert not private.parent.exists()
    assert compose() == (1, 0, [])
    assert len(kept(tmp_path)) == 1


def test_kernels_of_other_optimisation_levels_are_distinct(process, compose, tmp_path, monkeypatch):
    process(tmp_path)
    for number, level in enumerate(("none", "default"), 1):
        monkeypatch.setenv("ELVIS_SLANG_OPTIMIZATION", level)
        assert compose() == (0, 1, [])
        assert len(kept(tmp_path)) == number
    monkeypatch.delenv("ELVIS_SLANG_OPTIMIZATION")
    assert compose() == (1, 0, [])


def test_an_invalid_level_is_reported(compose, monkeypatch):
    monkeypatch.setenv("ELVIS_SLANG_OPTIMIZATION", "most")
    with pytest.raises(DeviceError, match=r"^ELVIS_SLANG_OPTIMIZATION is 'most': expected one of none, default"):
        compose()


@pytest.mark.parametrize("damage", ["one bit", "empty"])
def test_damaged_kernels_are_moved_aside_and_recompiled(process, compose, tmp_path, damage):
    process(tmp_path)
    compose()
    (file,) = kept(tmp_path)
    whole = file.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 4
    wrong = {"one bit": bytes(flipped), "empty": b""}[damage]
    file.write_bytes(wrong)
    process()
    hits, misses, remarks = compose()
    assert (hits, misses, len(remarks)) == (0, 1, 1)
    assert remarks[0] == (f"damaged compiled kernels in {file.parent}, moved aside and rebuilt when needed: 1")
    assert file.read_bytes() == whole
    assert [path.read_bytes() for path in kept(tmp_path, "damaged")] == [wrong]
    process()
    assert compose() == (1, 0, [])


@pytest.fixture
def compilers(monkeypatch):
    """The process that compiles for this one, in a list."""
    found = []
    monkeypatch.setattr(elsewhere, "_compilers", found)
    elsewhere.compile_elsewhere()
    yield found
    found[0].close()


@pytest.mark.parametrize("place", ["folder", "/dev/null/here"])
def test_another_process_compiles_kernels(process, compose, compilers, tmp_path, place):
    home = tmp_path / place
    process(home)
    assert compose()[:2] == (1, 0)
    assert len(kept(home)) == (place == "folder")


def test_a_known_kernel_starts_no_process(process, compose, compilers, tmp_path):
    process(tmp_path)
    compose()
    compilers[0].close()
    process()
    assert compose() == (1, 0, [])
    assert compilers[0]._process is None


@pytest.mark.parametrize("program", ["/bin/false", "/nowhere/python"])
def test_kernels_are_compiled_here_without_the_other_process(
    process, compose, compilers, tmp_path, monkeypatch, program
):
    monkeypatch.setattr(sys, "executable", program)
    process(tmp_path)
    assert compose() == (0, 1, [])
    assert compilers[0]._process is None


def test_the_other_process_starts_again_after_its_end(process, compose, compilers, tmp_path):
    for number in range(2):
        process(tmp_path / str(number))
        assert compose() == (1, 0, [])
        compilers[0]._process.kill()
        compilers[0]._process.wait()


def test_the_other_process_ends_when_idle():
    program = f"from {elsewhere.__name__} import serve; from {elsewhere.__name__.rpartition('.')[0]} import elsewhere;"
    program += "elsewhere.IDLE = 0.1; serve()"
    with subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE) as done:
        assert done.wait(60) == 0


def test_errors_of_kernels_are_found_here(process, compilers, renderer, tmp_path):
    renderer("vulkan")
    process(tmp_path)
    (tmp_path / "wrong_draw.slang").write_text("import nothing;")
    with Device("vulkan") as device:
        device.include(tmp_path)
        with pytest.raises(DeviceError, match="nothing"):
            device.kernel("wrong_draw")


def test_the_process_that_draws_has_its_kernels_compiled_elsewhere(compilers):
    compilers.clear()
    drawing_process._import_ahead()
    assert len(compilers) == 1


@pytest.mark.parametrize("place", ["a file", "a device"])
def test_pictures_are_drawn_without_a_writable_cache(process, compose, tmp_path, place):
    (tmp_path / "file").touch()
    home = tmp_path / "file" if place == "a file" else Path("/dev/null/here")
    process(home)
    hits, misses, remarks = compose()
    assert (hits, misses) == (0, 1)
    assert remarks == [f"compiled kernels can't be cached in {home}/elvis/kernels: Not a directory"]
    # once in a process, which has its kernels nonetheless
    assert compose() == (1, 0, remarks)


def test_a_full_disk_is_reported_and_leaves_no_partial_file(process, compose, tmp_path, monkeypatch):
    def full(self, place):
        raise OSError(28, "No space left on device")

    process(tmp_path)
    monkeypatch.setattr(Path, "replace", full)
    assert compose()[2] == [f"compiled kernels can't be cached in {tmp_path}/elvis/kernels: No space left on device"]
    assert list((tmp_path / "elvis" / "kernels").iterdir()) == []


def test_without_a_temporary_folder_kernels_are_in_memory(process, compose, tmp_path, monkeypatch):
    def none():
        raise FileNotFoundError(2, "No usable temporary directory found")

    process(tmp_path)
    monkeypatch.setattr(kernel_cache.tempfile, "gettempdir", none)
    for _ in range(2):
        assert compose() == (
            0,
            0,
            ["compiled kernels are cached in memory only: no temporary folder has room for them"],
        )


def test_kernels_stay_in_memory_if_the_temporary_folder_is_nearly_full(tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=kernel_cache.DATABASE_SIZE))
    cache = kernel_cache.KernelCache(tmp_path / "kept")
    assert cache.private is None
    assert cache.remarks == ["compiled kernels are cached in memory only: no temporary folder has room for them"]
    cache.close()


@pytest.mark.own_devices
def test_remarks_are_in_the_statistics_of_a_picture(process, renderer, linear):
    renderer("vulkan")
    kernel_cache.kernel_cache().remarks.append("compiled kernels can't be cached in a test")
    plane = Plane((0.5, 0.5, 0.5), (0.0, 0.0, 1.0))
    frame = render(linear(grid(Shape.HEXAHEDRON, 1)), field="u", plane=plane, size=(8, 8), device="vulkan")
    assert "compiled kernels can't be cached in a test" in frame.stats["remarks"]


@pytest.mark.thorough
def test_processes_that_run_at_the_same_time(process, compose, tmp_path):
    settings = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    started = [
        subprocess.Popen([sys.executable, "-c", PROGRAM], env=settings, stdout=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    assert [process.communicate()[0].strip() in ("0", "1") for process in started] == [True] * 3
    assert [process.returncode for process in started] == [0] * 3
    assert [path.suffix for path in (tmp_path / "elvis" / "kernels").iterdir()] == [".kernel"]
    process(tmp_path)
    assert compose() == (1, 0, [])


def test_the_least_recently_used_entries_are_evicted(tmp_path, monkeypatch):
    files = [Store(tmp_path, "kernel", 1 << 20).write(bytes([k]), bytes([k]) * 1000) for k in range(5)]
    now = time.time()
    for age, file in enumerate(files):
        os.utime(file, (now - 1000 * age, now - 1000 * age))
    (tmp_path / "half.written").touch()
    os.utime(tmp_path / "half.written", (now - 1e5, now - 1e5))
    monkeypatch.setattr(kernel_cache, "MOST_BYTES", 3500)
    cache = KernelCache(tmp_path)
    try:
        assert sorted(tmp_path.iterdir()) == sorted(files[:3])
        assert cache.remarks == []
    finally:
        cache.close()


def test_the_use_of_an_old_kernel_is_noted(process, compose, tmp_path):
    process(tmp_path)
    compose()
    (file,) = kept(tmp_path)
    os.utime(file, (1e9, 1e9))
    process()
    compose()
    process()
    assert file.stat().st_mtime > 1.1e9
    os.utime(file, (1e9, 1e9))
    kernel_cache.kernel_cache()
    process()
    assert file.stat().st_mtime == 1e9


def test_kernels_are_not_cached_without_a_home(process, compose, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", "relative")
    monkeypatch.chdir(tmp_path)
    process("")
    assert compose()[1:] == (1, ["compiled kernels are not cached: neither a home folder nor XDG_CACHE_HOME exists"])
    assert list(tmp_path.iterdir()) == []
