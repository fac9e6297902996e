"""Errors of fields of order 2 to 4 on each element, from polynomials of two degrees more.

The few levels of such a spectrum say little about the next one: their energies scatter by the phase of the field in the
element.  The neighbours say more.  On an element and its neighbours across sides, a polynomial q of degree p + 2 is
fitted to the field u of order p (`patch_fits`).  With R the operator that makes fields of functions, two norms on the
element are

    missing = |q - R q|,    what the order p cannot hold of q,
    misfit  = |R q - u|,    what q does not explain of the field.

For fields that are smooth on the patch, the missing part tends to the error, and the misfit is of higher order.  Next
to shocks, kinks and corners the misfit is as large.  The spectrum then says more, if it has levels enough.  Two levels
always lie on an exponential law, three and four can confirm it, so that the trust in the spectrum is

    trust = (p - 2) / 2,    share = trust (2 misfit)^2 / (missing^2 + (2 misfit)^2),
    error = (missing^2 + (1 - trust) misfit^2)^((1 - share) / 2) error of the spectrum^share.

Polynomials of degree p + 1 would do for smooth fields in theory (Zhang and Naga 2005, A new finite element gradient
recovery method: superconvergence property).  Degree p + 2 is needed where the derivative of order p + 1
changes sign between elements.
"""

from __future__ import annotations

from dataclasses import replace
from math import comb

import numpy as np
from scipy import sparse

from elvis.core.base.arrays import Floats, Ints, joined_columns
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.orientation import chunks
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.interpolation import modified
from elvis.core.resolution.decay_rates import LOWEST_ORDER, OWN_RATES_FROM
from elvis.core.resolution.element_resolution import ElementResolution
from elvis.core.resolution.modal_bases import exact_rule
from elvis.core.resolution.patch_fits import BATCH, TOGETHER, FieldElements, PatchFits, field_elements
from elvis.core.resolution.recovery import MORE, is_continuous

#: factor of the misfit against the missing part: from half of it on, the spectrum counts as much as the polynomial
_MISFIT = 2.0
#: numbers in normal equations from which fits are left out: some seconds
_MOST_WORK = 10_000_000


def with_neighbours(dataset: Dataset, name: str, own: ElementResolution) -> ElementResolution:
    """The measures of a field with errors from polynomials on patches, for fields of order 2 to 4.

    Others keep the errors from spectra, as do large data, surfaces and curves in space, and single elements.
    """
    mesh, order = dataset.mesh, int(own.orders.max())
    is_low = LOWEST_ORDER <= order < OWN_RATES_FROM
    if not is_low or mesh.dimension < mesh.space or len(own) == 1 or _work(own, order, mesh.dimension) > _MOST_WORK:
        return own
    ids, missing, misfit = patch_errors(dataset, name, order)
    place = np.argsort(ids)
    rows = np.flatnonzero(np.isin(own.element_ids, ids) & (own.orders >= LOWEST_ORDER))
    place = place[np.searchsorted(ids[place], own.element_ids[rows])]
    root = np.sqrt(own.measure[rows])
    trust = (own.orders[rows] - LOWEST_ORDER) / (OWN_RATES_FROM - 1 - LOWEST_ORDER)
    error = own.error.copy()
    error[rows] = _blended(root * missing[place], root * misfit[place], own.error[rows], trust)

    # the parts by direction remain those of the spectra
    factors = np.where(own.error > 0, error / np.where(own.error > 0, own.error, 1.0), 1.0)
    return replace(own, error=error, errors=own.errors * factors[:, None])


def _work(own: ElementResolution, order: int, dimension: int) -> int:
    """Numbers in the normal equations of all patches."""
    return len(own) * comb(order + MORE + dimension, dimension) ** 2


def _blended(missing: Floats, misfit: Floats, of_spectrum: Floats, trust: Floats) -> Floats:
    """(n,) errors from both norms on the patch and from the spectrum, which is trusted between 0 and 1."""
    rough = (_MISFIT * misfit) ** 2
    share = trust * rough / np.maximum(missing**2 + rough, np.finfo(float).tiny)
    of_patch = np.sqrt(missing**2 + (1 - trust) * misfit**2)
    return np.asarray(of_patch ** (1 - share) * of_spectrum**share)


def patch_errors(dataset: Dataset, name: str, order: int) -> tuple[Ints, Floats, Floats]:
    """Ids (n,) of the elements with finite coefficients, the missing part and the misfit (n,), as root mean squares."""
    elements = list(field_elements(dataset, name))
    continuous = is_continuous(dataset, name)
    fits = PatchFits(elements, sum(map(len, elements)), order + MORE, continuous, is_complete=True)
    patches_of = _neighbours(elements, len(dataset.mesh.vertices))
    found = []
    for own in elements:
        rows = np.arange(len(own))
        for part in chunks(len(own), TOGETHER):
            fits.fit(own.start + rows[part], patches_of[own.start + rows[part]])
        step = max(1, BATCH // (fits.size * (fits.degree + 1) ** own.patch.shape.dimension))
        found += [_norms(fits, own, rows[part]) for part in chunks(len(own), step)]
    missing, misfit = joined_columns(found)
    return np.concatenate([own.patch.element_ids for own in elements]), missing, misfit


def _neighbours(elements: list[FieldElements], vertices: int) -> sparse.csr_matrix:
    """(e, e) entries for an element and those with which it has a common side."""
    ends = np.concatenate([own.vertices.reshape(-1) for own in elements])
    numbers = [np.repeat(own.start + np.arange(len(own)), own.vertices.shape[1]) for own in elements]
    count = sum(map(len, elements))
    members = sparse.csr_matrix((np.ones(len(ends)), (np.concatenate(numbers), ends)), (count, vertices))
    is_near = (members @ members.T).tocsr() >= elements[0].patch.shape.dimension
    return sparse.csr_matrix(is_near)


def _norms(fits: PatchFits, own: FieldElements, rows: Ints) -> tuple[Floats, Floats]:
    """The missing part (n,) and the misfit (n,) on some elements of a patch."""
    restriction, (expansion, coefficients) = fits.restriction(own), own.field
    owners = own.start + rows
    restricted = fits.values(owners, own.positions(rows, restriction.points)) @ restriction.matrix
    points, weights = exact_rule(modified(expansion.shape, (fits.degree + 1,) * expansion.shape.dimension))
    share = weights / weights.sum()
    missing = fits.values(owners, own.positions(rows, points)) - evaluate(expansion, restricted, points)
    misfit = evaluate(expansion, restricted - coefficients[rows], points)
    return np.sqrt(missing**2 @ share), np.sqrt(misfit**2 @ share)
