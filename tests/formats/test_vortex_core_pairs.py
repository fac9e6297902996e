"""Vortex cores through pairs of elements, turned and curved at random: one line each, but for those at a true jump."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.cores import vortex_cores
from elvis.core.cores.parallel import ParallelVectors
from elvis.core.cores.search import CoreSearch
from elvis.core.cores.tracing import CoreTracing
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.connectivity import connected
from elvis.core.mapping.margins import heights
from elvis.core.mapping.pointwise import positions, positions_and_jacobians
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid, rotated

#: places of pairs are this far apart, along x
APART = 4.0
PRISMS = np.array([[0, 1, 3, 2, 4, 6], [1, 5, 7, 3, 4, 6]])
TETRAHEDRA = np.array([[0, 1, 2, 3], [0, 1, 2, 4]])
CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
TIPS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.4, 0.4, 1], [0.3, 0.2, -0.9]])


@dataclass(frozen=True)
class Axis:
    """A line about which a flow turns, which moves along it, too."""

    place: Floats
    direction: Floats

    def velocity(self, points: Floats) -> Floats:
        """(n, 3) at points (n, 3)."""
        return np.cross(self.direction, points - self.place) + self.direction

    def away(self, points: Floats) -> Floats:
        """(n,) distances of points (n, 3)."""
        return np.linalg.norm(np.cross(points - self.place, self.direction), axis=1)


def pair(shape, bent, rng):
    """Vertices of two elements, these, and an axis through their common side; turned at random."""
    corners, elements = (TIPS, TETRAHEDRA) if shape is Shape.TETRAHEDRON else (CORNERS, PRISMS)
    if shape is Shape.PRISM:
        elements = rotated({shape: elements}, int(rng.integers(1 << 30)))[shape]
    common = np.intersect1d(*elements)
    middle, ahead = corners[common].mean(axis=0), np.diff(corners[elements].mean(axis=1), axis=0)[0]
    tilted = ahead / np.linalg.norm(ahead) + 0.25 * rng.normal(size=3)
    moved = corners + (0.1 if bent else 0.0) * rng.uniform(-1, 1, corners.shape)
    stretched = np.linalg.qr(rng.normal(size=(3, 3)))[0] @ (np.eye(3) + rng.uniform(-0.2, 0.2, (3, 3)))
    stretched *= np.sign(np.linalg.det(stretched))
    direction = stretched @ tilted
    place = stretched @ (0.2 * rng.uniform(-0.5, 0.5, 3))
    return (moved - middle) @ stretched.T, elements, Axis(place, direction / np.linalg.norm(direction))


def pairs(shape, bent, count, seed):
    """A mesh of pairs, and the axis of each."""
    rng = np.random.default_rng(seed)
    vertices, elements, axes = [], [], []
    for number in range(count):
        own, these, axis = pair(shape, bent, rng)
        shift = np.array([APART * number, 0, 0])
        elements.append(these + number * len(own))
        vertices.append(own + shift)
        axes.append(Axis(axis.place + shift, axis.direction))
    return connected(np.concatenate(vertices), {shape: np.concatenate(elements)}), axes


def number_of(points):
    """(n,) which pair points (n, 3) are in."""
    return np.floor(points[:, 0] / APART + 0.5).astype(int)


def flowing(mesh, axes, modes):
    """Data on a mesh of pairs, with the velocity about each one's axis."""

    def component(which):
        def values(points):
            own = number_of(points)
            found = np.empty(len(points))
            for number in np.unique(own):
                here = own == number
                found[here] = axes[number].velocity(points[here])[:, which]
            return found

        return values

    bare = Dataset(mesh)
    fields = (approximated(bare, name, component(which), modes) for which, name in enumerate("uvw"))
    return Dataset(mesh, tuple(fields))


@pytest.mark.parametrize(
    ("shape", "bent"),
    [(Shape.TETRAHEDRON, False), (Shape.TETRAHEDRON, True), (Shape.PRISM, False), (Shape.PRISM, True)],
)
@pytest.mark.parametrize("criterion", ["acceleration", "vorticity"])
@pytest.mark.sampled(least=4)
def test_a_line_through_the_side_of_two_elements_is_one(shape, bent, criterion):
    mesh, axes = pairs(shape, bent, 6, 5)
    modes = 4 if bent and shape is Shape.PRISM else 2
    found = vortex_cores(flowing(mesh, axes, modes), criterion=criterion, spacing=0.2, min_swirl=0.5)
    assert found.counts() == {"boundary": 12}
    assert found.undecided == ()
    assert sorted(number_of(found.points[found.offsets[:-1]])) == list(range(6))
    for line in range(6):
        points = found[line]
        elements = found.element[found.offsets[line] : found.offsets[line + 1]]
        axis = axes[number_of(points)[0]]
        assert axis.away(points).max() < 1e-12
        assert (np.diff(points @ axis.direction) > -1e-12).all()
        assert len(set(elements.tolist())) == 2


@pytest.mark.parametrize(("aside", "ends"), [(0.01, {"boundary": 8}), (0.15, {"boundary": 8, "jump": 8})])
def test_axes_that_jump_far_are_two_lines(aside, ends):
    """The axis of one element lies next to that of the other: by less than lines are joined over, or by more."""
    mesh, axes = pairs(Shape.TETRAHEDRON, False, 4, 2)
    moved = [Axis(axis.place + aside * np.linalg.svd(axis.direction[None])[2][1], axis.direction) for axis in axes]
    fields = []
    for one, other in zip(flowing(mesh, axes, 2).fields, flowing(mesh, moved, 2).fields, strict=True):
        coefficients = one.blocks[0].coefficients.copy()
        coefficients[1::2] = other.blocks[0].coefficients[1::2]
        fields.append(replace(one, blocks=(replace(one.blocks[0], coefficients=frozen_floats(coefficients)),)))
    found = vortex_cores(Dataset(mesh, tuple(fields)), spacing=0.2, min_swirl=0.5)
    assert found.counts() == ends
    assert found.undecided == ()


def test_an_end_above_a_wall_is_independent_of_the_start():
    """A velocity that is zero where z is: its core ends where it turns as little as is requested, each time.

    Steps go on beyond the wall, where what is zero on cores has derivatives of the other sign.
    """
    direction = np.array([0.3, 0.2, 1.0])
    axis, least = Axis(np.array([0.45, 0.52, 0.5]), direction / np.linalg.norm(direction)), 0.01

    def component(which):
        return lambda points: points[:, 2] * axis.velocity(points)[:, which]

    bare = Dataset(grid(Shape.PRISM, 1))
    fields = tuple(approximated(bare, name, component(which), 3) for which, name in enumerate("uvw"))
    parallel = ParallelVectors(Dataset(bare.mesh, fields), None, "acceleration")
    (patch,) = parallel.evaluator.patches

    # the first prism stands on the wall with a side, the other touches it with an edge
    search = CoreSearch(parallel, patch, least, False)
    search.limits[:] = least
    vertices = patch.shape.vertices
    on_side = heights(patch.shape, vertices) == 0
    for row in range(len(patch)):
        on_wall = np.abs(positions(patch, np.full(len(vertices), row), vertices)[:, 2]) < 1e-12
        search.walls[row] = (on_wall[:, None] | ~on_side).all(axis=0)
    assert search.walls.sum(axis=1).tolist() == [1, 0]

    origin, jacobians = positions_and_jacobians(patch, np.array([0]), np.zeros((1, 3)))
    tracing = CoreTracing(search, 0.1)
    for height in (0.012, 0.2, 0.283, 0.28575, 0.289, 0.45):
        start = axis.place + (height - axis.place[2]) / axis.direction[2] * axis.direction
        xi = np.linalg.solve(jacobians[0], start - origin[0])
        (arc,) = tracing.run(np.array([0]), xi[None])
        ends = positions(patch, np.zeros(2, int), arc.xi[[0, -1]])
        assert axis.away(ends).max() < 1e-9
        assert ends[:, 2].min() == pytest.approx(0.01, abs=1e-9)
    assert tracing.failed == set()
