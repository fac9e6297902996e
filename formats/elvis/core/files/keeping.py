"""Cached results of earlier processes, each in a file of its own with a checksum, in the user's cache.

A file begins with a mark that identifies its kind; then come the SHA-256 of the rest, the length of the key in two
bytes, the key and the content.  A file takes its name when it is complete, so simultaneous processes don't disturb each
other; a damaged file is detected before use, and set aside.
"""

from __future__ import annotations

import os
import stat
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from hashlib import file_digest, sha256
from io import BufferedReader
from itertools import chain
from pathlib import Path
from typing import BinaryIO

#: bytes of the checksum, and of the length of the key
_CHECKSUM, _LENGTH = 32, 2
#: seconds after which a use is noted, and after which what a killed process has left is removed
_DAY, _HOUR = 86400.0, 3600.0
_DAMAGED = ".damaged"
#: bytes of a file that are read at once
_BLOCK = 1 << 20


def cache_folder(name: str) -> Path | None:
    """Folder for cached results of a kind, in $XDG_CACHE_HOME or ~/.cache; None if neither exists.

    A relative $XDG_CACHE_HOME is ignored, as its specification requires.
    """
    folder = os.environ.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(folder):
        # without HOME, the system's list of users decides; an empty HOME would mean the root folder
        home = os.path.expanduser("~") if os.environ.get("HOME") != "" else ""
        folder = os.path.join(home, ".cache")
    return Path(folder) / "elvis" / name if os.path.isabs(folder) else None


def kept_files(name: str) -> tuple[int, int]:
    """Number and bytes of the cached files of a kind."""
    folder = cache_folder(name)
    sizes: list[int] = []
    if folder is not None:
        with suppress(OSError), os.scandir(folder) as entries:
            for entry in entries:
                with suppress(OSError):
                    if entry.is_file(follow_symlinks=False):
                        sizes.append(entry.stat(follow_symlinks=False).st_size)
    return len(sizes), sum(sizes)


def make_private(folder: Path) -> None:
    """Make a folder, and missing folders above it, accessible only to the owner; raises OSError on failure."""
    missing = [own for own in (folder, *folder.parents) if not own.exists()]
    for own in reversed(missing):
        own.mkdir(mode=0o700, exist_ok=True)


def _blocks(part: bytes | Path) -> Iterator[bytes]:
    """The bytes of a part of a result, block by block if they are in a file."""
    if isinstance(part, bytes):
        yield part
        return
    with part.open("rb") as file:
        while block := file.read(_BLOCK):
            yield block


def _copied(parts: Iterable[bytes | Path], file: BinaryIO) -> bytes:
    """Write parts one after another; the SHA-256 of all."""
    total = sha256()
    for block in chain.from_iterable(map(_blocks, parts)):
        total.update(block)
        file.write(block)
    return total.digest()


def _check_own(path: Path) -> int:
    """The size of a regular file of this user or of the system's; OSError for any other."""
    about = os.stat(path)
    if not stat.S_ISREG(about.st_mode):
        raise OSError(f"{path} is not a regular file")
    if hasattr(os, "geteuid") and about.st_uid not in (os.geteuid(), 0):
        raise OSError(f"{path} belongs to another user")
    return about.st_size


def _set_aside(path: Path) -> None:
    """Give a damaged file another name."""
    with suppress(OSError):
        path.replace(path.with_suffix(_DAMAGED))


@dataclass(frozen=True)
class Store:
    """The cached results of one kind in a folder, which need not exist.

    kind  one word, the suffix of its files
    most  maximum bytes of all files; the least recently used ones are removed
    """

    folder: Path
    kind: str
    most: int

    @property
    def mark(self) -> bytes:
        """The beginning of its files."""
        return f"elvis {self.kind} 1\n".encode()

    def place(self, key: bytes) -> Path:
        """The file of the result with this key."""
        return self.folder / f"{sha256(key).hexdigest()[:40]}.{self.kind}"

    def write(self, key: bytes, *content: bytes | Path) -> Path:
        """Keep a result, in a file that takes its name when it is whole; raises OSError if that can't be.

        content  in parts, one after another: bytes, or files whose bytes are copied
        """
        path = self.place(key)
        parts = (len(key).to_bytes(_LENGTH, "little"), key, *content)
        with self._replacing(path) as beside, beside.open("wb") as file:
            file.write(self.mark + bytes(_CHECKSUM))
            total = _copied(parts, file)
            file.seek(len(self.mark))
            file.write(total)
        return path

    def write_beside(self, key: bytes, source: Path) -> str:
        """Keep a file next to a result, so that it can be mapped; its SHA-256, which the result has to hold.

        The file must not change afterwards: it is only copied from another file system.  Raises OSError if that can't
        be.
        """
        with self._replacing(self.place_beside(key, source.name)) as beside:
            try:
                os.link(source, beside)
            except OSError:
                with beside.open("wb") as file:
                    return _copied([source], file).hex()
        with source.open("rb") as file:
            return file_digest(file, "sha256").hexdigest()

    def place_beside(self, key: bytes, name: str) -> Path:
        """The file of this name next to the result with this key."""
        return self.folder / f"{self.place(key).stem}-{name}.{self.kind}"

    def found_beside(self, key: bytes, name: str, checksum: str) -> Path | None:
        """That file; None if it isn't as it was written, then it is set aside.

        Raises OSError as `read` does.
        """
        path = self.place_beside(key, name)
        _check_own(path)
        with path.open("rb") as file:
            is_whole = file_digest(file, "sha256").hexdigest() == checksum
        if not is_whole:
            _set_aside(path)
        return path if is_whole else None

    @contextmanager
    def _replacing(self, path: Path) -> Iterator[Path]:
        """The path of a temporary file, which is renamed at the end of the block; an error removes it."""
        make_private(self.folder)
        beside = self.folder / f"{path.stem}.{os.getpid()}.{os.urandom(3).hex()}"
        try:
            yield beside
            beside.replace(path)
        except OSError:
            with suppress(OSError):
                beside.unlink()
            raise

    def read(self, path: Path) -> tuple[bytes, bytes] | None:
        """Key and content of a file; None if it isn't as it was written, then it is set aside.

        Raises OSError if it can't be read, or another user than this one and the system's has written it.
        """
        with self.opened(path) as entry:
            return None if entry is None else (entry[0], entry[1].read())

    @contextmanager
    def opened(self, path: Path) -> Iterator[tuple[bytes, BinaryIO] | None]:
        """As `read`, with the file at the beginning of its content instead of the content."""
        size = _check_own(path)
        with open(path, "rb") as file:
            entry = self.parsed(file) if size <= 2 * self.most else None
            yield entry
        if entry is None:
            _set_aside(path)

    def parsed(self, file: BufferedReader) -> tuple[bytes, BinaryIO] | None:
        """The key in a file, and the file at the beginning of its content; None if it isn't as it was written."""
        mark, checksum = file.read(len(self.mark)), file.read(_CHECKSUM)
        begin, total = file.tell(), file_digest(file, "sha256")
        if mark != self.mark or total.digest() != checksum:
            return None
        file.seek(begin)
        return file.read(int.from_bytes(file.read(_LENGTH), "little")), file

    def remove(self, key: bytes) -> None:
        """Remove the result with this key, and the files next to it, as far as the system allows."""
        for path in self.folder.glob(f"{self.place(key).stem}*.{self.kind}"):
            with suppress(OSError):
                path.unlink()

    def note_use(self, path: Path) -> None:
        """Let a file that was used count as new; once a day is enough."""
        with suppress(OSError):
            if path.stat().st_mtime < time.time() - _DAY:
                os.utime(path)

    def files(self) -> list[Path]:
        """The files, the most recently used first; stale files and files beyond the limit are removed."""
        found: list[tuple[float, int, Path]] = []
        with suppress(OSError):
            for item in os.scandir(self.folder):
                about = item.stat()
                found.append((-about.st_mtime, about.st_size, Path(item.path)))
        files, room, suffix = [], self.most, f".{self.kind}"
        for age, size, path in sorted(found):
            room -= size
            is_stale = path.suffix not in (suffix, _DAMAGED) and -age < time.time() - _HOUR
            if (room < 0 or is_stale) and path.is_file():
                with suppress(OSError):
                    path.unlink()
            elif path.suffix == suffix:
                files.append(path)
        return files
