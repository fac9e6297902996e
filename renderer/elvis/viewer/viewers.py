"""Viewers of a session: pages and notebooks, which receive pictures as fast as they show them."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

from elvis.viewer.messages import id_of

#: pictures on their way to a page that it has not confirmed, at most
UNCONFIRMED = 2
Send: TypeAlias = Callable[[str | bytes], Awaitable[None]]


@dataclass(eq=False)
class Viewer:
    """One who looks, a page or a notebook.

    sent, confirmed  numbers of the last picture that went there, and that it has shown
    waiting          the picture that goes there next
    """

    send: Send
    sent: int = 0
    confirmed: int = 0
    waiting: bytes | None = None

    async def take(self, number: int, message: bytes, is_final: bool) -> None:
        """Send a picture, or keep a final one until there is room; others are skipped."""
        if self.sent - self.confirmed >= UNCONFIRMED:
            self.waiting = message if is_final else self.waiting
            return
        self.waiting, self.sent = None, self.sent + 1
        await self.send(message)

    async def confirm(self) -> None:
        """The page has shown one more picture."""
        self.confirmed = min(self.confirmed + 1, self.sent)
        if self.waiting is not None:
            message, self.waiting, self.sent = self.waiting, None, self.sent + 1
            await self.send(message)

    async def refuse(self, reason: str, message: object = None) -> None:
        """Send the reason for rejecting a message to the page that sent it."""
        answer: dict[str, Any] = {"type": "error", "text": reason}
        own = id_of(message)
        if own is not None:
            answer["id"] = own
        await self.send(json.dumps(answer))
