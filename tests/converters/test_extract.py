"""Surfaces out of data: on the exact surface, within the reported distance, closed, and as other programs read them."""

from dataclasses import replace

import igl
import meshio
import numpy as np
import pytest
import trimesh
from click import ClickException
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

from elvis import (
    Dataset,
    ElvisError,
    Field,
    Shape,
    boundary_data,
    boundary_triangles,
    from_arrays,
    integrate,
    level_triangles,
    read,
    sample,
    write,
)
from elvis.core.mapping.patch import patches
from elvis.core.testing import approximated, curved, grid, mixed_plane, ripple
from elvis.core.triangles import clipped, level_lines
from elvis.core.triangles.curved_triangles import curved_triangles
from elvis.core.triangles.outlines import open_sides
from elvis.core.wall_curves.chains import places_by_number
from elvis.plugins.data.boundary_data import convert_boundary

CENTRE, RADIUS = np.array([0.5, 0.5, 0.5]), 0.31
SPHERE = "sphere:0.5,0.5,0.5:0.31"
TORUS = "((x-0.5)^2+(y-0.5)^2+(z-0.5)^2+0.28^2-0.1^2)^2-4*0.28^2*((x-0.5)^2+(y-0.5)^2)=0"
FUNCTIONS = {"u": lambda x: x[:, 0] ** 2 + x[:, 1] * x[:, 2], "p": lambda x: 1.5 + x[:, 0] * x[:, 2]}


def flow(mesh, modes=3):
    data = Dataset(mesh)
    return replace(data, fields=tuple(approximated(data, *item, modes) for item in FUNCTIONS.items()))


def mesh_of(surface):
    return trimesh.Trimesh(surface.points, surface.triangles, process=False)


def on_sphere(count):
    points = np.random.default_rng(7).normal(size=(count, 3))
    return CENTRE + RADIUS * points / np.linalg.norm(points, axis=1, keepdims=True)


def wave(x):
    """The plane with bent lines of coordinates."""
    return x + 0.04 * np.sin(3 * x[..., [1, 0, 2]]) * [1, 1, 0]


def hex_and_prism():
    """A cube of half the length with a prism behind its face x = 1/2."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 0.5)], float)
    prism = np.array([[0.5, 0, 0], [0.5, 1, 0], [0.5, 1, 1], [0.5, 0, 1], [1, 0, 0], [1, 1, 0]], float)
    return from_arrays({"hexahedron": corners[None], "prism": prism[None]})


@pytest.mark.parametrize("shape", [Shape.HEXAHEDRON, Shape.TETRAHEDRON, Shape.PRISM])
def test_a_sphere_is_closed_and_within_the_stated_distance(shape):
    """Both ways: points of triangles to the sphere, and points of the sphere to triangles, by libigl."""
    found = level_triangles(Dataset(grid(shape, 1)), SPHERE, ["x*y"], 0.02)
    mesh = mesh_of(found)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.02)
    assert found.is_bound
    assert found.distance <= 0.02
    away = found.points - CENTRE
    assert np.abs(np.linalg.norm(away, axis=1) - RADIUS).max() < 1e-14
    assert np.abs(found.normals - away / RADIUS).max() < 1e-13
    assert found.values["x*y"] == pytest.approx(found.points[:, 0] * found.points[:, 1], abs=1e-14)
    middles = found.points[found.triangles].mean(axis=1)
    there = np.abs(np.linalg.norm(middles - CENTRE, axis=1) - RADIUS).max()
    back = np.sqrt(igl.point_mesh_squared_distance(on_sphere(2000), found.points, found.triangles)[0].max())
    assert 0 < max(there, back) <= found.distance


def test_areas_of_a_torus_converge():
    data, exact = Dataset(grid(Shape.HEXAHEDRON, 1)), 4 * np.pi**2 * 0.28 * 0.1
    coarse, fine = (level_triangles(data, TORUS, [], tolerance) for tolerance in (0.2, 0.02))
    errors = [abs(found.area / exact - 1) for found in (coarse, fine)]
    assert all(mesh_of(found).is_watertight for found in (coarse, fine))
    assert mesh_of(fine).euler_number == 0
    assert fine.distance <= 0.02
    assert errors[1] < errors[0] / 3
    assert errors[1] < 2e-3


def test_elements_of_other_shapes_share_their_edges():
    data = hex_and_prism()
    found = level_triangles(data, "sphere:0.5,0.4,0.5:0.2", [], 0.05)
    assert mesh_of(found).is_watertight
    assert mesh_of(boundary_triangles(data, "all", [], 0.1)).is_watertight


def test_planes_are_exact_on_curved_elements():
    data = Dataset(curved(grid(Shape.HEXAHEDRON, 2), ripple(0.03), 3))
    found = level_triangles(data, "plane:0.5,0.45,0.52:0.3,0.2,1", [], 1e-2)
    normal = np.array([0.3, 0.2, 1.0])
    assert np.abs((found.points - [0.5, 0.45, 0.52]) @ normal).max() < 1e-14
    assert 0 < found.distance <= 1e-2
    area = integrate(data, "1", over="plane:0.5,0.45,0.52:0.3,0.2,1").value
    assert found.area == pytest.approx(area, rel=1e-3)


def ring(x):
    """A quarter of a ring from radius 1 to 2 with plane ends."""
    radius, angle = 1 + x[..., 0], x[..., 1] * np.pi / 2
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), x[..., 2]], axis=-1)


def radii_of_sides(found):
    """Radii of the ends (k, 2) of sides with one triangle, and of their middles (k,)."""
    row, slot = open_sides(found.triangles)
    ends = found.points[np.stack([found.triangles[row, slot], found.triangles[row, (slot + 1) % 3]], axis=1)]
    return np.linalg.norm(ends[..., :2], axis=2), np.linalg.norm(ends.mean(axis=1)[:, :2], axis=1)


def test_outlines_are_within_the_stated_distance_of_curved_faces():
    """Arcs of a ring, to rounding of order 8; where the field jumps, also those between elements."""
    data = Dataset(curved(grid(Shape.HEXAHEDRON, 2), ring, 9))
    height, one = (approximated(data, "u", f, 2).blocks[0] for f in (lambda x: x[:, 2], lambda x: 1 + 0 * x[:, 0]))
    coefficients = height.coefficients + height.element_ids[:, None] / 64 * one.coefficients
    jumping = replace(data, fields=(Field("u", (replace(height, coefficients=coefficients),)),))
    areas = []
    for whole, surface, arcs in ((data, "plane:0,0,0.4:0,0,1", (1, 2)), (jumping, "u=0.3", (1, 1.5, 2))):
        for tolerance in (1e-2, 1e-3):
            found = level_triangles(whole, surface, [], tolerance)
            ends, middle = radii_of_sides(found)
            for arc in arcs:
                on_arc = (np.abs(ends - arc) < 1e-9).all(axis=1)
                off = np.abs(middle[on_arc] - arc)
                assert len(off) > 4
                assert tolerance / 30 < off.max() <= found.distance <= tolerance
            areas.append(abs(found.area / (np.pi * 0.75) - 1))
    assert areas[1] < areas[0] / 10


def test_surfaces_next_to_an_outer_face_need_no_finer_outlines():
    """A cylinder that weaves through a curved face within the tolerance, and a sphere that touches a plane one."""
    data = Dataset(curved(grid(Shape.HEXAHEDRON, 1), ring, 3))
    found = level_triangles(data, "x*x+y*y=3.99", [], 1e-2)
    assert found.distance <= 1e-2
    found = level_triangles(Dataset(grid(Shape.HEXAHEDRON, 1)), "sphere:0.5,0.5,0.3:0.3000001", [], 1e-2)
    assert found.distance <= 1e-2
    assert len(found.triangles) < 20000


def test_a_plane_along_faces_is_extracted_once():
    found = level_triangles(Dataset(grid(Shape.HEXAHEDRON, 2)), "plane:0,0,0.5:0,0,1", [], 1e-2)
    assert found.area == pytest.approx(1, abs=1e-12)
    assert len(found.triangles) == 8
    for end in ("0", "1"):
        found = level_triangles(Dataset(grid(Shape.HEXAHEDRON, 2)), f"plane:0,0,{end}:0,0,1", [], 1e-2)
        assert found.area == pytest.approx(1, abs=1e-12)
        assert (found.normals[:, 2] > 0).all()
        assert (found.crosses[:, 2] > 0).all()


def test_a_surface_along_curved_faces_has_no_holes():
    """A part of a cylinder that is the common face of elements to rounding: it changes from one side to the other."""

    def bent(x):
        radius, angle = 1 + x[..., 0], x[..., 1] / 3
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), x[..., 2]], axis=-1)

    found = level_triangles(Dataset(curved(grid(Shape.PRISM, 2), bent, 8)), "x*x+y*y=2.25", [], 1e-4)
    assert found.area == pytest.approx(0.5, rel=1e-5)
    edges = found.points[np.sort(mesh_of(found).edges, axis=1)]
    _, first, count = np.unique(np.sort(mesh_of(found).edges, axis=1), axis=0, return_index=True, return_counts=True)
    middle = edges[first[count == 1]].mean(axis=1)
    angle = np.arctan2(middle[:, 1], middle[:, 0]) * 3
    at_border = [np.abs(own - end) < 1e-6 for own in (angle, middle[:, 2]) for end in (0, 1)]
    assert np.any(at_border, axis=0).all()


@pytest.mark.parametrize(
    ("shape", "order", "quantity"),
    [(Shape.TETRAHEDRON, 4, "d(u,x)"), (Shape.HEXAHEDRON, 4, "vorticity")],
)
def test_distances_are_proved_for_derivatives_on_curved_elements(shape, order, quantity):
    """Within the stated distance along the normal the quantity takes its value, by values at points on both sides."""
    data = Dataset(curved(grid(shape, 1), ripple(0.02), order))
    parts = {
        "u": lambda x: np.sin(3 * x[:, 1]) * np.cos(2 * x[:, 0]),
        "v": lambda x: x[:, 0] ** 3,
        "w": lambda x: x[:, 1],
    }
    data = replace(data, fields=tuple(approximated(data, *item, order + 1) for item in parts.items()))
    value = float(sample(data, quantity, [(0.7, 0.6, 0.5)]).values.item())
    found = level_triangles(data, f"{quantity}={value}", [], 0.1)
    assert found.is_bound
    assert 0 < found.distance <= 0.1
    some = np.random.default_rng(3).integers(len(found.triangles), size=200)
    points = found.points[found.triangles[some]].mean(axis=1)
    normals = found.crosses[some] / np.linalg.norm(found.crosses[some], axis=1, keepdims=True)
    sides = [sample(data, quantity, points + sign * found.distance * normals) for sign in (-1, 1)]
    # next to borders of elements the quantity jumps
    elements = [own.location.element_id for own in sides]
    is_same = (elements[0] == elements[1]) & (elements[0] >= 0)
    assert is_same.sum() > 20
    signs = [np.sign(own.values[is_same, 0] - value) for own in sides]
    assert (signs[0] != signs[1]).all()


def test_surfaces_of_jumping_fields_end_at_the_jump():
    """The field x - z/4 + element/64: a plane in each element, that end on the faces between these."""
    data = Dataset(grid(Shape.HEXAHEDRON, 2))
    slope, one = (
        approximated(data, "u", f, 2).blocks[0] for f in (lambda x: x[:, 0] - x[:, 2] / 4, lambda x: 1 + 0 * x[:, 0])
    )
    coefficients = slope.coefficients + slope.element_ids[:, None] / 64 * one.coefficients
    data = replace(data, fields=(Field("u", (replace(slope, coefficients=coefficients),)),))
    found = level_triangles(data, "u=0.3", [], 1e-2)
    assert found.area == pytest.approx(integrate(data, "1", over="u=0.3").value, rel=1e-9)
    assert found.distance < 1e-12


def test_points_where_the_gradient_vanishes_are_enclosed_by_small_boxes():
    """The tip of a cone, as far as boxes may be bisected; a remark states the distance otherwise."""
    data = Dataset(grid(Shape.HEXAHEDRON, 1))
    found = level_triangles(data, "x^2+y^2-z^2=0", [], 0.002)
    assert found.distance <= 0.002
    assert not found.remarks
    found = level_triangles(data, "x^2+y^2-z^2=0", [], 4e-4)
    assert found.distance > 4e-4
    assert "in 1 box, as at tips of pyramids or where the gradient vanishes" in found.remarks[0]


@pytest.mark.parametrize("data", [hex_and_prism(), Dataset(curved(grid(Shape.TETRAHEDRON, 1), ripple(0.02), 2))])
def test_boxes_of_several_sizes_meet_without_gaps(data):
    """A thin ellipsoid, whose ends need smaller triangles than its sides."""
    found = level_triangles(data, "((x-0.45)/0.3)^2+((y-0.47)/0.06)^2+((z-0.4)/0.06)^2=1", [], 0.004)
    mesh = mesh_of(found)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2
    assert found.distance <= 0.004
    edges = mesh.edges_unique_length
    assert edges.max() > 5 * np.median(edges)
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 0.3 * 0.06**2, rel=0.01)


def pyramids_and_tetrahedra():
    """The cube [0, 1]^3 as pyramids from its middle to three faces, and pairs of tetrahedra to the others."""
    cube = Shape.HEXAHEDRON.vertices / 2 + 0.5
    faces = [cube[list(face)] for face in Shape.HEXAHEDRON.faces]
    middle = np.array([[0.5, 0.5, 0.55]])
    pyramids = np.array([np.concatenate([face, middle]) for face in faces[::2]])
    halves = [np.concatenate([face[list(own)], middle]) for face in faces[1::2] for own in ((0, 1, 2), (0, 2, 3))]
    return from_arrays({"pyramid": pyramids, "tetrahedron": np.array(halves)})


@pytest.mark.parametrize("map_of", [None, ripple(0.02)])
def test_pyramids_and_tetrahedra_cut_their_common_faces_alike(map_of):
    """A sphere that runs through faces between them, in part without meeting their edges."""
    data = pyramids_and_tetrahedra()
    data = data if map_of is None else Dataset(curved(data.mesh, map_of, 2))
    for radius, tolerance in ((0.31, 0.01), (0.1, 0.01)):
        found = level_triangles(data, f"sphere:0.52,0.47,0.53:{radius}", ["x"], tolerance)
        mesh = mesh_of(found)
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        assert mesh.volume == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.02)
        middles = found.points[found.triangles].mean(axis=1)
        off = np.linalg.norm(np.concatenate([found.points, middles]) - [0.52, 0.47, 0.53], axis=1) - radius
        assert np.abs(off[: len(found.points)]).max() < 1e-12
        assert np.abs(off).max() <= found.distance <= tolerance
        assert np.abs(found.values["x"] - found.points[:, 0]).max() < 1e-12


def test_curved_triangles_meet_without_gaps_next_to_pyramids():
    """Each side of the closed surface is a side of two triangles, with all of its nodes."""
    found = curved_triangles(pyramids_and_tetrahedra(), "sphere:0.52,0.47,0.53:0.31", 3, ["x"], 0.05)
    nodes = places_by_number(found.points.reshape(-1, 3)).reshape(len(found.points), -1)
    # corners, then the nodes along the sides
    sides = np.concatenate([nodes[:, [0, 3, 4, 1]], nodes[:, [1, 5, 6, 2]], nodes[:, [2, 7, 8, 0]]])
    turned = np.where((sides[:, 0] > sides[:, -1])[:, None], sides[:, ::-1], sides)
    counts = np.unique(turned, axis=0, return_counts=True)[1]
    assert (counts == 2).all()
    assert np.abs(np.linalg.norm(found.points - [0.52, 0.47, 0.53], axis=2) - 0.31).max() < 1e-12
    assert np.abs(found.values["x"] - found.points[..., 0]).max() < 1e-12


def test_curved_triangles_along_outer_faces_point_to_larger_values():
    """Both ends of a cube: on the upper one, all values inside are smaller."""
    for end in (0, 1):
        found = curved_triangles(Dataset(grid(Shape.HEXAHEDRON, 1)), f"plane:0,0,{end}:0,0,1", 3, [], 0.1)
        assert found.points[..., 2] == pytest.approx(end, abs=1e-14)
        a, b, c = np.moveaxis(found.points[:, :3], 1, 0)
        areas = np.cross(b - a, c - a)[:, 2] / 2
        assert (areas > 0).all()
        assert areas.sum() == pytest.approx(1, abs=1e-12)
        # nodes of order 3 lie at thirds of the first side
        assert found.points[:, 3] == pytest.approx((2 * a + b) / 3, abs=1e-14)


def test_outlines_of_curved_triangles_follow_curved_faces():
    """A plane across a quarter of a ring, whose area the estimated distance of the outline bounds."""
    found = curved_triangles(Dataset(curved(grid(Shape.HEXAHEDRON, 2), ring, 9)), "plane:0,0,0.4:0,0,1", 2, [], 1e-3)
    surface = from_arrays(
        {"triangle": found.points}, {}, reference={"triangle": found.weights @ Shape.TRIANGLE.vertices}
    )
    error = abs(integrate(surface, "1").value - np.pi * 0.75)
    assert 0 < error < found.distance * (1 + 2) * np.pi / 2
    assert found.distance <= 1e-3


def test_elements_of_other_orders_divide_their_own_faces_only():
    """Fields that agree at the corners of elements, but not on their common faces: all corners are on the surface."""

    def bent(x):
        bubble = x[:, 1:] * (x[:, 1:] - 0.5) * (x[:, 1:] - 1) / 0.047
        return x[:, 2] - 0.4 * np.prod(bubble**2, axis=1)

    data = Dataset(grid(Shape.HEXAHEDRON, 2))
    plain, other = (approximated(data, "u", f, 7).blocks[0] for f in (lambda x: x[:, 2], bent))
    is_bent = plain.element_ids % 2 == 1
    coefficients = np.where(is_bent[:, None], other.coefficients, plain.coefficients)
    data = replace(data, fields=(Field("u", (replace(plain, coefficients=coefficients),)),))
    found = level_triangles(data, "u=0.7", [], 1e-2)
    known = sample(data, "u", found.points, all=True)
    residual = np.full(len(found.points), np.inf)
    np.minimum.at(residual, known.location.point, np.abs(known.values[:, 0] - 0.7))
    assert residual.max() < 1e-12
    assert found.area == pytest.approx(integrate(data, "1", over="u=0.7").value, rel=0.02)


def test_clips_leave_the_outside():
    data = Dataset(grid(Shape.HEXAHEDRON, 1))
    plane = level_triangles(data, "plane:0,0,0.4:0,0,1", ["x"], 1e-3)
    left = clipped(plane, data, "sphere:0.5,0.5,0.4:0.3", 1e-4)
    disc = clipped(plane, data, "outside:sphere:0.5,0.5,0.4:0.3", 1e-4)
    assert disc.area == pytest.approx(np.pi * 0.09, rel=1e-3)
    assert left.area + disc.area == pytest.approx(1, rel=1e-3)
    assert disc.values["x"] == pytest.approx(disc.points[:, 0], abs=1e-12)
    ball = level_triangles(data, SPHERE, [], 1e-2)
    halves = [clipped(ball, data, f"{side}plane:0.5,0.5,0.5:0,0,1", 1e-2).area for side in ("", "outside:")]
    assert sum(halves) == pytest.approx(ball.area, rel=1e-12)
    with pytest.raises(ElvisError, match="expected some of the surface to be left"):
        clipped(ball, data, "outside:sphere:0,0,0:0.1", 1e-2)


def test_boundaries_are_closed_and_have_the_quantities_of_the_volume():
    data = flow(curved(grid(Shape.PRISM, 1), ripple(0.05), 3))
    found = boundary_triangles(data, "all", ["x*y"], 1e-2)
    mesh = mesh_of(found)
    assert mesh.is_watertight
    assert abs(mesh.volume - integrate(data, "1").value) <= found.distance * found.area
    assert found.area == pytest.approx(integrate(data, "1", over="all").value, rel=5e-3)
    assert found.values["x*y"] == pytest.approx(found.points[:, 0] * found.points[:, 1], abs=1e-11)
    flux = np.einsum("mi,mi->", found.crosses, found.points[found.triangles].mean(axis=1)) / 6
    assert flux == pytest.approx(mesh.volume, rel=1e-12)
    skin = convert_boundary(data, "all")
    assert all(own.is_exact for own in (skin.report.geometry, *skin.report.fields))
    for name in ("1", "u"):
        whole = integrate(data, name, over="all").value
        assert integrate(boundary_data(data, "all"), name).value == pytest.approx(whole, rel=1e-9)


def test_edges_of_plane_data_are_lines_with_their_fields():
    data = Dataset(curved(grid(Shape.QUADRILATERAL, 2), wave, 3))
    data = replace(data, fields=(approximated(data, "u", FUNCTIONS["u"], 3),))
    skin = convert_boundary(data, "all")
    assert all(own.is_exact for own in (skin.report.geometry, *skin.report.fields))
    assert integrate(skin.dataset, "u").value == pytest.approx(integrate(data, "u", over="all").value, rel=1e-12)


def test_streamlines_are_clipped(tmp_path, elvis):
    """Of a rigid rotation: circles, of which the ball leaves arcs with ends on its surface."""
    data = Dataset(grid(Shape.HEXAHEDRON, 2))
    velocity = {"u": lambda x: 0.5 - x[:, 1], "v": lambda x: x[:, 0] - 0.5, "w": lambda x: 0 * x[:, 0]}
    flow = replace(data, fields=tuple(approximated(data, *item, 2) for item in velocity.items()))
    files = write(flow, tmp_path / "a.xml")
    options = ["--clip", "outside:sphere:0.8,0.5,0.5:0.2", "--field", "speed", "-o", tmp_path / "a.npz"]
    elvis("extract", *files, "--streamlines", "line:0.7,0.5,0.5:0.9,0.5,0.5:3", *options)
    found = np.load(tmp_path / "a.npz")
    assert (np.linalg.norm(found["points"] - [0.8, 0.5, 0.5], axis=1) <= 0.2 + 1e-12).all()
    assert found["speed"] == pytest.approx(np.hypot(*(found["points"] - 0.5).T[:2]), abs=1e-4)
    cut = found["offsets"][1:][found["ends"][found["end"]] == "clip"] - 1
    assert np.linalg.norm(found["points"][cut] - [0.8, 0.5, 0.5], axis=1) == pytest.approx(0.2, abs=1e-12)


@pytest.mark.parametrize("data", [mixed_plane(1), curved(grid(Shape.TRIANGLE, 2), wave, 3)])
def test_isolines_of_plane_data_are_within_the_stated_distance(data):
    """A circle: closed, left of its inside by larger values outside, and its length from chords that differ in size."""
    found = level_lines(Dataset(data), "sphere:0.5,0.5,0:0.31", ["x*y"], 1e-3)
    away = found.points - [0.5, 0.5, 0]
    assert np.abs(np.linalg.norm(away, axis=1) - 0.31).max() < 1e-14
    assert found.values["x*y"] == pytest.approx(found.points[:, 0] * found.points[:, 1], abs=1e-14)
    start, stop = away[found.lines].swapaxes(0, 1)
    assert (np.cross(start, stop)[:, 2] < 0).all()
    assert found.is_bound
    assert 0 < 0.31 - np.linalg.norm((start + stop) / 2, axis=1).min() <= found.distance <= 1e-3
    rows, offsets = found.joined()
    assert offsets.tolist() == [0, len(found.lines) + 1]
    assert rows[0] == rows[-1]
    angles = 2 * np.arcsin(np.linalg.norm(stop - start, axis=1) / 0.62)
    assert angles.sum() == pytest.approx(2 * np.pi, abs=1e-10)


def test_distances_of_lines_are_estimates_if_those_in_some_elements_are():
    """A derivative, which is a polynomial in elements with an affine map only."""

    def bent(x):
        return x + 0.12 * (x[..., :1] > 0.5) * np.sin(2 * np.pi * x[..., :1]) ** 2 * np.sin(3 * x[..., 1:2]) * [1, 1, 0]

    bare = Dataset(curved(grid(Shape.QUADRILATERAL, 2), bent, 4))
    field = approximated(bare, "u", lambda x: x[:, 0] ** 2 + x[:, 1] ** 3, 4)
    found = level_lines(replace(bare, fields=(field,)), "d(u,y)=0.5", tolerance=1e-2)
    assert (found.points[:, 0] < 0.5).any()
    assert not found.is_bound


def test_plane_data_with_some_elements_in_space_have_no_lines():
    mesh = curved(mixed_plane(), lambda x: x + [0, 0, 1] * np.maximum(x[..., :1] - 2, 0) * (3 - x[..., :1]), 3)
    data = Dataset(replace(mesh, space=3))
    assert sorted(patch.is_flat for patch in patches(data)) == [False, True]
    with pytest.raises(ElvisError, match="expected 2D data in the plane, found a surface in space"):
        level_lines(data, "x=0.5")


def test_lines_of_plane_data_are_clipped(tmp_path, elvis, elvis_json):
    """A chord of a circle that both ends of its only segments lie outside of, and an arc that a line cuts."""
    data = Dataset(grid(Shape.QUADRILATERAL, 1))
    files = write(replace(data, fields=(approximated(data, "u", FUNCTIONS["u"], 3),)), tmp_path / "a.xml")
    chord = ["--plane", "0,0.6,0:0,1,0", "--clip", "outside:sphere:0.5,0.5,0:0.2", "--field", "v=3*x"]
    found = elvis_json("extract", *files, *chord, "-o", tmp_path / "a.vtp")
    assert found["length"] == pytest.approx(2 * np.sqrt(0.2**2 - 0.1**2), abs=1e-12)
    arc = ["--cut", "sphere:0.5,0.5,0:0.3", "--clip", "plane:0.65,0,0:1,0,0", "--tolerance", "1e-5"]
    found = elvis_json("extract", *files, *arc, "-o", tmp_path / "b.vtp")
    # the clip removes x < 0.65: half the angle of the arc is arccos(0.15/0.3) = 60 degrees
    assert found["length"] == pytest.approx(0.3 * 2 * np.pi / 3, abs=1e-4)
    with pytest.raises(ElvisError, match="expected some of the lines to be left, found none"):
        elvis("extract", *files, *arc, "--clip", "plane:9,0,0:1,0,0", "-o", tmp_path / "c.vtp")


def test_lines_of_plane_data_are_written_for_vtk(tmp_path, elvis, elvis_json):
    data = Dataset(mixed_plane(1))
    data = replace(data, fields=(approximated(data, "u", FUNCTIONS["u"], 3),))
    files = write(data, tmp_path / "a.xml")
    options = ["--isosurface", "u=0.3", "--field", "twice=2*u", "--field", "y"]
    facts = elvis_json("extract", *files, *options, "-o", tmp_path / "a.vtp")
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(tmp_path / "a.vtp"))
    reader.Update()
    found = reader.GetOutput()
    points = vtk_to_numpy(found.GetPoints().GetData())
    # x^2 = 0.3
    assert np.abs(points[:, 0] - np.sqrt(0.3)).max() < 1e-13
    assert vtk_to_numpy(found.GetPointData().GetArray("twice")) == pytest.approx(0.6, abs=1e-13)
    assert found.GetNumberOfLines() == facts["lines"] == 1
    assert facts["length"] == pytest.approx(1, abs=1e-12)
    elvis("extract", *files, "--plane", "0.5,0.5,0:1,1,0", "--field", "u", "-o", tmp_path / "a.vtu")
    known = meshio.read(tmp_path / "a.vtu")
    assert known.points.sum(axis=1) == pytest.approx(1, abs=1e-14)
    assert known.point_data["u"] == pytest.approx(FUNCTIONS["u"](known.points), abs=1e-13)
    with pytest.raises(ElvisError, match=r"expected a name ending in .vtp or .vtu, as u=0.3 meets 2D data in lines"):
        elvis("extract", *files, "--isosurface", "u=0.3", "-o", tmp_path / "a.stl")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return write(flow(grid(Shape.HEXAHEDRON, 1)), tmp_path_factory.mktemp("data") / "a.xml")


def torus(x):
    """The torus of `TORUS`, and its gradient."""
    away = x - 0.5
    square = (away**2).sum(axis=1) + 0.28**2 - 0.1**2
    flat = away * (1, 1, 0)
    value = square**2 - 4 * 0.28**2 * (flat**2).sum(axis=1)
    return value, 4 * square[:, None] * away - 8 * 0.28**2 * flat


def gyroid(x):
    """The gyroid of two periods, and its gradient."""
    s, c = np.sin(2 * np.pi * x), np.cos(2 * np.pi * x)
    value = s[:, 0] * c[:, 1] + s[:, 1] * c[:, 2] + s[:, 2] * c[:, 0]
    parts = [c[:, k] * c[:, (k + 1) % 3] - s[:, k] * s[:, (k + 2) % 3] for k in range(3)]
    return value, 2 * np.pi * np.stack(parts, axis=1)


GYROID = "sin(2*pi*x)*cos(2*pi*y) + sin(2*pi*y)*cos(2*pi*z) + sin(2*pi*z)*cos(2*pi*x)=0"


def onto(function, points):
    """Points (n, 3) moved onto a surface along its gradient, by Newton's method."""
    for _ in range(30):
        value, gradient = function(points)
        points = points - (value / (gradient**2).sum(axis=1))[:, None] * gradient
    return points[np.abs(function(points)[0]) < 1e-12]


@pytest.mark.parametrize(("surface", "function", "tolerance"), [(TORUS, torus, 0.02), (GYROID, gyroid, 0.05)])
def test_stl_files_are_within_the_tolerance_of_the_surface(tmp_path, elvis_json, surface, function, tolerance):
    """Points on the surface to triangles, by libigl, and points of triangles to the surface, by Newton's method."""
    files = write(Dataset(grid(Shape.HEXAHEDRON, 2)), tmp_path / "a.xml")
    facts = elvis_json("extract", *files, "--cut", surface, "--tolerance", tolerance, "-o", tmp_path / "a.stl")
    mesh = trimesh.load_mesh(tmp_path / "a.stl")
    assert facts["distance"] <= tolerance
    assert facts["is_bound"]
    # no two points are the same in single precision, although the gyroid is zero at all corners of elements
    assert len(mesh.vertices) == facts["points"]
    rng = np.random.default_rng(5)
    exact = onto(function, rng.uniform(0, 1, (3000, 3)))
    exact = exact[(np.abs(exact - 0.5) < 0.5).all(axis=1)]
    assert len(exact) > 500
    back = np.sqrt(igl.point_mesh_squared_distance(exact, mesh.vertices, mesh.faces)[0].max())
    weights = rng.dirichlet((1, 1, 1), len(mesh.faces))
    inner = np.einsum("nk,nki->ni", weights, mesh.triangles)
    there = np.linalg.norm(onto(function, inner) - inner, axis=1).max()
    assert 0 < max(there, back) <= facts["distance"] + 1e-6
    # open only where the surface leaves the data
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, first, counts = np.unique(edges, axis=0, return_index=True, return_counts=True)
    border = mesh.vertices[edges[first[counts == 1]]]
    assert (np.abs(np.abs(border - 0.5) - 0.5) < 1e-6).all(axis=1).any(axis=1).all()
    assert mesh.is_watertight == (function is torus)


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj", ".glb"])
def test_trimesh_reads_the_output(files, tmp_path, elvis_json, suffix):
    out = tmp_path / f"ball{suffix}"
    facts = elvis_json("extract", *files, "--cut", SPHERE, "--tolerance", "0.05", "--field", "p", "-o", out)
    mesh = trimesh.load_mesh(out)
    assert len(mesh.faces) == facts["triangles"]
    assert mesh.is_watertight
    assert mesh.area == pytest.approx(facts["area"], rel=1e-5)
    assert np.abs(np.linalg.norm(mesh.vertices - CENTRE, axis=1) - RADIUS).max() < (1e-12 if suffix == ".obj" else 1e-6)
    if suffix == ".glb":
        assert mesh.vertex_attributes["_p"].reshape(-1) == pytest.approx(FUNCTIONS["p"](mesh.vertices), abs=1e-6)
    if suffix == ".ply":
        known = meshio.read(out)
        assert known.point_data["p"] == pytest.approx(FUNCTIONS["p"](known.points), abs=1e-6)


def test_vtk_reads_triangles_with_every_digit(files, tmp_path, elvis):
    elvis(
        "extract",
        *files,
        "--isosurface",
        "p=1.6",
        "--field",
        "twice=2*u",
        "--tolerance",
        "0.02",
        "-o",
        tmp_path / "a.vtp",
    )
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(tmp_path / "a.vtp"))
    reader.Update()
    found = reader.GetOutput()
    points = vtk_to_numpy(found.GetPoints().GetData())
    assert np.abs(FUNCTIONS["p"](points) - 1.6).max() < 1e-12
    assert vtk_to_numpy(found.GetPointData().GetArray("twice")) == pytest.approx(2 * FUNCTIONS["u"](points), abs=1e-12)
    assert found.GetNumberOfPolys() > 0


def test_curved_triangles_have_their_nodes_on_the_surface_in_vtk(files, tmp_path, elvis_json):
    """Of order 2 on a sphere: their area converges with the fourth power of their size."""
    exact = 4 * np.pi * RADIUS**2
    errors = []
    for tolerance in (0.005, 0.0005):
        out = tmp_path / f"ball{tolerance}.vtu"
        options = ["--order", "2", "--tolerance", tolerance, "--field", "p"]
        facts = elvis_json("extract", *files, "--cut", SPHERE, *options, "-o", out)
        assert facts["distance"] <= tolerance
        known = meshio.read(out)
        assert np.abs(np.linalg.norm(known.points - CENTRE, axis=1) - RADIUS).max() < 1e-14
        assert known.point_data["p"] == pytest.approx(FUNCTIONS["p"](known.points), abs=1e-12)
        surface = read(out, cache=False)
        assert surface.order >= 2
        errors.append(abs(integrate(surface, "1").value / exact - 1))
    assert errors[0] < 1e-3
    assert errors[1] < errors[0] / 10


@pytest.mark.parametrize("suffix", [".xml", ".vtu", ".msh"])
def test_boundaries_record_their_elements(files, tmp_path, elvis, suffix):
    out = tmp_path / f"skin{suffix}"
    elvis("extract", *files, "--boundary", "all", "--field", "u", "--field", "push=p*nx", "-o", out)
    skin = read(out, *([out.with_suffix(".fld")] if suffix == ".xml" else []), cache=False)
    data = read(*files)
    for whole, own in (("u", "u"), ("p*nx", "push")):
        assert integrate(skin, own).value == pytest.approx(integrate(data, whole, over="all").value, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("options", "name", "message"),
    [
        (["--isosurface", "p=9"], "a.stl", "p=9: expected a surface within the data, found none"),
        (["--isosurface", "p"], "a.stl", "expected Q=V"),
        (["--isosurface", "r=1"], "a.stl", "there is no 'r'"),
        (["--cut", "cube:1"], "a.stl", "expected a surface QUANTITY=VALUE"),
        (["--boundary", "wall"], "a.stl", "there is no boundary 'wall'"),
        (["--boundary", "domain"], "a.stl", "domain: expected a boundary, found elements"),
        (["--boundary", "all", "--plane", "0,0,0:0,0,1"], "a.stl", "expected one of --boundary"),
        (["--isosurface", "p=1.6", "--isosurface", "p=1.7"], "a.stl", "expected one of --boundary"),
        (["--plane", "0,0,0.5:0,0,1"], "a.xml", "expected a name ending in"),
        (["--plane", "0,0,0.5:0,0,1", "--tolerance", "-1"], "a.stl", "expected a positive tolerance"),
        (
            ["--cut", SPHERE, "--tolerance", "1e-9"],
            "a.stl",
            "expected a tolerance that some millions of triangles reach",
        ),
        (["--plane", "0,0,0.5:0,0,1", "--clip", "p=1"], "a.stl", "--clip: expected plane:P:N"),
        (["--cut", SPHERE, "--order", "2"], "a.vtp", "expected a name ending in .xml, .vtu, .msh for curved triangles"),
        (["--boundary", "all", "--order", "2"], "a.vtu", "--order: expected --plane, --cut or --isosurface"),
        (["--boundary", "all", "--tolerance", "0.1"], "a.xml", "--tolerance and --clip are for triangles"),
    ],
)
def test_bad_input_gives_a_one_line_error_and_no_file(files, tmp_path, elvis, options, name, message):
    with pytest.raises((ElvisError, ClickException)) as raised:
        elvis("extract", *files, *options, "-o", tmp_path / name)
    text = getattr(raised.value, "message", str(raised.value))
    assert message in text
    assert "\n" not in text
    assert not list(tmp_path.iterdir())


def test_plane_data_have_no_triangles():
    with pytest.raises(ElvisError, match="expected 3D data, found 2D data"):
        level_triangles(Dataset(grid(Shape.QUADRILATERAL, 1)), "x=0.5")


def test_closed_data_have_no_boundary():
    """The faces of a cube as a surface."""
    skin = boundary_data(Dataset(grid(Shape.HEXAHEDRON, 1)), "all")
    with pytest.raises(ElvisError, match="all: expected a boundary, found none, as the data are closed or periodic"):
        boundary_data(skin, "all")
