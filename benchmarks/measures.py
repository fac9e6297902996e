"""Numbers from solutions: integrals, extrema and differences, each next to VTK's way, with true errors of both.

VTK integrates, cuts and probes linear pieces: elements refined 0, 1, 2, ... times.  Truths are closed forms where there
is one, else sums over a Gauss rule of 12 points each way, in extended precision, which shares nothing with `integrate`
but the tables of modes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import linear
import numpy as np
from cases import Case, cut, of_order, standard
from linear_scenes import FacePieces, marched
from measuring import Timing, in_turn, once
from shown import WING
from tables import Table, seconds

from elvis import Dataset, Plane, Shape, integrate
from elvis.core.base.arrays import Floats
from elvis.core.bounds.extrema import extrema
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.cubature import field_cubature
from elvis.core.polynomials.expansion import values, values_and_gradients
from elvis.core.polynomials.interpolation import modified
from elvis.core.testing import approximated, grid
from elvis.plugins.faces import native_faces
from elvis.renderer.frame.rendering import Pictures

#: refinements of VTK's pieces, and those of which two datasets fit into memory at once
LEVELS, OF_TWO = 5, 4
#: points of the rule of the truths, each way
_POINTS = 12
#: a plane across the box around the wing, downstream, and the integral of y z^2 over it
_DOWNSTREAM, _CLOSED = "plane:4.1,0,0:1,0,0", 12.5 * 128 / 3
#: order of fields that hold cubic polynomials of the coordinates where maps are quadratic
_CUBIC = 6
#: where the cubic polynomial of `_summit` is largest
_TOP = np.array([0.43, 0.37, 0.59])


@dataclass(frozen=True)
class Measure:
    """A number that is measured in two ways.

    ours   the value and its stated error
    vtk    the value for some refinements
    """

    name: str
    truth: float
    ours: Callable[[], tuple[float, float]]
    vtk: Callable[[int], float]
    levels: int


def measures(quick: bool) -> list[Measure]:
    """Measures of the wing, then of closed forms on curved elements and on a cube of 384 tetrahedra."""
    levels = 2 if quick else LEVELS
    wing = WING.dataset(quick)
    cube = standard(quick)
    bent = replace(cube, order=_CUBIC, field=_summit).dataset()
    force, whole = _gauss_force(wing), _gauss_volume(wing)
    swept = Dataset(wing.mesh, (approximated(Dataset(wing.mesh), "p", lambda p: p[:, 1] * p[:, 2] ** 2, 4),))
    across = Plane((4.1, 0.0, 0.0), (1.0, 0.0, 0.0))
    found = [
        Measure(
            "force on the wing's wall, z",
            force,
            partial(_integral, wing, "p*nz", over="wing"),
            partial(_vtk_force, wing),
            LEVELS,
        ),
        Measure(
            "integral of p over the wing's 70,564 elements",
            whole,
            partial(_integral, wing, "p"),
            lambda level: sum(map(_vtk_integral, linear.Pieces(wing, "p", level).grids())),
            levels,
        ),
        Measure(
            "integral of y z^2 over a plane across them",
            _CLOSED,
            partial(_integral, swept, "p", over=_DOWNSTREAM),
            lambda level: sum(
                _vtk_integral(linear.section(grid, across)) for grid in linear.Pieces(swept, "p", level).grids()
            ),
            levels,
        ),
        Measure(
            f"greatest value of a cubic polynomial, {cube.elements:,} bent elements",
            1.0,
            partial(_greatest, bent),
            lambda level: max(
                grid.GetPointData().GetScalars().GetRange()[1] for grid in linear.Pieces(bent, "u", level).grids()
            ),
            levels,
        ),
    ]
    return [*found, *_of_ball(quick)]


def _of_ball(quick: bool) -> list[Measure]:
    """A ball of radius 0.8 in a box of tetrahedra that doesn't follow it: r^2 is the field."""
    cells, error, levels = (2, 1e-2, 2) if quick else (4, 1e-8, LEVELS)
    mesh = grid(Shape.TETRAHEDRON, cells)
    mesh = replace(mesh, vertices=2.0 * mesh.vertices - 1.0)
    ball = Dataset(mesh, (approximated(Dataset(mesh), "p", lambda p: (p**2).sum(axis=1), 3),))
    return [
        Measure(
            f"volume of a ball that cuts {len(mesh.of(Shape.TETRAHEDRON))} tetrahedra",
            4 / 3 * np.pi * 0.8**3,
            partial(_integral, ball, "volume", clip="outside:p=0.64", error=error),
            lambda level: _vtk_integral(_clipped(linear.Pieces(ball, "p", level).grid(), 0.64), measure=True),
            levels,
        ),
        Measure(
            "area of its sphere",
            4 * np.pi * 0.8**2,
            partial(_integral, ball, "area", over="p=0.64", error=error),
            lambda level: _vtk_integral(marched(linear.Pieces(ball, "p", level).grid(), 0.64), measure=True),
            levels,
        ),
    ]


def _summit(points: Floats) -> Floats:
    """1 - r^2 (1 + (x - x_0)/5), r the distance from `_TOP`: at most 1 where x > x_0 - 5, and 1 at `_TOP` alone."""
    away = points - _TOP
    return np.asarray(1.0 - (away**2).sum(axis=-1) * (1.0 + away[..., 0] / 5))


def _valley(points: Floats) -> Floats:
    """Another cubic polynomial of the coordinates."""
    return np.asarray(points[..., 0] ** 3 - points[..., 1] * points[..., 2] + points[..., 2])


def _integral(dataset: Dataset, field: str, **options: Any) -> tuple[float, float]:
    found = integrate(dataset, field, **options)[-1]
    return found.value, found.error


def _greatest(dataset: Dataset) -> tuple[float, float]:
    found = extrema(dataset, "u")[1]
    return found.value, found.bound - found.value


def _gauss_volume(dataset: Dataset) -> float:
    """The integral of p over all elements."""
    total = np.longdouble(0)
    for patch in patches(dataset, ["p"]):
        rule = field_cubature(modified(patch.shape, (_POINTS,) * 3))
        slopes = values_and_gradients(patch.geometry, rule.points)[1]
        table = values(patch.fields[0], rule.points)  # type: ignore[arg-type]
        for rows in np.array_split(np.arange(len(patch)), -(-len(patch) // 500)):
            jacobians = np.einsum("edm,qkm->eqdk", patch.geometry_coefficients[rows], slopes, optimize=True)
            sums = patch.coefficients[0][rows] @ table.T * np.linalg.det(jacobians)  # type: ignore[index]
            total += (sums * rule.weights).astype(np.longdouble).sum()
    return float(total)


def _gauss_force(dataset: Dataset) -> float:
    """The integral of p n_z over the wing's wall."""
    parts, total = patches(dataset, ["p"]), np.longdouble(0)
    rule = field_cubature(modified(Shape.TRIANGLE, (_POINTS, _POINTS)))
    faces = native_faces(dataset, [patch.element_ids for patch in parts])
    for block, rows in zip(faces.blocks, faces.select(("wing",)), strict=True):
        patch = parts[block.part]
        for local, frame in enumerate(block.frames):
            chosen = block.element[rows[block.local[rows] == local]]
            where = frame[0] + rule.points @ frame[1:]
            slopes = frame[1:] @ values_and_gradients(patch.geometry, where)[1]
            along = np.einsum("edm,qkm->eqdk", patch.geometry_coefficients[chosen], slopes, optimize=True)
            normal = _outward(frame) * np.cross(along[..., 0], along[..., 1])
            table = values(patch.fields[0], where)  # type: ignore[arg-type]
            sums = patch.coefficients[0][chosen] @ table.T * normal[..., 2]  # type: ignore[index]
            total += (sums * rule.weights).astype(np.longdouble).sum()
    return float(total)


def _outward(frame: Floats) -> float:
    """1 where the product of a face's directions leads out of the tetrahedron, else -1."""
    middle = frame[0] - (frame[1] + frame[2]) / 3
    return float(np.sign(np.linalg.det(np.stack([frame[1], frame[2], middle + 0.5]))))


def _vtk_force(dataset: Dataset, level: int) -> float:
    """The sum over flat triangles of the mean of p times their outward area vector's z."""
    from vtk.util.numpy_support import vtk_to_numpy

    pieces = FacePieces(dataset, "p", ("wing",), level)
    surface = pieces.grid()
    corners = vtk_to_numpy(surface.GetPoints().GetData())[_triangles(surface)]
    means = vtk_to_numpy(surface.GetPointData().GetScalars())[_triangles(surface)].mean(axis=1)
    areas = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])

    # pieces of one face of the reference element stand together
    blocks = native_faces(dataset, [patch.element_ids for patch in patches(dataset, ["p"])]).blocks
    signs = [_outward(frame) for block in blocks for frame in block.frames]
    each = np.repeat(signs, [count * 4**level for count in pieces.counts])
    return float((each * means) @ areas[:, 2])


def _triangles(surface: Any) -> Any:
    from vtk.util.numpy_support import vtk_to_numpy

    return vtk_to_numpy(surface.GetPolys().GetConnectivityArray()).reshape(-1, 3)


def _vtk_integral(grid: Any, measure: bool = False) -> float:
    """vtkIntegrateAttributes of the field, or of 1; 0 of a grid without cells, which it knows nothing of."""
    import vtk

    if not grid.GetNumberOfCells():
        return 0.0
    integral = vtk.vtkIntegrateAttributes()
    integral.SetInputData(grid)
    integral.Update()
    found = integral.GetOutput()
    if measure:
        name = "Area" if isinstance(grid, vtk.vtkPolyData) else "Volume"
        return float(found.GetCellData().GetArray(name).GetValue(0))
    return float(found.GetPointData().GetArray("u").GetValue(0))


def _clipped(grid: Any, value: float) -> Any:
    import vtk

    clip = vtk.vtkTableBasedClipDataSet()
    clip.SetInputData(grid)
    clip.SetValue(value)
    clip.InsideOutOn()
    clip.Update()
    return clip.GetOutput()


def measure(device: str, side: int, rounds: int, quick: bool) -> dict[str, Any]:
    """All numbers in two ways, then the difference of two solutions on a plane."""
    return {"rows": [_row(each) for each in measures(quick)], "plane": _plane(device, side, rounds, quick)}


def _row(asked: Measure) -> dict[str, Any]:
    asked.ours()
    (value, stated), timing = once(asked.ours)
    linear_values = [once(partial(asked.vtk, level)) for level in range(asked.levels)]
    return {
        "name": asked.name,
        "stated": stated / abs(asked.truth),
        "true": abs(value - asked.truth) / abs(asked.truth),
        "ours": timing.record(),
        "vtk": [{"error": abs(own - asked.truth) / abs(asked.truth), **taken.record()} for own, taken in linear_values],
    }


def _plane(device: str, side: int, rounds: int, quick: bool) -> dict[str, Any]:
    """``u - ref:u`` where both are on meshes of quadratic tetrahedra, next to the planes of each."""
    cases = standard(quick), of_order(Shape.TETRAHEDRON, 2, 3, quick)
    if quick:
        cases = cases[0], replace(cases[1], cells=2)
    first, second = (case.dataset() for case in cases)
    drawn = _drawing(first, second, device, side)
    timings = in_turn(drawn, rounds)
    counts = drawn["A - B"]().counts()
    about = {"elements": [len(patches(each)[0]) for each in (first, second)], "counts": counts}
    return {
        **about,
        **{name: own.record() for name, own in timings.items()},
        "cubic": _cubic(cases, device, side, quick),
    }


def _drawing(first: Dataset, second: Dataset, device: str, side: int) -> dict[str, Callable[[], Any]]:
    """The pictures of A, of B and of A - B on the plane of the benchmarks."""
    scene, works = replace(cut(side), outputs=("plane.png",)), {}
    both = first.with_others(ref=second)
    for name, data, field in (("A", first, "u"), ("B", second, "u"), ("A - B", both, "u - ref:u")):
        works[name] = partial(Pictures(data, device).draw, replace(scene, field=field))
    return works


def _cubic(cases: Sequence[Case], device: str, side: int, quick: bool) -> dict[str, Any]:
    """The difference of two cubic polynomials of the coordinates: ours at all pixels, VTK's on its cut, true errors."""
    functions = _summit, _valley
    first, second = (
        replace(case, order=_CUBIC, field=own).dataset() for case, own in zip(cases, functions, strict=True)
    )
    draw = _drawing(first, second, device, side)["A - B"]
    draw()
    frame, timing = once(draw)

    def error(points: Floats, found: Floats) -> float:
        """The largest error, in parts of the largest difference."""
        truth = _summit(points) - _valley(points)
        return float(np.abs(found - truth).max() / np.abs(truth).max())

    has_value = np.isfinite(frame.field)
    ours = error(frame.position[has_value], frame.field[has_value])
    vtk = []
    for level in range(2 if quick else OF_TWO):
        (points, found), taken = _probed(first, second, level)
        vtk.append({"error": error(points, found), **taken.record()})
    return {"true": ours, "ours": timing.record(), "counts": frame.counts(), "vtk": vtk}


def _probed(first: Dataset, second: Dataset, level: int) -> tuple[tuple[Floats, Floats], Timing]:
    """VTK's way: the linear pieces of A are cut, those of B probed at the points of the cut; points and differences."""
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    plane = cut(1).only_plane
    assert plane is not None
    grids = [linear.Pieces(each, "u", level).grid() for each in (first, second)]

    def difference() -> tuple[Floats, Floats]:
        surface = linear.section(grids[0], plane)
        probe = vtk.vtkProbeFilter()
        probe.SetInputData(surface)
        probe.SetSourceData(grids[1])
        probe.Update()
        theirs = vtk_to_numpy(probe.GetOutput().GetPointData().GetArray("u"))
        is_known = vtk_to_numpy(probe.GetOutput().GetPointData().GetArray("vtkValidPointMask")) > 0
        ours = vtk_to_numpy(surface.GetPointData().GetScalars())
        return vtk_to_numpy(surface.GetPoints().GetData())[is_known], (ours - theirs)[is_known]

    return once(difference)


def tables(numbers: dict[str, Any]) -> list[Table]:
    """Quantities by rows, then the plane."""
    levels = [f"VTK {level}: error, s" for level in range(LEVELS)]
    shown = Table("Numbers, exact and by linear pieces", ["quantity", "true error", "stated", "s", "CPU s", *levels])
    for row in numbers["rows"]:
        shown.rows.append(_table_row(row["name"], f"{row['stated']:.1e}", row))
    shown.rows.append(_table_row("u - ref:u on a plane, picture", "-", numbers["plane"]["cubic"]))
    shown.notes = [
        "Errors in parts of the value. VTK: elements in 8^n linear pieces, faces in 4^n, then vtkIntegrateAttributes, "
        "vtkPlaneCutter, vtkTableBasedClipDataSet, vtkContourFilter; seconds with refining. The greatest value is "
        "between what is attained and a proved bound, whose distance is stated. The difference is one of cubic "
        f"polynomials of the coordinates, in fields of order {_CUBIC} on the two meshes of the next table: the "
        "greatest error of all pixels with a value, in parts of the greatest difference "
        f"({_counted(numbers['plane']['cubic'])}); VTK's by vtkPlaneCutter of A and "
        "vtkProbeFilter of B at its points, without picture and refining, as long as there is memory for both."
    ]
    return [shown, _plane_table(numbers["plane"])]


def _plane_table(found: dict[str, Any]) -> Table:
    shown = Table("A difference of two solutions on a plane", ["picture", "s", "CPU s", "in parts of A's, s", "CPU s"])
    for name in ("A", "B", "A - B"):
        own = found[name]
        ratios = [f"{own[key] / found['A'][key]:.2f}" for key in ("best", "processor")]
        shown.rows.append([name, seconds(own["best"]), seconds(own["processor"]), *ratios])
    elements = " and ".join(f"{count:,}" for count in found["elements"])
    shown.notes = [
        f"A and B: {elements} quadratic tetrahedra with fields of order 3. Pixels of A - B: {_counted(found)}."
    ]
    return shown


def _table_row(name: str, stated: str, row: dict[str, Any]) -> list[str]:
    """True and stated error and seconds, then VTK's errors and seconds."""
    own = [f"{row['true']:.1e}", stated, seconds(row["ours"]["best"]), seconds(row["ours"]["processor"])]
    rivals = [f"{each['error']:.1e}, {seconds(each['best'])}" for each in row["vtk"]]
    return [name, *own, *rivals, *[""] * (LEVELS - len(rivals))]


def _counted(found: dict[str, Any]) -> str:
    """Pixels by status, but those that show nothing."""
    return ", ".join(f"{count:,} {name}" for name, count in found["counts"].items() if name != "miss")
