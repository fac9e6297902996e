"""Pictures of data in parts: each part selects its relevant elements, and these are drawn as all would be.

A cut, outer faces or an isosurface of n elements meet some n^(2/3) of them: these go to all ranks that draw, with their
numbers in the whole, and every stage works on them without changes.  No pixels are compared or merged, so pictures are
the same to the byte for every partition.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import Ranks
from elvis.core.data.axis_planes import box_of
from elvis.core.data.dataset import Dataset
from elvis.core.portions.borrowing import BorrowedRates, borrowing
from elvis.core.portions.portion import Portion, unite
from elvis.core.quantities import Expression
from elvis.plugins.data.data import Opening, Reading, Report, open_data, open_part
from elvis.plugins.runtime.opening import PluginData
from elvis.renderer.asking.completing import completed, default_field, other_device
from elvis.renderer.asking.request import asked_by
from elvis.renderer.parts.relevance import Relevance, has_volumes
from elvis.scene import Scene, Streamlines
from elvis.scene.model.bare_mesh import of_mesh
from elvis.scene.model.errors import SceneError
from elvis.scene.model.middle_planes import with_middles

_NONE = np.empty(0, np.int64)
#: what a rank has opened
Opened: TypeAlias = Dataset | PluginData | Portion


@dataclass(frozen=True, eq=False)
class RankPart:
    """A rank's part of the data: its elements, some of which each picture needs.

    portion  elements on which pictures depend, with all fields that they evaluate
    beside   other attributes of the data, of which only the names count
    corners  (2, 3) of the box of all ranks' elements
    """

    portion: Portion
    ranks: Ranks
    beside: Mapping[str, Any]
    corners: Floats

    @cached_property
    def dataset(self) -> Dataset:
        """Its elements alone."""
        return self.united([self.portion])

    def united(self, some: Sequence[Portion]) -> Dataset:
        """The elements of portions."""
        return replace(drawable(unite(some)), **self.beside)

    def timed(self, time: float | None) -> RankPart:
        """The data with the time that a scene gives, unless they are a moment of a series."""
        if time is None or self.beside["rates"] is not None or self.portion.dataset.time == time:
            return self
        dataset = replace(self.portion.dataset, time=time)
        return replace(self, portion=replace(self.portion, dataset=dataset))


def of_ranks(
    opened: dict[object, Opened],
    scenes: Mapping[object, Sequence[Scene]],
    ranks: Ranks,
    *,
    for_others: bool = False,
) -> dict[object, Dataset | RankPart]:
    """For each of several ranks, the elements of its part of data on which scenes depend, or all if they may need any.

    Data that a rank has opened whole stay whole.

    opened  each rank's opened data, a part or all; emptied, so that they are freed
    for_others  whether other scenes with the same quantities will be drawn, so that all elements of the part stay
    Raises SceneError for data opened by a runtime plugin, as nothing more is known of its elements.
    """
    found: dict[object, Dataset | RankPart] = {}
    whole: dict[object, Portion] = {}
    for key in list(opened):
        data = opened.pop(key)
        if isinstance(data, PluginData):
            raise SceneError(f"data opened by the plugin {data.name} are drawn by one process: run without mpiexec")
        if isinstance(data, Dataset):
            found[key] = data
            continue
        corners = _corners(data, ranks)
        placed = _placed(scenes[key], corners)
        own = data
        del data
        has_less = is_local(own.dataset, own.is_even, placed)
        own = borrowing(own, _evaluated(own.dataset, placed), ranks)
        besides = _names_beside(own)
        if has_less and not for_others:
            own = what_matters(own, placed)
        found[key] = RankPart(own.alone, ranks, besides, corners)
        if not has_less:
            whole[key] = _with_others(own)
        del own
    every = ranks.exchange(whole, repr(scenes))
    for key, part in found.items():
        if isinstance(part, RankPart) and key in whole:
            found[key] = _whole(part, [some[key] for some in every])
    return found


def whole_of(part: Portion, texts: Sequence[str], ranks: Ranks) -> Dataset:
    """The complete data of all ranks' parts, with all inputs of quantities."""
    corners = _corners(part, ranks)
    part = borrowing(part, texts, ranks)
    every = ranks.exchange(_with_others(part), f"all elements for {', '.join(texts)}")
    return _whole(RankPart(part.alone, ranks, _names_beside(part), corners), every)


def _placed(scenes: Sequence[Scene], corners: Floats) -> list[Scene]:
    """Scenes with planes through the middle of data whose box has these corners (2, 3)."""
    return [with_middles(scene, lambda: corners) for scene in scenes]


def _corners(part: Portion, ranks: Ranks) -> Floats:
    """(2, 3) corners of the box of all ranks' parts; a part may have no elements."""
    own = box_of(part.dataset) if len(part.dataset.mesh.vertices) else None
    every = [box for box in ranks.exchange(own, "box of the data") if box is not None]
    return np.stack([np.min([box[0] for box in every], axis=0), np.max([box[1] for box in every], axis=0)])


def _with_others(part: Portion) -> Portion:
    """A rank's part of data and of others, in the form that is sent to all."""
    return replace(part.alone, others={name: other.alone for name, other in part.others.items()})


def _whole(part: RankPart, every: Sequence[Portion]) -> Dataset:
    """The complete data from all ranks' parts, with the complete other datasets."""
    others = part.beside["others"]
    for name, other in others.items():
        own = drawable(unite([portion.others[name] for portion in every]))
        others = {**others, name: replace(own, **beside(other))}
    return replace(part.united(every), others={}, shared={}).with_others(**others)


def _names_beside(part: Portion) -> dict[str, Any]:
    """Attributes of data in addition to a complete part: only names, so that the rest is freed."""
    dataset = part.dataset
    others = {
        name: replace(other.of(_NONE).dataset, rates=BorrowedRates.of(other.dataset))
        for name, other in part.others.items()
    }
    return {**beside(dataset), "others": others, "rates": BorrowedRates.of(dataset)}


def opening_for_ranks(scenes: Sequence[Scene], ranks: Ranks) -> Opening[Opened]:
    """Function that opens a rank's part of files for pictures of scenes, or all if these need that."""

    def opening(paths: Sequence[Path], reading: Reading, report: Report) -> Opened:
        return open_part(paths, replace(reading, ranks=ranks), report)

    return opening if comes_in_parts(scenes) else open_data


def comes_in_parts(scenes: Sequence[Scene]) -> bool:
    """Whether ranks may read parts of the data of scenes: no lines pass through steps of a series."""
    items = [item for each in scenes for item in each.every_object]
    return not any(isinstance(item, Streamlines) and item.since is not None for item in items)


def beside(dataset: Dataset) -> dict[str, Any]:
    """Attributes of a dataset in addition to its elements and the attributes of portions."""
    return {name: getattr(dataset, name) for name in ("others", "shared", "rates", "surfaces")}


def is_local(dataset: Dataset, even: bool, scenes: Sequence[Scene]) -> bool:
    """Whether scenes may depend on less than all elements; ``even``: the fields of the whole have the same ones."""
    if not even or any(other_device(scene.device) for scene in scenes):
        return False
    return all(Relevance(dataset, whole_scene(dataset, scene)).is_local for scene in scenes)


def _evaluated(dataset: Dataset, scenes: Sequence[Scene]) -> list[str]:
    """All that scenes of the whole evaluate, but for what says nothing, which shows when it is drawn."""
    found = []
    for text in asked_by([whole_scene(dataset, scene) for scene in scenes]):
        with suppress(ElvisError):
            Expression.of(dataset, text)
            found.append(text)
    return found


def what_matters(portion: Portion, scenes: Sequence[Scene]) -> Portion:
    """The elements of a portion that scenes of the whole depend on."""
    if any(has_volumes(scene) for scene in scenes):
        return portion
    dataset = drawable(portion)
    found = [Relevance(dataset, whole_scene(dataset, scene)).ids() for scene in scenes]
    return portion.of(np.unique(np.concatenate(found)))


def drawable(portion: Portion) -> Dataset:
    """The dataset of a portion, without blocks that have no elements."""
    dataset = portion.dataset
    fields = (replace(own, blocks=tuple(block for block in own.blocks if len(block))) for own in dataset.fields)
    return replace(dataset, fields=tuple(fields))


def whole_scene(dataset: Dataset, scene: Scene) -> Scene:
    """The scene with its field and its objects."""
    if not scene.field and not dataset.solution:
        scene = of_mesh(scene)
    return completed(dataset, scene if scene.field else replace(scene, field=default_field(dataset)))
