"""Pictures of a dataset by linear elements, one after another, next to exact ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.summary.picturing import Kind
from elvis.reference.baseline.linear_drawing import Baseline, affordable
from elvis.reference.quantities import Quantities, names_of
from elvis.reference.study import complete, memory_limit
from elvis.scene.record.frame import Frame, whole


class LinearPictures:
    """Pictures of linear meshes of a dataset, as `compare_scene` scores them; the last mesh is cached."""

    def __init__(self, dataset: Dataset) -> None:
        """Raise ElvisError for 1D data, which have no such pictures."""
        if Kind.of(dataset) is Kind.LINE:
            raise ElvisError("1D data are drawn as curves: there are no linear pictures")
        self._dataset = dataset
        self._mesh: tuple[object, Baseline] | None = None

    def draw(self, frame: Frame, level: int, limit: int | None = None) -> tuple[NDArray[np.uint8], int]:
        """The linear picture (h, w, 3) of an exact frame's scene, camera and colour range, and its number of simplices.

        level  cuts of each element
        limit  maximum bytes of the mesh during construction and drawing; by default half of the free memory

        Raises ElvisError for objects that linear meshes can't draw, and if the limit is too small; raises
        MissingPackageError without embreex.
        """
        scene = complete(frame)
        made = self._made(names_of(scene), level, scene.time, memory_limit() if limit is None else limit)
        strips = made.strips(scene, frame.view, frame.range)
        image = np.concatenate([whole(strip.color.clip(0.0, 1.0)) for strip in strips])
        return image, made.counts["simplices"]

    def _made(self, names: tuple[str, ...], level: int, time: float | None, limit: int) -> Baseline:
        """The mesh with some quantities at its corners."""
        key = names, level, time
        if self._mesh is None or self._mesh[0] != key:
            self._mesh = None
            dataset = self._dataset if time is None else replace(self._dataset, time=time)
            quantities = Quantities(dataset, names)
            fits, needed = affordable(quantities.patches, level, len(names), limit)
            if not fits:
                refinements = f"{level} refinement{'s' * (level != 1)}"
                raise ElvisError(f"linear elements of {refinements} need {needed / 1e9:.1f} GB, more than there are")
            self._mesh = key, Baseline.of(quantities, level)
        return self._mesh[1]
