"""Rendering of a dataset and a scene to a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from elvis.core.base.arrays import Bools
from elvis.core.base.memory import release_free_memory
from elvis.core.base.ranks import ALONE, Ranks
from elvis.core.base.terminal import Progress
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.geometry import share
from elvis.core.summary.picturing import Kind
from elvis.plugins.runtime.evaluation_service import check_volume
from elvis.plugins.runtime.opening import PluginData
from elvis.plugins.runtime.serving import names_of, volume_of
from elvis.renderer.asking.completing import arranged, kind_of, located, other_device, with_quantity
from elvis.renderer.asking.deformed_data import DeformedData
from elvis.renderer.asking.request import Request
from elvis.renderer.asking.requested_data import data_of
from elvis.renderer.asking.series_range import with_range
from elvis.renderer.flow.curves import draw_curves
from elvis.renderer.frame.canvas import is_exact
from elvis.renderer.frame.copied import CopiedData
from elvis.renderer.frame.copy_checks import CopyChecks
from elvis.renderer.frame.ghosts import check_ghosts
from elvis.renderer.frame.notes import note, remarks_on_conversion, remarks_on_derived
from elvis.renderer.frame.rank_pictures import RankPicture
from elvis.renderer.frame.renderer import Renderer
from elvis.renderer.parts.bands import Bands
from elvis.renderer.parts.bricks import Bricks, PictureData, in_memory, timed
from elvis.renderer.parts.near_cuts import NearCuts
from elvis.renderer.parts.parts import RankPart
from elvis.renderer.parts.rank_rows import RankRows
from elvis.scene import Camera, Copies, Scene
from elvis.scene.model.bare_mesh import REMARK, of_mesh
from elvis.scene.model.errors import SceneError
from elvis.scene.model.quantities import quantities, with_velocities
from elvis.scene.model.time_limit import limited
from elvis.scene.record.frame import Frame

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
        data: PictureData,
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

    def show(self, data: PictureData) -> None:
        """Take other data for the next pictures; the device stays."""
        if isinstance(data, Dataset) and isinstance(self.data, Dataset) and data.mesh is self.data.mesh:
            share(data.mesh)
        self._take(data)

    def _take(self, data: PictureData) -> None:
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
