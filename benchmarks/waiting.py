"""How long a page waits for a short answer while kernels of another page's picture are compiled for the first time."""

from __future__ import annotations

import asyncio
import json
import sys
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np
from cases import CUT, FIELD, of_order
from orders import caches_in
from starting import children
from tables import Table

from elvis import Contours, CutSurface, Isosurface, Scene, Shape, Style, Transfer, VolumeRendering
from elvis.viewer.drawing_process import Source
from elvis.viewer.session import Session
from elvis.viewer.viewers import Viewer

#: seconds between two questions
PAUSE = 0.01
#: order of the fields
ORDER = 3
#: what the first page shows, one after the other
OBJECTS: dict[str, Any] = {
    "contours": CutSurface(CUT, Style(contours=Contours(count=5))),
    "isosurface": Isosurface((0.5,)),
    "volume": VolumeRendering(Transfer((-1.0, 0.0, 1.0), (0.0, 1.0, 3.0))),
}


def measure(device: str, quick: bool) -> dict[str, Any]:
    """Waits and seconds of each picture, with empty caches and again with the cached kernels."""
    names = list(OBJECTS)[: 1 if quick else None]
    rounds = {}
    with TemporaryDirectory() as folder, caches_in(Path(folder)):
        for caches in ("empty", "full"):
            rounds[caches] = {name: asyncio.run(_shown(name, device)) for name in names}
    return {"order": ORDER, "rounds": rounds}


async def _shown(name: str, device: str) -> dict[str, float]:
    """The longest and the median wait of a second page while a picture is drawn, and the picture's own seconds."""
    before = children()
    data = of_order(Shape.HEXAHEDRON, 1, ORDER, quick=True).dataset()
    scene = Scene(FIELD, camera="iso", size=(64, 48), device=device, objects=(OBJECTS[name],))
    session = Session(scene, Source(data=data, device=device))
    pages = [Page(session), Page(session)]
    session.start()
    start = perf_counter()
    await pages[1].wait()
    await session.join(pages[0].viewer)
    drawing = asyncio.create_task(session.whole_message(inf))
    waits = list[float]()
    while not drawing.done():
        waits.append(await pages[1].wait())
        await asyncio.sleep(PAUSE)
    seconds = perf_counter() - start
    await session.close()
    own = {"seconds": seconds, "processor": children() - before}
    return {"longest": max(waits), "median": float(np.median(waits)), **own}


class Page:
    """A page without a browser."""

    def __init__(self, session: Session) -> None:
        self.viewer = Viewer(self._take)
        self._session, self._answered = session, asyncio.Event()

    async def wait(self) -> float:
        """Seconds until the drawing process has answered a question that takes it no time."""
        self._answered.clear()
        start = perf_counter()
        await self._session.receive(self.viewer, {"type": "check", "id": 1, "content": FIELD})
        await self._answered.wait()
        return perf_counter() - start

    async def _take(self, message: str | bytes) -> None:
        if isinstance(message, bytes):
            await self.viewer.confirm()
        elif json.loads(message)["type"] == "answer":
            self._answered.set()


def table(numbers: dict[str, Any]) -> Table:
    """A row a picture."""
    columns = ["picture", "caches", "longest wait s", "median wait s", "picture s", "CPU s"]
    shown = Table("Waiting for a short answer while another page's picture is drawn", columns)
    for caches, own in numbers["rounds"].items():
        for name, found in own.items():
            row = [found[key] for key in ("longest", "median", "seconds", "processor")]
            shown.rows.append([name, caches, *(f"{value:.2f}" for value in row)])
    return shown


if __name__ == "__main__":
    print(table(measure("auto", "--quick" in sys.argv)).text())
