"""Slang modules in the compiler's binary form, cached between processes.

Reading the sources of a picture's modules takes longer than loading its cached kernels.  A session of slangpy writes
each module that it has read from its source to a folder, and reads it from there as long as the digest in it matches
its sources (Slang's option UseUpToDateBinaryModule).  Unlike the folder of kernels, this folder can't belong to one
process: its name is in their keys.  Slang trusts the contents, so each module has the SHA-256 of its name and content
next to it, and a module with none, or with another one, is removed before a session begins.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from shutil import rmtree

from elvis.core.base.errors import ElvisError
from elvis.core.files.keeping import make_private
from elvis.core.files.output import write_text

#: most bytes of modules that are retained: folders that were not used for longest go
MOST_BYTES = 48 << 20
#: how files end: modules, and their checksums
_MODULE, _CHECKSUM = ".slang-module", ".sha256"
#: how the empty files end that are named after linked kernels
_LINKED = ".linked"
#: bytes of a RIFF file that precede the counted ones
_HEAD = 8
#: seconds after which what a process that was ended has left is removed
_HOUR = 3600.0


class CompiledModules:
    """The compiled modules that this process shares with others."""

    def __init__(self, kept_in: Path | None, remarks: list[str]) -> None:
        """A cache that has not been read yet.

        kept_in  the folder of all modules; None if nothing can be cached
        remarks  receives messages for the user
        """
        self._kept_in, self._remarks = kept_in, remarks
        self._used: set[Path] = set()
        #: sound modules, and when they were written
        self._sound: dict[Path, int] = {}

    def place(self, *about: object) -> Path | None:
        """The folder for sessions that are alike in ``about``, where each module is as it was written.

        None where there can be none.
        """
        if self._kept_in is None:
            return None
        folder = self._kept_in / sha256(repr(about).encode()).hexdigest()[:20]
        try:
            make_private(folder)
            os.utime(folder)
            damaged = self._remove_unsound(folder)
        except OSError:
            return None
        if damaged:
            self._remarks.append(f"damaged compiled modules in {folder}, removed and rebuilt: {damaged}")
        self._used.add(folder)
        _remove_unused(self._kept_in, self._used)
        return folder

    def seal(self) -> None:
        """Write the checksums of new modules; modules without a checksum are rebuilt."""
        for path in (path for folder in self._used for path in _modules(folder)):
            with suppress(OSError, ElvisError):
                written = path.stat().st_mtime_ns
                if self._sound.get(path) != written:
                    _seal(path)
                    self._sound[path] = written

    def _remove_unsound(self, folder: Path) -> int:
        """Remove modules that aren't as they were written; how many have another checksum, and not only none.

        OSError where one can't be removed.
        """
        damaged = 0
        for path in _modules(folder):
            written, known = path.stat().st_mtime_ns, _known_checksum(path)
            if known == _checksum(path, path.read_bytes()):
                self._sound[path] = written
                continue
            path.unlink(missing_ok=True)
            path.with_suffix(_CHECKSUM).unlink(missing_ok=True)
            damaged += bool(known)
        return damaged


class LinkedKernels:
    """Names of kernels that were linked before, as empty files next to the modules.

    They say that a kernel is probably cached; nothing relies on it.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    def is_known(self, name: str) -> bool:
        """Whether a kernel of this name was linked before."""
        return self._folder is not None and (self._folder / f"{name}{_LINKED}").exists()

    def note(self, name: str) -> None:
        """Remember a name, if there is a folder."""
        if self._folder is not None and not self.is_known(name):
            with suppress(OSError):
                (self._folder / f"{name}{_LINKED}").touch()


def _modules(folder: Path) -> Iterator[Path]:
    """The files of modules in a folder, and in those in it."""
    return folder.rglob(f"*{_MODULE}")


def _known_checksum(path: Path) -> str:
    """The checksum next to a module, empty if there is none."""
    try:
        return path.with_suffix(_CHECKSUM).read_text(encoding="ascii")
    except (OSError, ValueError):
        return ""


def _checksum(path: Path, content: bytes) -> str:
    """The checksum of a module with its name, so that it can't be confused with another one."""
    return sha256(path.name.encode() + b"\n" + content).hexdigest()


def _seal(path: Path) -> None:
    """Write the checksum of a module that is whole; ElvisError, or OSError, where that can't be."""
    content = path.read_bytes()
    if _is_whole(content):
        write_text(path.with_suffix(_CHECKSUM), _checksum(path, content))


def _is_whole(content: bytes) -> bool:
    """Whether as many bytes follow as the head of a RIFF file says."""
    return content.startswith(b"RIFF") and int.from_bytes(content[4:_HEAD], "little") == len(content) - _HEAD


def _remove_unused(kept_in: Path, used: set[Path]) -> None:
    """Remove the least recently used folders beyond the size limit, and unfinished ones."""
    ages = {}
    with suppress(OSError):
        ages = {Path(item.path): item.stat().st_mtime for item in os.scandir(kept_in)}
    room = MOST_BYTES
    for folder in sorted(ages, key=ages.__getitem__, reverse=True):
        for path in folder.rglob("*.*"):
            with suppress(OSError):
                about = path.stat()
                is_stale = path.suffix not in (_MODULE, _CHECKSUM, _LINKED) and about.st_mtime < time.time() - _HOUR
                room -= about.st_size
                if is_stale and path.is_file():
                    path.unlink()
        if room < 0 and folder not in used:
            rmtree(folder, ignore_errors=True)
