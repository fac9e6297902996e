"""Moving pictures: the scenes of all frames, from times, from keys of the scene, and from an orbit of the camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np

from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.base.ranks import ALONE, Ranks
from elvis.core.base.terminal import warn
from elvis.core.data.dataset import Dataset
from elvis.core.data.moments import Moment
from elvis.core.portions import Portion
from elvis.core.quantities import Expression, Names
from elvis.plugins.series.series import Series, series_in
from elvis.plugins.series.step_names import expanded
from elvis.renderer.asking.request import reading_for
from elvis.renderer.film.motions import Motion
from elvis.renderer.frame.rendering import Pictures
from elvis.renderer.parts.bricks import Bricks, PictureData, opening_for
from elvis.renderer.parts.parts import Opened, comes_in_parts, of_ranks, opening_for_ranks
from elvis.scene import Camera, Scene
from elvis.scene.commandline.composing import with_settings
from elvis.scene.model.errors import AbsentError, SceneError
from elvis.scene.record.frame import Frame

Read = TypeVar("Read")
#: a scene and the file of its picture
Shot: TypeAlias = tuple[Scene, Path]


def scenes_of(base: Scene, moments: Sequence[Moment], keys: Sequence[Motion]) -> list[Scene]:
    """The scene of each frame: one for each moment."""
    count = len(moments)
    found = []
    for number, moment in enumerate(moments):
        scene = replace(base, step=moment.step, time=moment.time)
        found.append(with_settings(scene, tuple(key.of_frame(number, count) for key in keys), "--key"))
    return found


def orbited(camera: Camera, degrees: float) -> Camera:
    """The camera turned about the upward direction through the place that it looks at, by Rodrigues' formula."""
    axis = np.array(camera.up, np.float64) / np.linalg.norm(camera.up)
    arm = np.subtract(camera.eye, camera.at)
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    turned = arm * cosine + np.cross(axis, arm) * sine + axis * (axis @ arm) * (1 - cosine)
    eye = np.add(camera.at, turned).tolist()
    return replace(camera, eye=(eye[0], eye[1], eye[2]))


class Film:
    """The data of a scene, found once, and its pictures at one moment after another; data are read when drawn.

    series  the steps that the files are, None where they are one state
    scene   that it was opened with
    files   that this names
    ranks   that draw each picture together, each of its part of the data; the first one writes
    """

    def __init__(self, scene: Scene, is_kept: bool, ranks: Ranks = ALONE) -> None:
        if not scene.data:
            raise SceneError("the scene names no data; also give the mesh and field files")
        self.scene, self.ranks = scene, ranks
        self.files = expanded(tuple(map(Path, scene.data)))
        self._reading = replace(reading_for([scene], is_kept), ranks=ranks if comes_in_parts([scene]) else ALONE)
        self.series: Series | None = series_in(self.files, self._reading)
        self._is_in_parts = self._reading.ranks.size > 1
        self._texts, self._field = self._reading.quantities, scene.field
        self._device = scene.device
        self._pictures: Pictures | None = None
        self._moment: Moment | None = None
        self._folded: set[float] = set()
        # a single thread reads steps: the next one, while a picture is drawn
        self._reader = ThreadPoolExecutor(1, "elvis-reading")
        self._next: tuple[Moment, Future[Dataset | None]] | None = None

    def __enter__(self) -> Film:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def open(self) -> None:
        """Read the data, unless that is done, or they are a series; raises what reading raises."""
        if self.series is None and self._pictures is None:
            several = self.ranks.size > 1
            opening = opening_for_ranks([self.scene], self.ranks) if several else opening_for([self.scene])
            self._show(opening(self.files, self._reading, warn), Moment())

    def close(self) -> None:
        """Give the device back."""
        self._reader.shutdown(cancel_futures=True)
        if self._pictures is not None:
            self._pictures.close()

    @property
    def told(self) -> tuple[str, ...]:
        """Remarks of the series on the steps that were read, and one on deformations that fold elements."""
        told = () if self.series is None else self.series.told
        if not self._folded:
            return told
        nearest = min(self._folded, key=abs)
        frames = f"at {len(self._folded)} of the scales" if len(self._folded) > 1 else "at one of the scales"
        limit = "elvis info --largest-scale prints the largest valid one"
        return (*told, f"elements are inverted or folded {frames}, the nearest to 0 is {nearest:g}; {limit}")

    def write(self, shots: Sequence[Shot]) -> Iterator[Path]:
        """Write frames one after another; the file of each, once it is there or its step turns out to be damaged."""
        following = [scene for scene, _ in shots[1:]]
        for (scene, path), after in zip(shots, [*following, None], strict=False):
            frame = self.draw(scene, after)
            if frame is not None and not self.ranks.rank:
                frame.save(path, plain=scene.plain)
            yield path

    def draw(self, scene: Scene, following: Scene | None = None) -> Frame | None:
        """The picture that ``elvis render`` draws of a scene; the data of the ``following`` one are read meanwhile.

        None for a step that can't be read, lacks the quantities, or shows nothing: the faults of the series report it.
        """
        pictures = self._shown(scene, following)
        try:
            return None if pictures is None else self._pictured(pictures, scene)
        except AbsentError as error:
            if self.series is None:
                raise
            self._pass_over(self.series, scene.moment, str(error))
            return None

    def _pictured(self, pictures: Pictures, scene: Scene) -> Frame:
        """The picture of a scene; scales at which its deformation folds elements are noted."""
        frame = pictures.draw(scene)
        deformation = frame.stats.get("deformation", {})
        if deformation.get("folds"):
            self._folded.add(deformation["scale"])
        return frame

    def first_camera(self, scenes: Sequence[Scene]) -> Camera:
        """The camera of the picture of the first of some scenes whose step can be read; FormatError where none can."""
        for scene in scenes:
            pictures = self._shown(scene)
            if pictures is not None:
                return self.ranks.exchange(pictures.camera(scene), "the camera of an animation")[0]
        raise FormatError(f"expected a step that can be read, found none among {len(scenes)}", file=self.files[0])

    def _shown(self, scene: Scene, following: Scene | None = None) -> Pictures | None:
        """Pictures of the data of a scene, None as of `draw`."""
        self.open()
        is_read = self.series is None or scene.moment == self._moment
        data = None if self.series is None or is_read else self._at(self.series, scene.moment)
        self._expect(following)
        if not is_read and (data is None or self._lacks_fields(scene.moment, data)):
            return None
        if data is not None:
            self._show(data, scene.moment)
        assert self._pictures is not None  # data are shown
        return self._pictures

    def _expect(self, following: Scene | None) -> None:
        """Begin to read the data of the following scene, unless that is done."""
        if self.series is None or following is None or following.moment == self._moment or self.ranks.size > 1:
            self._next = None
        elif self._next is None or self._next[0] != following.moment:
            self._next = following.moment, self._begun(self.series, following.moment)

    def _at(self, series: Series, moment: Moment) -> Dataset | Portion | None:
        """The data of a moment; None if its step can't be read.

        Ranks, which have to agree on it, read nothing while a picture is drawn.
        """
        if self._is_in_parts:
            return _unless_damaged(series, moment, series.part_at)
        return self._begun(series, moment).result()

    def _begun(self, series: Series, moment: Moment) -> Future[Dataset | None]:
        """The complete data of a moment: the ones that are being read, if they match."""
        if self._next is not None and self._next[0] == moment:
            return self._next[1]
        return self._reader.submit(_unless_damaged, series, moment, series.at_moment)

    def _lacks_fields(self, moment: Moment, data: Dataset | Portion) -> bool:
        """Whether data lack what the animation shows; SceneError if no step was shown and the last does too."""
        lack = self._lack(data)
        if not lack or self.series is None:
            return False
        if self._pictures is None and (last := self._at(self.series, Moment())) and self._lack(last):
            raise SceneError(lack)
        self._pass_over(self.series, moment, lack)
        return True

    @staticmethod
    def _pass_over(series: Series, moment: Moment, why: str) -> None:
        """Let the faults of the series say that a moment has no frame."""
        place = f"time {moment.time:.10g}" if moment.step is None else f"step {moment.step}"
        series.faults.append(f"{place} has no frame: {why.partition(';')[0]}")

    def _lack(self, data: Dataset | Portion) -> str:
        """Message on missing quantities of the animation, by default its first field; empty if none is missing."""
        names = Names.of(data.dataset if isinstance(data, Portion) else data)
        self._field = self._field or next(iter(names.fields), "")
        try:
            for text in filter(None, (text or self._field for text in self._texts)):
                Expression.parse(text, names)
        except ElvisError as error:
            return str(error)
        return ""

    def _show(self, data: Opened | Bricks, moment: Moment) -> None:
        """Take the data of a moment."""
        self._moment = moment
        shown = self._of_ranks(data)
        if self._pictures is None:
            self._pictures = Pictures(shown, self._device, ranks=self.ranks)
        else:
            self._pictures.show(shown)

    def _of_ranks(self, data: Opened | Bricks) -> PictureData:
        """The data from which a rank draws, for all scenes of the animation, which differ only in numbers."""
        if isinstance(data, Portion) or (self.ranks.size > 1 and not isinstance(data, Bricks)):
            return of_ranks({None: data}, {None: [self.scene]}, self.ranks, for_others=True)[None]
        return data


def _unless_damaged(series: Series, moment: Moment, read: Callable[[Moment], Read]) -> Read | None:
    """The data of a moment; None if its step can't be read."""
    is_damaged = moment.step is not None and bool(series.fault(moment.step))
    return None if is_damaged else read(moment)
