"""That kernels are compiled is said while it lasts, once, and to people at a terminal alone."""

import os
import shutil
import subprocess
import sys

import pytest

from elvis import Dataset, Shape, write
from elvis.core.testing import approximated, grid
from elvis.renderer.device import announcing
from elvis.renderer.device.announcing import MOMENT, Announcement
from elvis.renderer.device.kernels.cache import KernelCache


@pytest.fixture
def said(monkeypatch):
    """What is announced by a process that begins now."""
    sentences = []
    monkeypatch.setattr(Announcement, "_is_said", False)
    monkeypatch.setattr(announcing, "announce", sentences.append)
    return sentences


def test_it_is_announced_at_once_without_a_cache(said, tmp_path):
    announcement = Announcement(KernelCache(tmp_path), is_slow=True)
    announcement.expect()
    announcement.note(9 * MOMENT)
    announcement.expect()
    assert said == ["compiling kernels once; they are cached"]


def test_short_waits_are_not_announced(said, tmp_path):
    announcement = Announcement(KernelCache(tmp_path), is_slow=False)
    announcement.expect()
    announcement.note(0.4 * MOMENT)
    assert said == []
    announcement.note(0.7 * MOMENT)
    assert said == ["compiling kernels once; they are cached"]


def test_it_is_announced_each_time_if_kernels_cannot_be_cached(said):
    announcement = Announcement(KernelCache(None), is_slow=True)
    announcement.expect()
    assert said == ["compiling kernels"]


@pytest.fixture(scope="module")
def square(tmp_path_factory):
    bare = Dataset(grid(Shape.QUADRILATERAL, 1))
    field = approximated(bare, "u", lambda x: x[:, 0], modes=3)
    return write(Dataset(bare.mesh, (field,)), tmp_path_factory.mktemp("square") / "square.xml")


@pytest.mark.thorough
@pytest.mark.skipif(os.name != "posix", reason="terminals are made by pty")
def test_only_a_terminal_gets_the_first_announcement(square, tmp_path, renderer):
    import pty

    renderer("vulkan")
    command = [
        sys.executable,
        "-c",
        "from elvis.plugins.command.command import main; main()",
        "render",
        *map(str, square),
    ]
    command += ["--size", "16x12", "--device", "vulkan", "--overwrite", "-o", str(tmp_path / "a.png")]
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}

    def at_terminal():
        terminal, end = pty.openpty()
        done = subprocess.run(command, env=environment, stderr=end, stdout=subprocess.PIPE, check=True)
        os.close(end)
        heard = os.read(terminal, 1 << 16)
        os.close(terminal)
        assert done.stdout == b""
        return heard

    assert b"elvis: compiling kernels once" in at_terminal()
    assert b"compiling" not in at_terminal()
    # what kernels are compiled of is there still
    shutil.rmtree(tmp_path / "cache" / "elvis" / "kernels")
    piped = subprocess.run(command, env=environment, capture_output=True, check=True)
    assert (piped.stdout, piped.stderr) == (b"", b"")
