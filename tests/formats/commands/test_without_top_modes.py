"""--without-top-modes: numbers of truncated fields, against integrals of Legendre polynomials.

On [0, 1]^2 the fields are u = 1, v = P3(2 x - 1), p = P3(2 x - 1) + y, of order 3; truncated v is 0, truncated p is y.
"""

import click
import numpy as np
import pytest

from elvis import write
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid


def legendre3(x):
    return (5 * x**3 - 3 * x) / 2


@pytest.fixture(scope="module")
def square(tmp_path_factory):
    bare = Dataset(grid(Shape.QUADRILATERAL, 1))
    functions = {
        "u": lambda x: np.ones(len(x)),
        "v": lambda x: legendre3(2 * x[:, 0] - 1),
        "p": lambda x: legendre3(2 * x[:, 0] - 1) + x[:, 1],
    }
    fields = tuple(approximated(bare, name, own, 4) for name, own in functions.items())
    return write(Dataset(bare.mesh, fields), tmp_path_factory.mktemp("square") / "a.xml")


def test_integrals_stand_next_to_those_of_one_order_less(square, elvis, elvis_json):
    (row,) = elvis_json("integrate", *square, "--field", "p^2", "--without-top-modes")
    assert row["value"] == pytest.approx(1 / 3 + 1 / 7, rel=1e-12)
    assert row["value_without_top_modes"] == pytest.approx(1 / 3, rel=1e-12)
    assert row["difference"] == pytest.approx(1 / 7, rel=1e-11)
    headers, cells = elvis("integrate", *square, "--field", "p^2", "--without-top-modes").splitlines()
    assert headers.split()[-4:] == ["of", "order", "2", "difference"]
    assert cells.split()[-1] == "0.1429"

    # a level set of the truncated field is that of the truncated field, not of the field
    rows = elvis_json("integrate", *square, "--field", "length", "--over", "p=0.5", "--without-top-modes")
    assert rows[0]["value_without_top_modes"] == pytest.approx(1, rel=1e-6)
    assert rows[0]["value"] > 1.1


def test_extrema_stand_next_to_those_of_one_order_less(square, elvis, elvis_json):
    found = elvis_json("info", *square, "--extrema", "--field", "p", "--without-top-modes")["p"]["maximum"]
    assert found["value"] == pytest.approx(2, abs=1e-9)
    assert found["without_top_modes"]["value"] == pytest.approx(1, abs=1e-9)
    assert found["difference"] == pytest.approx(1, abs=1e-9)
    assert "of order 2" in elvis("info", *square, "--extrema", "--without-top-modes").splitlines()[0]


def test_lines_stand_next_to_those_of_one_order_less(square, elvis, elvis_json):
    """The line from (0, 1/2) lies at y = 1/2 + integral of P3(2 x - 1) = 1/2 + 1/16 after the time 1/2."""
    asked = ("trace", *square, "--seeds", "point:0,0.5", "--duration", "0.5", "--device", "reference")
    found = elvis_json(*asked, "--without-top-modes")["without_top_modes"]
    assert found["distances"] == pytest.approx([1 / 16], rel=1e-8)
    assert found["other_ends"] == 0
    assert "of order 2: ends move by up to 0.0625" in elvis(*asked, "--without-top-modes")


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (("info", "--without-top-modes"), "--without-top-modes: expected with --extrema"),
        (("trace", "--cores", "--without-top-modes"), "expected streamlines, found --cores"),
        (("integrate", "--field", "p", "--histogram", "4", "--without-top-modes"), "expected no --histogram"),
    ],
)
def test_other_uses_are_rejected(square, elvis, arguments, match):
    with pytest.raises((ElvisError, click.UsageError), match=match):
        elvis(arguments[0], *square, *arguments[1:])
