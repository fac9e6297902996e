"""Native blocks: a source's blocks as they will stand in the mesh, and how their elements lie in the source's."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import Expansion
from elvis.core.polynomials.collapse import collapse
from elvis.core.polynomials.interpolation import modified
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import orthonormal
from elvis.plugins.conversion.plugin import Elements
from elvis.plugins.projection.frames import affine, affine_between, orders, source_points


@dataclass(frozen=True, eq=False)
class NativeBlock:
    """Elements of one block of the source as elements of the mesh.

    number       of the block in the source
    source       that block
    shape        in the mesh: the source's, or a hexahedron where a pyramid's functions need one
    vertices     (n, n_vertices) rows of vertices, in native order
    order        (n,) which vertex order, of `frames.orders`, each element takes
    is_mirrored  whether the source's elements are left-handed as a whole
    rows         (n,) the elements' rows in the source's block
    mesh_rows    (n,) the elements' rows among all of their shape in the mesh
    ids          (n,) ids in the file
    modes        number of modes each way for every field, None where each field has its own
    is_ortho     whether fields take the Ortho expansion of the polynomial pyramid instead of the Modified one
    """

    number: int
    source: Elements
    shape: Shape
    vertices: Ints
    order: Ints
    is_mirrored: bool
    rows: Ints
    mesh_rows: Ints
    ids: Ints
    modes: int | None = None
    is_ortho: bool = False

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def is_collapsed(self) -> bool:
        """Whether hexahedra stand for pyramids."""
        return self.shape is not self.source.shape

    def expansion(self, modes: int | tuple[int, ...]) -> Expansion:
        """The native expansion of these elements with this many modes each way, or in each direction."""
        own = (modes,) * self.shape.dimension if isinstance(modes, int) else modes
        if self.is_ortho:
            return replace(orthonormal(self.shape, 1), modes=own)
        return modified(self.shape, own)

    def select(self, which: Ints, modes: int | None = None) -> NativeBlock:
        """Only the elements ``which`` (k,), with this many modes."""
        own = {name: getattr(self, name)[which] for name in ("vertices", "order", "rows", "mesh_rows", "ids")}
        return replace(self, **own, modes=modes)

    def points(self, order: int, points: Floats) -> Floats:
        """The source's reference points for native ones (n, d), in elements of vertex order number ``order``."""
        block = self.source
        own = source_points(block.shape, orders(block.shape, self.is_mirrored)[order], points, self.is_collapsed)
        if block.frame is None:
            return own
        matrix, offset = affine_between(block.shape.vertices, block.frame)
        return own @ matrix.T + offset

    def native_points(self, order: int, points: Floats) -> Floats:
        """The native reference points for the source's (n, d): the inverse of `points`."""
        block, own = self.source, points
        if block.frame is not None:
            matrix, offset = affine_between(block.frame, block.shape.vertices)
            own = own @ matrix.T + offset
        matrix, offset = affine(block.shape, orders(block.shape, self.is_mirrored)[order])
        own = np.asarray(np.linalg.solve(matrix, (own - offset).T).T, np.float64)
        return collapse(Shape.PYRAMID, own) if self.is_collapsed else own

    def batches(self, size: int, only: Ints | None = None) -> Iterator[tuple[int, slice | Ints]]:
        """Rows of this block, of one vertex order and ``size`` at most, with the number of the order.

        only  ids of the elements that are meant; None for all
        """
        size, numbers = max(1, size), np.unique(self.order).tolist()
        is_meant = None if only is None else np.isin(self.ids, only)
        for number in numbers:
            own = np.flatnonzero(self.order == number) if len(numbers) > 1 else None
            if is_meant is not None:
                own = np.flatnonzero(is_meant & (self.order == number))
            for start in range(0, len(self) if own is None else len(own), size):
                yield number, slice(start, min(start + size, len(self))) if own is None else own[start : start + size]

    def take(self, rows: slice | Ints) -> Elements:
        """The source's elements behind ``rows`` of this block; by slice where they stand in a row."""
        own = self.rows[rows]
        if len(own) and own[-1] - own[0] == len(own) - 1 and (np.diff(own) == 1).all():
            return self.source.take(slice(int(own[0]), int(own[-1]) + 1))
        return self.source.take(own)
