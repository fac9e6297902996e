"""Streamlines as VTK follows them: its stream tracer in linear meshes, and in its own cells of high order."""

from __future__ import annotations

from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.streamlines.velocity import Velocity
from elvis.reference.baseline.mesh import LinearMesh
from elvis.reference.baseline.saving import unstructured_grid
from elvis.reference.extras import comparison_module

#: requested error of a step of its adaptive method of order 4 and 5, relative to the box, and maximum number of steps
ERROR, STEPS = 1e-9, 100_000
#: by which lines may be longer than the true ones, so that they last as long
_LONGER = 1.25
_VECTOR = "elvis_velocity"


def linear_grid(mesh: LinearMesh, velocity: Velocity) -> Any:
    """A linear mesh as VTK's unstructured grid, with the exact velocity at its corners."""
    owner = np.zeros(len(mesh.points), np.int64)
    owner[mesh.simplices.ravel()] = np.repeat(mesh.element, mesh.simplices.shape[1])
    grid = unstructured_grid(mesh)
    set_velocity(grid, velocity.in_world(owner, mesh.reference))
    return grid


def set_velocity(grid: Any, vectors: Floats) -> None:
    """Give a grid vectors (n, 3) at its points, which lines follow."""
    numpy_support = comparison_module("vtkmodules.util.numpy_support")
    array = numpy_support.numpy_to_vtk(np.ascontiguousarray(vectors), deep=True)
    array.SetName(_VECTOR)
    grid.GetPointData().SetVectors(array)


def places_after(grid: Any, seeds: Floats, durations: Floats, length: float, sign: int) -> Floats:
    """(n, 3) positions on VTK's lines from seeds (n, 3) after durations (n,), with (``sign`` 1) or against the stream.

    A line that ends earlier gives its end; a missing line gives the seed.  Positions between a line's points are
    interpolated by the cubic that also matches its velocities. upper bound of the true lines' lengths
    """
    numpy_support = comparison_module("vtkmodules.util.numpy_support")
    core, model = comparison_module("vtkmodules.vtkCommonCore"), comparison_module("vtkmodules.vtkCommonDataModel")
    source, points = model.vtkPolyData(), core.vtkPoints()
    points.SetData(numpy_support.numpy_to_vtk(np.ascontiguousarray(seeds), deep=True))
    source.SetPoints(points)
    tracer = comparison_module("vtkmodules.vtkFiltersFlowPaths").vtkStreamTracer()
    tracer.SetInputData(grid)
    tracer.SetSourceData(source)
    tracer.SetIntegratorTypeToRungeKutta45()
    # walking from cell to cell loses lines where corners are apart; before 9.7 this has another name
    locate = getattr(tracer, "SetCellLocatorToStaticCellLocator", None) or tracer.SetInterpolatorTypeToCellLocator
    locate()
    tracer.SetMaximumError(ERROR * grid.GetLength())
    tracer.SetIntegrationStepUnit(type(tracer).CELL_LENGTH_UNIT)
    tracer.SetMinimumIntegrationStep(1e-6)
    tracer.SetMaximumIntegrationStep(0.25)
    tracer.SetMaximumPropagation(_LONGER * length)
    tracer.SetMaximumNumberOfSteps(STEPS)
    (tracer.SetIntegrationDirectionToForward if sign > 0 else tracer.SetIntegrationDirectionToBackward)()
    tracer.Update()
    found = tracer.GetOutput()
    places = seeds.copy()
    if not found.GetNumberOfLines():
        return places
    data = found.GetPointData()
    line = numpy_support.vtk_to_numpy(found.GetPoints().GetData()).astype(np.float64)
    time = np.abs(numpy_support.vtk_to_numpy(data.GetArray("IntegrationTime")))
    rate = sign * numpy_support.vtk_to_numpy(data.GetArray(_VECTOR)).astype(np.float64)
    starts = numpy_support.vtk_to_numpy(found.GetLines().GetOffsetsArray())
    order = numpy_support.vtk_to_numpy(found.GetLines().GetConnectivityArray())
    numbers = numpy_support.vtk_to_numpy(found.GetCellData().GetArray("SeedIds"))
    for seed, first, last in zip(numbers, starts[:-1], starts[1:], strict=True):
        own = order[first:last]
        places[seed] = _at_time(time[own], line[own], rate[own], durations[seed])
    return places


def _at_time(time: Floats, points: Floats, rates: Floats, wanted: float) -> Floats:
    """(3,) the place at a time of a line through points (n, 3) at times (n,) with velocities (n, 3), or its end."""
    if wanted >= time[-1]:
        return np.asarray(points[-1])
    k = int(np.searchsorted(time, wanted, side="right")) - 1
    step = time[k + 1] - time[k]
    t = (wanted - time[k]) / step
    ends = (1 + 2 * t) * (1 - t) ** 2 * points[k] + t * t * (3 - 2 * t) * points[k + 1]
    return np.asarray(ends + step * t * (1 - t) * ((1 - t) * rates[k] - t * rates[k + 1]))
