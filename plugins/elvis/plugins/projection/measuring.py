"""The error of converted data: one measurement for files, objects in memory, and every other conversion.

Errors are differences to the source's own functions at points not used by any fit.  If these exceed rounding, the
elements with the largest errors are checked at many more points, so that the largest error is hardly missed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from elvis.core.base.arrays import Floats, Ints, joined_ints
from elvis.core.mapping.tangents import duals
from elvis.core.polynomials.evaluation import evaluate
from elvis.plugins.conversion.report import is_rounding
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.checking import check_points
from elvis.plugins.projection.fitting import FieldFit
from elvis.plugins.projection.placing import in_space, worse
from elvis.plugins.projection.sampling import Sampler
from elvis.plugins.projection.verification import Findings, Maps, Tally, check

T = TypeVar("T")

#: points inside each element with one of the largest errors, and those at which derivatives of errors are taken
_DENSE, _AT_SLOPES = 2000, 200

#: step of central differences in reference coordinates, whose relative errors scale with its square
_STEP = 1e-4


def measure(
    sampler: Sampler,
    maps: Maps,
    blocks: Sequence[NativeBlock],
    fitted: Sequence[FieldFit],
    first: Findings | None = None,
) -> Findings:
    """Errors of a map and of fields on blocks, against the source behind ``sampler``.

    first  result of an earlier `check`; None if there was none

    If the map is not exact, errors of fields are the larger of those at reference coordinates and those at points in
    space.
    """
    precision = sampler.source.precision

    def look(only: Ints | None = None, inside: int | None = None) -> Findings:
        return check(sampler, maps, blocks, fitted, precision, only=only, inside=inside)

    def place(only: Ints | None = None, inside: int | None = None) -> list[Tally]:
        return in_space(sampler, maps, blocks, fitted, only, inside)

    findings = look() if first is None else first
    leaders = _sharpen(findings, look, lambda found: [found.coordinates, *found.fields], precision)
    if not is_exact_map(findings, precision):
        placed = place()
        _sharpen(placed, place, list, precision)
        findings = replace(findings, fields=[worse(*pair) for pair in zip(findings.fields, placed, strict=True)])
    if len(leaders):
        _take_slopes(findings, sampler, maps, blocks, fitted, leaders)
    return findings


def is_exact_map(findings: Findings, precision: float) -> bool:
    """Whether the differences of coordinates are rounding."""
    low, high = findings.box
    diagonal = float(np.sqrt(((high - low) ** 2).sum()))
    return is_rounding(findings.coordinates.worst, diagonal, float(np.abs(findings.box).max()), precision)


def _sharpen(
    found: T, look: Callable[[Ints, int], T], tallies_of: Callable[[T], Sequence[Tally]], precision: float
) -> Ints:
    """Check many more points of the elements with the largest errors beyond rounding, and include the results.

    Returns the ids (n,) of these elements.
    """
    tallies = tallies_of(found)
    some = [tally.leaders[0] for tally in tallies if not _is_rounding(tally, precision)]
    leaders = np.unique(joined_ints(some))
    if len(leaders):
        for tally, other in zip(tallies, tallies_of(look(leaders, _DENSE)), strict=True):
            tally.sharpen(other)
    return leaders


def _take_slopes(
    findings: Findings,
    sampler: Sampler,
    maps: Maps,
    blocks: Sequence[NativeBlock],
    fitted: Sequence[FieldFit],
    only: Ints,
) -> None:
    """Let tallies know the largest derivatives in space of the errors on elements ``only``.

    Derivatives along reference coordinates are central differences; J^-1 takes them to space.
    """
    for number, block in enumerate(blocks):
        inside = check_points(block.shape, _AT_SLOPES, block.is_collapsed)[:_AT_SLOPES]
        inside = (1 - 2 * _STEP) * inside
        ends = _ends(inside)
        for rows, points in sampler.batches(block, ends, only=only):
            ids = block.ids[rows]
            duals_there = _duals(maps, ids, inside)
            off = maps.at(ids, ends, 1)[0] - sampler.positions(block, rows, points)
            findings.coordinates.steepen(_in_space(off, duals_there))
            for tally, each in zip(findings.fields, fitted, strict=True):
                if not each.field.is_on(block.number):
                    continue
                ours = evaluate(block.expansion(each.modes[number]), each.coefficients[number][rows], ends)
                off = ours - sampler.values(block, rows, each.field, points)
                tally.steepen(_in_space(off[:, :, None], duals_there))


def _ends(points: Floats) -> Floats:
    """(2 d n, d) the ends of steps about points (n, d), in each direction the later ones first."""
    steps = _STEP * np.eye(points.shape[1])
    return np.concatenate([points + sign * step for step in steps for sign in (1, -1)])


def _in_space(off: Floats, duals_there: Floats) -> Floats:
    """(k, n) norms of derivatives in space of differences (k, 2 d n, c) at `_ends`; duals (k, n, 3, d)."""
    elements, points, directions = len(off), duals_there.shape[1], duals_there.shape[3]
    pairs = off.reshape(elements, directions, 2, points, -1)
    along = (pairs[:, :, 0] - pairs[:, :, 1]) / (2 * _STEP)
    return np.asarray(np.linalg.norm(np.einsum("kdnc,knad->knca", along, duals_there), axis=(2, 3)))


def _duals(maps: Maps, ids: Ints, points: Floats) -> Floats:
    """(k, n, 3, d) gradients in space of the reference coordinates at points (n, d) of elements (k,)."""
    matrices = maps.tangents(ids, points)[1]
    return duals(matrices.reshape(-1, *matrices.shape[2:])).reshape(matrices.shape)


def _is_rounding(tally: Tally, precision: float) -> bool:
    """Whether the differences of one quantity are rounding of its values."""
    if tally.element < 0:
        return True
    return is_rounding(tally.worst, tally.high - tally.low, max(abs(tally.low), abs(tally.high)), precision)
