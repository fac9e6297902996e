import io

import numpy as np
import pytest

from elvis.core.base.errors import FormatError
from elvis.core.numbers import queries
from elvis.core.numbers.queries import points_in_table, points_on_line, points_on_plane


def test_a_line_includes_its_ends_exactly():
    points = points_on_line((0.1, 0.2, 0.3), (0.7, -0.1, 1e6), 7)
    assert points.shape == (7, 3)
    np.testing.assert_array_equal(points[[0, -1]], [(0.1, 0.2, 0.3), (0.7, -0.1, 1e6)])
    np.testing.assert_allclose(np.diff(points, axis=0), np.tile((0.1, -0.05, (1e6 - 0.3) / 6), (6, 1)), rtol=1e-9)


def test_a_plane_runs_along_u_first():
    points = points_on_plane((1, 0, 0), (2, 0, 0), (0, 3, 0), (3, 2))
    np.testing.assert_array_equal(points, [(1, 0, 0), (2, 0, 0), (3, 0, 0), (1, 3, 0), (2, 3, 0), (3, 3, 0)])


POINTS = [(1.0, 2.0, 3.0), (0.5, -1e-3, 0.25)]


@pytest.mark.parametrize(
    "text",
    [
        "1,2,3\n0.5,-1e-3,0.25\n",
        "1 2 3\n0.5\t-1e-3  0.25",
        "x,y,z\r\n1,2,3\r\n0.5,-1e-3,0.25\r\n",
        "\ufeff# probe\n\n X ; Y ; Z \n1;2;3\n\n0.5;-1e-3;0.25",
        'z,"a,b",y,point,x\n3,9,2,0,1\n0.25,9,-1e-3,1,0.5',
    ],
)
def test_tables_in_many_dresses(tmp_path, text):
    (tmp_path / "points.csv").write_text(text, encoding="utf-8")
    np.testing.assert_array_equal(points_in_table(tmp_path / "points.csv"), POINTS)


@pytest.mark.parametrize(
    ("text", "points"), [("1\n2", [(1, 0, 0), (2, 0, 0)]), ("y,x\n1,2", [(2, 1, 0)]), ("x\n", np.zeros((0, 3)))]
)
def test_missing_coordinates_are_zero(tmp_path, text, points):
    (tmp_path / "points.csv").write_text(text)
    np.testing.assert_array_equal(points_in_table(tmp_path / "points.csv"), points)


def test_points_from_standard_input(monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO("1 2 3\n"))
    np.testing.assert_array_equal(points_in_table("-"), [(1, 2, 3)])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "points.csv: expected at least one point, found none"),
        ("# nothing\n", "points.csv: expected at least one point, found none"),
        ("a,b\n1,2\n", "points.csv: line 1: expected columns x, y, z or numbers, found a, b"),
        ("x,y,X\n1,2,3\n", "points.csv: line 1: expected one column x, found 2"),
        ("1,2,3,4\n", "points.csv: line 1: expected at most 3 columns without a header, found 4"),
        ("x,y\n1,2\n\n1,2,3\n", "points.csv: line 4: expected 2 columns, found 3"),
        ("1,2\n1,two\n", "points.csv: line 2: expected a finite number for y, found 'two'"),
        ("1,2\n1,nan\n", "points.csv: line 2: expected a finite number for y, found 'nan'"),
        ("inf,2\n", "points.csv: line 1: expected a finite number for x, found 'inf'"),
        ("x,y\n1,\n", "points.csv: line 2: expected a finite number for y, found ''"),
    ],
)
def test_faults_are_placed(tmp_path, monkeypatch, text, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "points.csv").write_text(text)
    with pytest.raises(FormatError) as failure:
        points_in_table("points.csv")
    assert str(failure.value) == message


@pytest.mark.parametrize(
    "text", ["1 2 3\r4 5 6\r", "y;x\n# note\n 2; 1\n\n5;4\n", "name,x,y,z\na,1,2,3\n", "x,y\n1_0,2\n", '"1",2\n3,4\n']
)
def test_tables_read_at_once_match_those_read_by_line(tmp_path, monkeypatch, text):
    path = tmp_path / "points.txt"
    path.write_bytes(text.encode())
    found = points_in_table(path)
    monkeypatch.setattr(queries, "_plain_numbers", lambda *_: None)
    assert np.array_equal(found, points_in_table(path))


@pytest.mark.parametrize("content", [b"\x00\xff\xfe\x01", b"\x89PNG\r\n\x1a\n" + bytes(100)])
def test_binary_files_are_rejected(tmp_path, content):
    (tmp_path / "points.csv").write_bytes(content)
    with pytest.raises(FormatError, match="expected columns x, y, z or numbers"):
        points_in_table(tmp_path / "points.csv")


def test_tables_have_at_most_a_million_columns(tmp_path):
    (tmp_path / "a.csv").write_text("x,y" + ",z" * 1_000_000)
    with pytest.raises(FormatError, match=r"line 1: expected at most 1000000 columns, found 1000002"):
        points_in_table(tmp_path / "a.csv")
