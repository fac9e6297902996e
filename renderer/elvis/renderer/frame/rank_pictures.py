"""Pictures drawn by several ranks, each of which draws a band of rows.

Each rank sends the elements of its part of the data that may be visible in a band to the rank that draws it: none has
more than its part and its band's elements.

Three steps: elements that decide global properties of the picture go to all; the view is found, by small pictures that
are also drawn in bands; all count how many of their elements reach into which rows, which determines the ends of bands,
and send them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.boxes import Boxes
from elvis.core.portions.portion import Portion, unite
from elvis.renderer.frame.shading import radius_of_lines
from elvis.renderer.parts.bands import Bands, counts_by_row, rows_reached
from elvis.renderer.parts.parts import RankPart
from elvis.renderer.parts.relevance import Relevance
from elvis.renderer.raster.tiles import TILE
from elvis.renderer.volume.device_volume import greatest_of
from elvis.scene import Scene
from elvis.scene.cameras.fitting import automatic
from elvis.scene.cameras.view import view_of

#: draws a rank's rows of a small picture: a dataset, its scene and the bands to (h, w) where something is seen
Glance: TypeAlias = Callable[[Dataset, Scene, Bands], Bools]


class RankPicture:
    """One picture, before it is drawn."""

    def __init__(self, part: RankPart, scene: Scene, glance: Glance) -> None:
        self._part, self._ranks, self._scene, self._glance = part, part.ranks, scene, glance
        relevance = Relevance(part.dataset, scene)
        deciding = relevance.deciding()
        every = self._ranks.exchange(part.portion.of(deciding), "the elements that decide a picture's view and ranges")
        self._deciding = unite(every)
        boxes_of_all = Relevance(part.united([self._deciding]), scene).boxes()
        self._greatest = max(greatest_of(some) for some in boxes_of_all)
        ids, boxes = relevance.shown()
        own = ~np.isin(ids, deciding)
        self._ids, self._of_ids = ids[own], boxes[own]

    def elements(self) -> tuple[Dataset, Bands]:
        """The elements that this rank's rows depend on, and who draws which rows; raises SceneError as `automatic`."""
        asked = automatic(self._scene, self._boxes(), self._seen, self._extent)
        return self._dealt(asked)

    def _boxes(self) -> list[Boxes]:
        """Boxes of deciding elements, by the volume's parts; a single plane adds the elements that it meets."""
        plane = self._scene.only_plane
        some = [self._deciding, self._part.portion.of(self._ids)] if plane else [self._deciding]
        return Relevance(self._part.united(some), self._scene).boxes()

    def _extent(self, own: Floats) -> Floats:
        """The combined visible extent of all ranks."""
        every = np.array(self._ranks.exchange(own, "visible parts of boxes"))
        return np.stack([every[:, 0].min(axis=0), every[:, 1].max(axis=0)])

    def _seen(self, small: Scene) -> Bools:
        """(h, w) where something is seen in a small picture."""
        dataset, bands = self._dealt(small)
        rows = self._glance(dataset, small, bands)
        return np.concatenate(self._ranks.exchange(rows, "a glance's rows"))

    def _dealt(self, scene: Scene) -> tuple[Dataset, Bands]:
        """The elements that this rank's rows of a picture depend on, sent by all, and who draws which rows."""
        view, size = view_of(scene), self._ranks.size
        # far from the origin or not: a pixel more or less
        around = -(-radius_of_lines(scene, is_far=True) // TILE) * TILE
        rows = rows_reached(view, self._of_ids, around, self._greatest)
        every = self._ranks.exchange(counts_by_row(view, rows), "how many elements reach into rows")
        bands = Bands.sharing(view, np.sum(every, axis=0), size)
        held = [self._ids[bands.reached(rows, number)] for number in range(size)]
        found = self._ranks.alltoall(_cut(self._part.portion, held), "the elements of rows")
        return self._part.united([self._deciding, *(some for some in found if some is not None)]), bands


def _cut(portion: Portion, ids: Sequence[Ints]) -> list[Portion | None]:
    """The elements of a portion with ids (n,) for each band, None for bands without any.

    Halves are cut first, and bands from these: elements outside common ranges are then processed only a few times.
    """
    every = np.unique(np.concatenate(ids))
    if not len(every):
        return [None] * len(ids)
    own, half = portion.of(every), len(ids) // 2
    return [own] if len(ids) == 1 else [*_cut(own, ids[:half]), *_cut(own, ids[half:])]
