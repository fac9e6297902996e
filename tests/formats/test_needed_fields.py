"""Fields that quantities need: from these alone they are what they are from all."""

import pytest

from elvis.core.quantities.needed import needed_fields
from elvis.core.testing import approximated, grid
from elvis.formats import Dataset, Shape

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
