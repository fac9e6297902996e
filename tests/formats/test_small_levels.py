"""Level sets that are small or near to each other: the stated error is at least the true one, against closed forms."""

from itertools import product
from math import pi

import numpy as np
import pytest

from elvis.core.data.dataset import Dataset
from elvis.core.integrals import integrate
from elvis.core.shapes import Shape
from elvis.core.testing import grid, with_field

SOLIDS = [shape for shape in Shape if shape.dimension == 3]
#: rounding of a true value
ROUNDING = 4e-16


def is_covered(found, truth):
    """Whether an integral differs from the truth by no more than its error."""
    return abs(found.value - truth) <= found.error + ROUNDING * abs(truth)


@pytest.mark.sampled(least=2, free=("distance",))
@pytest.mark.parametrize("distance", [1e-2, 1e-4, 1e-6, 1e-7])
def test_two_close_surfaces(distance):
    """The planes z = 0.5 +- distance / 2: sheets that rounding can't tell apart are in the error as a whole."""
    dataset, level = Dataset(grid(Shape.HEXAHEDRON, 1)), f"(z-0.5)^2={distance**2 / 4!r}"
    area = integrate(dataset, "area", over=level)[0]
    between = integrate(dataset, "volume", clip=f"outside:{level}")[0]
    assert is_covered(area, 2.0)
    assert is_covered(between, distance)
    if distance > 1e-7:
        assert area.error < 1e-2
        assert between.error < 0.2 * distance


@pytest.mark.sampled(least=2, free=("radius",))
@pytest.mark.parametrize("radius", [0.05, 0.02, 0.01, 0.003, 0.001])
def test_small_spheres_about_an_edge_of_tetrahedra(radius):
    """Several tetrahedra share the edge through the centre, and each has a part of the sphere with many ends."""
    dataset, sphere = Dataset(grid(Shape.TETRAHEDRON, 1)), f"sphere:0.5,0.5,0.5:{radius!r}"
    area = integrate(dataset, "area", over=sphere, error=1e-6)[0]
    volume = integrate(dataset, "volume", clip=f"outside:{sphere}", error=1e-6)[0]
    assert is_covered(area, 4 * pi * radius**2)
    assert is_covered(volume, 4 / 3 * pi * radius**3)
    assert area.error < 1e-4 * area.value


def corner(normal, height, power):
    """The integral over s < height of max(height - n.c, 0)^power with the signs of the cube's corners c."""
    signs = [(-1) ** sum(c) * max(height - np.dot(normal, c), 0.0) ** power for c in product((0, 1), repeat=3)]
    return sum(signs) / (power * (power - 1) * np.prod(normal))


@pytest.mark.sampled(least=4)
@pytest.mark.parametrize("shape", SOLIDS)
@pytest.mark.parametrize("seed", range(8))
def test_planes_of_any_direction(shape, seed):
    """Area and volume of a half of the cube: Barrow and Smith 1979, Spline notation applied to a volume problem."""
    random = np.random.default_rng(seed)
    normal = np.round(random.uniform(0.05, 1, 3), 3)
    height = round(float(random.uniform(0.2, 0.8) * normal.sum()), 3)
    level = f"{normal[0]:g}*x + {normal[1]:g}*y + {normal[2]:g}*z={height!r}"
    dataset = Dataset(grid(shape, 1 + seed % 2))
    area = integrate(dataset, "area", over=level)[0]
    volume = integrate(dataset, "volume", clip=f"outside:{level}")[0]
    tolerance = 1e-14 / np.prod(normal)  # of the closed forms, whose terms cancel
    assert abs(area.value - corner(normal, height, 2) * np.linalg.norm(normal)) <= area.error + tolerance
    assert abs(volume.value - corner(normal, height, 3)) <= volume.error + tolerance


@pytest.mark.parametrize("normal", [(0.3, 0.7, 0.9), (1.0, 0.2, 0.25)])
def test_planes_through_the_apexes_of_pyramids(normal):
    """Six pyramids meet at the middle of the cube, where the map of each is singular."""
    height = 0.5 * sum(normal)
    dataset = with_field(grid(Shape.PYRAMID, 1), lambda points: points[:, 0], 3)
    level = f"{normal[0]}*u + {normal[1]}*y + {normal[2]}*z={height!r}"
    area = integrate(dataset, "1", over=level, error=1e-3)[0]
    volume = integrate(dataset, "1", clip=f"outside:{level}", error=1e-3)[0]
    tolerance = 1e-13 / np.prod(normal)
    assert abs(area.value - corner(normal, height, 2) * np.linalg.norm(normal)) <= area.error + tolerance
    assert abs(volume.value - corner(normal, height, 3)) <= volume.error + tolerance


#: levels that coincide with sides of elements: of a mesh with so many cells a row, the area, and the integral of nx
SIDES = {
    "x=0": (2, 1.0, 1.0),
    "x=1": (2, 1.0, 1.0),
    "-x=0": (2, 1.0, -1.0),
    "x=0.5": (2, 1.0, 1.0),
    "x*(0.5-x)=0": (2, 2.0, 0.0),
    "x*(1-x)=0": (1, 2.0, 0.0),
}


@pytest.mark.sampled(least=4)
@pytest.mark.parametrize("level", SIDES)
@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1])
def test_levels_on_sides_count_once(shape, level):
    """On the outer boundary as inside of the mesh, whatever the sign of the expression next to it."""
    cells, area, flux = SIDES[level]
    found = integrate(Dataset(grid(shape, cells)), ["1", "nx"], over=level, error=1e-3)
    assert is_covered(found.of("1"), area)
    assert is_covered(found.of("nx"), flux)
    assert found.of("1").error < 1e-3


@pytest.mark.parametrize("level", ["x^2=0", "(x-0.5)^2=0", "x*(y-0.3)=0"])
def test_undecided_levels_on_sides_are_part_of_the_error(level):
    """Zeros of second order are no borders of parts; where signs change along a side, a part of it is in no element."""
    truth = 2.0 if "y" in level else 1.0
    (area,) = integrate(Dataset(grid(Shape.QUADRILATERAL, 2)), "area", over=level, error=1e-3)
    assert is_covered(area, truth)
