"""What one surface shows, pixel by pixel: what every stage that finds surfaces hands on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass
from dataclasses import field as default
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.arrays import Bools, Floats
from elvis.renderer.pixels import NOBODY, Pixels
from elvis.scene.frame import Status
from elvis.scene.view import PlaneView

if TYPE_CHECKING:
    from elvis.renderer.device import Buffer, Device


@dataclass
class Layer:
    """One hit at most for each of n pixels, row by row from the top; of a stack, the k-th nearest one.

    owner      (n,)    running element number (see Loaded), NOBODY where nothing is hit
    field      (n,)    the object's quantity there, NaN where nothing is hit
    reference  (n, 3)  reference coordinates in the element, NaN where nothing is hit
    depth      (n,)    distance from the eye's plane along the view (see View.rays), infinite where nothing is hit
    normal     (n, 3)  unit normal of the surface, turned to the viewer, NaN where nothing is hit
    status     (n,)    see frame.Status
    side       (n,)    numbers that tell elements apart, and the faces of each; None: the owners do
    flat       (3,)    the normal where all of it lies in one plane, else None
    held       buffers of a device that hold some of these arrays, by name
    sections   of a plane cut: where elements may be seen, by running number, as cut_cull lists them
    offset     of a plane cut: normal · x
    uncertainty  (n,) the true depths are within this of the given ones, in world units, infinite where nothing is
                 proved and NaN where nothing is hit; None: those of a surface that is given in closed form
    doubt      (n,)    depths from which on something may have been overlooked, infinite where nothing was; None: none
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
    uncertainty: Floats | None = default(default_factory=lambda: None)
    doubt: Floats | None = default(default_factory=lambda: None)

    @staticmethod
    def made(made: Mapping[str, Callable[[], Any]], **known: Any) -> Layer:
        """A layer of which some arrays are made (or read from a device) when they are first asked for."""
        layer = object.__new__(Layer)
        known = {
            "held": {},
            "flat": None,
            "sections": None,
            "offset": 0.0,
            "uncertainty": None,
            "doubt": None,
            **({} if "side" in made else {"side": None}),
            **known,
        }
        vars(layer).update(known, _made=made)
        return layer

    def __getattr__(self, name: str) -> Any:
        """Make what isn't there yet."""
        if name not in (made := vars(self).get("_made", {})):
            raise AttributeError(name)
        return vars(self).setdefault(name, made[name]())

    @staticmethod
    def empty(count: int) -> Layer:
        """A layer without hits."""
        vectors = np.full((2, count, 3), np.nan)
        owner, status = np.full(count, NOBODY, np.uint32), np.zeros(count, np.uint8)
        return Layer(owner, np.full(count, np.nan), vectors[0], np.full(count, np.inf), vectors[1], status)

    def without(self, gone: Bools) -> Layer:
        """The layer without its hits in the pixels ``gone`` (n,)."""
        wide = gone[:, None]
        return Layer(
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
        )

    def clipped(self, gone: Bools, unsure: Bools) -> Layer:
        """The layer without its hits in the pixels ``gone`` (n,); where that is ``unsure`` (n,), they may be there."""
        layer = self.without(gone)
        doubt = np.full(len(gone), np.inf) if self.doubt is None else self.doubt
        layer.doubt = np.where(unsure, np.minimum(doubt, self.depth), doubt)
        status = np.where(unsure & (layer.status != Status.FAILED), np.uint8(Status.AMBIGUOUS), layer.status)
        layer.status = np.where(gone & np.isfinite(doubt), np.uint8(Status.AMBIGUOUS), status)
        return layer

    def on(self, device: Device, name: str) -> Buffer:
        """One of the arrays on a device, which it is brought to once."""
        if name not in self.held:
            self.held = {**self.held, name: device.buffer(getattr(self, name))}
        return self.held[name]

    def normals(self, device: Device, *, needed: bool = True) -> tuple[Buffer, bool]:
        """The normals on a device, or one for all pixels; and whether it is that."""
        if self.flat is None and needed:
            return self.on(device, "normal"), False
        return device.buffer(np.zeros(3) if self.flat is None else self.flat), True

    def showing(self, values: Floats) -> Layer:
        """The layer with other values (n,) as its field."""
        layer = copy(self)
        layer.field, layer.held = values, {name: own for name, own in self.held.items() if name != "field"}
        return layer

    @staticmethod
    def of_cut(
        device: Device,
        view: PlaneView,
        pixels: Pixels,
        held: Mapping[str, Buffer],
        sections: NDArray[Any] | None,
    ) -> Layer:
        """The pixels of a plane cut, whose image a device holds."""
        normal, hit = view.normal(), pixels.owner != NOBODY

        def read(name: str, size: int) -> Floats:
            values = device.read(held[name], np.float64).reshape(-1, size)
            values[~hit] = np.nan
            return values if size > 1 else values[:, 0]

        made = {
            "field": lambda: read("field", 1),
            "reference": lambda: read("reference", 3),
            "depth": lambda: np.where(hit, view.depths(), np.inf),
            "normal": lambda: np.where(hit[:, None], normal, np.nan),
        }
        known = {"owner": pixels.owner, "status": pixels.status, "held": held, "sections": sections}
        return Layer.made(made, flat=normal, offset=float(normal @ view.plane.point), **known)
