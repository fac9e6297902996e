"""Ranks that see other files of the same name end with an error."""

import os

import pytest

from elvis.core.base.errors import FormatError
from elvis.core.base.ranks import ALONE, number_of_process
from elvis.core.testing.played_ranks import played
from elvis.plugins.command.same_files import check_same_files

BYTES = bytes(range(256)) * 8192


def files_of(tmp_path, contents):
    """A file of the same name for each rank, with its content."""
    found = []
    for rank, content in enumerate(contents):
        folder = tmp_path / str(rank)
        folder.mkdir()
        (folder / "a.fld").write_bytes(content)
        os.utime(folder / "a.fld", (rank, rank))
        found.append([folder / "a.fld"])
    return found


def changed(place):
    content = bytearray(BYTES)
    content[place] ^= 1
    return bytes(content)


def test_equal_files_of_other_times_pass(tmp_path):
    files = files_of(tmp_path, [BYTES] * 3)
    played(3, lambda ranks: check_same_files(files[ranks.rank], ranks))
    check_same_files(files[0], ALONE)


@pytest.mark.parametrize(
    "other", [BYTES[:-1], changed(0), changed(len(BYTES) - 1), b""], ids=["shorter", "head", "end", "empty"]
)
def test_another_size_or_content_ends_all_ranks(tmp_path, other):
    files = files_of(tmp_path, [BYTES, BYTES, other])
    with pytest.raises(FormatError, match=r"part 3 of 3: a\.fld is another file there than at part 1"):
        played(3, lambda ranks: check_same_files(files[ranks.rank], ranks))


def test_folders_are_compared_by_their_files(tmp_path):
    folders = [tmp_path / str(rank) / "mesh_xml" for rank in range(2)]
    for folder, content in zip(folders, (BYTES, changed(5)), strict=True):
        folder.mkdir(parents=True)
        (folder / "P0000000.xml").write_bytes(content)
    with pytest.raises(FormatError, match="part 2 of 2: mesh_xml is another file there than at part 1"):
        played(2, lambda ranks: check_same_files([folders[ranks.rank]], ranks))


@pytest.mark.parametrize(
    ("environment", "number"),
    [({}, 0), ({"PMI_SIZE": "2", "PMI_RANK": "1"}, 1), ({"PMI_RANK": "1"}, 0), ({"PMI_SIZE": "2", "PMI_RANK": "0"}, 0)],
)
def test_the_number_of_a_process(environment, number):
    assert number_of_process(environment) == number
