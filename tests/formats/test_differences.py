"""Differences of solutions against closed forms: one function on two meshes, a shift, families, parts without cover."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.bounds.extrema import Extremum, extrema
from elvis.core.data.dataset import Dataset
from elvis.core.differences import diff, family
from elvis.core.differences.convergence import Family
from elvis.core.differences.overlaps import bound_of_difference
from elvis.core.integrals import integrate
from elvis.core.mapping.patch import patches
from elvis.core.numbers.sampling import sample
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple

SHIFT = 1e-6


def cubic(points):
    return points[:, 0] ** 2 + points[:, 1] ** 2 * points[:, 2] - points[:, 0] * points[:, 1]


def with_p(mesh, function=cubic, modes=4):
    return Dataset(mesh, (approximated(Dataset(mesh), "p", function, modes),))


@pytest.mark.parametrize(("first", "second"), [(Shape.TETRAHEDRON, Shape.HEXAHEDRON), (Shape.PYRAMID, Shape.PRISM)])
def test_one_function_on_two_meshes_has_no_difference(first, second):
    """Range 2: every norm is below 1e-11 of it, and so is what the maximum is proved to be at most."""
    found = diff(with_p(grid(first, 1)), with_p(grid(second, 1), modes=5), error=0.1)[0]
    assert max(found.l1, found.l2, found.linf) < 2e-11
    assert found.linf <= found.bound < 2e-11
    assert found.covered == pytest.approx(1, abs=1e-12)


def test_a_share_of_a_zero_field_is_not_written_as_a_number():
    zero = with_p(grid(Shape.TETRAHEDRON, 1), lambda points: 0 * points[:, 0])
    assert diff(zero, zero, error=0.1).cells()[0][-2] == "-"


def turned(mesh):
    """The mesh in another place and direction, in which most of it meets the unit cube."""
    cosine, sine = np.cos(0.4), np.sin(0.4)
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    return replace(mesh, vertices=(mesh.vertices - 0.5) @ turn.T + [0.52, 0.47, 0.5])


@pytest.mark.sampled
@pytest.mark.parametrize("bend", [0.0, 0.04])
@pytest.mark.parametrize(
    ("first", "second"),
    [(a, b) for a in Shape for b in Shape if 1 < a.dimension == b.dimension and b is not Shape.PYRAMID],
)
def test_the_maximum_difference_of_one_function_is_proved_to_be_rounding(first, second, bend):
    """1e-11 of the range, 2, whichever elements meet; x is one on curved elements, too."""
    mesh = grid(first, 2)
    mesh = curved(mesh, ripple(bend), 3) if bend else mesh

    def function(p):
        return 2 * p[:, 0] - 1 if bend else 2 * p[:, 0] * p[:, 1] - 1

    found, _ = bound_of_difference(
        *(
            [*patches(Dataset(one.mesh, one.fields), ["p"])]
            for one in (with_p(mesh, function, 4 if bend else 3), with_p(turned(grid(second, 2)), function, 3))
        ),
        Extremum(1e-15, np.nan, (0, 0, 0), 0),
    )
    assert found.value <= found.bound < 2e-11


@pytest.mark.thorough
def test_a_shift_is_the_gradient_times_it():
    """p(x + s) - p(x) = s (2 x - y) + s^2."""
    moved = with_p(grid(Shape.TETRAHEDRON, 1), lambda p: cubic(p + SHIFT * np.eye(3)[0]), 5)
    for own, is_same in ((with_p(grid(Shape.TETRAHEDRON, 1)), True), (with_p(grid(Shape.HEXAHEDRON, 2)), False)):
        found = diff(own, moved, error=0.1)
        row = found.of("p")
        assert found.is_same_mesh == is_same
        assert row.l2 == pytest.approx(SHIFT * np.sqrt(2 / 3), rel=2e-6)
        assert row.h1 == pytest.approx(SHIFT * np.sqrt(2 / 3 + 5), rel=2e-6)
        assert row.linf == pytest.approx(2 * SHIFT, rel=1e-6)
        assert row.where == pytest.approx((1, 0, row.where[2]), abs=1e-3)
        assert abs(row.l2 - SHIFT * np.sqrt(2 / 3)) < row.l2_error + SHIFT**2
        assert 2 * SHIFT + SHIFT**2 - 1e-14 < row.bound < 2.003 * SHIFT
        assert row.bound >= row.linf
        point = sample(own.with_others(ref=moved), ["ref:p - p", "d(ref:p, y) - d(p, y)"], [(0.3, 0.2, 0.1)]).values[0]
        assert point == pytest.approx([SHIFT * 0.4 + SHIFT**2, -SHIFT], abs=1e-12)


@pytest.mark.parametrize(("bends", "closer"), [((False, False), 2e-4), ((True, False), 2e-3), ((False, True), 2e-3)])
def test_the_maximum_on_two_meshes_is_bounded(bends, closer):
    """|x y - (x y + y^2 / 2 + x / 4)| <= 3/4, at (1, 1) of the unit square, for either mesh curved inside."""

    def inside(points):
        bubble = points[:, 0] * (1 - points[:, 0]) * points[:, 1] * (1 - points[:, 1])
        return points + bubble[:, None] * [0.4, 0.3, 0]

    meshes = [grid(Shape.TRIANGLE, 2), grid(Shape.QUADRILATERAL, 3)]
    meshes = [curved(mesh, inside, 3) if bend else mesh for mesh, bend in zip(meshes, bends, strict=True)]
    own = with_p(meshes[0], lambda p: p[:, 0] * p[:, 1], 9 if bends[0] else 3)
    other = with_p(meshes[1], lambda p: p[:, 0] * p[:, 1] + p[:, 1] ** 2 / 2 + p[:, 0] / 4, 9 if bends[1] else 3)
    row = diff(own, other, error=0.5)[0]
    assert row.linf == pytest.approx(0.75, rel=1e-3)
    assert 0.75 - 1e-9 <= row.bound <= 0.75 * (1 + closer)
    assert row.linf <= row.bound <= row.linf * (1 + 2e-4)
    x, y, _ = row.where
    assert row.linf == pytest.approx(abs(y**2 / 2 + x / 4), abs=1e-3 * any(bends) + 1e-12)


def test_the_maximum_at_corners_is_found():
    """A peak that no point of the search lies on is found by halving boxes, within 1e-4, and has the value."""

    def peak(p):
        return 1 / (1 + 400 * ((p[:, 0] - 0.3137) ** 2 + (p[:, 1] - 0.7071) ** 2))

    own, other = (
        with_p(grid(Shape.QUADRILATERAL, 5), peak, 5),
        with_p(grid(Shape.TRIANGLE, 3), lambda p: 0 * p[:, 0], 2),
    )
    at_points = Extremum(0.01, np.nan, (0.0, 0.0, 0.0), -1)
    found, _ = bound_of_difference(*([*patches(one, ["p"])] for one in (own, other)), at_points)
    assert found.value <= found.bound <= found.value * 1.0002
    least, greatest = extrema(own, "p")
    assert found.value == pytest.approx(max(greatest.value, -least.value), rel=1e-3)
    values = sample(own, "p", [found.position]).values[:, 0]
    assert np.abs(values) == pytest.approx(found.value, abs=1e-12)
    assert found.element == sample(own, "p", [found.position]).location.element_id[0]


def test_fields_on_curved_elements_of_both_are_bounded_by_ranges_on_boxes():
    meshes = [curved(grid(shape, 1), ripple(0.05), 3) for shape in (Shape.TRIANGLE, Shape.QUADRILATERAL)]
    own, other = with_p(meshes[0], lambda p: p[:, 0], 5), with_p(meshes[1], lambda p: 3 - p[:, 0], 5)
    found = diff(own, other, error=0.5)
    assert found[0].linf < found[0].bound < found[0].linf * 1.01
    assert found.facts()["p"]["Linf_bound"] == found[0].bound


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.sampled(least=2, free=("seed",))
def test_no_point_on_curved_meshes_exceeds_the_maximum_difference(seed):
    """Of waves and a narrow peak on two curved meshes: no sample is greater, and the bound is close."""
    rng = np.random.default_rng(seed)
    d = 2 + seed % 2
    shapes = Shape.of_dimension(d)
    parts = []
    for _ in range(2):
        shape = shapes[rng.integers(len(shapes))]
        mesh = curved(grid(shape, int(rng.integers(1, 3 if d == 3 else 5))), ripple(0.05, int(rng.integers(99))), 3)
        waves, peak = rng.normal(size=3) * 4, rng.uniform(0.2, 0.8, 3)[:d]
        parts.append(
            with_p(
                mesh,
                lambda p, waves=waves, peak=peak: (
                    np.sin(p @ waves) + 8 * np.exp(-((p[:, :d] - peak) ** 2).sum(axis=1) / 0.01)
                ),
                4,
            )
        )
    found = diff(*parts, error=0.5)
    points = rng.random((4000, d))
    for width in (0.02, 0.004):
        one, other = (sample(part, "p", points).values[:, 0] for part in parts)
        apart = np.nan_to_num(np.abs(one - other))
        assert apart.max() <= found[0].linf * (1 + 1e-9)
        points = points[apart.argmax()] + width * rng.normal(size=(1000, d))
    assert found[0].linf <= found[0].bound <= 1.02 * found[0].linf
    told = any("no tighter bound is proved" in remark for remark in found.remarks)
    assert told == (found[0].bound > 1.001 * found[0].linf)


def test_parallelepipeds_are_bounded_as_closely():
    """Cubic waves on two grids of hexahedra, whose difference is about the same at thousands of places."""

    def wave(p):
        return np.sin(3 * p[:, 0] + 2 * p[:, 1]) * np.cos(2 * p[:, 2])

    own, other = (with_p(grid(Shape.HEXAHEDRON, count), wave) for count in (4, 3))
    least = Extremum(1e-6, np.nan, (0.0, 0.0, 0.0), -1)
    found, _ = bound_of_difference(*([*patches(one, ["p"])] for one in (own, other)), least)
    values = sample(
        own.with_others(ref=other), "abs(p - ref:p)", [found.position, *np.random.default_rng(1).random((2000, 3))]
    )
    assert values.values[0, 0] == pytest.approx(found.value, abs=1e-12)
    assert values.values.max() <= found.bound <= found.value * 1.0002


def test_cubic_fields_on_curved_hexahedra_are_bounded_as_closely():
    """Differences have degree 18 each way in these; nets of a lower one are near enough."""

    def wave(p):
        return np.sin(3 * p[:, 0] + 2 * p[:, 1]) * np.cos(2 * p[:, 2])

    own, other = (
        with_p(curved(grid(Shape.HEXAHEDRON, 2), ripple(0.03), 3), wave),
        with_p(grid(Shape.HEXAHEDRON, 1), wave),
    )
    least = Extremum(1e-3, np.nan, (0.0, 0.0, 0.0), -1)
    found, _ = bound_of_difference(*([*patches(one, ["p"])] for one in (own, other)), least)
    values = sample(
        own.with_others(ref=other), "abs(p - ref:p)", [found.position, *np.random.default_rng(1).random((2000, 3))]
    )
    assert found.value - 1e-12 <= values.values[0, 0] <= found.value * 1.0001
    assert np.nanmax(values.values) <= found.bound <= found.value * 1.0002


@pytest.mark.parametrize("is_refined", [True, False])
def test_orders_are_slopes_of_errors_over_sizes(is_refined):
    """Errors h^3, from coarse to fine or back; unknown after equal sizes, and where nothing differs."""
    sizes = np.array([0.4, 0.2, 0.1, 0.1, 0.05, 0.025][:: 1 if is_refined else -1])
    errors = np.where(sizes == 0.05, 0.0, sizes**3)
    members = [
        SimpleNamespace(size=h, of=lambda _, e=e: SimpleNamespace(l2=e)) for h, e in zip(sizes, errors, strict=True)
    ]
    found = Family(tuple("abcdef"), tuple(members)).orders("p")
    expected = [np.nan, 3, 3, np.nan, np.nan, np.nan] if is_refined else [np.nan, np.nan, np.nan, np.nan, 3, 3]
    assert found == pytest.approx(expected, nan_ok=True)


def wave(points):
    return np.sin(2 * points[:, 0] + points[:, 1])


@pytest.mark.thorough
@pytest.mark.parametrize("modes", [2, 4])
def test_families_show_their_order(modes):
    meshes = [grid(Shape.QUADRILATERAL, count) for count in (4, 8)]
    found = family([with_p(mesh, wave, modes) for mesh in meshes], with_p(grid(Shape.TRIANGLE, 2), wave, 9), error=0.9)
    assert found.orders("p")[1] == pytest.approx(modes, abs=0.05)
    assert found.orders("p", "h1")[1] == pytest.approx(modes - 1, abs=0.05)
    assert list(found.columns()["elements"]) == [16, 64]


@pytest.mark.sampled(least=3, free=("shape",))
@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1])
def test_inverted_elements_contain_the_points_they_cover(shape):
    """The second mesh is a mirror image, with negative Jacobians: points inside, on borders and corners have values."""
    first = Shape.HEXAHEDRON if shape.dimension == 3 else Shape.TRIANGLE
    mesh = grid(shape, 1)
    mirrored = replace(mesh, vertices=mesh.vertices * [-1, 1, 1] + [1, 0, 0])

    def square(p):
        return p[:, 0] ** 2 - p[:, 0] * p[:, 1]

    own, other = with_p(grid(first, 2), square, 3), with_p(mirrored, square, 3)
    row = diff(own, other, error=0.5)[0]
    assert row.covered == pytest.approx(1, abs=1e-12)
    assert max(row.l1, row.l2, row.linf) < 1e-11
    top = float(shape.dimension == 3)
    points = [(0.3, 0.2, 0.1 * top), (0.5, 0.5, 0.5 * top), (0, 0, 0), (1, 1, top), (1, 0.3, 0)]
    assert np.abs(sample(own.with_others(ref=other), "p - ref:p", points).values).max() < 1e-11
    assert np.isnan(sample(own.with_others(ref=other), "p - ref:p", [(1.5, 0, 0)]).values).all()


def test_a_folded_element_of_the_second_covers_the_image_of_its_map():
    """A corner of a quadrilateral is moved so far that it folds: values there are those of either sheet, x + y."""
    mesh = grid(Shape.QUADRILATERAL, 2)
    vertices = mesh.vertices.copy()
    vertices[np.abs(vertices - [0.5, 0.5, 0]).sum(axis=1).argmin()] = [0.9, 0.9, 0]
    folded = replace(mesh, vertices=vertices)

    def plane(p):
        return p[:, 0] + p[:, 1]

    row = diff(with_p(grid(Shape.TRIANGLE, 3), plane, 3), with_p(folded, plane, 3), error=0.3)[0]
    assert row.covered == pytest.approx(1, abs=1e-12)
    assert max(row.l1, row.l2, row.linf) < 2e-11
    assert row.linf <= row.bound < 2e-11


def half(points):
    return points * [0.5, 1, 1]


def test_the_part_outside_the_second_mesh_is_excluded_and_reported():
    """The second fills x < 0.5: the integral of (p - q)^2 = x^2 there is 1/24; points of its border count."""
    small = grid(Shape.TRIANGLE, 2)
    small = replace(small, vertices=half(small.vertices))
    own, other = with_p(grid(Shape.QUADRILATERAL, 2), lambda p: p[:, 0]), with_p(small, lambda p: 0 * p[:, 0])
    found = diff(own, other)
    assert found[0].covered == pytest.approx(0.5, rel=1e-12)
    assert found[0].l2 == pytest.approx(np.sqrt(1 / 24), rel=1e-10)
    assert found[0].linf == pytest.approx(0.5, rel=1e-12)
    assert found.remarks[0] == "p: the second dataset does not cover 0.5 of the first, which is excluded"
    values = sample(own.with_others(ref=other), "p - ref:p", [(0.5, 0.5, 0), (0.25, 0.25, 0), (0.51, 0.5, 0)]).values[
        :, 0
    ]
    np.testing.assert_allclose(values, [0.5, 0.25, np.nan], atol=1e-12)
    whole = integrate(own.with_others(ref=other), "p - ref:p")
    assert (whole.value, whole[0].measure) == pytest.approx((1 / 8, 0.5), rel=1e-12)
    assert "has no value on 0.5 of domain" in whole.remarks[0]


def test_data_without_overlap_have_no_difference():
    flat, solid = (with_p(grid(shape, 1), lambda p: p[:, 0]) for shape in (Shape.QUADRILATERAL, Shape.HEXAHEDRON))
    far = with_p(replace(flat.mesh, vertices=9 + flat.mesh.vertices), lambda p: p[:, 0])
    for other in (solid, far):
        sentence = f"no overlap of the first, of {other.mesh.dimension}D data, with the second, of 2D data"
        with pytest.raises(ElvisError, match=sentence):
            diff(other, flat)


def test_the_error_of_the_covered_part_is_valid():
    """The second fills x < 0.45, inside elements of the first."""
    small = grid(Shape.TRIANGLE, 2)
    small = replace(small, vertices=small.vertices * [0.45, 1, 1])
    row = diff(with_p(grid(Shape.QUADRILATERAL, 2)), with_p(small), error=0.1)[0]
    assert abs(row.covered - 0.45) < row.covered_error < 0.1


def test_invalid_comparisons_are_rejected():
    own = with_p(grid(Shape.TRIANGLE, 1))
    with pytest.raises(ElvisError, match="expected fields of the same names in both datasets, found p and none"):
        diff(own, Dataset(own.mesh))
    with pytest.raises(ElvisError, match=r"expected a field that both datasets have \(p\), found 'u'"):
        diff(own, own, "u")
    beside = own.with_others(ref=own)
    for text, sentence in (
        ("ref", "expected : after refand a quantity, such as ref:p"),
        ("ref:u", "character 5: there is no 'u'"),
        ("other:p", "there is no 'other'"),
    ):
        with pytest.raises(ElvisError) as error:
            sample(beside, text, [(0, 0, 0)])
        assert sentence in str(error.value)


@pytest.mark.parametrize("error", [-0.1, 0.0, 1.0, np.nan])
def test_errors_are_requested_between_0_and_1(error):
    own, other = (with_p(grid(Shape.QUADRILATERAL, count)) for count in (1, 2))
    with pytest.raises(ElvisError, match="expected an error between 0 and 1"):
        diff(own, other, error=error)
