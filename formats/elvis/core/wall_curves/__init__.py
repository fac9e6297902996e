"""Curves on boundaries: 2D walls themselves, and sections of 3D walls with planes.

wall_segments   parts of curves in the reference coordinates of sides of elements
plane_sections  the segments where a plane meets a boundary
chains          segments with common ends as curves
wall_curve      the curves of a name, their lengths, and the values of quantities along them
wall_pieces     the parts of these curves for integrals
drawn_curves    the curves for pictures
wall_places     values at the places of a boundary nearest to given points
"""

from __future__ import annotations

from elvis.core.wall_curves.curve import WallCurve, is_wall_curve, on_walls, points_along, wall_curves
from elvis.core.wall_curves.places import at_walls

__all__ = ["WallCurve", "at_walls", "is_wall_curve", "on_walls", "points_along", "wall_curves"]
