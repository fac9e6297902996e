"""Vortex cores: axes and rings known beforehand; none missed, none invented next to brute force; joins; limits."""

from types import SimpleNamespace

import numpy as np
import pytest

from elvis.core.base.arrays import frozen_floats
from elvis.core.base.errors import ElvisError
from elvis.core.cores import vortex_cores
from elvis.core.cores.boxes import Boxes, at_nodes
from elvis.core.cores.curves import core_curves
from elvis.core.cores.finding import CoreLimits
from elvis.core.cores.search import CoreSearch
from elvis.core.cores.turning import turns_less
from elvis.core.data.dataset import Block, Dataset, Field
from elvis.core.mapping.orientation import local_vertices
from elvis.core.mapping.patch import patches
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, ripple

CRITERIA = ("acceleration", "vorticity")
CENTRE = np.array([0.45, 0.52, 0.5])
AXIS = np.array([0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0])


def data(mesh, functions, modes=3, names="uvw"):
    bare = Dataset(mesh)
    return Dataset(mesh, tuple(approximated(bare, *own, modes) for own in zip(names, functions, strict=True)))


def components(velocity):
    """Of a velocity, points (n, 3) to (n, 3)."""
    return [lambda p, axis=axis: velocity(p)[:, axis] for axis in range(3)]


def vortex(axial=0.0, strain=0.0, decay=0.0):
    """A velocity around the tilted axis, with speed along it and strain; it turns less away from the axis."""

    def velocity(points):
        offset = points - CENTRE
        height = offset @ AXIS
        across = offset - np.outer(height, AXIS)
        turning = 1 - decay * (across**2).sum(axis=1, keepdims=True)
        return turning * np.cross(AXIS, across) + axial * AXIS + strain * (np.outer(height, AXIS) - across / 2)

    return velocity


def from_axis(points):
    """(n,) distances from the tilted axis."""
    offset = points - CENTRE
    return np.linalg.norm(offset - np.outer(offset @ AXIS, AXIS), axis=1)


def boundary_ends(found):
    return sum(found.counts().get(name, 0) for name in ("boundary", "all", "left"))


@pytest.mark.parametrize("shape", Shape.of_dimension(3))
@pytest.mark.parametrize("bend", [0.0, 0.04])
@pytest.mark.parametrize(("axial", "strain"), [(1.0, 0.0), (0.0, 0.0), (0.0, 0.5)])
@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.sampled(least=4, free=("axial", "strain"))
def test_a_tilted_axis_is_one_line(shape, bend, axial, strain, criterion):
    """With flow along it, without any, where all of it is at rest, and as in a Burgers vortex, at rest at one place."""
    mesh = curved(grid(shape, 2), ripple(bend), 3)
    found = vortex_cores(data(mesh, components(vortex(axial, strain)), 4), criterion=criterion, spacing=0.1)
    assert len(found) == 1
    assert found.undecided == ()
    assert boundary_ends(found) == 2
    assert from_axis(found[0]).max() < 1e-11
    steps = np.diff(found[0], axis=0)
    assert (steps @ AXIS > -1e-11).all()
    assert np.linalg.norm(steps, axis=1).max() < 0.1001
    assert found.swirl == pytest.approx(1.0, abs=1e-9)
    if not bend:
        assert found.lengths[0] == pytest.approx(1 / AXIS[2], abs=1e-8)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("shape", "bend"), [*((each, 0.0) for each in Shape.of_dimension(3)), (Shape.TETRAHEDRON, 0.04)]
)
@pytest.mark.parametrize(("axial", "strain"), [(1.0, 0.0), (0.0, 0.5)])
@pytest.mark.sampled(least=1, free=("axial", "strain"))
def test_lamb_oseen_and_burgers_vortices(shape, bend, axial, strain):
    """To the cubic terms, (1 - exp(-r^2)) / r = r - r^3 / 2, which elements hold exactly, as sextics on curved ones."""
    mesh = curved(grid(shape, 1), ripple(bend), 3) if bend else grid(shape, 1)
    functions = components(vortex(axial, strain, 0.5))
    found = vortex_cores(data(mesh, functions, 7 if bend else 4), spacing=0.1, min_swirl=0.5)
    assert found.undecided == ()
    assert len(found) == 1
    assert from_axis(found[0]).max() < 1e-8
    assert found.swirl == pytest.approx(1.0, abs=1e-8)


@pytest.mark.thorough
@pytest.mark.parametrize("criterion", CRITERIA)
def test_a_ring_is_closed(criterion):
    """The velocity (-x z, -y z, x^2 + y^2 - R^2): at rest on a circle about which it turns."""
    centre, radius = np.array([0.48, 0.53, 0.46]), 0.31

    def ring(points):
        x, y, z = (points - centre).T
        return np.stack([-x * z, -y * z, x**2 + y**2 - radius**2], axis=1)

    found = vortex_cores(data(grid(Shape.HEXAHEDRON, 2), components(ring)), criterion=criterion, spacing=0.05)
    (line,) = np.flatnonzero(found.closed)
    offset = found[line] - centre
    assert np.abs(np.linalg.norm(offset[:, :2], axis=1) - radius).max() < 1e-11
    assert np.abs(offset[:, 2]).max() < 1e-11
    assert found.lengths[line] == pytest.approx(2 * np.pi * radius, rel=0.01)
    assert found[line][0] == pytest.approx(found[line][-1], abs=1e-9)

    # as curves, whose lengths go on from element to element
    limits = CoreLimits(criterion, spacing=0.05)
    pieces = core_curves(data(grid(Shape.HEXAHEDRON, 2), components(ring)), None, limits).pieces
    starts, ends = pieces.length[:, 0], pieces.length[:, -1]
    assert starts[0] == 0
    assert starts[1:] == pytest.approx(ends[:-1])
    assert ends[-1] == pytest.approx(found.lengths[line], rel=1e-9)
    chords = 2 * pieces.points[:, 1::2].sum(axis=1)
    assert ends - starts == pytest.approx(np.linalg.norm(chords, axis=1), rel=1e-9)
    assert len(np.unique(pieces.element)) > 3


@pytest.mark.thorough
def test_a_ring_within_one_element_is_closed():
    def ring(points):
        x, y, z = (points - 0.5).T
        return np.stack([-x * z, -y * z, x**2 + y**2 - 0.09], axis=1)

    found = vortex_cores(data(grid(Shape.HEXAHEDRON, 1), components(ring)), spacing=0.1)
    assert found.counts() == {"closed": 1}
    assert np.abs(np.linalg.norm(found.points[:, :2] - 0.5, axis=1) - 0.3).max() < 1e-12
    assert found.lengths[0] == pytest.approx(0.6 * np.pi, rel=0.01)


POWERS = np.array([powers for powers in np.ndindex(3, 3, 3) if sum(powers) <= 2])


def random_fields(shape, cells, seed):
    """A dataset with another random quadratic velocity in each element, and the weights (3, n, 10) of powers.

    Powers are those of coordinates that are -1 to 1 in each cell of the grid; rows (n,) of elements in the mesh.
    """
    mesh = grid(shape, cells)
    bare = Dataset(mesh)

    def monomial(powers):
        return lambda p: ((2 * (p * cells - np.floor(p * cells)) - 1) ** powers).prod(axis=1)

    parts = [approximated(bare, "m", monomial(own), 3).blocks[0] for own in POWERS]
    rng = np.random.default_rng(seed)
    weights = rng.normal(size=(3, len(parts[0].element_ids), len(POWERS)))
    fields = []
    for name, own in zip("uvw", weights, strict=True):
        coefficients = sum(own[:, k, None] * part.coefficients for k, part in enumerate(parts))
        fields.append(Field(name, (Block(parts[0].expansion, parts[0].element_ids, frozen_floats(coefficients)),)))
    corners = mesh.vertices[local_vertices(mesh, shape)][mesh.of(shape).rows_of(parts[0].element_ids)]
    return Dataset(mesh, tuple(fields)), weights, corners, parts[0].element_ids


class Quadratics:
    """Random velocities in closed form, at points x (n, 3), with w their weights (3, n, 10) and the cells' places."""

    def __init__(self, weights, corners, cells, criterion):
        self.weights, self.cells, self.criterion = weights, cells, criterion
        self.origins = np.floor(corners.mean(axis=1) * cells)

    def at(self, element, x):
        """Velocities, gradients, and what must be zero."""
        s, w = 2 * (x * self.cells - self.origins[element]) - 1, self.weights[:, element]
        v = np.einsum("cnk,nk->nc", w, (s[:, None] ** POWERS).prod(axis=2))
        slopes = []
        for axis in range(3):
            lower = POWERS - np.eye(3, dtype=int)[axis]
            terms = POWERS[:, axis] * (s[:, None] ** lower.clip(0)).prod(axis=2)
            slopes.append(2 * self.cells * np.einsum("cnk,nk->nc", w, terms))
        g = np.stack(slopes, axis=2)
        other = np.einsum("nij,nj->ni", g, v)
        if self.criterion == "vorticity":
            other = np.stack([g[:, 2, 1] - g[:, 1, 2], g[:, 0, 2] - g[:, 2, 0], g[:, 1, 0] - g[:, 0, 1]], axis=1)
        return v, g, np.cross(v, other), np.linalg.norm(other, axis=1)

    def step(self, element, x):
        """(n, 3) steps of Gauss and Newton's method to cores, and gradients."""
        step = 1e-6 / self.cells * np.eye(3)
        slopes = [(self.at(element, x + h)[2] - self.at(element, x - h)[2]) / (2 * h.max()) for h in step]
        _, g, zero, _ = self.at(element, x)
        return np.einsum("nij,nj->ni", np.linalg.pinv(np.stack(slopes, axis=2), rcond=1e-6), zero), g

    def brute_force(self, corners, starts):
        """Elements and points of cores inside of them that Gauss and Newton's method finds from random starts."""
        rng = np.random.default_rng(0)
        element = np.repeat(np.arange(len(corners)), starts)
        x = np.einsum("nk,nkd->nd", rng.dirichlet(np.ones(corners.shape[1]), len(element)), corners[element])
        for _ in range(25):
            move = self.step(element, x)[0]
            length = np.linalg.norm(move, axis=1, keepdims=True)
            x = x - move * np.minimum(1, 0.1 / self.cells / length.clip(1e-300))
        v, g, zero, size = self.at(element, x)
        speed = np.linalg.norm(v, axis=1)
        swirl = np.abs(np.linalg.eigvals(g).imag).max(axis=1)
        good = (np.linalg.norm(zero, axis=1) < 1e-10 * speed * size) & (speed > 0.02)
        good &= swirl > 0.01 * np.linalg.norm(g, axis=(1, 2))
        return element[good], x[good]


def from_lines(found, element_id, points):
    """(n,) distances of points from the parts of lines in an element."""
    line = np.repeat(np.arange(len(found)), np.diff(found.offsets))
    inside = found.element == element_id
    first = np.flatnonzero(inside[:-1] & inside[1:] & (line[:-1] == line[1:]))
    if not len(first):
        return np.full(len(points), np.inf)
    begin, step = found.points[first], np.diff(found.points, axis=0)[first]
    part = np.einsum("nki,ki->nk", points[:, None] - begin, step) / (step**2).sum(axis=1).clip(1e-300)
    return np.linalg.norm(points[:, None] - begin - part.clip(0, 1)[:, :, None] * step, axis=2).min(axis=1)


def check_random_fields(shape, cells, criterion, seed):
    """None of the cores that brute force finds in random fields is missed; of all that are found, each is one."""
    dataset, weights, corners, ids = random_fields(shape, cells, seed)
    spacing = 0.05 / cells
    found = vortex_cores(dataset, criterion=criterion, spacing=spacing)
    truth = Quadratics(weights, corners, cells, criterion)
    element, x = truth.brute_force(corners, 40)
    low, high = corners.min(axis=1)[element], corners.max(axis=1)[element]
    inner = ((x > low + 1e-3) & (x < high - 1e-3)).all(axis=1)
    if shape is Shape.TETRAHEDRON:
        table = np.concatenate([corners.transpose(0, 2, 1), np.ones((len(corners), 1, 4))], axis=1)
        places = np.linalg.solve(table[element], np.column_stack([x, np.ones(len(x))])[:, :, None])[:, :, 0]
        inner = places.min(axis=1) > 1e-3
    for number in np.unique(element[inner]):
        if ids[number] not in found.undecided:
            assert from_lines(found, ids[number], x[inner & (element == number)]).max() < 0.1 * spacing

    rows = np.searchsorted(ids, found.element)
    move, g = truth.step(rows, found.points)
    size = np.linalg.norm(g, axis=(1, 2))
    assert np.abs(move).max(initial=0.0) < 1e-8
    swirl = np.abs(np.linalg.eigvals(g).imag).max(axis=1)
    assert swirl == pytest.approx(found.swirl, rel=1e-3, abs=1e-4 * size.max(initial=0.0))
    assert len(found.undecided) <= 0.1 * len(ids) + 1


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.HEXAHEDRON])
@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("seed", range(170))
@pytest.mark.sampled(least=4, free=("seed",))
def test_all_are_found_and_none_is_spurious(shape, criterion, seed):
    """In 1,000 random quadratic velocities on tetrahedra, and some on hexahedra."""
    check_random_fields(shape, 1, criterion, seed)


@pytest.mark.sampled(free=("seed",))
@pytest.mark.parametrize("seed", [14, 15])
def test_a_core_continuing_behind_a_gap_is_found(seed):
    """In these fields a core fades and, in about the same direction, goes on in the same element."""
    check_random_fields(Shape.TETRAHEDRON, 1, "vorticity", seed)


@pytest.mark.parametrize("shape", [Shape.HEXAHEDRON, Shape.PRISM])
def test_an_axis_on_borders_of_elements_is_found_once(shape):
    """Along the middle of the grid, where edges and faces of elements are."""
    middle = np.array([0.5, 0.25 if shape is Shape.PRISM else 0.5])

    def velocity(points):
        x, y = (points[:, :2] - middle).T
        return np.stack([-y, x, 1 + 0 * x], axis=1)

    found = vortex_cores(data(grid(shape, 2), components(velocity)), spacing=0.2)
    assert len(found) == 1
    assert boundary_ends(found) == 2
    assert np.abs(found.points[:, :2] - middle).max() < 1e-9
    assert found.lengths[0] == pytest.approx(1, abs=1e-6)


def test_momenta_are_divided_by_the_density():
    def density(points):
        return 1.5 + 0.4 * points[:, 0] - 0.3 * points[:, 2]

    flow = vortex(0.4, 0.2)
    functions = [density, *(lambda p, own=own: density(p) * own(p) for own in components(flow))]
    dataset = data(grid(Shape.PRISM, 1), functions, 3, ["rho", "rhou", "rhov", "rhow"])
    for criterion in CRITERIA:
        found = vortex_cores(dataset, criterion=criterion, spacing=0.1)
        assert len(found) == 1
        assert from_axis(found.points).max() < 1e-11
        assert found.swirl == pytest.approx(1.0, abs=1e-9)


def test_limits():
    dataset = data(grid(Shape.HEXAHEDRON, 1), components(vortex(1.0, 0.8)), 3)
    assert len(vortex_cores(dataset, min_swirl=0.99, spacing=0.2)) == 1
    assert len(vortex_cores(dataset, min_swirl=1.01, spacing=0.2)) == 0
    assert len(vortex_cores(dataset, min_length=2.0, spacing=0.2)) == 0
    assert len(vortex_cores(dataset, only_q=True, spacing=0.2)) == 1
    strained = data(grid(Shape.HEXAHEDRON, 1), components(vortex(1.0, 1.6)))
    assert len(vortex_cores(strained, only_q=True, spacing=0.2)) == 0
    found = vortex_cores(dataset, "u,v,w", fields=["u", "2*w"], spacing=0.2)
    assert list(found.values) == ["u", "2*w"]
    assert 2 * found.velocity[:, 2] == pytest.approx(found.values["2*w"], abs=1e-12)


@pytest.mark.parametrize(("speed", "expected"), [(0.0, 7e-4), (1e7, 2e-2 * 3**0.5)])
def test_turning_counts_relative_to_the_steepest_place_or_the_noise_of_the_fastest(speed, expected):
    """In a cube of size 1, whose reference coordinates change by 2 along each axis."""
    (patch,) = patches(Dataset(grid(Shape.HEXAHEDRON, 1)))
    steep, speeds = np.array([1.0, 7.0, 2.0, 3.0, 1.0, 1.0, 1.0, 5.0]), speed * np.array([1, 1, 0, 1, 0.1, 1, 0, 0])
    gradient, velocity = np.zeros((8, 3, 3)), np.zeros((8, 3))
    gradient[:, 0, 1], velocity[:, 2] = steep, speeds
    motions = SimpleNamespace(gradient=gradient, velocity=velocity, below=np.ones(8))
    parallel = SimpleNamespace(degrees=lambda *_: (1, 1), at=lambda _: motions)
    limits = CoreSearch(parallel, patch, 0.0, False)._limits(np.arange(1))
    assert limits == pytest.approx([expected], rel=1e-12)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_flows_without_rotation_have_no_cores(criterion):
    """In uniform flow, shear, strain, and at rest."""
    matrices = [np.zeros((3, 3)), np.diag([1.0, 0, 0])[[1, 0, 2]], np.diag([1.0, -0.4, -0.6])]
    for matrix in matrices:
        for base in (0.0, 1.0):
            flow = components(lambda p, matrix=matrix, base=base: p @ matrix.T + base)
            found = vortex_cores(data(grid(Shape.TETRAHEDRON, 1), flow), criterion=criterion)
            assert len(found) == 0
            assert found.undecided == ()


def test_bad_input():
    dataset = data(grid(Shape.HEXAHEDRON, 1), components(vortex()))
    with pytest.raises(ElvisError, match="one of acceleration, vorticity, found 'q'"):
        vortex_cores(dataset, criterion="q")
    with pytest.raises(ElvisError, match="minimum swirl: expected a number that is not negative"):
        vortex_cores(dataset, min_swirl=-1.0)
    with pytest.raises(ElvisError, match="spacing: expected a positive number"):
        vortex_cores(dataset, spacing=0.0)
    with pytest.raises(ElvisError, match=r"sin\(u\): expected a component that is a polynomial"):
        vortex_cores(dataset, "sin(u),v,w")
    with pytest.raises(ElvisError, match="expected 3D data, found 2D data"):
        vortex_cores(data(mixed_plane(1), components(vortex())[:2], names="uv"))
    with pytest.raises(ElvisError, match="has the name of a column"):
        vortex_cores(
            data(grid(Shape.HEXAHEDRON, 1), [lambda p: p[:, 0]], names=["swirl"]), "swirl,x,y", fields=["swirl"]
        )


def test_nan_values_are_undecided():
    dataset = data(grid(Shape.HEXAHEDRON, 2), components(vortex(1.0)))
    (block,) = dataset.field("u").blocks
    coefficients = block.coefficients.copy()
    coefficients[3] = np.nan
    broken = Field("u", (Block(block.expansion, block.element_ids, frozen_floats(coefficients)),))
    found = vortex_cores(Dataset(dataset.mesh, (broken, *dataset.fields[1:])))
    assert found.undecided == (int(block.element_ids[3]),)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_boxes_without_rotation_are_reported(degree):
    """None in which a sample turns; and shear layers, whose entries are large next to their eigenvalues."""
    rng = np.random.default_rng(degree)
    nets = rng.normal(size=(60, 9, *(degree + 1,) * 3)) * rng.choice([0.02, 0.2, 1.0], 60)[:, None, None, None, None]
    nets[:30] += np.diag([-1.0, 0.1, 1.2]).reshape(9, 1, 1, 1)
    nets[:10, 1] += 30.0
    nets[:10, [3, 6, 7]] *= 0.01
    least = rng.choice([0.01, 0.5], 60)
    uniform = np.ones((60, 3, 2, 2, 2))
    boxes = Boxes.whole(np.arange(60), uniform, nets, least, False)
    found = turns_less(boxes)
    matrices = at_nodes(nets, 6).reshape(60, 9, -1).swapaxes(1, 2).reshape(60, -1, 3, 3)
    turning = np.abs(np.linalg.eigvals(matrices).imag).max(axis=(1, 2))
    assert (turning[found] < least[found]).all()
    assert found[:10].sum() >= 3
    assert not found.all()


def test_a_no_slip_wall_is_not_a_core():
    """Where all velocity is zero it is parallel to everything: the axis ends above, where the flow turns too little."""

    def above_a_wall(points):
        return points[:, 2:] * vortex(1.0)(points)

    dataset = data(grid(Shape.PRISM, 1), components(above_a_wall), 3)
    found = vortex_cores(dataset, spacing=0.2, min_swirl=0.01)
    assert found.counts() == {"faded": 1, "boundary": 1}
    assert found.undecided == ()
    assert from_axis(found.points).max() < 1e-8
    assert found.points[:, 2].min() == pytest.approx(0.01, abs=1e-8)


@pytest.mark.thorough
@pytest.mark.parametrize("shape", [Shape.HEXAHEDRON, Shape.TETRAHEDRON])
def test_noise_that_jumps_at_borders_leaves_the_axis_one_line(shape):
    dataset = data(grid(shape, 2), components(vortex(1.0)), 3)
    rng = np.random.default_rng(0)
    noisy = []
    for field in dataset.fields:
        (block,) = field.blocks
        coefficients = block.coefficients + 1e-3 * rng.normal(size=block.coefficients.shape)
        noisy.append(Field(field.name, (Block(block.expansion, block.element_ids, frozen_floats(coefficients)),)))
    found = vortex_cores(Dataset(dataset.mesh, tuple(noisy)), spacing=0.1, min_swirl=0.5)
    assert found.undecided == ()
    assert found.counts() == {"boundary": 2}
    assert from_axis(found.points).max() < 0.02
