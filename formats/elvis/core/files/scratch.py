"""Scratch folders: where outputs are written before they take their places, on the same file system as these.

A scratch folder lies next to the outputs, is named ``.elvis-XXXXXXXXXXXX.tmp`` and holds

    lock   locked as long as its process lives: the system frees the lock even of a process that is killed
    new/   what is being written, under its final name
    old/   what stood in the places of the new, until all of these have theirs

The next run that writes into the same folder removes the remains of a killed one.  Locks, unlike process numbers, also
work across containers and, if the file system has locks, across machines.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # on Windows: folders are not locked there, so leftovers stay
    fcntl = None  # type: ignore[assignment]

_NAME = re.compile(r"\.elvis-[0-9a-f]{12}\.tmp")
#: tries to make a folder before another process takes it for a leftover
_TRIES = 8


@contextmanager
def scratch(folder: Path) -> Iterator[Path]:
    """A new scratch folder in ``folder``, without the leftovers of killed runs; it is removed when the block ends.

    Raises OSError where no folder can be made.
    """
    remove_leftovers(folder)
    own, lock = _make_folder(folder)
    try:
        (own / "new").mkdir()
        (own / "old").mkdir()
        yield own
    finally:
        _discard(own, lock)


def remove_leftovers(folder: Path) -> None:
    """Remove the scratch folders in ``folder`` whose processes have ended.

    Put back the files that they had set aside.
    """
    for leftover in _leftovers(folder):
        lock = _locked(leftover)
        if lock is None:
            continue
        try:
            _put_back(leftover, folder)
        except OSError:
            os.close(lock)  # it stays, for a run that may do so
            continue
        _discard(leftover, lock)


def _leftovers(folder: Path) -> list[Path]:
    """Our own scratch folders in ``folder``, also those in use."""
    try:
        with os.scandir(folder) as entries:
            found = [entry for entry in entries if _NAME.fullmatch(entry.name)]
            return [Path(entry.path) for entry in found if _is_own_folder(entry)]
    except OSError:
        return []


def _is_own_folder(entry: os.DirEntry[str]) -> bool:
    is_folder = entry.is_dir(follow_symlinks=False)
    return is_folder and hasattr(os, "geteuid") and entry.stat(follow_symlinks=False).st_uid == os.geteuid()


def _make_folder(folder: Path) -> tuple[Path, int | None]:
    """A new scratch folder and its lock, which is None if the file system has none."""
    for _ in range(_TRIES):
        own = folder / f".elvis-{os.urandom(6).hex()}.tmp"
        own.mkdir(mode=0o700)
        try:
            return own, _lock(own)
        except (BlockingIOError, FileNotFoundError):
            continue  # another process, which came between, took it for a leftover
        except KeyboardInterrupt:
            _discard(own, None)
            raise
        except OSError:
            break
    return own, None


def _locked(own: Path) -> int | None:
    """A descriptor that holds the lock of a scratch folder; None if it can't be had or the folder is gone."""
    try:
        return _lock(own)
    except OSError:
        return None


def _lock(own: Path) -> int:
    """A descriptor that holds the lock of a scratch folder.

    Raises BlockingIOError where another process has it, FileNotFoundError where the folder is gone, and OSError where
    there are no locks.
    """
    if fcntl is None:
        raise OSError("there are no locks")
    path = own / "lock"
    lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # the one that held it before may have removed the folder
        if not os.path.samestat(os.fstat(lock), os.stat(path)):
            raise FileNotFoundError(path)
    except OSError:
        os.close(lock)
        raise
    return lock


def _put_back(leftover: Path, folder: Path) -> None:
    """Return what a killed run had set aside to the places that nothing new has taken."""
    kept = leftover / "old"
    for item in kept.iterdir() if kept.is_dir() else ():
        if not os.path.lexists(folder / item.name):
            os.rename(item, folder / item.name)


def _discard(own: Path, lock: int | None) -> None:
    """Remove a scratch folder and free its lock; the old content goes first, so that it is not put back.

    The name of the lock is removed before it is released.  The creator of the folder, who waits for that lock, then
    finds it gone, and a new lock keeps the folder.  The folder goes last, since network file systems keep open files.
    An interrupt takes effect afterwards.
    """
    try:
        _empty(own)
    except KeyboardInterrupt:
        _empty(own)
        raise
    finally:
        if lock is not None:
            os.close(lock)
        with suppress(OSError):
            own.rmdir()


def _empty(own: Path) -> None:
    """Remove what a scratch folder holds, the lock last."""
    for part in (own / "old", own / "new"):
        shutil.rmtree(part, ignore_errors=True)
        with suppress(OSError):
            part.unlink()
    with suppress(OSError):
        (own / "lock").unlink()
