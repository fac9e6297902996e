"""What a source may get wrong: rejected with a one-line error, or kept and listed."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import ElvisError, Shape
from elvis.core.data.mesh import NON_CONFORMING
from elvis.core.testing import grid, mixed_volume, one_element
from elvis.plugins.conversion.converting import Settings, convert
from elvis.plugins.conversion.plugin import Boundary, Converter, Elements, SourceField
from elvis.plugins.testing import Analytic, AnalyticField


def plain(points):
    return points[..., 0] + 2 * points[..., 1]


class Nodes(Converter):
    """Linear elements with given corners."""

    def __init__(self, shape, corners, vertices=None, **more):
        self.corners = np.asarray(corners, float)
        self.blocks = [Elements(shape, len(self.corners), 1, vertices, **more)]
        self.fields = [SourceField("u", 1, True)]

    @classmethod
    def opens(cls, paths):
        return False

    def table(self, block, points):
        from elvis.core.mapping.mode_entities import entities
        from elvis.core.polynomials.expansion import values
        from elvis.core.polynomials.interpolation import modified

        linear = values(modified(block.shape, (2,) * block.shape.dimension), points)
        return linear[:, entities(block.shape, 2).vertices]

    def positions(self, block, points):
        return np.einsum("pv,evc->epc", self.table(block, points), self.corners[block.rows])

    def sample(self, block, field, points):
        return plain(self.positions(block, points))


def corners_of(mesh, shape):
    from elvis.core.mapping.orientation import local_vertices

    return mesh.vertices[local_vertices(mesh, shape)]


@pytest.mark.parametrize("shape", list(Shape))
def test_left_handed_blocks_are_reoriented_together(shape):
    corners = corners_of(grid(shape, 2), shape) * [-1, 1, 1]
    conversion = convert(Nodes(shape, corners))
    assert conversion.report.geometry.state == conversion.report.fields[0].state == "exact"
    assert not conversion.report.listed["inverted"]


@pytest.mark.parametrize("shape", Shape.of_dimension(3))
def test_single_inverted_elements_are_converted_and_listed(shape):
    source = Analytic(grid(shape, 2), {"u": AnalyticField(plain, 1)})
    (block,) = source.blocks
    corners = corners_of(grid(shape, 2), shape).copy()
    mirror = {8: [4, 5, 6, 7, 0, 1, 2, 3], 6: [3, 2, 1, 0, 5, 4], 5: [1, 0, 3, 2, 4], 4: [1, 0, 2, 3]}
    corners[3] = corners[3][mirror[len(shape.vertices)]]
    conversion = convert(Nodes(shape, corners, ids=100 + np.arange(len(corners))))
    assert conversion.report.listed["inverted"] == (103,)
    assert conversion.report.fields[0].state == "exact"
    assert sum(conversion.report.elements.values()) == len(block)


def test_flat_elements_are_converted_and_listed():
    corners = corners_of(grid(Shape.HEXAHEDRON, 2), Shape.HEXAHEDRON).copy()
    corners[5] *= [1, 1, 0]
    report = convert(Nodes(Shape.HEXAHEDRON, corners)).report
    assert report.listed["degenerate"] == (5,)
    assert report.geometry.state == "exact"


def test_elements_with_repeated_vertices_are_converted_and_listed():
    corners = corners_of(one_element(Shape.HEXAHEDRON), Shape.HEXAHEDRON).copy()
    corners[:, [5, 6, 7]] = corners[:, [4]]
    numbers = np.array([[0, 1, 2, 3, 4, 4, 4, 4]])
    report = convert(Nodes(Shape.HEXAHEDRON, corners, numbers)).report
    assert report.listed["degenerate"] == (0,)
    assert report.fields[0].state == "exact"


def test_periodic_numbers_are_distinguished_by_position():
    mesh = grid(Shape.HEXAHEDRON, 3)
    source = Analytic(mesh, {"u": AnalyticField(plain, 1)})
    (block,) = source.blocks
    wrapped = np.where(mesh.vertices[:, 0] > 0.99, np.arange(len(mesh.vertices)) - 3, np.arange(len(mesh.vertices)))
    source.blocks = [replace(block, vertices=wrapped[block.vertices])]
    conversion = convert(source)
    assert len(conversion.dataset.mesh.vertices) == 64
    assert conversion.report.fields[0].state == "exact"


def test_coincident_vertices_with_different_numbers_stay_separate():
    corners = corners_of(grid(Shape.HEXAHEDRON, 2), Shape.HEXAHEDRON)
    numbers = np.arange(corners[..., 0].size).reshape(-1, 8)
    mesh = convert(Nodes(Shape.HEXAHEDRON, corners, numbers)).dataset.mesh
    assert len(mesh.vertices) == 64
    counts = {c.name: len(c.parts[0][1]) for c in mesh.composites[1:]}
    assert counts == {"boundary": 24, NON_CONFORMING: 24}


def test_hanging_nodes_are_converted_element_by_element():
    big, small = np.zeros((1, 8, 3)), np.zeros((4, 8, 3))
    big[0] = (Shape.HEXAHEDRON.vertices + 1) / 2
    for i in range(4):
        small[i] = (Shape.HEXAHEDRON.vertices + 1) / 4 + [1, 0.5 * (i % 2), 0.5 * (i // 2)]
    source = Nodes(Shape.HEXAHEDRON, np.concatenate([big, small]))
    source.is_conforming = False
    report = convert(source).report
    assert report.fields[0].state == "exact"
    assert report.fields[0].is_continuous is False
    assert any("element by element" in note for note in report.notes)


def test_boundaries_by_vertices_and_by_sides_are_the_same_faces():
    mesh = mixed_volume()
    source = Analytic(mesh, {"u": AnalyticField(plain, 1)}, seed=3)
    ends, sides = [], []
    for number, block in enumerate(source.blocks):
        places = mesh.vertices[block.key]
        for face, local in enumerate(block.shape.faces):
            rows = np.flatnonzero((places[:, list(local), 0] == 0).all(axis=1))
            sides.append((number, rows, np.full(len(rows), face)))
            if len(rows):
                ends.append(block.vertices[rows][:, list(local)])
    source.boundaries = [Boundary("one", vertices=ends), Boundary("two", sides=sides)]
    one, two, rest = convert(source).dataset.mesh.composites[-3:]
    assert (one.name, two.name, rest.name) == ("one", "two", "boundary")
    assert one.parts[0][1].tolist() == two.parts[0][1].tolist()
    assert len(one.parts[0][1]) == 1
    assert not set(one.parts[0][1]) & set(rest.parts[0][1])


def test_boundaries_of_no_element_are_reported():
    source = Analytic(mixed_volume(), {})
    source.boundaries = [Boundary("nowhere", vertices=[np.array([[1, 2, 77]])])]
    report = convert(source).report
    assert report.remarks()[1] == ": 1 entries of the boundary 'nowhere' are sides of no element"


def test_nan_values_are_converted_and_listed():
    def spoilt(points):
        return np.where(points[:, :1, 0].min(axis=1, keepdims=True) > 0.4, np.nan, plain(points))

    conversion = convert(Analytic(grid(Shape.HEXAHEDRON, 2), {"u": AnalyticField(spoilt, 1, False)}))
    assert conversion.report.listed["not finite"] == (1, 3, 5, 7)
    assert conversion.report.fields[0].state == "exact"
    (block,) = conversion.dataset.field("u").blocks
    assert np.isfinite(block.coefficients).all(axis=1).sum() == 4


def nothing():
    return Analytic(grid(Shape.HEXAHEDRON, 1), {"u": AnalyticField(plain, 1)})


def without_elements(source):
    source.blocks = [source.blocks[0].take(slice(0, 0))]
    source.blocks = [replace(source.blocks[0], vertices=None)]


def of_two_dimensions(source):
    source.blocks = [*source.blocks, Elements(Shape.TRIANGLE, 1)]


def with_too_few_vertices(source):
    source.blocks = [replace(source.blocks[0], vertices=np.arange(7)[None])]


def with_fields_of_one_name(source):
    source.fields = [*source.fields, *source.fields]


def with_a_reserved_name(source):
    source.fields = [SourceField("map_x", 1, key=plain)]


def with_an_absurd_order(source):
    source.fields = [SourceField("u", 400, key=plain)]


def with_coordinates_that_are_not_numbers(source):
    source.warp = lambda points: points * np.nan


def with_flat_answers(source):
    source.sample = lambda block, field, points: np.zeros(len(points))


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (without_elements, "expected elements to convert, found none"),
        (of_two_dimensions, "expected elements of one dimension, found 2 and 3"),
        (with_too_few_vertices, r"block 0: expected vertices \(1, 8\), found \(1, 7\)"),
        (with_fields_of_one_name, "expected fields of distinct names, found several 'u'"),
        (with_a_reserved_name, "expected no field 'map_x'"),
        (with_an_absurd_order, "field u: expected an order from 0 to 30, found 400"),
        (with_coordinates_that_are_not_numbers, "hexahedron 0: expected finite coordinates"),
        (with_flat_answers, r"sample of u: expected an array of shape \(1, (\d+)\), found \(\1,\)"),
    ],
)
def test_unrepresentable_data_give_a_one_line_error(spoil, sentence):
    source = nothing()
    spoil(source)
    with pytest.raises(ElvisError, match=sentence) as caught:
        convert(source)
    assert "\n" not in str(caught.value)


def test_errors_about_elements_name_the_files():
    source = nothing()
    without_elements(source)
    with pytest.raises(ElvisError, match=r"^a\.mesh, b\.gf: expected elements to convert, found none$"):
        convert(source, files=["a.mesh", "b.gf"])


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"order": 0}, "expected an order from 1 to 30, found 0"),
        ({"order": 31}, "found 31"),
        ({"tolerance": -1.0}, "expected a positive tolerance, found -1.0"),
        ({"geometry": "round"}, "geometry round"),
    ],
)
def test_settings_are_checked(settings, sentence):
    with pytest.raises(ElvisError, match=sentence):
        Settings(**settings)


def test_unknown_fields_are_reported_with_existing_ones():
    with pytest.raises(ElvisError, match="no field 'v'; the fields are u"):
        convert(nothing(), Settings(fields=("v",)))
