"""Faces of elements in object order: patches of faces are drawn into the tiles of the picture that they reach into."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints, Records
from elvis.core.mapping.margins import TOLERANCE
from elvis.core.mapping.orientation import chunks
from elvis.core.shapes import Shape
from elvis.plugins.faces import FaceBlock, Faces
from elvis.renderer.device.device import Given, Kernel
from elvis.renderer.device.drafts import is_draft
from elvis.renderer.device.memory import Buffer
from elvis.renderer.passes.faces.face_patches import Edges, FacePatches, face_patches
from elvis.renderer.passes.faces.sides import Sides
from elvis.renderer.raster.ball_bounds import is_in_picture
from elvis.renderer.raster.camera import record_of
from elvis.renderer.raster.hit_buffer import HitBuffer, arrays_to_write, new_arrays
from elvis.renderer.raster.tiles import TILE, bin_sections
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View
from elvis.scene.record.conditioning import misplaced
from elvis.scene.record.frame import Status

#: part of the scene's size within which two hits are at one place
_TIE = 1e-11
#: length of a step after which Newton's method ends, in coordinates of a patch: the remaining error is of the order of
#: its square, below rounding for the point; in drafts, a millionth of a pixel
CLOSE = 1e-10
CLOSE_IN_DRAFTS = 1e-4
#: number of pixels near edges that are processed together
_AT_ONCE = 1 << 20
#: half the side of a pixel's square
_SQUARE = 0.5
#: what of the hit buffer the device holds
_HELD = ("owner", "side", "status", "field", "reference", "depth", "normal")


@dataclass(frozen=True, eq=False)
class _ChosenFaces:
    """Faces of one block that are drawn.

    rows   (n,)           rows of the block
    nets   (m, count, 4)  of the representative faces (see Sides.alone)
    sides  the pairs among them
    """

    rows: Ints
    nets: Floats
    sides: Sides


@dataclass(frozen=True, eq=False)
class _PartTiles:
    """Work of one part: a kernel with its buffers, and (t,) the number of patches in each tile."""

    number: int
    kernel: Kernel
    buffers: dict[str, Buffer]
    counts: Ints

    def run(self, output: Given) -> None:
        """Run the kernel, a group for each tile."""
        self.kernel(len(self.counts), {**self.buffers, **output}, groups=True, work=self.counts)


@dataclass(frozen=True, eq=False)
class SquarePatches:
    """Patches of faces of one part and shape that may reach into the squares of pixels.

    records  (n,) FacePatch (face.slang)
    edges    faces seen as points and lines
    """

    number: int
    shape: Shape
    records: Records
    edges: Edges


@dataclass
class FacesInView:
    """The faces that were drawn last, for each block, and what the view saw of them.

    choice  how they were chosen
    view    the whole picture that ``in_view`` belongs to; None while it belongs to another choice
    window  of that picture, which ``tiled`` belongs to
    tiled   patches, tiles and what these list, by part, whether the tiles are all of the window, and layout of patches
    """

    choice: tuple[str, ...] | Bools = ()
    chosen: list[_ChosenFaces] = field(default_factory=list)
    view: View | None = None
    window: View | None = None
    in_view: list[tuple[FacePatches, Edges]] = field(default_factory=list)
    tiled: dict[tuple[int, bool, np.dtype[Any]], tuple[Records, Records, NDArray[np.uint32]]] = field(
        default_factory=dict
    )


class FaceDrawer:
    """The faces of a loaded volume's elements, ready to be seen from anywhere."""

    def __init__(self, loaded: DeviceVolume, faces: Faces, last: FacesInView | None = None) -> None:
        """For a volume and its faces; ``last`` is what another drawer of the very same faces knows."""
        self.loaded = loaded
        self.faces = faces
        self._last = last or FacesInView()

    def draw(
        self, view: View, select: Sequence[str] = ("all",), beyond: Floats | None = None, quantity: str | None = None
    ) -> HitBuffer:
        """Nearest hits on the faces that ``select`` names (see Faces.select), beyond depths (n,) if given.

        quantity  one of the parts' quantities, None for their own field
        If hits coincide, the one farther than the tolerance from the border of its face counts, then the hit of the
        element with the lowest number.
        """
        device = self.loaded.device
        after = np.zeros(1) if beyond is None else np.ascontiguousarray(beyond, np.float64)

        # all parts draw into one picture; there is none where nothing is seen
        arrays: dict[str, Buffer] = {}
        for part in self._tiles("face_draw", view, select, quantity, beyond is not None):
            if not arrays:
                arrays = new_arrays(device, view.count, _HELD)
                image = {**arrays_to_write(device, arrays, view.count), "after": device.buffer(after)}
            part.run(image)
        hits = HitBuffer.on_device(device, arrays) if arrays else HitBuffer.empty(view.count)
        hits.near_squares = partial(self.near_squares, view, tuple(select)) if beyond is None else None

        for _, edges in self._patches(view, select):
            if len(edges.radius):
                _mark_edges(view, hits, edges, np.broadcast_to(after, view.count))
        return hits

    def hits(
        self, view: View, select: Sequence[str] | Bools = ("all",), rows: tuple[int, int] | None = None
    ) -> Records:
        """All hits on the faces that ``select`` names, for the pixels of some rows of a picture: by pixel and depth.

        select  as words; or (elements,) whether all faces of an element count, by its index
        rows    the first row and the one after the last, all by default
        The records are those of face_list.slang.  A face appears once for each time that a ray meets it.  A ray within
        the tolerance of an edge may meet the faces on both sides of it, at one depth.
        """
        device = self.loaded.device
        dtype = device.kernel("face_list", self.loaded.parts[0]).dtype("hits")
        found = [np.empty(0, dtype)]
        for part in self._tiles("face_list", view, select, None, rows=rows):
            found.append(device.appended("hits", part.kernel, part.run))
        hits = _without_repeats(np.concatenate(found, dtype=dtype), self._tie(view))

        # tiles reach beyond the rows
        if rows is None:
            return hits
        row = view.places(hits["pixel"])[1]
        wanted: Records = hits[(row >= rows[0]) & (row < rows[1])]
        return wanted

    def near_squares(self, view: View, select: Sequence[str]) -> Iterator[SquarePatches]:
        """Patches of the faces that ``select`` names in the squares of pixels; one of two sides of a face."""
        for index, (block, rows) in enumerate(zip(self.faces.blocks, self._chosen_rows(tuple(select)), strict=True)):
            own = _choose(block, rows)
            patches, edges = face_patches(block.space, own.nets, view.whole, _SQUARE)
            patches = own.sides.both(patches.within(view))

            # at one place the element with the lowest number is shown
            pair = np.stack([own.sides.alone[own.sides.first], own.sides.other])
            element = block.element[rows[pair]]
            hidden = np.where(element[0] < element[1], pair[1], pair[0])
            patches = patches.some(np.flatnonzero(~np.isin(patches.face, hidden)))

            kernel = self.loaded.device.kernel("face_draw", self.loaded.parts[block.part])
            records = self._patch_records(index, rows, patches, kernel.dtype("patches"))
            yield SquarePatches(block.part, block.space.shape, records, edges)

    def visible_patches(self, view: View, chosen: Bools, number: int, kernel: Kernel) -> tuple[Records, Records]:
        """FacePatch records of chosen elements of a part, one element's together, near ones first; and a FaceView.

        chosen  (elements,) by index
        """
        patches = self._part_patches(view, chosen, number, kernel.dtype("patches"))
        element = patches["element"]
        near = np.full(len(self.loaded.parts[number]), np.inf)
        np.minimum.at(near, element, patches["near"])

        # the rank of an element is its place among all, from near to far
        rank = np.argsort(np.argsort(near, kind="stable"))
        order = np.argsort(rank[element], kind="stable")
        patches = patches[order]
        is_seen = is_in_picture(view, patches["least"], patches["most"])
        return patches[is_seen], self._view_record(kernel, view, close=CLOSE)

    def _part_patches(self, view: View, select: Sequence[str] | Bools, number: int, dtype: np.dtype[Any]) -> Records:
        """Records of all patches of a part that are seen."""
        in_view = self._patches(view, select)
        found = [np.empty(0, dtype)]
        for index, block in enumerate(self.faces.blocks):
            if block.part == number:
                patches, _ = in_view[index]
                found.append(self._patch_records(index, self._last.chosen[index].rows, patches, dtype))
        return np.concatenate(found, dtype=dtype)

    def _tie(self, view: View) -> float:
        """Difference of depth up to which two hits are at one place."""
        return _TIE * (self.loaded.extent + float(np.abs(view.camera.eye).max()))

    def _tiles(
        self,
        stage: str,
        view: View,
        select: Sequence[str] | Bools,
        quantity: str | None,
        has_beyond: bool | None = None,
        rows: tuple[int, int] | None = None,
    ) -> Iterator[_PartTiles]:
        """The tiles of each part that is seen.

        has_beyond  whether depths are given beyond which hits count; None where hits are only listed
        The first part has all tiles of the picture, unless hits are only listed: it writes every pixel.
        """
        device = self.loaded.device
        in_view = self._patches(view, select)
        blocks_seen = zip(self.faces.blocks, in_view, strict=True)
        parts_seen = {block.part for block, (patches, _) in blocks_seen if len(patches.face)}

        is_first = has_beyond is not None
        for number, part in enumerate(self.loaded.parts):
            if number not in parts_seen:
                continue
            kernel = device.kernel(stage, part, quantity)
            patches, tiles, listed = self._tiled(view, select, number, kernel, is_first)
            if rows is not None:
                tiles = tiles[(tiles["y"] + TILE > rows[0]) & (tiles["y"] < rows[1])]

            place = {"first": self.loaded.first[number], "count": len(tiles)}
            close = CLOSE_IN_DRAFTS if is_draft() and has_beyond is not None else CLOSE
            record = self._view_record(kernel, view, **place, close=close, fresh=is_first, has_beyond=bool(has_beyond))
            data = {"patches": patches, "listed": listed, "tiles": tiles, "view": record}
            buffers = {name: device.buffer(array) for name, array in data.items()}
            counts = (tiles["end"] - tiles["first"]).astype(np.int64)
            yield _PartTiles(number, kernel, {**self.loaded.bindings(number, quantity), **buffers}, counts)
            is_first = False

    def _tiled(
        self, view: View, select: Sequence[str] | Bools, number: int, kernel: Kernel, is_first: bool
    ) -> tuple[Records, Records, NDArray[np.uint32]]:
        """Records of patches of a part, near ones first; of tiles; which patches each tile lists. Kept for the view."""
        key = number, is_first, kernel.dtype("patches")
        if key not in self._last.tiled:
            patches = self._part_patches(view, select, number, kernel.dtype("patches"))
            order = np.argsort(patches["near"], kind="stable")
            order = order[is_in_picture(view, patches[order]["least"], patches[order]["most"])]
            patches, beside = patches[order], self._part_lines(number)[..., order]
            least, most = pixel_bounds(patches, view)
            tiles, listed = bin_sections(least, most, kernel.dtype("tiles"), view if is_first else None, beside)
            self._last.tiled[key] = patches, tiles, listed
        return self._last.tiled[key]

    def _part_lines(self, number: int) -> Floats:
        """Lines (4, 3, n) along the patches of a part, as in FacePatches; triangles repeat their first one."""
        blocks = zip(self.faces.blocks, self._last.in_view, strict=True)
        return np.concatenate(
            [
                patches.beside[np.arange(4) % len(patches.beside)]
                for block, (patches, _) in blocks
                if block.part == number
            ],
            axis=2,
        )

    def _patches(self, view: View, select: Sequence[str] | Bools) -> list[tuple[FacePatches, Edges]]:
        """For each block of faces what the view sees of the chosen ones; the last answer is retained."""
        choice = select if isinstance(select, np.ndarray) else tuple(select)
        # an interruption leaves the last results unchanged
        last = self._last
        if not _same(last.choice, choice):
            chosen = [
                _choose(block, rows) for block, rows in zip(self.faces.blocks, self._chosen_rows(choice), strict=True)
            ]
            last.choice = choice
            last.chosen = chosen
            last.view = None

        if last.view is None or not last.view.shows_same(view.whole):
            in_view = []
            for block, own in zip(self.faces.blocks, last.chosen, strict=True):
                patches, edges = face_patches(block.space, own.nets, view.whole)
                in_view.append((own.sides.both(patches), edges))
            last.view, last.window = view.whole, None
            last.in_view = in_view
        if last.window is None or not last.window.shows_same(view):
            last.window, last.tiled = view, {}
        return last.in_view

    def _chosen_rows(self, choice: tuple[str, ...] | Bools) -> list[Ints]:
        """For each block the rows of the chosen faces."""
        if isinstance(choice, tuple):
            return list(self.faces.select(choice))
        first = self.loaded.first
        return [np.flatnonzero(choice[first[block.part] + block.element]) for block in self.faces.blocks]

    def _patch_records(self, number: int, chosen: Ints, patches: FacePatches, dtype: np.dtype[Any]) -> Records:
        """FacePatch records (face.slang) of patches of a block's faces in the rows ``chosen``."""
        block = self.faces.blocks[number]
        rows = chosen[patches.face]
        faces_before = sum(map(len, self.faces.blocks[:number]))
        record = np.zeros(len(rows), dtype)
        record["element"] = block.element[rows]
        record["face"] = faces_before + rows
        record["square"] = len(block.space.halves) == 2
        record["least"], record["most"] = patches.bounds
        record["near"] = patches.near
        record["noise"] = patches.noise

        # a margin changes at most as much as the coordinates of the face
        axes = np.abs(patches.place[:, 1:]).sum(axis=1).max(axis=1)
        record["border_width"] = TOLERANCE + 2.0 * patches.noise * axes

        # origin and axes of the patch in its face, then in its element
        record["origin"], record["along"], record["across"] = patches.place.transpose(1, 0, 2)
        frames = block.frames[block.local[rows]]
        in_element = patches.place @ frames[:, 1:]
        record["start"] = frames[:, 0] + in_element[:, 0]
        record["first"] = in_element[:, 1]
        record["second"] = in_element[:, 2]
        return record

    def _view_record(self, kernel: Kernel, view: View, **values: Any) -> Records:
        """The FaceView record (face.slang)."""
        uncertain = {"tie": self._tie(view), "misplaced": misplaced(view, self.loaded.extent)}
        return record_of(kernel, "view", view, **uncertain, **values)


def pixel_bounds(patches: Records, view: View) -> tuple[Ints, Ints]:
    """The minimum and the maximum (n, 4) of what bounds the pixels that FacePatch records have there."""
    if view.part_of is None:
        return patches["least"], patches["most"]
    least, most = patches["least"].copy(), patches["most"].copy()
    least[:, :2] = np.maximum(least[:, :2], view.first)
    most[:, :2] = np.minimum(most[:, :2], view.last)
    return least, most


def _choose(block: FaceBlock, rows: Ints) -> _ChosenFaces:
    """Some faces of a block; of two sides of a face one has the net for both."""
    nets = block.nets(rows)
    sides = Sides.of(block.space, block.entity[rows], nets)
    return _ChosenFaces(rows, nets[sides.alone], sides)


def _same(one: tuple[str, ...] | Bools, other: tuple[str, ...] | Bools) -> bool:
    """Whether two ways to choose faces are one."""
    if isinstance(one, tuple) or isinstance(other, tuple):
        return isinstance(one, tuple) and isinstance(other, tuple) and one == other
    return np.array_equal(one, other)


def _without_repeats(hits: Records, tie: float) -> Records:
    """Hits by pixel and depth, each once: patches of a face share their borders, where both of them are met."""
    hits = hits[np.lexsort((hits["depth"], hits["face"], hits["pixel"]))]
    same_face = np.diff(hits["face"].astype(np.int64)) == 0
    same_pixel = np.diff(hits["pixel"].astype(np.int64)) == 0
    same_depth = np.diff(hits["depth"]) <= tie
    repeats = np.append(False, same_face & same_pixel & same_depth)[: len(hits)]
    hits = hits[~repeats]
    return hits[np.lexsort((hits["element"], hits["depth"], hits["pixel"]))]


def _mark_edges(view: View, hits: HitBuffer, edges: Edges, after: Floats) -> None:
    """Mark pixels with an edge in front of everything else, visible or not, as ambiguous."""
    for own, pixel in pixels_near(view, edges):
        near, far = edges.depth[:, own]
        in_front = (near <= hits.depth[pixel]) & (far >= after[pixel])
        in_front &= hits.status[pixel] != Status.FAILED
        hits.status[pixel[in_front]] = Status.AMBIGUOUS


def pixels_near(view: View, edges: Edges, reach: float = 0.0) -> Iterator[tuple[Ints, Ints]]:
    """Edges (n,) by number and pixels (n,) whose centres are near them, or nearer than ``reach`` pixels to that."""
    # x runs along the longer direction of each edge, rows of the picture where it is steep, and y across it
    extent = np.abs(edges.ends[1] - edges.ends[0])
    steep = extent[:, 1] > extent[:, 0]
    start, end = np.where(steep[:, None], edges.ends[..., ::-1], edges.ends)
    x0, y0 = start.T
    x1, y1 = end.T
    first_x, first_y = np.where(steep, view.first[::-1, None], view.first[:, None])
    last_x, last_y = np.where(steep, view.last[::-1, None], view.last[:, None])
    every_radius = edges.radius + reach

    # steps of one pixel along each edge, within the picture
    first = np.maximum(np.ceil(np.minimum(x0, x1) - every_radius), first_x)
    last = np.minimum(np.floor(np.maximum(x0, x1) + every_radius), last_x)
    edge, x = _integers_between(first, last)

    # at each step all pixels whose centres are near the edge
    slope = np.divide(y1 - y0, x1 - x0, out=np.zeros_like(x0), where=x1 != x0)
    y = y0[edge] + slope[edge] * (x - x0[edge])
    radius = every_radius[edge]
    first = np.maximum(np.ceil(y - radius), first_y[edge])
    last = np.minimum(np.floor(y + radius), last_y[edge])
    for some in chunks(len(edge), max(1, _AT_ONCE // max(view.width, view.height))):
        step, across = _integers_between(first[some], last[some])
        along = x[some][step]
        own = edge[some][step]
        column, row = np.where(steep[own], [across, along], [along, across]).astype(np.int64)
        yield own, view.numbers(column, row)


def _integers_between(first: Floats, last: Floats) -> tuple[Ints, Floats]:
    """All whole numbers from first to last (n,), ends included: (m,) which of the ranges, and (m,) the number."""
    counts = np.maximum(last - first + 1, 0).astype(np.int64)
    which = np.repeat(np.arange(len(counts)), counts)
    starts = np.cumsum(counts) - counts
    return which, first[which] + np.arange(len(which)) - starts[which]
