"""Faces of elements in object order: patches of faces are drawn into the tiles of the picture that they reach into."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.mapping.margins import TOLERANCE
from elvis.core.mapping.orientation import chunks
from elvis.plugins.faces import Faces
from elvis.renderer.camera import record_of
from elvis.renderer.device import Buffer, Kernel
from elvis.renderer.device_volume import DeviceVolume
from elvis.renderer.hit_buffer import HitBuffer, arrays_to_write, new_arrays
from elvis.renderer.passes.faces.face_patches import Edges, FacePatches, face_patches
from elvis.renderer.passes.faces.sides import Sides
from elvis.renderer.tiles import TILE, bin_sections
from elvis.scene.conditioning import misplaced
from elvis.scene.frame import Status
from elvis.scene.view import View

#: part of the scene's size within which two hits are at one place
_TIE = 1e-11
#: pixels near edges that are looked at together
_AT_ONCE = 1 << 20
#: what of the hit buffer the device holds
_HELD = ("owner", "side", "status", "field", "reference", "depth", "normal")


class FaceDrawer:
    """The faces of a loaded volume's elements, ready to be seen from anywhere."""

    def __init__(self, loaded: DeviceVolume, faces: Faces) -> None:
        self.loaded, self.faces = loaded, faces
        self._chosen: tuple[tuple[str, ...] | Bools, list[tuple[Ints, Floats, Sides]]] = (), []
        self._seen: tuple[object, list[tuple[FacePatches, Edges]]] = None, []

    def draw(
        self, view: View, select: Sequence[str] = ("all",), beyond: Floats | None = None, quantity: str | None = None
    ) -> HitBuffer:
        """What is nearest on the faces that ``select`` names (see Faces.select), beyond depths (n,) where given.

        quantity  one of the parts' quantities, None for their own field
        Where hits are at one place, the one farther than the tolerance from the border of its face counts, then that of
        the element with the lowest number.
        """
        device = self.loaded.device
        after = np.zeros(1) if beyond is None else np.ascontiguousarray(beyond, np.float64)
        held: dict[str, Buffer] = {}
        for number, kernel, buffers, work in self._work("face_draw", view, select, quantity, beyond is not None):
            if not held:
                held = new_arrays(device, view.count, _HELD)
                image = {**arrays_to_write(device, held), "after": device.buffer(after)}
            every = {**self.loaded.bindings(number, quantity), **buffers, **image}
            kernel(len(work), every, groups=True, work=work)
        hits = HitBuffer.on_device(device, held) if held else HitBuffer.empty(view.count)
        for _, edges in self._patches(view, select):
            _mark(view, hits, edges, np.broadcast_to(after, view.count))
        return hits

    def hits(
        self, view: View, select: Sequence[str] | Bools = ("all",), rows: tuple[int, int] | None = None
    ) -> NDArray[Any]:
        """All hits on the faces that ``select`` names, for the pixels of some rows of a picture: by pixel and depth.

        select  as words; or (elements,) whether all faces of an element count, by its index
        rows    the first row and the one after the last, all by default
        The records are those of face_list.slang.  A face appears as often as a ray meets it.  A ray within the
        tolerance of an edge may meet the faces on both sides of it, at one depth.
        """
        found = [np.empty(0, self.loaded.device.kernel("face_list", self.loaded.parts[0]).dtype("hits"))]
        for number, kernel, buffers, work in self._work("face_list", view, select, None, rows=rows):
            run = partial(_run, kernel, work, {**self.loaded.bindings(number), **buffers})
            found.append(self.loaded.device.appended("hits", kernel, run))
        every = np.concatenate(found, dtype=found[0].dtype)

        # patches of a face share their borders
        every = every[np.lexsort((every["depth"], every["face"], every["pixel"]))]
        same = (np.diff(every["face"].astype(np.int64)) == 0) & (np.diff(every["pixel"].astype(np.int64)) == 0)
        every = every[~np.append(False, same & (np.diff(every["depth"]) <= self._tie(view)))[: len(every)]]
        every = every[np.lexsort((every["element"], every["depth"], every["pixel"]))]
        first, last = (0, view.height) if rows is None else rows
        held: NDArray[Any] = every[(every["pixel"] >= first * view.width) & (every["pixel"] < last * view.width)]
        return held

    def visible_patches(
        self, view: View, chosen: Bools, number: int, kernel: Kernel
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """FacePatch records of chosen elements of a part, one element's together, near ones first; and a FaceView.

        chosen  (elements,) by index
        """
        patches = self._parts(view, chosen, number, kernel.dtype("patches"))
        near = np.full(len(self.loaded.parts[number]), np.inf)
        np.minimum.at(near, patches["element"], patches["near"])
        rank = np.argsort(np.argsort(near, kind="stable"))
        return patches[np.argsort(rank[patches["element"]], kind="stable")], self._record(kernel, view)

    def _parts(self, view: View, select: Sequence[str] | Bools, number: int, dtype: np.dtype[Any]) -> NDArray[Any]:
        """Records of all patches of a part that are seen."""
        every = self._patches(view, select)
        own = [k for k, block in enumerate(self.faces.blocks) if block.part == number]
        return np.concatenate([np.empty(0, dtype), *(self._records(k, every[k][0], dtype) for k in own)], dtype=dtype)

    def _tie(self, view: View) -> float:
        """Difference of depth up to which two hits are at one place."""
        return _TIE * (self.loaded.extent + float(np.abs(view.camera.eye).max()))

    def _work(
        self,
        stage: str,
        view: View,
        select: Sequence[str] | Bools,
        quantity: str | None,
        has_beyond: bool | None = None,
        rows: tuple[int, int] | None = None,
    ) -> Iterator[tuple[int, Kernel, dict[str, Buffer], Ints]]:
        """For each part that is seen its number, a kernel, buffers that say what is where, and patches in each tile.

        The first one has all tiles of the picture, unless they are only listed (``layered`` None).
        """
        every, device, fresh = self._patches(view, select), self.loaded.device, has_beyond is not None
        for number, part in enumerate(self.loaded.parts):
            if not any(
                len(some.face)
                for block, (some, _) in zip(self.faces.blocks, every, strict=True)
                if block.part == number
            ):
                continue
            kernel = device.kernel(stage, part, quantity)
            patches = self._parts(view, select, number, kernel.dtype("patches"))
            patches = patches[np.argsort(patches["near"], kind="stable")]
            size = (view.width, view.height) if fresh else None
            tiles, listed = bin_sections(patches["least"], patches["most"], kernel.dtype("tiles"), size)
            if rows is not None:
                tiles = tiles[(tiles["y"] + TILE > rows[0]) & (tiles["y"] < rows[1])]
            place = {"first": self.loaded.first[number], "count": len(tiles)}
            record = self._record(kernel, view, **place, fresh=fresh, has_beyond=bool(has_beyond))
            data = {"patches": patches, "listed": listed, "tiles": tiles, "view": record}
            counts = (tiles["end"] - tiles["first"]).astype(np.int64)
            yield number, kernel, {name: device.buffer(some) for name, some in data.items()}, counts
            fresh = False

    def _patches(self, view: View, select: Sequence[str] | Bools) -> list[tuple[FacePatches, Edges]]:
        """For each block of faces what the view sees of the chosen ones; the last answer is kept."""
        words = select if isinstance(select, np.ndarray) else tuple(select)
        # what is interrupted leaves the last answers as they were
        if not _same(self._chosen[0], words):
            first, blocks = self.loaded.first, self.faces.blocks
            rows = (
                self.faces.select(words)
                if isinstance(words, tuple)
                else [np.flatnonzero(words[first[block.part] + block.element]) for block in blocks]
            )
            chosen = []
            for block, own in zip(self.faces.blocks, rows, strict=True):
                nets = block.nets(own)
                sides = Sides.of(block.space, block.entity[own], nets)
                chosen.append((own, nets[sides.alone], sides))
            self._chosen = words, chosen
        if self._seen[0] != (key := (view, words if isinstance(words, tuple) else id(words))):
            found = []
            for block, (_, nets, sides) in zip(self.faces.blocks, self._chosen[1], strict=True):
                patches, edges = face_patches(block.space, nets, view)
                found.append((sides.both(patches), edges))
            self._seen = key, found
        return self._seen[1]

    def _records(self, number: int, patches: FacePatches, dtype: np.dtype[Any]) -> NDArray[Any]:
        """FacePatch records (face.slang) of a block's patches."""
        block, rows = self.faces.blocks[number], self._chosen[1][number][0][patches.face]
        record = np.zeros(len(rows), dtype)
        record["element"], record["square"] = block.element[rows], len(block.space.halves) == 2
        record["face"] = sum(map(len, self.faces.blocks[:number])) + rows
        record["least"], record["most"], record["near"] = *patches.bounds, patches.near
        record["noise"] = patches.noise
        # a margin changes by no more than the coordinates of the face
        record["border_width"] = TOLERANCE + 2.0 * patches.noise * np.abs(patches.place[:, 1:]).sum(axis=1).max(axis=1)
        record["origin"], record["along"], record["across"] = patches.place.transpose(1, 0, 2)
        frames = block.frames[block.local[rows]]
        own = patches.place @ frames[:, 1:]
        record["start"], record["first"], record["second"] = frames[:, 0] + own[:, 0], own[:, 1], own[:, 2]
        return record

    def _record(self, kernel: Kernel, view: View, **values: Any) -> NDArray[Any]:
        """The FaceView record (face.slang)."""
        uncertain = {"tie": self._tie(view), "misplaced": misplaced(view, self.loaded.extent)}
        return record_of(kernel, "view", view, **uncertain, **values)


def _same(one: tuple[str, ...] | Bools, other: tuple[str, ...] | Bools) -> bool:
    """Whether two ways to choose faces are one: the same words, or the very same array."""
    return one is other or (isinstance(one, tuple) and isinstance(other, tuple) and one == other)


def _run(kernel: Kernel, work: Ints, buffers: dict[str, Buffer], lists: dict[str, Buffer]) -> None:
    kernel(len(work), {**buffers, **lists}, groups=True, work=work)


def _mark(view: View, hits: HitBuffer, edges: Edges, after: Floats) -> None:
    """What lies on an edge before all else is seen or not: such pixels are ambiguous."""
    # steps of one pixel along the longer direction of each edge, within the picture
    steep = np.abs(edges.ends[1, :, 1] - edges.ends[0, :, 1]) > np.abs(edges.ends[1, :, 0] - edges.ends[0, :, 0])
    (x0, y0), (x1, y1) = np.moveaxis(np.where(steep[:, None], edges.ends[..., ::-1], edges.ends), -1, 1)
    first, last = np.ceil(np.minimum(x0, x1) - edges.radius), np.floor(np.maximum(x0, x1) + edges.radius)
    end = np.where(steep, view.height, view.width) - 1
    edge, x = _runs(first.clip(0, None), np.minimum(last, end))

    # there all pixels whose centres are near it
    slope = np.divide(y1 - y0, x1 - x0, out=np.zeros_like(x0), where=x1 != x0)
    y, end = y0[edge] + slope[edge] * (x - x0[edge]), np.where(steep, view.width, view.height)[edge] - 1
    first, last = np.ceil(y - edges.radius[edge]).clip(0, None), np.minimum(np.floor(y + edges.radius[edge]), end)
    for some in chunks(len(edge), max(1, _AT_ONCE // max(view.width, view.height))):
        step, across = _runs(first[some], last[some])
        along, own = x[some][step], edge[some][step]
        column, row = np.where(steep[own], [across, along], [along, across]).astype(np.int64)
        pixel = row * view.width + column
        near, far = edges.depth[:, own]
        before = (near <= hits.depth[pixel]) & (far >= after[pixel]) & (hits.status[pixel] != Status.FAILED)
        hits.status[pixel[before]] = Status.AMBIGUOUS


def _runs(first: Floats, last: Floats) -> tuple[Ints, Floats]:
    """All whole numbers from first to last (n,), ends included: (m,) which of the ranges, and (m,) the number."""
    counts = np.maximum(last - first + 1, 0).astype(np.int64)
    which = np.repeat(np.arange(len(counts)), counts)
    return which, first[which] + np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
