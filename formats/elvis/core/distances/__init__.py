"""Distances to surfaces: curved boundaries of a dataset, and triangle meshes from files.

surface_patches  parts of faces as polynomials, cut until they are nearly flat
quadratic        the smallest value of a quadratic function on a triangle, square or line
boundaries       faces of a dataset's boundaries
triangle_files   triangle meshes
sides            which side of a closed surface is inside
surface          a surface with all that its distance takes
parts            parts of patches, and the squared distance to them with its derivatives
search           the nearest places, proved by bounds
directions       unit vectors from the nearest places
"""

from __future__ import annotations

from elvis.core.distances.directions import gradients, vectors_away
from elvis.core.distances.search import Near, nearest
from elvis.core.distances.surface import Surface, surface_of

__all__ = ["Near", "Surface", "gradients", "nearest", "surface_of", "vectors_away"]
