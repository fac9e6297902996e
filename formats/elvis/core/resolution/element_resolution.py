"""Measures of resolution of one field on each element."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, joined_columns
from elvis.core.base.errors import ElvisError
from elvis.core.base.rows import Rows
from elvis.core.data.dataset import Dataset, Expansion
from elvis.core.mapping.geometry import kept
from elvis.core.mapping.orientation import chunks, local_vertices
from elvis.core.mapping.patch import Patch, patches
from elvis.core.numbers.norms import stretch_factors
from elvis.core.polynomials.evaluation import evaluate, evaluate_with_gradients
from elvis.core.quantities.derived import TRUNCATED, derived_name
from elvis.core.resolution.decay_rates import (
    LOWEST_ORDER,
    OWN_RATES_FROM,
    acceleration,
    decay_rates,
    grows_at_top,
    remainder_shares,
)
from elvis.core.resolution.modal_bases import ModalBasis, exact_rule, modal_basis
from elvis.core.resolution.stored_precision import DOUBLE, SINGLE, is_single

#: numbers in a table of values at quadrature points
_BATCH = 1 << 20
#: amplitude of the highest level, relative to the largest root mean square, below which growth there is not reported:
#: below it lies the noise of single precision and of iterative solvers
_NOISE = 1e-6


@dataclass(frozen=True, eq=False)
class ElementResolution(Rows):
    """Measures of one field on elements (n,).  They are estimates, not bounds.

    element_ids  (n,)    ids in the file
    orders       (n,)    highest order of the field
    tail         (n,)    share of the energy that the projection to one order less removes (Persson and Peraire 2006,
                         Sub-cell shock capturing for discontinuous Galerkin methods)
    decay        (n,)    decay rate in the direction with the largest part of the error; NaN for orders below 2
    rates        (n, 3)  decay rate in each reference direction; directions of a simplex or pyramid, and the two of the
                         triangle of a prism, have one rate
    removed      (n,)    L2 norm over the element of the difference to the projection to one order less
    error        (n,)    L2 norm of what lies beyond the highest order, if the spectrum goes on to fall as it does on
                         the element and its neighbours; that of ``removed`` for orders below 2 (for orders 2 to 4 see
                         also `low_order_errors`)
    errors       (n, 3)  parts of the error by direction, each at most the error; zero beyond the dimension
    grows        (n,)    whether energy grows at the highest mode, as aliasing leaves it
    norm         (n,)    L2 norm of the field over the element
    measure      (n,)    length, area or volume
    """

    element_ids: Ints
    orders: Ints
    tail: Floats
    decay: Floats
    rates: Floats
    removed: Floats
    error: Floats
    errors: Floats
    grows: Bools
    norm: Floats
    measure: Floats


def element_resolution(dataset: Dataset, name: str) -> ElementResolution:
    """The measures of a field on the elements of the domain that have it.

    ElvisError where no element has it, or with Fourier directions.
    """
    names = (name, derived_name(TRUNCATED, name))
    held = [patch for patch in patches(dataset, names) if patch.fields[0] is not None and len(patch)]
    if not held:
        raise ElvisError(f"expected elements of the domain under {name}, found none")
    if any(patch.homogeneous for patch in held):
        raise ElvisError(f"{name}: expected a field without Fourier directions, to measure its resolution")
    spectra = [_Spectra.of(dataset, patch) for patch in held]
    largest = max(float(np.nanmax(own.root_mean_squares, initial=0.0)) for own in spectra)
    precision = SINGLE if all(map(is_single, held)) else DOUBLE
    squares = _squared_errors(spectra, _around(dataset, spectra), precision * largest)
    pairs = zip(spectra, squares, strict=True)
    return ElementResolution.joined(
        [own.measures(errors, precision * largest, _NOISE * largest) for own, errors in pairs]
    )


def _squared_errors(spectra: list[_Spectra], around: list[Floats], floor: float) -> list[Floats]:
    """For each patch the squared parts (n, 3) of the error by direction.

    Orders 2 to 4 have too few levels for a rate on each element: sums over neighbours have one, in all directions.
    """
    found = []
    for own, near in zip(spectra, around, strict=True):
        parts = np.zeros((len(own.patch), 3))
        if own.order < LOWEST_ORDER:
            parts[:, 0] = own.removed**2
        for factor, energies in zip(own.basis.factors, own.levels, strict=True):
            if factor.highest < LOWEST_ORDER:
                continue
            faster = acceleration(energies * own.scale[:, None])
            if factor.highest < OWN_RATES_FROM:
                shares = remainder_shares(near[:, : factor.highest + 1], 0.0, faster)
            else:
                shares = remainder_shares(energies, floor * own.root, faster)
            highest = energies[:, -1] + energies[:, -2]
            parts[:, list(factor.directions)] = (highest * shares * own.scale / len(factor.directions))[:, None]
        found.append(parts)
    return found


def _around(dataset: Dataset, spectra: list[_Spectra]) -> list[Floats]:
    """For each patch (n, 5) sums of the energies of the levels 0 … 4 over each element and its neighbours.

    Elements that share vertices are neighbours: the energies are summed at vertices, and from there over elements.
    """
    mesh = dataset.mesh
    sums = np.zeros((len(mesh.vertices), OWN_RATES_FROM))
    corners = []
    for own in spectra:
        shape = own.patch.shape
        vertices = local_vertices(mesh, shape)[mesh.of(shape).rows_of(own.patch.element_ids)]
        corners.append(vertices)
        energies = np.nan_to_num(own.low * own.scale[:, None], posinf=0.0)
        for column in vertices.T:
            np.add.at(sums, column, energies)
    return [sums[vertices].sum(axis=1) for vertices in corners]


def _of(patch: Patch) -> tuple[Expansion, Floats]:
    """Expansion and coefficients of the first field of a patch."""
    expansion, coefficients = patch.fields[0], patch.coefficients[0]
    assert expansion is not None
    assert coefficients is not None
    return expansion, coefficients


@dataclass(frozen=True, eq=False)
class _Spectra:
    """Energies of the elements of a patch, by level of each factor of their basis.

    patch    whose first field is meant; the second one has no highest modes
    basis    of the field
    total    (n,) energies on the reference element
    top      (n,) energies that the projection to one order less removes
    levels   (n, p + 1) energies for each factor
    removed, norm, measure  (n,) as in `ElementResolution`
    """

    patch: Patch
    basis: ModalBasis
    total: Floats
    top: Floats
    levels: tuple[Floats, ...]
    removed: Floats
    norm: Floats
    measure: Floats

    @staticmethod
    def of(dataset: Dataset, patch: Patch) -> _Spectra:
        """The energies and norms, batch by batch."""
        expansion, coefficients = _of(patch)
        basis = modal_basis(expansion)
        points, weights = exact_rule(expansion)
        # fields in one expansion share the maps
        key = ("resolution", patch.geometry, expansion, patch.element_ids.tobytes())
        measures = kept(dataset, key, lambda: _measures(patch, points, weights))
        energies, norms = [], []
        for batch in chunks(len(patch), max(1, _BATCH // max(len(points), coefficients.shape[1]))):
            energies.append(_energies(basis, coefficients[batch]))
            norms.append(_norms(patch, batch, measures[batch]))
        total, top, *levels = joined_columns(energies)
        removed, norm, measure = joined_columns(norms)
        return _Spectra(patch, basis, total, top, tuple(levels), removed, norm, measure)

    @property
    def root_mean_squares(self) -> Floats:
        """(n,) of the field on the reference element."""
        return np.sqrt(self.total / self._reference_measure)

    @property
    def _reference_measure(self) -> float:
        return float(exact_rule(_of(self.patch)[0])[1].sum())

    @property
    def scale(self) -> Floats:
        """(n,) energies on the element in parts of those on the reference element."""
        return self.measure / self._reference_measure

    @property
    def root(self) -> float:
        """The amplitude on the reference element of a field with root mean square 1."""
        return float(np.sqrt(self._reference_measure))

    @property
    def low(self) -> Floats:
        """(n, 5) energies of the levels 0 … 4, summed over the factors."""
        found = np.zeros((len(self.patch), OWN_RATES_FROM))
        for energies in self.levels:
            own = energies[:, :OWN_RATES_FROM]
            found[:, : own.shape[1]] += own
        return found

    @property
    def order(self) -> int:
        """The highest order of the field."""
        return max(factor.highest for factor in self.basis.factors)

    def measures(self, squares: Floats, floor: float, noise: float) -> ElementResolution:
        """The measures.

        squares  (n, 3) squared parts of the error by direction
        floor    root mean square that is rounding
        noise    root mean square below which growth is not reported
        """
        count = len(self.patch)
        root = self.root
        rates, grows = np.full((count, 3), np.nan), np.zeros(count, bool)
        for factor, energies in zip(self.basis.factors, self.levels, strict=True):
            rates[:, list(factor.directions)] = decay_rates(energies, floor * root)[:, None]
            grows |= grows_at_top(energies, np.bincount(factor.levels), noise * root)
        with np.errstate(invalid="ignore", divide="ignore"):
            tail = np.where(self.total == 0, 0.0, self.top / self.total)
        # nothing is known of an element whose coefficients are not all finite
        rates[~np.isfinite(self.total)] = np.nan
        return ElementResolution(
            element_ids=self.patch.element_ids,
            orders=np.full(count, self.order),
            tail=tail,
            decay=rates[np.arange(count), np.where(np.isnan(rates), -1.0, squares).argmax(axis=1)],
            rates=rates,
            removed=self.removed,
            error=np.sqrt(squares.sum(axis=1)),
            errors=np.sqrt(squares),
            grows=grows,
            norm=self.norm,
            measure=self.measure,
        )


def _energies(basis: ModalBasis, coefficients: Floats) -> tuple[Floats, ...]:
    """Total energies (n,), those of the highest levels (n,), and those of the levels (n, p + 1) of each factor."""
    squares = basis.modal(coefficients) ** 2
    flat = squares.reshape(len(squares), -1)
    levels = []
    for axis, factor in enumerate(basis.factors, 1):
        others = tuple(other for other in range(1, squares.ndim) if other != axis)
        members = factor.levels[:, None] == np.arange(factor.highest + 1)
        levels.append(squares.sum(axis=others) @ members.astype(np.float64))
    return flat.sum(axis=1), flat @ basis.is_top(), *levels


def _measures(patch: Patch, points: Floats, weights: Floats) -> Floats:
    """(n, q) weights of points (q, d) in space."""
    found = np.empty((len(patch), len(points)))
    for batch in chunks(len(patch), max(1, _BATCH // len(points))):
        jacobians = evaluate_with_gradients(patch.geometry, patch.geometry_coefficients[batch], points)[1]
        found[batch] = weights * stretch_factors(jacobians)
    return found


def _norms(patch: Patch, batch: slice, measure: Floats) -> tuple[Floats, Floats, Floats]:
    """L2 norms (n,) of what a projection to one order less removes and of the field, and the measures (n,)."""
    expansion, coefficients = _of(patch)
    points, _ = exact_rule(expansion)
    own, less = coefficients[batch], patch.coefficients[1]
    assert less is not None
    found = [evaluate(expansion, part, points) for part in (own - less[batch], own)]
    removed, norm = (np.sqrt((values**2 * measure).sum(axis=1)) for values in found)
    return removed, norm, measure.sum(axis=1)
