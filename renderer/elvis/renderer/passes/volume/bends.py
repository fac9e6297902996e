"""How much quantities bend along rays, for proofs of volumes (volume_bends.slang, volume_enclose.slang)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.polynomial import chebyshev

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.chebyshev_models.series import coefficients_of
from elvis.core.polynomials.chebyshev_nodes import series
from elvis.core.shapes import Shape
from elvis.plugins.runtime.volume import Enclosure
from elvis.renderer.device.leaf_types import along_rays
from elvis.renderer.device.memory import Buffer
from elvis.renderer.passes.volume.simplex_bends import RADII, nodes, tetrahedron_bends
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.renderer.volume.traversal import MORE

#: long half axes of ellipses in elements' cubes that bends are known on, as many as in volume_enclose.slang; around
#: tetrahedra there are distances in their place
CUBE_AXES = (1.02, 1.08, 1.2, 1.45, 2.0, 3.0, 5.0, 9.0, 16.0)
#: half axes of ellipses around parts of rays, the same number as in cubes: the first is the part itself
LINE_AXES = (1.0, 1.3, 1.8, 2.8, 4.5, 8.0)
#: of both (9, 2) the half axis, and the distance in which they are known
ELLIPSES = np.column_stack([CUBE_AXES, np.full(len(CUBE_AXES), 1e300)])
BALLS = np.column_stack([np.full(len(RADII), 1e150), RADII])
#: numbers on the device together on the way
_AT_ONCE = 1 << 22


class Bends:
    """Sums of first and second derivatives of the leaves of a volume's quantities, on and around each element."""

    def __init__(self, loaded: DeviceVolume) -> None:
        self._loaded = loaded
        self._known: dict[tuple[int, str | None], dict[str, Buffer]] = {}

    def buffers(self, number: int, quantity: str | None, degree: int) -> dict[str, Buffer]:
        """Inputs of volume_trace.slang for a part's quantity, for polynomials along rays of a degree."""
        if (number, quantity) not in self._known:
            self._known[number, quantity] = self._find(number, quantity)
        tails = self._loaded.device.buffer(line_tails(degree + MORE))
        return {**self._known[number, quantity], "line_tails": tails}

    def _find(self, number: int, quantity: str | None) -> dict[str, Buffer]:
        """The same but for what depends on the degree."""
        device, part = self._loaded.device, self._loaded.parts[number]
        enclosure = along_rays(part, self._loaded.quantity(number, quantity))
        found = {"line_axes": device.buffer(np.array(LINE_AXES))}
        found["leaf_errors"] = device.buffer(np.zeros(1) if enclosure is None else enclosure.errors())
        bent, rooms = np.zeros(1), ELLIPSES
        if enclosure is not None:
            around = self._around_tetrahedra(number, quantity, enclosure) if part.shape is Shape.TETRAHEDRON else None
            bent, rooms = (self._in_cubes(number, quantity, enclosure), ELLIPSES) if around is None else (around, BALLS)
        return {**found, "bent": device.buffer(bent), "cube_axes": device.buffer(rooms)}

    def series(self, number: int, quantity: str | None) -> Floats:
        """Chebyshev series (elements, 4, n, n, n) of the map and of a polynomial quantity of a part on its cubes."""
        enclosure = along_rays(self._loaded.parts[number], self._loaded.quantity(number, quantity))
        assert enclosure is not None
        count = enclosure.degree + 1
        found = list[Floats]()
        for _, values, _ in self._sampled(number, quantity, enclosure, series(enclosure.degree)[0], 0):
            # four leaves, and scratch memory for one more
            own = values.reshape(-1, 5 * count**3)[:, : 4 * count**3].reshape(-1, count**3, 4).swapaxes(1, 2)
            found.append(coefficients_of(own.reshape(-1, 4, count, count, count)))
        return np.concatenate(found)

    def _around_tetrahedra(self, number: int, quantity: str | None, enclosure: Enclosure) -> Floats | None:
        """(elements, leaves, distances, 2) of a part's quantity; None where its leaves are not of a total degree."""
        errors, degree = enclosure.errors(), enclosure.degree
        leaves, parts = 3 + enclosure.fields, list[Floats]()
        for first, values, _ in self._sampled(number, quantity, enclosure, nodes(degree), 0):
            count = len(values) // ((leaves + 1) * (degree + 1) ** 3)
            own = values.reshape(count, leaves + 1, -1)[:, :leaves].reshape(count, -1, leaves)
            bent = tetrahedron_bends(own.swapaxes(1, 2), errors[first : first + count], degree)
            if bent is None:
                return None
            parts.append(bent)
        return np.concatenate(parts)

    def _in_cubes(self, number: int, quantity: str | None, enclosure: Enclosure) -> Floats:
        """Curvature (elements, leaves, ellipses, 2) of the leaves of a part's quantity, one after the other."""
        places = series(enclosure.degree)[0]
        sampled = self._sampled(number, quantity, enclosure, places, len(CUBE_AXES))
        return np.concatenate([bent for _, _, bent in sampled])

    def _sampled(
        self, number: int, quantity: str | None, enclosure: Enclosure, places: Floats, ellipses: int
    ) -> Iterator[tuple[int, Floats, Floats]]:
        """For blocks of elements, samples of a part's leaves at a lattice of points, and on some ellipses."""
        loaded, device, part = self._loaded, self._loaded.device, self._loaded.parts[number]
        kernel = device.kernel("volume_bends", part, quantity)
        transform = series(enclosure.degree)[1]
        arrays = {"leaf_nodes": places, "leaf_chebyshev": transform, "grown": _grown(enclosure.degree)}
        arrays["leaf_errors"] = enclosure.errors()
        buffers = {name: device.buffer(array) for name, array in arrays.items()} | loaded.bindings(number, quantity)
        leaves, terms = 3 + enclosure.fields, (enclosure.degree + 1) ** 3
        most = max(1, _AT_ONCE // ((leaves + 1) * terms))
        for first in range(0, len(part), most):
            count = min(most, len(part) - first)
            size = 2 * leaves * ellipses * count
            wanted = np.zeros(1, kernel.dtype("wanted"))
            wanted["first"], wanted["count"], wanted["ellipses"] = first, count, ellipses
            own = {"wanted": device.buffer(wanted), "bent": device.empty(np.float64, max(1, size))}
            own["values"] = device.empty(np.float64, count * (leaves + 1) * terms)
            kernel(count, {**buffers, **own})
            values = np.zeros(0) if ellipses else device.read(own["values"], np.float64)
            bent = device.read(own["bent"], np.float64)[:size]
            yield first, values[: count * (leaves + 1) * terms].copy(), bent.copy()


@bounded_cache
def line_tails(degree: int) -> Floats:
    """(ellipses,) 4 r^-degree / (r - 1), r = a + sqrt(a^2 - 1), as in volume_enclose.slang; infinite for a = 1."""
    axes = np.array(LINE_AXES)
    ratio = axes + np.sqrt(axes * axes - 1.0)
    with np.errstate(divide="ignore"):
        return frozen_floats(4.0 * ratio**-degree / (ratio - 1.0))


@bounded_cache
def _grown(degree: int) -> Floats:
    """(ellipses, degree + 1, 3) largest values of T_k and of its first and second derivative: at the axes' ends."""
    axes, found = np.array(CUBE_AXES), np.zeros((len(CUBE_AXES), degree + 1, 3))
    for k in range(degree + 1):
        for order in range(3):
            term = np.eye(degree + 1)[k]
            found[:, k, order] = chebyshev.chebval(axes, chebyshev.chebder(term, order) if order else term)
    return frozen_floats(found * (1.0 + 1e-12))
