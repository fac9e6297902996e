"""Hits of rays: the records of single surfaces, pixel by pixel, before they are composed to a picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.scene.record.frame import Status


@dataclass(eq=False)
class Hits:
    """Up to one hit for each of n pixels, row by row from the top.

    element    (n,) id in the file, -1 without a hit
    values     name -> (n,), NaN without a hit
    reference  (n, 3) reference coordinates in the element, NaN without a hit
    position   (n, 3) world coordinates, NaN without a hit
    depth      (n,) distance from the eye's plane along the view, infinite without a hit
    normal     (n, 3) unit normal of the surface, facing the viewer, NaN without a hit
    status     (n,)    of `Status`
    uncertainty  (n,) maximum difference of ``depth`` from the true depth, NaN without a hit
    """

    element: Ints
    values: Mapping[str, Floats]
    reference: Floats
    position: Floats
    depth: Floats
    normal: Floats
    status: NDArray[np.uint8]
    uncertainty: Floats

    @staticmethod
    def none(count: int, names: tuple[str, ...]) -> Hits:
        """No hit at any pixel."""

        def nothing(*shape: int) -> Floats:
            return np.full((count, *shape), np.nan)

        values = {name: nothing() for name in names}
        away, miss = np.full(count, np.inf), np.full(count, Status.MISS, np.uint8)
        return Hits(np.full(count, -1), values, nothing(3), nothing(3), away, nothing(3), miss, nothing())

    @property
    def seen(self) -> Bools:
        """(n,) where something is met."""
        return self.element >= 0

    def put(self, pixels: Ints | Bools, other: Hits, rows: Ints | Bools | slice = slice(None)) -> None:
        """Overwrite some pixels by rows of other hits."""
        for name in ("element", "reference", "position", "depth", "normal", "status", "uncertainty"):
            getattr(self, name)[pixels] = getattr(other, name)[rows]
        for name, values in self.values.items():
            values[pixels] = other.values[name][rows]

    def nearer(self, other: Hits) -> Bools:
        """(n,) where the other surface lies before this one."""
        return other.depth < self.depth


def face_eye(normals: Floats, directions: Floats) -> Floats:
    """(n, 3) normals at length 1, turned against the directions (n, 3) of the rays."""
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    facing = np.einsum("ni,ni->n", unit, directions) > 0
    return np.asarray(np.where(facing[:, None], -unit, unit))
