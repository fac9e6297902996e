"""Data with a Fourier direction as slabs of volume elements, for programs and commands that have no waves.

A plane element times an interval of z is a hexahedron or a prism, a line element times one of y a quadrilateral.
There the waves become polynomials, whose errors are measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, factorial, pi
from pathlib import Path

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset, Homogeneous
from elvis.core.mapping.orientation import local_vertices
from elvis.core.mapping.patch import Patch, patches
from elvis.core.polynomials.bases import Basis
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.shapes import Shape
from elvis.plugins.conversion.converting import Conversion, Settings, convert
from elvis.plugins.conversion.plugin import Boundary, Converter, Elements, SourceField
from elvis.plugins.fourier.planes import only_waves

#: the shape of slabs by that of elements
_SLABS = {
    Shape.SEGMENT: Shape.QUADRILATERAL,
    Shape.TRIANGLE: Shape.PRISM,
    Shape.QUADRILATERAL: Shape.HEXAHEDRON,
}
#: error of the shortest wave, as a share of its amplitude, from which the number of slabs follows
_GOAL = 1e-3
#: slabs at most if their number isn't given
_MOST = 512


def in_slabs(dataset: Dataset, slabs: int | None = None, order: int | None = None) -> Conversion:
    """The data with slabs of elements instead of a Fourier direction, and the report of the errors.

    slabs  over a period; by default the shortest wave has an error of about 1e-3 of its amplitude
    order  polynomial degree, 1 to 30; by default the order of the fields in the plane, at least 3

    ElvisError for data without one Fourier direction.
    """
    source = _Slabs(dataset, slabs, order)
    return convert(source, Settings(order=source.order), ())


class _Slabs(Converter):
    """Slabs of the elements of a dataset with one Fourier direction."""

    format = "slabs of Fourier data"

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """No files."""
        return False

    def __init__(self, dataset: Dataset, slabs: int | None, order: int | None) -> None:
        names = [own.name for own in dataset.solution]
        self._patches = patches(dataset, names)
        waves = only_waves(self._patches, "--extrude")
        held = [own for patch in self._patches for own in patch.fields if own is not None]
        in_plane = max(max(own.modes) - 1 for own in held)
        self.order = max(in_plane, 3) if order is None else order
        self._slabs = _slab_count(waves, self.order) if slabs is None else slabs
        if self._slabs < 1:
            raise ElvisError(f"--extrude: expected at least one slab, found {self._slabs}")
        self._vertices = len(dataset.mesh.vertices)
        self.time, self.metadata = dataset.time, dataset.metadata
        self.blocks = [self._block(dataset, number) for number in range(len(self._patches))]
        self.fields = [SourceField(name, self.order, False, False, i) for i, name in enumerate(names)]
        self.boundaries = self._walls(dataset)

    def _block(self, dataset: Dataset, number: int) -> Elements:
        """All slabs of the elements of a patch, one level after the other."""
        patch = self._patches[number]
        order = max(patch.geometry.modes) - 1
        rows = dataset.mesh.of(patch.shape).rows_of(patch.element_ids)
        vertices = self._levels(self._around(patch.shape, local_vertices(dataset.mesh, patch.shape)[rows]))
        return Elements(_SLABS[patch.shape], len(vertices), order, vertices=vertices, key=number)

    def _around(self, shape: Shape, own: Ints) -> Ints:
        """(n, vertices of the slab) vertices of the lowest slab, numbered through the levels."""
        above = own + self._vertices
        if shape is Shape.TRIANGLE:
            # the prism's second coordinate goes down, so that its determinant is positive
            a, b, c = (np.stack([above[:, k], own[:, k]], axis=1) for k in range(3))
            return np.stack([a[:, 0], b[:, 0], b[:, 1], a[:, 1], c[:, 0], c[:, 1]], axis=1)
        if shape is Shape.SEGMENT:
            return np.stack([own[:, 0], own[:, 1], above[:, 1], above[:, 0]], axis=1)
        return np.concatenate([own, above], axis=1)

    def _levels(self, lowest: Ints) -> Ints:
        """The same on every level."""
        steps = self._vertices * np.arange(self._slabs)
        return np.asarray((lowest + steps[:, None, None]).reshape(-1, lowest.shape[1]))

    def _walls(self, dataset: Dataset) -> list[Boundary]:
        """Composites of sides, extruded."""
        found: list[Boundary] = []
        if dataset.mesh.dimension != 2:
            return found
        edges = dataset.mesh.of(Shape.SEGMENT)
        for composite in dataset.mesh.composites:
            ids = dict(composite.parts).get("E", ())
            if not len(ids):
                continue
            ends = edges.members[edges.rows_of(np.asarray(ids))]
            faces = self._levels(np.concatenate([ends, ends + self._vertices], axis=1))
            name = composite.name or composite.label or f"boundary{composite.id}"
            found.append(Boundary(name, [faces], number=composite.id))
        return found

    def positions(self, block: Elements, points: Floats) -> Floats:
        """The map in the plane, and the coordinate along the waves."""
        return self._at(block, points).positions.reshape(len(block), len(points), 3)

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """The values of the waves."""
        return self._at(block, points).derivative(field.key, 0).reshape(len(block), len(points))

    def _at(self, block: Elements, points: Floats) -> ElementPoints:
        """Points of slabs as points of elements and zeta."""
        patch: Patch = self._patches[block.key]
        numbers = np.arange(len(patch) * self._slabs)[block.rows]
        level, row = np.divmod(numbers, len(patch))
        in_plane = points[:, [0, 2]] if block.shape is Shape.PRISM else points[:, :-1]
        height = -points[:, 1] if block.shape is Shape.PRISM else points[:, -1]
        zeta = 2 * (level[:, None] + (1 + height) / 2) / self._slabs - 1
        own = np.column_stack([np.tile(in_plane, (len(numbers), 1)), zeta.reshape(-1)])
        return ElementPoints(patch, np.repeat(row, len(points)), own)


def _slab_count(waves: Homogeneous, order: int) -> int:
    """Slabs on which polynomials of an order approximate the shortest wave to `_GOAL`.

    On a slab with the phase 2 t the best approximation of exp(i t x) on [-1, 1] is off by about 2 (t/2)^(p+1) / (p+1)!
    (Chebyshev's leading term).
    """
    shortest = max(waves.z_ids) // 2 if waves.bases[0] is Basis.FOURIER else 1
    reach = 2 * float(_GOAL * factorial(order + 1) / 2) ** (1 / (order + 1))
    return int(min(_MOST, max(2, ceil(pi * shortest / reach))))
