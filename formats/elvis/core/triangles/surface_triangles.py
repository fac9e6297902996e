"""Triangles with values at their corners."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset

#: the share of the size of the data that is the tolerance where none is given
_DEFAULT_SHARE = 1e-3


def default_tolerance(dataset: Dataset, tolerance: float | None) -> float:
    """The requested distance from exact surfaces; raises ElvisError if it is not positive."""
    if tolerance is None:
        return _DEFAULT_SHARE * max(float(np.ptp(dataset.mesh.vertices, axis=0).max(initial=0.0)), 1e-300)
    if not 0 < tolerance < np.inf:
        raise ElvisError(f"expected a positive tolerance, found {tolerance}")
    return tolerance


@dataclass(frozen=True, eq=False)
class SurfaceTriangles:
    """A surface as triangles.

    points     (n, 3) corners
    triangles  (m, 3) rows of these; counter-clockwise seen from where the normal points
    normals    (n, 3) unit normals of the exact surface, towards larger values
    values     (n,) of quantities, by their texts
    distance   maximum distance of triangles and surface; 0 if unknown
    is_bound   whether that is a bound, not an estimate
    remarks    remarks about the computation
    """

    points: Floats
    triangles: Ints
    normals: Floats
    values: Mapping[str, Floats]
    distance: float = 0.0
    is_bound: bool = True
    remarks: tuple[str, ...] = ()

    @property
    def area(self) -> float:
        """Total area of the triangles."""
        return float(np.linalg.norm(self.crosses, axis=1).sum() / 2)

    @property
    def crosses(self) -> Floats:
        """Normals (m, 3) of the triangles, with twice their area as length."""
        a, b, c = (self.points[self.triangles[:, k]] for k in range(3))
        return np.cross(b - a, c - a)

    def compacted(self) -> SurfaceTriangles:
        """The surface without unused points."""
        used, flat = np.unique(self.triangles, return_inverse=True)
        values = {name: own[used] for name, own in self.values.items()}
        return replace(
            self,
            points=self.points[used],
            triangles=flat.reshape(-1, 3),
            normals=self.normals[used],
            values=values,
        )
