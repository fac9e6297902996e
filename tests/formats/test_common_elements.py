"""Elements that two meshes have in common: other ids, order and orientation, all shapes; some alike, others not."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.core.data.dataset import Dataset
from elvis.core.differences import diff
from elvis.core.differences.common_elements import common_elements
from elvis.core.mapping.connectivity import connected
from elvis.core.numbers.sampling import sample
from elvis.core.shapes import Shape
from elvis.core.testing import curved, mixed_plane, mixed_volume, ripple, scattered, with_field


def quadratic(points):
    return points[:, 0] ** 2 - points[:, 1] * points[:, 2]


def shifted(points):
    """By x / 4, whose norms on [0, 3] x [0, 1]^k are 9/8 and 3/4."""
    return quadratic(points) + points[:, 0] / 4


def renumbered(dataset):
    """The same with other ids of elements, in another order in the file."""
    entities = dict(dataset.mesh.entities)
    for shape, own in dataset.mesh.elements.items():
        entities[shape] = replace(own, ids=own.ids[::-1] + 100)
    top = {shape: own.ids for shape, own in dataset.mesh.elements.items()}
    fields = []
    for field in dataset.fields:
        blocks = []
        for block in field.blocks:
            new = dict(zip(top[block.expansion.shape], entities[block.expansion.shape].ids, strict=True))
            blocks.append(replace(block, element_ids=np.array([new[own] for own in block.element_ids])))
        fields.append(replace(field, blocks=tuple(blocks)))
    mesh = replace(dataset.mesh, entities=entities, composites=(), domains={})
    return replace(dataset, mesh=mesh, fields=tuple(fields))


@pytest.mark.sampled
@pytest.mark.parametrize("bend", [None, ripple(0.03)], ids=["straight", "curved"])
@pytest.mark.parametrize("seed", [1, 2])
def test_turned_and_renumbered_elements_are_found(seed, bend):
    """All shapes: the difference is taken by coefficients, its maximum x / 4 is proved."""
    meshes = [mixed_volume(), mixed_volume(seed)]
    if bend is not None:
        meshes = [curved(mesh, bend, 4) for mesh in meshes]
    own, other = with_field(meshes[0], quadratic, 4), renumbered(with_field(meshes[1], shifted, 4))
    common = common_elements(own, other)
    assert common.is_whole
    assert common.apart < 1e-14
    assert len(common.symmetries) > 1

    found = diff(own, other)
    assert found.is_same_mesh
    assert found[0].linf == pytest.approx(found[0].where[0] / 4, abs=1e-12)
    assert found[0].linf <= found[0].bound < found[0].linf + 1e-11
    points = own.mesh.vertices.mean(axis=0) + 0.2 * scattered(Shape.HEXAHEDRON, 5)
    values = sample(own.with_others(ref=other), ["ref:u - u", "d(ref:u - u, x)"], points).values
    np.testing.assert_allclose(values, [(p[0] / 4, 0.25) for p in points], atol=1e-12)


def test_only_equal_elements_are_common():
    """One of two quadrilaterals is two triangles in the second mesh: it alone is located in."""
    plane = mixed_plane()
    rows = {Shape.QUADRILATERAL: [[5, 4, 0, 1]], Shape.TRIANGLE: [[2, 6, 1], [6, 5, 1], [2, 3, 7], [2, 7, 6]]}
    other = connected(plane.vertices, {shape: np.array(own) for shape, own in rows.items()}, 2)
    first, second = with_field(plane, quadratic, 3), with_field(other, shifted, 3)
    assert len(common_elements(first, second)) == 3
    found = diff(first, second)
    assert not found.is_same_mesh
    assert (found[0].l1, found[0].l2) == pytest.approx((9 / 8, 3 / 4), rel=1e-10)
    assert found[0].covered == pytest.approx(1, abs=1e-12)
    assert found[0].where[0] == pytest.approx(3, abs=1e-12)


def test_maps_that_differ_by_rounding_are_reported():
    """In one coordinate; by more they are not the same."""
    own = with_field(mixed_volume(), quadratic, 3)
    for shift, is_same in ((1e-12, True), (1e-9, False)):
        mesh = replace(own.mesh, vertices=own.mesh.vertices + shift * np.eye(3)[0])
        common = common_elements(own, Dataset(mesh, own.fields))
        assert common.is_whole == is_same
        if is_same:
            assert common.apart == pytest.approx(shift / 3, rel=1e-2)
            apart = "their maps differ by up to 3e-13 of the coordinates"
            words = f"elements of both meshes count as the same, although {apart}"
            assert diff(own, Dataset(mesh, own.fields)).remarks == (words,)
