"""Work on a device that is repeated with fewer pixels at once if the device fails."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from elvis.renderer.device.errors import DeviceError, DeviceLostError
from elvis.renderer.frame.canvas import BAND

T = TypeVar("T")
#: pixels at once below which a device that fails has failed for good
FEWEST = 1 << 12


def persistent(work: Callable[[int], T], reopen: Callable[[], object]) -> T:
    """Run work with the number of pixels to draw at once, which is reduced if the device fails.

    reopen  replaces a lost device
    """
    most = BAND
    while True:
        try:
            return work(most)
        except DeviceLostError as error:
            most //= 8
            if most < FEWEST:
                raise DeviceError(f"{error}, even if it draws a few rows of the picture at a time") from error
            reopen()
