"""Errors of a conversion: the converted data against the source's own samples, at points not used by any fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.terminal import track
from elvis.core.base.threads import results
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.geometry import Part, parts
from elvis.core.mapping.tangents import determinants
from elvis.core.polynomials.evaluation import evaluate, evaluate_with_gradients
from elvis.core.shapes import Shape
from elvis.core.validity.folded import are_unfolded
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.checking import check_points, inside_count
from elvis.plugins.projection.fitting import FieldFit
from elvis.plugins.projection.sampling import BATCH, Sampler

#: of the reference shapes
VOLUMES = {
    Shape.SEGMENT: 2.0,
    Shape.TRIANGLE: 2.0,
    Shape.QUADRILATERAL: 4.0,
    Shape.TETRAHEDRON: 4 / 3,
    Shape.PYRAMID: 8 / 3,
    Shape.PRISM: 4.0,
    Shape.HEXAHEDRON: 8.0,
}

#: distances from the map of the source below this share of an element are rounding
_DEVIATION = 1e-11

#: numbers in an array of samples: several batches are held at once
_BATCH = BATCH // 4

#: how many of the elements with the largest differences a tally remembers
_LEADERS = 16

#: Jacobians below this share of an element's size to the power d are zero
_FLAT = 1e-12


@dataclass(eq=False)
class Tally:
    """Differences of one quantity, accumulated batch by batch.

    worst    the largest, and ``element`` the id in the file of its element; -1 if there is none
    square   integral of the squared difference
    low, high  of the source's values
    broken   ids of elements with source values that are not finite
    bound    and ids of the elements where the difference is ``beyond`` it
    leaders  (k,) ids of the elements with the largest differences, and these (k,)
    slope    the largest derivative of the difference in space, as far as it was measured
    terms    magnitude of the terms that add up to values, if known: rounding is relative to it
    """

    worst: float = 0.0
    element: int = -1
    square: float = 0.0
    low: float = np.inf
    high: float = -np.inf
    broken: list[Ints] = field(default_factory=list)
    bound: float = np.inf
    beyond: list[Ints] = field(default_factory=list)
    leaders: tuple[Ints, Floats] = (np.empty(0, np.int64), np.empty(0))
    slope: float = 0.0
    terms: float = 0.0

    def add(self, ids: Ints, differences: Floats, weights: Floats, values: Floats) -> None:
        """Include differences (k, n) with weights (k, i); the first i points count in the integral."""
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            self.broken.append(ids[~finite])
            ids, differences, weights, values = ids[finite], differences[finite], weights[finite], values[finite]
        if not len(ids):
            return
        most = differences.max(axis=1)
        first = int(most.argmax())
        if most[first] > self.worst or self.element < 0:
            self.worst, self.element = float(most[first]), int(ids[first])
        self.beyond.append(ids[most > self.bound])
        self._lead(ids, most)
        self.square += float((weights * differences[:, : weights.shape[1]] ** 2).sum())
        self.low, self.high = min(self.low, float(values.min())), max(self.high, float(values.max()))

    def include(self, other: Tally) -> None:
        """Take in what another one, of elements that come after these, has summed up."""
        if other.element >= 0 and (other.worst > self.worst or self.element < 0):
            self.worst, self.element = other.worst, other.element
        self.square += other.square
        self.low, self.high = min(self.low, other.low), max(self.high, other.high)
        self.broken += other.broken
        self.beyond += other.beyond
        self._lead(*other.leaders)

    def sharpen(self, other: Tally) -> None:
        """Include the worst difference and the range found at more points of the same elements."""
        if other.worst > self.worst:
            self.worst, self.element = other.worst, other.element
        self.low, self.high = min(self.low, other.low), max(self.high, other.high)

    def steepen(self, slopes: Floats) -> None:
        """Include derivatives of the difference; values that are not finite are ignored."""
        self.slope = max(self.slope, float(slopes[np.isfinite(slopes)].max(initial=0.0)))

    def _lead(self, ids: Ints, most: Floats) -> None:
        """Store elements, with their differences, that are among the largest."""
        all_ids, all_most = np.concatenate([self.leaders[0], ids]), np.concatenate([self.leaders[1], most])
        first = np.argsort(-all_most, kind="stable")[:_LEADERS]
        self.leaders = all_ids[first], all_most[first]


def joint(tallies: Sequence[Tally]) -> Tally:
    """Several quantities taken as one: the worst difference, the sum of the squares, the range of all."""
    worst = max(tallies, key=lambda each: each.worst)
    low, high = min(each.low for each in tallies), max(each.high for each in tallies)
    broken = [ids for each in tallies for ids in each.broken]
    slope = max(each.slope for each in tallies)
    return Tally(worst.worst, worst.element, sum(each.square for each in tallies), low, high, broken, slope=slope)


@dataclass(eq=False)
class Findings:
    """All that a check found.

    coordinates  distance between the map and the source's
    fields       for each field
    volume       of the domain
    box          (2, 3) of the points seen
    deviation    the largest distance as a share of its element's size, and the element's id
    exceeding    whether some distance is beyond what rounding explains
    inverted, degenerate   ids of elements with a negative Jacobian somewhere, with a vanishing one everywhere
    doubtful     ids of elements that a quick test doesn't prove to be unfolded
    """

    coordinates: Tally
    fields: list[Tally]
    volume: float = 0.0
    box: Floats = field(default_factory=lambda: np.array([[np.inf] * 3, [-np.inf] * 3]))
    deviation: tuple[float, int] = (0.0, -1)
    exceeding: bool = False
    inverted: list[Ints] = field(default_factory=list)
    degenerate: list[Ints] = field(default_factory=list)
    doubtful: list[Ints] = field(default_factory=list)

    @classmethod
    def none(cls, limits: Sequence[float]) -> Findings:
        """Findings of no elements.

        limits  for each field, the error beyond which elements are listed
        """
        return cls(Tally(), [Tally(bound=limit) for limit in limits])

    def include(self, other: Findings) -> None:
        """Include the findings of elements that come after these."""
        for own, its in zip((self.coordinates, *self.fields), (other.coordinates, *other.fields), strict=True):
            own.include(its)
        self.volume += other.volume
        low, high = np.minimum(self.box[0], other.box[0]), np.maximum(self.box[1], other.box[1])
        self.box = np.stack([low, high])
        if other.deviation[0] > self.deviation[0]:
            self.deviation = other.deviation
        self.exceeding |= other.exceeding
        self.inverted += other.inverted
        self.degenerate += other.degenerate
        self.doubtful += other.doubtful


@dataclass(frozen=True, eq=False)
class _Batch:
    """Samples of a source on some elements of a block at the points of a check.

    places  (k, n, 3) world coordinates
    values  (k, n) of each field, None if the block lacks it
    """

    block: NativeBlock
    rows: slice | Ints
    places: Floats
    values: list[Floats | None]


@dataclass(frozen=True, eq=False)
class _Check:
    """Converted data that are compared with samples of their source.

    inside     how many of the points count in integrals: the first ones
    limits     for each field, the error beyond which elements are listed
    precision  relative rounding of the source's coordinates
    """

    maps: Maps
    blocks: Sequence[NativeBlock]
    fitted: Sequence[FieldFit]
    inside: int
    limits: Sequence[float]
    precision: float

    def points(self, block: NativeBlock) -> Floats:
        """(n, d) native reference points of a block."""
        return check_points(block.shape, self.inside, block.is_collapsed)

    def sample(self, sampler: Sampler, number: int, rows: slice | Ints, points: Floats) -> _Batch:
        """Samples of the source on some elements of a block at its points (n, d)."""
        block = self.blocks[number]
        held = [each.modes[number] > 0 for each in self.fitted]
        values = [
            sampler.values(block, rows, each.field, points) if is_on else None
            for each, is_on in zip(self.fitted, held, strict=True)
        ]
        return _Batch(block, rows, sampler.positions(block, rows, points), values)

    def compare(self, number: int, batch: _Batch) -> Findings:
        """All that is found on some elements of the block of this number."""
        findings, block, rows = Findings.none(self.limits), batch.block, batch.rows
        own = self.points(block)
        weights = self._compare_map(findings, batch, own)
        for tally, each, values in zip(findings.fields, self.fitted, batch.values, strict=True):
            if values is None:
                continue
            ours = evaluate(block.expansion(each.modes[number]), each.coefficients[number][rows], own)
            with np.errstate(invalid="ignore"):
                tally.add(block.ids[rows], np.abs(ours - values), weights, values)
        return findings

    def _compare_map(self, findings: Findings, batch: _Batch, points: Floats) -> Floats:
        """Compare the map on some elements, check their Jacobians; the weights (k, inside) of integrals over them."""
        block, places, inside = batch.block, batch.places, self.inside
        ids = block.ids[batch.rows]
        ours, jacobians = self.maps.at(ids, points, inside, findings.doubtful)
        x, y, z = np.moveaxis(ours - places, 2, 0)
        distances = np.sqrt(x * x + y * y + z * z)
        # points first: NumPy then compares many elements at once
        by_point = np.ascontiguousarray(places.transpose(1, 0, 2))
        low, high = by_point.min(axis=0), by_point.max(axis=0)
        sizes = (high - low).max(axis=1)
        weights = np.abs(jacobians) * (VOLUMES[block.shape] / inside)
        findings.coordinates.add(ids, distances, weights, places.reshape(len(ids), -1))
        findings.volume = float(weights.sum())
        findings.box = np.stack([low.min(axis=0), high.max(axis=0)])

        # measured relative to the size of each element, and to the resolution of 64 bits or of the source's own digits
        most = distances.max(axis=1)
        share = most / np.where(sizes > 0, sizes, 1.0)
        if len(share) and share.max() > 0:
            findings.deviation = (float(share.max()), int(ids[share.argmax()]))
        magnitudes = np.maximum(np.abs(low), np.abs(high)).max(axis=1)
        noise = (2 * self.precision + 64 * np.finfo(float).eps * (block.source.order + 1)) * magnitudes
        findings.exceeding = bool((most > _DEVIATION * sizes + noise).any())
        scale = sizes**block.shape.dimension
        flat: Bools = (np.abs(jacobians) <= _FLAT * scale[:, None]).all(axis=1)
        findings.degenerate.append(ids[flat])
        findings.inverted.append(ids[(jacobians < 0).any(axis=1) & ~flat])
        return weights


def check(
    sampler: Sampler,
    maps: Maps,
    blocks: Sequence[NativeBlock],
    fitted: Sequence[FieldFit],
    precision: float,
    bounds: Sequence[float] = (),
    only: Ints | None = None,
    inside: int | None = None,
) -> Findings:
    """Compare the map of a dataset, and the fields, with the source.

    precision  relative rounding of the source's coordinates
    bounds     for each field, the error beyond which elements are listed
    only       ids of the elements to check; None for all
    inside     points inside each element; None for as many as the time allows

    Only the calling thread queries the source; others compare meanwhile, and their results are added in order.
    """
    limits = [*bounds, *[np.inf] * (len(fitted) - len(bounds))]
    inside = inside or inside_count(sum(map(len, blocks)))
    work = _Check(maps, blocks, fitted, inside, limits, precision)
    parts = [
        (i, *part)
        for i, block in enumerate(blocks)
        for part in sampler.batches(block, work.points(block), _BATCH, only)
    ]
    jobs = (partial(work.compare, part[0], work.sample(sampler, *part)) for part in parts)
    findings = Findings.none(limits)
    for found in track(results(jobs), "checking", len(parts)):
        findings.include(found)
    return findings


class Maps:
    """The geometry of a dataset, by element."""

    def __init__(self, dataset: Dataset) -> None:
        self.blocks = parts(dataset)
        self.is_flat = dataset.mesh.space == dataset.mesh.dimension == 2
        self.is_oriented = dataset.mesh.space == dataset.mesh.dimension
        ids = np.concatenate([block.element_ids for block in self.blocks])
        self._order = np.argsort(ids, kind="stable")
        self._ids = ids[self._order]
        self._block = np.repeat(np.arange(len(self.blocks)), [len(block) for block in self.blocks])
        self._row = np.concatenate([np.arange(len(block)) for block in self.blocks])

    def at(self, ids: Ints, points: Floats, inside: int, doubtful: list[Ints] | None = None) -> tuple[Floats, Floats]:
        """Positions (k, n, 3) of elements ``ids`` at reference points (n, d); Jacobians (k, inside) at the first.

        doubtful  receives ids of elements that a quick test doesn't prove to be unfolded
        """
        places = np.empty((len(ids), len(points), 3))
        matrices = np.empty((len(ids), inside, 3, points.shape[1]))
        for block, here, rows, own in self._parts(ids):
            places[here] = evaluate(block.expansion, own, points).transpose(0, 2, 1)
            gradients = evaluate_with_gradients(block.expansion, own, points[:inside])[1]
            matrices[here] = gradients.transpose(0, 2, 1, 3)
            if doubtful is not None and self.is_oriented:
                doubtful.append(ids[here][~are_unfolded(block, rows, own)])
        return places, self._determinants(matrices)

    def tangents(self, ids: Ints, points: Floats) -> tuple[Floats, Floats]:
        """Positions (k, n, 3) and Jacobian matrices (k, n, 3, d) of elements ``ids`` at reference points (n, d)."""
        places, matrices = np.empty((len(ids), len(points), 3)), np.empty((len(ids), len(points), 3, points.shape[1]))
        for block, here, _, own in self._parts(ids):
            found, gradients = evaluate_with_gradients(block.expansion, own, points)
            places[here], matrices[here] = found.transpose(0, 2, 1), gradients.transpose(0, 2, 1, 3)
        return places, matrices

    def _parts(self, ids: Ints) -> Iterator[tuple[Part, slice | Ints, Ints, Floats]]:
        """Blocks, where in ``ids`` their elements are, their rows in the block, and their coefficients."""
        place = self._order[np.searchsorted(self._ids, ids)]
        which, rows = self._block[place], self._row[place]
        numbers = np.unique(which).tolist()
        for number in numbers:
            here = slice(None) if len(numbers) == 1 else np.flatnonzero(which == number)
            yield self.blocks[number], here, rows[here], self.blocks[number].take(rows[here])

    def _determinants(self, matrices: Floats) -> Floats:
        """(k, n) of Jacobian matrices (k, n, 3, d); unsigned for curves and surfaces in space."""
        if matrices.shape[3] == 3 or not self.is_flat:
            flat = determinants(matrices.reshape(-1, 3, matrices.shape[3]))
            return flat.reshape(matrices.shape[:2])
        return np.asarray(np.linalg.det(matrices[:, :, :2]))
