"""The viewer in a notebook: the page's module as an anywidget, its messages by way of the notebook.

The session runs on a loop in a thread of its own, so that it answers while a cell runs.
"""

from __future__ import annotations

import asyncio
import base64
import json
import struct
import threading
from collections.abc import Coroutine
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from elvis.core.base.needing import require_module
from elvis.core.data.dataset import Dataset
from elvis.plugins.runtime.opening import PluginData
from elvis.renderer.asking.request import Request
from elvis.renderer.frame.rendering import render
from elvis.scene.model.tables import table_of
from elvis.scene.model.whole import Scene
from elvis.scene.record.frame import Frame
from elvis.viewer.drawing_process import Source
from elvis.viewer.moments import source_of
from elvis.viewer.patches import FIXED
from elvis.viewer.second_data import SentFiles
from elvis.viewer.server import page_facts
from elvis.viewer.session import Session
from elvis.viewer.viewers import Viewer

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from elvis.scene.render_keywords import ViewKeywords

#: seconds that a cell waits for the first picture, which a saved notebook shows
PATIENCE = 20.0
#: seconds that the loop may take to end
CLOSING = 5.0


def view(*data: Any, scene: Scene | None = None, height: int = 620, **keywords: Unpack[ViewKeywords]) -> NotebookViewer:
    """A viewer of data in a notebook: ``view("wing.xml", "wing.fld")``, ``view(ds, "speed", plane=(point, normal))``.

    data      result of `read`, or files and scene files; then the quantity that colours the picture, or a Scene
    scene     initial scene, which keywords change
    height    of the widget in pixels
    keywords  as of `render`

    Raises as `render`; ElvisError if anywidget is not installed.

    >>> viewer = elvis.view("wing.xml", "wing.fld", "p", plane="z=0.5")
    >>> viewer.scene.field
    'p'
    >>> viewer.close()
    """
    return NotebookViewer(Request.of(data, scene, keywords), height)


class NotebookViewer:
    """The output of a cell; the scene in Python and on the page is the same."""

    def __init__(self, request: Request, height: int) -> None:
        anywidget = require_module("anywidget", "view in a notebook", "notebook")
        import traitlets

        self._data: Dataset | PluginData | None = request.data
        scene = request.scene
        source = source_of(scene, request.data)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True, name="elvis-viewer")
        self._thread.start()
        self._session: Session = self._call(_session(scene, source))
        page = files("elvis.viewer") / "page"
        own = {
            "_esm": (page / "viewer.js").read_text(encoding="utf-8"),
            "_css": (page / "viewer.css").read_text(encoding="utf-8"),
            "height": traitlets.Int(height).tag(sync=True),
        }
        self._widget: Any = type("ElVis", (anywidget.AnyWidget,), own)()
        self._viewer = Viewer(self._send)
        self._sent: SentFiles | None = None
        self._widget.on_msg(self._receive)
        self._call(self._session.join(self._viewer))

    def _call(self, work: Coroutine[Any, Any, Any], patience: float | None = 60.0) -> Any:
        """The result of what runs on the session's loop."""
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(patience)

    async def _send(self, message: str | bytes) -> None:
        """A message, or a picture with the facts about it, to all places where the widget is shown."""
        if isinstance(message, str):
            self._widget.send(json.loads(message))
            return
        start = 4 + struct.unpack("<I", message[:4])[0]
        self._widget.send({"type": "frame", **json.loads(message[4:start])}, [message[start:]])

    def _receive(self, _: Any, content: Any, buffers: Any) -> None:
        asyncio.run_coroutine_threadsafe(self._answer(content, buffers), self._loop)

    async def _answer(self, content: Any, buffers: Any = None) -> None:
        """Handle a message of the page; a page that was just opened receives the complete state."""
        message = content if isinstance(content, dict) else {}
        if message.get("type") == "hello":
            await self._send(json.dumps({"type": "schema", **page_facts()}))
            self._viewer.confirmed = self._viewer.sent
            await self._session.join(self._viewer)
        elif message.get("type") == "save":
            await self._save(message)
        elif message.get("type") in ("upload", "compare"):
            await self._compare(message, buffers)
        else:
            await self._session.receive(self._viewer, message)

    async def _compare(self, message: dict[str, Any], buffers: Any) -> None:
        """Take a part of a file of a second dataset; or read this dataset, once all files are here."""
        from elvis.core.base.errors import ElvisError

        session = self._session
        try:
            if message["type"] == "upload":
                self._take(message.get("content"), buffers)
            else:
                sent, self._sent = self._sent or SentFiles(), None
                await session.compare(sent)
                if isinstance(self._data, Dataset) and isinstance(session.source.data, Dataset):
                    self._data = self._data.with_others(**session.source.data.others)
        except ElvisError as error:
            self._widget.send({"type": "error", "id": message.get("id"), "text": str(error)})
        else:
            self._widget.send({"type": "answer", "id": message.get("id"), "content": None})

    def _take(self, content: Any, buffers: Any) -> None:
        """Append a part of a file: ``name``, whether it is the ``first`` file of all, ``offset`` of the part."""
        part = content if isinstance(content, dict) else {}
        if self._sent is None or (part.get("offset") == 0 and part.get("first")):
            self._drop_sent()
            self._sent = SentFiles()
        if part.get("offset") == 0:
            self._sent.open(str(part.get("name")))
        self._sent.append(bytes(buffers[0]) if buffers else b"")

    def _drop_sent(self) -> None:
        """Remove files that were sent and never compared."""
        sent, self._sent = self._sent, None
        if sent is not None:
            sent.remove()

    async def _save(self, message: dict[str, Any]) -> None:
        """A file for the browser to keep."""
        from elvis.core.base.errors import ElvisError

        suffix = str(message.get("suffix"))
        try:
            how = message.get("content")
            content = await self._session.content_of(suffix, how if isinstance(how, dict) else {})
        except ElvisError as error:
            self._widget.send({"type": "error", "id": message.get("id"), "text": str(error)})
        else:
            self._widget.send({"type": "answer", "id": message.get("id")}, [content])

    @property
    def scene(self) -> Scene:
        """The displayed scene; another one can be set."""
        return self._session.current

    @scene.setter
    def scene(self, scene: Scene) -> None:
        table = {key: value for key, value in table_of(scene).items() if key not in FIXED}
        gone = dict.fromkeys(self._session.table.keys() - table.keys())
        self._call(self._session.change({**gone, **table}))

    @property
    def frame(self) -> Frame:
        """The exact record of the current view, drawn here."""
        return self._drawn(self.scene)

    def save(self, path: str | Path, *, size: tuple[int, int] | None = None, samples: int | None = None) -> None:
        """Write the picture, or the record, of the current view.

        size     width and height in pixels; those of the window by default
        samples  samples per pixel in each direction; those of the scene by default

        Raises SceneError for invalid values, or for a name without a suffix of a picture or record.
        """
        scene = self.scene
        if size is not None:
            scene = replace(scene, size=size)
        if samples is not None:
            scene = replace(scene, samples=samples)
        self._drawn(scene).save(path, plain=scene.plain)

    def _drawn(self, scene: Scene) -> Frame:
        return render(scene=scene) if self._data is None else render(self._data, scene)

    def close(self) -> None:
        """End the process that draws."""
        self._drop_sent()
        self._call(self._session.close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(CLOSING)
        if not self._thread.is_alive():
            self._loop.close()

    def _repr_mimebundle_(self, **how: Any) -> Any:
        """The widget, and the picture for notebooks that are only read."""
        found = self._widget._repr_mimebundle_(**how)
        bundle = found[0] if isinstance(found, tuple) else found
        message = self._call(self._session.whole_message(PATIENCE), PATIENCE + 10)
        if message is not None:
            start = 4 + struct.unpack("<I", message[:4])[0]
            bundle = {**bundle, "image/png": base64.b64encode(message[start:]).decode()}
        return (bundle, *found[1:]) if isinstance(found, tuple) else bundle


async def _session(scene: Scene, source: Source) -> Session:
    """A session on the running loop, which draws."""
    session = Session(scene, source)
    session.start()
    return session
