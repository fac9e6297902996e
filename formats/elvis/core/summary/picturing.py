"""The kind of picture of a dataset: from its elements, the space they lie in, and its Fourier directions."""

from __future__ import annotations

from enum import Enum

from elvis.core.data.dataset import Dataset
from elvis.core.quantities import Names


class Kind(Enum):
    """The kind of data for a picture; determined once and passed on.

    LINE     1D data, drawn as curves
    PLANE    2D data in the plane z = 0
    SURFACE  a surface in space: 2D elements, or lines with a Fourier direction
    SOLID    3D data
    """

    LINE = 1
    PLANE = 2
    SURFACE = "surface"
    SOLID = 3

    @staticmethod
    def of(dataset: Dataset) -> Kind:
        """The kind of a dataset, by its elements' coordinates and its Fourier directions."""
        mesh = dataset.mesh
        dimension = mesh.dimension + Names.of(dataset).dimension - mesh.space
        if dimension == 2 and (mesh.dimension == 1 or mesh.space > 2):
            return Kind.SURFACE
        return Kind(min(dimension, 3))
