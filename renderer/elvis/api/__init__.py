"""The public API of ElVis, which ``import elvis`` offers.

``NAMES`` lists every public name and the module that defines it.  A name is imported when a program first uses it.
This slice may import every other slice; no other slice imports it.
"""

from __future__ import annotations

from elvis.core.base.lazy import lazy_names

TYPE_CHECKING = False
if TYPE_CHECKING:
    from elvis.api.dataset_files import write
    from elvis.api.live_pictures import draw
    from elvis.api.numbers import extrema
    from elvis.converters.python.blueprint import from_blueprint
    from elvis.converters.python.handing import to_meshio, to_pyvista
    from elvis.converters.python.live import from_mfem, from_ngsolve
    from elvis.core.base.errors import ElvisError, FormatError
    from elvis.core.base.version import __version__
    from elvis.core.bounds.extrema import Extremum
    from elvis.core.cores import VortexCores, vortex_cores
    from elvis.core.critical.points import CriticalPoints, critical_points
    from elvis.core.critical.wall_points import wall_points
    from elvis.core.data.dataset import Block, Dataset, Expansion, ExpansionRule, Field, Homogeneous
    from elvis.core.data.mesh import Composite, Curves, Entities, Mesh
    from elvis.core.differences import diff
    from elvis.core.integrals import integrate
    from elvis.core.numbers.gridding import to_xarray
    from elvis.core.numbers.mesh_quality import MeshQuality, mesh_quality
    from elvis.core.numbers.norms import norms
    from elvis.core.numbers.queries import points_on_line, points_on_plane
    from elvis.core.numbers.sampling import Samples, line, sample
    from elvis.core.polynomials.bases import Basis
    from elvis.core.resolution.stream_functions import with_stream_function
    from elvis.core.shapes import Shape
    from elvis.core.streamlines import TracedLines, trace
    from elvis.core.triangles import LevelLines, SurfaceTriangles, boundary_triangles, level_lines, level_triangles
    from elvis.plugins.conversion.arrays import from_arrays
    from elvis.plugins.data.added_quantities import with_quantity
    from elvis.plugins.data.boundary_data import boundary_data
    from elvis.plugins.data.data import read
    from elvis.plugins.data.deforming import deform, largest_scale
    from elvis.plugins.data.phases import at_phase
    from elvis.plugins.means.extruded_mean import mean_along
    from elvis.plugins.means.plane_means import plane_means
    from elvis.plugins.series.paths import pathlines, streaklines
    from elvis.plugins.series.series import open_series
    from elvis.plugins.series.statistics import average
    from elvis.plugins.transfers.continuous_fields import continuous
    from elvis.plugins.transfers.onto_mesh import onto_mesh
    from elvis.renderer.device.errors import DeviceError
    from elvis.renderer.frame.renderer import Renderer
    from elvis.renderer.frame.rendering import render
    from elvis.renderer.insitu.in_situ import Session
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
    from elvis.scene.model.surfaces import Cone, Cylinder, Implicit, Plane, Sphere, Surface, TriangleMesh
    from elvis.scene.model.validation import scene_schema
    from elvis.scene.model.whole import NAMED_VIEWS, Camera, Caption, Clip, Deform, Light, Reference, Scene
    from elvis.scene.record.frame import Frame, Status
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
    "elvis.core.base.version": ("__version__",),
    "elvis.converters.python.blueprint": ("from_blueprint",),
    "elvis.converters.python.handing": (
        "to_meshio",
        "to_pyvista",
    ),
    "elvis.converters.python.live": (
        "from_mfem",
        "from_ngsolve",
    ),
    "elvis.core.cores": (
        "VortexCores",
        "vortex_cores",
    ),
    "elvis.core.critical.points": (
        "CriticalPoints",
        "critical_points",
    ),
    "elvis.core.data.dataset": (
        "Block",
        "Dataset",
        "Expansion",
        "ExpansionRule",
        "Field",
        "Homogeneous",
    ),
    "elvis.core.differences": ("diff",),
    "elvis.core.base.errors": (
        "ElvisError",
        "FormatError",
    ),
    "elvis.core.bounds.extrema": ("Extremum",),
    "elvis.core.numbers.gridding": ("to_xarray",),
    "elvis.core.integrals": ("integrate",),
    "elvis.core.data.mesh": (
        "Composite",
        "Curves",
        "Entities",
        "Mesh",
    ),
    "elvis.core.numbers.mesh_quality": (
        "MeshQuality",
        "mesh_quality",
    ),
    "elvis.core.numbers.norms": ("norms",),
    "elvis.core.polynomials.bases": ("Basis",),
    "elvis.core.numbers.queries": (
        "points_on_line",
        "points_on_plane",
    ),
    "elvis.core.resolution.stream_functions": ("with_stream_function",),
    "elvis.core.numbers.sampling": (
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
    "elvis.core.critical.wall_points": ("wall_points",),
    "elvis.plugins.data.added_quantities": ("with_quantity",),
    "elvis.plugins.conversion.arrays": ("from_arrays",),
    "elvis.plugins.data.boundary_data": ("boundary_data",),
    "elvis.plugins.transfers.continuous_fields": ("continuous",),
    "elvis.plugins.data.data": ("read",),
    "elvis.plugins.data.deforming": ("deform", "largest_scale"),
    "elvis.plugins.means.extruded_mean": ("mean_along",),
    "elvis.plugins.data.phases": ("at_phase",),
    "elvis.plugins.means.plane_means": ("plane_means",),
    "elvis.plugins.transfers.onto_mesh": ("onto_mesh",),
    "elvis.plugins.series.paths": (
        "pathlines",
        "streaklines",
    ),
    "elvis.plugins.series.series": ("open_series",),
    "elvis.plugins.series.statistics": ("average",),
    "elvis.renderer.device.errors": ("DeviceError",),
    "elvis.renderer.insitu.in_situ": ("Session",),
    "elvis.renderer.frame.renderer": ("Renderer",),
    "elvis.renderer.frame.rendering": ("render",),
    "elvis.scene.model.convolution": ("Lic",),
    "elvis.scene.model.copies": (
        "Copies",
        "Repeat",
        "Turn",
    ),
    "elvis.scene.model.errors": ("SceneError",),
    "elvis.scene.record.frame": (
        "Frame",
        "Status",
    ),
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
    "elvis.scene.model.style": (
        "ColorBar",
        "Contours",
        "MeshLines",
        "Style",
    ),
    "elvis.scene.model.surfaces": (
        "Cone",
        "Cylinder",
        "Implicit",
        "Plane",
        "Sphere",
        "Surface",
        "TriangleMesh",
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
    "elvis.viewer.widget": ("view",),
}

__getattr__ = lazy_names(__name__, NAMES)


def __dir__() -> list[str]:
    return __all__
