"""Sources of pictures, either a dataset or data opened by a runtime plugin: distinguished only here."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.bounds.bounding import quantity_range
from elvis.core.data.dataset import Dataset
from elvis.core.deformed.isometries import Isometry
from elvis.core.mapping.boxes import element_boxes
from elvis.core.mapping.patch import patches
from elvis.core.quantities import Expression
from elvis.plugins.runtime.opening import PluginData
from elvis.reference.copied import CopiedQuantities
from elvis.reference.quantities import Quantities
from elvis.reference.scenes.host_quantities import HostQuantities
from elvis.scene.cameras.fitting import surrounding
from elvis.scene.model.errors import SceneError


class Source(ABC):
    """Data of either kind."""

    @staticmethod
    def of(data: Dataset | PluginData) -> Source:
        """The source for the data."""
        return PluginSource(data) if isinstance(data, PluginData) else DatasetSource(data)

    @abstractmethod
    def quantities(self, names: Sequence[str]) -> Quantities:
        """The fields and expressions of these names; raises ElvisError for a name that means nothing of these data."""

    @abstractmethod
    def copied(self, names: Sequence[str], isometries: Sequence[Isometry]) -> Quantities:
        """The same on copies of the data by isometries, the identity first."""

    @abstractmethod
    def bounds(self, name: str) -> tuple[float, float] | None:
        """Certified bounds of a quantity over all data; None if none are known."""

    @abstractmethod
    def domain(self) -> Floats:
        """(2, 3) corners of the box around the domain; raises SceneError if none is known."""


@dataclass(frozen=True, eq=False)
class DatasetSource(Source):
    """A dataset."""

    dataset: Dataset

    def quantities(self, names: Sequence[str]) -> Quantities:
        """See `Source`."""
        return Quantities(self.dataset, names)

    def copied(self, names: Sequence[str], isometries: Sequence[Isometry]) -> Quantities:
        """See `Source`."""
        return CopiedQuantities(self.dataset, names, isometries)

    def bounds(self, name: str) -> tuple[float, float] | None:
        """See `Source`."""
        known = quantity_range(self.dataset, Expression.of(self.dataset, name))
        if known is None or not np.isfinite((known.lower, known.upper)).all():
            return None
        return known.lower, known.upper

    def domain(self) -> Floats:
        """The box of the elements, with known bounds of the coordinates instead (see `Source`)."""
        box = surrounding([element_boxes(patch) for patch in patches(self.dataset)])
        for axis, name in enumerate("xyz"[: self.dataset.mesh.dimension]):
            known = self.bounds(name)
            if known is not None:
                box[:, axis] = known
        return box


@dataclass(frozen=True, eq=False)
class PluginSource(Source):
    """The data opened by a runtime plugin."""

    opened: PluginData

    def quantities(self, names: Sequence[str]) -> Quantities:
        """See `Source`; also raises ElvisError if the plugin doesn't describe its elements in NumPy."""
        return HostQuantities(self.opened, names)

    def copied(self, names: Sequence[str], isometries: Sequence[Isometry]) -> Quantities:
        """Raise an error: a plugin's maps are no coefficients that could be moved (see `Source`)."""
        raise SceneError("copies: the device reference draws no copies of what a plugin opens")

    def bounds(self, name: str) -> tuple[float, float] | None:
        """None: no bounds are known (see `Source`)."""
        return None

    def domain(self) -> Floats:
        """Raise an error: no box is known (see `Source`)."""
        raise SceneError("the device reference knows no box around what a plugin opens: leave out --box and --axes")
