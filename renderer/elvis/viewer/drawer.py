"""The process that draws, seen from the server."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from elvis.core.base.errors import ElvisError
from elvis.core.base.memory import free_memory
from elvis.scene.model.errors import AbsentError
from elvis.viewer.drawing_process import QUESTIONS, Process, Source, spawn

#: name of the request for a picture that is saved
SAVE = "save"
#: requests for which a picture that is being saved isn't left
UNHURRIED = (SAVE, "follow")
#: share of the free memory that a process may take so that a second one reads its data next to it
ROOM = 0.5


class DiedError(ElvisError):
    """The process that draws has ended."""


class Exchange:
    """A pipe to a process: one request at a time, whose answer a thread waits for."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._waiting: threading.Thread | None = None

    async def ask(self, request: tuple[str, int, Any]) -> Any:
        """The answer to a request, None for an obsolete picture; ElvisError with the reason if there is none."""
        loop = asyncio.get_running_loop()
        answer: asyncio.Future[Any] = loop.create_future()

        def settle(found: Any) -> None:
            if not answer.done():
                answer.set_result(found)

        def wait() -> None:
            try:
                self._pipe.send(request)
                found = self._pipe.recv()
            except (EOFError, OSError):
                found = ("died", 0, "")
            with suppress(RuntimeError):  # the loop is closed: nobody waits for the answer
                loop.call_soon_threadsafe(settle, found)

        waiting = threading.Thread(target=wait, daemon=True)
        waiting.start()
        # only a thread that has started can be joined: Ctrl-C may come while it starts
        self._waiting = waiting
        kind, _, found = await answer
        if kind == "died":
            raise DiedError("the drawing process stopped unexpectedly and is restarting")
        if kind in ("error", "absent"):
            raise (AbsentError if kind == "absent" else ElvisError)(found)
        return None if kind == "obsolete" else found

    def close(self) -> None:
        """Close the pipe of a process that has ended.

        The end of the process ends a wait for its answer.  The pipe may only be closed after that: closing a pipe while
        a thread reads it leaves that thread with no descriptor, or with the descriptor of another file.
        """
        if self._waiting is not None:
            self._waiting.join(2)
            if self._waiting.is_alive():
                return
        self._pipe.close()


class Worker:
    """A process that draws, and the pipes to it."""

    def __init__(self, process: Process) -> None:
        self.process = process
        self._exchanges = [Exchange(pipe) for pipe in process.pipes]
        #: pipes without a request; who waits for one gets it in turn
        self._free_picture = asyncio.Queue[Exchange]()
        self._free_questions = asyncio.Queue[Exchange]()
        self._free_picture.put_nowait(self._exchanges[0])
        for exchange in self._exchanges[1:]:
            self._free_questions.put_nowait(exchange)

    async def tell(self, source: Source) -> None:
        """Send the source of the data, before any request."""
        with suppress(OSError):  # the first request finds out that the process has ended
            await asyncio.to_thread(self.process.pipes[0].send, source)

    @asynccontextmanager
    async def exchange(self, name: str) -> AsyncIterator[Exchange]:
        """A pipe for a request of this name."""
        free = self._free_questions if name in QUESTIONS else self._free_picture
        exchange = await free.get()
        try:
            yield exchange
        finally:
            free.put_nowait(exchange)

    @asynccontextmanager
    async def all_answered(self) -> AsyncIterator[None]:
        """All requests have their answers, and no other one begins within the block."""
        async with AsyncExitStack() as taken:
            await taken.enter_async_context(self.exchange("draw"))
            for _ in self._exchanges[1:]:
                await taken.enter_async_context(self.exchange("pick"))
            yield

    def end(self) -> None:
        """End the process, and wait for its end, which takes a moment if it holds a lot of memory."""
        process = self.process.own
        process.terminate()
        process.join(2)
        if process.is_alive():
            process.kill()
            process.join()
        for exchange in self._exchanges:
            exchange.close()


class Drawer:
    """The process that draws, seen from the server: one request at a time; started when it is needed.

    Starting and ending a process takes a fraction of a second, more on a busy machine: a thread does it, so that the
    server answers pages meanwhile.
    """

    def __init__(self, source: Source, process: Process | None = None) -> None:
        self.source = source
        self._number = 0
        #: requests that come before a picture that is saved, and whether one is being saved
        self._urgent = 0
        self._is_saving = False
        self._given = process
        self._worker: Worker | None = None
        self._start = asyncio.Lock()
        #: those that answer their last question, or read data that are not shown yet
        self._others: set[Worker] = set()
        self._retiring: set[asyncio.Task[None]] = set()

    async def ask(self, name: str, content: Any = None) -> Any:
        """The answer to a request; ElvisError with the reason where there is none, None for an obsolete picture.

        A picture that is being saved is left as soon as another one is needed.
        """
        if name in QUESTIONS or name in UNHURRIED:
            return await self._exchanged(name, content)
        self._urgent += 1
        if self._is_saving:
            self.make_obsolete()
        try:
            return await self._exchanged(name, content)
        finally:
            self._urgent -= 1

    async def _exchanged(self, name: str, content: Any) -> Any:
        """The answer of the current process, once one of its pipes is free."""
        while True:
            worker = await self._current()
            async with worker.exchange(name) as exchange:
                if worker is self._worker:
                    with self._marked(name):
                        return await self._answer(worker, exchange, name, content)

    async def _answer(self, worker: Worker, exchange: Exchange, name: str, content: Any) -> Any:
        """The answer of a process, which is ended if it has died."""
        if name == SAVE and self._urgent:
            return None
        try:
            return await exchange.ask((name, self._next_number(worker, name), content))
        except DiedError:
            if worker is self._worker:
                await self._retire(worker)
            raise

    @contextmanager
    def _marked(self, name: str) -> Iterator[None]:
        """Remember that a picture is being saved."""
        self._is_saving = self._is_saving or name == SAVE
        try:
            yield
        finally:
            self._is_saving = self._is_saving and name != SAVE

    def _next_number(self, worker: Worker, name: str) -> int:
        """The number of a request; a picture makes those with smaller numbers obsolete."""
        self._number += 1
        if name not in QUESTIONS:
            worker.process.newest.value = self._number
        return self._number

    async def _current(self) -> Worker:
        """The process, which is started if there is none."""
        async with self._start:
            if self._worker is None:
                given, self._given = self._given, None
                worker = Worker(await asyncio.to_thread(spawn) if given is None else given)
                # before anything that may fail: `close` ends it
                self._worker = worker
                await worker.tell(self.source)
            return self._worker

    async def read_again(self, source: Source) -> Any:
        """Facts of data that a new process has read, which then draws; ElvisError if they can't be read.

        The previous process answers until then; without room for both it ends first.
        """
        old = self._worker
        if old is not None and not _has_room(old):
            self.source = source
            async with old.all_answered():
                await self._retire(old)
            return await self.ask("facts")
        new = Worker(await asyncio.to_thread(spawn))
        self._others.add(new)
        try:
            await new.tell(source)
            async with new.exchange("facts") as exchange:
                facts = await exchange.ask(("facts", 0, None))
        except BaseException:
            await self._retire(new)
            raise
        self._others.discard(new)
        old, self._worker, self.source = self._worker, new, source
        if old is not None:
            self._others.add(old)
            old.process.newest.value = self._number + 1
            task = asyncio.get_running_loop().create_task(self._retire_later(old))
            self._retiring.add(task)
            task.add_done_callback(self._retiring.discard)
        return facts

    async def _retire_later(self, worker: Worker) -> None:
        """End a process once it has answered its last question."""
        async with worker.all_answered():
            await self._retire(worker)

    async def _retire(self, worker: Worker) -> None:
        """End a process."""
        if worker is self._worker:
            self._worker = None
        self._others.add(worker)
        await asyncio.to_thread(worker.end)
        self._others.discard(worker)

    def make_obsolete(self) -> None:
        """Let the picture that is being drawn be left: something newer is wanted."""
        if self._worker is not None:
            self._worker.process.newest.value = self._number + 1

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
        return None if self._worker is None else self._worker.process.own.pid

    def close(self) -> None:
        """End all processes."""
        if self._given is not None:
            self._others.add(Worker(self._given))
        if self._worker is not None:
            self._others.add(self._worker)
        self._given = self._worker = None
        while self._others:
            self._others.pop().end()


def _has_room(worker: Worker) -> bool:
    """Whether there is memory for the data of a process a second time, where the system reports it."""
    try:
        status = Path(f"/proc/{worker.process.own.pid}/status").read_text(encoding="ascii")
        taken = next(1024 * int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))
    except (OSError, StopIteration):
        return True
    return taken < ROOM * free_memory()
