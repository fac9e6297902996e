"""Pictures of other datasets next to the one that is shown: with its camera, size and range."""

from __future__ import annotations

from base64 import b64encode
from contextlib import nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from elvis.core.base.errors import ElvisError
from elvis.viewer.encoding import bare, png

if TYPE_CHECKING:
    from elvis.core.data.dataset import Dataset
    from elvis.renderer.frame.rendering import Pictures
    from elvis.scene.model.whole import Scene
    from elvis.scene.record.frame import Frame


class OtherPictures:
    """Pictures of the datasets that one dataset names; each has its own data on the device.

    device  as of ``elvis render``
    """

    def __init__(self, device: str) -> None:
        self._device = device
        self._pictures: dict[str, Pictures] = {}

    def draw(self, dataset: Dataset, name: str, frame: Frame, is_draft: bool) -> dict[str, Any]:
        """The picture of another dataset as a file in base64; ElvisError if there is no such dataset.

        frame  of the dataset that is shown
        """
        from elvis.renderer.device.drafts import drafted
        from elvis.renderer.frame.rendering import Pictures

        if name not in dataset.others:
            raise ElvisError(f"there is no second dataset {name!r:.40}")
        if name not in self._pictures:
            self._pictures[name] = Pictures(dataset.others[name], self._device)
        with drafted() if is_draft else nullcontext():
            found = self._pictures[name].draw(_beside(frame))
        file = bare(found)[0] if is_draft else png(found.rgb)
        return {"file": b64encode(file).decode(), "draft": is_draft}

    def clear(self) -> None:
        """Forget the data."""
        self._pictures.clear()


def _beside(frame: Frame) -> Scene:
    """The scene of a frame for another dataset."""
    height, width = frame.element.shape
    scene = replace(frame.scene, camera=frame.view.camera, size=(width, height), others=(), outputs=(), stats=None)
    for legend in frame.legends:
        palette = legend.palette
        if palette is not None and legend.title == scene.field and palette.low < palette.high:
            return replace(scene, range=(palette.low, palette.high))
    return scene
