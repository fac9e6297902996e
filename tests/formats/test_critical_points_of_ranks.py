"""Critical points that ranks find in their parts are those of one process, to the last digit."""

from dataclasses import replace

import pytest

from elvis.core.critical.points import critical_points, shared_critical_points
from elvis.core.data.dataset import Dataset
from elvis.core.portions import Portion, portions
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid, mixed_volume
from elvis.core.testing.played_ranks import played


def at_vertices(mesh):
    """A velocity with zeros inside of elements, at vertices and along edges, and on the outer boundary."""
    bare = Dataset(mesh)
    parts = (
        lambda p: (p[:, 0] - 0.5) * (p[:, 0] - 0.21),
        lambda p: p[:, 1] * (p[:, 1] - 0.5) + 0.1 * (p[:, 0] - 0.5),
        lambda p: (p[:, 2] - 0.1) * (p[:, 2] - 0.6) + 0.2 * (p[:, 0] - 0.5),
    )
    names = zip("uvw", parts[: mesh.dimension], strict=False)
    return replace(bare, fields=tuple(approximated(bare, name, own, 3) for name, own in names))


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL, Shape.TETRAHEDRON, Shape.PYRAMID, None])
@pytest.mark.parametrize("size", [2, 3, 8])
@pytest.mark.sampled(least=5)
def test_critical_points_of_parts_match_those_of_the_whole(shape, size):
    """Zeros on sides between parts are found once."""
    dataset = at_vertices(mixed_volume() if shape is None else grid(shape, 2))
    whole = critical_points(dataset)

    def shared(ranks):
        return shared_critical_points(Portion.of_whole(dataset, ranks.rank, ranks.size), None, ranks)

    found, *others = played(size, shared)
    assert len(found) > 1
    assert repr(found.facts()) == repr(whole.facts())
    assert not any(others)


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.PRISM])
def test_points_on_the_outer_boundary_are_skipped_by_every_rank(shape):
    """Of parts of an element each some touch the boundary with a vertex or an edge alone, where there is a zero."""
    dataset = at_vertices(grid(shape, 2))
    ids = dataset.mesh.of(shape).ids
    parts = portions(dataset, list(ids[:, None]))
    found = played(len(parts), lambda ranks: shared_critical_points(parts[ranks.rank], None, ranks))[0]
    assert repr(found.facts()) == repr(critical_points(dataset).facts())


def test_lines_of_zeros_are_undecided_in_the_same_elements():
    bare = Dataset(grid(Shape.QUADRILATERAL, 4))
    parts = (lambda p: p[:, 0] - 0.47, lambda p: 0.47 - p[:, 0])
    names = zip("uv", parts, strict=True)
    dataset = replace(bare, fields=tuple(approximated(bare, name, own, 2) for name, own in names))

    def shared(ranks):
        return shared_critical_points(Portion.of_whole(dataset, ranks.rank, ranks.size), None, ranks)

    found = played(5, shared)[0]
    assert found.undecided
    assert found.facts() == critical_points(dataset).facts()
