import importlib.util
import os
import stat
import subprocess
import sys

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.base.needing import MissingPackageError
from elvis.core.files.columns import csv_lines, write_columns
from elvis.core.files.output import replacing, write_text


def test_the_file_appears_complete_without_leftovers(tmp_path):
    with replacing(tmp_path / "out.csv") as temporary:
        assert temporary.stat().st_dev == tmp_path.stat().st_dev
        assert temporary.name == "out.csv"
        temporary.write_text("half")
        assert not (tmp_path / "out.csv").exists()
    assert (tmp_path / "out.csv").read_text() == "half"
    assert os.listdir(tmp_path) == ["out.csv"]


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt])
def test_a_failure_preserves_the_old_file_without_leftovers(tmp_path, failure):
    (tmp_path / "out.csv").write_text("old")

    def fail():
        with replacing(tmp_path / "out.csv") as temporary:
            temporary.write_text("half")
            raise failure

    with pytest.raises(failure):
        fail()
    assert (tmp_path / "out.csv").read_text() == "old"
    assert os.listdir(tmp_path) == ["out.csv"]


def test_the_mode_is_that_of_the_old_file_or_of_a_new_one(tmp_path):
    old, new, plain = tmp_path / "old", tmp_path / "new", tmp_path / "plain"
    old.write_text("")
    old.chmod(0o640)
    plain.write_text("")
    write_text(old, "x")
    write_text(new, "x")
    assert stat.S_IMODE(old.stat().st_mode) == 0o640
    assert new.stat().st_mode == plain.stat().st_mode


def test_a_link_keeps_its_target(tmp_path):
    (tmp_path / "link").symlink_to("target")
    write_text(tmp_path / "link", "text")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == "text"


@pytest.mark.parametrize(("path", "reason"), [("no/out.csv", "there is no folder"), (".", "it is a folder")])
def test_impossible_paths_are_reported(tmp_path, path, reason):
    with pytest.raises(ElvisError, match=reason):
        write_text(tmp_path / path, "")


def test_devices_are_written_directly():
    code = "from elvis.core.files.output import write_text; write_text('/dev/stdout', 'text')"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "text"


def test_open_files_are_not_truncated(tmp_path):
    """Standard output may be a log that others write to."""
    log = tmp_path / "log"
    log.write_text("before\n")
    code = (
        "from elvis.core.files.output import write_text\n"
        "print('one'); write_text('/dev/stdout', 'two\\n'); print('three')"
    )
    with log.open("a") as stream:
        subprocess.run([sys.executable, "-c", code], stdout=stream, check=True)
    assert log.read_text() == "before\none\ntwo\nthree\n"
    assert os.listdir(tmp_path) == ["log"]


@pytest.fixture
def columns():
    random = np.random.default_rng(1)
    values = random.standard_normal(5000) * 10.0 ** random.integers(-300, 300, 5000)
    values[7] = np.nan
    return {"point": np.arange(5000), "u": values, "file": -values, "d(u,x)": values / 3}


def test_archives_read_back_bit_by_bit(tmp_path, columns):
    write_columns(tmp_path / "out.npz", columns)
    with np.load(tmp_path / "out.npz") as archive:
        assert list(archive) == list(columns)
        for name, array in columns.items():
            assert archive[name].dtype == array.dtype
            np.testing.assert_array_equal(archive[name], array)


def test_tables_read_back_bit_by_bit(tmp_path, columns):
    write_columns(tmp_path / "out.csv", columns)
    lines = (tmp_path / "out.csv").read_text().splitlines()
    assert lines[0] == 'point,u,file,"d(u,x)"'
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    np.testing.assert_array_equal(table.T, list(columns.values()))
    assert lines[1].startswith("0,")


def test_an_empty_table_has_its_header():
    assert list(csv_lines({"point": np.arange(0)})) == ["point\n"]


def test_pandas_reads_the_parquet_file(tmp_path):
    pandas = pytest.importorskip("pandas")
    columns = {"point": np.arange(3), "d(u,x)": np.array([0.1, np.nan, 1 / 3]), "over": np.array(["a", "b,c", "d"])}
    if importlib.util.find_spec("pyarrow") is None:
        with pytest.raises(MissingPackageError, match="a Parquet table needs pyarrow, which is not installed"):
            write_columns(tmp_path / "out.parquet", columns)
        return
    write_columns(tmp_path / "out.parquet", columns)
    found = pandas.read_parquet(tmp_path / "out.parquet")
    assert list(found) == list(columns)
    for name, column in columns.items():
        np.testing.assert_array_equal(found[name].to_numpy(column.dtype.type), column)


def test_other_suffixes_are_rejected(tmp_path):
    with pytest.raises(ElvisError, match=r"ends in \.csv, \.npz or \.parquet, found \.xlsx"):
        write_columns(tmp_path / "out.xlsx", {})
    assert not os.listdir(tmp_path)
