"""Drafts: pictures that are shown during motion, and abandoned as soon as there is another one.

Their pixels are right, but pixels that only a proof finds are skipped: see gaps and cut.  They have depths, from which
a page moves them with the camera, and on request their lines as segments, which a page draws sharp over coarse pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from elvis.scene import Scene, VolumeRendering

_is_draft: ContextVar[bool] = ContextVar("is_draft", default=False)
_has_segments: ContextVar[bool] = ContextVar("has_segments", default=False)


@contextmanager
def drafted(*, segments: bool = False) -> Iterator[None]:
    """Let pictures be drafts.

    segments  whether their lines are segments over the pixels instead of pixels
    """
    tokens = _is_draft.set(True), _has_segments.set(segments)
    try:
        yield
    finally:
        _is_draft.reset(tokens[0])
        _has_segments.reset(tokens[1])


def is_draft() -> bool:
    """Whether the picture in the making is one."""
    return _is_draft.get()


def wants_segments() -> bool:
    """Whether lines of the picture in the making that do not depend on its surfaces become segments."""
    return _has_segments.get()


def has_segments(scene: Scene) -> bool:
    """Whether lines of the picture in the making become segments; lines within volumes are pixels."""
    return _has_segments.get() and not any(isinstance(item, VolumeRendering) for item in scene.every_object)


def traces_lines(scene: Scene) -> bool:
    """Whether lines of the picture in the making lie over its pixels, as curves or as segments."""
    return scene.is_traced or has_segments(scene)
