"""Fields that quantities need: from these alone they are what they are from all."""

import pytest

from elvis import Dataset, Shape
from elvis.core.quantities import Expression
from elvis.core.quantities.needed import needed_fields
from elvis.core.testing import approximated, grid

COMPRESSIBLE = ("rho", "rhou", "rhov", "E", "c")


def dataset_of(names):
    bare = Dataset(grid(Shape.TRIANGLE, 1), metadata={"Gamma": "1.4"})
    return Dataset(bare.mesh, tuple(approximated(bare, name, lambda x: 1 + x[:, 0], 2) for name in names))


@pytest.mark.parametrize(
    ("names", "texts", "needed"),
    [
        ("uvp", ["jump(v)"], ["v"]),
        ("uvp", ["p"], ["p"]),
        ("uvp", [""], ["u"]),
        ("uvp", ["x"], ["u"]),
        ("uvp", ["p", "speed"], ["u", "v", "p"]),
        # one component alone would not be known as that of a velocity
        ("uvp", ["velocity_x"], ["u", "v", "p"]),
        ("uvp", ["nonsense"], ["u", "v", "p"]),
        (COMPRESSIBLE, ["rho*c"], ["rho", "c"]),
        (COMPRESSIBLE, ["speed"], ["rho", "rhou", "rhov"]),
        (COMPRESSIBLE, ["velocity_x"], COMPRESSIBLE),
    ],
    ids=str,
)
def test_fields_that_are_needed(names, texts, needed):
    assert needed_fields(dataset_of(names), texts) == tuple(needed)


def test_each_quantity_is_parsed_once_for_all_fields(monkeypatch):
    """And once for those that are needed."""
    parsed = []
    parse = Expression.parse
    monkeypatch.setattr(Expression, "parse", lambda text, names: parsed.append(names.fields) or parse(text, names))
    dataset = dataset_of("uvp")
    assert needed_fields(dataset, ["u+v", "u+v"]) == ("u", "v")
    coordinates = 4 - dataset.mesh.space
    assert len(parsed) == 2 * coordinates
    assert sum("p" in fields for fields in parsed) == coordinates
