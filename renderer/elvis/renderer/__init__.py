"""Pixel-exact pictures: ``render(dataset, field="u", plane=Plane((0, 0, 0), (0, 0, 1))).save("u.png")``.

This is a door: it names what programs need, and imports it when it is used; nothing in the house goes through it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from elvis import scene
from elvis.core.lazy import lazy_names

if TYPE_CHECKING:
    from elvis.plugins.data import read
    from elvis.renderer.completing import default_field
    from elvis.renderer.device_errors import DeviceError
    from elvis.renderer.in_situ import Session
    from elvis.renderer.rendering import Renderer, render
    from elvis.scene import *  # noqa: F403
    from elvis.viewer.widget import view

__all__ = ["DeviceError", "Renderer", "Session", "default_field", "read", "render", "view", *scene.__all__]

__getattr__ = lazy_names(
    __name__,
    {
        "elvis.plugins.data": ("read",),
        "elvis.renderer.device_errors": ("DeviceError",),
        "elvis.renderer.in_situ": ("Session",),
        "elvis.renderer.completing": ("default_field",),
        "elvis.renderer.rendering": ("Renderer", "render"),
        "elvis.scene": tuple(scene.__all__),
        "elvis.viewer.widget": ("view",),
    },
)


def __dir__() -> list[str]:
    return __all__
