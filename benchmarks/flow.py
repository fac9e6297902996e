"""Streamlines: how fast they are followed, with VTK's own tracer next to; what tubes and streaks add to a picture."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from measuring import in_turn, once
from pictures import exact
from shown import DELTA, Shown
from tables import Table, seconds

from elvis import CutSurface, Dataset, Lic, Plane, Renderer, Scene, Streamlines, Style
from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.streamlines.course import Course, Flow, MakeTracer
from elvis.core.streamlines.tracer import Tracer
from elvis.reference.baseline.vtk import VtkBaseline
from elvis.reference.extras import comparison_module
from elvis.renderer.passes.streams.following import following

VELOCITY = ("u", "v", "w")
#: a cut across the vortex that fills much of its picture
CUT = Plane((0.9, 0.0, 0.0), (1.0, 0.0, 0.0))
#: seeds in a box around the wing and its vortex, length of lines, and a speed at which they end, near walls
SEEDS = "0,0,-0.05:1.1,0.3,0.25"
LENGTH, SPEED = 1.0, 0.02


def measure(device: str, lines: int, tubes: int, side: int, rounds: int, quick: bool) -> dict[str, Any]:
    """Of the delta wing, the case that has a velocity: points a second, and pictures with and without tubes."""
    dataset = DELTA.whole(quick)
    own = _followed(dataset, f"random:{lines}:{SEEDS}", device)
    row = {"case": DELTA.name, **own, **_pictures(dataset, DELTA, device, tubes, side, rounds)}
    row["streaks"] = _streaks(dataset, DELTA, device, side, rounds)
    return {"lines": lines, "tubes": tubes, "pixels": side, "rows": [row]}


def _followed(dataset: Dataset, seeds: str, device: str) -> dict[str, Any]:
    """Steps of lines, by the device and by the host, and points of VTK's: how many, and the seconds that they take."""
    course = Course((seeds,), VELOCITY, length=LENGTH, speed=SPEED)
    flow = Flow.of(dataset, course)
    with following(device) as make:
        works = {"device": partial(_steps, flow, make), "host": partial(_steps, flow, Tracer)}
        points, first = once(works["device"])
        timings = in_turn(works, 3)
    points_of_vtk = _seeds(flow)
    numbers = {"points": points, "first": first.best, **{name: own.record() for name, own in timings.items()}}
    try:
        count, other = once(partial(_vtk, VtkBaseline(dataset, VELOCITY).grid, points_of_vtk))
    except ElvisError as error:
        return {**numbers, "vtk": str(error)}
    return {**numbers, "vtk_points": count, "vtk_seconds": other.effort}


def _steps(flow: Flow, make: MakeTracer) -> int:
    """How many steps all lines have."""
    return sum(len(piece.line) for tracer in flow.tracers(make) for piece in tracer.run())


def _seeds(flow: Flow) -> Floats:
    """(n, 3) where lines begin."""
    inside = flow.location.patch >= 0
    location = flow.location
    return flow.velocity.positions(location.patch[inside], location.row[inside], location.reference[inside])


def _vtk(grid: Any, seeds: Floats) -> int:
    """The points of the lines that VTK's tracer finds in its own cells, by its adaptive method of order 4 and 5."""
    numpy_support = comparison_module("vtkmodules.util.numpy_support")
    data = comparison_module("vtkmodules.vtkCommonDataModel")
    flows = comparison_module("vtkmodules.vtkFiltersFlowPaths")
    values = grid.GetPointData()
    parts = [numpy_support.vtk_to_numpy(values.GetArray(name)) for name in VELOCITY]
    vectors = numpy_support.numpy_to_vtk(np.ascontiguousarray(np.stack(parts, axis=1)), deep=True)
    vectors.SetName("velocity")
    values.SetVectors(vectors)
    source, points = data.vtkPolyData(), comparison_module("vtkmodules.vtkCommonCore").vtkPoints()
    points.SetData(numpy_support.numpy_to_vtk(np.ascontiguousarray(seeds), deep=True))
    source.SetPoints(points)
    tracer = flows.vtkStreamTracer()
    tracer.SetInputData(grid)
    tracer.SetSourceData(source)
    tracer.SetIntegratorTypeToRungeKutta45()
    tracer.SetIntegrationDirectionToForward()
    tracer.SetMaximumPropagation(LENGTH)
    tracer.SetTerminalSpeed(SPEED)
    tracer.SetMaximumNumberOfSteps(10_000)
    tracer.Update()
    return int(tracer.GetOutput().GetNumberOfPoints())


def _pictures(dataset: Dataset, shown: Shown, device: str, tubes: int, side: int, rounds: int) -> dict[str, Any]:
    """The surfaces of a case with tubes and without, in turn."""
    without = replace(shown.scenes("faces", side)["overview"], field=shown.field)
    without = replace(without, objects=tuple(replace(item, style=Style()) for item in without.objects))
    seeds = (f"random:{tubes}:{SEEDS}",)
    drawn = Streamlines(seeds, ",".join(VELOCITY), length=LENGTH, speed=SPEED)
    scene: Scene = replace(without, objects=(*without.objects, drawn))
    with Renderer(device) as renderer:
        renderer.load(dataset, shown.field)
        frame, first = once(partial(renderer.render, scene))
        works = {"with": partial(exact, renderer, scene), "without": partial(exact, renderer, without)}
        timings = in_turn(works, rounds)
    counts = frame.counts()
    about = {"first": first.best, "certain": counts["certain"], "ambiguous": counts["ambiguous"]}
    return {**about, **{name: timing.record() for name, timing in timings.items()}}


def _streaks(dataset: Dataset, shown: Shown, device: str, side: int, rounds: int) -> dict[str, Any]:
    """A cut with line integral convolution and without, in turn, as pictures without a record."""
    styles = {"with": Style(lic=Lic(",".join(VELOCITY))), "without": Style()}
    scenes = {
        name: Scene(shown.field, objects=(CutSurface(CUT, style),), size=(side, side), zoom=2.0)
        for name, style in styles.items()
    }
    with Renderer(device) as renderer:
        renderer.load(dataset, shown.field, *VELOCITY)
        works = {name: partial(renderer.render, scene, references=False) for name, scene in scenes.items()}
        frame, first = once(works["with"])
        timings = in_turn(works, rounds)
    about = {"first": first.best, "seen": int(frame.status.astype(bool).sum())}
    return {**about, **{name: timing.record() for name, timing in timings.items()}}


def tables(numbers: dict[str, Any]) -> list[Table]:
    """Three of them: following, drawing, and streaks."""
    follow = Table(
        f"Streamlines: {numbers['lines']} lines of length {LENGTH:g}",
        ("case", "by", "points", "s", "processor s", "points a processor s", "first, s"),
    )
    draw = Table(
        f"Tubes: {numbers['tubes']} of them, {numbers['pixels']} x {numbers['pixels']} pixels",
        ("case", "with, s", "without, s", "added, s", "added, processor s", "first, s", "ambiguous pixels"),
    )
    streaks = Table(
        f"Line integral convolution on a cut, {numbers['pixels']} x {numbers['pixels']} pixels",
        ("case", "pixels of the cut", "with, s", "without, s", "with, processor s", "without, processor s", "first, s"),
    )
    for row in numbers["rows"]:
        own = row["streaks"]
        times = [own[name][unit] for unit in ("median", "processor") for name in ("with", "without")]
        streaks.rows.append((row["case"], f"{own['seen']:,}", *map(seconds, [*times, own["first"]])))
        for name in ("device", "host"):
            times = row[name]["median"], row[name]["processor"]
            first_time = seconds(row["first"]) if name == "device" else ""
            follow.rows.append((row["case"], name, *_rate(row["points"], *times), first_time))
        if "vtk_points" in row:
            follow.rows.append(
                (row["case"], "VTK", *_rate(row["vtk_points"], row["vtk_seconds"], row["vtk_seconds"]), "")
            )
        one, other = row["with"], row["without"]
        added = one["median"] - other["median"], one["processor"] - other["processor"]
        first = (seconds(row["first"]), str(row["ambiguous"]))
        draw.rows.append((row["case"], seconds(one["median"]), seconds(other["median"]), *map(seconds, added), *first))
    follow.notes.append(
        "Device and host take turns; first is the first run on the device, which compiles its kernel. Ours are steps "
        "of a method of order 8 with an error of 1e-12 of the box, VTK's those of its adaptive method of order 4 and 5 "
        "at its usual tolerance, in Lagrange cells of the same order."
    )
    draw.notes.append("With and without take turns; lines are followed in the first picture alone.")
    return [follow, draw, streaks]


def _rate(points: int, time: float, effort: float) -> tuple[str, ...]:
    return f"{points:,}", seconds(time), seconds(effort), f"{points / effort:,.0f}"
