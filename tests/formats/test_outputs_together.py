"""Several outputs as a unit: all take their places or none, whatever stops the run."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.files import output, replacement, scratch
from elvis.core.files.output import Outputs, check_places, write_text

#: what stands before and after a run that writes a file over an old one, a new one and a folder, and removes a file
BEFORE = {"a": "old a", "report/x": "old x", "report/y": "old y", "stale": "old s"}
AFTER = {"a": "new a", "b": "new b", "report/x": "new x"}


def prepare(folder):
    (folder / "report").mkdir(parents=True)
    for name, text in BEFORE.items():
        (folder / name).write_text(text)


def write_all(folder):
    with Outputs() as outputs:
        for name in "ab":
            with outputs.file(folder / name) as temporary:
                temporary.write_text(f"new {name}")
        with outputs.folder(folder / "report") as temporary:
            (temporary / "x").write_text("new x")
        outputs.remove(folder / "stale")


def state(folder):
    return {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*") if path.is_file()}


def finished(folder):
    """What stands there once another run has written next to it."""
    write_text(folder / "later", "")
    (folder / "later").unlink()
    return state(folder)


@pytest.fixture(params=["at once", "one after the other"])
def swapping(request, monkeypatch):
    """Folders are exchanged in one step, or renamed twice where a system can't do that."""
    if request.param == "one after the other":
        monkeypatch.setattr(replacement, "exchange", lambda one, other: False)
    elif not _exchanges():
        pytest.skip("this file system does not exchange folders")


def _exchanges():
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        for name in "ab":
            Path(folder, name).mkdir()
        return replacement.exchange(Path(folder, "a"), Path(folder, "b"))


def test_all_take_their_places_at_the_end(tmp_path, swapping):
    prepare(tmp_path)
    write_all(tmp_path)
    assert state(tmp_path) == AFTER
    assert sorted(os.listdir(tmp_path)) == ["a", "b", "report"]


def test_a_link_is_removed_without_its_target(tmp_path):
    (tmp_path / "data").write_text("data")
    (tmp_path / "stale").symlink_to("data")
    with Outputs() as outputs:
        outputs.remove(tmp_path / "stale")
    assert os.listdir(tmp_path) == ["data"]


def test_nothing_changes_before_the_commit(tmp_path):
    prepare(tmp_path)
    with Outputs() as outputs, outputs.file(tmp_path / "a") as temporary:
        temporary.write_text("new")
        assert {name: text for name, text in state(tmp_path).items() if ".elvis-" not in name} == BEFORE
    assert state(tmp_path) == {**BEFORE, "a": "new"}


@pytest.mark.parametrize("failing", ["a", "b", "stale"])
def test_one_that_fails_leaves_all(tmp_path, failing):
    """Each in turn as the last: something that can't be replaced comes into its place while the others are written."""
    prepare(tmp_path)
    order = [name for name in ("a", "b", "fresh") if name != failing] + [failing]
    (tmp_path / failing).unlink(missing_ok=True)

    def write():
        with Outputs() as outputs:
            for name in order:
                with outputs.file(tmp_path / name) as temporary:
                    temporary.write_text("new")
            (tmp_path / failing).mkdir()

    with pytest.raises(ElvisError, match=f"{failing}: cannot be written: "):
        write()
    (tmp_path / failing).rmdir()
    assert state(tmp_path) == {name: text for name, text in BEFORE.items() if name != failing}


@pytest.mark.parametrize("name", ["flock", "rmtree", "unlink"])
def test_an_interrupt_leaves_no_scratch_folder(tmp_path, monkeypatch, name):
    """Ctrl-C comes at the first call that locks the folder, or that removes parts of it."""
    owner = {"flock": scratch.fcntl, "rmtree": scratch.shutil, "unlink": Path}[name]
    original, interrupts = getattr(owner, name), iter([KeyboardInterrupt])

    def interrupted(*arguments, **keywords):
        for error in interrupts:
            raise error
        return original(*arguments, **keywords)

    monkeypatch.setattr(owner, name, interrupted)
    with pytest.raises(KeyboardInterrupt), Outputs() as outputs, outputs.file(tmp_path / "a") as temporary:
        temporary.write_text("new")
    assert [own for own in os.listdir(tmp_path) if own.startswith(".elvis-")] == []


OPERATIONS = ("link", "rename", "replace")


@pytest.mark.parametrize("moment", ["before", "after"])
@pytest.mark.parametrize("number", range(1, 8))
def test_an_interrupt_while_names_change(tmp_path, monkeypatch, swapping, number, moment):
    """All is old or all is new, wherever Ctrl-C comes between two operations."""
    prepare(tmp_path)
    left = [number]

    def counted(operation):
        def run(*arguments):
            left[0] -= 1
            if left[0] == 0 and moment == "before":
                raise KeyboardInterrupt
            operation(*arguments)
            if left[0] == 0:
                raise KeyboardInterrupt

        return run

    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    for name in OPERATIONS:
        monkeypatch.setattr(os, name, counted(getattr(os, name)))
    interrupted = False
    try:
        write_all(tmp_path)
    except KeyboardInterrupt:
        interrupted = True
    monkeypatch.undo()
    assert interrupted == (left[0] <= 0)
    assert state(tmp_path) in (BEFORE, AFTER)
    assert finished(tmp_path) == state(tmp_path)


KILLED = """
import json, os, signal, sys
from pathlib import Path
from tempfile import TemporaryDirectory
sys.path.insert(0, {tests!r})
from test_outputs_together import prepare, finished, state, write_all

def run(folder, number):
    child = os.fork()
    if child == 0:
        count = [0]
        def hook(event, arguments):
            if event.startswith(("os.", "open", "shutil.", "fcntl.", "ctypes.")):
                count[0] += 1
                if count[0] == number:
                    os.kill(os.getpid(), signal.SIGKILL)
        sys.addaudithook(hook)
        write_all(folder)
        os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])

# in memory where there is such a place: disks are slow to sync
place = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
found, number, killed = [], 0, True

# once before, for what is imported at first use is no operation of ours
with TemporaryDirectory(dir=place) as warm:
    prepare(Path(warm))
    write_all(Path(warm))
while killed:
    number += 1
    with TemporaryDirectory(dir=place) as folder:
        folder = Path(folder)
        prepare(folder)
        killed = run(folder, number)
        at_once = {{name: text for name, text in state(folder).items() if ".elvis-" not in name}}
        found.append((at_once, finished(folder), os.listdir(folder)))
print(json.dumps(found))
"""


def test_a_kill_at_any_operation_leaves_whole_files():
    """Processes that die before their first, second, ... operation: each file is old or new, and nothing else is left.

    Only names may be of two kinds, as no system renames several files at once.
    """
    code = KILLED.format(tests=str(Path(__file__).parent))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert len(found) > 30
    for at_once, later, names in found:
        assert at_once["a"] in ("old a", "new a")
        assert set(at_once) - set(AFTER) <= {"stale", "report/y"}
        assert not [name for name in names if name.startswith(".elvis-")]
        assert set(later) >= {"a", "report/x"}
        for name, text in later.items():
            assert text in (BEFORE.get(name), AFTER.get(name))
        assert {"x": later["report/x"], "y": later.get("report/y")} in (
            {"x": "old x", "y": "old y"},
            {"x": "new x", "y": None},
        )
        assert "stale" in later or later["a"] == "new a"
    assert found[-1][1] == AFTER


def test_files_of_a_running_process_are_untouched(tmp_path):
    with Outputs() as outputs, outputs.file(tmp_path / "long") as temporary:
        temporary.write_text("half")
        write_text(tmp_path / "short", "whole")
        assert temporary.read_text() == "half"
    assert state(tmp_path) == {"long": "half", "short": "whole"}


def test_only_scratch_folders_of_elvis_are_leftovers(tmp_path):
    for name in (".elvis-0123456789ab.tmp", ".elvis-short.tmp", "elvis-0123456789ab.tmp", ".elvis-0123456789ab.tmp2"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "new").write_text("")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "new").write_text("")
    (tmp_path / ".elvis-0123456789ac.tmp").symlink_to(tmp_path / "elsewhere")
    (tmp_path / ".elvis-0123456789ad.tmp").write_text("a file")
    scratch.remove_leftovers(tmp_path)
    assert sorted(os.listdir(tmp_path)) == [
        ".elvis-0123456789ab.tmp2",
        ".elvis-0123456789ac.tmp",
        ".elvis-0123456789ad.tmp",
        ".elvis-short.tmp",
        "elsewhere",
        "elvis-0123456789ab.tmp",
    ]
    assert (tmp_path / "elsewhere" / "new").exists()


def test_a_scratch_folder_removed_as_leftover_is_recreated(tmp_path, monkeypatch):
    """Another run may see a new scratch folder before it is locked: remove it, or hold its lock and then do so."""
    lock, made = scratch._lock, []

    def robbed(own):
        made.append(own)
        if len(made) == 1:
            scratch.shutil.rmtree(own)
        held = lock(own) if len(made) == 2 else None
        try:
            return lock(own)
        finally:
            if held is not None:
                scratch._discard(own, held)

    monkeypatch.setattr(scratch, "_lock", robbed)
    write_text(tmp_path / "a", "text")
    assert len(made) == 3
    assert state(tmp_path) == {"a": "text"}


def test_a_folder_being_removed_cannot_be_locked(tmp_path, monkeypatch):
    """Whoever opened its lock before that finds it gone; a lock that is made once it is free keeps the folder."""
    close, found = os.close, []

    def closed(lock):
        close(lock)
        if not found and not (made / "lock").exists():
            found.append(scratch._lock(made))

    with scratch.scratch(tmp_path) as made:
        monkeypatch.setattr(os, "close", closed)
    monkeypatch.undo()
    assert made.is_dir()
    scratch._discard(made, found[0])
    assert not os.listdir(tmp_path)


def test_file_systems_without_locks_and_links(tmp_path, monkeypatch):
    def unsupported(*arguments):
        raise OSError(95, "Operation not supported")

    prepare(tmp_path)
    monkeypatch.setattr(scratch.fcntl, "flock", unsupported)
    monkeypatch.setattr(os, "link", unsupported)
    write_all(tmp_path)
    assert state(tmp_path) == AFTER


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), OSError("the library says: no space left")])
@pytest.mark.parametrize("kind", ["file", "folder"])
def test_a_full_disk_names_the_file(tmp_path, error, kind):
    with (
        pytest.raises(ElvisError, match=r"^\S*/out: cannot be written: .*[Nn]o space left"),
        Outputs() as outputs,
        getattr(outputs, kind)(tmp_path / "out"),
    ):
        raise error
    assert not os.listdir(tmp_path)


def test_a_disk_that_is_full_only_when_synced(tmp_path, monkeypatch):
    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ElvisError, match=r"out: cannot be written: No space left on device"):
        write_text(tmp_path / "out", "text")
    assert not os.listdir(tmp_path)


def test_errors_of_other_files_name_them(tmp_path):
    with pytest.raises(FileNotFoundError, match="data"), output.replacing(tmp_path / "out"):
        (tmp_path / "data").read_text()


def test_everything_reaches_the_disk_before_any_name_changes(tmp_path, monkeypatch):
    prepare(tmp_path)
    done = []
    for name in ("fsync", "link", "replace", "rename"):
        operation = getattr(os, name)
        monkeypatch.setattr(os, name, lambda *a, name=name, run=operation: (done.append(name), run(*a)))
    write_all(tmp_path)
    first = min(done.index(name) for name in ("link", "replace"))
    assert done[:first] == ["fsync"] * 4  # three files, and the names in the folder
    assert done[-1] == "fsync"


def test_a_power_loss_at_any_operation_leaves_whole_files(tmp_path, monkeypatch, swapping):
    """A disk keeps what was synced: whenever a name changes, all that it stands for was, names in folders included."""
    prepare(tmp_path)
    kept = {path.stat().st_ino for path in tmp_path.rglob("*")}
    faults = []

    def synced(descriptor, run=os.fsync):
        run(descriptor)
        kept.add(os.fstat(descriptor).st_ino)

    def changed(run):
        def operation(*arguments, **keywords):
            result = run(*arguments, **keywords)
            standing = [path for path in tmp_path.rglob("*") if ".elvis-" not in str(path)]
            faults.extend(path for path in standing if path.lstat().st_ino not in kept)
            return result

        return operation

    monkeypatch.setattr(os, "fsync", synced)
    for name in ("link", "replace", "rename"):
        monkeypatch.setattr(os, name, changed(getattr(os, name)))
    with Outputs() as outputs:
        with outputs.file(tmp_path / "new.txt") as file:
            file.write_text("new")
        with outputs.folder(tmp_path / "nested") as folder:
            (folder / "below").mkdir()
            (folder / "below" / "deep.txt").write_text("deep")
    write_all(tmp_path)
    assert faults == []
    assert (tmp_path / "nested" / "below" / "deep.txt").read_text() == "deep"


@pytest.mark.parametrize("other", ["a", "./a", "link", "sub/../a"])
def test_one_name_for_two_outputs(tmp_path, monkeypatch, other):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    (tmp_path / "link").symlink_to("a")
    sentence = "is to be written twice"
    with pytest.raises(ElvisError, match=sentence):
        check_places(["a", other])
    with pytest.raises(ElvisError, match=sentence), Outputs() as outputs, outputs.file("a"), outputs.file(other):
        pass
    assert sorted(os.listdir(tmp_path)) == ["link", "sub"]


def test_inputs_are_not_outputs(tmp_path):
    (tmp_path / "data").mkdir()
    for name in ("in", "data/in"):
        (tmp_path / name).write_text("input")
    (tmp_path / "soft").symlink_to("in")
    os.link(tmp_path / "in", tmp_path / "hard")
    inputs = [tmp_path / "in", tmp_path / "data", tmp_path / "absent"]
    for name, what in (("in", "it is an input"), ("soft", "it is the input"), ("hard", "it is the input")):
        with pytest.raises(ElvisError, match=f"{name}: not written: {what}.*--overwrite"):
            check_places([tmp_path / "new", tmp_path / name], inputs)
        check_places([tmp_path / name], inputs, overwrite=True)
    with pytest.raises(ElvisError, match="it lies in the input"):
        check_places([tmp_path / "data" / "in"], inputs)
    check_places([tmp_path / "new", tmp_path / "data" / "new"], inputs)


def test_write_protection_is_detected_before_writing(tmp_path, monkeypatch):
    (tmp_path / "kept").write_text("")
    protected = {tmp_path / "kept"}
    access = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) not in protected and access(path, mode))
    with pytest.raises(ElvisError, match="kept: cannot be written: it is write-protected"):
        check_places([tmp_path / "kept"])
    protected.add(tmp_path)
    with pytest.raises(ElvisError, match=r"new: cannot be written: the folder .* is write-protected"):
        check_places([tmp_path / "new"])


def test_files_that_cannot_be_restored_are_left(tmp_path, monkeypatch):
    """A killed run had set a file aside, which the next one may not move."""
    leftover = tmp_path / ".elvis-0123456789ab.tmp"
    (leftover / "old").mkdir(parents=True)
    (leftover / "old" / "a").write_text("old a")

    def refuse(*arguments):
        raise PermissionError(1, "Operation not permitted")

    with monkeypatch.context() as patch:
        patch.setattr(os, "rename", refuse)
        scratch.remove_leftovers(tmp_path)
    assert (leftover / "old" / "a").read_text() == "old a"
    scratch.remove_leftovers(tmp_path)
    assert state(tmp_path) == {"a": "old a"}
