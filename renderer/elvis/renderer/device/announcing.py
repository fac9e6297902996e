"""Notes on the terminal while kernels are compiled, which takes seconds and happens once."""

from __future__ import annotations

from typing import ClassVar

from elvis.core.base.terminal import announce
from elvis.renderer.device.kernels.cache import KernelCache

#: seconds of compiling that nobody wonders about
MOMENT = 1.0


class Announcement:
    """Prints at most once per process that kernels are compiled.

    No Python thread runs while the compiler and the driver work.  So the note comes before the first kernel if the
    cache is empty, and otherwise after the first newly compiled ones that took longer than a moment.
    """

    _is_said: ClassVar[bool] = False

    def __init__(self, cache: KernelCache, is_slow: bool) -> None:
        """``is_slow``: the device is one that compiles for seconds whatever the kernel."""
        self._cache, self._is_slow = cache, is_slow
        self._seconds = 0.0

    def expect(self) -> None:
        """Kernels are about to be needed."""
        if self._is_slow and self._cache.is_empty:
            self._say()

    def note(self, seconds: float) -> None:
        """Record that a kernel was compiled and run for the first time, in this number of seconds."""
        self._seconds += seconds
        if self._seconds > MOMENT:
            self._say()

    def _say(self) -> None:
        if Announcement._is_said:
            return
        Announcement._is_said = True
        announce("compiling kernels once; they are cached" if self._cache.is_kept else "compiling kernels")
