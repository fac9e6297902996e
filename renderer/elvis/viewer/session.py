"""A scene in the viewer: its history, the process that draws it, and its viewers."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Any

from elvis.core.base.errors import ElvisError, fault_sentence
from elvis.core.base.terminal import warn
from elvis.core.files.output import write_bytes
from elvis.scene.model.errors import AbsentError, SceneError
from elvis.scene.model.files import SUFFIXES, scene_text
from elvis.scene.model.permissions import PICTURES
from elvis.scene.model.tables import Table, input_files, table_of
from elvis.scene.model.whole import Scene
from elvis.viewer import messages
from elvis.viewer.contents import first_sight
from elvis.viewer.drawer import SAVE, DiedError, Drawer
from elvis.viewer.drawing_process import Process, Source
from elvis.viewer.messages import AnyMessage, Message, Question, parsed
from elvis.viewer.page_files import views_of
from elvis.viewer.patches import FIXED, folder_of, patched, placed, put_back, scene_of_page, without
from elvis.viewer.placing import TakenError, place_of
from elvis.viewer.rereading import Rereading, first_of
from elvis.viewer.second_data import SentFiles, sources_with
from elvis.viewer.sizing import LATE, MOST, Sizing, limited_size
from elvis.viewer.viewers import Viewer, is_any_slow
from elvis.viewer.watching import WatchedFiles

#: seconds after the last change while something moves, until the picture is drawn whole
REST = 0.25
#: scenes that can be undone
HISTORY = 200
#: seconds between looks at the files that were read
WATCH = 2.0
#: deaths of the drawing process in a row after which it is not started again
DEATHS = 3
#: times that a picture to save is begun, at most; it is left when the viewer needs another picture
MAX_SAVES = 5
#: drafts that nobody sees, at most: the first one may load kernels
TRIALS = 2
#: objects that can be hidden
MOST_HIDDEN = 1000
#: a scene's table, and the objects that are hidden: each its key and itself
Shown = tuple[Table, tuple[Table, ...]]


@dataclass(eq=False)
class Session:
    """A scene and its viewers.

    scene      shown first; its files are the data
    source     of the data, for the drawing process
    may_write  whether pages may write files in the folder of the data or below
    process    a drawing process that has already been started
    """

    scene: Scene
    source: Source
    may_write: bool = False
    process: Process | None = None
    viewers: set[Viewer] = field(default_factory=set)
    #: what programs that hold the session hear of: the scene after each change
    listeners: list[Callable[[Scene], None]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.table: Table = {key: value for key, value in table_of(self.scene).items() if key not in FIXED}
        self._start = self.table
        self.size = self.scene.size or (900, 700)
        self.facts: Table | None = None
        self.message: bytes | None = None
        self.revision = 0
        self.is_proof = False
        self._paper: list[float] | None = None
        #: objects that are retained, but not shown
        self.hidden: tuple[Table, ...] = ()
        self._undo: list[Shown] = []
        self._redo: list[Shown] = []
        self._before: Shown | None = None
        self._moved = 0.0
        self._sizing = Sizing()
        self._number = 0
        self._deaths = 0
        #: the last scene with a complete picture, or with a reason why there is none
        self._settled = -1
        self._leavable = 0
        self._saving = asyncio.Lock()
        self._has_shown = False
        #: called with the reason if the data can't be read when they are read first; whether that ends the drawing
        self.on_unreadable: Callable[[str], bool] = lambda reason: False
        self._drawer = Drawer(self.source, self.process)
        self._files = WatchedFiles(self.scene.data)
        #: removes the files of the second dataset
        self._second = ExitStack()
        #: changes on disk since the data were read
        self._stale = ""
        self._wake = asyncio.Event()
        self._wake.set()
        self._tasks: list[asyncio.Task[None]] = []
        #: the scene remains unchanged, and pages get answers on the previous data meanwhile
        self.rereading = Rereading(lambda: self._read_from(self.source), self._tell)

    def start(self) -> None:
        """Begin to draw, on the running loop."""
        loop = asyncio.get_running_loop()
        self._tasks = [loop.create_task(self._draw_for_ever()), loop.create_task(self._watch_for_ever())]

    async def close(self) -> None:
        """End the drawing."""
        self.rereading.cancel()
        for task in self._tasks:
            task.cancel()
        self._drawer.close()
        self._second.close()

    async def join(self, viewer: Viewer) -> None:
        """Somebody begins to look: the state, and the picture that there is."""
        self.viewers.add(viewer)
        await viewer.send(self._state(start=self._start))
        if self.message is not None:
            await viewer.take(self._number, self.message, True)
        self._wake.set()

    def leave(self, viewer: Viewer) -> None:
        """Remove a viewer."""
        self.viewers.discard(viewer)

    # what a page asks for

    async def receive(self, viewer: Viewer, message: object) -> None:
        """Handle a message of a page; errors are sent back."""
        try:
            answer = await self._answer(viewer, parsed(message))
        except Exception as error:  # noqa: BLE001 - a fault must not end the connection
            await viewer.refuse(fault_sentence(error), message)
        else:
            if answer is not None:
                await viewer.send(json.dumps(answer))

    async def _answer(self, viewer: Viewer, message: AnyMessage) -> Table | None:
        """Do what a message says; the answer, if it asks for one."""
        match message:
            case messages.Shown():
                await viewer.confirm()
            case messages.Change():
                await self.change(message.changes, is_moving=message.moving, by=viewer)
            case messages.Size():
                self._resize(message.size)
            case messages.Paper():
                self._take_paper(message.color)
            case messages.Hide():
                await self.hide(message.key)
            case messages.Unhide():
                await self.unhide(message.number, is_kept=message.type == "unhide")
            case messages.Step():
                await self._step(message.type)
            case messages.Proof():
                self.is_proof = message.on
                self._wake_up()
                await self._send_state()
            case messages.ReadAgain():
                self.rereading.request()
            case _:
                return {"type": "answer", "id": message.id, "content": await self._content_for(viewer, message)}
        return None

    async def _content_for(self, viewer: Viewer, message: Question) -> Any:
        """The content that a page requests."""
        if isinstance(message, messages.Copy):
            return self.lines(message.content)
        async with viewer.question():
            if isinstance(message, messages.Write):
                return await self._write(message.content.name, message.content.confirmed)
            return await self._drawn_content(message)

    async def _drawn_content(self, message: Question) -> Any:
        """The answer of the process that draws."""
        match message:
            case messages.Linear():
                return await self._ask_leavably(message.type, message.content.model_dump())
            case messages.Other() if not message.content.draft:
                return await self._ask_leavably(message.type, message.content.model_dump())
        content = message.content
        known = content.model_dump(exclude_none=True) if isinstance(content, Message) else content
        return await self._drawer.ask(message.type, known)

    def _resize(self, size: Sequence[float]) -> None:
        """Draw in another size, within the limits."""
        limited = limited_size(size)
        if limited != self.size:
            self.size = limited
            self._wake_up()

    def _take_paper(self, color: list[float] | None) -> None:
        """Draw on another background where the scene has none; saved pictures and scenes stay as they are."""
        if color != self._paper:
            self._paper = color
            self._wake_up()

    def _shown_table(self) -> Table:
        """The table of the scene as pages show it."""
        table = table_of(self.current)
        # a table of a scene omits defaults: white may have been chosen
        if self._paper is None or "background" in self.table:
            return table
        return {**table, "background": self._paper}

    async def change(self, changes: Table, *, is_moving: bool = False, by: Viewer | None = None) -> None:
        """Change the scene in some places; SceneError where it would not be valid, and nothing is changed."""
        await self._take(patched(self.table, changes), self.hidden, is_moving, by)

    async def hide(self, key: str) -> None:
        """Hide an object, ``plane``, ``objects[n]`` or ``clip[n]``, and keep it; SceneError for another key."""
        if len(self.hidden) >= MOST_HIDDEN:
            raise SceneError(f"{MOST_HIDDEN} objects are already hidden; delete some of them")
        table, item = without(self.table, key)
        await self._take(table, (*self.hidden, item))

    async def unhide(self, number: int, is_kept: bool = True) -> None:
        """Show a hidden object again, where it was, or forget it; SceneError where there is none."""
        if not 0 <= number < len(self.hidden):
            raise SceneError("the hidden object no longer exists")
        item, rest = self.hidden[number], (*self.hidden[:number], *self.hidden[number + 1 :])
        await self._take(put_back(self.table, item) if is_kept else self.table, rest)

    async def _take(
        self, table: Table, hidden: tuple[Table, ...], is_moving: bool = False, by: Viewer | None = None
    ) -> None:
        """Show another scene; SceneError where it would not be valid."""
        table = placed(table, scene_of_page(table, self.scene), self.facts)
        if self._before is None:
            self._before = self.table, self.hidden
        if not is_moving and self._before != (table, hidden):
            self._undo = [*self._undo, self._before][-HISTORY:]
            self._redo = []
        if not is_moving:
            self._before = None
        await self._set((table, hidden), is_moving, by)

    async def _step(self, kind: str) -> None:
        """Undo or redo."""
        back, forth = (self._undo, self._redo) if kind == "undo" else (self._redo, self._undo)
        if back:
            forth.append((self.table, self.hidden))
            await self._set(back.pop(), False, None)

    async def _set(self, shown: Shown, is_moving: bool, by: Viewer | None) -> None:
        self.table, self.hidden = shown
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
        if self._leavable or not self._is_moving:
            self._drawer.make_obsolete()
        self._wake.set()

    @property
    def _is_moving(self) -> bool:
        return perf_counter() - self._moved < REST

    @property
    def current(self) -> Scene:
        """The current scene, with the size of the picture."""
        return replace(scene_of_page(self.table, self.scene), size=self.size)

    @property
    def name(self) -> str:
        """The name of the data without suffix, for titles and files; ``elvis`` for data that are not files."""
        first = next(iter(self.scene.data), "elvis")
        return Path(Path(first).name.removesuffix(".gz")).stem or "elvis"

    def text(self, suffix: str) -> str:
        """The scene as a file; SceneError for another suffix than .toml, .yaml, .json."""
        return scene_text(self.current, folder_of(self.scene) / f"scene{suffix}")

    def lines(self, language: str) -> str:
        """A ``command`` or lines of ``Python`` that reproduce this picture; SceneError if there are none."""
        from elvis.scene.commandline.writing import command_of, python_of

        writers = {"command": command_of, "Python": python_of}
        return writers[language](self.current)

    async def content_of(self, suffix: str, how: Mapping[str, Any] | None = None) -> bytes:
        """The contents of a file to save: the scene, its picture or record; ElvisError for another suffix.

        how  ``size`` and ``samples`` of a picture if they differ from the scene's; ``directions`` and ``all_steps`` of
             a page; SceneError for invalid values
        """
        if suffix in SUFFIXES:
            return self.text(suffix).encode()
        if suffix not in PICTURES:
            raise SceneError(f"expected a name that ends in {', '.join((*SUFFIXES, *PICTURES))}, found {suffix!r:.80}")
        return await self._file(suffix, how or {})

    async def _write(self, name: str, confirmed: bool = False) -> Table:
        """Write what `content_of` gives into the folder of the data: where it is, or a question; else ElvisError."""
        if not self.may_write:
            raise SceneError("writing files is not allowed; start elvis view with --allow-writes")
        scene = self.current
        try:
            place = place_of(name, folder_of(self.scene), input_files(scene), is_confirmed=confirmed)
        except TakenError as error:
            return {"question": f"{error}. Replace it?"}
        suffix = place.suffix.lower()
        # names of files in a scene are relative to the place where it stands
        content = scene_text(scene, place).encode() if suffix in SUFFIXES else await self.content_of(suffix)
        write_bytes(place, content)
        return {"wrote": str(place)}

    async def whole_message(self, patience: float) -> bytes | None:
        """The complete picture of the current scene, with its facts; the previous picture if there is none.

        patience  seconds to wait at most
        """
        await self._settle(patience)
        return self.message

    async def _file(self, suffix: str, how: Mapping[str, Any]) -> bytes:
        """The picture or the record as a file."""
        known = {key: how[key] for key in ("size", "samples") if key in how}
        scene = scene_of_page({**self.table, "size": self.size, **known}, self.scene)
        if scene.size is not None and max(scene.size) > MOST:
            raise SceneError(
                f"size: expected at most {MOST} pixels in each direction, found {scene.size[0]} x {scene.size[1]}"
            )
        content = {"table": table_of(scene), "suffix": suffix, **views_of(how)}
        async with self._saving:
            for _ in range(MAX_SAVES):
                found = await self._drawer.ask(SAVE, content)
                if found is not None:
                    return bytes(found)
                await self._settle()
        raise SceneError("other pictures were needed while this one was drawn; save it again")

    async def _settle(self, patience: float = float("inf")) -> None:
        """Wait until the current scene has its complete picture, or none, for some seconds at most."""
        end = perf_counter() + patience
        while self._settled < self.revision and perf_counter() < end:
            await asyncio.sleep(0.02)

    def _state(self, **more: Any) -> str:
        files = [Path(name).name for name in self.scene.data]
        facts = None if self.facts is None else {**self.facts, "name": self.name, "files": files}
        known = {
            "table": self.table,
            "revision": self.revision,
            "size": self.size,
            "facts": facts,
            "paper": self._paper,
        }
        shown = {"proof": self.is_proof, "hidden": self.hidden, "paper": self._paper}
        steps = {"undo": len(self._undo), "redo": len(self._redo), **shown}
        return json.dumps({"type": "state", "writes": self.may_write, "stale": self._stale, **known, **steps, **more})

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
                if self._deaths < DEATHS:
                    self._wake.set()
                    await self._tell(str(error))
                else:
                    await self._give_up("the drawing process stopped repeatedly; restart elvis view")
            except ElvisError as error:
                if self.facts is None and not self._has_shown and self.on_unreadable(str(error)):
                    return
                await self._give_up(str(error), isinstance(error, AbsentError))
            except Exception as error:  # noqa: BLE001 - a fault must not end the viewer
                await self._give_up(fault_sentence(error))

    async def _watch_for_ever(self) -> None:
        """Report changes of the files that were read."""
        while True:
            await asyncio.sleep(WATCH)
            if self.source.is_live:
                await self._follow()
                continue
            stale = self._files.sentence() if self.viewers else self._stale
            if stale and self.facts is None:
                # they could not be read before; perhaps now
                self._wake.set()
            elif stale != self._stale:
                self._stale = stale
                await self._send_state()

    async def _follow(self) -> None:
        """Show the newest step of a run, where there is a newer one than before."""
        if not self.viewers:
            return
        if self.facts is None:
            self._wake.set()
            return
        with suppress(ElvisError):
            if await self._drawer.ask("follow"):
                self.facts = await self._drawer.ask("facts")
                self.revision += 1
                self._wake_up()
                await self._send_state()

    async def compare(self, sent: SentFiles) -> None:
        """Read a second dataset, for expressions and next to the first; ElvisError if that fails, nothing changes."""
        async with self.rereading.turn:
            with sent:
                sources = await asyncio.to_thread(sources_with, self.source, sent.files)
                await first_of(sources, self._read_from)
            self._second.close()
            self._second.callback(sent.remove)

    async def _read_from(self, source: Source) -> None:
        """Read the data from a source, in a new process; ElvisError if they can't be read, nothing changes."""
        stamps = self._files.stamps()
        facts = await self._drawer.read_again(source)
        self._files.note(stamps)
        self.source, self.facts, self._stale = source, facts, ""
        self._begin(facts)
        if source.reading is not None:
            self.scene = replace(self.scene, others=source.reading.others)
        self.revision += 1
        self._wake_up()
        await self._send_state()

    async def _send_state(self) -> None:
        for viewer in list(self.viewers):
            await viewer.send(self._state())

    async def _facts_once(self) -> None:
        if self.facts is not None:
            return
        self._files.note(self._files.stamps())
        self.facts = await self._drawer.ask("facts")
        self._begin(self.facts)
        await self._send_state()

    def _begin(self, facts: Table) -> None:
        """Show only bodies if no objects are given and a far field would hide them, in colours of the pressure."""
        is_untouched = self.revision == 0 and not self._undo and self.table is self._start
        if is_untouched:
            more = {} if self.scene.every_object else first_sight(facts, bool(self.scene.field))
            self._start = self.table = {**placed(self.table, self.scene, facts), **more}

    async def _draw(self) -> None:
        """One picture; while something moves, and before there is any, a quick one, and a whole one after it."""
        is_moving, revision = self._is_moving, self.revision
        is_draft = is_moving or not self._has_shown
        part = self._sizing.part() if is_draft else 1.0
        content = {
            "table": self._shown_table(),
            "part": part,
            "is_draft": is_draft,
            "is_lean": is_any_slow(self.viewers),
            "proof": self.is_proof,
        }
        start = perf_counter()
        try:
            with self._drawer.limited(LATE if is_draft and self._sizing.is_late(part) else None):
                found = await (self._drawer.ask if is_moving else self._ask_leavably)("draw", content)
        except DiedError:
            raise
        except ElvisError:
            if not is_draft:
                raise
            # only the complete picture reports errors: a small one may miss all visible points
            found, self._has_shown = None, True
        seconds = perf_counter() - start
        if is_moving:
            self._sizing.note(part, seconds)
        elif not is_draft and found:
            self._sizing.note_whole(seconds)
        if is_moving:
            asyncio.get_running_loop().call_later(REST if found else 0, self._wake.set)
        elif is_draft:
            self._wake.set()
        if found is None:
            return
        facts, file = found
        self._has_shown = True
        await self._show({**facts, "revision": revision}, file)
        if not is_draft:
            await self._try(content)

    async def _try(self, content: Table) -> None:
        """Draw drafts that nobody sees, to know how long they take; another change ends this."""
        for _ in range(TRIALS):
            part, start = self._sizing.trial, perf_counter()
            if part is None or self._settled != self.revision:
                return
            with self._drawer.limited(LATE):
                found = await self._ask_leavably("try", {**content, "part": part, "is_draft": True})
            seconds = perf_counter() - start
            if found or seconds >= LATE:
                self._sizing.note(part, seconds)

    async def _ask_leavably(self, name: str, content: Table) -> Any:
        """An answer that is given up, and is None, once something moves."""
        self._leavable += 1
        try:
            return await self._drawer.ask(name, content)
        finally:
            self._leavable -= 1

    async def _show(self, facts: Table, file: bytes) -> None:
        """A picture to all who look: the length of the facts, the facts, the file."""
        head = json.dumps(facts).encode()
        message = len(head).to_bytes(4, "little") + head + file
        self._number += 1
        if facts["final"]:
            self.message, self._settled = message, facts["revision"]
        for viewer in list(self.viewers):
            await viewer.take(self._number, message, bool(facts["final"]))

    async def _give_up(self, text: str, is_empty: bool = False) -> None:
        """Report why there is no picture of this scene; for an empty one, another view may show something."""
        self._settled = self.revision
        await self._tell(text, is_empty)

    async def _tell(self, text: str, is_empty: bool = False) -> None:
        """Report an error to the viewers, or on the terminal while there are none."""
        if not self.viewers:
            warn(text)
        for viewer in list(self.viewers):
            await viewer.send(json.dumps({"type": "error", "text": text, "until": "picture", "fit": is_empty}))
