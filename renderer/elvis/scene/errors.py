"""What can go wrong between a scene and its picture."""

from __future__ import annotations

from elvis.core.errors import ElvisError


class SceneError(ElvisError, ValueError):
    """A scene that can't be drawn: an unknown field, an empty picture, a camera without direction."""


class KeywordError(SceneError, TypeError):
    """A keyword that there is not."""
