"""Drafts: pictures that are shown while something moves, and left as soon as there is another one.

What they show is right, but pixels that only a proof finds are left out: see gaps.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_is_draft: ContextVar[bool] = ContextVar("is_draft", default=False)


@contextmanager
def drafted() -> Iterator[None]:
    """Let pictures be drafts."""
    token = _is_draft.set(True)
    try:
        yield
    finally:
        _is_draft.reset(token)


def is_draft() -> bool:
    """Whether the picture in the making is one."""
    return _is_draft.get()
