"""Ends of a scene's streamlines: ours against a tenfold tighter tolerance, and VTK's in linear meshes and cells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints, joined_floats
from elvis.core.base.errors import ElvisError
from elvis.core.base.needing import MissingPackageError
from elvis.core.data.dataset import Dataset
from elvis.core.streamlines.course import TOLERANCE, Course, Flow
from elvis.core.streamlines.tracer import Tracer
from elvis.core.streamlines.velocity import Velocity, velocity_expressions
from elvis.reference.baseline.linear_drawing import affordable
from elvis.reference.baseline.mesh import concatenate, linear_meshes
from elvis.reference.baseline.vtk import VtkBaseline
from elvis.reference.baseline.vtk_lines import linear_grid, places_after, set_velocity
from elvis.reference.extras import comparison_module
from elvis.reference.quantities import Quantities
from elvis.scene import Scene, Streamlines
from elvis.scene.flow.flow import course_of
from elvis.scene.model.time_limit import check_time

#: maximum number of lines of an object that are compared, evenly among its seeds, and tolerance of the true ones
#: relative to ours
MOST, FINER = 100, 0.1


@dataclass(frozen=True)
class Ends:
    """Distances of lines' ends from the true ones, relative to the diagonal of the box.

    name      name of the tracer
    level     cuts of each element, None if not applicable
    largest, median
    skipped   reason why there are none
    """

    name: str
    level: int | None = None
    maximum: float | None = None
    median: float | None = None
    skipped: str | None = None


@dataclass(frozen=True, eq=False)
class LineStudy:
    """The lines of one object.

    name    of the object in the scene
    lines   number of lines that are compared
    length  of the longest
    ours    at the object's own tolerance
    others  VTK's
    """

    name: str
    lines: int
    length: float
    ours: Ends
    others: Sequence[Ends]


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines that were followed one way: the sign of that, seeds (n, 3), ends (n, 3), lengths (n,), times (n,)."""

    sign: int
    seeds: Floats
    ends: Floats
    lengths: Floats
    times: Floats


def line_studies(
    dataset: Dataset, scene: Scene, quantities: Quantities, levels: Sequence[int], limit: int
) -> list[LineStudy]:
    """The studies of all objects of streamlines in elements; linear meshes use at most ``limit`` bytes."""
    found = []
    for number, shown in enumerate(scene.objects):
        if isinstance(shown, Streamlines) and shown.seeds and shown.wall is None:
            found.append(_study(dataset, f"objects[{number}]", course_of(shown), quantities, levels, limit))
    return found


def _study(
    dataset: Dataset, name: str, course: Course, quantities: Quantities, levels: Sequence[int], limit: int
) -> LineStudy:
    """One object's lines."""
    flow = Flow.of(dataset, course)
    size = flow.size
    inside = np.flatnonzero(flow.location.patch >= 0)
    chosen = inside[np.unique(np.linspace(0, len(inside) - 1, min(MOST, len(inside))).astype(np.int64))]
    tolerance = FINER * (TOLERANCE * size if course.tolerance is None else course.tolerance)
    true = _followed(Flow.of(dataset, replace(course, tolerance=tolerance)), chosen)
    own = _followed(flow, chosen)
    apart = [np.linalg.norm(one.ends - other.ends, axis=1) for one, other in zip(own, true, strict=True)]
    length = max(float(one.lengths.max(initial=0.0)) for one in true)
    others = _of_vtk(dataset, course, quantities, levels, limit, true, size)
    return LineStudy(name, len(chosen) * len(true), length, _ends("exact elements", None, apart, size), others)


def _followed(flow: Flow, chosen: Ints) -> list[_Lines]:
    """Lines from some of the seeds."""
    found = []
    for sign in flow.signs:
        tracer = Tracer(flow.velocity, flow.neighbours, flow.locator, flow.limits, sign)
        where = flow.location
        tracer.place(where.patch[chosen], where.row[chosen], where.reference[chosen])
        seeds = flow.velocity.positions(tracer.patch, tracer.row, tracer.state[:, :-1])
        for _ in tracer.run():
            check_time()
        ends = flow.velocity.positions(tracer.patch, tracer.row, tracer.state[:, :-1])
        found.append(_Lines(sign, seeds, ends, tracer.state[:, -1].copy(), tracer.time.copy()))
    return found


def _of_vtk(
    dataset: Dataset,
    course: Course,
    quantities: Quantities,
    levels: Sequence[int],
    limit: int,
    true: Sequence[_Lines],
    size: float,
) -> list[Ends]:
    """VTK's lines after each number of refinements, and in its own cells; none if VTK is not there."""
    try:
        comparison_module("vtkmodules.vtkFiltersFlowPaths")
    except MissingPackageError:
        return []
    velocity = Velocity(dataset, velocity_expressions(dataset, course.velocity))
    found = []
    for level in levels:
        name = f"VTK, {level} refinement{'s' * (level != 1)}"
        if not affordable(quantities.patches, level, 3, limit)[0]:
            found.append(Ends(name, level, skipped="more than the memory limit"))
            continue
        try:
            grid = linear_grid(concatenate(linear_meshes(quantities.patches, level, {})), velocity)
        except ElvisError as error:
            found.append(Ends(name, level, skipped=str(error)))
            continue
        found.append(_ends(name, level, _away(grid, true), size))
    name = "VTK's own cells"
    try:
        texts = [own.text for own in velocity.expressions]
        baseline = VtkBaseline(dataset, texts)
    except ElvisError as error:
        return [*found, Ends(name, skipped=str(error))]
    numpy_support = comparison_module("vtkmodules.util.numpy_support")
    cells = baseline.grid
    values = [numpy_support.vtk_to_numpy(cells.GetPointData().GetArray(array)) for array in baseline.arrays.values()]
    vectors = np.zeros((len(values[0]), 3))
    vectors[:, : len(values)] = np.stack(values, axis=1)
    set_velocity(cells, vectors)
    return [*found, _ends(name, None, _away(cells, true), size)]


def _away(grid: object, true: Sequence[_Lines]) -> list[Floats]:
    """For each way the distances (n,) of VTK's lines from the true ones, after the times that these last."""
    found = []
    for own in true:
        check_time()
        places = places_after(grid, own.seeds, own.times, float(own.lengths.max(initial=0.0)), own.sign)
        found.append(np.linalg.norm(places - own.ends, axis=1))
    return found


def _ends(name: str, level: int | None, apart: Sequence[Floats], size: float) -> Ends:
    """The largest distance, and the median."""
    every = joined_floats(apart) / size
    if not len(every):
        return Ends(name, level, skipped="no line begins in the elements")
    return Ends(name, level, float(every.max()), float(np.median(every)))


def line_facts(study: LineStudy) -> Mapping[str, object]:
    """As plain data."""
    return {
        "name": study.name,
        "lines": study.lines,
        "length": study.length,
        "ours": vars(study.ours),
        "others": [vars(own) for own in study.others],
    }
