"""Solutions in files and in memory: ``ds = read("wing.xml", "wing.fld")``; what they hold, what one asks of them.

This is a door: it names, from all over the house, what programs need of data, and imports it when it is used.  Nothing
in the house goes through it (a test guards that), so what reads and writes the native format stands on the core alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from elvis.core.lazy import lazy_names

if TYPE_CHECKING:
    from elvis.converters.blueprint import from_blueprint
    from elvis.converters.handing import to_meshio, to_pyvista
    from elvis.converters.live import from_mfem, from_ngsolve
    from elvis.core.cores import VortexCores, vortex_cores
    from elvis.core.critical_points import CriticalPoints, critical_points
    from elvis.core.dataset import Block, Dataset, Expansion, ExpansionRule, Field, Homogeneous
    from elvis.core.differences import diff
    from elvis.core.errors import ElvisError, FormatError
    from elvis.core.gridding import to_xarray
    from elvis.core.integrals import integrate
    from elvis.core.mesh import Composite, Curves, Entities, Mesh
    from elvis.core.norms import norms
    from elvis.core.polynomials.bases import Basis
    from elvis.core.queries import points_on_line, points_on_plane
    from elvis.core.sampling import Samples, line, sample
    from elvis.core.shapes import Shape
    from elvis.core.streamlines import Streamlines, trace
    from elvis.core.wall_points import wall_points
    from elvis.formats.writing import write
    from elvis.plugins.arrays import from_arrays
    from elvis.plugins.data import read
    from elvis.plugins.series.paths import pathlines, streaklines
    from elvis.plugins.series.series import open_series

__all__ = [
    "Basis",
    "Block",
    "Composite",
    "CriticalPoints",
    "Curves",
    "Dataset",
    "ElvisError",
    "Entities",
    "Expansion",
    "ExpansionRule",
    "Field",
    "FormatError",
    "Homogeneous",
    "Mesh",
    "Samples",
    "Shape",
    "Streamlines",
    "VortexCores",
    "critical_points",
    "diff",
    "from_arrays",
    "from_blueprint",
    "from_mfem",
    "from_ngsolve",
    "integrate",
    "line",
    "norms",
    "open_series",
    "pathlines",
    "points_on_line",
    "points_on_plane",
    "read",
    "sample",
    "streaklines",
    "to_meshio",
    "to_pyvista",
    "to_xarray",
    "trace",
    "vortex_cores",
    "wall_points",
    "write",
]

__getattr__ = lazy_names(
    __name__,
    {
        "elvis.converters.blueprint": ("from_blueprint",),
        "elvis.converters.handing": ("to_meshio", "to_pyvista"),
        "elvis.converters.live": ("from_mfem", "from_ngsolve"),
        "elvis.core.cores": ("VortexCores", "vortex_cores"),
        "elvis.core.critical_points": ("CriticalPoints", "critical_points"),
        "elvis.core.dataset": ("Block", "Dataset", "Expansion", "ExpansionRule", "Field", "Homogeneous"),
        "elvis.core.differences": ("diff",),
        "elvis.core.errors": ("ElvisError", "FormatError"),
        "elvis.core.gridding": ("to_xarray",),
        "elvis.core.integrals": ("integrate",),
        "elvis.core.mesh": ("Composite", "Curves", "Entities", "Mesh"),
        "elvis.core.norms": ("norms",),
        "elvis.core.polynomials.bases": ("Basis",),
        "elvis.core.queries": ("points_on_line", "points_on_plane"),
        "elvis.core.sampling": ("Samples", "line", "sample"),
        "elvis.core.shapes": ("Shape",),
        "elvis.core.streamlines": ("Streamlines", "trace"),
        "elvis.core.wall_points": ("wall_points",),
        "elvis.formats.writing": ("write",),
        "elvis.plugins.arrays": ("from_arrays",),
        "elvis.plugins.data": ("read",),
        "elvis.plugins.series.paths": ("pathlines", "streaklines"),
        "elvis.plugins.series.series": ("open_series",),
    },
)


def __dir__() -> list[str]:
    return __all__
