"""Compiled modules: read in place of their sources, never where they are damaged or these have changed."""

import os
import shutil
import time
from hashlib import sha256

import pytest

from elvis.renderer.device import compiled_modules, device
from elvis.renderer.device.compiled_modules import CompiledModules
from elvis.renderer.device.device import SHADERS, Device
from elvis.renderer.device.kernels import cache as kernel_cache
from elvis.renderer.device.kernels.cache import KernelCache
from elvis.renderer.raster.compositing import FragmentLists

COLOR = (0.25, 0.5, 0.75)


@pytest.fixture
def compose(renderer, monkeypatch, tmp_path):
    """Draw nothing on a background, as a new process does; its colour, and remarks."""
    renderer("vulkan")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(kernel_cache, "_caches", {})

    def compose():
        with Device("vulkan") as opened:
            (color,) = FragmentLists.of(opened, 1, [], COLOR).compose().colors()
            remarks = opened.cache.remarks
        for cache in kernel_cache._caches.values():
            cache.close()
        kernel_cache._caches.clear()
        return tuple(color), remarks

    return compose


def kept(tmp_path):
    """The files of modules by name."""
    return {path.stem: path for path in (tmp_path / "home" / "elvis" / "modules").rglob("*.slang-module")}


def riff(size):
    """A file of some bytes that looks whole."""
    return b"RIFF" + (size - 8).to_bytes(4, "little") + bytes(size - 8)


def test_modules_are_read_in_place_of_their_sources(compose, tmp_path):
    assert compose() == (COLOR, [])
    written = {path: path.stat().st_mtime_ns for path in kept(tmp_path).values()}
    assert set(kept(tmp_path)) == {"compose", "fragments", "dispatch"}
    for path in written:
        named = path.name.encode() + b"\n" + path.read_bytes()
        assert path.with_suffix(".sha256").read_text() == sha256(named).hexdigest()
    assert compose() == (COLOR, [])
    assert {path: path.stat().st_mtime_ns for path in kept(tmp_path).values()} == written


@pytest.mark.parametrize("damage", ["one bit", "empty", "another", "no checksum"])
def test_damaged_modules_are_made_again(compose, tmp_path, damage):
    compose()
    file = kept(tmp_path)["compose"]
    whole = file.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 4
    file.write_bytes({"one bit": bytes(flipped), "empty": b""}.get(damage, whole))
    if damage == "another":
        for suffix in (".slang-module", ".sha256"):
            shutil.copyfile(kept(tmp_path)["dispatch"].with_suffix(suffix), file.with_suffix(suffix))
    if damage == "no checksum":
        file.with_suffix(".sha256").unlink()
    # without kernels, which would be found whatever they are made of
    shutil.rmtree(tmp_path / "home" / "elvis" / "kernels")
    place = file.parents[2]
    remark = f"damaged compiled modules in {place}, removed and rebuilt: 1"
    assert compose() == (COLOR, [] if damage == "no checksum" else [remark])
    assert len(file.read_bytes()) == len(whole)
    assert compose() == (COLOR, [])


def test_a_source_that_has_changed_is_read(compose, tmp_path, monkeypatch):
    folder = shutil.copytree(SHADERS[0], tmp_path / "shaders")
    monkeypatch.setattr(device, "SHADERS", [folder])
    assert compose() == (COLOR, [])
    source = folder / "fragments.slang"
    text = source.read_text()
    source.write_text(text.replace("through * composition", "0.5lf * through * composition"))
    assert source.read_text() != text
    half = tuple(0.5 * channel for channel in COLOR)
    assert compose() == (half, [])
    assert compose() == (half, [])
    source.write_text(text)
    assert compose() == (COLOR, [])


def test_incomplete_modules_get_no_checksum(tmp_path):
    modules = CompiledModules(tmp_path, [])
    folder = modules.place("here")
    for name, content in {"whole": riff(100), "cut": riff(100)[:-1], "other": b"x" * 100}.items():
        (folder / f"{name}.slang-module").write_bytes(content)
    modules.seal()
    assert [path.name for path in folder.glob("*.sha256")] == ["whole.sha256"]
    again = CompiledModules(tmp_path, [])
    assert again.place("here") == folder
    assert [path.name for path in folder.glob("*.slang-module")] == ["whole.slang-module"]
    assert again.place("elsewhere") != folder


def test_folders_that_were_not_used_for_longest_make_room(tmp_path, monkeypatch):
    now = time.time()
    for age in range(4):
        folder = tmp_path / str(age)
        folder.mkdir()
        (folder / "a.slang-module").write_bytes(riff(1000))
        os.utime(folder, (now - 1000 * age - 1000,) * 2)
    left = tmp_path / "0" / "a.slang-module-0123456789abcdef"
    left.touch()
    os.utime(left, (now - 1e5,) * 2)
    os.utime(left.parent, (now - 1000,) * 2)
    monkeypatch.setattr(compiled_modules, "MOST_BYTES", 2500)
    used = CompiledModules(tmp_path, []).place("here")
    assert sorted(tmp_path.iterdir()) == sorted([tmp_path / "0", tmp_path / "1", used])
    assert not left.exists()


@pytest.mark.parametrize("home", ["", "file/here"])
def test_modules_are_not_stored_without_a_folder(tmp_path, home):
    (tmp_path / "file").touch()
    cache = KernelCache(tmp_path / home / "kernels" if home else None)
    try:
        assert cache.modules.place("here") is None
        cache.modules.seal()
    finally:
        cache.close()
