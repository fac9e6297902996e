"""Scenes and frames as plain Python: objects and cameras to draw, and the pictures.  Needs no device."""

from __future__ import annotations

from typing import TYPE_CHECKING

from elvis.core.lazy import lazy_names

if TYPE_CHECKING:
    from elvis.scene.convolution import Lic
    from elvis.scene.copies import Copies, Repeat, Turn
    from elvis.scene.errors import SceneError
    from elvis.scene.frame import Frame, Status
    from elvis.scene.objects import (
        CutSurface,
        Faces,
        Glyphs,
        Isosurface,
        SceneObject,
        Streamlines,
        Transfer,
        VolumeRendering,
    )
    from elvis.scene.style import ColorBar, Contours, MeshLines, Style
    from elvis.scene.surfaces import Cone, Cylinder, Implicit, Plane, Sphere, Surface, TriangleMesh, Vector, unit
    from elvis.scene.validation import scene_schema
    from elvis.scene.whole import NAMED_VIEWS, Camera, Caption, Clip, Deform, Light, Reference, Scene

__all__ = [
    "NAMED_VIEWS",
    "Camera",
    "Caption",
    "Clip",
    "ColorBar",
    "Cone",
    "Contours",
    "Copies",
    "CutSurface",
    "Cylinder",
    "Deform",
    "Faces",
    "Frame",
    "Glyphs",
    "Implicit",
    "Isosurface",
    "Lic",
    "Light",
    "MeshLines",
    "Plane",
    "Reference",
    "Repeat",
    "Scene",
    "SceneError",
    "SceneObject",
    "Sphere",
    "Status",
    "Streamlines",
    "Style",
    "Surface",
    "Transfer",
    "TriangleMesh",
    "Turn",
    "Vector",
    "VolumeRendering",
    "scene_schema",
    "unit",
]

__getattr__ = lazy_names(
    __name__,
    {
        "elvis.scene.errors": ("SceneError",),
        "elvis.scene.frame": ("Frame", "Status"),
        "elvis.scene.convolution": ("Lic",),
        "elvis.scene.copies": ("Copies", "Repeat", "Turn"),
        "elvis.scene.objects": (
            "CutSurface",
            "Faces",
            "Glyphs",
            "Isosurface",
            "SceneObject",
            "Streamlines",
            "Transfer",
            "VolumeRendering",
        ),
        "elvis.scene.style": ("ColorBar", "Contours", "MeshLines", "Style"),
        "elvis.scene.surfaces": (
            "Cone",
            "Cylinder",
            "Implicit",
            "Plane",
            "Sphere",
            "Surface",
            "TriangleMesh",
            "Vector",
            "unit",
        ),
        "elvis.scene.validation": ("scene_schema",),
        "elvis.scene.whole": ("Camera", "Caption", "Clip", "Deform", "Light", "NAMED_VIEWS", "Reference", "Scene"),
    },
)
