"""Moments of fields on boxes of collapsed coordinates: the right-hand sides of L2 projections, and mass matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.rows import Rows
from elvis.core.data.dataset import Expansion
from elvis.core.integrals.reference_cells import box_rule
from elvis.core.polynomials.boxnets import all_half_boxes
from elvis.core.polynomials.collapse import collapse_jacobian, uncollapse
from elvis.core.polynomials.cubature import COLLAPSE
from elvis.core.polynomials.expansion import mode_count
from elvis.core.polynomials.expansion import values as mode_values


@dataclass(frozen=True, eq=False)
class BlockBoxes(Rows):
    """Boxes of eta in elements (n,) of a block: ends (n, d)."""

    element: Ints
    low: Floats
    high: Floats

    def halved(self) -> BlockBoxes:
        """The halves in all directions, far apart for one box: half k of box i is number k n + i."""
        low, high = all_half_boxes(self.low, self.high)
        return BlockBoxes(np.tile(self.element, 2 ** self.low.shape[1]), low, high)


def orthonormal_spaces(spaces: Sequence[Expansion]) -> dict[Expansion, Floats]:
    """Distinct expansions, each with the matrix (m, m) that makes its functions orthonormal on the reference shape."""
    found: dict[Expansion, Floats] = {}
    for own in spaces:
        if own in found:
            continue
        counts = tuple(max(own.modes) + power for power in COLLAPSE[own.shape])
        eta, weights = box_rule(counts)
        table = mode_values(own, uncollapse(own.shape, eta))
        root = np.sqrt(weights * collapse_jacobian(own.shape, eta))
        found[own] = np.linalg.inv(np.linalg.qr(root[:, None] * table, mode="r"))
    return found


@dataclass(frozen=True, eq=False)
class Moments(Rows):
    """Moments on n boxes.

    fields     (n, fields, m) by space
    functions  (n, m, m) of the space's own functions
    measure    (n,) of the boxes
    missed     (n,) the part of it that the source doesn't cover
    size       (n, fields) integrals of magnitudes
    """

    fields: dict[Expansion, Floats]
    functions: dict[Expansion, Floats]
    measure: Floats
    missed: Floats
    size: Floats

    @staticmethod
    def none(count: int, many: int, spaces: dict[Expansion, Floats]) -> Moments:
        """Zero on ``count`` boxes, for ``many`` fields."""
        sizes = {own: mode_count(own) for own in spaces}
        fields = {own: np.zeros((count, many, size)) for own, size in sizes.items()}
        functions = {own: np.zeros((count, size, size)) for own, size in sizes.items()}
        return Moments(fields, functions, np.zeros(count), np.zeros(count), np.zeros((count, many)))

    def put(self, rows: Ints, other: Moments) -> None:
        """Replace the moments of some boxes (k,)."""
        for own in self.fields:
            self.fields[own][rows] = other.fields[own]
            self.functions[own][rows] = other.functions[own]
        self.measure[rows], self.missed[rows], self.size[rows] = other.measure, other.missed, other.size

    def summed(self, count: int) -> Moments:
        """The sums over the halves of each of ``count`` boxes."""

        def total(own: Floats) -> Floats:
            return np.asarray(own.reshape(-1, count, *own.shape[1:]).sum(axis=0))

        fields = {own: total(value) for own, value in self.fields.items()}
        functions = {own: total(value) for own, value in self.functions.items()}
        return Moments(fields, functions, total(self.measure), total(self.missed), total(self.size))

    def distance(self, other: Moments, measure: Floats, size: Floats) -> Floats:
        """(n,) the largest difference, as a share of the measure (n,) and the size (n, fields) of elements."""
        scale = np.maximum(size, 1e-300)[:, :, None]
        found = [np.abs(value - other.fields[own]) / scale for own, value in self.fields.items()]
        found += [
            np.abs(value - other.functions[own]) / measure[:, None, None] for own, value in self.functions.items()
        ]
        # in a box that the source covers in part, this share of the missed part is in doubt
        found.append(np.minimum(self.missed, self.measure - self.missed) / measure)
        # values that are not numbers stay so, however often boxes are bisected
        every = [np.nan_to_num(own.reshape(len(own), -1), nan=0.0).max(axis=1, initial=0.0) for own in found]
        return np.asarray(np.max(every, axis=0))


@dataclass(eq=False)
class Totals:
    """Moments of fields (n, fields, m) and of functions (n, m, m) on n elements, by space, and the measure missed."""

    fields: dict[Expansion, Floats]
    functions: dict[Expansion, Floats]
    missed: float = 0.0

    @staticmethod
    def none(count: int, many: int, spaces: dict[Expansion, Floats]) -> Totals:
        """Zero on ``count`` elements, for ``many`` fields."""
        sizes = {own: mode_count(own) for own in spaces}
        fields = {own: np.zeros((count, many, size)) for own, size in sizes.items()}
        return Totals(fields, {own: np.zeros((count, size, size)) for own, size in sizes.items()})

    def add(self, found: Moments, element: Ints, chosen: Bools) -> None:
        """Add the moments of chosen boxes to the moments of their elements (boxes,)."""
        rows = np.flatnonzero(chosen)
        self.missed += float(found.missed[rows].sum())
        for own in self.fields:
            np.add.at(self.fields[own], element[rows], found.fields[own][rows])
            np.add.at(self.functions[own], element[rows], found.functions[own][rows])


def moments_of(
    spaces: dict[Expansion, Floats], points: Floats, measure: Floats, values: Floats, is_missed: Bools
) -> Moments:
    """Moments from weights (n, q) and values (fields, n, q) at reference points (n q, d), some of which are outside."""
    fields, functions = dict[Expansion, Floats](), dict[Expansion, Floats]()
    for own, matrix in spaces.items():
        table = (mode_values(own, points) @ matrix).reshape(*measure.shape, -1)
        weighted = table * measure[:, :, None]
        fields[own] = np.einsum("fnq,nqm->nfm", values, weighted)
        functions[own] = np.einsum("nqk,nqm->nkm", table, weighted, optimize=True)
    size = np.einsum("fnq,nq->nf", np.abs(values), measure)
    missed = np.where(is_missed, measure, 0.0).sum(axis=1)
    return Moments(fields, functions, measure.sum(axis=1), missed, size)
