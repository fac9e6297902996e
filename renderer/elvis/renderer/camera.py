"""The camera on the device: a part of the records of all passes (camera.slang)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.renderer.device import Kernel
from elvis.scene.view import View


def record_of(kernel: Kernel, name: str, view: View, **values: Any) -> NDArray[Any]:
    """(1,) a kernel's record of this name, which has a camera: that of the view, and other values by name."""
    record = np.zeros(1, kernel.dtype(name))
    fill_camera(record["camera"], view)
    for key, value in values.items():
        record[key] = value
    return record


def fill_camera(camera: NDArray[Any], view: View) -> None:
    """Let Camera records say what a view says."""
    eye, forward = np.asarray(view.camera.eye, dtype=np.float64), view.camera.basis()[2]
    camera["to_column"], camera["to_row"], camera["to_weight"] = view.to_pixel
    camera["to_depth"] = np.append(forward, -forward @ eye)
    camera["eye"], camera["forward"] = eye, forward
    camera["corner"], camera["column"], camera["row"] = view.corner, view.column, view.row
    camera["width"], camera["height"], camera["perspective"] = view.width, view.height, view.perspective
