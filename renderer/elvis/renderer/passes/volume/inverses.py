"""Models of the inverse map, by which rays are followed in large elements without Newton's method (volume_model.slang).

They depend on the elements alone, and are found for an element once it covers enough pixels.  How far the polynomials
along rays may be from a field follows from the errors of the models and from the field's own series in their boxes.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, Records
from elvis.core.chebyshev_models.inverse_maps import (
    InverseMaps,
    around,
    growth_at,
    horner_order,
    inverse_maps,
    largest_sum,
    on_boxes,
    reach_of,
    to_powers,
    weighted,
)
from elvis.core.chebyshev_models.model_boxes import ShapeFacets
from elvis.core.chebyshev_models.series import slopes_of
from elvis.core.mapping.margins import facets
from elvis.renderer.device.device import Kernel
from elvis.renderer.device.leaf_types import along_rays
from elvis.renderer.device.memory import Buffer
from elvis.renderer.passes.faces.faces import pixel_bounds
from elvis.renderer.passes.volume.bends import Bends
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View

#: how often boxes of elements are halved, at most
_MOST_HALVINGS = 2
#: maximum error of a model that suffices, in coordinates of the cube; boxes of others are halved if it is worth while
_SUFFICIENT = 1e-5
#: pixels that an element covers before a model of it saves more time than it takes, for each of its boxes
_PIXELS_OF_A_BOX = 60
#: elements that are tried first: if models of none of them suffice, boxes of all others are halved at once
_SAMPLE = 8
#: boxes of a part that have models, at most: they take 12 kB each
_MOST_BOXES = 1 << 16
#: degree of polynomials along rays from which on they hold on long parts
_LEAST_DEGREE = 6
#: parts into which rays through a box may be divided: the smallest sufficient number, which may be a fraction, is used
_PIECES = (1.0, 1.25, 1.6, 2.0, 3.0)
#: errors of fields that are allowed where there are models, relative to other elements: those take up to a quarter of
#: the error of a pixel, quadrature half of it
_OF_PROOF = 1.75
#: half axes of ellipses around parts of rays
_AXES = (1.5, 2.0, 2.7, 3.6, 5.0, 7.0)
#: rounding of values and of their polynomials, relative to the magnitudes of terms: ample
_ROUNDING = 1e-11
#: boxes that are bounded together, and those whose values at many points stay in the processor's cache
_AT_ONCE, _IN_CACHE = 256, 4


@dataclass(eq=False)
class KnownInverses:
    """Models of the inverse maps of some elements of a part.

    tried  (elements,) number of halvings that have been tried
    """

    tried: Ints
    found: list[InverseMaps] = field(default_factory=list)

    def add(self, series: Floats, inside: ShapeFacets, pixels: Ints) -> None:
        """Find models of further elements, from the series of all maps and the number of pixels that they cover."""
        for halvings in range(_MOST_HALVINGS + 1):
            worthwhile = pixels >= _PIXELS_OF_A_BOX * 8**halvings
            rows = np.flatnonzero((self.tried == halvings) & worthwhile)
            room = max(0, _MOST_BOXES - sum(map(len, self.found))) // 8**halvings
            if len(rows) > room:
                rows = np.sort(rows[np.argsort(-pixels[rows], kind="stable")[:room]])
            some = rows[:: max(1, len(rows) // _SAMPLE)]
            if len(rows) > len(some) and not self._try(series, inside, some, halvings).any():
                self.tried[rows] = halvings + 1
                continue
            rows = rows[self.tried[rows] == halvings]
            if len(rows):
                self._try(series, inside, rows, halvings)

    def _try(self, series: Floats, inside: ShapeFacets, rows: Ints, halvings: int) -> Bools:
        """Find models of elements; returns in which of all elements they suffice."""
        models = inverse_maps(series, inside, rows, halvings)
        suffices = elements_with(models, models.error * models.half <= _SUFFICIENT, len(self.tried))
        self.tried[rows] = np.where(suffices[rows], _MOST_HALVINGS + 1, halvings + 1)
        self.found.append(models.part(suffices[models.element]))
        return suffices


def pixels_of(patches: Records, view: View, count: int) -> Ints:
    """(count,) pixels of the rectangles that hold elements, from patches of their faces."""
    least, most = pixel_bounds(patches, view)
    low, high = np.full((count, 2), np.iinfo(np.int64).max), np.full((count, 2), -1)
    np.minimum.at(low, patches["element"], least[:, :2])
    np.maximum.at(high, patches["element"], most[:, :2])
    return np.asarray(np.maximum(high - low + 1, 0).prod(axis=1))


def elements_with(models: InverseMaps, good: Bools, count: int) -> Bools:
    """(count,) elements all of whose boxes are good."""
    present, bad = (np.zeros(count, bool) for _ in range(2))
    present[models.element] = True
    bad[models.element[~good]] = True
    return present & ~bad


class Inverses:
    """Models of the inverse maps in a volume, and of how far fields are from polynomials along rays that use them."""

    def __init__(self, loaded: DeviceVolume, bends: Bends) -> None:
        self._loaded, self._bends = loaded, bends
        self._series: dict[tuple[int, str | None], Floats] = {}
        self._buffers: dict[tuple[int, str | None, int], tuple[tuple[int, float], dict[str, Buffer]]] = {}
        self._judged: dict[tuple[int, str | None, int], tuple[float, list[tuple[InverseMaps, Floats, Floats]]]] = {}

    def buffers(
        self, number: int, quantity: str | None, kernel: Kernel, degree: int, allowed: float, pixels: Ints
    ) -> dict[str, Buffer]:
        """Inputs of volume_model.slang, for polynomials of a degree with an allowed error.

        pixels  (elements,) how many each element of the part covers
        """
        known = self._known(number, quantity, degree, pixels)
        state = sum(map(len, known.found)), allowed
        before = self._buffers.get((number, quantity, degree))
        if before is None or before[0] != state:
            before = state, self._bring(number, quantity, kernel, degree, _OF_PROOF * allowed, known)
            self._buffers[number, quantity, degree] = before
        return before[1]

    def _known(self, number: int, quantity: str | None, degree: int, pixels: Ints) -> KnownInverses:
        """The models of a part's elements, with those of elements that cover enough pixels."""
        part, chosen = self._loaded.parts[number], self._loaded.quantity(number, quantity)
        has_models = chosen.degree > 0 and degree >= _LEAST_DEGREE
        if not has_models or part.shape is None or part.collapsed:
            return KnownInverses(np.zeros(0, np.int64))
        key = ("inverse maps", number)
        known = self._loaded.once(key, lambda: KnownInverses(np.zeros(len(part), np.int64)))
        if ((known.tried <= _MOST_HALVINGS) & (pixels >= _PIXELS_OF_A_BOX * 8**known.tried)).any():
            normals, offsets = facets(part.shape)
            inside = ShapeFacets(np.column_stack([normals, offsets]))
            known.add(self._series_of(number, quantity)[:, :3], inside, pixels)
        return known

    def _series_of(self, number: int, quantity: str | None) -> Floats:
        """(elements, 4, count three times) series of the map and of a polynomial quantity on the elements' cubes."""
        if (number, quantity) not in self._series:
            self._series[number, quantity] = self._bends.series(number, quantity)
        return self._series[number, quantity]

    def _bring(
        self, number: int, quantity: str | None, kernel: Kernel, degree: int, allowed: float, known: KnownInverses
    ) -> dict[str, Buffer]:
        """The models of elements in which the error is allowed."""
        device, count = self._loaded.device, len(self._loaded.parts[number])
        found = self._judged_models(number, quantity, degree, allowed, known)
        records = np.zeros(sum(len(models) for models, _, _ in found), kernel.dtype("models"))
        boxes = np.zeros(count + 1, np.uint32)
        terms = np.zeros(1)
        if len(records):
            models = InverseMaps.joined([own for own, _, _ in found])
            order = np.argsort(models.element, kind="stable")
            models = models.part(order)
            records["origin"] = models.origin
            for axis, name in enumerate(("across_x", "across_y", "across_z")):
                records[name] = models.axes[:, axis]
            records["off"] = np.concatenate([off for _, off, _ in found])[order]
            records["longest"] = 2.0 / np.concatenate([pieces for _, _, pieces in found])[order]
            boxes[1:] = np.cumsum(np.bincount(models.element, minlength=count))
            terms = _terms(models)
        arrays = {"models": records if len(records) else np.zeros(1, records.dtype), "boxes": boxes, "inverse": terms}
        return {name: device.buffer(array) for name, array in arrays.items()}

    def _judged_models(
        self, number: int, quantity: str | None, degree: int, allowed: float, known: KnownInverses
    ) -> list[tuple[InverseMaps, Floats, Floats]]:
        """Models as of `_allowed`, one group for each that has been found; only new ones are examined."""
        before, found = self._judged.get((number, quantity, degree), (allowed, []))
        if before != allowed:
            found = []
        # models are only ever added
        for models in known.found[len(found) :]:
            found.append(self._allowed(number, quantity, degree, allowed, models))
        self._judged[number, quantity, degree] = allowed, found
        return found

    def _allowed(
        self, number: int, quantity: str | None, degree: int, allowed: float, models: InverseMaps
    ) -> tuple[InverseMaps, Floats, Floats]:
        """Models of elements in which the error is allowed, errors (n,), and the pieces (n,) of rays in each box."""
        enclosure = along_rays(self._loaded.parts[number], self._loaded.quantity(number, quantity))
        assert enclosure is not None
        errors = enclosure.errors()[:, 3]
        series = self._series_of(number, quantity)[:, 3:]
        off, pieces = np.full(len(models), np.inf), np.full(len(models), _PIECES[-1])
        for first in range(0, len(models), _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            own = models.part(some)
            field = on_boxes(series, own.element, own.centre, own.half)[:, 0]
            off[some], pieces[some] = errors_along_rays(own, field, errors[own.element], degree, allowed)
        good = elements_with(models, off <= allowed, len(errors))[models.element]
        return models.part(good), off[good], pieces[good]


def errors_along_rays(
    models: InverseMaps, field: Floats, errors: Floats, degree: int, allowed: float
) -> tuple[Floats, Floats]:
    """How far fields may be from polynomials along rays in boxes (n,), and the pieces (n,) of rays that this needs.

    A ray has y linear in depth, and v = P(y) is a polynomial.  On an ellipse around a piece, so are bounds of v, and of
    the field.  Trefethen's theorem 8.2 gives the error of a polynomial through Chebyshev points (volume_enclose.slang).

    field   (n, count three times) series in the boxes
    errors  (n,) of computed values
    """
    magnitudes = np.abs(field)
    fixed = _steepness(models, field) * models.error + 8.0 * errors + _ROUNDING * magnitudes.sum(axis=(1, 2, 3))
    magnitudes[:, 0, 0, 0] = 0.0
    off, pieces = np.full(len(models), np.inf), np.full(len(models), _PIECES[-1])
    left = np.arange(len(models))
    for number in _PIECES:
        best = _tails(np.abs(models.series[left]), magnitudes[left], degree, number)
        off[left], pieces[left] = best + fixed[left], number
        left = left[~(off[left] <= allowed) & (fixed[left] <= allowed)]
        if not len(left):
            break
    return off, pieces


def _tails(inverse: Floats, changing: Floats, degree: int, number: float) -> Floats:
    """(n,) how far fields may be from polynomials on a part of rays through boxes, from the magnitudes of all terms."""
    best = np.full(len(inverse), np.inf)
    for axis in _AXES:
        weights = growth_at(around(reach_of(inverse, 1.0 + (axis - 1.0) / number)), changing.shape[-1])
        ratio = axis + np.sqrt(axis * axis - 1.0)
        tail = 4.0 * ratio**-degree / (ratio - 1.0)
        best = np.minimum(best, tail * weighted(changing, weights, weights, weights))
    return best


def _steepness(models: InverseMaps, field: Floats) -> Floats:
    """(n,) bounds of sums of the magnitudes of first derivatives of series (n, count three times) in the elements."""
    found = []
    for first in range(0, len(field), _IN_CACHE):
        some = slice(first, first + _IN_CACHE)
        slopes = np.stack([slopes_of(field[some], direction) for direction in range(3)], axis=1)
        found.append(largest_sum(slopes, models.centre[some], models.half[some]))
    return np.concatenate(found)


def _terms(models: InverseMaps) -> Floats:
    """Coefficients of reference coordinates, as nested Horner schemes read them: powers of z, y and x descend."""
    powers = to_powers(models.series) * models.half[:, None, None]
    powers[:, :, 0] += models.centre
    return np.ascontiguousarray(powers[:, :, horner_order(models.series.shape[-1] - 1)].swapaxes(1, 2))
