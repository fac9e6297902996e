"""Results that are retained: found again where they are whole, and never trusted where they are not."""

import os
import subprocess
import sys
import time
from io import BufferedReader, BytesIO
from pathlib import Path

import pytest

from elvis.core.files.keeping import Store, cache_folder


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "kept", "number", 1 << 20)


def test_cached_results_are_read_again(store):
    path = store.write(b"pi", b"3.14")
    assert path == store.place(b"pi")
    assert store.read(path) == (b"pi", b"3.14")
    assert store.files() == [path]
    assert store.folder.stat().st_mode & 0o777 == 0o700


def test_any_changed_bit_is_detected(store):
    whole = store.write(b"key", b"a number").read_bytes()
    key, file = store.parsed(BufferedReader(BytesIO(whole)))
    assert (key, file.read()) == (b"key", b"a number")
    for bit in range(8 * len(whole)):
        wrong = bytearray(whole)
        wrong[bit // 8] ^= 1 << bit % 8
        assert store.parsed(BufferedReader(BytesIO(wrong))) is None
    assert all(store.parsed(BufferedReader(BytesIO(whole[:end]))) is None for end in range(len(whole)))


def test_files_of_another_kind_count_as_damaged(store):
    path = store.write(b"key", b"a number")
    other = Store(store.folder, "letter", 1 << 20)
    assert other.read(path) is None
    assert [each.suffix for each in store.folder.iterdir()] == [".damaged"]


def test_special_files_are_not_opened(store, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, tmp_path / "none"):
        with pytest.raises(OSError, match=r"regular|No such file"):
            store.read(path)


def test_the_least_recently_used_entries_are_evicted(tmp_path):
    store = Store(tmp_path, "number", 3500)
    files = [store.write(bytes([k]), bytes([k]) * 1000) for k in range(5)]
    now = time.time()
    for age, file in enumerate(files):
        os.utime(file, (now - 1000 * age, now - 1000 * age))
    assert store.files() == files[:3]
    assert sorted(tmp_path.iterdir()) == sorted(files[:3])


@pytest.mark.parametrize(
    ("cache_home", "home", "expected"),
    [
        ("/a/b", "/h", "/a/b/elvis/kernels"),
        ("", "/h", "/h/.cache/elvis/kernels"),
        (None, "/h", "/h/.cache/elvis/kernels"),
        ("a/b", "/h", "/h/.cache/elvis/kernels"),
        ("./a", "/h", "/h/.cache/elvis/kernels"),
        (None, "relative", None),
        ("", "", None),
        ("/a", "", "/a/elvis/kernels"),
    ],
)
def test_the_folder_follows_the_base_directory_specification(monkeypatch, cache_home, home, expected):
    """Empty is as if it were not set; a relative path is ignored."""
    monkeypatch.setenv("HOME", home)
    if cache_home is None:
        monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    else:
        monkeypatch.setenv("XDG_CACHE_HOME", cache_home)
    assert cache_folder("kernels") == (None if expected is None else Path(expected))


def test_the_command_lists_the_cache(tmp_path, monkeypatch):
    import json

    from click.testing import CliRunner

    from elvis.plugins.command.command import elvis

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "elvis" / "kernels").mkdir(parents=True)
    (tmp_path / "elvis" / "kernels" / "a.kernel").write_bytes(bytes(1000))
    (tmp_path / "elvis" / "kernels" / "link").symlink_to("/etc/passwd")

    def run(*words):
        return CliRunner().invoke(elvis, ["devices", "--caches", *words], standalone_mode=False).stdout

    kernels, conversions = json.loads(run("--json"))["caches"]
    assert (kernels["folder"], kernels["files"], kernels["bytes"]) == (str(tmp_path / "elvis" / "kernels"), 1, 1000)
    assert (conversions["files"], conversions["bytes"]) == (0, 0)
    assert "0.977 KiB" in run()


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files have no owners")
def test_files_of_another_user_are_not_read(tmp_path, monkeypatch):
    store = Store(tmp_path, "thing", 1000)
    path = store.write(b"key", b"content")
    assert store.read(path) == (b"key", b"content")
    if os.geteuid() == 0:
        os.chown(path, 12345, -1)
    else:
        monkeypatch.setattr("os.geteuid", lambda: path.stat().st_uid + 1)
    with pytest.raises(OSError, match="belongs to another user"):
        store.read(path)


#: a process that writes results under few keys, and reads them
WRITER = """
import sys
from pathlib import Path
from elvis.core.files.keeping import Store

store = Store(Path(sys.argv[1]), "thing", 20_000)
for number in range(200):
    key = b"%d" % (number % 5)
    path = store.write(key, key * 1000)
    try:
        found = store.read(path)
    except FileNotFoundError:  # removed by the other, as there is room for few
        continue
    assert found == (key, key * 1000), found
    store.files()
"""


def test_two_processes_write_one_cache(tmp_path):
    """Each reads what one of them wrote, whole; nothing is left over."""
    command = [sys.executable, "-c", WRITER, str(tmp_path)]
    running = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    assert [each.communicate()[1] for each in running] == ["", ""]
    assert {path.suffix for path in tmp_path.iterdir()} == {".thing"}
