"""How large drafts are, from what the last ones took: costs are a share that all sizes have, and one by pixels."""

import asyncio
import time
from itertools import pairwise
from types import SimpleNamespace

import pytest
from driving import finished

from elvis.scene import Scene, Transfer, VolumeRendering
from elvis.scene.model.errors import SceneError
from elvis.scene.model.tables import table_of
from elvis.viewer import session, sizing, viewers
from elvis.viewer.drawer import Drawer
from elvis.viewer.drawing_process import Source, _Drawing
from elvis.viewer.session import Session
from elvis.viewer.sizing import LATE, PARTS, USUAL, Sizing, draft_of
from elvis.viewer.viewers import Viewer


def drag(own, whole, host, pixels, count=30):
    """Parts of the drafts of a drag after a whole picture; durations are a share that all have and one by pixels."""
    own.note_whole(whole)
    parts = []
    for _ in range(count):
        parts.append(own.part())
        own.note(parts[-1], min(LATE, host + pixels * parts[-1] ** 2))
    return parts


@pytest.mark.parametrize(
    ("host", "pixels", "part"),
    [(0.002, 0.01, 1.0), (0.01, 0.06, 0.75), (0.01, 0.15, 0.5), (0.02, 2.0, 1 / 3), (0.02, 30.0, 0.0625)],
)
def test_sizes_stay_within_a_drag(host, pixels, part):
    """Whatever the whole picture took, which is another work."""
    for whole in (0.02, 5.0, 100.0):
        own = Sizing()
        assert own.part() == USUAL
        own.note_whole(whole)
        while own.trial is not None:
            own.note(own.trial, min(LATE, host + pixels * own.trial**2))
        drags = [drag(own, whole, host, pixels) for _ in range(4)]
        # only late drafts change it, and it never grows
        assert all(parts == sorted(parts, reverse=True) for parts in drags)
        changes = sum(one != other for parts in drags for one, other in pairwise(parts))
        assert changes <= (3 if part < USUAL else 0)
        assert set(drags[-1]) == {part}


def test_one_disturbed_draft_does_not_count():
    """Loading kernels, or another program."""
    own = Sizing()
    own.note_whole(0.3)
    own.note(USUAL, 3.0)
    assert own.trial == USUAL
    own.note(USUAL, 0.05)
    assert own.trial is None
    assert set(drag(own, 0.3, 0.02, 0.27)) == {USUAL}


def test_volumes_are_coarse_in_drafts():
    volume = VolumeRendering(Transfer((0.0, 1.0), (0.0, 1.0)))
    scene = Scene("u", objects=(volume,), size=(1000, 500), samples=3)
    draft = draft_of(scene, 0.125)
    assert draft.objects[0].error > volume.error
    assert (draft.size, draft.samples) == ((125, 62), 1)


def test_drafts_are_lean_on_a_slow_line(monkeypatch, scene):
    """After some late confirmations, until the next whole picture: few bytes, and lines are pixels."""

    async def send(message):
        pass

    async def main():
        page = Viewer(send)
        found = []
        for is_final in (False, False, False, False, True):
            await page.take(page.sent + 1, b"", is_final)
            found.append(page.is_slow)
            await page.confirm()
        return found

    assert finished(main()) == [False] * 5
    monkeypatch.setattr(viewers, "LATE_CONFIRMATION", -1.0)
    assert finished(main()) == [False, False, False, True, False]

    drawing = _Drawing(Source(scene.data), SimpleNamespace(value=0))
    content = {"table": table_of(scene), "part": 0.5, "is_draft": True, "proof": False}
    (rich, file), (lean, few) = (drawing.answer("draw", 0, {**content, "is_lean": one}) for one in (False, True))
    assert len(few) < 0.7 * len(file)
    assert rich["size"] == lean["size"]


class _Slow:
    """Draws the smallest drafts at once; others never end unless nobody waits for them; the first shows nothing."""

    pid = None

    def __init__(self):
        self.asked = []
        self.obsolete = asyncio.Event()

    async def ask(self, name, content=None):
        if name == "facts":
            return {}
        self.obsolete.clear()
        if name == "try":
            return None
        self.asked.append((content["is_draft"], content["part"]))
        if len(self.asked) == 1:
            raise SceneError("the picture is empty")
        if content["is_draft"] and content["part"] > PARTS[-1]:
            await self.obsolete.wait()
            return None
        return {"final": not content["is_draft"]}, b""

    limited = Drawer.limited

    def make_obsolete(self):
        self.obsolete.set()

    def close(self):
        pass


def test_a_draft_comes_first_and_late_ones_are_dropped(monkeypatch):
    """A draft and the whole picture; while something moves, smaller drafts for those that are late, and a whole one."""
    # on a busy machine it may be long from one movement to the next
    monkeypatch.setattr(session, "REST", 3.0)
    late_after = 0.1
    for module in (session, sizing):
        monkeypatch.setattr(module, "LATE", late_after)

    async def main():
        own = Session(Scene("u"), Source())
        slow = own._drawer = _Slow()
        own.start()
        while len(slow.asked) < 2:
            await asyncio.sleep(0.001)
        begin = time.monotonic()
        while slow.asked[-1] != (True, PARTS[-1]):
            await own.change({"camera": "+x"}, is_moving=True)
            await asyncio.sleep(0.01)
        while slow.asked[-1] != (False, 1.0):
            await asyncio.sleep(0.001)
        took = time.monotonic() - begin
        await own.close()
        return slow.asked, took

    asked, took = finished(main())
    assert asked[:2] == [(True, USUAL), (False, 1.0)]
    late = [part for is_draft, part in asked[2:] if is_draft and part > PARTS[-1]]
    assert late
    assert late == sorted(set(late), reverse=True)
    assert took > late_after * len(late)
