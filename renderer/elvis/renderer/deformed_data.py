"""Data on the geometry that a scene asks for."""

from __future__ import annotations

from dataclasses import dataclass

from elvis.core.dataset import Dataset
from elvis.plugins.deforming import is_deformed, with_deformation
from elvis.plugins.opening import PluginData
from elvis.scene import Scene
from elvis.scene.errors import SceneError
from elvis.scene.whole import Deform


@dataclass
class DeformedData:
    """Data, and their last deformation.

    is_whole  whether the data were read whole, not in parts
    """

    data: Dataset | PluginData
    is_whole: bool
    _last: tuple[Deform, Dataset] | None = None

    def of(self, scene: Scene) -> Dataset | PluginData:
        """The data on the geometry of a scene; SceneError if they can't be deformed."""
        if scene.deform is None:
            return self.data
        if not isinstance(self.data, Dataset):
            raise SceneError(f"deform: data of plugin {self.data.name} have no polynomial maps: leave deform out")
        if is_deformed(self.data, scene.deform.deformation):
            return self.data
        if not self.is_whole:
            raise SceneError("deform: the geometry of data read in parts cannot be changed: open the data with it")
        if self._last is None or self._last[0] != scene.deform:
            self._last = scene.deform, with_deformation(self.data, scene.deform.deformation)
        return self._last[1]
