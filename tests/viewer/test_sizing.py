"""How large drafts are, from what the last ones took: costs are a share that all sizes have, and one by pixels."""

import asyncio
import time
from itertools import pairwise

import pytest
from driving import finished

from elvis.scene import Scene, Transfer, VolumeRendering
from elvis.scene.errors import SceneError
from elvis.viewer import session
from elvis.viewer.drawing_process import Source
from elvis.viewer.session import Session
from elvis.viewer.sizing import FIRST, GOAL, LATE, PARTS, Sizing, draft_of


def turned(sizing, host, pixels, count=100, now=0.0):
    """Parts and times of pictures, one after another."""
    parts, times = [], []
    for _ in range(count):
        parts.append(sizing.part(now))
        times.append(host + pixels * parts[-1] ** 2)
        now += times[-1]
        sizing.note(parts[-1], times[-1], now)
    return parts, times


@pytest.mark.parametrize(
    ("host", "pixels", "part"),
    [(0.002, 0.01, 1.0), (0.01, 0.15, 0.5), (0.004, 0.44, 1 / 3), (0.012, 2.0, 0.125), (0.02, 30.0, 0.0625)],
)
def test_draft_sizes_follow_the_time_budget(host, pixels, part):
    """Whatever the whole picture took, which is another work."""
    for whole in (0.1, 5.0, 100.0):
        sizing = Sizing()
        assert sizing.part(0.0) == FIRST
        sizing.note_whole(whole)
        parts, times = turned(sizing, host, pixels)
        settled = parts[50:]
        assert settled.count(part) > 0.9 * len(settled)
        assert sum(times[50:]) < 50 * max(GOAL, host + pixels * PARTS[-1] ** 2) * 1.2
        # sizes don't flip: a larger one is tried now and then
        assert sum(one != other for one, other in pairwise(settled)) <= 2
        # once drafts are quick, they are large
        assert turned(sizing, 0.002, 0.01, now=1000.0)[0][-1] == 1.0


def test_volumes_are_coarse_in_drafts():
    volume = VolumeRendering(Transfer((0.0, 1.0), (0.0, 1.0)))
    scene = Scene("u", objects=(volume,), size=(1000, 500), samples=3)
    draft = draft_of(scene, 0.125)
    assert draft.objects[0].error > volume.error
    assert (draft.size, draft.samples) == ((125, 62), 1)


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
        self.asked.append((content["is_draft"], content["part"]))
        if len(self.asked) == 1:
            raise SceneError("the picture is empty")
        if content["is_draft"] and content["part"] > PARTS[-1]:
            await self.obsolete.wait()
            return None
        return {"final": not content["is_draft"]}, b""

    def make_obsolete(self):
        self.obsolete.set()

    def close(self):
        pass


def test_a_draft_comes_first_and_late_ones_are_dropped(monkeypatch):
    """A draft and the whole picture; while something moves, smaller drafts for those that are late, and a whole one."""
    # on a busy machine it may be long from one movement to the next
    monkeypatch.setattr(session, "REST", 3.0)

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
    assert asked[:2] == [(True, FIRST), (False, 1.0)]
    late = [part for is_draft, part in asked[2:] if is_draft and part > PARTS[-1]]
    assert late
    assert late == sorted(set(late), reverse=True)
    assert took > LATE * len(late)
