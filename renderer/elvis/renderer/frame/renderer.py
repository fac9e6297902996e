"""A device with a volume: pictures of its scenes."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import ALONE, Ranks
from elvis.core.base.terminal import Progress
from elvis.core.data.dataset import Dataset
from elvis.plugins.runtime.serving import volume_of
from elvis.plugins.runtime.volume import Volume
from elvis.plugins.runtime.volume_checks import Samples
from elvis.renderer.device.device import Device
from elvis.renderer.device.drafts import is_draft
from elvis.renderer.device.persistence import persistent
from elvis.renderer.flow.stage import Made
from elvis.renderer.frame.canvas import Canvas, check_memory
from elvis.renderer.frame.copied import CopiedData, boxes_of_copies, surrounding_copies
from elvis.renderer.frame.ghosts import Ghosts
from elvis.renderer.frame.other_data import OtherData
from elvis.renderer.frame.outlined import with_surroundings
from elvis.renderer.frame.shading import Painter
from elvis.renderer.frame.stages import Stages
from elvis.renderer.parts.bands import Bands
from elvis.renderer.parts.rank_rows import RankRows, channels, joined
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.raster.tiles import TILE
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.renderer.volume.element_samples import sample_elements
from elvis.renderer.volume.probing import Places
from elvis.scene import Plane, Scene, Vector
from elvis.scene.cameras.fitting import automatic, empty_picture_remark, is_of_elements
from elvis.scene.cameras.view import PlaneView, View, view_of
from elvis.scene.model.errors import AbsentError
from elvis.scene.model.time_limit import check_time, limited
from elvis.scene.record.frame import Frame
from elvis.scene.record.palette import automatic_range


class Renderer:
    """A device with a volume, for many pictures of the same data.

    progress  called with the number of finished bands of a picture, and their total
    ranks     as in `Pictures`
    bands     view of the next picture and distribution of its rows, if several ranks draw it
    """

    def __init__(self, device: str = "auto", progress: Progress | None = None, ranks: Ranks = ALONE) -> None:
        """Open a device (see render)."""
        self.device, self.ranks = Device(device), ranks
        self.bands: Bands | None = None
        self.progress = progress or (lambda done, total: None)
        self.seconds: dict[str, float] = {}
        self._stages: Stages | None = None
        self._ghosts = Ghosts()
        self._fitted: tuple[object, View] | None = None
        self._stays = False  # whether that view is one of the elements, whatever the values

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the device and the volume; nothing can be drawn afterwards."""
        self._stages, self._fitted = None, None
        self._ghosts.clear()
        self.device.close()

    def load(
        self,
        dataset: Dataset,
        *quantities: str,
        ghosts: Mapping[str, Dataset] | None = None,
        copied: CopiedData | None = None,
    ) -> None:
        """Load fields of a dataset, or other quantities, onto the device; the first is the field of its scenes.

        ghosts  geometries that are drawn next to the data, by name
        copied  copies of the data that are drawn too
        """
        start = perf_counter()
        before = None if self._stages is None else self._stages.others
        copied = copied or CopiedData()
        others = OtherData.of(self.device, dataset, quantities, before, copied.expressions)
        self.show(volume_of(dataset, others.own), dataset, others, copied)
        self._ghosts.show(ghosts or {}, others.own, self.stages)
        self.seconds["load"] = perf_counter() - start

    def show(
        self,
        volume: Volume,
        made_of: Made = None,
        others: OtherData | None = None,
        copied: CopiedData | None = None,
    ) -> None:
        """Load a volume onto the device; ``made_of`` is its dataset, or the data of a runtime plugin, if known.

        others  data on other meshes that its quantities need
        copied  copies of the data that are drawn too
        """
        # runtime plugins don't state whether maps are unchanged
        last = self._stages
        before = None if last is None or last.dataset is None or not isinstance(made_of, Dataset) else last.loaded
        loaded = DeviceVolume(self.device, volume, before)
        if before is None or not (self._stays and loaded.shares_elements(before)):
            self._fitted = None
        self._stages = Stages(loaded, volume, made_of, others)
        self._stages.copied = copied or CopiedData()

    @property
    def stages(self) -> Stages:
        """The stages for the volume; raises ElvisError if there is none yet."""
        if self._stages is None:
            raise ElvisError("no dataset is loaded; load one before drawing, probing or sampling")
        return self._stages

    def probe(self, points: Floats) -> Places:
        """Elements and field at world points (n, 3), found on the device."""
        return self.stages.finder.find(points)

    def sample_elements(self, part: int, elements: Ints, offsets: Floats, quantity: str | None = None) -> Samples:
        """Samples in elements (n,) of a part at offsets (n, 3) from their type's centre; for checks of plugins."""
        return sample_elements(self.stages.loaded, part, elements, offsets, quantity)

    def preview(self, point: Vector, size: tuple[int, int] = (90, 60)) -> Frame:
        """A small picture of the current data: a cut through a point, or all 2D data; for checks of plugins."""
        normal = (0.2, 0.5, 1.0) if self.stages.loaded.dimension == 3 else (0.0, 0.0, 1.0)
        return self.render(Scene("", plane=Plane(point, normal), size=size))

    def render(self, scene: Scene, *, references: bool = True) -> Frame:
        """A picture of the volume; the scene has objects.  Only exact records need reference coordinates."""
        start = perf_counter()
        with limited(scene.timeout):
            rows = RankRows(self.ranks, self.bands)
            frame = persistent(lambda most: self._draw(scene, references, most, rows), self._reopen)
            check_time()
        if not frame.status.any() and not self.ranks.rank:
            boxes = surrounding_copies(self.stages.box, self.stages.copied.copies)
            raise AbsentError(
                "; ".join([empty_picture_remark(scene.only_plane, boxes), *frame.stats.get("remarks", ())])
            )
        frame.stats.update(
            device={"name": self.device.adapter.name, "label": self.device.adapter.label},
            elements=self.stages.elements,
            pixels=frame.counts(),
            remarks=[*frame.stats.get("remarks", ()), *self.device.passed, *self.device.cache.remarks],
        )
        if not self.ranks.rank:
            frame = with_surroundings(frame, scene, self.stages)
        frame.stats["seconds"] = {**self.seconds, **frame.stats.get("seconds", {}), "frame": perf_counter() - start}
        return frame

    def view(self, scene: Scene) -> View:
        """The view that `render` uses for a scene."""
        with limited(scene.timeout):
            return persistent(lambda most: self._view(scene), self._reopen)

    def _draw(self, scene: Scene, references: bool, most: int, rows: RankRows) -> Frame:
        """A frame that is drawn with at most ``most`` pixels at once."""
        view = self._view(scene)
        check_time()
        check_memory(view, references, most)
        if isinstance(view, PlaneView) and scene.is_plain and view.count <= 4 * most:
            return self._plane_frame(scene, view, references, rows)
        return Canvas(scene, view, self.stages, references, most, self.progress, rows).frame()

    def _reopen(self) -> None:
        """Replace a lost device by a new one, with the same volume."""
        stages, name = self.stages, self.device.adapter.name
        with suppress(Exception):
            self.device.close()
        self.device = Device(name)
        self.show(stages.volume, stages.made_of, stages.others.on(self.device), stages.copied)
        self._ghosts.show_again(self.stages)

    def _view(self, scene: Scene) -> View:
        """The view of a scene; the previous view if the objects and the camera are unchanged."""
        if self.bands is not None:
            return self.bands.view
        part = scene.region, scene.zoom, scene.box, scene.axes, scene.companions, scene.copies, scene.shows_domain
        key = (scene.every_object, scene.clip, scene.camera, scene.size, part, is_draft())
        if self._fitted is None or self._fitted[0] != key:
            every = [self.stages, *self.stages.ghosts.values()]
            boxes = [part.boxes for own in every for part in own.loaded.parts]
            boxes += boxes_of_copies(boxes, self.stages.copied.copies)
            asked = automatic(scene, boxes, partial(self.glance, rows=RankRows()))
            self._fitted, self._stays = (key, view_of(asked)), is_of_elements(scene)
        return self._fitted[1]

    def glance(self, scene: Scene, rows: RankRows) -> Bools:
        """(h, w) where something is seen, in this rank's rows."""
        view, own = rows.window(view_of(scene), self._around)
        hit = np.zeros(view.count, bool)
        if isinstance(view, PlaneView) and scene.is_plain:
            hit = self.stages.cutter.draw(view, references=False).owner != NOBODY
        else:
            for draw_call in self.stages.draw_calls(scene):
                opaque = replace(draw_call, style=replace(draw_call.style, opacity=1.0), bare=False)
                for hits in self.stages.hit_buffers(opaque, view, scene.clip):
                    hit |= hits.owner != NOBODY
            painter = Painter(scene, self.stages)
            painter.paint([], view)
            hit |= painter.volume_status > 0
        return np.asarray(hit.reshape(view.height, view.width)[own])

    @property
    def _around(self) -> int:
        """Rows around a rank's own: far from the origin, neighbours of visible pixels are in doubt (see cut)."""
        return TILE * self.stages.loaded.is_far

    def _plane_frame(self, scene: Scene, view: PlaneView, references: bool, rows: RankRows) -> Frame:
        """A frame that shows only the plane."""
        cutter, loaded = self.stages.cutter, self.stages.loaded
        window, inner = rows.window(view, self._around)
        own = channels(self.stages.plain_cut(scene, window, references), window, loaded.ids, references)
        own = {name: array[inner] for name, array in own.items()}
        every = joined(rows.gathered(own) or [own])
        if scene.range == "all":
            scene = replace(scene, range=automatic_range(self.stages.bounds(scene.field), scene.palette))
        shown = every["field"], every["element"], every.get("reference"), every["status"]
        frame = Frame(scene, view, *shown)
        sizes = {"volume": loaded.bytes, "image": 12 * view.count}
        frame.stats.update(bytes=sizes, seconds=dict(cutter.clock.seconds))
        return frame
