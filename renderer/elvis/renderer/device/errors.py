"""Errors of a device."""

from __future__ import annotations

from elvis.core.base.errors import ElvisError


class DeviceError(ElvisError):
    """The device does not exist, or lacks a feature that the kernels need."""

    keeps_lines = True


class DeviceLostError(DeviceError):
    """A device that failed while it worked; smaller batches of work may go well on a new one."""
