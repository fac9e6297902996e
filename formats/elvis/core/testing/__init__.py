"""Datasets made on the spot, for tests, demonstrations and benchmarks: every shape, straight and curved, any size."""

from elvis.core.testing.bending import curved, ripple, shuffled
from elvis.core.testing.fields import approximated, with_field
from elvis.core.testing.meshes import grid, mixed_plane, mixed_volume, one_element, rotated, scattered

__all__ = [
    "approximated",
    "curved",
    "grid",
    "mixed_plane",
    "mixed_volume",
    "one_element",
    "ripple",
    "rotated",
    "scattered",
    "shuffled",
    "with_field",
]
