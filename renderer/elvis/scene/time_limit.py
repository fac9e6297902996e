"""The time limit of a picture: all that takes long, in the renderer and in the reference, looks at it from within."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from time import perf_counter

from elvis.scene.errors import SceneError

#: when the picture in the making is to be done, by perf_counter, and the seconds that it was given
_limit: ContextVar[tuple[float, float] | None] = ContextVar("limit", default=None)


@contextmanager
def limited(seconds: float | None) -> Iterator[None]:
    """Let `check_time` raise what ends the work after this many seconds; within another such block its limit counts."""
    if seconds is None or _limit.get() is not None:
        yield
        return
    token = _limit.set((perf_counter() + seconds, seconds))
    try:
        yield
    finally:
        _limit.reset(token)


def check_time() -> None:
    """Look at the time; SceneError where the limit has passed."""
    known = _limit.get()
    if known is not None and perf_counter() > known[0]:
        raise SceneError(f"the picture was not done after {known[1]:g} s, the time limit: nothing is written")
