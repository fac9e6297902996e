"""Ranks read their parts of other data, too, which expressions name, where these hold the same elements."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.core.norms import quantity_norms
from elvis.core.portions import Portion
from elvis.core.quantities import Expression
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple
from elvis.core.testing.played_ranks import played
from elvis.formats import Dataset, Shape, write
from elvis.plugins.data import Reading, open_data, open_part


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """All shapes, bent; the same with a field of another order, and with other numbers; other elements."""
    path = tmp_path_factory.mktemp("beside")
    mesh = curved(mixed_volume(), ripple(0.05), 3)
    entities = {shape: replace(own, ids=own.ids + 7) for shape, own in mesh.entities.items()}
    renamed = replace(mesh, entities=entities, composites=(), domains={})
    meshes = {"a": mesh, "same": mesh, "renamed": renamed, "other": grid(Shape.HEXAHEDRON, 3)}
    for order, (name, own) in enumerate(meshes.items(), 2):
        field = approximated(Dataset(own), "u", lambda p: p[:, 0] * np.sin(p[:, 1] + p[:, 2]), order)
        write(Dataset(own, (field,)), path / f"{name}.xml", path / f"{name}.fld")
    return path


@pytest.mark.parametrize("size", [2, 30])
@pytest.mark.parametrize("other", ["same", "renamed", "other"])
def test_norms_of_differences_are_those_of_one_process(folder, other, size):
    """With ranks that have no elements, too; what holds other elements all read whole."""
    files = [folder / "a.xml", folder / "a.fld"]
    reading = Reading(others=(f"ref={folder / other}.xml,{folder / other}.fld",))

    def found(ranks):
        part = open_part(files, reading, str, ranks, divides_others=True)
        assert isinstance(part, Portion) == (other != "other")
        if isinstance(part, Dataset):
            return {}
        expression = Expression.of(part.dataset, "u - ref:u")
        assert expression.is_local
        # of the other no more is there than the same elements
        assert part.dataset.others["ref"].mesh.excerpt is not None
        return quantity_norms(part.dataset, [expression], ranks)

    first, *others = played(size, found)
    assert not any(others)
    if first:
        whole = open_data(files, reading)
        assert first == quantity_norms(whole, [Expression.of(whole, "u - ref:u")])
        assert first["u - ref:u"].l2 > 0


def test_pictures_have_others_whole(folder):
    """What is seen may be located in any of their elements."""
    reading = Reading(others=(f"ref={folder / 'same'}.xml,{folder / 'same'}.fld",))
    files = [folder / "a.xml", folder / "a.fld"]
    assert played(2, lambda ranks: isinstance(open_part(files, reading, str, ranks), Dataset)) == [True, True]
