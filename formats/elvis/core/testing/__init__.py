"""Datasets made on the spot, for tests, demonstrations and benchmarks: every shape, straight and curved, any size."""

from elvis.core.testing.bending import curved, ripple, shuffled, swirled
from elvis.core.testing.fields import VORTICES, approximated, interpolated, with_field
from elvis.core.testing.meshes import grid, mixed_plane, mixed_volume, one_element, rotated, scattered

__all__ = [
    "VORTICES",
    "approximated",
    "curved",
    "grid",
    "interpolated",
    "mixed_plane",
    "mixed_volume",
    "one_element",
    "ripple",
    "rotated",
    "scattered",
    "shuffled",
    "swirled",
    "with_field",
]
