"""Pixel-exact pictures: ``render(dataset, field="u", plane=Plane((0, 0, 0), (0, 0, 1))).save("u.png")``."""

from __future__ import annotations

from elvis.renderer.errors import DeviceError, SceneError
from elvis.renderer.frame import Frame, Status
from elvis.renderer.rendering import Renderer, default_field, render
from elvis.renderer.scene import Camera, Plane, Scene

__all__ = [
    "Camera",
    "DeviceError",
    "Frame",
    "Plane",
    "Renderer",
    "Scene",
    "SceneError",
    "Status",
    "default_field",
    "render",
]
