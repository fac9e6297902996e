"""What can go wrong between a scene and its picture."""

from __future__ import annotations

from elvis.core.errors import ElvisError


class SceneError(ElvisError, ValueError):
    """A scene that can't be drawn: an unknown field, an empty picture, a camera without direction."""


class AbsentError(SceneError):
    """A scene of which these data show nothing, others may: a value that isn't there, an empty picture."""


class KeywordError(SceneError, TypeError):
    """A keyword that there is not."""
