"""Plane cuts in object order: each element is drawn into the pixels of its section (stages: cut_*.slang)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from time import perf_counter

import numpy as np

from elvis.core.base.arrays import Records
from elvis.core.mapping.orientation import chunks
from elvis.plugins.runtime.volume import Part
from elvis.renderer.device.device import Device, Given, Kernel, guess_nodes
from elvis.renderer.device.drafts import is_draft
from elvis.renderer.device.memory import Buffer
from elvis.renderer.raster.camera import record_of
from elvis.renderer.raster.gaps import Gaps, beside, unknown
from elvis.renderer.raster.hit_buffer import HitBuffer, arrays_to_write, new_arrays
from elvis.renderer.raster.pixels import NOBODY, UNKNOWN, Pixels, resolve
from elvis.renderer.raster.proof import prove
from elvis.renderer.raster.tiles import tiles_by_section
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import PlaneView
from elvis.scene.record.conditioning import doubt, slanted
from elvis.scene.record.frame import Status

#: sections that are drawn at a time
_SECTIONS = 1 << 16


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
    """A loaded volume, ready to be cut by any plane from any view."""

    def __init__(self, loaded: DeviceVolume) -> None:
        self.device, self.parts, self.buffers = loaded.device, loaded.parts, loaded.buffers
        self.first, self.extent = loaded.first, loaded.extent
        bent = loaded.once("bent", lambda: unknown(loaded.parts))
        # no method of its own, which would keep all that steps of a series leave until garbage is collected
        self.gaps, self.far = Gaps(self.parts, partial(_candidates, self.device), bent), loaded.is_far
        self.clock = Clock()
        self.references = True

    def draw(self, view: PlaneView, *, references: bool = True) -> HitBuffer:
        """The hit buffer of one view; slightly faster without reference coordinates."""
        self.references = references
        self.clock = Clock()
        count = view.width * view.height
        with self.clock.stage("clear"):
            names = ("owner", "field", "reference") if references else ("owner", "field")
            held = new_arrays(self.device, count, names, clear=("owner",))
            image = arrays_to_write(self.device, held, count)
        every, sections, candidates = [], [], []
        for number in range(len(self.parts)):
            with self.clock.stage("cull"):
                every.append(self._sections(number, view))
                sections.append(_visible(every[number]))
            if len(sections[number]):
                candidates.append(self._draw_part(number, view, sections[number], image))
        with self.clock.stage("read"):
            owner = self.device.read(held["owner"], np.uint32)
            pixels = Pixels(owner, (owner != NOBODY).view(np.uint8))  # Status.MISS is 0, Status.CERTAIN 1
        with self.clock.stage("resolve"):
            resolve(pixels, [some[some["status"] != UNKNOWN] for some in candidates])
            left = [] if is_draft() else [some[some["status"] == UNKNOWN] for some in candidates]
            resolve(pixels, [prove(self.parts, view, some) for some in left if len(some)])
        with self.clock.stage("gaps"):
            self.gaps.close(view, pixels, sections)
        if self.far:
            _doubt_cracks(pixels, view)
        with self.clock.stage("commit"):
            self._commit(pixels.committed, image)
        uncertain = slanted(view, self.extent)
        if uncertain is not None:
            pixels.status = doubt(pixels.status, uncertain)
        for some, first in zip(every, self.first, strict=False):
            some["element"] += np.uint32(first)
        return self._hits(view, pixels, held, np.concatenate(every) if every else None)

    def _hits(self, view: PlaneView, pixels: Pixels, held: dict[str, Buffer], sections: Records | None) -> HitBuffer:
        """The hit buffer on the device, with depths and the normal from the plane."""
        normal, hit = view.normal(), pixels.owner != NOBODY
        made = {
            "depth": lambda: np.where(hit, view.depths(), np.inf),
            "normal": lambda: np.where(hit[:, None], normal, np.nan),
        }
        known = {"owner": pixels.owner, "status": pixels.status, "flat": normal, "sections": sections}
        return HitBuffer.on_device(self.device, held, made, offset=float(normal @ view.plane.point), **known)

    def _draw_part(self, number: int, view: PlaneView, sections: Records, image: Given) -> Records:
        """All stages for one part; returns the deferred candidates, searched again, with indices in the volume."""
        # guesses take hundreds of bytes for each section, so only those of some sections are in memory at a time
        blocks = chunks(len(sections), _SECTIONS)
        candidates = [self._draw_sections(number, view, sections[block], image) for block in blocks]
        with self.clock.stage("retry"):
            return self._retry(number, view, np.concatenate(candidates))

    def _draw_sections(self, number: int, view: PlaneView, sections: Records, image: Given) -> Records:
        """Draw sections of one part; returns the deferred candidates."""
        part, buffers = self.parts[number], {**self.buffers[number], **image}

        # a guess of the inverse map for every section
        aim, draw = self._kernel("cut_aim", part), self._kernel("cut_draw", part)
        with self.clock.stage("aim"):
            buffers["sections"] = self.device.buffer(sections)
            buffers["guesses"] = self.device.empty(aim.dtype("guesses"), len(sections))
            numbers = 3 * guess_nodes(part) ** 2 * len(sections)
            buffers["guess_values"] = self.device.empty(np.float64, numbers)
            buffers["view"] = self._view(aim, view, number, len(sections))
            aim(len(sections), buffers)

        # the pixels of every tile; drawing twice is harmless, should the list of candidates have been too short
        with self.clock.stage("draw"):
            tiles = tiles_by_section(sections["least"], sections["most"], view, draw.dtype("tiles"))
            buffers["tiles"] = self.device.buffer(tiles)
            buffers["view"] = self._view(draw, view, number, len(tiles))
            return self.device.appended(
                "candidates", draw, lambda lists: draw(len(tiles), {**buffers, **lists}, groups=True)
            )

    def _sections(self, number: int, view: PlaneView) -> Records:
        """Sections of one part, in order of elements."""
        part = self.parts[number]
        cull = self._kernel("cut_cull", part)
        buffers = {**self.buffers[number], "view": self._view(cull, view, number, len(part))}
        sections = self.device.appended("sections", cull, lambda lists: cull(len(part), {**buffers, **lists}))
        return sections[np.argsort(sections["element"])]

    def _retry(self, number: int, view: PlaneView, candidates: Records) -> Records:
        """Candidates with indices in the volume; without a proof, a thorough search decides as many as possible."""
        if self.parts[number].solve is not None or not len(candidates):
            candidates["element"] += np.uint32(self.first[number])
            return candidates
        retry = self._kernel("cut_retry", self.parts[number])
        buffers = {**self.buffers[number], "view": self._view(retry, view, number, len(candidates))}
        buffers["candidates"] = self.device.buffer(candidates)
        retry(len(candidates), buffers)
        candidates = self.device.read(buffers["candidates"], candidates.dtype)
        candidates["element"] += np.uint32(self.first[number])
        return candidates

    def _kernel(self, stage: str, part: Part) -> Kernel:
        return self.device.kernel(stage, part)

    def _view(self, kernel: Kernel, view: PlaneView, number: int, count: int) -> Buffer:
        """The View record of the stages (cut.slang)."""
        record = record_of(kernel, "view", view, references=self.references, first=self.first[number], count=count)
        record["origin"], record["column"], record["row"], record["weight"] = view.plane_point
        record["point"], record["normal"] = view.plane.point, view.across
        record["slack"] = 1e-12 * (self.extent + float(np.abs(view.plane.point).max()))
        return self.device.buffer(record)

    def _commit(self, committed: list[Records], image: Given) -> None:
        """Let an image hold what the candidates for its pixels say."""
        if not sum(map(len, committed)):
            return
        kernel = self.device.kernel("cut_commit")
        every = np.concatenate(committed)[::-1]
        last = np.unique(every["pixel"], return_index=True)[1]
        candidates = np.zeros(len(last), kernel.dtype("candidates"))
        for name in ("pixel", "element", "field", "reference"):
            candidates[name] = every[name][last]
        data = {"candidates": candidates, "references": np.array([self.references], np.uint32)}
        kernel(len(candidates), {**image, **{name: self.device.buffer(array) for name, array in data.items()}})


def _candidates(device: Device, count: int) -> Records:
    """Empty Candidate records (cut.slang)."""
    return np.zeros(count, device.kernel("cut_commit").dtype("candidates"))


def _visible(sections: Records) -> Records:
    """The sections with pixels: all of them without a copy."""
    has_pixels = (sections["least"] <= sections["most"]).all(axis=1)
    return sections if has_pixels.all() else sections[has_pixels]


def _doubt_cracks(pixels: Pixels, view: PlaneView) -> None:
    """Mark free pixels next to owned ones as ambiguous: far from the origin both neighbours may miss a point.

    The maps of two elements are rounded differently: a point of the face between them may be outside of both.
    """
    owned = (pixels.owner != NOBODY).reshape(view.height, view.width)
    pixels.status[(~owned & beside(owned)).reshape(-1)] = Status.AMBIGUOUS
