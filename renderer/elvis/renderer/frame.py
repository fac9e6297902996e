"""The exact record of a picture, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as default
from enum import IntEnum
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.formats.arrays import Floats, Ints
from elvis.renderer.palette import NOT_A_NUMBER, STEPS, Palette, automatic_range
from elvis.renderer.scene import Scene
from elvis.renderer.view import PlaneView


class Status(IntEnum):
    """What is known of a pixel."""

    MISS = 0
    CERTAIN = 1
    AMBIGUOUS = 2  # its point is within tolerance of an element border
    FAILED = 3  # an element may hold its point, but the search for it did not settle


@dataclass(frozen=True, eq=False)
class Frame:
    """A picture; row 0 is the top.

    field      (h, w)     NaN where nothing is seen
    element    (h, w)     global element ids, -1 where nothing is seen
    reference  (h, w, 3)  reference coordinates in the element, NaN where nothing is seen; None where they were not
                          asked for
    status     (h, w)     see Status
    stats      seconds, bytes and counts by name
    """

    scene: Scene
    view: PlaneView
    field: Floats
    element: Ints
    reference: Floats | None
    status: NDArray[np.uint8]
    stats: dict[str, Any] = default(default_factory=dict)

    @cached_property
    def seen(self) -> NDArray[np.bool_]:
        """(h, w) where an element is seen."""
        return self.element >= 0

    @cached_property
    def position(self) -> Floats:
        """(h, w, 3) world position of what is seen, NaN elsewhere."""
        position = np.full((*self.element.shape, 3), np.nan)
        rows, columns = np.nonzero(self.seen)
        position[rows, columns] = self.view.points_of(columns, rows)
        return position

    @cached_property
    def depth(self) -> Floats:
        """(h, w) distance from the eye's plane along the view, infinite where nothing is seen."""
        return np.where(self.seen, self.view.depth_of(self.position), np.inf)

    @cached_property
    def normal(self) -> Floats:
        """(h, w, 3) unit normal of the surface that is seen, turned to the viewer; NaN elsewhere."""
        return np.where(self.seen[..., None], self.view.normal(), np.nan)

    @cached_property
    def range(self) -> tuple[float, float]:
        """Values at the ends of the colour map."""
        return self.scene.range if isinstance(self.scene.range, tuple) else automatic_range(self.field)

    @cached_property
    def palette(self) -> Palette:
        """The colour map over the picture's range."""
        return Palette.named(self.scene.palette, *self.range)

    @cached_property
    def color(self) -> Floats:
        """(h, w, 3) colours in [0, 1]."""
        return self._colors.take(self._steps, axis=0)

    @cached_property
    def rgb(self) -> NDArray[np.uint8]:
        """(h, w, 3) colours in [0, 255]."""
        return np.rint(255 * self._colors).astype(np.uint8).take(self._steps, axis=0)

    @cached_property
    def _steps(self) -> NDArray[np.uint16]:
        """(h, w) rows of _colors."""
        return np.where(self.seen, self.palette.steps(self.field), np.uint16(STEPS + 1))

    @property
    def _colors(self) -> Floats:
        """(STEPS + 2, 3) the colours of the palette, of what is not a number, of the background."""
        return np.vstack([self.palette.table, NOT_A_NUMBER, self.scene.background])

    def counts(self) -> dict[str, int]:
        """Pixels by status, and those that are seen but are not finite numbers."""
        by_status = {status.name.lower(): int(np.count_nonzero(self.status == status.value)) for status in Status}
        return {**by_status, "not_a_number": int(np.count_nonzero(self.seen & ~np.isfinite(self.field)))}

    def save(self, path: str | Path, *, plain: bool = False) -> None:
        """Write ``.png`` (with colour bar and title unless ``plain``), ``.exr`` or ``.npz``, by the suffix."""
        from elvis.renderer.saving import save

        save(self, Path(path), plain=plain)
