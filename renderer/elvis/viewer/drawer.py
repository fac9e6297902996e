"""The process that draws, seen from the server."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from typing import Any

from elvis.core.errors import ElvisError
from elvis.scene.errors import AbsentError
from elvis.viewer.drawing_process import Process, Source, spawn


class DiedError(ElvisError):
    """The process that draws has ended."""


class Drawer:
    """The process that draws, seen from the server: one request at a time; started when it is needed."""

    def __init__(self, source: Source, process: Process | None = None) -> None:
        self.source = source
        #: with whether it knows its source
        self._process, self._is_told = process, False
        self._waiting: threading.Thread | None = None
        self._number = 0
        self._turn = asyncio.Lock()

    async def ask(self, name: str, content: Any = None) -> Any:
        """The answer to a request; ElvisError with the reason where there is none, None for an obsolete picture."""
        async with self._turn:
            if self._process is None:
                self._process, self._is_told = spawn(), False
            self._number += 1
            self._process.newest.value = self._number
            return await self._exchange(self._process.pipe, name, self._number, content)

    async def _exchange(self, pipe: Connection, name: str, number: int, content: Any) -> Any:
        loop = asyncio.get_running_loop()
        answer: asyncio.Future[Any] = loop.create_future()

        def settle(found: Any) -> None:
            if not answer.done():
                answer.set_result(found)

        def wait() -> None:
            try:
                if not self._is_told:
                    pipe.send(self.source)
                    self._is_told = True
                pipe.send((name, number, content))
                found = pipe.recv()
            except (EOFError, OSError):
                found = ("died", number, "")
            with suppress(RuntimeError):  # the loop is closed: nobody waits for the answer
                loop.call_soon_threadsafe(settle, found)

        waiting = threading.Thread(target=wait, daemon=True)
        waiting.start()
        # only a thread that has started can be joined: Ctrl-C may come while it starts
        self._waiting = waiting
        kind, _, found = await answer
        if kind == "died":
            self.close()
            raise DiedError("the drawing process stopped unexpectedly and is restarting")
        if kind in ("error", "absent"):
            raise (AbsentError if kind == "absent" else ElvisError)(found)
        return None if kind == "obsolete" else found

    async def restart(self) -> None:
        """Let the next request find a new process, which reads the data again."""
        self.make_obsolete()
        async with self._turn:
            self.close()

    def make_obsolete(self) -> None:
        """Let the picture that is being drawn be left: something newer is wanted."""
        if self._process is not None:
            self._process.newest.value = self._number + 1

    @contextmanager
    def limited(self, seconds: float | None) -> Iterator[None]:
        """Let the picture that is requested meanwhile be left after some seconds; None for no limit."""
        if seconds is None:
            yield
            return
        end = asyncio.get_running_loop().call_later(seconds, self.make_obsolete)
        try:
            yield
        finally:
            end.cancel()

    @property
    def pid(self) -> int | None:
        """Id of the process, None if there is none."""
        return None if self._process is None else self._process.own.pid

    def close(self) -> None:
        """End the process."""
        known, self._process = self._process, None
        if known is None:
            return
        process = known.own
        process.terminate()
        process.join(2)
        if process.is_alive():
            process.kill()
            process.join()
        # The end of the process ends a wait for its answer.  The pipe may only be closed after that: closing a pipe
        # while a thread reads it leaves that thread with no descriptor, or with the descriptor of another file.
        if self._waiting is not None:
            self._waiting.join(2)
            if self._waiting.is_alive():
                return
        known.pipe.close()
