"""Ctrl-C, taken at moments at which Python code can take it."""

from __future__ import annotations

import signal
import sys
from types import FrameType, TracebackType
from typing import Any

INTERRUPTED = 130
#: seconds after which an interrupt that came at a bad moment is tried again
_LATER = 0.02
#: starts of names of modules whose functions are not interrupted
_FRAGILE = ("multiprocessing.popen", "elvis.core.files.scratch", __name__)


class Interrupts:
    """While the block runs, Ctrl-C is a KeyboardInterrupt, but waits for the end of what must not be left half done.

    A library raises its own errors, or crashes, if it is interrupted while it is loaded.  A process whose start is
    interrupted prints a traceback, and a scratch folder would remain.

    asked  whether somebody has pressed Ctrl-C
    """

    def __init__(self, is_process: bool) -> None:
        """``is_process``: nothing comes after the block but the end of the process, which nothing interrupts."""
        self.asked = False
        self._is_process = is_process
        self._before: Any = None
        self._hook = sys.unraisablehook

    def __enter__(self) -> Interrupts:
        # one that is ignored, as in the background of a script, stays so
        if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
            return self
        try:
            self._before = signal.signal(signal.SIGINT, self._take)
        except ValueError:  # threads other than the main one get no signals
            return self
        sys.unraisablehook = self._unraisable
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._before is None:
            return
        # first, as an interrupt while the timer is stopped would be a traceback
        signal.signal(signal.SIGINT, signal.SIG_IGN if self._is_process else self._before)
        signal.setitimer(signal.ITIMER_REAL, 0)
        if not (self._is_process and self.asked):
            sys.unraisablehook = self._hook

    def _take(self, number: int, frame: FrameType | None) -> None:
        """Raise KeyboardInterrupt now, or see again soon."""
        self.asked = True
        if _is_fragile(frame):
            self._try_later()
            return
        raise KeyboardInterrupt

    def _try_later(self) -> None:
        signal.signal(signal.SIGALRM, self._take)
        signal.setitimer(signal.ITIMER_REAL, _LATER)

    def _unraisable(self, lost: sys.UnraisableHookArgs) -> None:
        """An interrupt that came where nothing can be raised, as in a destructor, comes again; others are printed.

        After an interrupt they aren't: objects that it left half made complain when they are destroyed.
        """
        if issubclass(lost.exc_type, KeyboardInterrupt):
            self._try_later()
        elif not self.asked:
            self._hook(lost)


def _is_fragile(frame: FrameType | None) -> bool:
    """Whether something is being done, in a call from the command, that must not be left half done."""
    while frame is not None:
        name = frame.f_globals.get("__name__", "")
        if name == "elvis.plugins.command.command":
            return False
        if name.startswith(_FRAGILE) or frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False
