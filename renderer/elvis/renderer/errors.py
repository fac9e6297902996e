"""What can go wrong between a scene and its picture."""

from __future__ import annotations

from elvis.core.errors import ElvisError


class DeviceError(ElvisError):
    """No such device, or one that can't do what the kernels need."""


class DeviceLostError(DeviceError):
    """A device that failed while it worked; smaller pieces of work may go well on a new one."""


class SceneError(ElvisError):
    """A scene that can't be drawn: an unknown field, an empty picture, a camera without direction."""
