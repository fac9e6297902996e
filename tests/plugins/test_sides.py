"""Sides found by the numbers of their vertices: the same as by looking at every side, and sorted once."""

import numpy as np
import pytest

from elvis.core.data.mesh import Mesh
from elvis.core.mapping.orientation import first_face_row, polygon_vertices
from elvis.core.shapes import Shape
from elvis.core.testing import grid, mixed_plane, mixed_volume
from elvis.plugins.conversion.converting import convert
from elvis.plugins.conversion.plugin import Boundary
from elvis.plugins.projection import sides
from elvis.plugins.projection.sides import Sides
from elvis.plugins.testing import Analytic

MESHES = {"volume": lambda: mixed_volume(2), "plane": mixed_plane, "line": lambda: grid(Shape.SEGMENT, 4)}


def own_sides(mesh: Mesh):
    """Pairs of a side's vertices and its row, one after another."""
    if mesh.dimension == 1:
        return [((i,), i) for i in range(len(mesh.vertices))]
    if mesh.dimension == 2:
        return [(tuple(own), i) for i, own in enumerate(mesh.of(Shape.SEGMENT).members.tolist())]
    found = []
    for kind in (Shape.TRIANGLE, Shape.QUADRILATERAL):
        rows = polygon_vertices(mesh, kind).tolist()
        found += [(tuple(own), first_face_row(mesh, kind) + i) for i, own in enumerate(rows)]
    return found


@pytest.mark.parametrize("name", MESHES)
def test_sides_are_found_in_any_order_of_their_vertices(name):
    mesh, rng = MESHES[name](), np.random.default_rng(1)
    numbers = rng.permutation(10 * len(mesh.vertices))[: len(mesh.vertices)] * 10**9
    known = Sides(mesh, numbers)
    for corners in {len(own) for own, _ in own_sides(mesh)}:
        some = [(own, row) for own, row in own_sides(mesh) if len(own) == corners]
        chosen = [some[i] for i in rng.choice(len(some), max(1, len(some) // 2), replace=False)]
        wanted = np.array([rng.permutation(numbers[list(own)]) for own, _ in chosen])
        rows, lost = known.matched(np.concatenate([wanted, wanted[:1]]))
        assert rows.tolist() == sorted(row for _, row in chosen)
        assert lost == 0


@pytest.mark.parametrize("strange", [-5, 3, 10**15])
def test_vertex_lists_that_are_not_sides_are_counted(strange):
    mesh = mixed_volume(2)
    numbers = 7 * np.arange(len(mesh.vertices))
    real = numbers[polygon_vertices(mesh, Shape.TRIANGLE)[:2]]
    wrong = real.copy()
    wrong[:, 1] = strange
    apart = numbers[[[0, 1, len(numbers) - 1]]]  # vertices that are there, of no side
    rows, lost = Sides(mesh, numbers).matched(np.concatenate([wrong, real, apart]))
    assert rows.tolist() == [first_face_row(mesh, Shape.TRIANGLE), first_face_row(mesh, Shape.TRIANGLE) + 1]
    assert lost == 3


def test_two_sides_with_the_same_numbers_are_both_found():
    mesh = grid(Shape.SEGMENT, 4)
    rows, lost = Sides(mesh, np.array([4, 4, 2, 9, 2])).matched(np.array([[2], [4], [8]]))
    assert rows.tolist() == [0, 1, 2, 4]
    assert lost == 1


@pytest.mark.parametrize("count", [1, 40])
def test_many_boundaries_sort_the_sides_once(monkeypatch, count):
    asked = []
    monkeypatch.setattr(sides, "polygon_vertices", lambda *args: asked.append(1) or polygon_vertices(*args))
    source = Analytic(grid(Shape.TETRAHEDRON, 2), {})
    faces = np.asarray(source.blocks[0].vertices)[:, [0, 1, 2]]
    source.boundaries = [Boundary(f"part {i}", vertices=[faces[i : i + 1]]) for i in range(count)]
    names = {composite.name for composite in convert(source).dataset.mesh.composites}
    assert {boundary.name for boundary in source.boundaries} <= names
    assert len(asked) == 1
