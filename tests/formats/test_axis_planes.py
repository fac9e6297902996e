"""Planes across an axis by their short names: at a coordinate, and through the middle of the data."""

import numpy as np
import pytest

from elvis import integrate
from elvis.core.data.axis_planes import box_of, is_across_axis, needs_box, point_and_normal, with_normals
from elvis.core.data.dataset import Dataset
from elvis.core.integrals import comes_apart
from elvis.core.mapping.locate import Locator
from elvis.core.mapping.patch import patches
from elvis.core.portions import portions
from elvis.core.shapes import Shape
from elvis.core.streamlines.seeds import SeedPlaces, seed_points
from elvis.core.testing import grid
from elvis.core.testing.played_ranks import played


@pytest.fixture(scope="module")
def column():
    """Four cells in x and y, of which the upper ones are removed: the box is not the unit cube."""
    whole = Dataset(grid(Shape.HEXAHEDRON, 2))
    (cells,) = patches(whole)
    return portions(whole, [cells.element_ids[:4]])[0].dataset


def corners():
    return np.array([[0.0, 1.0, -3.0], [1.0, 5.0, 3.5]])


@pytest.mark.parametrize(
    ("text", "whole"),
    [
        ("z", "0,0,0.25:0,0,1"),
        (" y :20", "0,3.0,0:0,1,0:20"),
        ("x=0.2", "0.2,0,0:1,0,0"),
        ("0,0,1:0,0,1", "0,0,1:0,0,1"),
        ("zeta", "zeta"),
    ],
)
def test_texts_are_written_with_points_and_normals(text, whole):
    assert point_and_normal(text, corners) == whole
    assert with_normals(f"plane:{text}", corners) == with_normals(f"middle:{text}", corners) == f"plane:{whole}"
    assert with_normals(f"sphere:{text}", corners) == f"sphere:{text}"
    assert is_across_axis(text) == (text != whole)
    # no box is needed for a coordinate, and none is asked for
    assert point_and_normal(text) == (whole if "=" in text else text)


def test_planes_through_the_middle_are_those_of_the_box(column):
    low, high = box_of(column)
    middle = (low + high) / 2
    for axis, name in enumerate("xyz"):
        size = np.delete(high - low, axis).prod()
        for over in (name, f"plane:{name}", f"middle:{name}"):
            (area,) = integrate(column, "area", over)
            assert area.value == pytest.approx(size, rel=1e-12)
            (coordinate,) = integrate(column, f"average({name})", over)
            assert coordinate.value == pytest.approx(middle[axis], abs=1e-13)
        for clip in (name, f"outside:plane:{name}"):
            (volume,) = integrate(column, "volume", clip=clip)
            assert volume.value == pytest.approx((high - low).prod() / 2, rel=1e-12)
        seeds = seed_points(SeedPlaces.of(column, Locator(patches(column))), f"plane:{name}:4")
        assert np.abs(seeds[:, axis] - middle[axis]).max() == 0


def test_ranks_with_parts_do_not_take_the_middle_of_their_part():
    dataset = Dataset(grid(Shape.HEXAHEDRON, 2))
    ids = dataset.mesh.domain_ids()

    def apart(ranks):
        part = portions(dataset, [ids[:3], ids[3:]])[ranks.rank].dataset
        names = ["plane:z=0.5", "plane:z", "z"]
        found = [comes_apart(part, ["area"], [name], ranks=ranks) for name in names]
        return [*found, comes_apart(part, ["volume"], ["domain"], clip="outside:plane:x", ranks=ranks)]

    assert played(2, apart) == [[True, False, False, False]] * 2
    assert needs_box("section:wing:plane:y")
    assert not needs_box("plane:0,0,1:0,0,1")
