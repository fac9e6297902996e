"""The ``elvis`` command: ``main`` runs it, ``elvis`` is the click group.

Exit status: 0 when all went well, 2 after a usage error, 130 after an interrupt, 1 after any other failure; one
sentence on standard error goes with each failure.

This module imports next to nothing, as Ctrl-C is a traceback of Python's own until `main` takes charge of it.
"""

from __future__ import annotations

import os
import signal
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import NoReturn


def main(arguments: Sequence[str] | None = None) -> None:
    """Run ``elvis`` with ``arguments``, by default the process's own, and exit with its status."""
    # a Ctrl-C waits until there is something to take it
    can_wait = hasattr(signal, "pthread_sigmask")  # not on Windows
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if can_wait else set()
    from elvis.plugins.command.interrupts import INTERRUPTED, Interrupts

    is_process = arguments is None
    if is_process:
        # matrices here are tall and narrow: a second thread of NumPy's library waits more than it helps
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with Interrupts(is_process) as interrupts:
        try:
            if can_wait:
                signal.pthread_sigmask(signal.SIG_SETMASK, before)
            if is_process:
                _open_closed_streams()
            from elvis.plugins.command.running import run

            status = run(arguments, interrupts)
        except KeyboardInterrupt:
            print("elvis: error: interrupted", file=sys.stderr)
            status = INTERRUPTED
    if is_process and status == INTERRUPTED:
        _leave(status)
    sys.exit(status)


def _leave(status: int) -> NoReturn:
    """End the process as Python does, but destroy no objects.

    An interrupt leaves objects of libraries in C half made, or in use by a thread; destroying them may crash.
    """
    import atexit
    import threading
    from contextlib import suppress

    with suppress(Exception):
        threading._shutdown()  # type: ignore[attr-defined]  # waits for threads, as at each end
    with suppress(Exception):
        atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(Exception):
            stream.flush()
    os._exit(status)


def _open_closed_streams() -> None:
    """Open the standard streams that the caller has closed, so that the next file opened does not become one of them.

    Writing to standard output then fails as on a broken one; messages about it are lost.
    """
    for number, mode in ((0, os.O_RDONLY), (1, os.O_RDONLY), (2, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, mode)
    sys.stdin = sys.stdin or os.fdopen(0, closefd=False)
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)
    for stream in (sys.stdout, sys.stderr):
        # names of files need not be text in the encoding of the terminal
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def __getattr__(name: str) -> object:
    if name == "elvis":
        from elvis.plugins.command.running import elvis

        return elvis
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
