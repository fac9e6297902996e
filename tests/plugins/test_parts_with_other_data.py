"""Ranks read their parts of other data, too, which expressions name, where these hold the same elements."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, Shape, write
from elvis.core.numbers.norms import quantity_norms
from elvis.core.portions import unite
from elvis.core.portions.borrowing import borrowing
from elvis.core.quantities import Expression
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple
from elvis.core.testing.played_ranks import played
from elvis.plugins.data.data import Reading, open_data, open_part


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """All shapes, curved; the same with a field of another order, and with other numbers; other elements."""
    path = tmp_path_factory.mktemp("beside")
    mesh = curved(mixed_volume(), ripple(0.05), 3)
    entities = {shape: replace(own, ids=own.ids + 7) for shape, own in mesh.entities.items()}
    renamed = replace(mesh, entities=entities, composites=(), domains={})
    meshes = {"a": mesh, "same": mesh, "renamed": renamed, "other": grid(Shape.HEXAHEDRON, 3)}
    for order, (name, own) in enumerate(meshes.items(), 2):
        field = approximated(Dataset(own), "u", lambda p: p[:, 0] * np.sin(p[:, 1] + p[:, 2]), order)
        write(Dataset(own, (field,)), path / f"{name}.xml", path / f"{name}.fld")
    return path


@pytest.mark.thorough
@pytest.mark.sampled
@pytest.mark.parametrize("size", [2, 30])
@pytest.mark.parametrize("other", ["same", "renamed", "other"])
def test_differences_in_parts_match_those_of_one_process(folder, other, size):
    """With ranks that have no elements, too; in other elements values are found with all of them alone."""
    files = [folder / "a.xml", folder / "a.fld"]
    reading = Reading(others=(f"ref={folder / other}.xml,{folder / other}.fld",))

    def found(ranks):
        part = open_part(files, replace(reading, ranks=ranks), str)
        expression = Expression.of(part.dataset, "u - ref:u")
        assert expression.is_local == (other != "other") == bool(part.dataset.shared)
        # of the other, too, no more is there than a part
        assert part.dataset.others["ref"].mesh.excerpt is not None
        borrowed = borrowing(part, ["u - ref:u"], ranks)
        assert list(borrowed.dataset) == ["u"]
        return borrowed.alone, quantity_norms(part.dataset, [expression], ranks) if expression.is_local else {}

    every = played(size, found)
    first, *others = (norms for _, norms in every)
    assert not any(others)
    whole = open_data(files, reading)
    if other == "other":
        return
    assert first == quantity_norms(whole, [Expression.of(whole, "u - ref:u")])
    assert first["u - ref:u"].l2 > 0
    united = unite([part for part, _ in every]).dataset.field("ref:u")
    blocks = [block for block in united.blocks if len(block)]
    for own, wanted in zip(blocks, whole.field("ref:u").blocks, strict=True):
        assert own.expansion == wanted.expansion
        assert np.array_equal(own.element_ids, wanted.element_ids)
        assert own.coefficients.tobytes() == wanted.coefficients.tobytes()
