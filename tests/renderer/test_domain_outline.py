"""The outline of the domain: sharp edges and silhouettes against closed forms, and when it is drawn."""

import numpy as np
import pytest

from elvis import Camera, CutSurface, Dataset, Faces, Isosurface, Plane, Scene, Shape, Streamlines, render
from elvis.core.testing import curved, grid, mixed_plane, mixed_volume, with_field
from elvis.plugins.samples.sample_data import wing
from elvis.renderer.frame.domain_outline import _edges_of_faces, _numbers, boundary_surface
from elvis.scene.cameras.view import View

LEVEL = Isosurface((0.5,))
ABOVE = Camera((0.5, 0.5, 3.0), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0), height=1.5)
ASIDE = Camera((3.0, 2.0, 2.5), (0.5, 0.5, 0.5), height=2.5)


def surface_of(mesh):
    return boundary_surface(Dataset(mesh))


def lengths(surface):
    ends = surface.sharp_edges
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def ring(points):
    """A quarter of a hollow cylinder about z with radii 1 and 2."""
    radius, angle = 1.0 + points[:, 0], 0.5 * np.pi * points[:, 1]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), points[:, 2]], axis=1)


@pytest.mark.parametrize("shape", [Shape.HEXAHEDRON, Shape.TETRAHEDRON, Shape.PRISM])
def test_sharp_edges_of_a_cube_are_its_twelve_edges(shape):
    assert lengths(surface_of(grid(shape, 2))).sum() == pytest.approx(12.0, rel=1e-12)


def test_no_lines_lie_between_faces_of_different_kinds():
    """Triangles and squares meet within the sides of three cubes in a row with a wedge in front of the middle one."""
    straight = mixed_volume()
    bent = curved(straight, lambda x: x + 1e-3 * np.sin(3.0 * x[:, [1, 2, 0]]), 4)
    assert lengths(surface_of(straight)).sum() == pytest.approx(24.0 + np.sqrt(8.0), rel=1e-12)
    assert lengths(surface_of(bent)).sum() == pytest.approx(24.0 + np.sqrt(8.0), rel=1e-2)


def test_faces_are_counted_with_triangles_first():
    mesh = mixed_volume()
    triangles, squares = (mesh.of(shape).members for shape in (Shape.TRIANGLE, Shape.QUADRILATERAL))
    rows = np.array([len(triangles) + 2, len(triangles) - 1, len(triangles)])
    found = list(_edges_of_faces(Dataset(mesh), rows))
    assert np.array_equal(found[0], triangles[-1:])
    assert np.array_equal(found[1], squares[[2, 0]])


def test_pairs_of_vertices_have_different_numbers_in_large_meshes():
    """Rows of vertices are of 32 bits, their products are not."""
    pairs = np.array([[70000, 46341], [0, 0], [46341, 70000]], np.int32)
    assert _numbers(pairs, 92682).tolist() == [46341 * 92682 + 70000, 0, 46341 * 92682 + 70000]


@pytest.mark.parametrize("fov", [None, 30.0])
def test_silhouettes_of_a_cylinder_are_where_its_normal_is_across_the_view(fov):
    eye, at = np.array([6.0, -5.0, 2.5]), np.array([1.0, 1.0, 0.5])
    how = {"height": 4.0} if fov is None else {"fov": fov}
    view = View.through(Camera(tuple(eye), tuple(at), **how), (200, 160))
    surface = surface_of(curved(grid(Shape.HEXAHEDRON, 2), ring, n=6))
    points = surface.silhouettes(view).reshape(-1, 3)
    radius, angle = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
    for own in (1.0, 2.0):
        normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        towards = (eye - points)[:, :2] if fov else np.tile((eye - at)[:2], (len(points), 1))
        cosine = (normal * towards).sum(axis=1) / np.linalg.norm(towards, axis=1)
        is_on = np.abs(radius - own) < 1e-2
        assert np.ptp(points[is_on, 2]) == pytest.approx(1.0, abs=1e-9)
        assert np.abs(cosine[is_on]).max() < 0.01
        points, radius, angle = points[~is_on], radius[~is_on], angle[~is_on]
    assert not len(points)


def test_the_outline_is_that_of_bodies_or_of_all_edges_of_a_plane():
    data = wing()
    points = boundary_surface(data).points
    assert (np.ptp(points, axis=0)[:2] < 0.3 * np.ptp(data.mesh.corners, axis=0)[:2]).all()
    low, high = mixed_plane().corners
    assert lengths(surface_of(mixed_plane())).sum() == pytest.approx(2.0 * (high - low).sum(), rel=1e-12)


PLANE = CutSurface(Plane((0.5, 0.5, 0.5), (0.0, 0.0, 1.0)))


@pytest.mark.parametrize(
    ("objects", "camera", "is_shown"),
    [
        ((), "fit", False),
        ((Faces(),), "fit", False),
        ((LEVEL,), "fit", True),
        ((LEVEL, Faces(("wall",))), "fit", False),
        ((Streamlines(("random:9",)),), "iso", True),
        ((PLANE,), "fit", False),
        ((PLANE,), "top", False),
        ((PLANE,), ABOVE, False),
        ((PLANE,), "iso", True),
        ((PLANE,), ASIDE, True),
        ((PLANE, LEVEL), ABOVE, True),
    ],
)
def test_the_outline_is_drawn_unless_faces_or_the_view_show_the_domain(objects, camera, is_shown):
    scene = Scene("u", objects=objects, camera=camera)
    assert scene.shows_domain is is_shown
    assert Scene("u", objects=objects, camera=camera, domain_outline=not is_shown).shows_domain is not is_shown


@pytest.mark.parametrize("item", [LEVEL, PLANE], ids=["level", "plane"])
def test_only_images_have_the_outline(item):
    """Records are the same with and without; lines are grey, and not where an object is in front of them."""
    data = with_field(grid(Shape.HEXAHEDRON, 2), lambda x: x[:, 2])
    how = {"objects": (item,), "camera": ASIDE, "size": (120, 100)}
    with_lines, without = render(data, "u", **how), render(data, "u", domain_outline=False, **how)
    for name in ("field", "element", "depth", "normal", "color", "status"):
        assert np.array_equal(getattr(with_lines, name), getattr(without, name), equal_nan=True)
    is_other = (with_lines.rgb != without.rgb).any(axis=2)
    # the cube's box is about 50 pixels wide; nine edges are visible, some of them in part
    assert 200 < np.count_nonzero(is_other) < 2000
    assert np.ptp(with_lines.rgb[is_other & ~with_lines.seen].astype(int), axis=1).max() == 0
    numbers, colors = with_lines.below_domain
    assert np.array_equal(colors, without.rgb.reshape(-1, 3)[numbers])


def test_pictures_hold_the_outline_unless_objects_are_small_in_the_domain():
    data = with_field(grid(Shape.HEXAHEDRON, 2), lambda x: np.linalg.norm(x - 0.5, axis=1) ** 2)

    def height(radius, **how):
        return render(
            data, "u", objects=(Isosurface((radius**2,)),), size=(80, 80), camera="+x", **how
        ).view.camera.height

    assert height(0.3) == pytest.approx(1.04, rel=1e-6)
    assert height(0.3, domain_outline=False) < 0.75
    assert height(0.1) < 0.3
