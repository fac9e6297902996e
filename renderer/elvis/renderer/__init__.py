"""Pixel-exact pictures: ``render(dataset, field="u", plane=Plane((0, 0, 0), (0, 0, 1))).save("u.png")``.

Names are imported from their modules when they are first used, so that commands start quickly.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from elvis.renderer.errors import DeviceError, SceneError
    from elvis.renderer.frame import Frame, Status
    from elvis.renderer.rendering import Renderer, default_field, render
    from elvis.renderer.scene import (
        Camera,
        Clip,
        Cone,
        Contours,
        CutSurface,
        Cylinder,
        Faces,
        Implicit,
        Isosurface,
        Light,
        MeshLines,
        Plane,
        Scene,
        Sphere,
        Style,
        Transfer,
        TriangleMesh,
        VolumeRendering,
    )

__all__ = [
    "Camera",
    "Clip",
    "Cone",
    "Contours",
    "CutSurface",
    "Cylinder",
    "DeviceError",
    "Faces",
    "Frame",
    "Implicit",
    "Isosurface",
    "Light",
    "MeshLines",
    "Plane",
    "Renderer",
    "Scene",
    "SceneError",
    "Sphere",
    "Status",
    "Style",
    "Transfer",
    "TriangleMesh",
    "VolumeRendering",
    "default_field",
    "render",
]

_MODULES = {
    "errors": ("DeviceError", "SceneError"),
    "frame": ("Frame", "Status"),
    "rendering": ("Renderer", "default_field", "render"),
    "scene": (
        "Camera",
        "Clip",
        "Cone",
        "Contours",
        "CutSurface",
        "Cylinder",
        "Faces",
        "Implicit",
        "Isosurface",
        "Light",
        "MeshLines",
        "Plane",
        "Scene",
        "Sphere",
        "Style",
        "Transfer",
        "TriangleMesh",
        "VolumeRendering",
    ),
}


def __getattr__(name: str) -> object:
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(f"elvis.renderer.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
