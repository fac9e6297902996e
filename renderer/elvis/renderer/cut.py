"""Plane cuts in object order: each element is drawn into the pixels of its section (stages: shaders/cut_*.slang)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elvis.formats.arrays import Floats
from elvis.plugins.volume import Part, Volume
from elvis.renderer.device import Device, Kernel
from elvis.renderer.frame import Status
from elvis.renderer.view import View

if TYPE_CHECKING:
    import slangpy

NOBODY = 0xFFFFFFFF
#: verdicts, as in shaders/invert.slang
INSIDE, UNKNOWN = 1, 2
TILE = 8
#: reference units within which a point counts as on an element's border, as in shaders/invert.slang
BORDER = 1e-10


@dataclass
class Pixels:
    """What the stages leave behind, by pixel.

    owner      running element numbers over all parts, NOBODY where nothing is seen
    reference  (n, 3), None where it was not asked for
    """

    field: Floats
    owner: NDArray[np.uint32]
    reference: Floats | None
    status: NDArray[np.uint8]


@dataclass
class Clock:
    """Seconds by stage, summed over parts."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time spent in the block counts for the stage."""
        start = perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + perf_counter() - start


class Cutter:
    """A volume on a device, ready to be cut by any plane from any view."""

    def __init__(self, device: Device, volume: Volume) -> None:
        device.include(volume.shader_folder)
        self.device, self.parts = device, volume.parts
        self.buffers = [{name: device.buffer(data) for name, data in part.buffers.items()} for part in self.parts]
        self.first = np.cumsum([0, *map(len, self.parts)])
        self.reach = max((float(np.abs(part.boxes).max(initial=0.0)) for part in self.parts), default=0.0)
        self.bytes = sum(data.nbytes for part in self.parts for data in part.buffers.values())
        self.clock = Clock()
        self.tiles = 0
        self.references = True

    def draw(self, view: View, *, references: bool = True) -> Pixels:
        """The pixels of one view; without reference coordinates they are there a little sooner."""
        self.references = references
        self.clock, self.tiles = Clock(), 0
        count = view.width * view.height
        with self.clock.stage("clear"):
            image = {
                "field": self.device.empty(np.float64, count),
                "owner": self.device.buffer(np.full(count, NOBODY, np.uint32)),
                "reference": self.device.empty(np.float64, 3 * count if references else 1),
            }
        claims = [self._draw_part(number, view, image) for number in range(len(self.parts))]
        with self.clock.stage("read"):
            pixels = self._read(image, count)
        with self.clock.stage("settle"):
            settle(pixels, [some for some in claims if len(some)])
        return pixels

    def _draw_part(self, number: int, view: View, image: dict[str, slangpy.Buffer]) -> NDArray[Any]:
        """All stages for one part; returns what draw put off, searched again, with running element numbers."""
        part, buffers = self.parts[number], {**self.buffers[number], **image}
        with self.clock.stage("cull"):
            sections = self._sections(number, view)
        if not len(sections):
            return np.empty(0)

        # a guess of the inverse map for every section
        aim, draw = self._kernel("cut_aim", part), self._kernel("cut_draw", part)
        with self.clock.stage("aim"):
            buffers["sections"] = self.device.buffer(sections)
            buffers["guesses"] = self.device.empty(aim.dtype("guesses"), len(sections))
            buffers["view"] = self._view(aim, view, number, len(sections))
            aim(len(sections), buffers)

        # the pixels of every tile; drawing twice is harmless, should the list of claims have been too short
        with self.clock.stage("draw"):
            tiles = tiles_of(sections, draw.dtype("tiles"))
            self.tiles += len(tiles)
            buffers["tiles"] = self.device.buffer(tiles)
            buffers["view"] = self._view(draw, view, number, len(tiles))
            claims = self.device.listed(
                "claims", draw, lambda lists: draw(len(tiles), {**buffers, **lists}, groups=True)
            )
        with self.clock.stage("retry"):
            return self._retry(number, view, claims)

    def _sections(self, number: int, view: View) -> NDArray[Any]:
        """Sections of one part, in order of elements."""
        part = self.parts[number]
        cull = self._kernel("cut_cull", part)
        buffers = {**self.buffers[number], "view": self._view(cull, view, number, len(part))}
        sections = self.device.listed("sections", cull, lambda lists: cull(len(part), {**buffers, **lists}))
        return sections[np.argsort(sections["element"])]

    def _retry(self, number: int, view: View, claims: NDArray[Any]) -> NDArray[Any]:
        """Claims without doubt where the thorough search can settle them; element numbers made running."""
        if not len(claims):
            return claims
        retry = self._kernel("cut_retry", self.parts[number])
        buffers = {**self.buffers[number], "view": self._view(retry, view, number, len(claims))}
        buffers["claims"] = self.device.buffer(claims)
        retry(len(claims), buffers)
        claims = self.device.read(buffers["claims"], claims.dtype)
        self._decide(self.parts[number], view, claims)
        claims["element"] += np.uint32(self.first[number])
        return claims

    def _decide(self, part: Part, view: View, claims: NDArray[Any]) -> None:
        """Let the plugin itself answer the claims that the kernels left open."""
        left = np.flatnonzero(claims["verdict"] == UNKNOWN)
        if part.solve is None or not len(left):
            return
        pixels = claims["pixel"][left].astype(np.int64)
        points = view.points_of(pixels % view.width, pixels // view.width)
        solution = part.solve(claims["element"][left].astype(np.int64), points)
        for name in ("verdict", "margin", "reference", "field"):
            claims[name][left] = getattr(solution, name)

    def _kernel(self, stage: str, part: Part) -> Kernel:
        return self.device.kernel(stage, part)

    def _view(self, kernel: Kernel, view: View, number: int, count: int) -> slangpy.Buffer:
        """The View record of the stages (shaders/cut.slang)."""
        record = np.zeros(1, kernel.dtype("view"))
        record["origin"], record["column"], record["row"], record["weight"] = view.plane_point
        record["point"], record["normal"] = view.plane.point, view.plane.basis()[2]
        record["to_column"], record["to_row"], record["to_weight"] = view.to_pixel
        record["width"], record["height"], record["references"] = view.width, view.height, self.references
        record["first"], record["count"] = self.first[number], count
        record["slack"] = 1e-12 * (self.reach + float(np.abs(view.plane.point).max()))
        return self.device.buffer(record)

    def _read(self, image: dict[str, slangpy.Buffer], count: int) -> Pixels:
        owner = self.device.read(image["owner"], np.uint32)
        values = self.device.read(image["field"], np.float64)
        nowhere = owner == NOBODY
        values[nowhere] = np.nan
        status = (~nowhere).view(np.uint8)  # Status.MISS is 0, Status.CERTAIN 1
        if not self.references:
            return Pixels(values, owner, None, status)
        reference = self.device.read(image["reference"], np.float64).reshape(count, 3)
        reference[nowhere] = np.nan
        return Pixels(values, owner, reference, status)


def tiles_of(sections: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Tiles of TILE x TILE pixels that cover the bounds of all sections, those cut off by x + y and x - y left out."""
    least, most = sections["least"], sections["most"]
    across = (most[:, 0] - least[:, 0]) // TILE + 1
    along = (most[:, 1] - least[:, 1]) // TILE + 1

    # number the tiles of every section
    counts = across * along
    owner = np.repeat(np.arange(len(sections)), counts)
    index = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    x = least[owner, 0] + TILE * (index % across[owner])
    y = least[owner, 1] + TILE * (index // across[owner])

    # keep those that the diagonal bounds touch
    reach = TILE - 1
    kept = (x + y + 2 * reach >= least[owner, 2]) & (x + y <= most[owner, 2])
    kept &= (x - y + reach >= least[owner, 3]) & (x - y - reach <= most[owner, 3])
    tiles = np.zeros(int(kept.sum()), dtype)
    tiles["element"], tiles["section"] = sections["element"][owner[kept]], owner[kept]
    tiles["x"], tiles["y"] = x[kept], y[kept]
    return tiles


def settle(pixels: Pixels, claims: list[NDArray[Any]]) -> None:
    """Give disputed pixels to one element each: what is well inside comes first, then the lowest number.

    A pixel that only borders claim is ambiguous; one that nobody owns but a search could not decide has failed.
    """
    if not claims:
        return
    every = np.concatenate(claims)
    border = every["margin"] <= BORDER
    every = every[np.lexsort([every["element"], border, every["pixel"]])]

    inside = every[every["verdict"] == INSIDE]
    _, first = np.unique(inside["pixel"], return_index=True)
    chosen = inside[first]
    certain = chosen["margin"] > BORDER
    owner = pixels.owner[chosen["pixel"]]
    better = (owner == NOBODY) | (certain & (chosen["element"] < owner))
    chosen, certain = chosen[better], certain[better]
    pixels.owner[chosen["pixel"]] = chosen["element"]
    pixels.field[chosen["pixel"]] = chosen["field"]
    if pixels.reference is not None:
        pixels.reference[chosen["pixel"]] = chosen["reference"]
    pixels.status[chosen["pixel"]] = np.where(certain, Status.CERTAIN, Status.AMBIGUOUS)

    unknown = every["pixel"][every["verdict"] == UNKNOWN]
    pixels.status[unknown[pixels.owner[unknown] == NOBODY]] = Status.FAILED
