"""Texts that repeat one small thing many times: memory and time are in proportion to the text."""

import re
import tracemalloc

import numpy as np
import pytest

from elvis.converters.mfem_files import named_attributes
from elvis.core.arrays import distinct_rows, distinct_sides, rows_of_sides
from elvis.core.files.pieces import pieces, substituted
from elvis.core.shapes import Shape
from elvis.formats.nektar.composites import composite_ids, parse_tokens
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
