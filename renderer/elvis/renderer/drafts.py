"""Drafts: pictures that are shown during motion, and abandoned as soon as there is another one.

Their pixels are right, but pixels that only a proof finds are skipped: see gaps.
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
