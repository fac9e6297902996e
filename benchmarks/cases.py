"""The data that are measured: curved meshes of the unit cube, fields of any order, one oblique cut through them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elvis import Composite, Dataset, Mesh, Plane, Scene, Shape
from elvis.core.base.arrays import Floats, frozen_ints
from elvis.core.testing import approximated, curved, grid

Function = Callable[[Floats], Floats]

CUT = Plane((0.5, 0.5, 0.52), (0.1, 0.2, 1.0))
FIELD = "u"
ELEMENTS_OF_A_CELL = {Shape.TETRAHEDRON: 6, Shape.PYRAMID: 6, Shape.PRISM: 2, Shape.HEXAHEDRON: 1}


@dataclass(frozen=True)
class Case:
    """A dataset to be made.

    cells   of a row; the cube has cells^3, each filled with elements of the shape
    width   cells of a row that are retained in x and y, all of them where it is 0
    degree  of the map: 1 straight, 2 quadratic
    order   of the field (degree of its polynomials)
    """

    name: str
    shape: Shape
    cells: int
    degree: int
    order: int
    field: Function
    width: int = 0

    def dataset(self) -> Dataset:
        """Mesh and field."""
        mesh = grid(self.shape, self.cells)
        mesh = curved(mesh, bend, self.degree + 1) if self.degree > 1 else mesh
        dataset = Dataset(trimmed(mesh, self.shape, self.cells, self.width) if self.width else mesh)
        return replace(dataset, fields=(approximated(dataset, FIELD, self.field, self.order + 1),))

    @property
    def elements(self) -> int:
        """Their number."""
        return ELEMENTS_OF_A_CELL[self.shape] * self.cells * (self.width or self.cells) ** 2

    @property
    def spacing(self) -> float:
        """h: the edge of a cell."""
        return 1 / self.cells

    @property
    def label(self) -> str:
        """Elements, shape, degree, order and size in words."""
        maps = {1: "straight", 2: "quadratic"}.get(self.degree, f"degree {self.degree}")
        return f"{self.elements:,} {plural(self.shape)}, {maps} map, field p = {self.order}, h = {self.spacing:.3g}"


def plural(shape: Shape) -> str:
    """Tetrahedra, pyramids, prisms, hexahedra."""
    return f"{shape.label.lower()}s".replace("hedrons", "hedra")


def bend(points: Floats) -> Floats:
    """The unit cube a little curved, so that no face of a mesh stays flat."""
    moved = np.array(points, dtype=np.float64)
    for axis, (first, second, waves) in enumerate(((1, 2, 0.7), (2, 0, 0.9), (0, 1, 1.1))):
        moved[..., axis] += 0.03 * np.sin(5 * points[..., first] + 2 * waves * points[..., second])
    return moved


def mild(points: Floats) -> Floats:
    """A function with about one wave a side, well resolved by cubics on the meshes used here."""
    return np.asarray(np.sin(6 * points[..., 0] + 1) * np.cos(8 * points[..., 1]) * np.exp(points[..., 2]))


def rich(points: Floats) -> Floats:
    """A function with about three waves a side."""
    return np.asarray(np.sin(16 * points[..., 0] + 1) * np.cos(18 * points[..., 1]) * np.exp(points[..., 2]))


def trimmed(mesh: Mesh, shape: Shape, cells: int, width: int) -> Mesh:
    """The mesh with a domain of only the first ``width`` cells in x and y."""
    cell = np.arange(cells**3)
    kept = np.flatnonzero((cell % cells < width) & (cell // cells % cells < width))
    count = ELEMENTS_OF_A_CELL[shape]
    chosen = (kept[:, None] * count + np.arange(count)).reshape(-1)
    return replace(mesh, composites=(Composite(0, ((shape.tag, frozen_ints(chosen)),)),), domains={0: (0,)})


def cut(side: int) -> Scene:
    """The cut of the benchmarks, seen straight, in a picture of ``side`` by ``side`` pixels."""
    return Scene(FIELD, plane=CUT, size=(side, side))


def standard(quick: bool) -> Case:
    """The case of the limit: quadratic tetrahedra with a cubic field."""
    size = {"cells": 3} if quick else {"cells": 10, "width": 9}
    return Case("standard", Shape.TETRAHEDRON, degree=2, order=3, field=mild, **size)


def hard(quick: bool) -> Case:
    """Few elements of high order, which linear pieces fail to follow."""
    return Case("hard", Shape.TETRAHEDRON, cells=2 if quick else 5, degree=2, order=7, field=rich)


#: cells that make about 5,000 elements of each shape
CELLS = {Shape.TETRAHEDRON: 9, Shape.PRISM: 14, Shape.PYRAMID: 9, Shape.HEXAHEDRON: 17}


def of_order(shape: Shape, degree: int, order: int, quick: bool) -> Case:
    """About 5,000 elements of one shape with a field of any order."""
    return Case("order", shape, 3 if quick else CELLS[shape], degree, order, mild)


million = partial(Case, "million", Shape.TETRAHEDRON, degree=1, order=3, field=mild)
