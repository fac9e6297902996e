"""New output that waits next to its place: how it is moved there, and how that is undone."""

from __future__ import annotations

import ctypes
import os
import shutil
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass
class Replacement:
    """A file or folder that replaces another; without new content, the old one is removed.

    named   the target as the user calls it
    target  its place, with links resolved
    new     path of the new content
    old     path of the old content, on the same file system
    """

    named: str | Path
    target: Path
    new: Path
    old: Path
    _own: os.stat_result | None = field(default=None, init=False)
    _had: bool = field(default=False, init=False)
    _began: bool = field(default=False, init=False)

    def place(self) -> None:
        """Take the place and keep what stood there; no moment leaves a file's name without a whole file."""
        self._had = os.path.lexists(self.target)
        self._own = self.new.lstat() if os.path.lexists(self.new) else None
        self._began = True
        if self._own is None:
            if self._had:
                os.rename(self.target, self.old)
        elif self._had and self.new.is_dir():
            self._swap_folders()
        else:
            if self._had:
                _keep(self.target, self.old)
            os.replace(self.new, self.target)

    @property
    def is_placed(self) -> bool:
        """Whether the new content is in its place, or the removed content is gone."""
        stands = os.path.lexists(self.target)
        if self._own is None:
            return self._began and not stands
        return stands and os.path.samestat(self.target.lstat(), self._own)

    def restore(self) -> None:
        """Restore the previous content, independent of how far `place` came."""
        if self._own is not None and self.is_placed:
            if self.target.is_dir() and os.path.lexists(self.new):
                exchange(self.new, self.target)
            elif self.target.is_dir() or not self._had:
                os.rename(self.target, self.new)
            else:
                os.replace(self.old, self.target)
        if os.path.lexists(self.old) and not os.path.lexists(self.target):
            os.rename(self.old, self.target)

    def _swap_folders(self) -> None:
        """Replace a folder by another: atomically if the system can, else in two steps."""
        if exchange(self.new, self.target):
            os.rename(self.new, self.old)
        else:
            os.rename(self.target, self.old)
            os.rename(self.new, self.target)


def _keep(target: Path, old: Path) -> None:
    """A second name for a file; a copy where the file system has no such names."""
    try:
        os.link(target, old)
    except OSError:
        shutil.copy2(target, old)


def exchange(one: Path, other: Path) -> bool:
    """Let two folders change their names in one step; False if the system or the file system can't do that."""
    library: Any = ctypes.CDLL(None, use_errno=True)
    swap_flag = ctypes.c_uint(2)  # RENAME_SWAP there, RENAME_EXCHANGE here
    first, second = os.fsencode(one), os.fsencode(other)
    if sys.platform == "darwin":
        return hasattr(library, "renamex_np") and library.renamex_np(first, second, swap_flag) == 0
    here = ctypes.c_int(-100)  # AT_FDCWD, the working folder
    return hasattr(library, "renameat2") and library.renameat2(here, first, here, second, swap_flag) == 0
