"""Texts that repeat one small thing many times: memory and time are in proportion to the text."""

import re
import tracemalloc
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from elvis import FormatError, open_series
from elvis.converters.gmf.gmf import Gmf
from elvis.converters.mfem.files import named_attributes
from elvis.converters.mfem.mfem import Mfem
from elvis.converters.vtk import files as vtk_files
from elvis.core.base.arrays import (
    distinct_bits,
    distinct_rows,
    distinct_sides,
    groups,
    rows_by_number,
    rows_of_sides,
    uses_of,
)
from elvis.core.bounds.ranges import value_range
from elvis.core.files.pieces import pieces, substituted
from elvis.core.interfaces.hanging import _Search
from elvis.core.mapping.orientation import local_vertices
from elvis.core.polynomials.interpolation import modified
from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.formats.nektar.composites import composite_ids, parse_tokens
from elvis.formats.nektar.expansions import _Expansions
from elvis.formats.nektar.xml import _without_comments

COUNT = 20_000


def peak_of(work, text):
    """Bytes that work on a text takes at most, after a first time."""
    work(text)
    tracemalloc.start()
    work(text)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


@pytest.mark.parametrize(
    ("work", "text"),
    [
        (parse_tokens, b"T[0] Q[1,2-4] " * COUNT),
        (composite_ids, b"C[0] " * COUNT),
        (lambda text: _without_comments(text, "a.xml"), b"<!---->" * COUNT),
        (lambda text: named_attributes(text, "attribute_sets"), f"attribute_sets\n{COUNT}" + '\n"a" 1 1' * COUNT),
        (lambda text: named_attributes(text, "attribute_sets"), f'attribute_sets\n1\n"a" {COUNT}' + " 1" * COUNT),
    ],
)
def test_memory_is_in_proportion_to_the_text(work, text):
    assert peak_of(work, text) < 25 * len(text)


def test_tokens_of_a_tag_are_one_list():
    found = dict(parse_tokens(b" T[0] Q[5] T[2-4], T[] "))
    assert {tag: own.expand(9).tolist() for tag, own in found.items()} == {"T": [0, 2, 3, 4], "Q": [5]}


def test_sets_name_their_attributes_from_the_smallest_on():
    text = 'attribute_sets\n3\n"all" 3\n1 2 3\n"one" 1 2\n"" 2 3 2\n\nboundary\n"x" 1 1\n'
    assert named_attributes(text, "attribute_sets") == {1: ("all",), 2: ("one", "", "all"), 3: ("", "all")}
    assert named_attributes(text, "bdr_attribute_sets") == {}


def test_substitutions_do_not_depend_on_pieces(monkeypatch):
    text = b"1 2 # 3\n" * 100 + b"4 #"
    comment, line_end = re.compile(rb"#[^\n]*"), re.compile(rb"\n")
    whole = comment.sub(b"", text)
    monkeypatch.setattr("elvis.core.files.pieces._PIECE", 7)
    assert b"".join(pieces(text, line_end)) == text
    assert len(list(pieces(text, line_end))) == 101
    assert substituted(comment, b"", text, line_end) == whole


def test_sides_are_matched_without_a_table_of_them():
    """Tetrahedra of many different faces; the result is that of all rows at once."""
    elements = np.random.default_rng(2).integers(0, 300, (30_000, 4))
    views = [(elements, face) for face in Shape.TETRAHEDRON.faces]
    stacked = np.concatenate([table[:, list(face)] for table, face in views])
    first, which = distinct_sides(views)
    for ours, theirs in zip((first, which), distinct_rows(stacked), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(rows_of_sides(views, first), stacked[first])
    assert peak_of(distinct_sides, views) < 170 * len(elements)


def test_sides_of_many_vertices_are_matched():
    elements = np.random.default_rng(2).integers(0, 3, (1000, 4)) << 30
    views = [(elements, (0, 1, 2, 3)), (elements, (3, 1, 2, 0))]
    np.testing.assert_array_equal(distinct_sides(views)[1], np.tile(distinct_rows(elements)[1], 2))


def test_rows_are_grouped_by_their_numbers():
    numbers = np.random.default_rng(2).integers(-3, 9, 500)
    found = list(rows_by_number(numbers))
    assert [number for number, _ in found] == np.unique(numbers).tolist()
    assert all(np.array_equal(rows, np.flatnonzero(numbers == number)) for number, rows in found)
    assert list(rows_by_number(numbers[:0])) == []


def test_expansions_on_composites_are_those_of_their_elements():
    """Elements of a part of the data may be in several composites, and elements of a composite in several parts."""
    random = np.random.default_rng(2)
    parts = [SimpleNamespace(expansion=name, element_ids=random.permutation(900)[:40]) for name in "abcdef"]
    composites = [SimpleNamespace(id=i, parts=(("A", random.permutation(900)[:15]),)) for i in range(30)]
    mesh = SimpleNamespace(dimension=3, composites=composites)
    found = _Expansions(mesh, [SimpleNamespace(parts=parts[:4]), SimpleNamespace(parts=parts[4:])])
    for one, other in pairwise(composites):
        elements = np.concatenate([one.parts[0][1], other.parts[0][1]])
        wanted = [part.expansion for part in parts if np.isin(part.element_ids, elements).any()]
        assert found.on((one.id, other.id)) == wanted


GMF_MESH = """MeshVersionFormatted 2\nDimension 3\nVertices\n5\n0 0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1 1 1 0
Tetrahedra\n2\n1 2 3 4 1\n5 2 3 4 2\nTriangles\n3\n1 2 3 7\n1 2 4 8\n1 3 4 9\nEnd\n"""
MFEM_MESH = """MFEM mesh v1.0\ndimension\n3\nelements\n2\n1 4 0 1 2 3\n2 4 4 1 2 3
boundary\n3\n7 2 0 1 2\n8 2 0 1 3\n9 2 0 2 3\nvertices\n5\n3\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n"""


@pytest.mark.parametrize(("reader", "text"), [(Gmf, GMF_MESH), (Mfem, MFEM_MESH)])
def test_numbers_name_parts_unless_too_many_differ(tmp_path, monkeypatch, reader, text):
    path = tmp_path / "a.mesh"
    path.write_text(text)
    source = reader([path])
    assert [own.name for own in source.boundaries] == ["boundary7", "boundary8", "boundary9"]
    assert len({block.region for block in source.blocks}) == 2
    assert not source.warnings
    monkeypatch.setattr("elvis.converters.shared.inputs.MOST_PARTS", 2)
    assert not reader([path]).boundaries
    monkeypatch.setattr("elvis.converters.shared.inputs.MOST_PARTS", 1)
    source = reader([path])
    assert [block.region for block in source.blocks] == [""]
    assert sum(map(len, source.blocks)) == 2
    assert [warning.split(" different")[0] for warning in source.warnings] == ["2", "3"]
    assert not source.declared.check(source)


def test_unreadable_steps_of_a_long_series_are_not_all_tried(tmp_path, monkeypatch):
    entries = "".join(f'<DataSet timestep="{i}" file="a.vtu"/>' for i in range(300))
    index = tmp_path / "a.pvd"
    index.write_text(f'<VTKFile type="Collection"><Collection>{entries}</Collection></VTKFile>')
    readings = []
    exists = vtk_files.kind_of

    def counted(path):
        readings.append(path.name)
        return exists(path)

    monkeypatch.setattr(vtk_files, "kind_of", counted)
    vtk_files._files_by_time.cache_clear()
    with pytest.raises(FormatError, match="none among 100 of 300 steps"):
        open_series(index).last_readable()
    assert readings.count("a.vtu") == 100
    assert vtk_files._files_by_time.cache_info().misses == 1


def test_rows_of_small_keys_are_grouped_in_a_table():
    random = np.random.default_rng(2)
    small = random.integers(0, 40, 200_000)
    # the same groups, but too large for a table
    large = small.astype(np.int64) << 40
    for ours, theirs in zip(groups(small), groups(large), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert peak_of(groups, small) < 10 * len(small) < peak_of(groups, large)


def test_ranges_take_memory_for_few_elements_at_a_time():
    """Each end is that of the values themselves: linear functions have it at a vertex."""
    expansion = modified(Shape.TETRAHEDRON, (2, 2, 2))
    coefficients = np.random.default_rng(2).normal(size=(200_000, 4))
    found = value_range([(expansion, coefficients)])
    assert found.maximum == coefficients.max()
    assert found.minimum == coefficients.min()
    assert peak_of(lambda own: value_range([(expansion, own)]), coefficients) < coefficients.nbytes


@pytest.mark.parametrize("kind", [np.int32, np.int64])
def test_rows_of_any_width_and_type_are_told_apart(kind):
    """Also of five columns of 32 bits, which are no whole number of 64-bit ones."""
    rows = np.random.default_rng(5).integers(0, 3, (500, 5)).astype(kind)
    first, which = distinct_bits(rows)
    known = np.unique(rows, axis=0)
    assert len(first) == len(known)
    assert np.array_equal(rows[first[which]], rows)


def test_members_take_32_bits_and_ids_64():
    mesh = grid(Shape.PRISM, 2)
    assert {own.members.dtype for own in mesh.entities.values()} == {np.dtype(np.int32)}
    assert {own.ids.dtype for own in mesh.entities.values()} == {np.dtype(np.int64)}
    assert local_vertices(mesh, Shape.PRISM).dtype == np.int32


def test_numbers_of_pairs_exceed_32_bits():
    """Sides of large meshes have 32-bit numbers, and codes of pairs of them need more."""
    great = np.array([2**31 - 2], np.int32)
    search = _Search.__new__(_Search)
    search.sides = range(2**31 - 1)
    assert search._code(great, great).tolist() == [(2**31 - 2) * (2**31 - 1) + 2**31 - 2]


def test_uses_are_counted_without_copies():
    rows = np.random.default_rng(6).integers(0, 1000, (200_000, 3)).astype(np.int32)
    assert np.array_equal(uses_of(rows, 1001), np.bincount(rows.reshape(-1), minlength=1001))
    tracemalloc.start()
    uses_of(rows, 1001)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < rows.nbytes
