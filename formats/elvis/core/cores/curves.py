"""Vortex cores as curves, for pictures of them: cubic in the elements between their points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.terminal import Progress
from elvis.core.cores.finding import CoreArcs, CoreLimits, core_arcs
from elvis.core.cores.joining import Course
from elvis.core.data.dataset import Dataset
from elvis.core.polynomials.boxnets import power_net
from elvis.core.streamlines.course import components_of, diagonal
from elvis.core.streamlines.dop853 import DEGREE
from elvis.core.streamlines.flow_data import flow_data
from elvis.core.streamlines.lines.pieces import DEVIATION, Curves, Pieces, Steps, check_count, in_patch
from elvis.core.streamlines.velocity import Velocity

#: (4, 8) matrix from Bernstein coefficients of cubics to coefficients of degree 7; multiply from the right
_ELEVATED = np.array([power_net(power, 3, DEGREE) for power in range(4)])


def core_curves(
    dataset: Dataset,
    velocity: Sequence[str] | str | None,
    limits: CoreLimits,
    progress: Progress | None = None,
) -> Curves:
    """The lines of `vortex_cores` as curves, with its errors; their parameter of time is the length."""
    found = core_arcs(dataset, velocity, limits, progress=progress)
    data = flow_data(dataset)
    own = data.velocity(data.components(components_of(velocity)))
    courses = [course for course in found.courses() if _length(course, found) >= limits.min_length]
    elements = [_element_of(found, number) for number in range(len(found.arcs))]
    places = _places(own, np.array(elements, np.int64))
    pieces = Pieces.joined(
        [part for line, course in enumerate(courses) for part in _pieces_of(found, course, line, own, places)]
    )
    check_count(len(pieces))
    return Curves(pieces, len(courses), {}, diagonal(data.locator(own)), tuple(_remarks(found, len(courses))))


def _length(course: Course, found: CoreArcs) -> float:
    """Length of a line along its points."""
    parts = [found.arcs[number].points[:: _step(is_turned)] for number, is_turned in _ways(course)]
    if course.closed:
        parts.append(parts[0][:1])
    return float(np.linalg.norm(np.diff(np.concatenate(parts), axis=0), axis=1).sum())


def _remarks(found: CoreArcs, lines: int) -> list[str]:
    """Remarks about missing lines, and about elements where lines may be missing."""
    left = len(found.undecided)
    none = [] if lines else ["vortex cores: none has the requested swirl and length"]
    missed = [f"vortex cores: in {left} elements, which are undecided, there may be more"] if left else []
    return none + missed


def _ways(course: Course) -> list[tuple[int, bool]]:
    """Arcs of a line, and whether each is turned round."""
    return list(zip(course.arcs, course.turned, strict=True))


def _step(is_turned: bool) -> int:
    return -1 if is_turned else 1


def _element_of(found: CoreArcs, number: int) -> int:
    """The id of the element of an arc."""
    own = found.arcs[number]
    return int(found.parallel.evaluator.patches[own.patch].element_ids[own.arc.row])


def _pieces_of(
    found: CoreArcs, course: Course, line: int, velocity: Velocity, places: Mapping[int, tuple[int, int]]
) -> Iterator[Pieces]:
    """A line's curves, arc by arc: Hermite's cubic between two points, by the tangents there.

    places  patches and rows of elements by their ids, as the velocity has them
    """
    before = 0.0
    for number, is_turned in _ways(course):
        own, step = found.arcs[number], _step(is_turned)
        xi, tangents, points = own.arc.xi[::step], step * own.arc.tangents[::step], own.points[::step]
        chords = np.linalg.norm(np.diff(xi, axis=0), axis=1)[:, None] / 3
        cubics = np.stack([xi[:-1], xi[:-1] + chords * tangents[:-1], xi[1:] - chords * tangents[1:], xi[1:]], axis=1)
        length = before + np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        before = float(length[-1])
        ends = np.stack([length[:-1], length[1:]], axis=1)
        nets = np.concatenate([np.einsum("ij,nid->njd", _ELEVATED, cubics), _linear(ends)], axis=2)
        patch, row = places[_element_of(found, number)]
        steps = Steps(np.full(len(nets), row), np.full(len(nets), line), nets, ends)
        yield in_patch(velocity, patch, steps, DEVIATION * own.size)


def _linear(ends: Floats) -> Floats:
    """(n, 8, 1) Bernstein coefficients of what goes evenly from one end to the other (n, 2)."""
    share = np.linspace(0.0, 1.0, DEGREE + 1)
    return np.asarray(ends[:, :1, None] + (ends[:, 1:] - ends[:, :1])[:, None] * share[None, :, None])


def _places(velocity: Velocity, elements: Ints) -> dict[int, tuple[int, int]]:
    """The patch and the row of elements with these ids."""
    found = {}
    for number, patch in enumerate(velocity.patches):
        rows = np.flatnonzero(np.isin(patch.element_ids, elements))
        found.update({int(patch.element_ids[row]): (number, int(row)) for row in rows})
    return found
