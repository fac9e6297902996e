"""Compiled kernels kept from one process to the next, each in a file of its own with a checksum.

What earlier processes kept is checked and copied to a folder of this process alone, where slangpy works with it; what
is compiled meanwhile is kept at once.  So a damaged file is noticed before anything trusts it, processes that run at
the same time don't disturb each other, and where files can't be kept, all goes on without.
"""

from __future__ import annotations

import atexit
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from hashlib import sha256
from pathlib import Path

from elvis.core.files.scratch import scratch
from elvis.renderer.kernel_database import DatabaseError, content, fill

#: how a file begins; then come the SHA-256 of all that follows, the length of the key in two bytes, key and kernel
MARK = b"elvis kernel 1\n"
#: most bytes of kernels that are kept: those that were not used for longest go
MOST_BYTES = 48 << 20
#: seconds after which a use is noted, and after which what a killed process has left is removed
_DAY, _HOUR = 86400.0, 3600.0


class KernelCache:
    """The compiled kernels of this process.

    kept_in  folder of the files; None where there is none
    private  folder of slangpy's database; None where there is no room for one, and kernels are in memory alone
    remarks  what the user should know
    """

    def __init__(self, kept_in: Path | None) -> None:
        """Bring what was kept to a private folder."""
        self.kept_in = kept_in
        self._until_exit = ExitStack()
        self.remarks: list[str] = []
        self._known: dict[bytes, Path] = {}
        if kept_in is None:
            self.remarks.append("compiled kernels are not kept: there is no home folder, and no XDG_CACHE_HOME")
        self.private = self._private_folder()
        if self.private is None:
            self.remarks.append("compiled kernels are in memory alone: there is no temporary folder to write to")
        else:
            self._fill(self.private)

    def keep(self) -> None:
        """Write the kernels that are new to files, and note which others were used; nobody may compile meanwhile."""
        if self.private is None or self.kept_in is None:
            return
        try:
            new, used = content(self.private, set(self._known))
            for key, kernel in new.items():
                self._known[key] = _write(self.kept_in, key, kernel)
        except (OSError, DatabaseError) as error:
            self._give_up((error.strerror if isinstance(error, OSError) else None) or str(error))
            return
        for key in used & self._known.keys():
            with suppress(OSError):
                if self._known[key].stat().st_mtime < time.time() - _DAY:
                    os.utime(self._known[key])

    def _private_folder(self) -> Path | None:
        """A new folder that is removed when the process ends."""
        try:
            folder = self._until_exit.enter_context(scratch(Path(tempfile.gettempdir()))) / "new"
            (folder / "rhi").mkdir()
        except OSError:
            return None
        return folder

    def _fill(self, folder: Path) -> None:
        """Bring what was kept to a database."""
        try:
            fill(folder, self._sound())
        except DatabaseError as error:
            self._give_up(str(error))

    def _give_up(self, reason: str) -> None:
        """Keep nothing from now on."""
        self.remarks.append(f"compiled kernels can't be kept in {self.kept_in}: {reason}")
        self.kept_in = None

    def close(self) -> None:
        """Note what was used, and leave nothing behind."""
        self.keep()
        self._until_exit.close()

    def _sound(self) -> Iterator[tuple[bytes, bytes]]:
        """Keys and kernels of all files that are as they were written; damaged ones are set aside."""
        damaged = 0
        for path in self._files():
            try:
                entry = _parsed(path.read_bytes())
            except OSError:
                continue
            if entry is None:
                damaged += 1
                with suppress(OSError):
                    path.replace(path.with_suffix(".damaged"))
            else:
                self._known[entry[0]] = path
                yield entry
        if damaged:
            self.remarks.append(
                f"compiled kernels in {self.kept_in} that were damaged, set aside and made again when needed: {damaged}"
            )

    def _files(self) -> list[Path]:
        """Files of kernels, the last used first; those that there is no room for, and what is stale, are removed."""
        found: list[tuple[float, int, Path]] = []
        with suppress(OSError):
            for item in os.scandir(self.kept_in or os.devnull):
                about = item.stat()
                found.append((-about.st_mtime, about.st_size, Path(item.path)))
        files, room = [], MOST_BYTES
        for age, size, path in sorted(found):
            room -= size
            stale = path.suffix not in (".kernel", ".damaged") and -age < time.time() - _HOUR
            if path.is_file() and (room < 0 or stale):
                with suppress(OSError):
                    path.unlink()
            elif path.suffix == ".kernel":
                files.append(path)
        return files


_caches: dict[tuple[int, Path | None], KernelCache] = {}


def kernel_cache() -> KernelCache:
    """The cache of this process; a forked one has its own."""
    key = os.getpid(), cache_folder()
    if key not in _caches:
        _caches[key] = KernelCache(key[1])
    return _caches[key]


def cache_folder() -> Path | None:
    """Where kernels are kept: in $XDG_CACHE_HOME or ~/.cache; as its specification says, a relative one is ignored."""
    folder = os.environ.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(folder):
        # without HOME the system's list of users tells; an empty one would mean the root of all folders
        home = os.path.expanduser("~") if os.environ.get("HOME") != "" else ""
        folder = os.path.join(home, ".cache")
    return Path(folder) / "elvis" / "kernels" if os.path.isabs(folder) else None


@atexit.register
def _finish() -> None:
    """Close the caches of this process, not those of one that it was forked from."""
    for (process, _), cache in _caches.items():
        if process == os.getpid():
            cache.close()


def _write(folder: Path, key: bytes, kernel: bytes) -> Path:
    """Write one kernel; the file takes its name when it is whole."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    path = folder / f"{sha256(key).hexdigest()[:40]}.kernel"
    beside = folder / f"{path.stem}.{os.getpid()}.{os.urandom(3).hex()}"
    rest = len(key).to_bytes(2, "little") + key + kernel
    try:
        beside.write_bytes(MARK + sha256(rest).digest() + rest)
        beside.replace(path)
    except OSError:
        with suppress(OSError):
            beside.unlink()
        raise
    return path


def _parsed(data: bytes) -> tuple[bytes, bytes] | None:
    """Key and kernel of a file; None where it isn't as it was written."""
    begin = len(MARK) + 32
    checksum, rest = data[len(MARK) : begin], data[begin:]
    if not data.startswith(MARK) or sha256(rest).digest() != checksum:
        return None
    end = 2 + int.from_bytes(rest[:2], "little")
    return rest[2:end], rest[end:]
