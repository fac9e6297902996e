"""The viewer: how long after an event of the mouse its picture is there, while something is turned, and at rest.

Measured at the session, as a page would send and receive; the browser's own decoding is not in it.
"""

from __future__ import annotations

import asyncio
import json
import resource
import struct
from dataclasses import replace
from math import cos, pi, sin
from time import perf_counter
from typing import Any

import numpy as np
from shown import Shown
from tables import Table, seconds

from elvis.scene import Camera, Scene
from elvis.viewer.drawing_process import Source
from elvis.viewer.session import Session, Viewer

#: seconds from an event to its picture that 95 of 100 are to keep
LIMITS = {"cut": 0.1, "faces": 0.15, "isosurface": 0.25}
#: seconds between events
EVERY = 1 / 60


def measure(case: Shown, device: str, side: int, duration: float, quick: bool) -> dict[str, Any]:
    """All kinds of pictures of a case, turned about the vertical axis for some seconds."""
    data = case.dataset(quick)
    found = {}
    for kind in LIMITS:
        scene = next(iter(case.scenes(kind, side).values()))
        found[kind] = asyncio.run(_turn(scene, Source(data=data, device=device), duration))
    return {"case": case.name, "pixels": side, "kinds": found}


async def _turn(scene: Scene, source: Source, duration: float) -> dict[str, float]:
    """Seconds from events to pictures, and to the whole picture after the last one."""
    session, arrived = Session(scene, source), list[tuple[float, dict[str, Any]]]()
    page: Viewer

    async def send(message: str | bytes) -> None:
        if isinstance(message, bytes):
            length = struct.unpack("<I", message[:4])[0]
            arrived.append((perf_counter(), json.loads(message[4 : 4 + length])))
            await page.confirm()

    page = Viewer(send)
    session.start()
    start = perf_counter()
    await session.join(page)
    first = await _whole(arrived, 0)
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
    numbers = {"first": first - start, "pictures": count / duration, "median": p50, "p95": p95, "rest": rest}
    return {name: float(value) for name, value in {**numbers, "idle": share}.items()}


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


def table(numbers: dict[str, Any]) -> Table:
    """A row a kind of picture."""
    columns = ["picture", "first s", "pictures a second", "median s", "95 % s", "limit s", "at rest after s", "idle %"]
    found = Table(f"Viewer: {numbers['case']} wing, {numbers['pixels']}^2 pixels at rest", columns)
    for kind, own in numbers["kinds"].items():
        figures = [seconds(own["median"]), seconds(own["p95"]), str(LIMITS[kind]), seconds(own["rest"])]
        found.rows.append([kind, seconds(own["first"]), f"{own['pictures']:.1f}", *figures, f"{100 * own['idle']:.2f}"])
    found.notes = ["From an event of the mouse to its picture, at the session, while the view turns; kernels at hand."]
    return found
