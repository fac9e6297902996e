"""Compiled kernels cached between processes, each in a file of its own with a checksum.

Cached kernels are checked and copied to a private folder of this process, in which slangpy works; newly compiled ones
are cached at once.  So a damaged file is detected before it is used, concurrent processes don't disturb each other, and
if files can't be written, everything works without the cache.
"""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

from elvis.core.base.memory import release_free_memory
from elvis.core.files.keeping import Store, cache_folder
from elvis.core.files.scratch import scratch
from elvis.renderer.device.compiled_modules import CompiledModules
from elvis.renderer.device.kernels.database import SIZE as DATABASE_SIZE
from elvis.renderer.device.kernels.database import DatabaseError, content, fill

#: maximum size of cached kernels in bytes: the least recently used ones are removed
MOST_BYTES = 48 << 20
#: free bytes of the temporary folder below which no database is made there
_ROOM = 2 * DATABASE_SIZE


class KernelCache:
    """The compiled kernels of this process.

    private  folder of slangpy's database; None if there is no room for one, and kernels are only in memory
    remarks  messages for the user
    modules  compiled modules of the kernels
    """

    def __init__(self, kept_in: Path | None, lent: Path | None = None) -> None:
        """Copy cached kernels to a private folder.

        lent  the private folder of another process, which caches what this one adds to it
        """
        self._store = None if kept_in is None or lent is not None else _store(kept_in)
        self._until_exit = ExitStack()
        self.remarks: list[str] = []
        self.modules = CompiledModules(None if kept_in is None else kept_in.with_name("modules"), self.remarks)
        self._known: dict[bytes, Path] = {}
        if kept_in is None:
            self.remarks.append("compiled kernels are not cached: neither a home folder nor XDG_CACHE_HOME exists")
        self.private = lent or self._private_folder()
        if self.private is None:
            self.remarks.append("compiled kernels are cached in memory only: no temporary folder has room for them")
        elif lent is None:
            self._fill(self.private)

    @property
    def is_empty(self) -> bool:
        """Whether no kernel was ever stored, so that whatever is needed must be compiled."""
        return not self._known

    @property
    def is_kept(self) -> bool:
        """Whether kernels are there for the next process."""
        return self.private is not None and self._store is not None

    def keep(self) -> None:
        """Write the kernels that are new to files, and note which others were used; nobody may compile meanwhile."""
        # compilers leave hundreds of megabytes to malloc
        release_free_memory()
        self.modules.seal()
        if self.private is None or self._store is None:
            return
        try:
            new, used = content(self.private, set(self._known))
            for key, kernel in new.items():
                self._known[key] = self._store.write(key, kernel)
        except (OSError, DatabaseError) as error:
            self._give_up((error.strerror if isinstance(error, OSError) else None) or str(error))
            return
        for key in used & self._known.keys():
            self._store.note_use(self._known[key])

    def _private_folder(self) -> Path | None:
        """A new folder that is removed when the process ends."""
        try:
            folder = self._until_exit.enter_context(scratch(Path(tempfile.gettempdir()))) / "new"
            (folder / "rhi").mkdir()
            # slangpy maps a sparse file: where the disk fills up under it the system ends the process (SIGBUS)
            has_room = shutil.disk_usage(folder).free > _ROOM
        except OSError:
            return None
        return folder if has_room else None

    def _fill(self, folder: Path) -> None:
        """Copy cached kernels to a database."""
        try:
            fill(folder, self._sound())
        except DatabaseError as error:
            self._give_up(str(error))

    def _give_up(self, reason: str) -> None:
        """Keep nothing from now on."""
        if self._store is not None:
            self.remarks.append(f"compiled kernels can't be cached in {self._store.folder}: {reason}")
        self._store = None

    def close(self) -> None:
        """Record the use of kernels, and remove all temporary files."""
        self.keep()
        self._until_exit.close()

    def _sound(self) -> Iterator[tuple[bytes, bytes]]:
        """Keys and kernels of all files that are as they were written; damaged ones are set aside."""
        if self._store is None:
            return
        damaged, store = 0, self._store
        for path in store.files():
            try:
                entry = store.read(path)
            except OSError:
                continue
            if entry is None:
                damaged += 1
            else:
                self._known[entry[0]] = path
                yield entry
        if damaged:
            self.remarks.append(
                f"damaged compiled kernels in {store.folder}, moved aside and rebuilt when needed: {damaged}"
            )


def is_any_kept() -> bool:
    """Whether kernels of earlier processes are there; without any, whatever is needed must be compiled."""
    folder = cache_folder("kernels")
    return folder is not None and any(True for _ in _store(folder).files())


def _store(folder: Path) -> Store:
    return Store(folder, "kernel", MOST_BYTES)


_caches: dict[tuple[int, Path | None], KernelCache] = {}


def kernel_cache() -> KernelCache:
    """The cache of this process; a forked one has its own."""
    key = os.getpid(), cache_folder("kernels")
    if key not in _caches:
        _caches[key] = KernelCache(key[1])
    return _caches[key]


def work_on(database: Path) -> None:
    """Let this process compile kernels into the database of another one."""
    kept_in = cache_folder("kernels")
    _caches[os.getpid(), kept_in] = KernelCache(kept_in, database)


@atexit.register
def _finish() -> None:
    """Close the caches of this process, but not of its parent before a fork."""
    for (process, _), cache in _caches.items():
        if process == os.getpid():
            cache.close()
