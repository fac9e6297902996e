"""The page of a session on localhost: files of the page, one socket for each page, files that are saved.

Everyone with the token may view and change the scene; addresses are relative, so that tunnels and proxies work.
"""

from __future__ import annotations

import asyncio
import errno
import json
import re
import secrets
import signal
import threading
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from html import escape
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from elvis.core.base.errors import ElvisError
from elvis.core.base.needing import require_module
from elvis.scene.model.errors import SceneError
from elvis.viewer.access import LOGGER, Connections, refusal
from elvis.viewer.messages import id_of, table_of_text
from elvis.viewer.second_data import received
from elvis.viewer.session import Session
from elvis.viewer.viewers import Viewer

if TYPE_CHECKING:
    from aiohttp import web

#: bytes of a message of a page, at most
MOST_BYTES = 1 << 20
#: messages to a page that takes none, after which its connection is closed; it comes back when it can
MOST_WAITING = 500
#: seconds in which most data that can't be read are found out
DOUBT = 0.5
#: files of the page, and their types
PAGE = {
    "": ("index.html", "text/html"),
    "viewer.js": ("viewer.js", "text/javascript"),
    "viewer.css": ("viewer.css", "text/css"),
}
#: the page runs only its own code and loads nothing from elsewhere
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class Server:
    """Serves a session.

    token        that addresses must contain
    allow_hosts  host names, such as those of proxies, that addresses may have in addition to those of this machine
    """

    def __init__(self, session: Session, token: str | None = None, allow_hosts: Sequence[str] = ()) -> None:
        require_module("aiohttp", "elvis view", "view")
        self.session = session
        self.token = token or secrets.token_urlsafe(24)
        self._hosts = set(allow_hosts)
        self.on_empty: Callable[[], object] = lambda: None
        self._runner: Any = None
        self._listening: Any = None

    async def start(self, host: str, port: int) -> int:
        """Listen; the port, which is a free one where 0 was given.  ElvisError where the port is taken."""
        from aiohttp import web

        app = web.Application(middlewares=[self._guard])
        app.router.add_get("/", self._page)
        app.router.add_get("/{name:viewer\\.(?:js|css)}", self._page)
        app.router.add_get("/socket", self._socket)
        app.router.add_get("/save/{name}", self._save)
        app.router.add_post("/compare", self._compare)
        self._hosts.add(host)
        self._runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0, logger=LOGGER)
        await self._runner.setup()
        loop = asyncio.get_running_loop()
        try:
            self._listening = await loop.create_server(Connections(self._runner.server), host, port)
        except OSError as error:
            await self._runner.cleanup()
            # Python 3.13 gives no number if the host has no address of this machine, 3.10 a long text
            is_foreign = error.errno in (None, errno.EADDRNOTAVAIL)
            reason = "not an address of this machine" if is_foreign else error.strerror
            raise ElvisError(f"cannot listen on {host}:{port}: {reason}; see --host and --port") from error
        self.session.start()
        return int(self._listening.sockets[0].getsockname()[1])

    async def close(self) -> None:
        """Close all pages' sockets and end the drawing."""
        self._listening.close()
        await self.session.close()
        await self._runner.cleanup()

    @property
    def _guard(self) -> Any:
        """Refuses requests without the token, with unknown host names, and from pages of other origins."""
        from aiohttp import web

        @web.middleware
        async def guard(request: web.Request, handler: Callable[[web.Request], Awaitable[Any]]) -> Any:
            reason = refusal(request, self.token, self._hosts)
            if reason is not None:
                rejection = web.Response(status=403, text=f"{reason}\n")
                # strangers can't hold connections open
                rejection.force_close()
                return rejection
            answer = await handler(request)
            if not isinstance(answer, web.WebSocketResponse):
                answer.headers.update(HEADERS)
            return answer

        return guard

    async def _page(self, request: web.Request) -> web.Response:
        from aiohttp import web

        name, kind = PAGE[request.match_info.get("name", "")]
        text = (files("elvis.viewer") / "page" / name).read_text(encoding="utf-8")
        if name == "index.html":
            text = text.replace("{{token}}", self.token).replace("{{title}}", escape(f"{self.session.name} - ElVis"))
        return web.Response(text=text, content_type=kind)

    async def _socket(self, request: web.Request) -> web.WebSocketResponse:
        """One page: its messages go to the session, pictures come back."""
        from aiohttp import WSMsgType, web

        socket = web.WebSocketResponse(max_msg_size=MOST_BYTES, heartbeat=30.0)
        await socket.prepare(request)

        outbox = asyncio.Queue[str | bytes]()

        async def send(message: str | bytes) -> None:
            outbox.put_nowait(message)
            if outbox.qsize() > MOST_WAITING:
                await socket.close()

        answers = set[asyncio.Task[None]]()
        viewer = Viewer(send)
        await send(json.dumps({"type": "schema", **page_facts()}))
        # a page that takes nothing holds up nobody else
        posting = asyncio.get_running_loop().create_task(_post(socket, outbox))
        await self.session.join(viewer)
        try:
            async for message in socket:
                if message.type != WSMsgType.TEXT:
                    continue
                try:
                    content = table_of_text(message.data)
                except ElvisError as error:
                    await viewer.refuse(str(error))
                    continue
                work = self.session.receive(viewer, content)
                if id_of(content) is None:
                    await work
                    continue
                # changes don't wait for answers, which the drawing may delay
                answer = asyncio.get_running_loop().create_task(work)
                answers.add(answer)
                answer.add_done_callback(answers.discard)
        finally:
            posting.cancel()
            self.session.leave(viewer)
            if not self.session.viewers:
                self.on_empty()
        return socket

    async def _compare(self, request: web.Request) -> web.Response:
        """Take the files of a second dataset."""
        from aiohttp import web

        try:
            if not request.content_type.startswith("multipart/"):
                raise ElvisError("expected the files of a dataset as multipart/form-data")
            await self.session.compare(await received(await request.multipart()))
        except (ElvisError, ValueError, OSError) as error:
            return web.Response(status=400, text=f"{error}\n")
        return web.Response(text="read\n")

    async def _save(self, request: web.Request) -> web.Response:
        """The scene, the picture or the record as a file that the browser keeps."""
        from aiohttp import web

        name = request.match_info["name"]
        suffix = f".{name.rpartition('.')[2].lower()}"
        try:
            content = await self.session.content_of(suffix, _how(request))
        except ElvisError as error:
            return web.Response(status=400, text=f"{error}\n")
        # names of files may hold what headers may not
        own = re.sub(r"[^\w.-]", "_", self.session.name, flags=re.ASCII)
        headers = {"Content-Disposition": f'attachment; filename="{own}{suffix}"'}
        return web.Response(body=content, content_type="application/octet-stream", headers=headers)


async def _post(socket: web.WebSocketResponse, outbox: asyncio.Queue[str | bytes]) -> None:
    """Send the messages of an outbox in order until the page disconnects."""
    with suppress(ConnectionError, RuntimeError):
        while True:
            message = await outbox.get()
            await (socket.send_str(message) if isinstance(message, str) else socket.send_bytes(message))


def _how(request: web.Request) -> dict[str, Any]:
    """Size and samples of a picture to save, directions and steps of a page; SceneError unless they are numbers."""
    found = dict[str, Any]()
    try:
        for key in ("size", "samples", "directions", "all_steps") & request.query.keys():
            numbers = [int(text) for text in request.query[key].split("x")]
            found[key] = numbers if key == "size" else numbers[0]
    except ValueError as error:
        raise SceneError(
            "expected size=WIDTHxHEIGHT, samples=NUMBER, directions=NUMBER and all_steps=0 or 1, in whole numbers"
        ) from error
    return found


def page_facts() -> dict[str, Any]:
    """Facts from which the page makes its controls: the schema of scenes, the names of colour maps."""
    from elvis.scene.model.validation import scene_schema

    return {"schema": scene_schema(), "palettes": list(PALETTES)}


#: colour maps that the page offers; any other name may be typed
PALETTES = (
    *("viridis", "cividis", "plasma", "inferno", "magma", "turbo"),
    *("coolwarm", "RdBu_r", "PiYG", "gray", "twilight", "batlow", "vik"),
)


def _heed(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Report unhandled errors of tasks, except connections that pages reset while aiohttp sends."""
    if not isinstance(context.get("exception"), ConnectionResetError):
        loop.default_exception_handler(context)


def run_until_interrupted(work: Callable[[], Awaitable[object]]) -> None:
    """Run a coroutine in a loop; the first Ctrl-C or SIGTERM cancels it, wherever it arrives.

    An exception would be raised, and printed, in any of the tasks, or leave the loop with a task that never began.
    """
    before = dict[int, Any]()
    if threading.current_thread() is threading.main_thread():
        before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    tasks: list[tuple[asyncio.AbstractEventLoop, asyncio.Task[Any] | None]] = []
    interrupts = [0]

    def cancel(*_: object) -> None:
        interrupts[0] += 1
        if interrupts[0] > 1:
            raise KeyboardInterrupt
        for loop, task in tasks:
            if task is not None:
                # wakes the loop as well
                loop.call_soon_threadsafe(task.cancel)

    async def run() -> None:
        tasks.append((asyncio.get_running_loop(), asyncio.current_task()))
        if not interrupts[0]:
            await work()

    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, cancel)
    try:
        with suppress(asyncio.CancelledError):
            asyncio.run(run())
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


async def serve(
    server: Server,
    host: str,
    port: int,
    opened: Callable[[str], object],
    idle: float | None,
    needs_data: bool = False,
) -> None:
    """Serve until it is cancelled, or no page has been open for ``idle`` seconds.

    opened      called with the address once it can be opened
    needs_data  whether data that can't be read end it, by an ElvisError; else pages show why, until they can be read
    """
    done = asyncio.Event()
    unreadable: list[str] = []
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(_heed)

    def end_if_empty() -> None:
        if not server.session.viewers:
            done.set()

    waiting: list[asyncio.TimerHandle] = []

    def on_empty() -> None:
        if idle is None:
            return
        # the seconds count from the last one who left
        while waiting:
            waiting.pop().cancel()
        waiting.append(loop.call_later(idle, end_if_empty))

    def end(reason: str) -> bool:
        unreadable.append(reason)
        done.set()
        return True

    if needs_data:
        server.session.on_unreadable = end
    server.on_empty = on_empty
    own = await server.start(host, port)
    try:
        on_empty()
        with suppress(asyncio.TimeoutError):
            # a browser that opens at once would show nothing but the end
            await asyncio.wait_for(done.wait(), DOUBT if needs_data else 0)
        if not unreadable:
            opened(f"http://{host if ':' not in host else f'[{host}]'}:{own}/?token={server.token}")
            await done.wait()
    finally:
        await server.close()
    if unreadable:
        raise ElvisError(unreadable[0])
