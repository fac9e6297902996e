"""What Python asks of a dataset: fields by name, quantities at points, lines; answers are closed forms."""

import gc
import re
import sys
import weakref
from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, ElvisError, Shape, line, sample
from elvis.core.base.hints import nearest, perhaps
from elvis.core.base.ranks import ALONE
from elvis.core.mapping.patch import patches
from elvis.core.numbers import sampling
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.testing import approximated, curved, grid, mixed_plane, ripple

POINTS = [(0.21, 0.34), (0.8, 0.77), (5.0, 5.0)]


def product(x):
    return x[:, 0] * x[:, 1]


def with_fields(bare, **functions):
    return replace(bare, fields=tuple(approximated(bare, name, f, modes=4) for name, f in functions.items()))


@pytest.fixture(scope="module")
def plane():
    """u = x y and v = x - 2 y, exactly, on straight triangles and quadrilaterals."""
    return with_fields(Dataset(mixed_plane(seed=3)), u=product, v=lambda x: x[:, 0] - 2 * x[:, 1])


@pytest.fixture(scope="module")
def solid():
    return with_fields(Dataset(curved(grid(Shape.HEXAHEDRON, 2), ripple(0.02), n=3)), w=lambda x: x[:, 2])


def test_points_in_place_of_quantities_are_named():
    bare = Dataset(grid(Shape.TRIANGLE, 1))
    with pytest.raises(ElvisError, match="expected the text of a quantity, found ndarray"):
        sample(bare, np.zeros((1, 2)), ["x"])


def test_fields_are_found_by_name(plane):
    assert list(plane) == ["u", "v"]
    assert plane["u"].blocks is plane.fields[0].blocks is plane.field("u").blocks
    assert "v" in plane
    assert "speed" not in plane


def test_a_wrong_name_is_reported_with_a_similar_one(plane):
    with pytest.raises(KeyError, match=r"no field 'V' \(perhaps v\); the fields are u, v"):
        plane["V"]


@pytest.mark.parametrize("quantities", ["u*v", ["u*v"], ("u*v",)], ids=["text", "list", "tuple"])
def test_sample_accepts_the_quantities_of_probe(plane, quantities):
    x, y = np.transpose(POINTS[:2])
    found = sample(plane, quantities, POINTS)
    assert found["u*v"][:2] == pytest.approx(x * y * (x - 2 * y), abs=1e-13)
    assert np.isnan(found["u*v"][2])
    assert found.location.element_id[2] == -1


def test_sampled_data_are_released_at_once(plane):
    """Data that are done with take no memory until Python looks for circles, which may be long."""
    places = ElementPoints(patches(plane, ["u"])[0], np.array([0, 1]), np.zeros((2, 2)))
    for order in (0, 1, 2):
        assert np.isfinite(places.derivative(0, order)).all()
    gone = weakref.ref(places)
    gc.disable()
    try:
        del places
        assert gone() is None
    finally:
        gc.enable()


def test_predefined_quantities_and_derivatives(plane):
    found = sample(plane, ["speed", "d(u,x)"], POINTS[:2])
    x, y = np.transpose(POINTS[:2])
    assert found["speed"] == pytest.approx(np.hypot(x * y, x - 2 * y), abs=1e-13)
    assert found["d(u,x)"] == pytest.approx(y, abs=1e-12)


def test_none_means_all_fields(plane):
    assert sample(plane, None, POINTS).names == ("u", "v")


@pytest.mark.parametrize("point", [(0.21, 0.34), [0.21, 0.34, 0.0], np.array([[0.21, 0.34]])], ids=["2D", "3D", "row"])
def test_one_point(plane, point):
    found = sample(plane, "u", point)
    assert len(found) == 1
    assert found["u"] == pytest.approx([0.21 * 0.34], abs=1e-14)
    assert found.points.tolist() == [[0.21, 0.34, 0.0]]


@pytest.mark.parametrize(
    ("points", "told"),
    [
        ([(0.1, 0.2)], r"expected points (n, 3), or one of 3 coordinates, found numbers of shape (1, 2)"),
        (0.5, r"found numbers of shape ()"),
        (np.zeros((2, 2, 3)), r"found numbers of shape (2, 2, 3)"),
        ([(0, 0, 0, 0)], r"found numbers of shape (1, 4)"),
        ("here", r"expected points as numbers (n, 3), found 'here'"),
        ([(0, 0, 0), (0, 0)], r"expected points as numbers (n, 3)"),
    ],
)
def test_points_of_another_shape_are_rejected(solid, points, told):
    with pytest.raises(ElvisError, match=re.escape(told)):
        sample(solid, "w", points)


def test_no_points_are_no_results(solid):
    found = sample(solid, "w", [])
    assert len(found) == 0
    assert found["w"].shape == (0,)
    assert "0 points" in repr(found)


@pytest.mark.parametrize("count", [0, 6, 7, 23])
def test_points_are_taken_some_at_a_time(plane, monkeypatch, count):
    points = np.random.default_rng(8).uniform(-0.2, 1.2, (count, 3)) * [1, 1, 0]
    whole = sample(plane, "u", points).columns()
    monkeypatch.setattr(sampling, "_POINTS_AT_ONCE", 7)
    found = sampling.by_points(lambda some: sample(plane, "u", some).columns(), points, ["u"], ALONE)
    assert list(found) == list(whole)
    for name, column in whole.items():
        np.testing.assert_array_equal(found[name], column)


def test_an_unknown_quantity_is_reported(plane):
    with pytest.raises(ElvisError, match=r"there is no 'sped' \(perhaps speed\)"):
        sample(plane, "sped", POINTS)
    with pytest.raises(KeyError, match=r"'U' was not requested \(perhaps u\): there are u"):
        sample(plane, "u", POINTS)["U"]


def test_a_line(solid):
    found = line(solid, "w", (0.5, 0.5, 0), (0.5, 0.5, 1), 11)
    assert len(found) == 11
    assert found.points[:, 2].tolist() == pytest.approx(np.linspace(0, 1, 11))


def test_both_sides_of_a_border(plane):
    corner = plane.mesh.vertices[0]
    both = sample(plane, "u", corner, all=True)
    assert both["u"] == pytest.approx(np.full(len(both), corner[0] * corner[1]), abs=1e-13)


def test_results_are_one_line_and_a_table(plane):
    found = sample(plane, "u", np.tile(POINTS, (10, 1)))
    assert repr(found) == "<Samples of u at 30 points: 10 outside, 20 inside>"
    html = found._repr_html_()
    assert html.count("<tr>") == 12
    assert "<th>u</th>" in html


def test_results_become_a_pandas_table(plane):
    pandas = pytest.importorskip("pandas")
    found = sample(plane, ["u", "speed"], POINTS)
    table = found.to_pandas()
    assert isinstance(table, pandas.DataFrame)
    assert list(table.columns) == ["point", "x", "y", "z", "element", "status", "u", "speed"]
    assert np.array_equal(table["u"], found["u"], equal_nan=True)


def test_a_missing_library_is_named(plane, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ElvisError, match=r"a table needs pandas, .* pip install .elvis-viz.notebook.. installs it"):
        sample(plane, "u", POINTS).to_pandas()


def test_similar_names_are_ranked_by_letters_first():
    assert nearest("TURBO", ["turbo", "turbid"]) == "turbo"
    assert nearest("velocty", ["velocity", "p"]) == "velocity"
    assert perhaps("zzz", ["velocity", "p"]) == ""
