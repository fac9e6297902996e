"""Access to the viewer: token, host and origin of requests, limits of unfinished ones, a private first page."""

from __future__ import annotations

import asyncio
import hmac
import logging
import os
import socket
import tempfile
import webbrowser
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from html import escape
from ipaddress import ip_address
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from elvis.core.files.keeping import cache_folder, make_private

if TYPE_CHECKING:
    from aiohttp import web

#: seconds in which a new connection must have sent the head of its first request
REQUEST_SECONDS = 10.0
#: connections that may be without such a head at a time; a further one is closed
MAX_UNFINISHED = 64
_END_OF_HEAD = b"\r\n\r\n"


def _is_own_fault(record: logging.LogRecord) -> bool:
    """Whether a record is about more than a malformed request; those hold their address, and so the token."""
    error = record.exc_info[1] if record.exc_info else None
    return error is None or not type(error).__module__.startswith("aiohttp.")


#: drops records about malformed requests
LOGGER = logging.getLogger("elvis.viewer.http")
LOGGER.addFilter(_is_own_fault)


def refusal(request: web.Request, token: str, hosts: Collection[str]) -> str | None:
    """Reason for rejecting a request, in one sentence; None if it is accepted.

    token  that the address must contain
    hosts  host names that the address may contain, in addition to those of this machine
    """
    given = request.query.get("token", "")
    if not hmac.compare_digest(given.encode(), token.encode()):
        return "The token is missing: open the address that elvis view printed."
    name = _host_name(request.host)
    if not is_known_host(name, hosts):
        return f"The host name {name!r} is not allowed; start elvis view with --allow-host {name}."
    origin = request.headers.get("Origin")
    if origin is not None and not _is_same_origin(origin, request):
        return "Access from pages of other origins is not allowed."
    return None


def is_known_host(name: str, hosts: Collection[str] = ()) -> bool:
    """Whether the host name of a request is an IP address, a name of this machine or one of ``hosts``.

    Other sites can let a name of theirs point to this machine (DNS rebinding), but not an address or its own names.
    """
    names = {"localhost", socket.gethostname().lower(), *(host.lower() for host in hosts)}
    if name in names or name.endswith(".localhost"):
        return True
    with suppress(ValueError):
        ip_address(name)
        return True
    return name == socket.getfqdn().lower()


def _host_name(host: str) -> str:
    """The name in ``NAME:PORT`` or ``[ADDRESS]:PORT``, in lower case; empty where there is none."""
    with suppress(ValueError):
        return (urlsplit(f"//{host}").hostname or "").lower()
    return ""


def _is_same_origin(origin: str, request: web.Request) -> bool:
    """Whether an origin has the host and the scheme of a request; proxies may add the encryption."""
    with suppress(ValueError):
        found = urlsplit(origin)
        scheme = request.headers.get("X-Forwarded-Proto", request.scheme)
        return found.netloc == request.host and found.scheme in (scheme, "https")
    return False


class Connections:
    """Protocols of new connections, each of which must send the head of a request in time.

    make  creates the protocol that answers requests
    """

    def __init__(self, make: Callable[[], asyncio.Protocol]) -> None:
        self._make = make
        self._unfinished = 0

    def __call__(self) -> asyncio.Protocol:
        """A protocol for a new connection."""
        return _Connection(self._make(), self)

    def begin(self) -> bool:
        """Count a connection; False if there are too many without a request."""
        self._unfinished += 1
        return self._unfinished <= MAX_UNFINISHED

    def end(self) -> None:
        """Count one less: its request is whole, or it has gone."""
        self._unfinished -= 1


class _Connection(asyncio.Protocol):
    """Passes everything on to a protocol, and ends the connection if no head of a request comes in time."""

    def __init__(self, inner: asyncio.Protocol, every: Connections) -> None:
        self._inner, self._every = inner, every
        self._tail = b""
        self._timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Start the time."""
        is_allowed = self._every.begin()
        self._inner.connection_made(transport)
        assert isinstance(transport, asyncio.Transport)
        self._timer = asyncio.get_running_loop().call_later(REQUEST_SECONDS, transport.abort)
        if not is_allowed:
            transport.abort()

    def data_received(self, data: bytes) -> None:
        """Stop the time at the end of a head."""
        if self._timer is not None:
            seen = self._tail + data
            self._tail = seen[-len(_END_OF_HEAD) :]
            if _END_OF_HEAD in seen:
                self._stop()
        self._inner.data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection is gone."""
        self._stop()
        self._inner.connection_lost(exc)

    def eof_received(self) -> bool | None:
        """Pass on the end of the data."""
        return self._inner.eof_received()

    def pause_writing(self) -> None:
        """The other side is slow."""
        self._inner.pause_writing()

    def resume_writing(self) -> None:
        """It takes data again."""
        self._inner.resume_writing()

    def _stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
            self._every.end()


def open_browser(address: str, pages: ExitStack) -> None:
    """Show an address in the browser by a `private_page`, which is removed with ``pages``.

    If no such page can be written, the browser stays closed; the address is printed in any case.
    """
    with suppress(OSError):
        page = pages.enter_context(private_page(address, cache_folder("view")))
        Thread(target=webbrowser.open, args=(page,), daemon=True).start()


@contextmanager
def private_page(address: str, folder: Path | None) -> Iterator[str]:
    """The address of a file that only its owner can read, and that leads a browser to ``address``.

    The command line of a browser is visible to all users of a machine; so it names this file instead of the token.

    folder  where the file lies until the block ends; None for the system's folder of temporary files
    """
    if folder is not None:
        make_private(folder)
    number, name = tempfile.mkstemp(".html", "elvis-view-", folder)
    try:
        target = escape(address)
        with os.fdopen(number, "w", encoding="utf-8") as file:
            file.write(f'<!DOCTYPE html><meta charset="utf-8"><meta http-equiv="refresh" content="0;url={target}">')
            file.write(f'<meta name="referrer" content="no-referrer"><a href="{target}">ElVis</a>\n')
        yield Path(name).as_uri()
    finally:
        with suppress(OSError):
            os.unlink(name)
