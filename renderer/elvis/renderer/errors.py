"""What can go wrong between a scene and its picture."""

from __future__ import annotations

from elvis.formats.errors import ElvisError


class DeviceError(ElvisError):
    """No such device, or one that can't do what the kernels need."""


class SceneError(ElvisError):
    """A scene that can't be drawn: an unknown field, an empty picture, a camera without direction."""
