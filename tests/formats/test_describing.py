"""What datasets show of themselves: the essentials in one line, a table in a notebook."""

from dataclasses import replace
from xml.etree import ElementTree

import pytest

from elvis import Dataset, Field, Shape
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple


@pytest.fixture(scope="module")
def dataset():
    bare = Dataset(curved(mixed_volume(seed=1), ripple(0.02), n=3), time=0.5)
    fields = [approximated(bare, name, lambda x: x[:, 0] * x[:, 2], modes=4) for name in ("p", "u")]
    return replace(bare, fields=tuple(fields))


def test_a_dataset_is_one_line(dataset):
    line = repr(dataset)
    assert line.startswith("<Dataset 3D: ")
    assert "2 prisms, 1 hexahedron" in line
    assert line.endswith("; fields p, u of order 3; time 0.5>")
    assert len(line) < 150


def test_its_parts_are_one_line_each(dataset):
    field = dataset.field("p")
    elements = sum(map(len, field.blocks))
    assert repr(field) == f"<Field p: {elements} elements of order 3>"
    assert repr(dataset.mesh).startswith("<Mesh 3D: ")
    assert "curved edges" in repr(dataset.mesh)
    assert "coefficients each" in repr(field.blocks[0])


@pytest.mark.parametrize(
    ("mesh", "told"),
    [
        (grid(Shape.TETRAHEDRON, 1), "<Dataset 3D: 6 tetrahedra; no fields>"),
        (grid(Shape.QUADRILATERAL, 1), "<Dataset 2D: 1 quadrilateral; no fields>"),
    ],
    ids=["solid", "flat"],
)
def test_data_without_fields_are_described_as_such(mesh, told):
    assert repr(Dataset(mesh)) == told


def test_many_fields_are_counted(dataset):
    many = replace(dataset, fields=tuple(replace(dataset.fields[0], name=f"f{i}") for i in range(40)))
    assert "(40 in all)" in repr(many)
    assert len(repr(many)) < 200


def test_a_notebook_gets_a_table_for_all_names(dataset):
    wild = replace(dataset, fields=(*dataset.fields, Field("<b>&", ())))
    table = ElementTree.fromstring(wild._repr_html_())
    assert [row[0].text for row in table.iter("tr")] == ["field", "p", "u", "<b>&"]
