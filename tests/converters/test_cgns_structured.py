"""Structured zones of CGNS files, whose sides are named in every way, against closed forms and VTK's own reader."""

import cgns_writing as writing
import numpy as np
import pytest
from cgns_reader import patches_by_vtk
from cgns_writing import base, condition, conditions, grid, node, structured

from elvis.converters.cgns.cgns import Cgns
from elvis.core.integrals import integrate
from elvis.plugins.conversion.converting import convert
from elvis.plugins.testing import check, values_found

SIZES = (3, 4, 5)
NAMES = ("imin", "imax", "jmin", "jmax", "kmin", "kmax")
LOCATIONS = ("IFaceCenter", "JFaceCenter", "KFaceCenter")


def ends(sizes, name):
    """Direction of a side, and whether it is the last."""
    return "ijk".index(name[0]), name.endswith("max")


def vertex_range(sizes, name):
    """The two ends of the vertices of a side, from 1."""
    axis, is_last = ends(sizes, name)
    found = np.array([np.ones(len(sizes), int), sizes])
    found[:, axis] = sizes[axis] if is_last else 1
    return found


def face_range(sizes, name):
    found = vertex_range(sizes, name)
    found[1] -= np.arange(len(sizes)) != ends(sizes, name)[0]
    return found


def filled(span):
    axes = [np.arange(low, high + 1) for low, high in span.T]
    return np.stack([axis.reshape(-1) for axis in np.meshgrid(*axes, indexing="ij")], axis=1)


def cell_range(sizes, name):
    axis, is_last = ends(sizes, name)
    found = face_range(sizes, name)
    found[:, axis] -= is_last
    return found


def inward(sizes, name):
    axis, is_last = ends(sizes, name)
    own = np.zeros(len(sizes), np.int32)
    own[axis] = -1 if is_last else 1
    return node("InwardNormalIndex", '"int[IndexDimension]"', own)


WAYS = {
    "vertices": lambda s, n: condition(n, "PointRange", vertex_range(s, n)),
    "reversed": lambda s, n: condition(n, "PointRange", vertex_range(s, n)[::-1], "Vertex"),
    "list of vertices": lambda s, n: condition(n, "PointList", filled(vertex_range(s, n))),
    "faces across": lambda s, n: condition(n, "PointRange", face_range(s, n), LOCATIONS[ends(s, n)[0]]),
    "list of faces": lambda s, n: condition(n, "PointList", filled(face_range(s, n)), LOCATIONS[ends(s, n)[0]]),
    "faces": lambda s, n: condition(n, "PointRange", face_range(s, n), "FaceCenter"),
    "cells": lambda s, n: condition(n, "PointRange", cell_range(s, n), "CellCenter"),
    "cells inwards": lambda s, n: condition(n, "PointRange", cell_range(s, n), "CellCenter", None, inward(s, n)),
}


def areas(dataset):
    tags = {2: "ES", 3: "FTQ"}[dataset.mesh.dimension]
    names = [c.name for c in dataset.mesh.composites if c.parts[0][0] in tags]
    return {name: integrate(dataset, "1", over=name, error=1e-13)[0].value for name in names}


def box(sizes, way, low=0.0, high=1.0, order=None):
    """A zone of a box with a condition on each side; ``order`` of the coordinates makes left-handed ones."""
    points = grid(*sizes, low=low, high=high)
    points = points if order is None else points[..., order]
    return structured("Zone", points, conditions(*(way(sizes, name) for name in NAMES[: 2 * len(sizes)])))


@pytest.mark.sampled
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("sizes", [SIZES, (3, 3, 3), (4, 5)])
def test_conditions_lie_on_their_sides(tmp_path, way, sizes):
    if len(sizes) == 2 and "face" in way and way != "faces":
        pytest.skip("lines have no such places")
    zone = box(sizes, WAYS[way], high=(1.0, 2.0, 4.0)[: len(sizes)])
    path = writing.write_hdf5(tmp_path / "a.cgns", [base(zone, dimension=len(sizes))], 3.4)
    done = check(Cgns, [path])
    assert Cgns([path]).warnings == []
    lengths = np.array([1.0, 2.0, 4.0][: len(sizes)])
    wanted = {name: np.prod(np.delete(lengths, ends(sizes, name)[0])) for name in NAMES[: 2 * len(sizes)]}
    assert areas(done.dataset) == pytest.approx(wanted, abs=1e-12)


def test_left_handed_zones(tmp_path):
    zone = box(SIZES, WAYS["vertices"], high=(1.0, 2.0, 4.0), order=[1, 0, 2])
    done = check(Cgns, [writing.write_hdf5(tmp_path / "a.cgns", [base(zone)], 3.4)])
    assert areas(done.dataset) == pytest.approx(
        {"imin": 8, "imax": 8, "jmin": 4, "jmax": 4, "kmin": 2, "kmax": 2}, abs=1e-12
    )
    assert integrate(done.dataset, "1")[0].value == pytest.approx(8, abs=1e-12)


def test_patches_agree_with_another_reader(tmp_path):
    """Patches of several sizes, one inside: areas and the volume as VTK reads them; faces are flat, as its are."""
    points = grid(4, 5, 6)
    sheared = points @ np.array([[1, 0.2, 0.1], [0, 1, 0.3], [0, 0, 1]]) * [1, 2, 3]
    spans = {
        "low": [(1, 1, 1), (1, 3, 6)],
        "high": [(1, 3, 1), (1, 5, 6)],
        "wall": [(2, 1, 2), (4, 1, 5)],
        "inner": [(1, 2, 3), (4, 5, 3)],
        "lid": [(1, 1, 6), (2, 2, 6)],
    }
    own = conditions(*(condition(name, "PointRange", span, None, name) for name, span in spans.items()))
    families = [node(name, "Family_t") for name in spans]
    path = writing.write_hdf5(tmp_path / "a.cgns", [base(*families, structured("Zone", sheared, own))], 3.4)
    found = areas(check(Cgns, [path]).dataset)
    wanted, volume = patches_by_vtk(path)
    assert set(wanted) == set(spans)
    assert {name: found[name] for name in spans} == pytest.approx(wanted, rel=1e-12)
    assert integrate(convert(Cgns([path])).dataset, "1")[0].value == pytest.approx(volume, rel=1e-12)


def test_zones_that_touch_are_joined(tmp_path):
    """Three zones around a corner, turned against each other: what is between them is inside."""
    points = [
        grid(3, 4, 5),
        grid(3, 4, 5, low=(1, 0, 0), high=(2, 1, 1))[::-1],
        np.swapaxes(grid(3, 3, 5, low=(0, 1, 0), high=(1, 2, 1)), 0, 2),
    ]
    zones = [
        structured(f"Zone{i}", own, writing.solution("Flow", None, {"u": own @ [1.0, 2, 3]}))
        for i, own in enumerate(points)
    ]
    done = check(Cgns, [writing.write_hdf5(tmp_path / "a.cgns", [base(*zones)], 3.4)])
    assert integrate(done.dataset, "1")[0].value == pytest.approx(3, abs=1e-12)
    assert integrate(done.dataset, "1", over="all")[0].value == pytest.approx(14, abs=1e-12)
    assert {measure.state for measure in done.report.fields} == {"exact"}
    inside = np.array([[0.9, 0.4, 0.3], [1.1, 0.4, 0.3], [0.4, 1.1, 0.3]])
    assert np.abs(values_found(done.dataset, "u", inside) - inside @ [1, 2, 3]).max() < 1e-12


def test_grids_that_close_on_themselves(tmp_path):
    """A ring of quadrilaterals around a pole: the polygon's area, and no side along the seam."""
    count, radii = 12, np.linspace(0, 1, 4)
    angle = np.linspace(0, 2 * np.pi, count + 1)
    angle[-1] = 0.0
    points = radii[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    rim = condition("rim", "PointRange", [(4, 1), (4, count + 1)])
    pole = node(
        "pole", "BC_t", "BCDegeneratePoint", node("PointRange", "IndexRange_t", np.array([[1, 1], [1, 13]], np.int32))
    )
    zone = structured("Disc", points, conditions(rim, pole))
    done = convert(Cgns([writing.write_hdf5(tmp_path / "a.cgns", [base(zone, dimension=2)], 3.4)]))
    area, chord = count / 2 * np.sin(2 * np.pi / count), 2 * count * np.sin(np.pi / count)
    assert integrate(done.dataset, "1")[0].value == pytest.approx(area, abs=1e-12)
    assert areas(done.dataset)["rim"] == pytest.approx(chord, abs=1e-12)


@pytest.mark.parametrize("is_adf", [False, True])
def test_planes_beyond_the_zone_are_skipped(tmp_path, is_adf):
    """Two planes before and one behind along i, one behind along k; cells have one on each side of j."""
    points = grid(4, 3, 3)
    wide = grid(7, 3, 4, low=(-2 / 3, 0, 0), high=(4 / 3, 1, 1.5))
    cells = (points[1:, 1:, 1:] + points[:-1, :-1, :-1]) / 2
    inner = cells @ [1.0, 10, 100]
    padded = np.full((3, 4, 2), 1e9)
    padded[:, 1:3] = inner
    flows = [
        writing.solution("Vertices", "Vertex", {"u": wide[:, :, :] @ [1.0, 2, 3]}, [2, 1, 0, 0, 0, 1]),
        writing.solution("Cells", "CellCenter", {"c": padded, "u": padded}, [0, 0, 1, 1, 0, 0]),
    ]
    zone = structured("Zone", wide, *flows, conditions(WAYS["vertices"]((4, 3, 3), "imin")), rind=[2, 1, 0, 0, 0, 1])
    write = writing.write_adf if is_adf else writing.write_hdf5
    done = check(Cgns, [write(tmp_path / "a.cgns", [base(zone)], 3.4)])
    assert areas(done.dataset)["imin"] == pytest.approx(1, abs=1e-12)
    assert integrate(done.dataset, "1")[0].value == pytest.approx(1, abs=1e-12)
    places = cells.reshape(-1, 3)
    assert np.abs(values_found(done.dataset, "u", places) - places @ [1, 2, 3]).max() < 1e-12
    for name in ("c", "u_cell"):
        assert np.abs(values_found(done.dataset, name, places) - inner.reshape(-1)).max() < 1e-12


def test_ambiguous_conditions_are_named(tmp_path):
    own = [
        condition("volume", "PointRange", [(1, 1, 1), (3, 4, 5)]),
        condition("cells", "PointRange", [(1, 1, 1), (2, 3, 4)], "CellCenter"),
        condition("inside", "PointList", [(2, 2, 2)]),
        condition("beyond", "PointRange", [(1, 4, 0), (3, 4, -1)]),
    ]
    path = writing.write_hdf5(tmp_path / "a.cgns", [base(structured("Zone", grid(*SIZES), conditions(*own)))], 3.4)
    notes = Cgns([path]).warnings
    assert len(notes) == 4
    assert any("beyond of Zone names vertices [1, 4, -1] to [3, 4, 0] of a grid of [3, 4, 5]" in note for note in notes)
    assert "the boundary condition volume of Zone is not a face but a part of the grid, and was skipped" in notes
    assert "the boundary condition inside of Zone marks no side of a cell, and was skipped" in notes
    assert any("cells of Zone doesn't define which direction" in note for note in notes)


def test_coordinates_of_cylinders(tmp_path):
    radius, angle, height = np.moveaxis(grid(3, 7, 2, low=(1, 0, 0), high=(2, 90, 1)), -1, 0)
    names = {"CoordinateR": radius, "CoordinateTheta": angle, "CoordinateZ": height}
    units = ["Kilogram", "Meter", "Second", "Kelvin", "Degree"]
    unit = node("DimensionalUnits", "DimensionalUnits_t", units)
    arrays = [node(key, "DataArray_t", values, unit) for key, values in names.items()]
    own = node("GridCoordinates", "GridCoordinates_t", None, *arrays)
    sizes = np.array([[3, 2, 0], [7, 6, 0], [2, 1, 0]], np.int32)
    zone = node("Zone", "Zone_t", sizes, node("ZoneType", "ZoneType_t", "Structured"), own)
    done = convert(Cgns([writing.write_hdf5(tmp_path / "a.cgns", [base(zone)], 3.4)]))
    # six chords of 15 degrees
    assert integrate(done.dataset, "1")[0].value == pytest.approx(3 * 6 * np.sin(np.pi / 12) / 2, abs=1e-12)
    assert any("cylindrical" in note for note in done.report.notes)
