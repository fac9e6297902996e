"""What is to be drawn, as plain Python: surfaces, objects, cameras and scenes.  Needs no device."""

from elvis.renderer.scene.objects import (
    Contours,
    CutSurface,
    Faces,
    Isosurface,
    MeshLines,
    SceneObject,
    Style,
    Transfer,
    VolumeRendering,
)
from elvis.renderer.scene.surfaces import (
    Cone,
    Cylinder,
    Implicit,
    Plane,
    Sphere,
    Surface,
    TriangleMesh,
    Vector,
    unit,
)
from elvis.renderer.scene.whole import NAMED_VIEWS, Camera, Clip, Light, Scene

__all__ = [
    "NAMED_VIEWS",
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
    "SceneObject",
    "Sphere",
    "Style",
    "Surface",
    "Transfer",
    "TriangleMesh",
    "Vector",
    "VolumeRendering",
    "unit",
]
