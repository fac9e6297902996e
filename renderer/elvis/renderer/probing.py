"""Point location on the device: which elements hold given points, and the field there (shaders/locate.slang)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elvis.formats.arrays import Floats, Ints
from elvis.formats.mapping.boxes import BoxTree
from elvis.plugins.volume import Volume
from elvis.renderer.cut import BORDER, INSIDE, NOBODY, UNKNOWN
from elvis.renderer.device import Device, Kernel
from elvis.renderer.errors import SceneError
from elvis.renderer.frame import Status

if TYPE_CHECKING:
    import slangpy


@dataclass(frozen=True, eq=False)
class Places:
    """Where n points are; of several elements that hold a point, the one with the greatest margin, then the first.

    owner      (n,)    running element number (see Loaded), NOBODY where no element holds the point
    element    (n,)    global id, -1 where no element holds the point
    reference  (n, 3)  reference coordinates, NaN outside
    field      (n,)    NaN outside
    status     (n,)    see Status; FAILED where an element may hold the point but its map did not invert
    """

    owner: NDArray[np.uint32]
    element: Ints
    reference: Floats
    field: Floats
    status: NDArray[np.uint8]

    @staticmethod
    def none(count: int) -> Places:
        """So many places outside."""
        nan, status = np.full(count, np.nan), np.zeros(count, np.uint8)
        return Places(np.full(count, NOBODY, np.uint32), np.full(count, -1), np.tile(nan[:, None], 3), nan, status)

    def put(self, rows: Ints, others: Places) -> None:
        """Set some rows (n,) to n other places."""
        for name, values in vars(self).items():
            values[rows] = getattr(others, name)


class Finder:
    """A volume on a device, with a bounding volume hierarchy for each part."""

    def __init__(self, device: Device, volume: Volume, buffers: Sequence[Mapping[str, slangpy.Buffer]]) -> None:
        """``buffers`` hold the data of the volume's parts on the device."""
        if not sum(map(len, volume.parts)):
            raise SceneError("there is no element to look in: none carries the field")
        device.include(volume.shader_folder)
        self._device, self._parts = device, volume.parts
        self._kernels = [device.kernel("locate", part) for part in self._parts]
        self._trees = [BoxTree.build(part.boxes) for part in self._parts]
        self._buffers = [{**held, **self._upload(tree)} for held, tree in zip(buffers, self._trees, strict=True)]
        self._first = np.cumsum([0, *map(len, self._parts)])

    def find(self, points: Floats) -> Places:
        """Places of world points (n, 3)."""
        shared = {"points": self._device.buffer(np.asarray(points, dtype=np.float64))}
        start = np.zeros(len(points), self._kernels[0].dtype("places"))
        start["element"] = NOBODY
        shared["places"] = self._device.buffer(start)

        # every part improves on the places that those before it found
        doubts = []
        for number, kernel in enumerate(self._kernels):
            shared["query"] = self._query(number, kernel, len(points))
            buffers = {**self._buffers[number], **shared}
            doubts.append(self._device.listed("doubts", kernel, partial(_run, kernel, len(points), buffers)))
        found = self._device.read(shared["places"], start.dtype)[: len(points)]
        doubts = [
            np.concatenate([some, self._missed(number, points, found, some.dtype)])
            for number, some in enumerate(doubts)
        ]
        failed = [self._decide(number, some, points, found) for number, some in enumerate(doubts)]
        return _places(found, np.concatenate([part.element_ids for part in self._parts]), np.concatenate(failed))

    def _missed(self, number: int, points: Floats, found: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
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

    def _decide(self, number: int, doubts: NDArray[Any], points: Floats, found: NDArray[Any]) -> Ints:
        """Let the plugin answer what the kernel left open, and improve ``found``; returns the points still open."""
        part, point = self._parts[number], doubts["point"].astype(np.int64)
        if part.solve is None or not len(doubts):
            return point
        solution = part.solve(doubts["element"].astype(np.int64), points[point])
        margin = np.maximum(solution.margin, BORDER)
        better = (solution.verdict == INSIDE) & (
            (found["element"][point] == NOBODY) | (margin > found["margin"][point])
        )
        best = np.flatnonzero(better)[np.argsort(margin[better])]
        there = point[best]
        found["element"][there] = self._first[number] + doubts["element"][best]
        for name, values in (("margin", margin), ("reference", solution.reference), ("field", solution.field)):
            found[name][there] = values[best]
        undecided: Ints = point[solution.verdict == UNKNOWN]
        return undecided

    def _upload(self, tree: BoxTree) -> dict[str, slangpy.Buffer]:
        return {"nodes": self._device.buffer(tree.nodes), "order": self._device.buffer(tree.order)}

    def _query(self, number: int, kernel: Kernel, points: int) -> slangpy.Buffer:
        tree, record = self._trees[number], np.zeros(1, kernel.dtype("query"))
        record["points"], record["elements"], record["first"] = points, len(tree.order), self._first[number]
        record["leaves"], record["leaf_size"] = (len(tree.nodes) + 1) // 2, tree.leaf
        return self._device.buffer(record)


def _run(kernel: Kernel, count: int, buffers: dict[str, slangpy.Buffer], lists: dict[str, slangpy.Buffer]) -> None:
    kernel(count, {**buffers, **lists})


def _places(found: NDArray[Any], ids: Ints, failed: Ints) -> Places:
    """Running element numbers become global ids; ``failed`` lists points that some element may hold."""
    outside = found["element"] == NOBODY
    element = np.where(outside, -1, ids[np.where(outside, 0, found["element"])])
    status = np.where(outside, Status.MISS, Status.CERTAIN)
    status[~outside & (found["margin"] <= BORDER)] = Status.AMBIGUOUS
    status[failed[outside[failed]]] = Status.FAILED
    reference = np.where(outside[:, None], np.nan, found["reference"])
    field = np.where(outside, np.nan, found["field"])
    return Places(found["element"].copy(), element, reference, field, status.astype(np.uint8))
