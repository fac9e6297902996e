"""A scene that is looked at: its history, the process that draws it, and those who look."""

from __future__ import annotations

import asyncio
import json
import struct
import threading
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any, TypeAlias

from elvis.core.errors import ElvisError
from elvis.scene.errors import SceneError
from elvis.scene.files import scene_text
from elvis.scene.permissions import PICTURES
from elvis.scene.tables import Table, table_of
from elvis.scene.whole import Scene
from elvis.viewer.drawing_process import Source, spawn
from elvis.viewer.patches import FIXED, folder_of, patched, scene_of_page

#: seconds after the last change while something moves, until the picture is drawn whole
REST = 0.25
#: seconds that a picture may take while something moves, and parts of the full size each way that it may have
GOAL, PARTS = 1 / 30, (1.0, 0.5, 0.25)
#: pictures on their way to a page that it has not confirmed, at most
UNCONFIRMED = 2
#: scenes that can be undone
HISTORY = 200
#: deaths of the drawing process in a row after which it is not started again
DEATHS = 3
#: suffixes of scenes that can be saved
SCENES = (".toml", ".yaml", ".json")
#: pixels of a picture each way
LEAST, MOST = 64, 8192
Send: TypeAlias = Callable[[str | bytes], Awaitable[None]]


class DiedError(ElvisError):
    """The process that draws has ended."""


class Drawer:
    """The process that draws, seen from the server: one request at a time; started when it is needed."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self._process: Any = None
        self._pipe: Any = None
        self._newest: Any = None
        self._number = 0
        self._turn = asyncio.Lock()

    async def ask(self, name: str, content: Any = None) -> Any:
        """The answer to a request; ElvisError with the reason where there is none, None for an obsolete picture."""
        async with self._turn:
            if self._process is None:
                self._process, self._pipe, self._newest = spawn(self.source)
            self._number += 1
            self._newest.value = self._number
            return await self._exchange(name, self._number, content)

    async def _exchange(self, name: str, number: int, content: Any) -> Any:
        loop, pipe = asyncio.get_running_loop(), self._pipe
        answer: asyncio.Future[Any] = loop.create_future()

        def settle(found: Any) -> None:
            if not answer.done():
                answer.set_result(found)

        def wait() -> None:
            try:
                pipe.send((name, number, content))
                found = pipe.recv()
            except (EOFError, OSError):
                found = ("died", number, "")
            loop.call_soon_threadsafe(settle, found)

        threading.Thread(target=wait, daemon=True).start()
        kind, _, found = await answer
        if kind == "died":
            self.close()
            raise DiedError("the process that draws has ended, and is started again")
        if kind == "error":
            raise ElvisError(found)
        return None if kind == "obsolete" else found

    def make_obsolete(self) -> None:
        """Let the picture that is being drawn be left: something newer is wanted."""
        if self._newest is not None:
            self._newest.value = self._number + 1

    @property
    def pid(self) -> int | None:
        """Of the process, None while there is none."""
        return None if self._process is None else self._process.pid

    def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is None:
            return
        self._pipe.close()
        process.terminate()
        process.join(2)
        if process.is_alive():
            process.kill()


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
        """Send a picture, or keep a final one until there is room; others are left out."""
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


@dataclass(eq=False)
class Session:
    """A scene and those who look at it.

    scene   what is shown first; its files are the data
    source  the same for the process that draws
    """

    scene: Scene
    source: Source
    viewers: set[Viewer] = field(default_factory=set)
    #: what programs that hold the session hear of: the scene after each change
    listeners: list[Callable[[Scene], None]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.table: Table = {key: value for key, value in table_of(self.scene).items() if key not in FIXED}
        self.size = self.scene.size or (900, 700)
        self.facts: Table | None = None
        self.message: bytes | None = None
        self.revision = 0
        self.is_proof = False
        self._undo: list[Table] = []
        self._redo: list[Table] = []
        self._before: Table | None = None
        self._moved = 0.0
        self._cost: float | None = None
        self._number = 0
        self._deaths = 0
        self._is_drawing_whole = False
        self._drawer = Drawer(self.source)
        self._wake = asyncio.Event()
        self._wake.set()
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Begin to draw, on the running loop."""
        self._task = asyncio.get_running_loop().create_task(self._draw_for_ever())

    async def close(self) -> None:
        """End the drawing."""
        if self._task is not None:
            self._task.cancel()
        self._drawer.close()

    async def join(self, viewer: Viewer) -> None:
        """Somebody begins to look: the state, and the picture that there is."""
        self.viewers.add(viewer)
        await viewer.send(self._state())
        if self.message is not None:
            await viewer.take(self._number, self.message, True)
        self._wake.set()

    def leave(self, viewer: Viewer) -> None:
        """Somebody looks no more."""
        self.viewers.discard(viewer)

    # what a page asks for

    async def receive(self, viewer: Viewer, message: Table) -> None:
        """A message of a page; what is wrong with it goes back as a sentence."""
        try:
            answer = await self._answer(viewer, str(message.get("type")), message)
        except (ElvisError, KeyError, TypeError, ValueError) as error:
            reason = str(error) if isinstance(error, ElvisError) else f"the viewer does not understand {message!r:.100}"
            answer = {"type": "error", "text": reason}
            if "id" in message:
                answer["id"] = message["id"]
        if answer is not None:
            await viewer.send(json.dumps(answer))

    async def _answer(self, viewer: Viewer, kind: str, message: Table) -> Table | None:
        match kind:
            case "shown":
                await viewer.confirm()
            case "change":
                await self.change(message["changes"], is_moving=bool(message.get("moving")), by=viewer)
            case "size":
                width, height = (min(max(int(side), LEAST), MOST) for side in message["size"])
                if (width, height) != self.size:
                    self.size = width, height
                    self._wake_up()
            case "undo" | "redo":
                await self._step(kind)
            case "proof":
                self.is_proof = bool(message["on"])
                self._wake_up()
            case "pick" | "line" | "check":
                found = await self._drawer.ask(kind, message["content"])
                return {"type": "answer", "id": message["id"], "content": found}
            case _:
                raise ValueError(kind)
        return None

    async def change(self, changes: Table, *, is_moving: bool = False, by: Viewer | None = None) -> None:
        """Change the scene in some places; SceneError where it would not be valid, and nothing is changed."""
        table = patched(self.table, changes)
        scene_of_page(table, self.scene)
        if self._before is None:
            self._before = self.table
        if not is_moving and self._before != table:
            self._undo = [*self._undo, self._before][-HISTORY:]
            self._redo = []
        if not is_moving:
            self._before = None
        await self._set(table, is_moving, by)

    async def _step(self, kind: str) -> None:
        """Undo or redo."""
        back, forth = (self._undo, self._redo) if kind == "undo" else (self._redo, self._undo)
        if back:
            forth.append(self.table)
            await self._set(back.pop(), False, None)

    async def _set(self, table: Table, is_moving: bool, by: Viewer | None) -> None:
        self.table = table
        self.revision += 1
        self._moved = perf_counter() if is_moving else 0.0
        for listener in self.listeners:
            listener(self.current)
        self._wake_up()
        others = [viewer for viewer in self.viewers if viewer is not by or not is_moving]
        for viewer in others:
            await viewer.send(self._state())

    def _wake_up(self) -> None:
        """A new picture is wanted; the one that is being drawn isn't any more, unless it shows how something moves."""
        if self._is_drawing_whole or not self._is_moving:
            self._drawer.make_obsolete()
        self._wake.set()

    @property
    def _is_moving(self) -> bool:
        return perf_counter() - self._moved < REST

    @property
    def current(self) -> Scene:
        """The scene as it is, with the size of the picture."""
        return replace(scene_of_page(self.table, self.scene), size=self.size)

    def text(self, suffix: str) -> str:
        """The scene as a file; SceneError for another suffix than .toml, .yaml, .json."""
        return scene_text(self.current, folder_of(self.scene) / f"scene{suffix}")

    async def content_of(self, suffix: str, size: tuple[int, int] | None = None, samples: int | None = None) -> bytes:
        """What is saved: the scene, or the picture or record of it; ElvisError for another suffix."""
        if suffix in SCENES:
            return self.text(suffix).encode()
        if suffix not in PICTURES:
            raise SceneError(f"expected a name that ends in {', '.join((*SCENES, *PICTURES))}, found {suffix!r:.80}")
        return await self._file(suffix, size, samples)

    async def first_message(self, patience: float) -> bytes | None:
        """The last whole picture with its facts, for which this waits for some seconds; None where there is none."""
        end = perf_counter() + patience
        while self.message is None and perf_counter() < end:
            await asyncio.sleep(0.02)
        return self.message

    async def _file(self, suffix: str, size: tuple[int, int] | None, samples: int | None) -> bytes:
        """The picture or the record as a file, at any size."""
        scene = replace(self.current, size=size or self.size)
        scene = replace(scene, samples=samples) if samples else scene
        found = await self._drawer.ask("save", {"table": table_of(scene), "suffix": suffix})
        if found is None:
            raise SceneError("the picture was given up, as the scene has changed: save it again")
        return bytes(found)

    def _state(self) -> str:
        known = {"table": self.table, "revision": self.revision, "size": self.size, "facts": self.facts}
        steps = {"undo": len(self._undo), "redo": len(self._redo), "proof": self.is_proof}
        return json.dumps({"type": "state", **known, **steps})

    # drawing

    async def _draw_for_ever(self) -> None:
        """Draw whenever something has changed and somebody looks."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            try:
                await self._facts_once()
                await self._draw()
                self._deaths = 0
            except DiedError as error:
                self._deaths += 1
                await self._tell(str(error) if self._deaths < DEATHS else "the process that draws ends again and again")
                if self._deaths < DEATHS:
                    self._wake.set()
            except ElvisError as error:
                await self._tell(str(error))
            except Exception as error:  # a fault must not end the viewer
                await self._tell(f"unexpected {type(error).__name__}: {error}; this is a fault of the program")

    async def _facts_once(self) -> None:
        if self.facts is None:
            self.facts = await self._drawer.ask("facts")
            for viewer in list(self.viewers):
                await viewer.send(self._state())

    async def _draw(self) -> None:
        """One picture; while something moves a quick one, and a whole one after it."""
        is_moving, revision = self._is_moving, self.revision
        part = self._part() if is_moving else 1.0
        content = {"table": table_of(self.current), "part": part, "is_moving": is_moving, "proof": self.is_proof}
        start = perf_counter()
        self._is_drawing_whole = not is_moving
        try:
            found = await self._drawer.ask("draw", content)
        finally:
            self._is_drawing_whole = False
        if found is None:
            return
        facts, file = found
        # seconds of a picture of full size, by the last one
        self._cost = (perf_counter() - start) / part**2
        if is_moving:
            asyncio.get_running_loop().call_later(REST, self._wake.set)
        await self._show({**facts, "revision": revision}, file)

    def _part(self) -> float:
        """The greatest part of the full size that is drawn in time, as far as is known: cost goes with pixels."""
        pixel = self._cost
        fitting = [part for part in PARTS if pixel is not None and pixel * part**2 <= GOAL]
        return max(fitting, default=PARTS[-1])

    async def _show(self, facts: Table, file: bytes) -> None:
        """A picture to all who look: the length of the facts, the facts, the file."""
        head = json.dumps(facts).encode()
        message = struct.pack("<I", len(head)) + head + file
        self._number += 1
        if facts["final"]:
            self.message = message
        for viewer in list(self.viewers):
            await viewer.take(self._number, message, bool(facts["final"]))

    async def _tell(self, text: str) -> None:
        for viewer in list(self.viewers):
            await viewer.send(json.dumps({"type": "error", "text": text}))
