"""A source made of functions: any mesh, curved by any map, with any fields; to try the conversion itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.mesh import Mesh
from elvis.core.mapping.mode_entities import entities
from elvis.core.mapping.orientation import local_vertices
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.shapes import Shape
from elvis.core.testing import rotated
from elvis.plugins.conversion.plugin import Converter, Elements, PyramidSpace, SourceField
from elvis.plugins.projection.frames import PROPER

Function = Callable[[Floats], Floats]


@dataclass(frozen=True)
class AnalyticField:
    """A field: its function of points (..., 3) of the straight mesh, and what the source says of it."""

    function: Function
    order: int
    is_continuous: bool = True
    is_polynomial: bool = True


class Analytic(Converter):
    """Straight elements of a mesh, moved by a map, with fields that are functions of where the points came from.

    warp   moves points (..., 3); of degree ``order`` on every element
    seed   turns every element at random, and numbers the vertices at random; None leaves them as in the mesh
    """

    format = "functions"

    def __init__(
        self,
        mesh: Mesh,
        fields: Mapping[str, AnalyticField],
        warp: Function = lambda points: points,
        order: int = 1,
        seed: int | None = None,
        pyramid: PyramidSpace = PyramidSpace.TENSOR,
        is_numbered: bool = True,
    ) -> None:
        self.places, self.warp = mesh.vertices, warp
        elements = {shape: local_vertices(mesh, shape) for shape in mesh.elements}
        numbers = np.arange(len(mesh.vertices))
        if seed is not None:
            elements = rotated({s: _reorder(s, rows, seed) for s, rows in elements.items()}, seed)
            numbers = np.random.default_rng(seed).permutation(7 * len(numbers) + 3)[: len(numbers)]
        self.blocks = [
            Elements(s, len(rows), order, numbers[rows] if is_numbered else None, pyramid=pyramid, key=rows)
            for s, rows in elements.items()
        ]
        self.fields = [
            SourceField(name, given.order, given.is_continuous, given.is_polynomial, given.function)
            for name, given in fields.items()
        ]

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """No files: a source is made, not read."""
        return False

    def positions(self, block: Elements, points: Floats) -> Floats:
        """Images of points of the straight elements."""
        return self.warp(self.straight(block, points))

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """The function at the points of the straight elements."""
        return np.asarray(field.key(self.straight(block, points)), np.float64)

    def straight(self, block: Elements, points: Floats) -> Floats:
        """(len(block), n, 3) points of the straight elements."""
        shape = block.shape
        table = values(modified(shape, (2,) * shape.dimension), points)[:, entities(shape, 2).vertices]
        return np.asarray(np.einsum("pv,evc->epc", table, self.places[block.key[block.rows]]))


def _reorder(shape: Shape, rows: Ints, seed: int) -> Ints:
    """Elements in any of the vertex orders that a native element may need."""
    which = np.random.default_rng(seed).integers(len(PROPER[shape]), size=len(rows))
    return np.take_along_axis(rows, np.array(PROPER[shape])[which], axis=1)
