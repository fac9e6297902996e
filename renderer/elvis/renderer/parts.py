"""Pictures of data in parts: each part tells which of its elements matter, and these are drawn as all would be.

A cut, outer faces or an isosurface of n elements meet some n^(2/3) of them: so many go to all that draw, with
their numbers in the whole, and every stage works on them as it is.  No pixel is compared or merged, so that pictures
are the same to the byte, whatever the parts are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from elvis.core.dataset import Dataset
from elvis.core.portions.portion import Portion, unite
from elvis.core.ranks import Ranks
from elvis.plugins.opening import PluginData
from elvis.renderer.completing import completed, default_field, other_device
from elvis.renderer.relevance import Relevance, has_volumes
from elvis.scene import Scene
from elvis.scene.bare_mesh import of_mesh
from elvis.scene.errors import SceneError


@dataclass(frozen=True, eq=False)
class RankPart:
    """What one of several ranks has of data: elements of its part, of which each picture needs some.

    portion  those that pictures depend on
    beside   what the data have beside elements and what portions have
    """

    portion: Portion
    ranks: Ranks
    beside: Mapping[str, Any]

    @cached_property
    def dataset(self) -> Dataset:
        """Its elements alone."""
        return self.united([self.portion])

    def united(self, some: Sequence[Portion]) -> Dataset:
        """The elements of portions."""
        return replace(drawable(unite(some)), **self.beside)


def of_ranks(
    opened: dict[object, Dataset | PluginData | Portion], scenes: Mapping[object, Sequence[Scene]], ranks: Ranks
) -> dict[object, Dataset | RankPart]:
    """For each of several ranks, the elements of its part of data that scenes depend on; where they may depend on any,
    all that there are.

    opened  what each rank has opened, its part or all; emptied, so that what is all takes no memory any longer
    Raises SceneError for what a runtime plugin has opened, of whose elements nothing else is known.
    """
    found: dict[object, RankPart] = {}
    whole: dict[object, Portion] = {}
    for key in list(opened):
        data = opened.pop(key)
        if isinstance(data, PluginData):
            raise SceneError(f"one process draws what the plugin {data.name} opens: leave mpiexec out")
        own = data if isinstance(data, Portion) else Portion.of_whole(data, ranks.rank, ranks.size)
        dataset = data.dataset if isinstance(data, Portion) else data
        has_less, besides = is_local(dataset, own.is_even, scenes[key]), beside(dataset)
        del data, dataset
        own = what_matters(own, scenes[key]) if has_less else own
        found[key] = RankPart(own, ranks, besides)
        if not has_less:
            whole[key] = own
        del own
    every = ranks.exchange(whole, repr(scenes))
    return {key: part.united([some[key] for some in every]) if key in whole else part for key, part in found.items()}


def beside(dataset: Dataset) -> dict[str, Any]:
    """What a dataset has beside elements and what portions have."""
    return {"others": dataset.others, "shared": dataset.shared, "rates": dataset.rates}


def is_local(dataset: Dataset, even: bool, scenes: Sequence[Scene]) -> bool:
    """Whether scenes may depend on less than all elements; ``even``: the fields of the whole have the same ones."""
    if not even or any(other_device(scene.device) for scene in scenes):
        return False
    return all(Relevance(dataset, whole_scene(dataset, scene)).is_local for scene in scenes)


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
