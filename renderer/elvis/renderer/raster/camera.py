"""The camera on the device: a part of the records of all passes (camera.slang)."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from elvis.core.base.arrays import Records
from elvis.renderer.device.device import Kernel
from elvis.scene.cameras.view import View

#: Camera records of views that are drawn
_CAMERAS: WeakKeyDictionary[View, Records] = WeakKeyDictionary()


def record_of(kernel: Kernel, name: str, view: View, **values: Any) -> Records:
    """A kernel's record (1,) of this name with the camera of the view, and other values by name."""
    record = np.zeros(1, kernel.dtype(name))
    record["camera"] = _camera(view, record.dtype["camera"])
    for key, value in values.items():
        record[key] = value
    return record


def _camera(view: View, dtype: np.dtype[Any]) -> Records:
    """(1,) the Camera record of a view, made once for all kernels that lay it out alike."""
    known = _CAMERAS.get(view)
    if known is None or known.dtype != dtype:
        known = np.zeros(1, dtype)
        _fill(known, view)
        _CAMERAS[view] = known
    return known


def _fill(camera: Records, view: View) -> None:
    """Let Camera records say what a view says."""
    eye, forward = np.asarray(view.camera.eye, dtype=np.float64), view.camera.basis()[2]
    camera["to_column"], camera["to_row"], camera["to_weight"] = view.to_pixel
    camera["to_depth"] = np.append(forward, -forward @ eye)
    camera["eye"], camera["forward"] = eye, forward
    camera["corner"], camera["column"], camera["row"] = view.corner, view.column, view.row
    camera["left"], camera["top"], camera["width"], camera["height"] = view.left, view.top, view.width, view.height
    camera["picture"] = np.append(view.whole.first, view.whole.last)
    camera["perspective"] = view.perspective
