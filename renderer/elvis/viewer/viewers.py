"""Viewers of a session: pages and notebooks, which receive pictures as fast as they show them."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from time import perf_counter
from typing import Any, TypeAlias

from elvis.core.base.errors import ElvisError
from elvis.viewer.messages import id_of

#: pictures on their way to a page that it has not confirmed, at most
UNCONFIRMED = 2
#: seconds until a confirmation, and how many that take longer one after another make a line slow
LATE_CONFIRMATION, LATE_CONFIRMATIONS = 0.4, 3
#: questions of a page that wait for their answers, at most
MAX_QUESTIONS = 100
Send: TypeAlias = Callable[[str | bytes], Awaitable[None]]


@dataclass(eq=False)
class Viewer:
    """One who looks, a page or a notebook.

    sent, confirmed  numbers of the last picture that went there, and that it has shown
    waiting          the picture that goes there next
    is_slow          whether pictures take long to arrive, until the next final one
    """

    send: Send
    sent: int = 0
    confirmed: int = 0
    waiting: bytes | None = None
    is_slow: bool = False

    def __post_init__(self) -> None:
        self._times = deque[float]()
        self._late = 0
        self._turn = asyncio.Lock()
        self._questions = 0

    @asynccontextmanager
    async def question(self) -> AsyncIterator[None]:
        """Wait until this page has no other question, so that its questions don't delay those of other pages.

        Raises ElvisError if too many wait.
        """
        if self._questions >= MAX_QUESTIONS:
            raise ElvisError(f"{MAX_QUESTIONS} questions of this page are still waiting; ask again later")
        self._questions += 1
        try:
            async with self._turn:
                yield
        finally:
            self._questions -= 1

    async def take(self, number: int, message: bytes, is_final: bool) -> None:
        """Send a picture, or keep a final one until there is room; others are skipped."""
        if self.sent - self.confirmed >= UNCONFIRMED:
            self.waiting = message if is_final else self.waiting
            return
        if is_final:
            self.is_slow, self._late = False, 0
        await self._put(message)

    async def confirm(self) -> None:
        """The page has shown one more picture."""
        self.confirmed = min(self.confirmed + 1, self.sent)
        if self._times:
            is_late = perf_counter() - self._times.popleft() > LATE_CONFIRMATION
            self._late = self._late + 1 if is_late else 0
            self.is_slow = self.is_slow or self._late >= LATE_CONFIRMATIONS
        if self.waiting is not None:
            await self._put(self.waiting)

    async def _put(self, message: bytes) -> None:
        """Send a picture."""
        self.waiting = None
        self.sent += 1
        self._times.append(perf_counter())
        await self.send(message)

    async def refuse(self, reason: str, message: object = None) -> None:
        """Send the reason for rejecting a message to the page that sent it."""
        answer: dict[str, Any] = {"type": "error", "text": reason}
        own = id_of(message)
        if own is not None:
            answer["id"] = own
        await self.send(json.dumps(answer))


def is_any_slow(viewers: Iterable[Viewer]) -> bool:
    """Whether pictures take long to reach one of the viewers."""
    return any(viewer.is_slow for viewer in viewers)
