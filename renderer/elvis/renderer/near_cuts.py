"""Large data of which a first picture loads only the elements that its cuts and faces may show.

A cut or the boundary of n elements meets some n^(2/3) of them.  Boxes of elements are found several times faster than
all that kernels need of them, so a single picture takes a fraction of the time and the memory.  Whoever draws another
cut probably draws more: all elements are loaded for it.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace
from operator import is_

from elvis.core.dataset import Dataset
from elvis.core.portions.portion import Portion, is_even, knows_inner_sides
from elvis.plugins.opening import PluginData
from elvis.renderer.completing import other_device
from elvis.renderer.parts import beside, drawable, is_local, whole_scene
from elvis.renderer.relevance import Relevance
from elvis.scene import Scene

#: bytes of coefficients from which on data are large
LARGE = 1 << 27
#: part of all elements beyond which all are loaded
_MOST = 0.75


class NearCuts:
    """The elements that the first picture on a device depends on, if boxes and sides of elements decide."""

    def __init__(self, device: str = "auto") -> None:
        self._device = device
        #: what the first picture was drawn of, what its elements depend on, and these, None for all
        self._first: tuple[tuple[object, ...], Hashable, Dataset | None] | None = None

    def elements(self, dataset: Dataset | PluginData, scene: Scene) -> Dataset | None:
        """The elements for a picture, the same object if another camera shows the same ones; None for all."""
        is_known_whole = self._first is not None and self._first[2] is None
        if is_known_whole or isinstance(dataset, PluginData) or other_device(self._device) is not None:
            return None
        source = dataset.mesh, *dataset.fields
        if not _is_large(dataset) or scene.copies or dataset.others:
            self._first = source, None, None
            return None
        relevance = Relevance(dataset, whole_scene(dataset, scene))
        key = relevance.decided_by, relevance.shown_by
        if self._first is None:
            self._first = source, key, _few(dataset, relevance)
        known, known_key, found = self._first
        is_same = len(known) == len(source) and all(map(is_, known, source)) and known_key == key
        if not is_same:
            self._first = known, None, None
        return found if is_same else None


def _is_large(dataset: Dataset) -> bool:
    """Whether loading all of a dataset takes seconds."""
    return sum(block.coefficients.nbytes for own in dataset.fields for block in own.blocks) >= LARGE


def _few(dataset: Dataset, relevance: Relevance) -> Dataset | None:
    """The elements that a picture depends on; None if boxes and sides don't decide, or most are needed."""
    is_known = knows_inner_sides(dataset) and is_local(dataset, is_even(dataset), [relevance.scene])
    if not is_known or not relevance.is_by_boxes:
        return None
    ids = relevance.ids()
    if len(ids) > _MOST * dataset.mesh.count:
        return None
    return replace(drawable(Portion.whole(dataset).of(ids)), **beside(dataset))
