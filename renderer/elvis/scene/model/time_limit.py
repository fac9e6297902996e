"""Limits that end an unfinished picture: its time limit, or a caller that no longer needs it.

All long computations, in the renderer and in the reference, check both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from time import perf_counter

from elvis.core.base.errors import ElvisError
from elvis.scene.model.errors import SceneError

#: when the picture in the making is to be done, by perf_counter, and the seconds that it was given
_limit: ContextVar[tuple[float, float] | None] = ContextVar("limit", default=None)
#: whether the caller has no use for it any more
_is_obsolete: ContextVar[Callable[[], bool] | None] = ContextVar("is_obsolete", default=None)


class ObsoleteError(ElvisError):
    """A picture that nobody waits for any more was not finished."""


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


@contextmanager
def stopped_when(is_obsolete: Callable[[], bool]) -> Iterator[None]:
    """Let `check_time` raise ObsoleteError once ``is_obsolete`` is true."""
    token = _is_obsolete.set(is_obsolete)
    try:
        yield
    finally:
        _is_obsolete.reset(token)


def check_time() -> None:
    """Look at both; SceneError where the limit has passed, ObsoleteError where nobody waits."""
    known = _limit.get()
    if known is not None and perf_counter() > known[0]:
        raise SceneError(f"the picture exceeded the time limit of {known[1]:g} s: no file is written")
    is_obsolete = _is_obsolete.get()
    if is_obsolete is not None and is_obsolete():
        raise ObsoleteError("the picture is no longer requested")
