"""Critical points of walls that ranks find in their parts are those of one process, to the last digit."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.critical import wall_points as wall_points_module
from elvis.core.critical.wall_points import is_outer_wall, shared_wall_points, wall_points
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import Composite
from elvis.core.portions import Portion
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid, mixed_volume
from elvis.core.testing.played_ranks import played


def on_floor(mesh, speed=0.0):
    """A flow over the sides of which all vertices lie low, with several zeros of its shear, some on edges.

    speed  of the floor, in one corner
    """
    height = mesh.vertices[:, 2]
    sides = [shape for shape in (Shape.TRIANGLE, Shape.QUADRILATERAL) if len(mesh.of(shape))]
    parts = []
    for shape in sides:
        edges = mesh.of(Shape.SEGMENT).members[mesh.of(shape).members]
        parts.append(("F", mesh.of(shape).ids[(height[edges] == 0).all(axis=(1, 2))]))
    mesh = replace(mesh, composites=(*mesh.composites, Composite(77, tuple(parts), "floor")))
    bare = Dataset(mesh)
    functions = (
        lambda p: p[:, 2] * (p[:, 0] - 0.5) * (p[:, 0] - 0.2) + speed * np.maximum(0, p[:, 0] - 0.6),
        lambda p: p[:, 2] * (p[:, 1] * (p[:, 1] - 0.5) + 0.1 * (p[:, 0] - 0.5)),
        lambda p: p[:, 2] ** 2,
    )
    return replace(bare, fields=tuple(approximated(bare, *own, 4) for own in zip("uvw", functions, strict=True)))


def shared(dataset, size, wall="floor"):
    def found(ranks):
        return shared_wall_points(Portion.of_whole(dataset, ranks.rank, size), wall, None, ranks)

    return played(size, found)


@pytest.mark.parametrize("shape", [*Shape.of_dimension(3), None], ids=str)
@pytest.mark.parametrize("size", [2, 3, 8])
@pytest.mark.sampled(least=5)
def test_points_on_walls_of_parts_match_those_of_the_whole(shape, size, monkeypatch):
    """Also where some parts have no face of the wall, and few are examined together."""
    dataset = on_floor(mixed_volume() if shape is None else grid(shape, 2))
    whole = wall_points(dataset, "floor")
    monkeypatch.setattr(wall_points_module, "_CHUNK", 3)
    found, *others = shared(dataset, size)
    assert len(found) > 1
    assert repr(found.facts()) == repr(whole.facts())
    assert not any(others)


def test_lines_of_zeros_are_undecided_in_the_same_elements():
    dataset = on_floor(grid(Shape.PRISM, 2))
    lines = [lambda p: p[:, 2] * (p[:, 0] - 0.47), lambda p: p[:, 2] * (0.47 - p[:, 0])]
    fields = [approximated(Dataset(dataset.mesh), *own, 4) for own in zip("uv", lines, strict=True)]
    dataset = replace(dataset, fields=(*fields, dataset["w"]))
    whole = wall_points(dataset, "floor")
    assert whole.undecided
    assert shared(dataset, 5)[0].facts() == whole.facts()


def test_a_wall_that_moves_in_one_part_is_rejected_on_all_ranks():
    """Its speed is small next to what the velocity grows to elsewhere, and great next to that in its own elements."""
    for speed, is_refused in ((1e-3, True), (1e-12, False)):
        dataset = on_floor(grid(Shape.HEXAHEDRON, 3), speed)
        if not is_refused:
            assert repr(shared(dataset, 5)[0].facts()) == repr(wall_points(dataset, "floor").facts())
            continue
        with pytest.raises(ElvisError, match="zero on the wall floor, found") as alone:
            wall_points(dataset, "floor")
        with pytest.raises(ElvisError) as together:
            shared(dataset, 5)
        assert str(together.value) == str(alone.value)


def test_walls_inside_the_data_are_not_outer_walls():
    dataset = on_floor(grid(Shape.HEXAHEDRON, 2))
    mesh = dataset.mesh
    every = Composite(78, (("F", mesh.of(Shape.QUADRILATERAL).ids),), "faces")
    part = Portion.of_whole(replace(dataset, mesh=replace(mesh, composites=(*mesh.composites, every))), 0, 2).dataset
    assert all(is_outer_wall(part, name) for name in ("floor", "77", "all"))
    assert not any(is_outer_wall(part, name) for name in ("faces", "nothing"))


def test_only_boundaries_are_walls():
    with pytest.raises(ElvisError, match="expected a wall, the name or id of a boundary, found domain"):
        wall_points(on_floor(grid(Shape.HEXAHEDRON, 1)), "domain")
