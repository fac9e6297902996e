"""Processes that have loaded a library, and copies of them; each copy reads the files of one request.

Loading a library takes longer than reading most files.  The first request therefore starts the origin, a process that
loads the library and reads nothing; every file is read by a copy of that process (POSIX fork), which ends with its
object.  The damage that a file does to one copy does not affect others.  An origin ends after a while without requests.

Only on Linux: elsewhere, copies of processes that have loaded system libraries may fail.
"""

from __future__ import annotations

import gc
import json
import os
import signal
import socket
import subprocess
import sys
import weakref
from collections.abc import Callable
from contextlib import suppress
from threading import Lock
from typing import Any, NoReturn

#: whether this system has what copies need
IS_POSSIBLE = sys.platform == "linux"

#: seconds after which an origin without copies ends
IDLE = 10

#: bytes of a message at most: it holds the name of a folder
_LONGEST = 1 << 16

_PROGRAM = """
import sys
sys.path[:] = {places!r}
from elvis.converters.shared.apart import make, serve
from elvis.converters.shared.copies import multiply
multiply({channel!r}, lambda: make({worker!r}), serve)
"""


class Copy:
    """A copied process, with the interface of `subprocess.Popen`.

    stdin, stdout  pipes for requests and replies
    """

    def __init__(self, origin: _Origin, pid: int, stdin: int, stdout: int) -> None:
        self._origin, self.pid = origin, pid
        self._status: int | None = None
        self.stdin, self.stdout = os.fdopen(stdin, "wb"), os.fdopen(stdout, "rb")

    def kill(self) -> None:
        """End it; nothing if it has been waited for."""
        if self._status is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)

    def wait(self) -> int:
        """The exit status, or minus the number of the signal that ended it."""
        if self._status is None:
            self._status = self._origin.status(self.pid)
        return self._status

    def forget(self) -> None:
        """Let the origin take note of its end, which need not be awaited: collecting garbage may call this."""
        if self._status is None:
            self._status = 0
            self._origin.forget(self.pid)


class _Origin:
    """The process that has loaded a library."""

    def __init__(self, worker: str, places: tuple[str, ...], patience: float) -> None:
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._channel.settimeout(patience)
        self._lock = Lock()
        program = _PROGRAM.format(places=list(places), worker=worker, channel=theirs.fileno())
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", program],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
            )
        weakref.finalize(self, _closed, self._channel, self._process)

    def copy(self, memory: int) -> Copy:
        """A copy that may use ``memory`` bytes of memory; raises OSError if the origin has ended, or doesn't reply."""
        requests, replies = os.pipe(), os.pipe()
        try:
            pid = self._ask(["copy", memory, os.getcwd()], [requests[0], replies[1]])
        except BaseException:
            os.close(requests[1])
            os.close(replies[0])
            raise
        finally:
            os.close(requests[0])
            os.close(replies[1])
        return Copy(self, pid, requests[1], replies[0])

    def status(self, pid: int) -> int:
        """Exit status of a copy; 1, as after a failure, if the origin has also ended."""
        try:
            return self._ask(["status", pid])
        except OSError:
            return 1

    def forget(self, pid: int) -> None:
        """Report that the status of a copy will not be requested."""
        with suppress(OSError):
            self._send(["forget", pid])

    def _ask(self, message: list[Any], files: list[int] | None = None) -> int:
        with self._lock:
            self._send(message, files)
            text = self._channel.recv(_LONGEST)
        if not text:
            raise ConnectionError
        return int(text)

    def _send(self, message: list[Any], files: list[int] | None = None) -> None:
        """Send a message, whole: also between another one and its reply."""
        socket.send_fds(self._channel, [json.dumps(message).encode("ascii")], files or [], socket.MSG_NOSIGNAL)


#: origins by this process, worker and search paths of modules
_ORIGINS: dict[tuple[int, str, tuple[str, ...]], _Origin] = {}
_ORIGINS_LOCK = Lock()


def copied(worker: str, memory: int, patience: float) -> Copy:
    """A process that serves a worker: it receives requests on its input and answers on its output.

    patience  seconds in which the library is loaded, else OSError
    """
    places = tuple(place for place in sys.path if place)
    key = (os.getpid(), worker, places)
    with _ORIGINS_LOCK:
        known = _ORIGINS.get(key)
    if known is not None:
        with suppress(OSError):  # it has ended, for want of questions
            return known.copy(memory)
    fresh = _Origin(worker, places, patience)
    copy = fresh.copy(memory)
    with _ORIGINS_LOCK:
        _ORIGINS[key] = fresh
    return copy


def multiply(channel: int, make: Callable[[], Any], serve: Callable[[Any, int, int, int], NoReturn]) -> None:
    """Load a library and make copies of this process on request; the life of an origin.

    make   loads the library, and returns the worker
    serve  the life of a copy: of the worker, input, output and bytes of memory
    """
    made = make()
    gc.freeze()  # collecting garbage would write to the memory of all that was loaded, and so copy it
    copies: set[int] = set()
    with socket.socket(fileno=channel) as asked:
        asked.settimeout(IDLE)
        while True:
            try:
                text, files, _, _ = socket.recv_fds(asked, _LONGEST, 2)
            except TimeoutError:
                if copies:
                    continue
                return
            if not text:
                return
            kind, *given = json.loads(text)
            if kind == "copy":
                pid = os.fork()
                if not pid:
                    _live(asked, given[1], serve, (made, *files, given[0]))
                for file in files:
                    os.close(file)
                copies.add(pid)
                asked.send(str(pid).encode())
            else:
                status = os.waitstatus_to_exitcode(os.waitpid(given[0], 0)[1])
                copies.discard(given[0])
                if kind == "status":
                    asked.send(str(status).encode())


def _live(asked: socket.socket, folder: str, serve: Callable[..., NoReturn], given: tuple[Any, ...]) -> NoReturn:
    """The life of a copy, in the folder of the requesting process."""
    try:
        asked.close()
        os.chdir(folder)
        serve(*given)
    finally:
        os._exit(1)


def _closed(channel: socket.socket, process: subprocess.Popen[bytes]) -> None:
    """End an origin, which holds nothing that would be missed."""
    channel.close()
    process.kill()
    process.wait()
