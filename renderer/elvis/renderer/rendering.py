"""Rendering of a dataset and a scene to a frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.dataset import Dataset
from elvis.core.errors import ElvisError
from elvis.core.geometry import share
from elvis.core.memory import release_free_memory
from elvis.core.picturing import Kind
from elvis.core.ranks import ALONE, Ranks
from elvis.core.terminal import Progress
from elvis.plugins.evaluation_service import check_volume
from elvis.plugins.opening import PluginData
from elvis.plugins.serving import names_of, volume_of
from elvis.plugins.volume import Volume
from elvis.plugins.volume_checks import Samples
from elvis.renderer.bands import Bands
from elvis.renderer.bricks import Bricks, in_memory, timed
from elvis.renderer.canvas import Canvas, check_memory, is_exact
from elvis.renderer.completing import arranged, kind_of, located, other_device, with_quantity
from elvis.renderer.copied import CopiedData, boxes_of_copies, surrounding_copies
from elvis.renderer.copy_checks import CopyChecks
from elvis.renderer.curves import draw_curves
from elvis.renderer.deformed_data import DeformedData
from elvis.renderer.device import Device
from elvis.renderer.device_volume import DeviceVolume
from elvis.renderer.drafts import is_draft
from elvis.renderer.element_samples import sample_elements
from elvis.renderer.flow_stage import Made
from elvis.renderer.frame_notes import note, remarks_on_conversion, remarks_on_derived
from elvis.renderer.ghosts import Ghosts, check_ghosts
from elvis.renderer.near_cuts import NearCuts
from elvis.renderer.other_data import OtherData
from elvis.renderer.outlined_frame import with_surroundings
from elvis.renderer.parts import RankPart
from elvis.renderer.persistence import persistent
from elvis.renderer.pixels import NOBODY
from elvis.renderer.probing import Places
from elvis.renderer.rank_pictures import RankPicture
from elvis.renderer.rank_rows import RankRows, channels, joined
from elvis.renderer.request import Request
from elvis.renderer.requested_data import data_of
from elvis.renderer.series_range import with_range
from elvis.renderer.shading import Painter
from elvis.renderer.stages import Stages
from elvis.renderer.tiles import TILE
from elvis.scene import Camera, Copies, Plane, Scene, Vector
from elvis.scene.bare_mesh import REMARK, of_mesh
from elvis.scene.errors import AbsentError, SceneError
from elvis.scene.fitting import automatic, empty_picture_remark, is_of_elements
from elvis.scene.frame import Frame
from elvis.scene.palette import automatic_range
from elvis.scene.quantities import quantities, with_velocities
from elvis.scene.time_limit import check_time, limited
from elvis.scene.view import PlaneView, View, view_of

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from elvis.scene.render_keywords import RenderKeywords


def render(
    *data: Any,
    scene: Scene | None = None,
    device: str | None = None,
    progress: Progress | None = None,
    **keywords: Unpack[RenderKeywords],
) -> Frame:
    """A picture of a dataset, of data opened by a runtime plugin, or of files of any format.

    As ``render("case.xml", "case.fld", "u")``, or ``render(ds, "speed", contours=10, plane=(point, normal))``.

    data      result of `read`, or files and scene files; then the quantity that colours the picture, or a Scene
    scene     scene to draw, which keywords change
    device    ``auto``, ``vulkan``, ``vulkan:N``, ``cuda``, ``cpu``, or a device plugin such as ``reference``
    progress  called with the amounts done and in total
    keywords  options of ``elvis render`` and keys of scenes, by name (docs/scene.md); ``output`` writes the picture

    Raises SceneError if nothing is visible or the field is unknown, DeviceError if the device can't be used,
    KeywordError, which is also a TypeError, with a similar name for an unknown keyword.

    >>> elvis.render("wing.xml", "wing.fld", "p", plane="z=0.5", size=(80, 60)).image.shape
    (60, 80, 3)
    """
    asked = Request.of(data, scene, keywords)
    at_hand = data_of(asked)
    shown = asked.scene if asked.data is not None else with_range(asked.scene)
    with Pictures(at_hand, device or asked.scene.device, progress) as pictures:
        frame = pictures.draw(shown)
    asked.write(frame)
    return frame


class Pictures:
    """Pictures of the same data, one after another: the device and the data on it are kept.

    device    ``auto``, ``vulkan``, ``vulkan:N``, ``cuda``, ``cpu``, or a device plugin such as ``reference``
    progress  called with the amounts of a picture done and in total
    ranks     that draw rows of the pictures, each from its part of the data or from all; only the first rank's pictures
              are complete
    """

    def __init__(
        self,
        data: Dataset | PluginData | RankPart | Bricks,
        device: str = "auto",
        progress: Progress | None = None,
        ranks: Ranks = ALONE,
    ) -> None:
        self.device, self.ranks, self._progress = device, ranks, progress
        self._drawn: Dataset | None = None
        self._kind: Kind | None = None
        self._renderer: Renderer | None = None
        self._quantities: tuple[str, ...] = ()
        self._time: float | None = None
        self._ghosts: dict[str, Dataset] = {}
        self._copies: Copies | None = None
        self._remarks: Sequence[str] = ()
        self._near = NearCuts(device)
        self._take(data)

    def __enter__(self) -> Pictures:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the device back; the next picture opens it again."""
        renderer, self._renderer, self._quantities = self._renderer, None, ()
        if renderer is not None:
            renderer.close()
            # drivers that compile for the CPU leave hundreds of megabytes to malloc, also with kernels from the cache
            del renderer
            release_free_memory()

    @property
    def buffers_made(self) -> int:
        """Pieces of the device's memory that were made so far; steady frames make none."""
        return 0 if self._renderer is None else self._renderer.device.buffers_made

    def show(self, data: Dataset | PluginData | RankPart | Bricks) -> None:
        """Take other data for the next pictures; the device stays."""
        if isinstance(data, Dataset) and isinstance(self.data, Dataset) and data.mesh is self.data.mesh:
            share(data.mesh)
        self._take(data)

    def _take(self, data: Dataset | PluginData | RankPart | Bricks) -> None:
        """Start with data without any known facts."""
        self._part = data if isinstance(data, RankPart) else None
        self._bricks = data if isinstance(data, Bricks) else None
        self.data = data.dataset if isinstance(data, RankPart | Bricks) else data
        self._quantities, self._kind = (), None
        self._deformed = DeformedData(self.data, self.data is data)
        self._geometry: Dataset | PluginData = self.data
        self._checked: tuple[str, float | None] | None = None
        self._copy_checks = CopyChecks()
        self._conversion: tuple[object, tuple[str, ...]] = (None, ())

    def draw(self, scene: Scene) -> Frame:
        """A picture; raises as `render`."""
        asked, scene, data, remarks = self._arranged(scene)
        other = other_device(self.device)
        check_ghosts(scene, self._kind, self.device, other is None)
        self._copy_checks.check(scene, self._kind, data, is_whole=self._part is None and self._bricks is None)
        if other is not None:
            return note(other(data, scene), asked, data, remarks)
        if self._kind is Kind.LINE and isinstance(data, Dataset):
            return note(draw_curves(data, scene), asked, data, remarks)
        frame = self._with_volume(data, scene).render(scene, references=is_exact(scene))
        return note(frame, asked, data, (*remarks, *self._deformed.remarks(scene), *self._remarks))

    def camera(self, scene: Scene) -> Camera:
        """The camera of that picture; if a Renderer draws it, only the view is computed."""
        _, shown, data, _ = self._arranged(scene)
        if other_device(self.device) is not None or self._kind is Kind.LINE:
            return self.draw(scene).view.camera
        return self._with_volume(data, shown).view(shown).camera

    def _arranged(self, scene: Scene) -> tuple[Scene, Scene, Dataset | PluginData, tuple[str, ...]]:
        """The requested scene, the scene that shows it, the data of its picture and remarks on them."""
        data = self._deformed.of(scene)
        if data is not self._geometry:
            # bricks of another geometry are of no use; data that were read in parts have one geometry
            self._geometry, self._quantities, self._bricks = data, (), None
        if scene.range == "series":
            raise SceneError("range: series needs the files of a series: expected visible, all or two values")
        if not scene.field and isinstance(data, Dataset) and not data.solution:
            scene, data = of_mesh(scene), replace(data, remarks=(*data.remarks, REMARK))
        scene = located(scene, data, self._bricks or self._part)
        data = timed(data, scene.time) if isinstance(data, Dataset) else data
        if self._checked != (scene.field, scene.time):
            scene = with_quantity(scene, data)
            self._checked = scene.field, scene.time
        self._tell_conversion(data, scene)
        self._kind = self._kind or kind_of(data, scene)
        asked, scene = scene, arranged(with_velocities(scene, names_of(data), self._kind), self._kind)
        told = (*data.remarks, *self._conversion[1]) if isinstance(data, Dataset) else ()
        remarks = (*told, *remarks_on_derived(data, scene))
        if self._part is not None:
            data = self._of_ranks(self._part.timed(scene.time), scene)
        found = self._in_bricks(data, scene)
        if self._bricks is not None and isinstance(found, Dataset):
            remarks = tuple(dict.fromkeys((*remarks, *found.remarks)))
        return asked, scene, found, remarks

    def _tell_conversion(self, data: Dataset | PluginData, scene: Scene) -> None:
        """Record the error of the conversion in the shown quantities, once for the same quantities."""
        shown = quantities(scene), scene.time
        if isinstance(data, Dataset) and self._conversion[0] != shown:
            self._conversion = shown, tuple(remarks_on_conversion(data, scene))

    def _opened(self) -> Renderer:
        """The renderer, whose device is opened when it is first asked for."""
        if self._renderer is None:
            self._renderer = Renderer(self.device, self._progress, self.ranks)
        return self._renderer

    def _in_bricks(self, data: Dataset | PluginData, scene: Scene) -> Dataset | PluginData:
        """The elements that a picture depends on, where data are limited in memory, come in bricks, or are large."""
        if scene.memory is None and self._bricks is None:
            found = None if self._part else self._near.elements(data, scene)
        else:
            self._bricks = self._bricks or in_memory(data)
            found = self._bricks.elements(scene)
        if found is not self._drawn:
            self._drawn, self._quantities = found, ()
        return data if found is None else timed(found, scene.time)

    def _of_ranks(self, part: RankPart, scene: Scene) -> Dataset:
        """The elements that this rank's rows of a picture depend on; the renderer knows which rows."""
        renderer, wanted, self._quantities = self._opened(), quantities(scene), ()

        def glance(data: Dataset, small: Scene, bands: Bands) -> Bools:
            renderer.load(data, *wanted)
            return renderer.glance(small, RankRows(part.ranks, bands))

        with limited(scene.timeout):
            data, renderer.bands = RankPicture(part, scene, glance).elements()
        return data

    def _with_volume(self, data: Dataset | PluginData, scene: Scene) -> Renderer:
        """The renderer with all quantities of a scene, on the elements that have its field."""
        wanted = quantities(scene)
        known, renderer = self._quantities, self._opened()
        ghosts = self._deformed.ghosts(scene)
        is_known = known[:1] == wanted[:1] and set(wanted) <= set(known) and self._time == scene.time
        if is_known and self._ghosts == ghosts and self._copies == scene.copies:
            return renderer
        self._quantities, self._ghosts, self._copies = (), ghosts, scene.copies
        copied = CopiedData.of(scene, names_of(data))
        if isinstance(data, Dataset):
            renderer.load(data, *wanted, ghosts=ghosts, copied=copied)
        else:
            volume = volume_of(data, [*wanted, *copied.expressions])
            renderer.show(volume, data, copied=copied)
            # a runtime plugin's elements are tried first
            self._remarks = check_volume(data.name, volume, renderer)
        self._quantities, self._time = wanted, scene.time
        return renderer


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
