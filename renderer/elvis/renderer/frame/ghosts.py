"""Geometries next to the data on a device: the undeformed one, and walls of a height."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from elvis.core.data.dataset import Dataset
from elvis.core.quantities import Expression
from elvis.core.quantities.tree import coordinate
from elvis.core.summary.picturing import Kind
from elvis.plugins.runtime.serving import volume_of
from elvis.renderer.frame.stages import Stages
from elvis.renderer.frame.undeformed import UNDEFORMED
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene import Scene
from elvis.scene.model.errors import SceneError

#: a quantity of every geometry
X = Expression("x", coordinate(0))


@dataclass(frozen=True, eq=False)
class Ghost:
    """A geometry next to the data.

    dataset  the data on it
    texts    of the quantities that are on the device
    """

    dataset: Dataset
    texts: tuple[str, ...]
    stages: Stages

    @staticmethod
    def of(dataset: Dataset, quantities: Sequence[Expression], shown: Stages, before: Ghost | None) -> Ghost:
        """The ghost of a dataset next to what is shown.

        before  what was on the device so far
        """
        texts = tuple(own.text for own in quantities)
        if before is not None and before.dataset is dataset and before.texts == texts:
            return before
        volume = volume_of(dataset, quantities)
        loaded = DeviceVolume(shown.loaded.device, volume, shown.loaded)
        return Ghost(dataset, texts, Stages(loaded, volume, dataset))


class Ghosts:
    """All geometries next to the data that a renderer shows, by name."""

    def __init__(self) -> None:
        self._known: dict[str, Ghost] = {}

    def show(self, datasets: Mapping[str, Dataset], quantities: Sequence[Expression], shown: Stages) -> None:
        """Bring geometries to the device, unless they are there; the undeformed one has the quantities."""
        found = {}
        for name, dataset in datasets.items():
            own = quantities if name == UNDEFORMED else [X]
            found[name] = Ghost.of(dataset, own, shown, self._known.get(name))
        self._known = found
        shown.ghosts = {name: own.stages for name, own in found.items()}

    def show_again(self, shown: Stages) -> None:
        """Bring all to a new device."""
        datasets = {name: own.dataset for name, own in self._known.items()}
        self._known = {}
        self.show(datasets, shown.others.own, shown)

    def clear(self) -> None:
        """Forget all."""
        self._known = {}


def check_ghosts(scene: Scene, kind: Kind | None, device: str, is_own: bool) -> None:
    """SceneError for 1D data and devices of plugins, which draw no further geometries.

    is_own  whether the device is one of this renderer
    """
    if scene.companions and (not is_own or kind is Kind.LINE):
        found = "1D data" if is_own else f"device {device}"
        key = scene.companions[0]
        raise SceneError(f"{key}: expected 2D or 3D data and a device that draws them, found {found}")
