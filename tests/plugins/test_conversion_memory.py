"""What a conversion holds at once grows no faster than a few times what comes out."""

import gc
import tracemalloc

import numpy as np

from elvis.core.mapping.orientation import local_vertices
from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.plugins.conversion.converting import convert
from elvis.plugins.conversion.plugin import Converter, Elements, SourceField

#: peak memory over the arrays of the result
LIMIT = 5.0


class Bent(Converter):
    """Tetrahedra of a cube under a quadratic map, with a cubic field that is continuous."""

    def __init__(self, cells):
        mesh = grid(Shape.TETRAHEDRON, cells)
        rows = local_vertices(mesh, Shape.TETRAHEDRON)
        self.corners = mesh.vertices[rows]
        self.blocks = [Elements(Shape.TETRAHEDRON, len(rows), 2, vertices=rows)]
        self.fields = [SourceField("u", 3, is_continuous=True)]

    @classmethod
    def opens(cls, paths):
        return False

    def straight(self, block, points):
        weights = np.column_stack([-(1 + points.sum(axis=1)), *(1 + points.T)]) / 2
        return np.einsum("evc,pv->epc", self.corners[block.rows], weights)

    def positions(self, block, points):
        x = self.straight(block, points)
        return x + 0.05 * x[:, :, [1, 2, 0]] ** 2

    def sample(self, block, field, points):
        x = self.straight(block, points)
        return x[:, :, 0] ** 3 - x[:, :, 1] * x[:, :, 2]


def used(cells):
    """Bytes that a conversion has at most, beyond the source's, and bytes of its arrays."""
    source = Bent(cells)
    gc.collect()
    tracemalloc.start()
    dataset = convert(source).dataset
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    mesh = dataset.mesh
    arrays = [mesh.vertex_ids, mesh.vertices, *(a for e in mesh.entities.values() for a in (e.ids, e.members))]
    arrays += [getattr(c, name) for c in (mesh.edge_curves, mesh.face_curves) for name in ("rows", "kinds", "points")]
    arrays += [block.coefficients for field in dataset.fields for block in field.blocks]
    return peak, sum(array.nbytes for array in arrays)


def test_memory_grows_with_the_output():
    used(2)  # tables are made once; from 12 cells on pieces are as large as they get
    (few, small), (many, large) = used(12), used(15)
    assert (many - few) <= LIMIT * (large - small)
