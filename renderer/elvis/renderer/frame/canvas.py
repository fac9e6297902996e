"""Pictures of many objects: bands of rows are drawn, recorded and painted one after another."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from math import inf
from time import monotonic, perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats
from elvis.core.base.memory import free_memory, size_text
from elvis.core.base.terminal import Progress
from elvis.renderer.device.drafts import has_segments, is_draft, traces_lines
from elvis.renderer.flow.tracing import Tracer
from elvis.renderer.frame.shading import Painter
from elvis.renderer.frame.stages import Stages
from elvis.renderer.frame.visible_hits import Drawn, record_of
from elvis.renderer.parts.rank_rows import RankRows, joined
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.raster.tiles import TILE
from elvis.scene import Scene
from elvis.scene.cameras.view import View
from elvis.scene.model.errors import SceneError
from elvis.scene.model.permissions import PIXELS
from elvis.scene.model.time_limit import check_time
from elvis.scene.record.frame import Drawing, Frame, Status, whole

#: most pixels that are drawn at once, and hits that are kept while colours must wait for other bands
BAND, KEPT = 1 << 21, 1 << 23
#: the same while copies of data are drawn, each of which has hits of its own: many copies take no more than few
KEPT_OF_COPIES = 1 << 20
#: pixels that are drawn at once of many copies, at least
FEWEST_OF_COPIES = 1 << 12
#: bytes for each pixel of a picture with and without its record until it is saved, and for each that is drawn at once
BYTES, BYTES_AT_ONCE = {True: 216, False: 8}, 400

#: bytes that there are always
LITTLE = 1 << 22


def is_exact(scene: Scene) -> bool:
    """Whether the scene needs more than colours, such as depths that hide the box, or has no outputs."""
    return scene.box or not scene.outputs or not all(name.lower().endswith(PIXELS) for name in scene.outputs)


@dataclass(frozen=True, eq=False)
class Band:
    """Rows of a picture, drawn with a margin of pixels on all sides, as lines look around.

    rows   of the picture
    inner  rows and columns of the same pixels in the view
    """

    rows: slice
    inner: tuple[slice, slice]
    view: View

    @property
    def own(self) -> NDArray[np.bool_]:
        """(n,) the band's own pixels, and those before."""
        rows, columns = self.inner
        own = np.zeros((self.view.height, self.view.width), bool)
        own[max(rows.start - (self.rows.start == 0), 0) : rows.stop, max(columns.start - 1, 0) : columns.stop] = True
        return own.reshape(-1)

    def cropped(self, values: NDArray[Any]) -> NDArray[Any]:
        """The picture's own pixels (h, w[, 3]) of the values (n[, 3]) of all pixels of the view."""
        return values.reshape(self.view.height, self.view.width, *values.shape[1:])[self.inner]


@dataclass(eq=False)
class Canvas:
    """A picture that is being drawn.

    records   whether fields, elements, positions and normals are stored, or only colours and statuses
    most      pixels that are drawn at once
    progress  called with the amounts done and in total
    rows      the ranks that draw rows of it; finally all but the first have only their own rows
    """

    scene: Scene
    view: View
    stages: Stages
    records: bool = True
    most: int = BAND
    progress: Progress = lambda done, total: None
    rows: RankRows = field(default_factory=RankRows)
    seconds: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.done, self.total, self.undefined, self.still = 0, 0, 0, 0
        copies = len(self.stages.copied.copies)
        # each copy has hits of its own
        self.most = self.most if copies < 2 else max(FEWEST_OF_COPIES, self.most // copies)
        self.painter = Painter(self.scene, self.stages)
        self.draw_calls = self.stages.draw_calls(self.scene)
        self.tracer = Tracer(self.painter, self.draw_calls)
        self.contours: Counter[Status] = Counter()
        is_whole = self.view.count <= self.most and self.rows.is_alone
        self.arrays = _arrays(self.view, self.records and not is_whole)
        self.keeps_depths = is_draft() or self.scene.shows_domain
        if self.keeps_depths and not (self.records and is_whole):
            self.arrays["depth"] = np.full((self.view.height, self.view.width), inf)

    @property
    def _proves(self) -> bool:
        """Whether proofs about contours are counted: only for statistics and records."""
        asked = self.scene.stats or any(not name.lower().endswith(PIXELS) for name in self.scene.outputs)
        return bool(asked) and any(draw_call.style.contours is not None for draw_call in self.draw_calls)

    def frame(self) -> Frame:
        """The complete picture.  If colours depend on all bands, bands that don't fit into memory are drawn twice."""
        bands, samples = list(self._bands()), self.scene.samples**2 + (self.scene.samples % 2 == 0)
        in_parts = len(bands) > 1 or not self.rows.is_alone
        first = bands if in_parts and not self.painter.is_complete(self.draw_calls) else []
        self.total = len(first) + len(bands) * samples
        room = KEPT_OF_COPIES if self.stages.copied.copies else KEPT
        kept: dict[int, Drawn] = {}
        for band in first:
            drawn = self._draw_hit_buffers(band.view)
            self.painter.note(drawn, band.cropped)
            room -= band.view.count * len(drawn)
            kept |= {band.rows.start: drawn} if room >= 0 else {}
        self.painter.note_of_others(self.draw_calls, self.rows.together(self.painter.noted(self.draw_calls)))
        for band in bands:
            own = band.rows.start
            self._fill(band, kept.pop(own) if own in kept else self._draw_hit_buffers(band.view))
        if not self.rows.is_alone:
            self._take_others()
        arrays = self.arrays
        legends = self.painter.legends(self.draw_calls) + self.stages.flow.keys(self.scene, self.view)
        drawing = Drawing(arrays["depth"], arrays["normal"], arrays["color"], legends)
        drawing = replace(drawing, uncertainty=arrays["uncertainty"]) if self.records else drawing
        through = arrays["through"] if self.scene.is_clear else None
        drawing = replace(drawing, line_status=arrays["line_status"] if self._proves else None)
        drawing = replace(drawing, through=through)
        if has_segments(self.scene):
            drawing = replace(drawing, segments=self.tracer.segments())
        else:
            drawing = replace(drawing, strokes=self.tracer.strokes())
        stats: dict[str, Any] = {"seconds": self.seconds, "bytes": {"volume": self.stages.loaded.bytes}}
        remarks = self.painter.remarks(self.draw_calls)
        if self.still:
            remarks.append(f"pixels without streaks, because the velocity along the surface is zero: {self.still}")
        stats |= {"remarks": remarks, "not_a_number": self.undefined}
        if self._proves:
            stats["contours"] = {status.name.lower(): self.contours[status] for status in self.contours}
        if self.painter.volume_counts:
            stats["volume"] = {**self.painter.volume_counts, "inverted_elements": self.stages.inverted_elements}
        record, element, reference = (arrays[name] for name in ("field", "element", "reference"))
        reference = reference if self.records else None
        drawing = replace(drawing, copies=arrays["copy"] if self.scene.copies and self.records else None)
        return Frame(self.scene, self.view, record, element, reference, arrays["status"], stats, drawing)

    def _take_others(self) -> None:
        """Gather what other ranks have drawn."""
        first, last = self.rows.of(self.view)
        names = [name for name, array in self.arrays.items() if array.flags.writeable]
        own = {name: self.arrays[name][first:last] for name in names}
        counts = self.undefined, self.still, self.contours, self.painter.volume_counts
        noted = self.painter.noted(self.draw_calls)
        every = self.rows.gathered((own, counts, noted, self.tracer.found))
        if not every:
            return
        self.arrays |= joined([arrays for arrays, *_ in every])
        for _, (undefined, still, contours, volumes), others, found in every[1:]:
            self.undefined, self.still = self.undefined + undefined, self.still + still
            self.contours.update(contours)
            self.painter.volume_counts.update(volumes)
            self.painter.note_of_others(self.draw_calls, [others])
            self.tracer.take(found)

    def _bands(self) -> Iterator[Band]:
        """Bands of ``most`` pixels at most, and the pixels around that lines need, also beyond the picture's edge."""
        view, margin = self.view, self.painter.radius
        wide = view.with_margin(margin)
        rows = view.height
        start, stop = self.rows.of(view)
        if view.count > self.most:
            # a tile that has pixels of a band lies in its window
            most = max(1, self.most // view.width)
            rows = most // TILE * TILE or most
        around = -(-margin // TILE) * TILE
        for top in range(start, stop, rows):
            end = min(stop, top + rows)
            window = wide.rows(top - around, end + around)
            inner = slice(top - window.top, end - window.top), slice(margin, margin + view.width)
            yield Band(slice(top, end), inner, window)

    def _fill(self, band: Band, drawn: Drawn) -> None:
        """Record and paint one band."""
        self.painter.note(drawn, band.cropped)
        rows, inner = band.rows, band.cropped
        record = record_of(drawn, band.view, self.stages.loaded.extent, whole=self.records)
        self.undefined += int(np.count_nonzero(inner(~np.isfinite(record.field) & (record.owner != NOBODY))))
        color = inner(self._colors(drawn, band.view))
        self.still += int(np.count_nonzero(inner(self.painter.still(drawn, band.view))))
        if self.scene.is_clear:
            self._keep("through", rows, inner(self.through))
        if traces_lines(self.scene):
            self.tracer.note(drawn, band.view, band.own)
        if self._proves:
            found, coverage = map(inner, self.painter.contour_status(drawn, band.view))
            self._keep("line_status", rows, coverage)
            self.contours.update({word: int((found == word).sum()) for word in (Status.CERTAIN, Status.AMBIGUOUS)})
        self._keep("color", rows, color if self.records else whole(np.asarray(color)))
        self._keep("status", rows, inner(np.maximum(record.status, self.volume_status)))
        if self.records:
            self._keep_record(band, record)
        elif self.keeps_depths:
            self._keep("depth", rows, inner(record.depth))

    def _keep_record(self, band: Band, record: HitBuffer) -> None:
        """Keep the channels of a band that only records have."""
        rows, inner = band.rows, band.cropped
        self._keep("element", rows, inner(self.stages.loaded.ids.take(record.owner, mode="clip")))
        known = record.uncertainty
        self._keep("uncertainty", rows, inner(np.full(band.view.count, np.nan) if known is None else known))
        if self.scene.copies is not None:
            self._keep("copy", rows, inner(np.full(band.view.count, -1) if record.copies is None else record.copies))
        for name in ("field", "depth", "reference", "normal"):
            self._keep(name, rows, inner(getattr(record, name)))

    def _keep(self, name: str, rows: slice, values: Any) -> None:
        """Put rows of a channel in their place."""
        if len(values) == self.view.height:
            self.arrays[name] = values
        else:
            self.arrays[name][rows] = values

    def _draw_hit_buffers(self, view: View) -> Drawn:
        """All hit buffers of all draw calls."""
        start, drawn = perf_counter(), []
        for draw_call in self.draw_calls:
            for hits in self.stages.hit_buffers(draw_call, view, self.scene.clip):
                check_time()
                # most copies are elsewhere than a band
                if draw_call.copy is None or not hits.is_empty:
                    drawn.append((draw_call, hits))
        self.seconds["surfaces"] = self.seconds.get("surfaces", 0.0) + perf_counter() - start
        self.done += 1
        self.progress(self.done, self.total)
        return drawn

    def _colors(self, drawn: Drawn, view: View) -> Floats | NDArray[np.uint8]:
        """(n, 3) means over the samples of each pixel; ``drawn`` are the hit buffers at its centre."""
        count, self.volume_status = self.scene.samples, np.zeros(view.count, np.uint8)
        steps = (np.arange(count) - 0.5 * (count - 1)) / count
        total: Any = 0.0
        self.through = np.zeros(view.count)
        for x, y in product(steps, steps):
            here = view if x == y == 0.0 else view.shifted(x, y)
            hit_buffers = drawn if here is view else self._draw_hit_buffers(here)
            start = perf_counter()
            colors = self.painter.paint(
                hit_buffers, here, whole=count == 1 and not (self.records or self.scene.is_clear)
            )
            if self.scene.is_clear:
                self.through += self._through(hit_buffers, here) / count**2
            total = colors if count == 1 else total + colors / count**2
            self.volume_status = np.maximum(self.volume_status, self.painter.volume_status)
            self.seconds["colours"] = self.seconds.get("colours", 0.0) + perf_counter() - start
            check_time()
        return np.asarray(total)

    def _through(self, hit_buffers: Drawn, view: View) -> Floats:
        """(n,) part of the background that comes through: what a white one adds to a black one."""
        black, white = (self.painter.paint(hit_buffers, view, behind=3 * (shade,)) for shade in (0.0, 1.0))
        return np.asarray((white - black).mean(axis=1))


def _arrays(view: View, records: bool) -> dict[str, Any]:
    """Empty channels by name, (height, width[, 3]); unused ones take no memory."""
    shape = view.height, view.width
    color, through = np.zeros((*shape, 3), np.float64 if records else np.uint8), np.zeros(shape)
    record = _record(shape, np.full) if records else _no_record(shape)
    status, line_status = np.zeros((2, *shape), np.uint8)
    return {"color": color, "through": through, "status": status, "line_status": line_status, **record}


def _record(shape: tuple[int, int], full: Callable[..., NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The channels of a record, initially without any visible point."""
    values = {"field": np.nan, "depth": np.inf, "element": -1, "copy": -1, "uncertainty": np.nan}
    scalars = {name: full(shape, value) for name, value in values.items()}
    return scalars | {name: full((*shape, 3), np.nan) for name in ("reference", "normal")}


@lru_cache(maxsize=4)
def _no_record(shape: tuple[int, int]) -> dict[str, NDArray[Any]]:
    """The same of one number each, which nobody can change."""
    return _record(shape, lambda shape, value: np.broadcast_to(np.array(value), shape))


@lru_cache(maxsize=1)
def _free_memory(second: int) -> float:
    """Bytes that are free, asked for once in a second: it takes milliseconds, of each frame while a camera turns."""
    return free_memory()


def check_memory(view: View, records: bool, most: int) -> None:
    """SceneError where a picture takes more memory than is free, if ``most`` pixels are drawn at once."""
    need = view.count * BYTES[records] + min(view.count, most) * BYTES_AT_ONCE
    # the system takes longer to report its free memory than drawing a small picture takes
    free = _free_memory(int(monotonic())) if need > LITTLE else inf
    if need > free:
        alone = ", or write only a .png" if records else ""
        raise SceneError(
            f"a picture of {view.width} x {view.height} pixels takes {size_text(need)} of memory, "
            f"{size_text(free)} are free; reduce its size{alone}"
        )
