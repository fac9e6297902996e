"""Errors between a scene and its picture."""

from __future__ import annotations

from elvis.core.base.errors import ElvisError


class SceneError(ElvisError, ValueError):
    """A scene that can't be drawn: an unknown field, an empty picture, a camera without direction."""


class AbsentError(SceneError):
    """A scene that shows nothing of these data but may show something of others: an absent value, an empty picture."""


class KeywordError(SceneError, TypeError):
    """An unknown keyword."""
