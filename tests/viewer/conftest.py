"""A viewer of a small dataset, served by a loop in a thread of its own."""

import asyncio
import threading
from concurrent.futures import Future
from urllib.parse import urlsplit

import numpy as np
import pytest
from browsers import find_browser
from driving import PATIENCE, settled

from elvis import Dataset, Shape, write
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.scene import Plane, Scene
from elvis.scene.model.tables import table_of
from elvis.viewer.drawing_process import Source
from elvis.viewer.patches import FIXED
from elvis.viewer.server import Server, serve
from elvis.viewer.session import Session

HOSTILE = "<img src=x onerror=alert(1)>"


@pytest.fixture(scope="session")
def wave(tmp_path_factory):
    """Files of curved hexahedra with two fields, the name of one of which is an element of HTML."""
    mesh = curved(grid(Shape.HEXAHEDRON, 2), ripple(0.05), n=3)
    bare = Dataset(mesh)
    fields = (
        approximated(bare, "u", lambda x: np.sin(3 * x[:, 0]) + x[:, 1] * x[:, 2], 3),
        approximated(bare, HOSTILE, lambda x: x[:, 2] ** 2, 3),
    )
    return tuple(map(str, write(Dataset(mesh, fields), tmp_path_factory.mktemp("wave") / "wave.xml")))


@pytest.fixture(scope="session")
def scene(wave):
    """A plane through them."""
    return Scene("u", plane=Plane((0.5, 0.5, 0.4), (0.1, 0.2, 1.0)), data=wave, camera="iso", size=(200, 160))


class Running:
    """A viewer that runs."""

    def __init__(self, scene):
        self.loop = asyncio.new_event_loop()
        self.session = self._task = None
        self._scene, self._address = scene, Future()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self.address = self._address.result(PATIENCE)

    def _run(self):
        async def main():
            self.session = Session(self._scene, Source(self._scene.data))
            self.server = Server(self.session)
            self._task = asyncio.current_task()
            await serve(self.server, "127.0.0.1", 0, self._address.set_result, None)

        try:
            self.loop.run_until_complete(main())
        except asyncio.CancelledError:
            pass
        except Exception as error:
            self._address.set_exception(error)
        self.loop.close()

    @property
    def root(self):
        """The address without its token."""
        parts = urlsplit(self.address)
        return f"{parts.scheme}://{parts.netloc}/"

    def call(self, coroutine):
        """The result of a coroutine, run by the viewer's loop."""
        return asyncio.run_coroutine_threadsafe(coroutine, self.loop).result(PATIENCE)

    def restore(self):
        """Show what was shown first."""
        start = {key: value for key, value in table_of(self._scene).items() if key not in FIXED}
        gone = dict.fromkeys(self.session.table.keys() - start.keys())
        if self.session.table != start:
            self.call(self.session.change({**gone, **start}))

    def close(self):
        """End it."""
        self.loop.call_soon_threadsafe(self._task.cancel)
        self._thread.join(PATIENCE)


@pytest.fixture(scope="session")
def viewer(scene):
    """A viewer for all tests that leave it as it was."""
    running = Running(scene)
    yield running
    running.close()


@pytest.fixture
def start():
    """Starts viewers of scenes, which end with the test."""
    running = []

    def start(scene):
        running.append(Running(scene))
        return running[-1]

    yield start
    for one in running:
        one.close()


@pytest.fixture(scope="session")
def browser():
    """A browser; tests that need one are left out where there is none."""
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as tools:
        own = tools.chromium.launch(executable_path=find_browser(), args=["--no-sandbox", "--disable-gpu"])
        yield own
        own.close()


@pytest.fixture
def page(browser, viewer):
    """The page with its first picture; nothing may fail in it."""
    context = browser.new_context(viewport={"width": 900, "height": 420}, bypass_csp=True)
    own = context.new_page()
    own.set_default_timeout(1000 * PATIENCE)
    faults = []
    own.on("pageerror", lambda error: faults.append(str(error)))
    own.on("dialog", lambda dialog: faults.append("a dialog"))
    viewer.restore()
    own.goto(viewer.address)
    settled(own, viewer)
    yield own
    assert not faults
    context.close()
