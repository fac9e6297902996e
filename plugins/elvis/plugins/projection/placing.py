"""Effect of an inexact map on fields: their errors at points in space, not at reference coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.terminal import track
from elvis.core.mapping.tangents import determinants, duals
from elvis.core.polynomials.evaluation import evaluate_with_gradients
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.checking import check_points, inside_count
from elvis.plugins.projection.fitting import FieldFit
from elvis.plugins.projection.sampling import Sampler
from elvis.plugins.projection.verification import VOLUMES, Maps, Tally


def in_space(
    sampler: Sampler,
    maps: Maps,
    blocks: Sequence[NativeBlock],
    fitted: Sequence[FieldFit],
    only: Ints | None = None,
    inside: int | None = None,
) -> list[Tally]:
    """For each field, its differences to the source at the same points in space.

    only    ids of the elements to check; None for all
    inside  points inside each element; None for as many as the time allows

    If the map is off by x - x_h at reference coordinates xi, the point x has the coordinates xi + J^-1 (x - x_h) in
    the converted element, to first order; there the field is evaluated along its gradient.
    """
    tallies = [Tally() for _ in fitted]
    inside = inside or inside_count(sum(map(len, blocks)))
    for i, block in track(list(enumerate(blocks)), "checking places"):
        own = check_points(block.shape, inside, block.is_collapsed)
        for rows, points in sampler.batches(block, own, only=only):
            shifts, jacobians = _shifts(maps, block.ids[rows], own, sampler.positions(block, rows, points))
            weights = jacobians[:, :inside] * (VOLUMES[block.shape] / inside)
            for tally, each in zip(tallies, fitted, strict=True):
                if not each.modes[i]:
                    continue
                values = sampler.values(block, rows, each.field, points)
                expansion = block.expansion(each.modes[i])
                ours, gradients = evaluate_with_gradients(expansion, each.coefficients[i][rows], own)
                moved = ours + np.einsum("knd,knd->kn", gradients, shifts)
                with np.errstate(invalid="ignore"):
                    tally.add(block.ids[rows], np.abs(moved - values), weights, values)
    return tallies


def _shifts(maps: Maps, ids: Ints, points: Floats, places: Floats) -> tuple[Floats, Floats]:
    """Shifts (k, n, d) from reference points (n, d) to images of ``places`` (k, n, 3), and unsigned Jacobians (k, n).

    Shifts are zero where the Jacobian vanishes.
    """
    found, matrices = maps.tangents(ids, points)
    flat = matrices.reshape(-1, *matrices.shape[2:])
    shifts = np.einsum("knad,kna->knd", duals(flat).reshape(matrices.shape), places - found)
    return np.where(np.isfinite(shifts), shifts, 0.0), np.abs(determinants(flat)).reshape(found.shape[:2])


def worse(at_coordinates: Tally, at_places: Tally) -> Tally:
    """The greater of two tallies of a field, in the worst difference and in the integral each."""
    worst = max((at_coordinates, at_places), key=lambda each: each.worst)
    square = max(at_coordinates.square, at_places.square)
    return replace(at_coordinates, worst=worst.worst, element=worst.element, square=square)
