"""Meshes that break the rules of the format: each is told, by element and by fact."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.core.base.arrays import frozen_ints
from elvis.core.base.errors import FormatError
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import Curves, Entities
from elvis.core.mapping.connectivity import connected
from elvis.core.mapping.geometry import geometry
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, mixed_plane, one_element, ripple


def broken(mesh, shape, row, members):
    entities = mesh.of(shape)
    changed = np.array(entities.members)
    changed[row] = members
    return replace(mesh, entities={**mesh.entities, shape: Entities(entities.ids, frozen_ints(changed))})


def with_ids_from(mesh, shape, first):
    entities = mesh.of(shape)
    moved = Entities(frozen_ints(first + np.arange(len(entities))), entities.members)
    return replace(mesh, entities={**mesh.entities, shape: moved}, domains={})


def test_edges_that_do_not_form_a_polygon():
    mesh = with_ids_from(mixed_plane(), Shape.TRIANGLE, 100)
    edges = mesh.of(Shape.TRIANGLE).members[1]
    with pytest.raises(FormatError, match="triangle 101: expected edges that form a closed polygon, found edges from"):
        geometry(Dataset(broken(mesh, Shape.TRIANGLE, 1, [edges[0], edges[1], edges[1]])))
    quad = mesh.of(Shape.QUADRILATERAL).members[0]
    with pytest.raises(FormatError, match="quadrilateral 2: expected edges that form a closed polygon"):
        geometry(Dataset(broken(mesh, Shape.QUADRILATERAL, 0, quad[[0, 2, 1, 3]])))


@pytest.mark.parametrize("shape", Shape.of_dimension(3))
def test_faces_that_do_not_form_a_solid(shape):
    mesh = with_ids_from(grid(shape, 2), shape, 40)
    faces = mesh.of(shape).members
    other = next(row for row in faces if not set(row) & set(faces[2]))
    with pytest.raises(FormatError, match=f"{shape.label.lower()} 42: expected (faces that share one|local face)"):
        geometry(Dataset(broken(mesh, shape, 2, [*faces[2, :-1], other[-1]])))
    with pytest.raises(FormatError, match=f"{shape.label.lower()} 42: expected"):
        geometry(Dataset(broken(mesh, shape, 2, [*faces[2, :-1], faces[2, -2]])))


@pytest.mark.parametrize("shape", [Shape.PRISM, Shape.PYRAMID])
def test_faces_of_the_wrong_kind(shape):
    mesh = grid(shape, 1)
    faces = mesh.of(shape).members[1]
    with pytest.raises(FormatError, match="1: expected a quadrilateral as local face 0, found a triangle"):
        geometry(Dataset(broken(mesh, shape, 1, [faces[1], *faces[1:]])))
    with pytest.raises(FormatError, match="1: expected a triangle as local face 1, found a quadrilateral"):
        geometry(Dataset(broken(mesh, shape, 1, [faces[0], faces[0], *faces[2:]])))


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PRISM, Shape.PYRAMID])
def test_triangles_collapsed_at_other_vertices(shape):
    mesh = with_ids_from(one_element(shape), shape, 7)
    last = mesh.of(shape).members[0, 1]
    turned = broken(mesh, Shape.TRIANGLE, last, np.roll(mesh.of(Shape.TRIANGLE).members[last], 1))
    expected = f"{shape.label.lower()} 7: expected local face 1 to be collapsed at local vertex"
    with pytest.raises(FormatError, match=expected):
        geometry(Dataset(turned))


def bent(mesh, **changes):
    """A mesh curved with three nodes, its face or edge curves changed."""
    done = curved(mesh, ripple(0.1), 3)
    name = next(iter(changes))
    return replace(done, **{name: replace(getattr(done, name), **changes[name])})


def test_a_curved_face_needs_curved_edges():
    mesh = replace(curved(mixed_plane(), ripple(0.1), 3), edge_curves=Curves.none())
    with pytest.raises(FormatError, match="triangle 0: expected edges curved with 3 nodes each, as the face is, found"):
        geometry(Dataset(mesh))


def test_curves_of_unknown_kinds_and_counts():
    mesh = mixed_plane()
    edges = len(mesh.of(Shape.SEGMENT))
    cases = [
        (
            bent(mesh, edge_curves={"kinds": frozen_ints(np.full(edges, 77))}),
            "segment 0: expected the number of a family",
        ),
        (
            bent(mesh, edge_curves={"kinds": frozen_ints(np.full(edges, 22))}),
            "curve of segment 0: expected nodes for a segment",
        ),
        (bent(mesh, edge_curves={"kinds": frozen_ints(np.full(edges, 20))}), "curve of segment 0: expected a one-dim"),
        (bent(mesh, face_curves={"kinds": frozen_ints(np.full(4, 24))}), "curve of quadrilateral 2: expected"),
        (bent(mesh, face_curves={"kinds": frozen_ints(np.full(4, 4))}), "curve of triangle 0: expected a number of"),
    ]
    for case, message in cases:
        with pytest.raises(FormatError, match=message):
            geometry(Dataset(case))


def test_absurd_orders_are_rejected_at_once():
    mesh = mixed_plane()
    count = 1 << 20
    curve = Curves(frozen_ints([0]), frozen_ints([17]), frozen_ints([0, count]), np.zeros((count, 3)))
    with pytest.raises(FormatError, match="of order up to 63, found 1048576"):
        geometry(Dataset(replace(mesh, edge_curves=curve)))
    with pytest.raises(FormatError, match="of order up to 63, found 1048576"):
        geometry(Dataset(replace(mesh, face_curves=curve)))


def test_connected_numbers_everything_once():
    mesh = connected(np.eye(3), {Shape.TRIANGLE: np.array([[0, 1, 2]])})
    assert (len(mesh.of(Shape.SEGMENT)), len(mesh.of(Shape.TRIANGLE)), mesh.space) == (3, 1, 3)
