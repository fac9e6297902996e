"""What one surface shows, pixel by pixel: what every stage that finds surfaces hands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elvis.formats.arrays import Bools, Floats
from elvis.renderer.pixels import NOBODY, Pixels
from elvis.renderer.view import PlaneView


@dataclass
class Layer:
    """One hit at most for each of n pixels, row by row from the top; of a stack, the k-th nearest one.

    owner      (n,)    running element number (see Loaded), NOBODY where nothing is hit
    field      (n,)    the object's quantity there, NaN where nothing is hit
    reference  (n, 3)  reference coordinates in the element, NaN where nothing is hit
    depth      (n,)    distance from the eye's plane along the view (see View.rays), infinite where nothing is hit
    normal     (n, 3)  unit normal of the surface, turned to the viewer, NaN where nothing is hit
    status     (n,)    see frame.Status
    """

    owner: NDArray[np.uint32]
    field: Floats
    reference: Floats
    depth: Floats
    normal: Floats
    status: NDArray[np.uint8]

    @staticmethod
    def empty(count: int) -> Layer:
        """A layer without hits."""
        vectors = np.full((2, count, 3), np.nan)
        owner, status = np.full(count, NOBODY, np.uint32), np.zeros(count, np.uint8)
        return Layer(owner, np.full(count, np.nan), vectors[0], np.full(count, np.inf), vectors[1], status)

    def without(self, gone: Bools) -> Layer:
        """The layer without its hits in the pixels ``gone`` (n,)."""
        wide = gone[:, None]
        return Layer(
            np.where(gone, np.uint32(NOBODY), self.owner),
            np.where(gone, np.nan, self.field),
            np.where(wide, np.nan, self.reference),
            np.where(gone, np.inf, self.depth),
            np.where(wide, np.nan, self.normal),
            np.where(gone, np.uint8(0), self.status),
        )

    @staticmethod
    def of_cut(view: PlaneView, pixels: Pixels) -> Layer:
        """The pixels of a plane cut, drawn with reference coordinates."""
        assert pixels.reference is not None
        hit = np.isfinite(pixels.reference[:, 0])
        normal = np.where(hit[:, None], view.normal(), np.nan)
        return Layer(
            pixels.owner, pixels.field, pixels.reference, np.where(hit, view.depths(), np.inf), normal, pixels.status
        )
