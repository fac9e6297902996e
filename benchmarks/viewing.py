"""The viewer: how long after the command its first picture is there, and after an event of the mouse the next ones.

The first picture is measured from the start of the command to the socket of a page; others at the session, as a page
would send and receive, and at the end of a slow line to the server; the browser's own decoding is not in it.
"""

from __future__ import annotations

import asyncio
import json
import resource
import struct
import subprocess
from contextlib import suppress
from dataclasses import replace
from math import cos, pi, sin
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import aiohttp
import numpy as np
from measuring import Timing
from shown import Shown
from starting import ELVIS, children, run
from tables import Table, seconds

from elvis import write
from elvis.scene import Camera, Scene
from elvis.scene.model.files import write_scene
from elvis.viewer.drawing_process import Source
from elvis.viewer.server import Server
from elvis.viewer.session import Session
from elvis.viewer.viewers import Viewer

#: seconds from an event to its picture that 95 of 100 are to keep
LIMITS = {"cut": 0.1, "faces": 0.15, "isosurface": 0.25}
#: seconds between events
EVERY = 1 / 60
#: a slow line: seconds there and back, bytes a second; seconds after release until the whole picture is to be there
LATENCY, RATE, LIMIT_AT_REST = 0.1, 2e6 / 8, 1.5
#: seconds from the command to the first picture
LIMIT_OF_FIRST = 2.0


def measure(case: Shown, device: str, side: int, duration: float, quick: bool) -> dict[str, Any]:
    """All kinds of pictures of a case, turned about the vertical axis for some seconds."""
    data, rounds = case.dataset(quick), 1 if quick else 4
    found = {}
    with TemporaryDirectory() as folder:
        files = tuple(str(path) for path in write(data, Path(folder) / "case.xml"))
        for kind in list(LIMITS)[: 1 if quick else None]:
            scene = replace(next(iter(case.scenes(kind, side).values())), data=files, device=device)
            source = Source(data=data, device=device)
            numbers = _start(scene, Path(folder), rounds) | asyncio.run(_turn(scene, source, duration))
            found[kind] = numbers | asyncio.run(_turn_far(scene, source, duration))
    return {"case": case.name, "pixels": side, "kinds": found}


def _start(scene: Scene, folder: Path, rounds: int) -> dict[str, float]:
    """Smallest seconds from the command to the first picture and to the whole one, next to those of ``elvis render``.

    A round before them, which may compile, doesn't count.
    """
    file, runs, timing = folder / "scene.toml", list[tuple[float, float, float]](), Timing()
    write_scene(scene, file)
    drawn = [*ELVIS, "render", str(file), "-o", str(folder / "scene.png")]
    for number in range(-1 if rounds > 1 else 0, rounds):
        before = children()
        times = asyncio.run(_open([*ELVIS, "view", str(file), "--no-browser"]))
        runs.append((*times, children() - before))
        run(drawn, timing if number >= 0 else Timing())
    first, whole, processor = np.min(runs[-rounds:], axis=0)
    own = {"first": first, "whole": whole, "start processor": processor}
    return {**own, "render": timing.best, "render processor": timing.effort}


async def _open(command: list[str]) -> tuple[float, float]:
    """Seconds until a page that joins as soon as it can has a picture, and the whole one."""
    start = perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = (await asyncio.to_thread(process.stdout.readline)).strip()
        arrived = list[tuple[float, dict[str, Any]]]()
        async with (
            aiohttp.ClientSession() as client,
            client.ws_connect(address.replace("/?", "/socket?"), max_msg_size=0) as socket,
        ):
            while not arrived or not arrived[-1][1]["final"]:
                message = await socket.receive()
                if message.type == aiohttp.WSMsgType.BINARY:
                    arrived.append((perf_counter() - start, _facts_of(message.data)))
                    await socket.send_json({"type": "shown"})
        process.terminate()
    return arrived[0][0], arrived[-1][0]


async def _turn(scene: Scene, source: Source, duration: float) -> dict[str, float]:
    """Seconds from events to pictures, and to the whole picture after the last one."""
    session, arrived = Session(scene, source), list[tuple[float, dict[str, Any]]]()
    page: Viewer

    async def send(message: str | bytes) -> None:
        if isinstance(message, bytes):
            arrived.append((perf_counter(), _facts_of(message)))
            await page.confirm()

    page = Viewer(send)
    session.start()
    await session.join(page)
    await _whole(arrived, 0)
    await session.change({"camera": _camera(scene, 0.01)})
    await _whole(arrived, session.revision)

    # the mouse turns the picture
    sent, begin, number = dict[int, float](), perf_counter(), 0
    arrived.clear()
    while perf_counter() - begin < duration:
        number += 1
        sent[session.revision + 1] = perf_counter()
        await session.change({"camera": _camera(scene, 0.01 * number)}, is_moving=True)
        await asyncio.sleep(EVERY)
    waits = [when - sent[facts["revision"]] for when, facts in arrived if facts["revision"] in sent]
    count = len(waits)
    released = perf_counter()
    await session.change({"camera": _camera(scene, 0.01 * number)})
    rest = await _whole(arrived, session.revision) - released

    # nothing happens
    idle, clock = _processor(), perf_counter()
    await asyncio.sleep(duration)
    share = (_processor() - idle) / (perf_counter() - clock)
    await session.close()
    p50, p95 = np.percentile(waits, [50, 95]) if waits else (np.nan, np.nan)
    numbers = {"pictures": count / duration, "median": p50, "p95": p95, "rest": rest}
    return {name: float(value) for name, value in {**numbers, "idle": share}.items()}


async def _turn_far(scene: Scene, source: Source, duration: float) -> dict[str, float]:
    """The same at the end of a slow line: seconds, pictures on their way at once, bytes of the whole picture."""
    session = Session(scene, source)
    server = Server(session)
    port = await server.start("127.0.0.1", 0)
    arrived, most, size = list[tuple[float, dict[str, Any]]](), 0, 0

    async def show(socket: aiohttp.ClientWebSocketResponse) -> None:
        nonlocal most, size
        async for message in socket:
            if message.type == aiohttp.WSMsgType.BINARY:
                most = max(most, *(viewer.sent - viewer.confirmed for viewer in session.viewers))
                size = len(message.data)
                arrived.append((perf_counter(), _facts_of(message.data)))
                await socket.send_json({"type": "shown"})

    async with SlowLine(port) as line, aiohttp.ClientSession() as client:
        address = f"http://127.0.0.1:{line.port}/socket?token={server.token}"
        async with client.ws_connect(address, max_msg_size=0) as socket:
            page = asyncio.create_task(show(socket))
            await _whole(arrived, 0)
            arrived.clear()
            begin, number = perf_counter(), 0
            while perf_counter() - begin < duration:
                number += 1
                camera = {"camera": _camera(scene, 0.01 * number)}
                await socket.send_json({"type": "change", "changes": camera, "moving": True})
                await asyncio.sleep(EVERY)
            count, released = len(arrived), perf_counter()
            await socket.send_json({"type": "change", "changes": camera, "moving": False})
            rest = await _whole(arrived, number + 1) - released
            page.cancel()
    await server.close()
    return {"far pictures": count / duration, "far rest": rest, "far queued": most, "far bytes": size}


class SlowLine:
    """A port of this machine that leads to another one, as over a slow line."""

    def __init__(self, target: int) -> None:
        self._target = target

    async def __aenter__(self) -> SlowLine:
        self._server = await asyncio.start_server(self._connect, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_: object) -> None:
        self._server.close()

    async def _connect(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._target)
        # either end may be gone while bytes are on their way
        with suppress(ConnectionError):
            await asyncio.gather(self._carry(reader, far_writer), self._carry(far_reader, writer))

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Hand on what comes, each byte after those before it, and all of them half of the latency later."""
        loop, free = asyncio.get_running_loop(), 0.0

        def deliver(data: bytes) -> None:
            if not writer.is_closing():
                writer.write(data)

        while data := await reader.read(4096):
            free = max(free, loop.time()) + len(data) / RATE
            loop.call_at(free + LATENCY / 2, deliver, data)
            # the line holds no more than what it is sending
            await asyncio.sleep(free - loop.time())
        loop.call_at(max(free, loop.time()) + LATENCY / 2, writer.close)


def _facts_of(message: bytes) -> dict[str, Any]:
    """What a picture's message says of it."""
    length = struct.unpack("<I", message[:4])[0]
    facts: dict[str, Any] = json.loads(message[4 : 4 + length])
    return facts


async def _whole(arrived: list[tuple[float, dict[str, Any]]], revision: int) -> float:
    """When the whole picture of a revision, or a later one, was there."""
    while True:
        found = [when for when, facts in arrived if facts["final"] and facts["revision"] >= revision]
        if found:
            return found[0]
        await asyncio.sleep(0.002)


def _camera(scene: Scene, angle: float) -> dict[str, Any]:
    """The scene's camera, turned about the vertical axis through its target by an angle in radians."""
    camera = scene.camera
    assert isinstance(camera, Camera)
    away = np.subtract(camera.eye, camera.at)
    turn = angle % (pi / 2)
    x, y = cos(turn) * away[0] - sin(turn) * away[1], sin(turn) * away[0] + cos(turn) * away[1]
    eye = tuple(float(value) for value in np.add(camera.at, (x, y, away[2])))
    moved = replace(camera, eye=eye)
    return {"eye": list(moved.eye), "at": list(moved.at), "up": list(moved.up), "height": moved.height}


def _processor() -> float:
    """Processor seconds of this process, which serves."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def tables(numbers: dict[str, Any]) -> list[Table]:
    """A row a kind of picture: until the first one, while the mouse turns it, and both at the end of a slow line."""
    return [_first_table(numbers), _turning_table(numbers), _far_table(numbers)]


def _first_table(numbers: dict[str, Any]) -> Table:
    columns = ["picture", "first s", "limit s", "whole s", "CPU s", "elvis render s", "its CPU s"]
    names = ["whole", "start processor", "render", "render processor"]
    rows = [
        [kind, seconds(own["first"]), str(LIMIT_OF_FIRST), *(seconds(own[name]) for name in names)]
        for kind, own in numbers["kinds"].items()
    ]
    note = (
        "From the command to a page that joins as soon as it can: the first picture, a draft, and the whole one; least "
        "of some runs with kernels at hand, beside `elvis render` of the same scene in turn."
    )
    return Table(_title("the first picture", numbers), columns, rows, [note])


def _turning_table(numbers: dict[str, Any]) -> Table:
    columns = ["picture", "pictures a second", "median s", "95 % s", "limit s", "at rest after s", "idle %"]
    rows = []
    for kind, own in numbers["kinds"].items():
        figures = [seconds(own["median"]), seconds(own["p95"]), str(LIMITS[kind]), seconds(own["rest"])]
        rows.append([kind, f"{own['pictures']:.1f}", *figures, f"{100 * own['idle']:.2f}"])
    note = "From an event of the mouse to its picture, at the session, while the view turns; kernels at hand."
    return Table(_title("turning", numbers), columns, rows, [note])


def _far_table(numbers: dict[str, Any]) -> Table:
    columns = ["picture", "pictures a second", "at rest after s", "limit s", "bytes at rest", "queued at most"]
    rows = []
    for kind, own in numbers["kinds"].items():
        figures = [f"{own['far pictures']:.1f}", seconds(own["far rest"]), str(LIMIT_AT_REST)]
        rows.append([kind, *figures, f"{own['far bytes']:.0f}", f"{own['far queued']:.0f}"])
    note = f"{1000 * LATENCY:.0f} ms there and back, {8e-6 * RATE:.0f} Mbit/s, a proxy of this machine."
    return Table(_title("a slow line", numbers), columns, rows, [note])


def _title(what: str, numbers: dict[str, Any]) -> str:
    return f"Viewer, {what}: {numbers['case']} wing, {numbers['pixels']}^2 pixels at rest"
