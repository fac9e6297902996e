"""Streamlines traced on the device: many steps of many lines in a dispatch, and the rest by the host's tracer.

The kernel takes steps within the elements of one part and through the sides between these.  A line that reaches
anything else (an end, an outer side, an element of another shape, a jump) keeps its previous state, and the host takes
that one step as it takes all steps without a device.  So the rules for ends of lines are written once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, Records, starts_of
from elvis.core.mapping.locate import Locator
from elvis.core.polynomials.expansion import mode_count
from elvis.core.streamlines import dop853, entries, tracer
from elvis.core.streamlines.endings import End
from elvis.core.streamlines.lines.steps import Limits, Piece
from elvis.core.streamlines.neighbours import Neighbours
from elvis.core.streamlines.tracer import Tracer
from elvis.core.streamlines.velocity import Velocity
from elvis.plugins.native import NativeVolume
from elvis.plugins.native.buffers import stacks
from elvis.plugins.runtime.volume import Part
from elvis.renderer.device.device import Device
from elvis.renderer.device.errors import DeviceError
from elvis.renderer.device.memory import Buffer
from elvis.renderer.raster.pixels import NOBODY

#: lines below which the host is sooner done than a device is opened and its kernel compiled
FEW = 128
#: steps that the host takes of few lines before a device goes on: their largest number, and that of the product of
#: steps, lines and modes
LONG, WORK = 100, 1 << 20
#: steps per dispatch, shared by lines; minimum and maximum steps per line
_ROOM, _LEAST, _MOST = 1 << 16, 8, 128
#: stands for an element of another part, as in trace_follow.slang
_ELSEWHERE = int(NOBODY) - 1


@dataclass(frozen=True, eq=False)
class _Stage:
    """A part on the device, and which elements of the velocity's patches it has.

    patch, row  (n,) of its elements
    number      (m,) by all elements of all patches one after the other: which one of the part it is, -1 for none
    buffers     of the part, its sides, and the tables of the method
    """

    part: Part
    patch: Ints
    row: Ints
    number: Ints
    buffers: Mapping[str, Buffer]


class Followers:
    """Makes tracers that follow many lines on a device, and keeps what that has of the last velocity.

    device  gives the device when it is first needed; None where there is none
    """

    def __init__(self, device: Callable[[], Device | None]) -> None:
        self._device = device
        self._velocity: Velocity | None = None
        self._stages: list[_Stage] = []

    def __call__(
        self, velocity: Velocity, neighbours: Neighbours, locator: Locator, limits: Limits, sign: int
    ) -> Tracer:
        """A tracer; the host's own on walls, where the velocity's components are no fields, and for data with waves."""
        is_plain = type(velocity) is Velocity and all(each.is_field for each in velocity.expressions)
        has_waves = any(patch.periods for patch in velocity.patches)
        if not is_plain or has_waves:
            return Tracer(velocity, neighbours, locator, limits, sign)
        return DeviceTracer(self, velocity, neighbours, locator, limits, sign)

    def device_for(self, velocity: Velocity, neighbours: Neighbours) -> tuple[Device, list[_Stage]] | None:
        """The device and its parts of a velocity; None without a device."""
        device = self._device()
        if device is None:
            return None
        if velocity is not self._velocity:
            device.include(NativeVolume(3, ()).shader_folder)
            self._stages = list(_stages(device, velocity, neighbours))
            self._velocity = velocity
        return device, self._stages


@contextmanager
def following(name: str) -> Iterator[Followers]:
    """Tracers on a device of this name, opened if there are many lines and closed at the end.

    DeviceError if it can't be opened; with ``auto`` the host then traces lines.
    """
    found: list[Device] = []

    def open_once() -> Device | None:
        try:
            found.extend([] if found else [Device(name)])
        except DeviceError:
            if name != "auto":
                raise
        return found[0] if found else None

    try:
        yield Followers(open_once)
    finally:
        for device in found:
            device.close()


class DeviceTracer(Tracer):
    """Lines under way, most of their steps taken on a device."""

    def __init__(
        self,
        followers: Followers,
        velocity: Velocity,
        neighbours: Neighbours,
        locator: Locator,
        limits: Limits,
        sign: int,
    ) -> None:
        super().__init__(velocity, neighbours, locator, limits, sign)
        self._followers = followers
        self._starts = starts_of(velocity.patches)
        self._dimension = velocity.patches[0].dimension

    def place(self, patch: Ints, row: Ints, reference: Floats) -> None:
        """Begin lines, as `Tracer.place`."""
        super().place(patch, row, reference)
        # the box of each line's model: middle, half width, half width of the next one; and its element
        self._boxes = np.zeros((len(patch), 5))
        self._boxed = np.full(len(patch), -1)

    def run(self) -> Iterator[Piece]:
        """The steps of all lines until each has ended, many lines at a time: few lines are the host's, if not long."""
        yield from islice(super().run(), self._host_steps(int(np.count_nonzero(self.end == End.GOING))))
        if not (self.end == End.GOING).any():
            return
        found = self._followers.device_for(self.velocity, self.neighbours)
        if found is None:
            yield from super().run()
            return
        self._device, self._stages = found
        yield from self._run_there()

    def _host_steps(self, count: int) -> int:
        """The number of steps that the host takes of ``count`` lines: about as long as a device takes to be opened."""
        patches = self.velocity.patches
        modes = max(mode_count(own) for patch in patches for own in (patch.geometry, *patch.fields) if own is not None)
        return 0 if count >= FEW else min(LONG, WORK // (max(count, 1) * modes))

    def _run_there(self) -> Iterator[Piece]:
        """The same, on the device where that can."""
        is_plain = np.ones(len(self.end), bool)
        while True:
            active = np.flatnonzero(self.end == End.GOING)
            if not len(active):
                return
            for stage in self._stages:
                own = self._lines_in(stage, active[is_plain[active]])
                for first in range(0, len(own), _ROOM // _LEAST):
                    yield from self._follow(stage, own[first : first + _ROOM // _LEAST], is_plain)
            # steps that the device has left
            rest = active[~is_plain[active]]
            if len(rest):
                with np.errstate(all="ignore"):
                    piece = self._advance(rest)
                if piece is not None:
                    yield piece
            is_plain[rest] = True

    def _lines_in(self, stage: _Stage, lines: Ints) -> Ints:
        """The lines that are in a stage's elements."""
        return lines[self._elements(stage, lines) >= 0]

    def _elements(self, stage: _Stage, lines: Ints) -> Ints:
        """(k,) which of a stage's elements lines are in, -1 for none."""
        return np.asarray(stage.number[self._starts[self.patch[lines]] + self.row[lines]])

    def _follow(self, stage: _Stage, lines: Ints, is_plain: Bools) -> Iterator[Piece]:
        """Steps of lines that are in a stage's elements; written is which of them go on plainly."""
        kernel = self._device.kernel("trace_follow", stage.part)
        most = min(max(_ROOM // len(lines), _LEAST), _MOST)
        record = self._records(stage, lines, most, kernel.dtype("lines"))
        layout = kernel.dtype("steps")
        facts = self._facts(kernel.dtype("facts"), stage, most)
        buffers = {"lines": self._device.buffer(record), "steps": self._device.empty(layout, len(lines) * most)}
        kernel(len(lines), {**stage.buffers, **buffers, "facts": self._device.buffer(facts)})
        found = self._device.read(buffers["lines"], record.dtype, len(lines))
        steps = self._device.read(buffers["steps"], layout, len(lines) * most).reshape(len(lines), most)

        # a line that is not moved at all is the host's, whatever the reason
        is_plain[lines] = (found["is_plain"] > 0) & (found["count"] > 0)
        counts = found["count"].astype(np.int64)
        self._take(stage, lines, found)
        if counts.any():
            yield self._piece(stage, np.repeat(lines, counts), steps[np.arange(most) < counts[:, None]])
        slow = lines[found["is_slow"] > 0]
        self._inspect(slow)

    def _records(self, stage: _Stage, lines: Ints, most: int, layout: np.dtype[Any]) -> Records:
        """Lines as the device has them."""
        record = np.zeros(len(lines), layout)
        state, width = self.state[lines], self._width[lines]
        record["state"][:, : self._dimension] = state[:, :-1]
        record["state"][:, 3] = state[:, -1]
        record["time"], record["element"] = self.time[lines], self._elements(stage, lines)
        record["width"] = np.where(np.isfinite(width), width, 1e300)
        record["middle"], record["room"] = self._boxes[lines, :3], self._boxes[lines, 4]
        record["half"] = np.where(self._boxed[lines] == record["element"], self._boxes[lines, 3], 0.0)
        # the last step that is allowed is the host's
        record["most"] = np.clip(self.limits.steps - self._steps[lines] - 1, 0, most)
        return record

    def _take(self, stage: _Stage, lines: Ints, found: Records) -> None:
        """Go on from where the device has left lines."""
        moved = np.flatnonzero(found["count"])
        lines, found = lines[moved], found[moved]
        self.patch[lines], self.row[lines] = stage.patch[found["element"]], stage.row[found["element"]]
        self.state[lines] = self._states(found["state"])
        self._slope[lines] = self._states(found["rate"])
        columns = np.stack([found[name] for name in ("dx", "dy", "dz")], axis=2)
        self._jacobians[lines] = columns[:, :, : self._dimension]
        self._boxes[lines] = np.column_stack([found[name] for name in ("middle", "half", "room")])
        self._boxed[lines] = found["element"]
        self.time[lines], self._width[lines] = found["time"], found["width"]
        self._steps[lines] += found["count"]
        self._turns[lines] = 0

    def _piece(self, stage: _Stage, lines: Ints, steps: Records) -> Piece:
        """Steps of the device as the host has them."""
        patch, row = stage.patch[steps["element"]], stage.row[steps["element"]]
        nets, ends = self._states(steps["nets"]), self._states(steps["end"])
        return Piece(lines, patch, row, steps["time"], steps["lasts"], nets, steps["part"], ends)

    def _states(self, found: Floats) -> Floats:
        """(…, D+1) reference coordinates and length, from three coordinates and the length."""
        if self._dimension == 3:
            return found
        return np.concatenate([found[..., : self._dimension], found[..., 3:]], axis=-1)

    def _facts(self, layout: np.dtype[Any], stage: _Stage, most: int) -> Records:
        """Constants of all lines."""
        facts = np.zeros(1, layout)
        limits = self.limits
        for name in ("length", "duration", "speed", "rest", "tolerance"):
            facts[name] = min(getattr(limits, name), 1e300)
        values = {
            "sign": self.sign,
            "reach": tracer.REACH,
            "shortest": tracer.SHORTEST,
            "along": entries.ALONG,
            "beside": tracer.BESIDE,
            "beside_outer": tracer.BESIDE_OUTER,
            "gap": tracer.GAP * self._size,
            "shrink": tracer.SHRINK,
            "grow": tracer.GROW,
            "safety": tracer.SAFETY,
            "defect": tracer.DEFECT,
            "rounded": tracer.ROUNDED,
            "checks": len(tracer.CHECKS),
            "sides": len(self.neighbours.sides(int(stage.patch[0])).corners),
            "most": most,
        }
        for name, value in values.items():
            facts[name] = value
        return facts


def _stages(device: Device, velocity: Velocity, neighbours: Neighbours) -> Iterator[_Stage]:
    """The parts of a velocity on a device."""
    names = tuple(each.root.name for each in velocity.expressions)
    numbers = {id(patch): number for number, patch in enumerate(velocity.patches)}
    starts = starts_of(velocity.patches)
    for part, own in stacks(velocity.patches, velocity.evaluator, names):
        patches = [numbers[id(patch)] for patch in own]
        patch = np.concatenate([np.full(len(velocity.patches[k]), k) for k in patches])
        row = np.concatenate([np.arange(len(velocity.patches[k])) for k in patches])
        number = np.full(starts[-1], -1)
        number[starts[patch] + row] = np.arange(len(patch))
        arrays = {**part.buffers, **_tables(), "vertices": _vertices(own[0].shape.vertices)}
        kept = Part(
            part.module,
            part.type,
            part.element_ids,
            part.boxes,
            {},
            source=f"{part.source} import trace_motion; export static const int components = {len(names)};",
        )
        kernel = device.kernel("trace_follow", kept)
        arrays["sides"] = _sides(neighbours, patches[0], kernel.dtype("sides"))
        arrays["doors"] = _doors(neighbours, patches, number, kernel.dtype("doors"))
        yield _Stage(kept, patch, row, number, {name: device.buffer(array) for name, array in arrays.items()})


def _tables() -> dict[str, Floats]:
    """The coefficients of the method, and the places where its defect is taken."""
    errors = np.zeros((2, 16))
    errors[:, : dop853.ERRORS.shape[1]] = dop853.ERRORS
    checks = np.array(tracer.CHECKS)
    return {"stages": dop853.STAGES, "errors": errors, "dense": dop853.DENSE, "powers": dop853.POWERS, "checks": checks}


def _vertices(places: Floats) -> Floats:
    """(n, 3) the vertices of a shape."""
    found = np.zeros((len(places), 3))
    found[:, : places.shape[1]] = places
    return found


def _sides(neighbours: Neighbours, patch: int, layout: np.dtype[Any]) -> Records:
    """The sides of a shape."""
    own = neighbours.sides(patch)
    found = np.zeros(len(own.corners), layout)
    dimension = own.normals.shape[1]
    found["height"][:, :dimension], found["height"][:, 3] = own.normals, own.offsets
    found["origin"][:, :dimension] = own.origins
    for k, name in enumerate(("first", "second")[: own.duals.shape[2]]):
        found[name][:, :dimension] = own.duals[:, :, k]
    return found


def _doors(neighbours: Neighbours, patches: list[int], number: Ints, layout: np.dtype[Any]) -> Records:
    """Elements beyond the sides of a part's elements."""
    parts = []
    for patch in patches:
        other, across, corners = neighbours.doors(patch)
        found = np.zeros(other.shape, layout)
        inside = np.where(number[other] >= 0, number[other], _ELSEWHERE)
        found["element"] = np.where(other < 0, NOBODY, inside)
        shifts = 4 * np.arange(corners.shape[2])
        found["corners"] = ((corners << shifts).sum(axis=2)) | (np.maximum(across, 0) << 12)
        parts.append(found.reshape(-1))
    return np.concatenate(parts)
