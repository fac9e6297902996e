"""Line integral convolution in NumPy: lines by Runge and Kutta's method, all pixels at a time.

Only the noise, the weights along a line and the meaning of a mean are shared with the renderer
(elvis.scene.flow.streaks).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.bounds.bounding import quantity_range
from elvis.core.data.dataset import Dataset
from elvis.core.quantities import Expression
from elvis.core.streamlines.course import REST
from elvis.reference.hits import Hits
from elvis.scene import Lic
from elvis.scene.cameras.view import View
from elvis.scene.flow.streaks import cells, middle, noise, scale_of, tones, weights

#: steps of an integration between two places that noise is taken from
_FINER = 2
#: sine of the angle between a surface and the line from one hit to the next, beyond which it doesn't go on there
_STEEP = 0.5


def margin(lic: Lic) -> int:
    """Pixels around a picture that lines reach into."""
    return int(np.ceil(0.5 * lic.length)) + 1


def padded(view: View, around: int) -> View:
    """A view with ``around`` more pixels on each side, where the first is pixel (0, 0)."""
    wide, high = view.width + 2 * around, view.height + 2 * around
    return replace(view.shifted(-around, -around), width=wide, height=high)


def inner(values: Floats, view: View, around: int) -> Floats:
    """(n,) what of values (m,) of the padded view belongs to the pixels of the view itself."""
    rows, columns = view.height + 2 * around, view.width + 2 * around
    kept = slice(around, around + view.height), slice(around, around + view.width)
    return values.reshape(rows, columns)[kept].reshape(-1)


def rest(dataset: Dataset | None, lic: Lic) -> float:
    """The speed that counts as none: a part of the certified bounds of the components, zero if none are known."""
    if dataset is None:
        return 0.0
    known = [quantity_range(dataset, Expression.of(dataset, name)) for name in lic.components]
    ends = [max(abs(own.lower), abs(own.upper)) if own else np.inf for own in known]
    return REST * max(ends) if np.isfinite(ends).all() else 0.0


def streaks(hits: Hits, lic: Lic, view: View, least: float) -> Floats:
    """(n,) tones of the hits, NaN if there are none.

    hits   with the values of the components
    least  a speed along the surface up to this value counts as zero
    """
    image = Image.of(hits, lic, view, least)
    first, shape = cells(view, lic.width)
    lattice, origin, scale = noise(tuple(first.tolist()), shape), middle(view), scale_of(lic.width)
    step, own = weights(lic.length)

    def noise_at(places: Floats) -> Floats:
        return _bilinear(lattice, (places - origin) * scale - first)

    pixel = np.flatnonzero(image.motion.any(axis=-1))
    start = np.stack(np.divmod(pixel, view.width)[::-1], axis=1).astype(np.float64)
    weight, squares = np.full(len(pixel), own[0]), np.full(len(pixel), own[0] ** 2)
    total = own[0] * noise_at(start)
    for sense in (1.0, -1.0):
        place, going = start.copy(), np.arange(len(pixel))
        for amount in own[1:]:
            for _ in range(_FINER):
                place[going], goes = image.advance(place[going], sense * step / _FINER)
                going = going[goes]
            total[going] += amount * noise_at(place[going])
            weight[going] += amount
            squares[going] += amount**2
    found = np.full(view.count, np.nan)
    found[pixel] = tones(total / weight, step * weight, step * squares, lic.width)
    return found


def _bilinear(lattice: Floats, places: Floats) -> Floats:
    """(n,) a lattice (rows, columns) at places (n, 2), column and row."""
    corner = np.floor(places).astype(np.int64)
    part = places - corner
    total = np.zeros(len(places))
    for across, along in np.ndindex(2, 2):
        share = np.abs(1.0 - across - part[:, 0]) * np.abs(1.0 - along - part[:, 1])
        total += share * lattice[corner[:, 1] + along, corner[:, 0] + across]
    return total


@dataclass(frozen=True, eq=False)
class Image:
    """Movement of hits in the picture, and the neighbours that show the same surface.

    motion  (n, 2) of pixels, in columns and rows, zero if nothing moves
    joined  (n, 3, 3)  whether the pixel in the row above, this one or below, in the column before, this one or after,
                       does
    """

    view: View
    motion: Floats
    joined: Bools

    @staticmethod
    def of(hits: Hits, lic: Lic, view: View, least: float) -> Image:
        """The movement of hits, from their places and normals."""
        velocity = np.zeros((view.count, 3))
        for axis, name in enumerate(lic.components):
            velocity[:, axis] = hits.values[name]
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            velocity -= np.einsum("ni,ni->n", velocity, hits.normal)[:, None] * hits.normal

            # the derivative of the projection along the velocity, by a step that is not real (Squire and Trapp 1998)
            size = 1e-30 / np.linalg.norm(velocity, axis=1, keepdims=True)
            placed = view.projected(hits.position.astype(complex) + 1j * size * velocity)
            motion = (placed[:, :2] / placed[:, 2:]).imag
            moves = np.linalg.norm(velocity, axis=1) > least
        good = hits.seen & moves & np.isfinite(motion).all(axis=1)
        speed = np.linalg.norm(velocity, axis=1, keepdims=True)
        motion = np.where(good[:, None], motion * speed * 1e30, 0.0)
        return Image(view, motion, _joined(hits, view))

    def directions(self, places: Floats, pixel: Ints) -> Floats:
        """(n, 2) unit directions at places (n, 2) whose nearest pixels are ``pixel`` (n, 2); zero at rest."""
        corner = np.floor(places).astype(np.int64)
        part = places - corner
        total = np.zeros((len(places), 2))
        own = pixel[:, 1] * self.view.width + pixel[:, 0]
        for across, along in np.ndindex(2, 2):
            other = corner + np.array([across, along])
            apart = other - pixel + 1
            counts = self.joined[own, apart[:, 1], apart[:, 0]]
            share = np.abs(1.0 - across - part[:, 0]) * np.abs(1.0 - along - part[:, 1])
            number = np.where(counts, other[:, 1] * self.view.width + other[:, 0], own)
            total += np.where(counts, share, 0.0)[:, None] * self.motion[number]
        size = np.linalg.norm(total, axis=1, keepdims=True)
        return np.divide(total, size, out=np.zeros_like(total), where=size > 0.0)

    def advance(self, places: Floats, step: float) -> tuple[Floats, Bools]:
        """(n, 2) places a step further by the classical method of order 4; (n,) whether lines go on there.

        They end at rest, where they leave the surface, and where they would turn back.
        """
        pixel = np.floor(places + 0.5).astype(np.int64)
        first = self.directions(places, pixel)
        goes, slopes = first.any(axis=1), [first]
        for part in (0.5, 0.5, 1.0):
            there, kept = self._moved(places, pixel, part * step * slopes[-1])
            slopes.append(np.where(kept[:, None], self.directions(there, np.floor(there + 0.5).astype(np.int64)), 0.0))
            goes &= kept & (np.einsum("ni,ni->n", slopes[-1], first) > 0.0)
        way = (slopes[0] + 2.0 * slopes[1] + 2.0 * slopes[2] + slopes[3]) / 6.0
        there, kept = self._moved(places, pixel, step * way)
        return there, goes & kept

    def _moved(self, places: Floats, pixel: Ints, way: Floats) -> tuple[Floats, Bools]:
        """Places (n, 2) elsewhere, or where they were if that isn't on the same surface; (n,) whether it is."""
        there = places + way
        apart = np.floor(there + 0.5).astype(np.int64) - pixel + 1
        own = pixel[:, 1] * self.view.width + pixel[:, 0]
        kept = self.joined[own, apart[:, 1], apart[:, 0]]
        return np.where(kept[:, None], there, places), kept


def _joined(hits: Hits, view: View) -> Bools:
    """(n, 3, 3) see Image."""
    shape = view.height, view.width
    seen = np.pad(hits.seen.reshape(shape), 1)
    place, normal = (
        np.pad(own.reshape(*shape, 3), ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
        for own in (hits.position, hits.normal)
    )
    found = np.zeros((*shape, 3, 3), bool)
    middle_part = slice(1, -1), slice(1, -1)
    for row, column in np.ndindex(3, 3):
        other = slice(row, row + view.height), slice(column, column + view.width)
        way = place[other] - place[middle_part]
        most = _STEEP * np.linalg.norm(way, axis=-1)
        with np.errstate(invalid="ignore"):
            flat = [np.abs(np.einsum("hwi,hwi->hw", way, normal[side])) <= most for side in (middle_part, other)]
        found[..., row, column] = seen[middle_part] & seen[other] & flat[0] & flat[1]
    return found.reshape(-1, 3, 3)
