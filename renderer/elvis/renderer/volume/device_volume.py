"""A volume on a device, which all stages share."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import chain
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import EPS, Bools, Floats, Ints, starts_of
from elvis.core.mapping.boxes import Boxes
from elvis.plugins.runtime.volume import Enclosure, LevelSeries, Part, Quantity, Volume
from elvis.renderer.device.device import Device
from elvis.renderer.device.leaf_types import enclosure_of
from elvis.renderer.device.memory import Buffer
from elvis.renderer.raster.pixels import BORDER
from elvis.scene.cameras.fitting import surrounding

T = TypeVar("T")
#: bytes of the series in boxes that stay from one picture to the next
_MOST_OF_BOXES = 1 << 30
#: unit roundings by which a coordinate may be off
_ROUNDINGS = 8


class DeviceVolume:
    """A volume's parts and their buffers.

    first  (parts + 1,) index of each part's first element: elements count through all parts
    ids    (elements + 1,) element ids by index; NOBODY, which is beyond the end, maps to the last one, -1
    extent  maximum finite coordinate of the elements' boxes, in magnitude
    bytes  of all buffers so far: buffers of quantities are added when they are first used
    """

    def __init__(self, device: Device, volume: Volume, before: DeviceVolume | None = None) -> None:
        """Bring a volume to a device; what one that was there ``before`` has too, stays, as for steps of a series."""
        device.include(volume.shader_folder)
        self.device, self.parts, self.dimension = device, list(volume.parts), volume.dimension
        self._levels: dict[tuple[int, str], tuple[str | None, float]] = {}
        self._in_boxes: OrderedDict[tuple[int, str], LevelSeries] = OrderedDict()
        self._brought = {} if before is None or before.device is not device else before._shared_with(self.parts)
        self.bytes = sum(data.nbytes for data, _ in self._brought.values())
        is_same = before is not None and before.device is device and _has_same_elements(before.parts, self.parts)
        self._of_elements: dict[Hashable, Any] = before._of_elements if before is not None and is_same else {}
        self._bounds: dict[tuple[int, str | None], tuple[Floats, Floats]] = {}
        self._ends: dict[str | None, tuple[NDArray[np.float32], Buffer]] = {}
        self.buffers = [self._bring(part.buffers) for part in self.parts]
        self.first = starts_of(self.parts)
        self.ids = np.concatenate([*(part.element_ids for part in self.parts), [-1]])
        self.extent = self.once("extent", lambda: max((greatest_of(part.boxes) for part in self.parts), default=0.0))

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """Results that depend only on elements and maps, computed once for all volumes of the same elements."""
        if key not in self._of_elements:
            self._of_elements[key] = make()
        found: T = self._of_elements[key]
        return found

    def shares_elements(self, other: DeviceVolume) -> bool:
        """Whether what follows from the maps of elements is the very same."""
        return self._of_elements is other._of_elements

    def _shared_with(self, parts: Sequence[Part]) -> dict[int, tuple[NDArray[Any], Buffer]]:
        """Arrays of other parts that are already on the device."""
        owners: Iterable[Part | Quantity] = chain.from_iterable((part, *part.quantities.values()) for part in parts)
        wanted = {id(data) for own in owners for data in own.buffers.values()}
        return {number: brought for number, brought in self._brought.items() if number in wanted}

    @cached_property
    def box(self) -> Floats:
        """(2, 3) low and high corner of a box that holds all elements."""
        return self.once("box", lambda: surrounding([part.boxes for part in self.parts]))

    def owners_of(self, element: Ints) -> tuple[Ints, Bools]:
        """Indices of elements by their ids (n,), and (n,) whether the volume has them."""
        if not len(self._order):
            return np.zeros(len(element), np.int64), np.zeros(len(element), bool)
        place = np.minimum(np.searchsorted(self.ids[:-1], element, sorter=self._order), len(self._order) - 1)
        found = self._order[place]
        return found, self.ids[found] == element

    @cached_property
    def _order(self) -> Ints:
        """(elements,) indices by ascending id."""
        return np.argsort(self.ids[:-1], kind="stable")

    @property
    def rounding(self) -> float:
        """How far coordinates may be off by rounding, in world units."""
        return _ROUNDINGS * EPS * self.extent

    @cached_property
    def is_far(self) -> bool:
        """Whether coordinates are rounded by more than the tolerance of borders, relative to the size of the domain."""
        return bool(self.parts) and bool(self.rounding > BORDER * float(np.ptp(self.box, axis=0).max()))

    def bindings(self, number: int, quantity: str | None = None) -> dict[str, Buffer]:
        """The buffers of a part, or of one of its quantities, by name."""
        own = {} if quantity is None else self._bring(self.parts[number].quantities[quantity].buffers)
        return {**self.buffers[number], **own}

    def quantity(self, number: int, name: str | None) -> Part | Quantity:
        """One of a part's quantities; None is the part itself, for its own field."""
        return self.parts[number].quantity(name)

    def leveled(self, number: int, quantity: str | None, value: float) -> tuple[str | None, float]:
        """A quantity of a part and its value with the same level set, a polynomial's if one is known."""
        part, key = self.parts[number], (number, f"{quantity} at {value!r}")
        own = self.quantity(number, quantity)
        if key not in self._levels:
            self._levels[key] = quantity, value
            if own.level is not None and (found := own.level(value)) is not None:
                condition = found[0].condition
                brought = {key[1]: found[0], **({} if condition is None else {_condition_of(key[1]): condition})}
                self.parts[number] = replace(part, quantities={**part.quantities, **brought})
                self._levels[key] = key[1], found[1]
        return self._levels[key]

    def in_boxes(self, number: int, quantity: str | None, value: float) -> tuple[str, LevelSeries] | None:
        """A quantity in boxes of elements that may have a value, by series, and these; None if none are known."""
        own = self.quantity(number, quantity)
        if own.degree or own.level_boxes is None or enclosure_of(own) is None:
            return None
        key = number, f"{quantity} in boxes at {value!r}"
        if key not in self._in_boxes:
            self._in_boxes[key] = boxes = own.level_boxes(value)
            assert own.enclosure is not None
            enclosure = replace(
                own.enclosure, type=f"Itself<{own.type}>", fields=1, degree=boxes.degree, base_degree=0, in_boxes=True
            )
            self._add_quantity(number, key[1], _as_quantity(own, enclosure))
            self._drop_old_boxes()
        self._in_boxes.move_to_end(key)
        return key[1], self._in_boxes[key]

    def _add_quantity(self, number: int, name: str, own: Quantity) -> None:
        part = self.parts[number]
        self.parts[number] = replace(part, quantities={**part.quantities, name: own})

    def _drop_old_boxes(self) -> None:
        """Give back the boxes that were not drawn for longest while all take more than they may; the last ones stay."""
        while len(self._in_boxes) > 1 and sum(own.nbytes for own in self._in_boxes.values()) > _MOST_OF_BOXES:
            (number, name), _ = self._in_boxes.popitem(last=False)
            part = self.parts[number]
            others = {key: own for key, own in part.quantities.items() if key != name}
            self.parts[number] = replace(part, quantities=others)

    def condition(self, number: int, quantity: str | None) -> str | None:
        """The quantity that is positive where the level of one isn't to be shown; None: it is shown everywhere."""
        name = None if quantity is None else _condition_of(quantity)
        return name if name in self.parts[number].quantities else None

    def bounds(self, number: int, quantity: str | None) -> tuple[Floats, Floats]:
        """Certified minimum and maximum value of each element of a part, (n,) each; infinite where none are known.

        They are asked of the part once: every stage has them from here.
        """
        part = self.parts[number]
        known = self.quantity(number, quantity).bounds
        if (number, quantity) not in self._bounds:
            endless = np.full(len(part), np.inf)
            self._bounds[number, quantity] = (-endless, endless) if known is None else known()
        return self._bounds[number, quantity]

    def ends(self, number: int, quantity: str | None) -> Floats:
        """(n, 2) the bounds of a part's elements, widened by rounding."""
        ends = np.stack(self.bounds(number, quantity), axis=1)
        return np.asarray(ends + 1e-12 * np.abs(ends).max(axis=1, keepdims=True) * [-1.0, 1.0])

    def every(self, quantity: str | None = None) -> tuple[NDArray[np.float32], Buffer]:
        """(n, 2) the ends of all elements by index, in single precision: here and on the device; made once."""
        if quantity not in self._ends:
            ends = _outward(np.concatenate([self.ends(number, quantity) for number in range(len(self.parts))]))
            self._ends[quantity] = ends, self.device.buffer(ends)
            self.bytes += ends.nbytes
        return self._ends[quantity]

    def _bring(self, arrays: Mapping[str, NDArray[Any]]) -> dict[str, Buffer]:
        """Arrays on the device, each once if several parts and quantities share it."""
        for data in arrays.values():
            if id(data) not in self._brought:
                # the array is also stored, so that its id is not reused
                self._brought[id(data)] = data, self.device.buffer(data)
                self.bytes += data.nbytes
        return {name: self._brought[id(data)][1] for name, data in arrays.items()}


def _has_same_elements(some: Sequence[Part], others: Sequence[Part]) -> bool:
    """Whether parts have the very same boxes, which plugins share where all that follows from maps is the same."""
    return len(some) == len(others) and all(a.boxes is b.boxes for a, b in zip(some, others, strict=True))


def _as_quantity(own: Part | Quantity, enclosure: Enclosure) -> Quantity:
    """A part's own field or one of its quantities, made of something else."""
    if isinstance(own, Quantity):
        return replace(own, enclosure=enclosure)
    return Quantity(own.type, own.source, {}, bounds=own.bounds, rounding=own.rounding, enclosure=enclosure)


def _condition_of(quantity: str) -> str:
    """The name of the condition that goes with a quantity."""
    return f"where {quantity} isn't shown"


def _outward(ends: Floats) -> NDArray[np.float32]:
    """Bounds (n, 2), made wider by rounding to single precision."""
    with np.errstate(over="ignore"):
        return np.nextafter(ends.astype(np.float32), np.array([-np.inf, np.inf], np.float32))


def greatest_of(boxes: Boxes) -> float:
    """The largest finite coordinate of boxes (n, 6), in magnitude."""
    return float(np.abs(boxes).max(initial=0.0, where=np.isfinite(boxes)))
