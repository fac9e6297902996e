"""Surfaces as triangles, within a tolerance of the exact ones: level sets, cuts and boundaries."""

from elvis.core.triangles.boundary_triangles import boundary_triangles
from elvis.core.triangles.clipped import clipped
from elvis.core.triangles.level_lines import LevelLines, level_lines
from elvis.core.triangles.surface_triangles import SurfaceTriangles
from elvis.core.triangles.triangulation import level_triangles

__all__ = ["LevelLines", "SurfaceTriangles", "boundary_triangles", "clipped", "level_lines", "level_triangles"]
