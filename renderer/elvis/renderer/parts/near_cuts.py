"""First pictures of large data: only the elements near the cuts and faces are loaded.

A cut or the boundary of n elements meets about n^(2/3) of them.  Bounding boxes are computed several times faster than
the buffers of kernels, so a single picture takes a fraction of the time and the memory.  A second picture with other
cuts loads all elements, because more such pictures probably follow.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace
from operator import is_

from elvis.core.data.dataset import Dataset
from elvis.core.portions.portion import Portion, is_even, knows_inner_sides
from elvis.plugins.runtime.opening import PluginData
from elvis.renderer.asking.completing import other_device
from elvis.renderer.parts.parts import beside, drawable, is_local, whole_scene
from elvis.renderer.parts.relevance import Relevance
from elvis.scene import Scene

#: bytes of the coefficients of a field from which on data are large
LARGE = 1 << 25
#: part of all elements beyond which all are loaded
_MOST = 0.75


class NearCuts:
    """The elements that the first picture on a device depends on, if boxes and sides of elements decide."""

    def __init__(self, device: str = "auto") -> None:
        self._loads_all = other_device(device) is not None
        #: the data of the first picture, what its elements depend on, and these elements
        self._first: tuple[Sequence[object], Hashable, Dataset] | None = None

    def elements(self, dataset: Dataset | PluginData, scene: Scene) -> Dataset | None:
        """The elements for a picture, the same object if another camera shows the same ones; None for all."""
        if self._loads_all or isinstance(dataset, PluginData):
            return None
        found = self._few(dataset, scene)
        if found is None:
            self._loads_all, self._first = True, None
        return found

    def _few(self, dataset: Dataset, scene: Scene) -> Dataset | None:
        """The elements of the first picture; None if this one depends on others."""
        if not _is_large(dataset) or scene.copies or dataset.others:
            return None
        relevance = Relevance(dataset, whole_scene(dataset, scene))
        source, key = (dataset.mesh, *dataset.fields), (relevance.decided_by, relevance.shown_by)
        if self._first is None:
            few = _few(dataset, relevance)
            self._first = None if few is None else (source, key, few)
            return few
        known, known_key, found = self._first
        is_same = len(known) == len(source) and all(map(is_, known, source)) and known_key == key
        return found if is_same else None


def _is_large(dataset: Dataset) -> bool:
    """Whether loading all of a dataset takes seconds."""
    sizes = (sum(block.coefficients.nbytes for block in own.blocks) for own in dataset.fields)
    return max(sizes, default=0) >= LARGE


def _few(dataset: Dataset, relevance: Relevance) -> Dataset | None:
    """The elements that a picture depends on; None if boxes and sides don't decide, or most are needed."""
    is_known = knows_inner_sides(dataset) and is_local(dataset, is_even(dataset), [relevance.scene])
    if not is_known or not relevance.is_by_boxes:
        return None
    ids = relevance.ids()
    if len(ids) > _MOST * dataset.mesh.count:
        return None
    return replace(drawable(Portion.whole(dataset).of(ids)), **beside(dataset))
