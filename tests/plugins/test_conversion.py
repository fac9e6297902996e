"""Theorems of conversion: what is contained arrives exactly, the rest converges, traces agree, jumps stay."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Basis, Shape, read, write
from elvis.core.mapping.locate import locate
from elvis.core.mapping.orientation import polygon_vertices
from elvis.core.mapping.patch import patches
from elvis.core.mapping.pointwise import values
from elvis.core.testing import grid, mixed_plane, mixed_volume
from elvis.plugins.conversion import converting
from elvis.plugins.conversion.converting import Settings, convert
from elvis.plugins.conversion.plugin import PyramidSpace
from elvis.plugins.projection import choosing
from elvis.plugins.projection.traces import Traces
from elvis.plugins.testing import Analytic, AnalyticField, values_found

VOLUMES = Shape.of_dimension(3)


def powers(p):
    """Exponents (i, j, k) of total degree p at most."""
    return [(i, j, k) for i in range(p + 1) for j in range(p + 1 - i) for k in range(p + 1 - i - j)]


def polynomial(p, seed=0):
    """A polynomial of total degree p in points (..., 3)."""
    weights = np.random.default_rng(seed).uniform(-1, 1, len(powers(p)))

    def function(points):
        x, y, z = np.moveaxis(points, -1, 0)
        return sum(w * x**i * y**j * z**k for w, (i, j, k) in zip(weights, powers(p), strict=True))

    return function


def bent(q, size=0.1):
    """A map of degree q."""
    parts = [polynomial(q, seed) for seed in (1, 2, 3)]
    return lambda points: points + size * np.stack([part(points) for part in parts], axis=-1) / 3**q


def wave(points):
    return np.sin(points[..., 0] + 2 * points[..., 1]) * np.cos(points[..., 2] - points[..., 0])


def cells(shape):
    return grid(shape, 2)


def assert_exact(report):
    for measure in (report.geometry, *report.fields):
        assert measure.state == "exact", measure
        assert measure.relative < 1e-12, measure


@pytest.mark.sampled
@pytest.mark.parametrize("p", [1, 2, 3, 5])
@pytest.mark.parametrize("shape", list(Shape))
def test_polynomials_on_curved_meshes_are_exact(shape, p):
    fields = {"u": AnalyticField(polynomial(p), p, True), "w": AnalyticField(polynomial(p, 9), p, False)}
    source = Analytic(cells(shape), fields, bent(p), p, seed=p)
    conversion = convert(source)
    assert_exact(conversion.report)
    assert {measure.order for measure in conversion.report.fields} == {p}
    assert [measure.is_continuous for measure in conversion.report.fields] == [True, False]


@pytest.mark.sampled(least=2, free=("seed",))
@pytest.mark.parametrize("seed", range(4))
def test_mixed_meshes_with_random_orientation_and_numbering_are_exact(seed):
    fields = {"u": AnalyticField(polynomial(3), 3, True)}
    for mesh in (mixed_volume(), mixed_plane()):
        conversion = convert(Analytic(mesh, fields, bent(2), 2, seed, is_numbered=seed % 2 == 0))
        assert_exact(conversion.report)
        assert not conversion.report.listed["detached"]
        assert not conversion.report.listed["inverted"]


@pytest.mark.sampled
@pytest.mark.parametrize("shape", [*VOLUMES, Shape.TRIANGLE])
@pytest.mark.parametrize("p", [1, 2, 3])
def test_errors_of_smooth_fields_shrink_with_order_p_plus_1(shape, p):
    errors = []
    for count in (2, 4):
        source = Analytic(grid(shape, count), {"u": AnalyticField(wave, p, True, is_polynomial=False)}, seed=1)
        measure = convert(source, Settings(order=p)).report.fields[0]
        errors.append((measure.max, measure.l2))
        assert measure.state == "projected"
    rates = np.log2(np.array(errors[0]) / np.array(errors[1]))
    assert rates[0] > p + 1 - 0.35
    assert rates[1] > p + 1 - 0.25


@pytest.mark.sampled(free=("seed",))
@pytest.mark.parametrize("is_polynomial", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_traces_of_continuous_fields_are_equal_to_the_last_bit(seed, is_polynomial):
    function = polynomial(4) if is_polynomial else wave
    fields = {"u": AnalyticField(function, 4, True, is_polynomial)}
    for mesh in (mixed_volume(), mixed_plane(), grid(Shape.TETRAHEDRON, 2), grid(Shape.PRISM, 2)):
        conversion = convert(
            Analytic(mesh, fields, bent(2), 2, seed, PyramidSpace.RATIONAL), Settings(pyramids="native")
        )
        blocks = [block.coefficients[:, None] for block in conversion.dataset.field("u").blocks]
        traces = Traces(conversion.dataset.mesh, conversion.blocks, [5] * len(blocks))
        assert traces.gather(blocks).apply(blocks) == 0
        if mesh.dimension == 3:
            apart = [own + np.random.default_rng(seed).normal(size=own.shape) for own in blocks]
            before = [own.copy() for own in apart]
            skins = traces.gather(apart)
            change = skins.apply(apart)
            assert change == max(np.abs(own - old).max() for own, old in zip(apart, before, strict=True)) > 0
            assert skins.apply(apart) == 0


@pytest.mark.sampled(free=("seed",))
@pytest.mark.parametrize("seed", range(3))
def test_every_element_around_a_point_gives_the_same_value(seed):
    # independently of how traces were made: points on shared faces, found by search, seen from both sides
    source = Analytic(mixed_volume(), {"u": AnalyticField(wave, 4, True, False)}, bent(2), 2, seed)
    dataset = convert(source, Settings(pyramids="native")).dataset
    mesh = mixed_volume()
    corners = np.concatenate([mesh.vertices[polygon_vertices(mesh, s)][:, :3] for s in Shape.of_dimension(2)])
    points = bent(2)(np.einsum("i,fic->fc", [0.5, 0.2, 0.3], corners))
    found = locate(dataset, points, all=True)
    sides = np.full(len(found), np.nan)
    for number, patch in enumerate(patches(dataset, ["u"])):
        here = found.patch == number
        sides[here] = values(patch, 0, found.row[here], found.reference[here])
    shared = np.flatnonzero(np.bincount(found.point) == 2)
    pairs = np.array([sides[found.point == point] for point in shared])
    assert len(pairs) >= 15
    assert np.abs(pairs[:, 0] - pairs[:, 1]).max() < 1e-11


def test_jumps_are_preserved():
    def steps(points):
        # constant on every element of a grid: the number of its cell
        return np.broadcast_to(np.floor(2 * points.mean(axis=1, keepdims=True)[..., :1]).sum(-1), points.shape[:2])

    conversion = convert(Analytic(cells(Shape.HEXAHEDRON), {"w": AnalyticField(steps, 0, False)}))
    assert_exact(conversion.report)
    found = values_found(conversion.dataset, "w", np.array([[0.499, 0.3, 0.3], [0.501, 0.3, 0.3]]))
    assert found == pytest.approx([0, 1])


def test_jumps_of_a_supposedly_continuous_field_are_preserved_and_reported():
    def steps(points):
        return np.broadcast_to(np.floor(2 * points.mean(axis=1, keepdims=True)[..., :1]).sum(-1), points.shape[:2])

    report = convert(Analytic(cells(Shape.HEXAHEDRON), {"w": AnalyticField(steps, 1, True)})).report
    assert_exact(report)
    assert report.fields[0].is_continuous is False
    assert any("jumps" in note for note in report.notes)


@pytest.mark.parametrize(
    ("space", "order", "is_continuous", "shape", "last"),
    [
        (PyramidSpace.POLYNOMIAL, 4, False, Shape.PYRAMID, Basis.ORTHO_PYR_C),
        (PyramidSpace.RATIONAL, 2, False, Shape.PYRAMID, Basis.MODIFIED_PYR_C),
        (PyramidSpace.RATIONAL, 3, False, Shape.HEXAHEDRON, Basis.MODIFIED_A),
        (PyramidSpace.TENSOR, 1, True, Shape.PYRAMID, Basis.MODIFIED_PYR_C),
        (PyramidSpace.TENSOR, 1, False, Shape.HEXAHEDRON, Basis.MODIFIED_A),
        (PyramidSpace.TENSOR, 4, True, Shape.HEXAHEDRON, Basis.MODIFIED_A),
    ],
)
def test_pyramids_use_the_smallest_sufficient_form(space, order, is_continuous, shape, last):
    fields = {"u": AnalyticField(polynomial(order), order, is_continuous)}
    conversion = convert(Analytic(grid(Shape.PYRAMID, 2), fields, pyramid=space, seed=2))
    assert_exact(conversion.report)
    (block,) = conversion.dataset.field("u").blocks
    assert (block.expansion.shape, block.expansion.bases[-1]) == (shape, last)
    points = np.random.default_rng(0).random((50, 3))
    found = values_found(conversion.dataset, "u", points)
    assert found == pytest.approx(polynomial(order)(points), rel=0, abs=1e-11)


def test_native_pyramids_are_projected_and_the_error_is_measured():
    fields = {"u": AnalyticField(lambda x: (x[..., 0] * x[..., 1]) ** 2, 4, True)}
    source = Analytic(grid(Shape.PYRAMID, 2), fields, pyramid=PyramidSpace.RATIONAL, seed=2)
    report = convert(source, Settings(pyramids="native", order=3)).report
    assert report.elements == {"pyramid": 48}
    assert 1e-6 < report.fields[0].relative < 0.1


@pytest.mark.parametrize("shape", VOLUMES)
def test_maps_beyond_curves_are_stored_as_fields(shape):
    # a bubble inside: zero on all faces of the cells
    def bubble(points):
        x, y, z = np.moveaxis(2 * points, -1, 0)
        moved = 0.03 * np.sin(np.pi * x) * np.sin(np.pi * y) * np.sin(np.pi * z)
        return points + moved[..., None]

    fields = {"u": AnalyticField(polynomial(2), 2, True)}
    # the smallest orders that curves of edges and faces can't hold
    maps = {Shape.HEXAHEDRON: (bubble, 6), Shape.PRISM: (bent(5), 5)}
    warp, order = maps.get(shape, (bent(4), 4))
    source = Analytic(cells(shape), fields, warp, order, seed=3, pyramid=PyramidSpace.POLYNOMIAL)
    source.blocks = [replace(block, is_polynomial=shape is not Shape.HEXAHEDRON) for block in source.blocks]
    automatic, curves, always = (convert(source, Settings(geometry=g)) for g in ("auto", "curves", "map"))
    assert automatic.report.has_map
    assert automatic.dataset.metadata["GeometryMap"] == "map_x,map_y,map_z"
    assert not curves.report.has_map
    assert curves.report.geometry.max > 100 * automatic.report.geometry.max
    assert automatic.report.deviation[0] == pytest.approx(curves.report.deviation[0])
    assert always.report.geometry.max == automatic.report.geometry.max
    if shape is not Shape.HEXAHEDRON:
        assert_exact(automatic.report)


def test_a_map_representable_by_curves_is_stored_in_the_mesh_file():
    conversion = convert(Analytic(mixed_volume(), {}, bent(2), 2, seed=1))
    assert_exact(conversion.report)
    assert not conversion.report.has_map
    assert not conversion.dataset.fields
    assert len(conversion.dataset.mesh.edge_curves)


@pytest.mark.parametrize("shape", [Shape.SEGMENT, Shape.TRIANGLE, Shape.QUADRILATERAL])
def test_meshes_lie_in_the_space_of_the_axes_that_they_use(shape):
    def arch(points):  # all vertices stay where they are
        x = points[..., 0]
        return points + (x * (x - 1))[..., None] * [0, 0, 1]

    straight = Analytic(grid(shape, 1), {"u": AnalyticField(polynomial(2), 2)})
    bent_up = Analytic(grid(shape, 1), {"u": AnalyticField(polynomial(2), 2)}, arch, 2)
    assert convert(straight).dataset.mesh.space == shape.dimension
    conversion = convert(bent_up)
    assert conversion.dataset.mesh.space == 3
    assert_exact(conversion.report)


def test_straight_meshes_get_no_curves():
    conversion = convert(Analytic(mixed_volume(), {}, lambda x: 2 * x + 1, 3, seed=1))
    assert not len(conversion.dataset.mesh.edge_curves)
    assert not len(conversion.dataset.mesh.face_curves)


@pytest.mark.sampled
@pytest.mark.parametrize("mesh", [mixed_volume(), grid(Shape.TETRAHEDRON, 3), grid(Shape.QUADRILATERAL, 4)])
@pytest.mark.parametrize("is_continuous", [True, False])
def test_orders_by_element_satisfy_the_tolerance(mesh, is_continuous):
    def front(points):
        return np.tanh(4 * (points[..., 0] - 0.5 * points[..., 1] - 0.4))

    source = Analytic(mesh, {"u": AnalyticField(front, 5, is_continuous, False)}, seed=4)
    conversion = convert(source, Settings(tolerance=3e-3))
    measure = conversion.report.fields[0]
    assert measure.relative <= 3e-3
    assert measure.is_continuous is is_continuous
    orders = {block.expansion.modes for block in conversion.dataset.field("u").blocks}
    assert len(orders) > 1


def test_a_tolerance_never_raises_orders_above_the_exact_one():
    source = Analytic(cells(Shape.TETRAHEDRON), {"u": AnalyticField(polynomial(3), 3, True)}, seed=4)
    report = convert(source, Settings(tolerance=1e-9)).report
    assert_exact(report)
    assert report.fields[0].order == 3


def test_fields_of_several_orders_share_one_section_a_shape(tmp_path):
    fields = {"u": AnalyticField(polynomial(4), 4, True), "w": AnalyticField(polynomial(2), 2, False)}
    conversion = convert(Analytic(mixed_volume(), fields, bent(3), 3, seed=1))
    assert_exact(conversion.report)
    written = write(conversion.dataset, tmp_path / "case.xml")
    text = written[-1].read_text()
    assert text.count("<ELEMENTS") == len(conversion.report.elements)
    assert "MIXORDER" not in text


@pytest.mark.thorough
def test_the_announced_error_is_that_of_the_written_file(tmp_path):
    def warp(points):
        return points / (1 + 0.2 * points[..., :1])

    source = Analytic(mixed_volume(), {"u": AnalyticField(wave, 2, True, False)}, warp, 3, seed=1)
    source.blocks = [replace(block, is_polynomial=False) for block in source.blocks]
    conversion = convert(source)
    again = read(*write(conversion.dataset, tmp_path / "case.xml"))
    places = np.random.default_rng(0).random((400, 3)) * [3, 1, 1]
    found = values_found(again, "u", warp(places))
    inside = np.isfinite(found)
    assert inside.sum() > 350
    measure, geometry = conversion.report.fields[0], conversion.report.geometry
    assert np.abs(found - wave(places))[inside].max() <= 1.5 * measure.max + 5 * geometry.max


@pytest.mark.thorough
def test_converting_twice_gives_the_same_bytes(tmp_path):
    fields = {"u": AnalyticField(wave, 3, True, False), "w": AnalyticField(polynomial(2), 2, False)}
    for name in ("one", "two"):
        conversion = convert(Analytic(mixed_volume(), fields, bent(3), 3, seed=5))
        for kind in ("text", "compressed"):
            (tmp_path / name / kind).mkdir(parents=True)
            write(conversion.dataset, tmp_path / name / kind / "case.xml", mesh_format=kind)
    for file in sorted((tmp_path / "one").rglob("case.*")):
        assert file.read_bytes() == (tmp_path / "two" / file.relative_to(tmp_path / "one")).read_bytes()


def spike(points):
    """A bump in one corner, of which most elements see nothing."""
    return np.exp(-(points**2).sum(axis=-1) / 0.01)


@pytest.mark.parametrize(
    ("function", "is_polynomial", "times"),
    [(polynomial(2), True, 1), (lambda x: np.exp(x[..., 0]), False, 1), (spike, False, 2)],
)
def test_fields_are_projected_again_only_if_few_elements_were_inconclusive(monkeypatch, function, is_polynomial, times):
    projected = []
    fit = converting.at_order
    monkeypatch.setattr(converting, "at_order", lambda *args: projected.append(1) or fit(*args))
    monkeypatch.setattr(choosing, "_FEW", 8)
    fields = {"u": AnalyticField(function, 2, False, is_polynomial)}
    (measure,) = convert(Analytic(grid(Shape.QUADRILATERAL, 12), fields)).report.fields
    assert len(projected) == times
    assert (measure.order == 2) == is_polynomial
    assert measure.relative < 1e-8
