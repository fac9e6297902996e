"""Requirements of this area on a device: samples in elements, the elements that contain points, a preview."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, Ints
from elvis.plugins.runtime.volume import Volume
from elvis.plugins.runtime.volume_checks import Samples, check_samples, notes, probes


class Location(Protocol):
    """Locations of n points.

    owner      (n,)    index of the element in the volume, through all parts
    element    (n,)    its id in the file, -1 if no element contains the point
    reference  (n, 3)  reference coordinates
    status     (n,)    0 outside, 1 inside, 2 on a border, 3 not known
    """

    @property
    def owner(self) -> NDArray[np.uint32]: ...  # noqa: D102
    @property
    def element(self) -> Ints: ...  # noqa: D102
    @property
    def reference(self) -> Floats: ...  # noqa: D102
    @property
    def status(self) -> NDArray[np.uint8]: ...  # noqa: D102


class Preview(Protocol):
    """A small picture, (h, w) pixels.

    element    (h, w)     id in the file, -1 where nothing is seen
    position   (h, w, 3)  in the world
    reference  (h, w, 3)  reference coordinates
    field      (h, w)
    status     (h, w)     0 nothing, 1 and 2 inside, 3 not known
    """

    @property
    def element(self) -> Ints: ...  # noqa: D102
    @property
    def position(self) -> Floats: ...  # noqa: D102
    @property
    def reference(self) -> Floats | None: ...  # noqa: D102
    @property
    def field(self) -> Floats: ...  # noqa: D102
    @property
    def status(self) -> NDArray[np.uint8]: ...  # noqa: D102

    def save(self, path: str | Path) -> None:
        """Write it to a file."""


class EvaluationService(Protocol):
    """Evaluates elements on a device: an elvis.renderer.Renderer."""

    def show(self, volume: Volume) -> None:
        """Bring the volume to the device."""

    def sample_elements(self, part: int, elements: Ints, offsets: Floats, quantity: str | None = None) -> Samples:
        """Samples in elements of a part, at offsets from the centre of their type, of a quantity or its own field."""
        ...

    def probe(self, points: Floats) -> Location:
        """Locations of world points (n, 3)."""
        ...

    def preview(self, point: tuple[float, float, float]) -> Preview:
        """A cut through a point, of 2D elements all of them."""
        ...


def check_volume(name: str, volume: Volume, service: EvaluationService) -> list[str]:
    """Remarks on a volume that the service shows; PluginError with the plugin's name where its maps are broken."""
    remarks = []
    for number, part in enumerate(volume.parts):
        elements, offsets = probes(part, volume.dimension)
        samples = service.sample_elements(number, elements, offsets)
        check_samples(name, part, elements, samples)
        remarks += notes(name, part, elements, samples)
    return remarks
