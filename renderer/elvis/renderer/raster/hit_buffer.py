"""The hit buffer: what one surface shows, pixel by pixel. Every pass that finds surfaces leaves one (hits.slang)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from dataclasses import field as default
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.renderer.raster.pixels import NOBODY
from elvis.scene.record.frame import Status

if TYPE_CHECKING:
    from elvis.renderer.device.device import Device
    from elvis.renderer.device.memory import Buffer
    from elvis.renderer.passes.faces.faces import SquarePatches

#: the arrays as a device holds them: kind of number, how many of a pixel (the first of all pixels, then the second),
#: and what stands where nothing is hit
CHANNELS: Mapping[str, tuple[type[np.generic], int, float]] = {
    "owner": (np.uint32, 1, NOBODY),
    "side": (np.uint32, 1, NOBODY),
    "status": (np.uint32, 1, Status.MISS),
    "field": (np.float64, 1, np.nan),
    "reference": (np.float64, 3, np.nan),
    "depth": (np.float64, 1, np.inf),
    "normal": (np.float64, 3, np.nan),
    "uncertainty": (np.float64, 1, np.nan),
    "doubt": (np.float64, 1, np.inf),
}


@dataclass
class HitBuffer:
    """At most one hit for each of n pixels, row by row from the top; in a stack, the k-th nearest one.

    owner      (n,)    index of the element (see DeviceVolume), NOBODY without a hit
    field      (n,)    the object's quantity there, NaN without a hit
    reference  (n, 3)  reference coordinates in the element, NaN without a hit
    depth      (n,)    distance from the eye's plane along the view (see View.rays), infinite without a hit
    normal     (n, 3)  unit normal of the surface, turned to the viewer, NaN without a hit
    status     (n,)    see frame.Status
    side       (n,)    numbers that distinguish elements, and the faces of each; None: the owners do
    flat       (3,)    the normal if all of it lies in one plane, else None
    held       buffers of a device that contain some of these arrays, by name
    sections   for a plane cut: ranges in which elements may be visible, by index, as cut_cull lists them
    offset     for a plane cut: normal · x
    near_squares  for the nearest hits on faces: finds faces in the squares of pixels (FaceDrawer.near_squares)
    uncertainty  (n,) bounds on the error of the depths, in world units, infinite if nothing is proved and NaN without a
                 hit; None: bounds of a surface that is given analytically
    doubt      (n,)    depths beyond which a surface may have been missed, infinite without doubt; None: none
    clear      (n,)    clips remove nothing nearer than this to the hit, in world units; None: there are no clips
    copies     (n,)    in a record, numbers of the copies that are hit, -1 without a hit; None: there are no copies
    """

    owner: NDArray[np.uint32]
    field: Floats
    reference: Floats
    depth: Floats
    normal: Floats
    status: NDArray[np.uint8]
    side: NDArray[np.uint32] | None = default(default_factory=lambda: None)
    flat: Floats | None = None
    held: Mapping[str, Buffer] = default(default_factory=dict)
    sections: NDArray[Any] | None = default(default_factory=lambda: None)
    offset: float = 0.0
    near_squares: Callable[[], Iterator[SquarePatches]] | None = default(default_factory=lambda: None)
    uncertainty: Floats | None = default(default_factory=lambda: None)
    doubt: Floats | None = default(default_factory=lambda: None)
    clear: Floats | None = default(default_factory=lambda: None)
    copies: Ints | None = default(default_factory=lambda: None)

    @staticmethod
    def empty(count: int) -> HitBuffer:
        """A hit buffer without hits."""
        vectors = np.full((2, count, 3), np.nan)
        owner, status = np.full(count, NOBODY, np.uint32), np.zeros(count, np.uint8)
        return HitBuffer(owner, np.full(count, np.nan), vectors[0], np.full(count, np.inf), vectors[1], status)

    @staticmethod
    def on_device(
        device: Device, held: Mapping[str, Buffer], made: Mapping[str, Callable[[], Any]] | None = None, **known: Any
    ) -> HitBuffer:
        """The output of a pass on a device; arrays are read when they are first used.

        held   buffers on the device, by name (see ``new_arrays``)
        made   functions that make other arrays when they are first used
        known  arrays and facts that are already known
        """
        hits = object.__new__(HitBuffer)
        absent = {"side": None, "flat": None, "sections": None, "offset": 0.0}
        absent |= {"near_squares": None, "uncertainty": None, "doubt": None, "clear": None, "copies": None}
        made = made or {}
        vars(hits).update({name: value for name, value in absent.items() if name not in {**held, **made}})
        vars(hits).update(known, held=held, _made=made, _device=device)
        return hits

    def __getattr__(self, name: str) -> Any:
        """Make or read what isn't there yet."""
        own = vars(self)
        if name in own.get("_made", {}):
            own[name] = own["_made"][name]()
        elif "_device" in own and name in own["held"]:
            own[name] = self._read(own["_device"], name)
        else:
            raise AttributeError(name)
        return own[name]

    def _read(self, device: Device, name: str) -> NDArray[Any]:
        """Read an array from the device; without a hit its values are undefined in kernels."""
        dtype, size, nothing = CHANNELS[name]
        values = device.read(self.held[name], dtype)
        if name == "status":
            return values.astype(np.uint8)
        values = values.reshape(size, -1).T if size > 1 else values
        if name not in ("owner", "side", "doubt"):
            values[self.owner == NOBODY] = nothing
        return values

    @property
    def is_empty(self) -> bool:
        """Whether nothing is hit, and nothing may have been missed."""
        if np.any(self.owner != NOBODY) or self.status.any():
            return False
        return self.doubt is None or not np.isfinite(self.doubt).any()

    def without(self, gone: Bools) -> HitBuffer:
        """The hit buffer without its hits in the pixels ``gone`` (n,)."""
        wide = gone[:, None]
        return HitBuffer(
            np.where(gone, np.uint32(NOBODY), self.owner),
            np.where(gone, np.nan, self.field),
            np.where(wide, np.nan, self.reference),
            np.where(gone, np.inf, self.depth),
            np.where(wide, np.nan, self.normal),
            np.where(gone, np.uint8(0), self.status),
            None if self.side is None else np.where(gone, np.uint32(NOBODY), self.side),
            self.flat,
            sections=self.sections,
            offset=self.offset,
            uncertainty=None if self.uncertainty is None else np.where(gone, np.nan, self.uncertainty),
            doubt=self.doubt,
            clear=self.clear,
        )

    def clip(self, gone: Bools, unsure: Bools, clear: Floats) -> HitBuffer:
        """The same without the hits in the pixels ``gone`` (n,); where that is ``unsure`` (n,), they may be there.

        clear  (n,) see above
        """
        left = self.without(gone)
        left.clear = clear
        doubt = np.full(len(gone), np.inf) if self.doubt is None else self.doubt
        left.doubt = np.where(unsure, np.minimum(doubt, self.depth), doubt)
        status = np.where(unsure & (left.status != Status.FAILED), np.uint8(Status.AMBIGUOUS), left.status)
        left.status = np.where(gone & np.isfinite(doubt), np.uint8(Status.AMBIGUOUS), status)
        return left

    def on(self, device: Device, name: str) -> Buffer:
        """One of the arrays on a device, which it is brought to once."""
        if name not in self.held:
            self.held = {**self.held, name: device.buffer(getattr(self, name).T)}
        return self.held[name]

    def bindings(self, device: Device, *names: str) -> dict[str, Buffer]:
        """Some of the arrays under the names of kernels; of a plane there is one normal for all pixels."""
        return {hit_name(name): self._bound(device, name) for name in names}

    def _bound(self, device: Device, name: str) -> Buffer:
        if name == "normal" and self.flat is not None:
            return device.buffer(self.flat)
        return self.on(device, "owner" if name == "side" and self.side is None else name)

    def turned(self, rotation: Floats) -> HitBuffer:
        """The hit buffer with normals R n, for an orthogonal matrix R (3, 3)."""
        other = copy(self)
        other.held = {name: own for name, own in self.held.items() if name != "normal"}
        other.flat = None if self.flat is None else rotation @ self.flat
        vars(other).pop("normal", None)
        vars(other)["_made"] = {**vars(self).get("_made", {}), "normal": lambda: self.normal @ rotation.T}
        return other

    def set_back(self, distance: float) -> HitBuffer:
        """The hit buffer with depths that are greater by a distance."""
        other = copy(self)
        other.depth, other.held = self.depth + distance, {n: own for n, own in self.held.items() if n != "depth"}
        return other

    def of_copies(self, copies: Ints) -> HitBuffer:
        """The hit buffer with numbers of copies (n,)."""
        other = copy(self)
        other.copies = copies
        return other

    def showing(self, values: Floats) -> HitBuffer:
        """The hit buffer with other values (n,) as its field."""
        other = copy(self)
        other.field, other.held = values, {name: own for name, own in self.held.items() if name != "field"}
        return other


def hit_name(name: str) -> str:
    """Name of an array in kernels."""
    return f"hit_{name}"


def new_arrays(device: Device, count: int, names: Sequence[str], clear: Sequence[str] = ()) -> dict[str, Buffer]:
    """Some of the arrays, of n pixels, for a pass to write; those to ``clear`` say that nothing is hit."""
    held = {}
    for name in names:
        dtype, size, nothing = CHANNELS[name]
        fresh = np.full(size * count, nothing, dtype) if name in clear else None
        held[name] = device.empty(dtype, size * count) if fresh is None else device.buffer(fresh)
    return held


def arrays_to_write(device: Device, held: Mapping[str, Buffer], count: int) -> dict[str, Any]:
    """All that hits.slang declares, of n pixels, under the names there; what a pass does not write has no room."""
    nothing = device.empty(np.float64, 1)
    arrays = {hit_name(name): held.get(name, nothing) for name in CHANNELS}
    return {**arrays, "hit_pixels": np.array([count], np.uint32)}
