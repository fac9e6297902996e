"""Pixel-exact pictures: ``render(dataset, field="u", plane=Plane((0, 0, 0), (0, 0, 1))).save("u.png")``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from elvis import scene
from elvis.core.lazy import lazy_names

if TYPE_CHECKING:
    from elvis.plugins.data import read
    from elvis.renderer.device_errors import DeviceError
    from elvis.renderer.rendering import Renderer, default_field, render
    from elvis.scene import *  # noqa: F403

__all__ = ["DeviceError", "Renderer", "default_field", "read", "render"]
__all__ += scene.__all__

__getattr__ = lazy_names(
    __name__,
    {
        "elvis.plugins.data": ("read",),
        "elvis.renderer.device_errors": ("DeviceError",),
        "elvis.renderer.rendering": ("Renderer", "default_field", "render"),
        "elvis.scene": tuple(scene.__all__),
    },
)


def __dir__() -> list[str]:
    return __all__
