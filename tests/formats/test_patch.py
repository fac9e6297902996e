"""Patches: which elements go together, maps given as fields, and what is copied."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from element_maps import by_element

from elvis.core.base.arrays import frozen_ints
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.data.dataset import Block, Dataset, Field
from elvis.core.data.mesh import Curves
from elvis.core.mapping.geometry import geometry
from elvis.core.mapping.patch import patches
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple


def test_straight_and_curved_elements_form_separate_patches():
    mesh = grid(Shape.TETRAHEDRON, 2)
    bent = curved(mesh, ripple(0.1), 3)
    some = np.flatnonzero((mesh.vertices[mesh.of(Shape.SEGMENT).members] == 0).all(axis=1)[:, 0])
    assert 0 < len(some) < len(mesh.of(Shape.SEGMENT))
    edges = bent.edge_curves
    points = edges.points.reshape(-1, 3, 3)[some].reshape(-1, 3)
    few = Curves(frozen_ints(some), edges.kinds[some], frozen_ints(3 * np.arange(len(some) + 1)), points)
    blocks = geometry(Dataset(replace(mesh, edge_curves=few)))
    assert [b.expansion.modes for b in blocks] == [(2, 2, 2), (3, 3, 3)]
    np.testing.assert_array_equal(np.sort(np.concatenate([b.element_ids for b in blocks])), mesh.domain_ids())
    straight = by_element(mesh)
    for id, coefficients in zip(blocks[0].element_ids, blocks[0].coefficients, strict=True):
        np.testing.assert_array_equal(coefficients, straight[id][1])


def test_only_elements_of_the_domain_count():
    mesh = mixed_volume()
    tetrahedra = replace(mesh, domains={0: (0,)})
    (block,) = geometry(Dataset(tetrahedra))
    assert block.expansion.shape is Shape.TETRAHEDRON
    np.testing.assert_array_equal(block.element_ids, mesh.of(Shape.TETRAHEDRON).ids)


def test_fields_can_be_the_map():
    mesh = curved(mixed_volume(), ripple(0.2), 3)
    columns = {f"map_{axis}": i for i, axis in enumerate("xyz")}
    plain = Dataset(mesh)
    fields = tuple(approximated(plain, name, lambda x, i=i: x[:, i] ** 2, 4) for name, i in columns.items())
    chosen = tuple(replace(f, blocks=tuple(b for b in f.blocks if len(b) != 1)) for f in fields)
    mapped = geometry(Dataset(mesh, chosen, metadata={"GeometryMap": "map_x, map_y,map_z"}))
    kept = [b for b in mapped if b.expansion.shape is Shape.HEXAHEDRON]
    assert len(kept) == 1
    assert kept[0].expansion.modes == (3, 3, 3)
    for block in mapped:
        if block is not kept[0]:
            assert max(block.expansion.modes) == 4
            for i, field in enumerate(chosen):
                (own,) = (b for b in field.blocks if b.expansion.shape is block.expansion.shape)
                np.testing.assert_array_equal(block.element_ids, own.element_ids)
                np.testing.assert_array_equal(block.coefficients[:, i], own.coefficients)
    default = geometry(Dataset(mesh, chosen, metadata={"GeometryMap": ""}))
    assert [b.expansion for b in default] == [b.expansion for b in mapped]
    flat = geometry(Dataset(mesh, fields, metadata={"GeometryMap": "map_y"}))
    assert all(not b.coefficients[:, 1:].any() for b in flat)


def test_a_map_needs_its_fields():
    mesh = mixed_volume()
    fields = tuple(approximated(Dataset(mesh), f"map_{axis}", lambda x: x[:, 0], 3) for axis in "xyz")
    with pytest.raises(FormatError, match="map_x, map_y, map_z among u"):
        geometry(Dataset(mesh, (Field("u", ()),), metadata={"GeometryMap": ""}))
    less = replace(fields[2], blocks=fields[2].blocks[1:])
    with pytest.raises(FormatError, match="other expansions for element 0"):
        geometry(Dataset(mesh, (*fields[:2], less), metadata={"GeometryMap": ""}))


def test_patches_group_by_expansions_without_needless_copies():
    dataset = Dataset(curved(mixed_volume(), ripple(0.2), 3))
    whole = approximated(dataset, "u", lambda x: x[:, 0], 3)
    split = Field("v", tuple(part for block in whole.blocks for part in halves(block)))
    finer = approximated(dataset, "w", lambda x: x[:, 1], 4)
    partial = Field("w", finer.blocks[:2])
    found = patches(replace(dataset, fields=(whole, split, partial)), ["u", "v", "w"])
    assert [p.shape for p in found] == list(Shape.of_dimension(3))
    for patch, block, blocks in zip(found, whole.blocks, geometry(dataset), strict=True):
        assert patch.geometry == blocks.expansion
        np.testing.assert_array_equal(patch.geometry_coefficients, blocks.coefficients)
        assert np.shares_memory(patch.coefficients[0], block.coefficients)
        np.testing.assert_array_equal(patch.coefficients[1], block.coefficients)
        assert (patch.fields[2] is None) == (patch.shape not in (Shape.TETRAHEDRON, Shape.PYRAMID))
        assert (patch.coefficients[2] is None) == (patch.fields[2] is None)


def halves(block):
    """A block in two parts, the second one first and backwards."""
    middle = len(block) // 2
    rows = [np.arange(middle, len(block))[::-1], np.arange(middle)]
    return [Block(block.expansion, block.element_ids[r], block.coefficients[r]) for r in rows if len(r)]


def test_mismatched_patches_are_reported():
    dataset = Dataset(mixed_volume())
    field = approximated(dataset, "u", lambda x: x[:, 0], 3)
    with pytest.raises(ElvisError, match=r"\(u\), found p"):
        patches(replace(dataset, fields=(field,)), ["p"])
    tets, pyramids, *_ = field.blocks
    swapped = Field("u", (Block(pyramids.expansion, tets.element_ids, pyramids.coefficients[:3]),))
    with pytest.raises(FormatError, match="field u, element 0: expected a tetrahedron as in the mesh, found a pyramid"):
        patches(replace(dataset, fields=(swapped,)), ["u"])
    short = Field("u", (Block(tets.expansion, tets.element_ids, tets.coefficients[:, :5]),))
    with pytest.raises(FormatError, match="expected 10 coefficients for its bases and orders, found 5"):
        patches(replace(dataset, fields=(short,)), ["u"])


def test_straight_meshes_need_little_memory():
    mesh = grid(Shape.TETRAHEDRON, 24)
    tracemalloc.start()
    (block,) = geometry(Dataset(mesh))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3 * block.coefficients.nbytes + 3e7
