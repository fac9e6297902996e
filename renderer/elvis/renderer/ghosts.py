"""The undeformed geometry on a device, next to the deformed one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from elvis.core.dataset import Dataset
from elvis.core.picturing import Kind
from elvis.core.quantities import Expression
from elvis.plugins.serving import volume_of
from elvis.renderer.device_volume import DeviceVolume
from elvis.renderer.stages import Stages
from elvis.scene import Scene
from elvis.scene.errors import SceneError


@dataclass(frozen=True, eq=False)
class Ghost:
    """The undeformed geometry of a dataset.

    dataset  the data on it
    texts    of the quantities that are on the device
    """

    dataset: Dataset
    texts: tuple[str, ...]
    stages: Stages

    @staticmethod
    def of(
        dataset: Dataset | None, quantities: Sequence[Expression], shown: Stages, before: Ghost | None
    ) -> Ghost | None:
        """The ghost of a dataset, None for none, with the same quantities as what is shown.

        before  what was on the device so far
        """
        if dataset is None:
            return None
        texts = tuple(own.text for own in quantities)
        if before is not None and before.dataset is dataset and before.texts == texts:
            return before
        volume = volume_of(dataset, quantities)
        loaded = DeviceVolume(shown.loaded.device, volume, shown.loaded)
        return Ghost(dataset, texts, Stages(loaded, volume, dataset))


def check_undeformed(scene: Scene, kind: Kind | None, device: str, is_own: bool) -> None:
    """SceneError for 1D data and devices of plugins, which draw no undeformed geometry.

    is_own  whether the device is one of this renderer
    """
    if scene.undeformed and (not is_own or kind is Kind.LINE):
        found = "1D data" if is_own else f"device {device}"
        raise SceneError(f"undeformed: expected 2D or 3D data and a device that draws them, found {found}")
