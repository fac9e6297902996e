"""Distances on a device: values and gradients against NumPy, surfaces at a distance, what plugins have of them."""

import numpy as np
import pytest
import trimesh

from elvis import Camera, Dataset, Isosurface, Scene, Status, render
from elvis.core.base.errors import ElvisError
from elvis.core.distances import nearest, surface_of
from elvis.core.mapping.geometry import geometry
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.functions import FUNCTIONS, OPERATORS
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple, scattered
from elvis.plugins.runtime.serving import volume_of

#: of the largest magnitude
VALUE, UNIT = 1e-12, 1e-9


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A closed body with spikes."""
    ball = trimesh.creation.icosphere(1, radius=0.6)
    ball.vertices *= 1 + 0.8 * (np.arange(len(ball.vertices)) % 4 == 0)[:, None]
    path = tmp_path_factory.mktemp("bodies") / "spikes.ply"
    ball.apply_translation((1, 0.5, 0.5)).export(path)
    return str(path)


def with_field(mesh):
    """A dataset with the field u = x."""
    return Dataset(mesh, (approximated(Dataset(mesh), "u", lambda p: p[:, 0], 3),))


@pytest.mark.parametrize("shape", [Shape.HEXAHEDRON, Shape.TRIANGLE])
def test_distances_and_their_gradients_match_those_of_numpy(renderer, file, shape):
    text = "distance(all)" if shape is Shape.TRIANGLE else f"distance('{file}')"
    dataset, drawing = with_field(curved(grid(shape, 2), ripple(0.05), n=4)), renderer("vulkan")
    (part,) = volume_of(dataset, [text]).parts
    slope, away = f"d({text},x)", text.replace("distance", "bfc_dir1_y")
    drawing.show(volume_of(dataset, [text, slope, away]))
    reference, elements = np.zeros((80, 3)), np.resize(np.arange(len(part)), 80)
    reference[:, : shape.dimension] = 0.95 * scattered(shape, 80, seed=1) + 0.05 * shape.vertices.mean(axis=0)
    centre = drawing.sample_elements(0, elements[:1], reference[:1]).center
    found = drawing.sample_elements(0, elements, reference - centre, text)
    expression = Expression.of(dataset, text)
    truth = Evaluator(dataset, [expression]).at(expression, part.element_ids[elements], reference)
    assert np.abs(found.value - truth).max() < VALUE * np.abs(truth).max()
    gradient = np.linalg.solve(found.jacobian.transpose(0, 2, 1), found.gradient[:, :, None])[:, :, 0]
    assert np.abs(np.linalg.norm(gradient, axis=1) - 1).max() < UNIT
    for name, own in ((slope, gradient[:, 0]), (away, np.sign(truth) * gradient[:, 1])):
        assert np.abs(drawing.sample_elements(0, elements, reference - centre, name).value - own).max() < UNIT
    place = nearest(surface_of(dataset, text[9:-1].strip("'")), found.position).place
    assert np.abs(found.position - found.value[:, None] * gradient - place).max() < UNIT


def notched(points, bend):
    """The unit square or cube with an acute notch from x = 0, turned and shifted so that coordinates are rounded."""
    x, y, z = points.T
    depth = 0.8 * (1 - x) * (1 - np.abs(2 * y - 1))
    cosine, sine = np.cos(0.3), np.sin(0.3)
    u, v = x + depth, y + bend * depth * np.sin(np.pi * y)
    return np.stack([cosine * u - sine * v + 0.1 * z, sine * u + cosine * v + 0.2 * z, z], axis=1)


@pytest.fixture(scope="module")
def spike(tmp_path_factory):
    """A closed body with a tip at the middle of the unit cube, one wall of which is cut into many slivers."""
    line = np.linspace(-1, 1, 9)
    base = np.array([*((-0.25, y, -1.0) for y in line), (0.6, 1.0, -1.0), (0.6, -1.0, -1.0)])
    vertices = np.array([*(base * (0.5, 0.5, 1.5)), (0, 0, 0), (0, 0, -1.5)]) + 0.5
    count = len(base)
    walls = [[(k + 1) % count, count, k] for k in range(count)]
    floor = [[k, count + 1, (k + 1) % count] for k in range(count)]
    path = tmp_path_factory.mktemp("bodies") / "spike.ply"
    trimesh.Trimesh(vertices, walls + floor, process=False).export(path)
    return str(path)


@pytest.mark.parametrize(
    ("shape", "bend"), [(Shape.QUADRILATERAL, 0.1), (Shape.HEXAHEDRON, 0.1), (Shape.HEXAHEDRON, 0.0)]
)
def test_points_near_acute_notches_are_inside(renderer, shape, bend):
    """Their nearest place is on two or more patches, and may lie behind one of them."""
    mesh = curved(grid(shape, 2), lambda points: notched(points, bend), n=4 if bend else 2)
    dataset, drawing = with_field(mesh), renderer("vulkan")
    assert (check_signs(dataset, drawing, "distance(all)", shape) < 0).all()


def test_points_near_tips_with_slivers_are_outside(renderer, spike):
    """The angles of faces at the tip weigh their normals."""
    dataset, drawing = with_field(grid(Shape.HEXAHEDRON, 2)), renderer("vulkan")
    assert (check_signs(dataset, drawing, f"distance('{spike}')", Shape.HEXAHEDRON) > 0).mean() > 0.95


def check_signs(dataset, drawing, text, shape):
    """Distances inside of elements, with their signs, match those of NumPy."""
    (part,) = volume_of(dataset, [text]).parts
    drawing.show(volume_of(dataset, [text]))
    reference, elements = np.zeros((400, 3)), np.resize(np.arange(len(part)), 400)
    reference[:, : shape.dimension] = 0.999 * scattered(shape, 400, seed=2)
    centre = drawing.sample_elements(0, elements[:1], reference[:1]).center
    found = drawing.sample_elements(0, elements, reference - centre, text).value
    expression = Expression.of(dataset, text)
    truth = Evaluator(dataset, [expression]).at(expression, part.element_ids[elements], reference)
    assert np.abs(found - truth).max() < VALUE * np.abs(truth).max()
    return found


def test_the_surface_at_a_distance_of_a_plane_is_parallel_to_it(tmp_path, renderer):
    corners = np.array([[-9, -9, 0.1], [9, -9, 0.1], [9, 9, 0.4], [-9, 9, 0.4]], np.float64)
    trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]]).export(tmp_path / "plane.obj")
    normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
    normal /= np.linalg.norm(normal)
    scene = Scene(
        field=f"distance('{tmp_path / 'plane.obj'}')",
        objects=(Isosurface((0.2,)),),
        camera=Camera((0.5, 0.5, 4.0), (0.5, 0.5, 0.5), up=(0, 1, 0), height=0.8),
        size=(24, 20),
    )
    frame = render(with_field(grid(Shape.TETRAHEDRON, 1)), scene)
    hit = np.isfinite(frame.depth)
    assert hit.all()
    height = (frame.position[hit] - corners[0]) @ normal
    assert np.abs(height - 0.2).max() < 1e-10
    assert np.abs(np.abs(frame.normal[hit] @ normal) - 1).max() < 1e-9
    assert (frame.status[hit] == Status.CERTAIN).mean() > 0.9


def test_bounds_of_elements_exclude_distant_ones():
    dataset = with_field(grid(Shape.TETRAHEDRON, 4))
    (part,) = volume_of(dataset, ["distance(boundary)"]).parts
    low, high = part.quantities["distance(boundary)"].bounds()
    value = Evaluator(dataset, [Expression.of(dataset, "distance(boundary)")])
    expression = value.expressions[0]
    for spot in scattered(Shape.TETRAHEDRON, 20, seed=2):
        own = value.at(expression, part.element_ids, np.tile(spot, (len(part), 1)))
        assert (low <= own).all()
        assert (own <= high).all()
    assert ((low > -0.1) | (high < -0.1)).sum() > 0.1 * len(part)


def test_an_unknown_boundary_is_rejected_before_drawing():
    with pytest.raises(ElvisError, match="there is no boundary 'wall'; there are all, boundary, 1"):
        volume_of(with_field(grid(Shape.HEXAHEDRON, 1)), ["distance(wall)"])


#: every operator and function with a distance D in it, where it is defined all over, and where it is not
OPERATIONS = {
    "+": ("D + u", "2 + D"),
    "-": ("u - D", "-D", "D - D"),
    "*": ("D * u", "D * D", "D * (u - 0.4)"),
    "/": ("D / (2 + u)", "u / (0.9 + D)", "u / D"),
    "^": ("D^2", "D^3", "(1 + D)^1.5", "2^D", "(1 + D)^u"),
    "step": (),  # in derivatives alone
    "abs": ("abs(D)",),
    "sign": ("sign(D)",),
    "sqrt": ("sqrt(0.9 + D)", "sqrt(D)"),
    "exp": ("exp(2 * D)",),
    "log": ("log(0.9 + D)", "log(D)"),
    "sin": ("sin(9 * D)",),
    "cos": ("cos(9 * D)",),
    "tan": ("tan(D)", "tan(9 * D)"),
    "asin": ("asin(D)", "asin(9 * D)"),
    "acos": ("acos(D)",),
    "atan": ("atan(9 * D)",),
    "sinh": ("sinh(D)",),
    "cosh": ("cosh(D)",),
    "tanh": ("tanh(D)",),
    "atan2": ("atan2(D, u - 0.5)",),
    "min": ("min(D, u - 0.5)",),
    "max": ("max(D, u - 0.5)", "max(D, -D)"),
    "imaginary_root": ("imaginary_root(D, u)",),
    "middle_eigenvalue": ("middle_eigenvalue(D, u, 0.2, D, 0.1, u)",),
    "pow": ("pow(1 + D, u)",),
}


@pytest.fixture(scope="module")
def bent(file):
    """Elements of all shapes, curved, and the shapes by id."""
    dataset = with_field(curved(mixed_volume(seed=2), ripple(0.03), n=3))
    shapes = {int(number): block.expansion.shape for block in geometry(dataset) for number in block.element_ids}
    assert set(shapes.values()) == set(Shape.of_dimension(3))
    return dataset, shapes


def test_every_operation_is_tried():
    assert OPERATIONS.keys() == {**OPERATORS, **FUNCTIONS}.keys()


@pytest.mark.sampled(least=10, free=("name",))
@pytest.mark.parametrize("name", [name for name, texts in OPERATIONS.items() if texts])
def test_bounds_of_operations_with_distances_contain_all_values(bent, file, name):
    """On each element of all shapes; where a value is not a number somewhere nothing is claimed of the rest."""
    dataset, shapes = bent
    texts = [text.replace("D", f"distance('{file}')") for text in OPERATIONS[name]]
    expressions = [Expression.of(dataset, text) for text in texts]
    value = Evaluator(dataset, expressions)
    close = 0
    for part in volume_of(dataset, ["u", *texts]).parts:
        spots = scattered(shapes[int(part.element_ids[0])], 60, seed=5)
        ids, points = np.repeat(part.element_ids, len(spots)), np.tile(spots, (len(part), 1))
        for text, expression in zip(texts, expressions, strict=True):
            low, high = (np.repeat(ends, len(spots)) for ends in part.quantities[text].bounds())
            own = value.at(expression, ids, points)
            there = np.isfinite(own)
            assert (low[there] <= own[there]).all(), text
            assert (own[there] <= high[there]).all(), text
            close += (np.isfinite(low) & np.isfinite(high)).sum()
    assert close > 0
