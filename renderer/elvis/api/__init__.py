"""The public API of ElVis, which ``import elvis`` offers.

``NAMES`` lists every public name and the module that defines it.  A name is imported when a program first uses it.
This slice may import every other slice; no other slice imports it.
"""

from __future__ import annotations

from elvis.core.lazy import lazy_names

TYPE_CHECKING = False
if TYPE_CHECKING:
    from elvis.api.dataset_files import write
    from elvis.api.live_pictures import draw
    from elvis.api.numbers import extrema
    from elvis.converters.blueprint import from_blueprint
    from elvis.converters.handing import to_meshio, to_pyvista
    from elvis.converters.live import from_mfem, from_ngsolve
    from elvis.core.cores import VortexCores, vortex_cores
    from elvis.core.critical_points import CriticalPoints, critical_points
    from elvis.core.dataset import Block, Dataset, Expansion, ExpansionRule, Field, Homogeneous
    from elvis.core.differences import diff
    from elvis.core.errors import ElvisError, FormatError
    from elvis.core.extrema import Extremum
    from elvis.core.gridding import to_xarray
    from elvis.core.integrals import integrate
    from elvis.core.mesh import Composite, Curves, Entities, Mesh
    from elvis.core.mesh_quality import MeshQuality, mesh_quality
    from elvis.core.norms import norms
    from elvis.core.polynomials.bases import Basis
    from elvis.core.queries import points_on_line, points_on_plane
    from elvis.core.resolution.stream_functions import with_stream_function
    from elvis.core.sampling import Samples, line, sample
    from elvis.core.shapes import Shape
    from elvis.core.streamlines import TracedLines, trace
    from elvis.core.triangles import LevelLines, SurfaceTriangles, boundary_triangles, level_lines, level_triangles
    from elvis.core.version import __version__
    from elvis.core.wall_points import wall_points
    from elvis.plugins.added_quantities import with_quantity
    from elvis.plugins.arrays import from_arrays
    from elvis.plugins.boundary_data import boundary_data
    from elvis.plugins.continuous_fields import continuous
    from elvis.plugins.data import read
    from elvis.plugins.deforming import deform, largest_scale
    from elvis.plugins.extruded_mean import mean_along
    from elvis.plugins.onto_mesh import onto_mesh
    from elvis.plugins.phases import at_phase
    from elvis.plugins.plane_means import plane_means
    from elvis.plugins.series.paths import pathlines, streaklines
    from elvis.plugins.series.series import open_series
    from elvis.plugins.series.statistics import average
    from elvis.renderer.device_errors import DeviceError
    from elvis.renderer.in_situ import Session
    from elvis.renderer.rendering import Renderer, render
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
    from elvis.scene.surfaces import Cone, Cylinder, Implicit, Plane, Sphere, Surface, TriangleMesh
    from elvis.scene.validation import scene_schema
    from elvis.scene.whole import NAMED_VIEWS, Camera, Caption, Clip, Deform, Light, Reference, Scene
    from elvis.viewer.widget import view

__all__ = [
    "NAMED_VIEWS",
    "Basis",
    "Block",
    "Camera",
    "Caption",
    "Clip",
    "ColorBar",
    "Composite",
    "Cone",
    "Contours",
    "Copies",
    "CriticalPoints",
    "Curves",
    "CutSurface",
    "Cylinder",
    "Dataset",
    "Deform",
    "DeviceError",
    "ElvisError",
    "Entities",
    "Expansion",
    "ExpansionRule",
    "Extremum",
    "Faces",
    "Field",
    "FormatError",
    "Frame",
    "Glyphs",
    "Homogeneous",
    "Implicit",
    "Isosurface",
    "LevelLines",
    "Lic",
    "Light",
    "Mesh",
    "MeshLines",
    "MeshQuality",
    "Plane",
    "Reference",
    "Renderer",
    "Repeat",
    "Samples",
    "Scene",
    "SceneError",
    "SceneObject",
    "Session",
    "Shape",
    "Sphere",
    "Status",
    "Streamlines",
    "Style",
    "Surface",
    "SurfaceTriangles",
    "TracedLines",
    "Transfer",
    "TriangleMesh",
    "Turn",
    "VolumeRendering",
    "VortexCores",
    "__version__",
    "at_phase",
    "average",
    "boundary_data",
    "boundary_triangles",
    "continuous",
    "critical_points",
    "deform",
    "diff",
    "draw",
    "extrema",
    "from_arrays",
    "from_blueprint",
    "from_mfem",
    "from_ngsolve",
    "integrate",
    "largest_scale",
    "level_lines",
    "level_triangles",
    "line",
    "mean_along",
    "mesh_quality",
    "norms",
    "onto_mesh",
    "open_series",
    "pathlines",
    "plane_means",
    "points_on_line",
    "points_on_plane",
    "read",
    "render",
    "sample",
    "scene_schema",
    "streaklines",
    "to_meshio",
    "to_pyvista",
    "to_xarray",
    "trace",
    "view",
    "vortex_cores",
    "wall_points",
    "with_quantity",
    "with_stream_function",
    "write",
]

#: full name of a module -> the public names that it defines
NAMES = {
    "elvis.api.dataset_files": ("write",),
    "elvis.api.live_pictures": ("draw",),
    "elvis.api.numbers": ("extrema",),
    "elvis.core.version": ("__version__",),
    "elvis.converters.blueprint": ("from_blueprint",),
    "elvis.converters.handing": (
        "to_meshio",
        "to_pyvista",
    ),
    "elvis.converters.live": (
        "from_mfem",
        "from_ngsolve",
    ),
    "elvis.core.cores": (
        "VortexCores",
        "vortex_cores",
    ),
    "elvis.core.critical_points": (
        "CriticalPoints",
        "critical_points",
    ),
    "elvis.core.dataset": (
        "Block",
        "Dataset",
        "Expansion",
        "ExpansionRule",
        "Field",
        "Homogeneous",
    ),
    "elvis.core.differences": ("diff",),
    "elvis.core.errors": (
        "ElvisError",
        "FormatError",
    ),
    "elvis.core.extrema": ("Extremum",),
    "elvis.core.gridding": ("to_xarray",),
    "elvis.core.integrals": ("integrate",),
    "elvis.core.mesh": (
        "Composite",
        "Curves",
        "Entities",
        "Mesh",
    ),
    "elvis.core.mesh_quality": (
        "MeshQuality",
        "mesh_quality",
    ),
    "elvis.core.norms": ("norms",),
    "elvis.core.polynomials.bases": ("Basis",),
    "elvis.core.queries": (
        "points_on_line",
        "points_on_plane",
    ),
    "elvis.core.resolution.stream_functions": ("with_stream_function",),
    "elvis.core.sampling": (
        "Samples",
        "line",
        "sample",
    ),
    "elvis.core.shapes": ("Shape",),
    "elvis.core.streamlines": (
        "TracedLines",
        "trace",
    ),
    "elvis.core.triangles": (
        "LevelLines",
        "SurfaceTriangles",
        "boundary_triangles",
        "level_lines",
        "level_triangles",
    ),
    "elvis.core.wall_points": ("wall_points",),
    "elvis.plugins.added_quantities": ("with_quantity",),
    "elvis.plugins.arrays": ("from_arrays",),
    "elvis.plugins.boundary_data": ("boundary_data",),
    "elvis.plugins.continuous_fields": ("continuous",),
    "elvis.plugins.data": ("read",),
    "elvis.plugins.deforming": ("deform", "largest_scale"),
    "elvis.plugins.extruded_mean": ("mean_along",),
    "elvis.plugins.phases": ("at_phase",),
    "elvis.plugins.plane_means": ("plane_means",),
    "elvis.plugins.onto_mesh": ("onto_mesh",),
    "elvis.plugins.series.paths": (
        "pathlines",
        "streaklines",
    ),
    "elvis.plugins.series.series": ("open_series",),
    "elvis.plugins.series.statistics": ("average",),
    "elvis.renderer.device_errors": ("DeviceError",),
    "elvis.renderer.in_situ": ("Session",),
    "elvis.renderer.rendering": (
        "Renderer",
        "render",
    ),
    "elvis.scene.convolution": ("Lic",),
    "elvis.scene.copies": (
        "Copies",
        "Repeat",
        "Turn",
    ),
    "elvis.scene.errors": ("SceneError",),
    "elvis.scene.frame": (
        "Frame",
        "Status",
    ),
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
    "elvis.scene.style": (
        "ColorBar",
        "Contours",
        "MeshLines",
        "Style",
    ),
    "elvis.scene.surfaces": (
        "Cone",
        "Cylinder",
        "Implicit",
        "Plane",
        "Sphere",
        "Surface",
        "TriangleMesh",
    ),
    "elvis.scene.validation": ("scene_schema",),
    "elvis.scene.whole": (
        "Camera",
        "Caption",
        "Clip",
        "Deform",
        "Light",
        "NAMED_VIEWS",
        "Reference",
        "Scene",
    ),
    "elvis.viewer.widget": ("view",),
}

__getattr__ = lazy_names(__name__, NAMES)


def __dir__() -> list[str]:
    return __all__
