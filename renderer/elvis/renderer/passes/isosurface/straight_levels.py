"""Levels of straight tetrahedra: data that do not depend on the view, computed once and cached for recent levels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.renderer.device.memory import Buffer
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.renderer.volume.traversal import Traversal

#: levels of parts that are retained
_MOST = 16


@dataclass(frozen=True, eq=False)
class StraightLevel:
    """Data of a level of straight tetrahedra for every view.

    wanted           (n,) elements of the part that may have the value
    flat, undefined  numbers of skipped elements, see IsosurfaceDrawer
    buffers          errors and maximum changes of the field, and of the condition that hides it
    """

    wanted: Bools
    flat: int
    undefined: int
    buffers: dict[str, Buffer]


class StraightLevels:
    """The levels of a volume's parts that were requested last."""

    def __init__(self, loaded: DeviceVolume, traversal: Traversal) -> None:
        self._loaded, self._traversal = loaded, traversal
        self._known: dict[tuple[int, str | None, float], StraightLevel] = {}

    def of(self, number: int, quantity: str | None, value: float) -> StraightLevel:
        """A level of a quantity of a part."""
        key = number, quantity, value
        found = self._known.pop(key, None) or self._find(*key)
        self._known[key] = found
        while len(self._known) > _MOST:
            del self._known[next(iter(self._known))]
        return found

    def _find(self, number: int, quantity: str | None, value: float) -> StraightLevel:
        traversal, device = self._traversal, self._loaded.device
        flat = traversal.flat(number, quantity, value)
        undefined = np.isnan(self._loaded.bounds(number, quantity)[0])
        arrays = {
            "errors": np.where(flat, np.inf, traversal.rounding(number, quantity, value)),
            "steepest": traversal.steepest(number, quantity, value),
            **self._condition(number, quantity),
        }
        buffers = {name: device.buffer(array) for name, array in arrays.items()}
        buffers |= traversal.lines(traversal.degree(number, quantity))
        wanted = traversal.holding(number, quantity, value) & ~undefined
        return StraightLevel(wanted, int(flat.sum()), int(undefined.sum()), buffers)

    def _condition(self, number: int, quantity: str | None) -> dict[str, Floats]:
        """Accuracy of the condition that hides the level: its errors, and its maximum change."""
        condition = self._loaded.condition(number, quantity)
        if condition is None:
            return {"condition_errors": np.zeros(1), "condition_steepest": np.zeros(1)}
        errors = self._traversal.rounding(number, condition, 0.0)
        return {"condition_errors": errors, "condition_steepest": self._traversal.steepest(number, condition, 0.0)}
