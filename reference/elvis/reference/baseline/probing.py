"""Triangles from a file that cut a linear mesh: rays meet the triangles, and values are interpolated in the mesh."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.reference.baseline.mesh import LinearMesh
from elvis.reference.baseline.tracing import Tracer
from elvis.reference.extras import comparison_module
from elvis.reference.hits import Hits
from elvis.reference.scenes.rasters import barycentric_gradients
from elvis.scene.cameras.view import View

#: triangles that a ray may meet outside of the mesh before it is given up
_DEEPEST = 64


class Probe:
    """A tetrahedral mesh, prepared for interpolation at intersections of rays and triangles."""

    def __init__(self, mesh: LinearMesh, triangles: LinearMesh) -> None:
        """Build the trees; MissingPackageError without libigl or embreex."""
        self.mesh, self._surface = mesh, Tracer(triangles)
        self._tree, self._corners = comparison_module("igl").AABB(), mesh.simplices.astype(np.int64)
        self._tree.init(mesh.points, self._corners)

    def first(self, view: View, beyond: Floats | None = None) -> Hits:
        """The nearest hit of each pixel's ray within the mesh, of those deeper than ``beyond`` (n,)."""
        found = Hits.none(view.count, tuple(self.mesh.values))
        for _ in range(_DEEPEST):
            met = self._surface.first(view, beyond)
            pixels = np.flatnonzero(met.seen)
            if not len(pixels):
                break
            igl = comparison_module("igl")
            cells = igl.in_element(self.mesh.points, self._corners, met.position[pixels], self._tree)
            inside = cells >= 0
            self._put(found, pixels[inside], cells[inside], met)
            beyond = np.full(view.count, np.inf)
            beyond[pixels[~inside]] = met.depth[pixels[~inside]]
        return found

    def _put(self, found: Hits, pixels: Ints, cells: Ints, met: Hits) -> None:
        """Set the values of the mesh at some of the triangles' hits."""
        corners, places = self._corners[cells], met.position[pixels]
        world = self.mesh.points[corners]
        weights = np.einsum("nki,ni->nk", barycentric_gradients(world), places - world[:, 0]) + (np.arange(4) == 0)

        def interpolate(column: Floats) -> Floats:
            return np.asarray(np.einsum("nk,nk...->n...", weights, column[corners]))

        for name in ("position", "depth", "normal", "status"):
            getattr(found, name)[pixels] = getattr(met, name)[pixels]
        found.element[pixels], found.reference[pixels] = self.mesh.element[cells], interpolate(self.mesh.reference)
        for name, values in self.mesh.values.items():
            found.values[name][pixels] = interpolate(values)
