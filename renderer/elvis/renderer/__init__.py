"""Pixel-exact pictures: ``render(dataset, field="u", plane=Plane((0, 0, 0), (0, 0, 1))).save("u.png")``.

Names are imported from their modules when they are first used, so that commands start quickly.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from elvis.renderer.errors import DeviceError as DeviceError
    from elvis.renderer.errors import SceneError as SceneError
    from elvis.renderer.frame import Frame as Frame
    from elvis.renderer.frame import Status as Status
    from elvis.renderer.rendering import Renderer as Renderer
    from elvis.renderer.rendering import default_field as default_field
    from elvis.renderer.rendering import render as render
    from elvis.renderer.scene import *  # noqa: F403

_MODULES = {
    "errors": ("DeviceError", "SceneError"),
    "frame": ("Frame", "Status"),
    "rendering": ("Renderer", "default_field", "render"),
}


def __getattr__(name: str) -> object:
    module = next((module for module, names in _MODULES.items() if name in names), "scene")
    found = import_module(f"elvis.renderer.{module}")
    if name == "__all__":
        return [*found.__all__, *(own for names in _MODULES.values() for own in names)]
    if name not in _MODULES.get(module, ()) and name not in found.__all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(found, name)
