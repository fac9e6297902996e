"""Reading data again when pages ask for it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence

from elvis.core.base.errors import ElvisError
from elvis.viewer.drawing_process import Source


class Rereading:
    """Reads data again, once at a time; requests while it reads are one more, as the files may have changed since.

    read  reads the data; ElvisError if they can't be read
    tell  reports the reason
    turn  held while data are read, by whoever reads them
    """

    def __init__(self, read: Callable[[], Awaitable[None]], tell: Callable[[str], Awaitable[None]]) -> None:
        self._read, self._tell = read, tell
        self.turn = asyncio.Lock()
        self._task: asyncio.Task[None] | None = None
        self._is_wanted = False

    def request(self) -> None:
        """Read the data again, soon."""
        self._is_wanted = True
        if not self.is_running:
            self._task = asyncio.get_running_loop().create_task(self._run())

    @property
    def is_running(self) -> bool:
        """Whether data are about to be read."""
        return self._task is not None and not self._task.done()

    def cancel(self) -> None:
        """End it."""
        if self._task is not None:
            self._task.cancel()

    async def _run(self) -> None:
        while self._is_wanted:
            self._is_wanted = False
            try:
                async with self.turn:
                    await self._read()
            except ElvisError as error:
                await self._tell(str(error))


async def first_of(sources: Sequence[Source], read: Callable[[Source], Awaitable[None]]) -> None:
    """Read the first source that can be read; ElvisError of the first one, the most useful reason, if none can."""
    reason = ElvisError("expected a source, found none")
    for number, source in enumerate(sources):
        try:
            await read(source)
        except ElvisError as error:
            reason = reason if number else error
        else:
            return
    raise reason
