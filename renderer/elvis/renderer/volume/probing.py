"""Point location on the device: which elements hold given points, and the field there (locate.slang)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, Ints, Records
from elvis.core.mapping.boxes import BoxTree
from elvis.renderer.device.device import Kernel
from elvis.renderer.device.memory import Buffer
from elvis.renderer.raster.pixels import BORDER, INSIDE, NOBODY, UNKNOWN
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.model.errors import SceneError
from elvis.scene.record.frame import Status


@dataclass(frozen=True, eq=False)
class Places:
    """Locations of n points; if several elements contain a point, the one with the largest margin, then the first.

    owner      (n,)    index of the element (see DeviceVolume), NOBODY if no element contains the point
    element    (n,)    element id, -1 if no element contains the point
    reference  (n, 3)  reference coordinates, NaN outside
    field      (n,)    NaN outside
    status     (n,)    see Status; FAILED if an element may contain the point but its map could not be inverted
    """

    owner: NDArray[np.uint32]
    element: Ints
    reference: Floats
    field: Floats
    status: NDArray[np.uint8]

    @staticmethod
    def none(count: int) -> Places:
        """Locations of ``count`` points outside."""
        nan, status = np.full(count, np.nan), np.zeros(count, np.uint8)
        return Places(np.full(count, NOBODY, np.uint32), np.full(count, -1), np.tile(nan[:, None], 3), nan, status)

    def put(self, rows: Ints, others: Places) -> None:
        """Set some rows (n,) to n other places."""
        for name, values in vars(self).items():
            values[rows] = getattr(others, name)


class Finder:
    """A loaded volume, with a bounding volume hierarchy for each part."""

    def __init__(self, loaded: DeviceVolume) -> None:
        if not loaded.first[-1]:
            raise SceneError("no element to search: none has the field")
        self._loaded, self._parts, self._first = loaded, loaded.parts, loaded.first
        self._kernels = [loaded.device.kernel("locate", part) for part in self._parts]
        self._trees = loaded.once("trees", lambda: [BoxTree.build(part.boxes) for part in self._parts])
        self._buffers = loaded.once("trees on the device", lambda: [self._upload(tree) for tree in self._trees])

    def find(self, points: Floats) -> Places:
        """Locations of world points (n, 3); points that rounding may have put outside of all elements are ambiguous."""
        places = self._find(points)
        missed = np.flatnonzero(places.status == Status.MISS)
        if self._loaded.is_far and len(missed):
            near = np.zeros(len(missed), bool)
            for corner in product((-1.0, 1.0), repeat=self._loaded.dimension):
                step = np.append(corner, np.zeros(3 - len(corner))) * self._loaded.rounding
                near |= self._find(np.asarray(points, np.float64)[missed] + step).element >= 0
            places.status[missed[near]] = Status.AMBIGUOUS
        return places

    def _find(self, points: Floats) -> Places:
        """Places of world points (n, 3) as coordinates are rounded."""
        device, count = self._loaded.device, len(points)
        start = np.zeros(count, self._kernels[0].dtype("places"))
        start["element"] = NOBODY
        shared = {"points": device.buffer(np.asarray(points, np.float64)), "places": device.buffer(start)}

        # every part improves on the places that those before it found
        doubts = []
        for number, kernel in enumerate(self._kernels):
            buffers = {**self._loaded.bindings(number), **self._buffers[number], **shared}
            buffers["query"] = self._query(number, kernel, count)
            run = partial(_run, kernel, count, buffers)
            doubts.append(device.appended("doubts", kernel, run))
        found = device.read(shared["places"], start.dtype)[:count]
        doubts = [
            np.concatenate([some, self._missed(number, points, found, some.dtype)])
            for number, some in enumerate(doubts)
        ]
        failed = [self._decide(number, some, points, found) for number, some in enumerate(doubts)]
        return _places(found, self._loaded.ids, np.concatenate(failed))

    def _missed(self, number: int, points: Floats, found: Records, dtype: np.dtype[Any]) -> Records:
        """Doubts about points that nothing was found for, in elements of a part that bend strongly (see gaps)."""
        part, lost = self._parts[number], np.flatnonzero(found["element"] == NOBODY)
        if part.bends is None or part.solve is None or not len(lost):
            return np.empty(0, dtype)
        point, element = self._trees[number].candidates(points[lost])
        near, place = np.unique(element, return_inverse=True)
        bent = part.bends(near)[place]
        doubts = np.zeros(int(bent.sum()), dtype)
        doubts["point"], doubts["element"] = lost[point[bent]], element[bent]
        return doubts

    def _decide(self, number: int, doubts: Records, points: Floats, found: Records) -> Ints:
        """Let the plugin answer what the kernel left open, and improve ``found``; returns the points still open."""
        part = self._parts[number]
        point: Ints = doubts["point"].astype(np.int64)
        if part.solve is None or not len(doubts):
            return point
        solution = part.solve(doubts["element"].astype(np.int64), points[point])
        margin = np.maximum(solution.margin, BORDER)
        better = (solution.status == INSIDE) & ((found["element"][point] == NOBODY) | (margin > found["margin"][point]))
        best = np.flatnonzero(better)[np.argsort(margin[better])]
        there = point[best]
        found["element"][there] = self._first[number] + doubts["element"][best]
        for name, values in (("margin", margin), ("reference", solution.reference), ("field", solution.field)):
            found[name][there] = values[best]
        undecided: Ints = point[solution.status == UNKNOWN]
        return undecided

    def _upload(self, tree: BoxTree) -> dict[str, Buffer]:
        arrays = {"nodes": tree.nodes, "order": tree.order, "boxes": tree.boxes[tree.order]}
        return {name: self._loaded.device.buffer(data) for name, data in arrays.items()}

    def _query(self, number: int, kernel: Kernel, points: int) -> Buffer:
        tree, record = self._trees[number], np.zeros(1, kernel.dtype("query"))
        record["points"], record["elements"], record["first"] = points, len(tree.order), self._first[number]
        record["leaves"], record["leaf_size"] = (len(tree.nodes) + 1) // 2, tree.leaf
        return self._loaded.device.buffer(record)


def _run(kernel: Kernel, count: int, buffers: dict[str, Buffer], lists: dict[str, Buffer]) -> None:
    kernel(count, {**buffers, **lists})


def _places(found: Records, ids: Ints, failed: Ints) -> Places:
    """Indices of elements become element ids; ``failed`` lists points that some element may hold."""
    outside, element = found["element"] == NOBODY, ids.take(found["element"], mode="clip")
    status = np.where(outside, Status.MISS, np.where(found["margin"] <= BORDER, Status.AMBIGUOUS, Status.CERTAIN))
    status[failed[outside[failed]]] = Status.FAILED
    reference = np.where(outside[:, None], np.nan, found["reference"])
    field = np.where(outside, np.nan, found["field"])
    return Places(found["element"].copy(), element, reference, field, status.astype(np.uint8))
