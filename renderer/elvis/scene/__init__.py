"""Scenes and frames as plain Python: objects and cameras to draw, and the pictures.  Needs no device."""

from __future__ import annotations

from typing import TYPE_CHECKING

from elvis.core.base.lazy import lazy_names

if TYPE_CHECKING:
    from elvis.scene.model.convolution import Lic
    from elvis.scene.model.copies import Copies, Repeat, Turn
    from elvis.scene.model.errors import SceneError
    from elvis.scene.model.objects import (
        CutSurface,
        Faces,
        Glyphs,
        Isosurface,
        SceneObject,
        Streamlines,
        Transfer,
        VolumeRendering,
    )
    from elvis.scene.model.style import ColorBar, Contours, MeshLines, Style
    from elvis.scene.model.surfaces import Cone, Cylinder, Implicit, Plane, Sphere, Surface, TriangleMesh, Vector, unit
    from elvis.scene.model.validation import scene_schema
    from elvis.scene.model.whole import NAMED_VIEWS, Camera, Caption, Clip, Deform, Light, Reference, Scene
    from elvis.scene.record.frame import Frame, Status

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
        "elvis.scene.model.errors": ("SceneError",),
        "elvis.scene.record.frame": ("Frame", "Status"),
        "elvis.scene.model.convolution": ("Lic",),
        "elvis.scene.model.copies": ("Copies", "Repeat", "Turn"),
        "elvis.scene.model.objects": (
            "CutSurface",
            "Faces",
            "Glyphs",
            "Isosurface",
            "SceneObject",
            "Streamlines",
            "Transfer",
            "VolumeRendering",
        ),
        "elvis.scene.model.style": ("ColorBar", "Contours", "MeshLines", "Style"),
        "elvis.scene.model.surfaces": (
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
        "elvis.scene.model.validation": ("scene_schema",),
        "elvis.scene.model.whole": (
            "Camera",
            "Caption",
            "Clip",
            "Deform",
            "Light",
            "NAMED_VIEWS",
            "Reference",
            "Scene",
        ),
    },
)
