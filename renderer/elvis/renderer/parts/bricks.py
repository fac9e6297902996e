"""Data that are processed brick by brick: results of each are cached, so that the next picture reads few of them.

Bricks have some tens of elements and are ranges along a curve.  A first picture reads all, as many at a time as memory
allows, and stores the box of each, the bounds of its values, and whether it has faces that words choose.  Later
pictures read only bricks in which something may be visible, and process their elements.  Elements that decide global
properties of a picture, such as ranges over all, are cached for all pictures with the same dependencies.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints, rows_of
from elvis.core.base.memory import peak_memory, size_text
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.boxes import Boxes
from elvis.core.portions.partition import numbers_along_curve
from elvis.core.portions.portion import Portion, unite
from elvis.core.shapes import Shape
from elvis.core.validity.folded import Folded, folded
from elvis.formats.nektar.dataset_parts import DatasetParts
from elvis.formats.nektar.mapped_files import mapped
from elvis.plugins.data.data import Opening, Reading, Report, open_data, open_parts
from elvis.plugins.runtime.opening import PluginData
from elvis.renderer.parts.near_boxes import meets
from elvis.renderer.parts.parts import RankPart, beside, drawable, is_local, whole_scene
from elvis.renderer.parts.relevance import Looked, Relevance, has_volumes
from elvis.scene import CutSurface, Implicit, Scene
from elvis.scene.model.errors import SceneError

#: memory of elements while they are drawn, on the host and on a device, relative to their coefficients
_TIMES = 4
#: elements of a brick, about
ELEMENTS = 64


class Source(Protocol):
    """Data that can be had in parts.

    whole  all of them, at least the ids of the elements
    """

    whole: Dataset

    @property
    def bytes(self) -> int:
        """How much memory the arrays of all take."""

    @property
    def corners(self) -> Floats:
        """(2, 3) minimum and maximum coordinates of vertices and of points of curves."""

    def numbers(self, count: int) -> Mapping[Shape, NDArray[Any]]:
        """For each shape of the elements (n,) which of ``count`` parts each is in."""

    def of(self, chosen: Bools) -> Portion:
        """Some of the parts together, (count,) which."""


class InMemory:
    """A dataset that is at hand."""

    def __init__(self, dataset: Dataset) -> None:
        self.whole, self._portion = dataset, Portion.whole(dataset)
        self._numbers: dict[int, dict[Shape, Ints]] = {}

    @property
    def bytes(self) -> int:
        """See `Source`."""
        return self._portion.bytes

    @property
    def corners(self) -> Floats:
        """See `Source`."""
        return self.whole.mesh.corners

    def numbers(self, count: int) -> Mapping[Shape, Ints]:
        """See `Source`."""
        if count not in self._numbers:
            self._numbers = {count: numbers_along_curve(self.whole, count)}
        return self._numbers[count]

    def of(self, chosen: Bools) -> Portion:
        """See `Source`."""
        numbers, elements = self.numbers(len(chosen)), self.whole.mesh.elements
        return self._portion.of(np.concatenate([elements[shape].ids[chosen[own]] for shape, own in numbers.items()]))


@dataclass(eq=False)
class Digest:
    """Cached facts about bricks.

    boxes   (count, 6) that contain their elements
    ends    by quantity (count, 2) bounds of the values that its elements may show
    chosen  by word (count,) which have faces that it chooses
    """

    boxes: Boxes
    ends: dict[str, Floats] = field(default_factory=dict)
    chosen: dict[str, Bools] = field(default_factory=dict)

    @staticmethod
    def of(count: int) -> Digest:
        """The facts of bricks before any was processed."""
        return Digest(np.tile(np.array([np.inf] * 3 + [-np.inf] * 3, np.float32), (count, 1)))

    def note(self, looked: Looked, bricks: Ints) -> None:
        """Include the findings on elements of these bricks (n,)."""
        _widen(self.boxes, bricks, looked.boxes)
        for name, ends in looked.ends.items():
            _widen(self.ends.setdefault(name, np.tile([np.inf, -np.inf], (len(self.boxes), 1))), bricks, ends)
        for word, mask in looked.chosen.items():
            self.chosen.setdefault(word, np.zeros(len(self.boxes), bool))[bricks[mask]] = True

    def joined(self, other: Digest) -> Digest:
        """The facts of both: other quantities and words of the same bricks."""
        return Digest(self.boxes, {**self.ends, **other.ends}, {**self.chosen, **other.chosen})

    def knows(self, relevance: Relevance) -> bool:
        """Whether it suffices to decide where something of a scene may be visible."""
        names = {name for name, _ in relevance.levels()}
        return names <= self.ends.keys() and set(relevance.words) <= self.chosen.keys()

    def shown(self, relevance: Relevance) -> Bools:
        """(count,) bricks in which something of the scene may be shown."""
        scene = relevance.scene
        mask, held = np.zeros(len(self.boxes), bool), self.boxes[:, 0] < np.inf
        for name, value in relevance.levels():
            low, high = self.ends[name].T
            mask |= (low <= value) & (value <= high)
        for word in relevance.words:
            mask |= self.chosen[word]
        for item in scene.every_object:
            if isinstance(item, CutSurface) and not isinstance(item.surface, Implicit):
                mask[held] |= meets(item.surface, self.boxes[held])
        return mask


class Bricks:
    """Data whose pictures are limited to a scene's memory.

    source  gives them in parts
    whole   gives all of them, if they fit, or if a picture depends on all
    """

    def __init__(self, source: Source, whole: Callable[[], Dataset]) -> None:
        self._source, self._open = source, whole
        self._count = -(-source.whole.mesh.count // ELEMENTS)
        self._time: float | None = None
        self._digest: Digest | None = None
        self._deciding: dict[Hashable, Portion] = {}
        #: elements that fold, known after the first picture
        self._folded = Folded.joined([])
        #: what the last picture depended on, how many bytes of elements, and these
        self._last: tuple[Hashable, int, Dataset] | None = None

    @cached_property
    def whole(self) -> Dataset:
        """All data, kept from when they are first requested."""
        return self._open()

    @property
    def corners(self) -> Floats:
        """(2, 3) minimum and maximum coordinates of all vertices and points of curves."""
        return self._source.corners

    @cached_property
    def dataset(self) -> Dataset:
        """A few of the elements, for names and kinds."""
        return replace(drawable(self._head), **beside(self._source.whole))

    @cached_property
    def _head(self) -> Portion:
        """The first brick that has elements."""
        first = min(int(own.min()) for own in self._source.numbers(self._count).values() if len(own))
        return self._source.of(np.arange(self._count) == first)

    def elements(self, scene: Scene) -> Dataset:
        """The elements on which a scene depends; all, if they fit into its memory, or if any may count.

        The same object as before if another camera shows the same elements.  SceneError if they need more memory.
        """
        memory = np.inf if scene.memory is None else scene.memory
        needed = _TIMES * self._source.bytes
        if needed <= memory:
            return self.whole
        self._take_time(scene)
        head = self._timed(self.dataset)
        relevance = Relevance(head, whole_scene(head, scene))
        if has_volumes(scene) or relevance.borrows or not is_local(head, self._head.is_even, [scene]):
            raise _too_much(needed, "all elements, which this picture needs", memory)
        key = relevance.decided_by, relevance.shown_by
        if self._last is None or self._last[0] != key:
            self._last = None
            found = self._found(relevance, int(np.ceil(needed / memory)))
            dataset = replace(drawable(found), **beside(self._source.whole))
            remarks = dict.fromkeys((*dataset.remarks, *self._folded.sentences()))
            self._last = key, found.bytes, replace(dataset, remarks=tuple(remarks))
        _, size, dataset = self._last
        if _TIMES * size > memory:
            raise _too_much(_TIMES * size, "the elements that the picture depends on", memory)
        return dataset

    def _found(self, relevance: Relevance, count: int) -> Portion:
        """The elements that a scene depends on; ``count`` times fewer than all are read at once.

        relevance  of the scene, for a few elements
        """
        scene, key, known = relevance.scene, relevance.decided_by, self._digest
        if known is not None and known.knows(relevance) and key in self._deciding:
            read = self._read(np.flatnonzero(known.shown(relevance)), count)
            shown = (portion.of(Relevance(drawable(portion), scene).shown()[0]) for portion in read)
            return unite([self._deciding[key], *shown])
        digest, found, deciding = Digest.of(self._count), list[Portion](), list[Portion]()
        invalid: list[Folded] = []
        for portion in self._read(np.arange(self._count), count):
            own = Relevance(drawable(portion), scene)
            invalid.append(folded(portion.dataset))
            for looked in own.looked_at():
                digest.note(looked, self._bricks_of(portion, looked.ids))
            deciding.append(portion.of(own.deciding()))
            found += [deciding[-1], portion.of(own.shown()[0])]
        self._folded = Folded.joined(invalid)
        self._digest = digest if known is None else known.joined(digest)
        self._deciding[key] = unite(deciding)
        return unite(found)

    def _take_time(self, scene: Scene) -> None:
        """Forget what depends on another time."""
        if scene.time != self._time:
            self._time, self._digest, self._last = scene.time, None, None
            self._deciding.clear()

    def _timed(self, dataset: Dataset) -> Dataset:
        """The data at the time of the scene, as `Pictures.draw` gives it to all of one state."""
        return timed(dataset, self._time) if self._source.whole.rates is None else dataset

    def _read(self, bricks: Ints, count: int) -> Iterator[Portion]:
        """The elements of bricks (n,), as many bricks at once as a part is that ``count`` make the whole of."""
        at_once = max(1, self._count // count)
        for start in range(0, len(bricks), at_once):
            chosen = np.zeros(self._count, bool)
            chosen[bricks[start : start + at_once]] = True
            portion = self._source.of(chosen)
            yield replace(portion, dataset=self._timed(portion.dataset))

    def _bricks_of(self, portion: Portion, ids: Ints) -> Ints:
        """(n,) the brick of each of the elements with these ids (n,) of a portion."""
        numbers, elements = self._source.numbers(self._count), portion.dataset.mesh.elements
        every = np.concatenate([own.ids for own in elements.values()])
        bricks = np.concatenate([numbers[shape][portion.rows[shape]] for shape in elements]).astype(np.int64)
        return np.asarray(bricks[rows_of(every, ids)])


#: what pictures are drawn from
PictureData: TypeAlias = Dataset | PluginData | RankPart | Bricks


def opening_for(scenes: Sequence[Scene]) -> Opening[Dataset | PluginData | Bricks]:
    """Function that opens files that are only used for pictures of scenes: in bricks if all limit their memory."""
    return _open_bricks if all(scene.memory is not None for scene in scenes) else open_data


def _open_bricks(paths: Sequence[Path], reading: Reading, report: Report) -> Dataset | PluginData | Bricks:
    """The data of `open_data`, in bricks if the files are native and one state; HDF5 must not change meanwhile."""
    with mapped():
        opened = open_parts(paths, reading, report)
    if not isinstance(opened, DatasetParts):
        return opened

    def whole() -> Dataset:
        found = open_data(paths, reading, report)
        assert isinstance(found, Dataset)  # no plugin has opened the files
        return found

    return Bricks(opened, whole)


def in_memory(data: Dataset | PluginData) -> Bricks:
    """Bricks of data in memory; SceneError for the data of a runtime plugin."""
    if isinstance(data, PluginData):
        raise SceneError(f"memory: data opened by the plugin {data.name} cannot be read in bricks: remove this setting")
    return Bricks(InMemory(data), lambda: data)


def peak_note(scene: Scene) -> str:
    """The memory of the whole process next to what a scene allows its elements; empty where it allows any."""
    peak = peak_memory()
    if scene.memory is None or peak is None:
        return ""
    budget = size_text(scene.memory)
    return f"memory: the process took up to {size_text(peak)}; the {budget} of --memory only limit elements"


def timed(dataset: Dataset, time: float | None) -> Dataset:
    """The data with the time that a scene gives, unless they are a moment of a series."""
    return dataset if time is None or dataset.rates is not None else replace(dataset, time=time)


def _too_much(needed: float, whose: str, memory: float) -> SceneError:
    return SceneError(f"memory: expected at least {size_text(needed)} for {whose}, found {size_text(memory)}")


def _widen(ranges: NDArray[Any], rows: Ints, found: NDArray[Any]) -> None:
    """Extend ranges (n, 2 k), low and high corners, by the ranges (m, 2 k) found for these of their rows (m,)."""
    if not len(rows):
        return
    order = np.argsort(rows, kind="stable")
    starts = np.flatnonzero(np.append(True, np.diff(rows[order]) > 0))
    own, half = rows[order[starts]], ranges.shape[1] // 2
    low, high = found[order, :half], found[order, half:]
    ranges[own, :half] = np.minimum(ranges[own, :half], np.minimum.reduceat(low, starts))
    ranges[own, half:] = np.maximum(ranges[own, half:], np.maximum.reduceat(high, starts))
