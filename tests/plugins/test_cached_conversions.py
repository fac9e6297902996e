"""Cached conversions: reused if nothing changed, checked, and never in the way of the work."""

import dataclasses
import json
import os
import subprocess
import sys
from functools import partial

import numpy as np
import pytest

from elvis import ElvisError, read, write
from elvis.core.portions import Portion
from elvis.core.quantities.needed import needed_fields
from elvis.core.shapes import Shape
from elvis.core.testing.played_ranks import played
from elvis.plugins.conversion import kept_conversions
from elvis.plugins.conversion.converting import convert
from elvis.plugins.conversion.kept_conversions import Work, load_or_convert, part_of_conversion
from elvis.plugins.conversion.plugin import Converter, Elements, SourceField


class Cubes(Converter):
    """Unit cubes side by side, with a field u = slope x; a file next to it may say the slope."""

    format = "cubes"
    made = 0

    @classmethod
    def opens(cls, paths):
        return True

    def __init__(self, paths, times="1"):
        Cubes.made += 1
        facts = json.loads(paths[0].read_text())
        others = [paths[0].parent / name for name in facts.get("others", [])]
        slopes = [facts.get("slope", 0), *(json.loads(path.read_text()) for path in others)]
        self.further_files = None if facts.get("secretive") else others
        self.slope = sum(slopes) * float(times)
        self.blocks = [Elements(Shape.HEXAHEDRON, facts["cubes"])]
        self.fields = [SourceField("u", 1)]

    def positions(self, block, points):
        first = np.arange(len(block))[:, None, None] if block.rows == slice(None) else np.arange(99)[block.rows]
        low = np.reshape(first, (-1, 1, 1)) * [1.0, 0.0, 0.0]
        return low + (1 + points) / 2

    def sample(self, block, field, points):
        return self.slope * self.positions(block, points)[..., 0]


class Secretive(Cubes):
    """The same under another name."""


class Pairs(Cubes):
    """The same with a second field, v = -u."""

    def __init__(self, paths):
        super().__init__(paths)
        self.fields = [SourceField("u", 1), SourceField("v", 1)]

    def sample(self, block, field, points):
        return super().sample(block, field, points) * (1 if field.name == "u" else -1)


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "elvis" / "conversions"


@pytest.fixture
def case(tmp_path):
    def write_case(name="a.json", folder=tmp_path, **facts):
        folder.mkdir(exist_ok=True)
        (folder / name).write_text(json.dumps({"cubes": 2, **facts}))
        return folder / name

    return write_case


def same(one, other):
    """Whether two things hold the same, in the same order, to the last bit."""
    if dataclasses.is_dataclass(one):
        names = [field.name for field in dataclasses.fields(one)]
        return type(one) is type(other) and all(same(getattr(one, name), getattr(other, name)) for name in names)
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    if isinstance(one, (tuple, list)):
        return len(one) == len(other) and all(map(same, one, other))
    if hasattr(one, "items"):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    return one == other


def asked(*paths, converter=Cubes, is_kept=True, **keywords):
    """The largest value of the dataset, its remarks but for that on errors, and whether it was made again."""
    before = Cubes.made
    dataset = load_or_convert(Work("cubes", converter, paths, keywords), is_kept)
    (field,) = dataset.fields
    highest = 2 * max(block.coefficients.max() for block in field.blocks)
    assert dataset.remarks[0].startswith(f"{paths[0].name}: converted in memory, exact to the rounding")
    return round(highest / 4, 9), dataset.remarks[1:], Cubes.made - before


def parts(size, *paths, is_kept=True):
    """What each of several ranks has of a conversion, and how often that was made."""
    before, work = Cubes.made, Work("cubes", Cubes, paths, {})
    found = played(size, lambda ranks: part_of_conversion(work, is_kept, ranks))
    return found, Cubes.made - before


@pytest.mark.parametrize("mapped", [kept_conversions._MAPPED, -1])
def test_the_first_conversion_has_the_requested_fields_and_the_second_all(home, case, monkeypatch, mapped):
    monkeypatch.setattr(kept_conversions, "_MAPPED", mapped)
    path = case(slope=3)

    def converted(*texts):
        before, choose = Cubes.made, partial(needed_fields, texts=texts) if texts else None
        found = load_or_convert(Work("pairs", Pairs, (path,), {}, choose=choose))
        return found, "".join(field.name for field in found.fields), Cubes.made - before

    first, *names = converted("v")
    assert names == ["v", 1]
    assert converted("2*v^2")[1:] == ("v", 0)
    # the empty text is the first field of the file, not of the cached data
    assert converted("")[1:] == ("uv", 1)
    # the first conversion, and files next to it, are gone
    assert len({kept.name[:40] for kept in home.iterdir()}) == 1
    assert converted("v")[1:] == converted()[1:] == ("uv", 0)
    assert same(first.field("v"), converted()[0].field("v"))
    assert same(first.mesh, converted()[0].mesh)


@pytest.mark.parametrize("is_kept", [True, False], ids=["cached", "not cached"])
def test_one_rank_converts_and_all_read_their_part(home, case, is_kept):
    path = case(slope=3, cubes=7)
    found, count = parts(3, path, is_kept=is_kept)
    assert (count, len(list(home.iterdir()) if is_kept else [])) == (1, 1 if is_kept else 0)
    whole = load_or_convert(Work("cubes", Cubes, (path,), {}), is_kept)
    for number, own in enumerate(found):
        expected = Portion.of_whole(whole, number, 3)
        assert same(own, expected)
    assert parts(3, path, is_kept=is_kept)[1] == (0 if is_kept else 1)


def test_ranks_without_a_shared_cache_convert_separately(home, case, monkeypatch):
    """As where temporary folders are those of several machines, or full."""
    monkeypatch.setattr(kept_conversions, "_written", lambda work, is_kept, folder: None)
    path = case(slope=3)
    found, count = parts(2, path, is_kept=False)
    assert count == 2
    whole = load_or_convert(Work("cubes", Cubes, (path,), {}), False)
    assert all(same(own, Portion.of_whole(whole, number, 2)) for number, own in enumerate(found))


def test_a_conversion_is_found_again(home, case):
    path = case(slope=3)
    first = asked(path)
    assert first[1:] == ((), 1)
    assert [each.suffix for each in home.iterdir()] == [".conversion"]
    assert asked(path) == (first[0], (), 0)


def test_mapped_conversions_equal_others(home, case, monkeypatch):
    """As large ones are, and where their native files can't be read."""
    work = Work("cubes", Cubes, (case(slope=3),), {})
    expected = load_or_convert(work, False)
    monkeypatch.setattr(kept_conversions, "_MAPPED", -1)
    found = [load_or_convert(work) for _ in range(2)]

    def unreadable(*paths):
        raise ElvisError("expected a native file")

    monkeypatch.setattr(kept_conversions, "read", unreadable)
    found.append(load_or_convert(work, False))
    for dataset in found:
        (own,), (block,) = dataset.fields[0].blocks, expected.fields[0].blocks
        assert np.array_equal(own.coefficients, block.coefficients)
        assert dataset.remarks == expected.remarks


def test_cached_conversions_equal_the_output_of_convert(home, case, tmp_path):
    path = case(slope=3)
    by_hand = read(*write(convert(Cubes([path]), files=[path]).dataset, tmp_path / "by_hand.xml"))
    for is_kept in (False, True, True):
        assert same(
            dataclasses.replace(load_or_convert(Work("cubes", Cubes, (path,), {}), is_kept), remarks=()), by_hand
        )


@pytest.mark.parametrize("change", ["content", "option", "converter", "name", "further file", "code", "not cached"])
def test_changed_files_are_converted_again(home, case, tmp_path, monkeypatch, change):
    path, keywords, converter, is_kept = case(slope=3, others=["b.json"]), {}, Cubes, True
    (tmp_path / "b.json").write_text("2")
    before = asked(path)[0]
    if change == "content":
        case(slope=4, others=["b.json"])
    elif change == "option":
        keywords = {"times": "2"}
    elif change == "converter":
        converter = Secretive
    elif change == "name":
        path = path.rename(tmp_path / "c.json")
    elif change == "further file":
        (tmp_path / "b.json").write_text("7")
    elif change == "code":
        monkeypatch.setattr(kept_conversions, "_code", lambda name: f"{name}, newer")
    else:
        is_kept = False
    after, _, made = asked(path, converter=converter, is_kept=is_kept, **keywords)
    assert made == 1
    assert (after != before) == (change in ("content", "option", "further file"))


def test_neighbouring_files_are_those_of_the_same_folder(home, case, tmp_path):
    """The same file in another folder has other neighbours."""
    found = {}
    for name, slope in (("one", "2"), ("two", "7")):
        path = case(folder=tmp_path / name, slope=3, others=["b.json"])
        (path.parent / "b.json").write_text(slope)
        found[name] = asked(path)
    assert found["one"][0] != found["two"][0]
    assert found["two"][2] == 1


def test_conversions_with_unknown_inputs_are_not_cached(home, case):
    path = case(slope=3, secretive=True)
    assert [asked(path)[2] for _ in range(2)] == [1, 1]
    assert not home.exists()


def test_files_that_change_while_they_are_read_are_not_cached(home, case, monkeypatch):
    path = case(slope=3)
    original = Cubes.__init__

    def slow(self, paths, **keywords):
        original(self, paths, **keywords)
        case(slope=5)

    monkeypatch.setattr(Cubes, "__init__", slow)
    asked(path)
    assert not home.exists()


@pytest.mark.parametrize("damage", ["one bit", "cut short", "empty", "something else"])
def test_damaged_conversions_are_moved_aside_and_regenerated(home, case, damage):
    path = case(slope=3)
    value = asked(path)[0]
    (file,) = home.iterdir()
    whole = file.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 4
    wrong = {"one bit": bytes(flipped), "cut short": whole[:-1], "empty": b"", "something else": b"x" * 1000}[damage]
    file.write_bytes(wrong)
    remark = f"a cached conversion in {home} is damaged: it was moved aside, and the conversion repeated"
    assert asked(path) == (value, (remark,), 1)
    assert file.read_bytes() == whole
    assert file.with_suffix(".damaged").read_bytes() == wrong
    assert asked(path) == (value, (), 0)


def test_long_files_lie_beside_a_cached_conversion_and_are_checked(home, case, monkeypatch):
    monkeypatch.setattr(kept_conversions, "_MAPPED", -1)
    path = case(slope=3)
    value = asked(path)[0]
    (file,) = home.glob("*.fld.conversion")
    whole = file.read_bytes()
    assert asked(path) == (value, (), 0)

    file.write_bytes(whole[:-1] + bytes([whole[-1] ^ 4]))
    remark = f"a cached conversion in {home} is damaged: it was moved aside, and the conversion repeated"
    assert asked(path) == (value, (remark,), 1)
    assert (file.read_bytes(), file.with_suffix(".damaged").exists()) == (whole, True)

    # of what was evicted, only the file itself is missing
    file.unlink()
    assert asked(path) == (value, (), 1)
    assert asked(path) == (value, (), 0)


@pytest.mark.parametrize("place", ["a file", "a device", "a full disk", "no home"])
def test_conversion_works_without_a_writable_cache(case, tmp_path, monkeypatch, place):
    path = case(slope=3)
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null/here" if place == "a device" else str(tmp_path / "a.json"))
    reason = "Not a directory"
    if place == "a full disk":
        reason = "No space left on device"
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

        def full(store, key, *content):
            raise OSError(28, reason)

        monkeypatch.setattr(kept_conversions.Store, "write", full)
    elif place == "no home":
        monkeypatch.delenv("XDG_CACHE_HOME")
        monkeypatch.setenv("HOME", "")
    for _ in range(2):
        _, remarks, made = asked(path)
        assert made == 1
        if place == "no home":
            assert remarks == ()
        else:
            (remark,) = remarks
            assert remark.startswith("conversions can't be cached in ")
            assert remark.endswith(reason)


def test_conversion_works_without_a_temporary_folder(home, case, monkeypatch):
    def none(**_):
        raise FileNotFoundError(2, "No usable temporary directory found")

    monkeypatch.setattr(kept_conversions, "TemporaryDirectory", none)
    assert [asked(case(slope=3))[1:] for _ in range(2)] == [((), 1)] * 2


def test_a_conversion_that_fails_leaves_nothing(home, case):
    with pytest.raises(ElvisError):
        load_or_convert(Work("cubes", Cubes, (case(cubes=0),), {}))
    assert not home.exists()


def test_the_least_recently_used_entries_are_evicted(home, case, monkeypatch):
    files = [case(f"{k}.json", slope=k) for k in range(4)]
    asked(files[0])
    size = next(home.iterdir()).stat().st_size
    monkeypatch.setattr(kept_conversions, "MOST_BYTES", int(2.5 * size))
    for age, file in enumerate(reversed(files), 1):
        asked(file)
        for each in home.iterdir():
            os.utime(each, (each.stat().st_mtime - 100 * age,) * 2)
    assert len(list(home.iterdir())) == 2
    monkeypatch.setattr(kept_conversions, "MOST_BYTES", size // 2)
    asked(case("5.json", slope=5))
    assert not any(asked(case("5.json", slope=5))[2] == 0 for _ in range(2))


PROGRAM = """
import sys
from elvis.plugins import read
dataset = read(sys.argv[1], reader={"nodes": "equispaced"})
print(dataset.fields[0].blocks[0].coefficients.tobytes().hex()[:200], len(dataset.remarks))
"""


@pytest.mark.thorough
def test_processes_that_run_at_the_same_time(home, tmp_path):
    pytest.importorskip("vtk")
    path = tmp_path / "one.vtk"
    points = "0 0 0 1 0 0 0 1 0 0 0 1"
    path.write_text(
        f"# vtk DataFile Version 3.0\none\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n{points}\n"
        "CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\nPOINT_DATA 4\nSCALARS u double\nLOOKUP_TABLE default\n0 1 2 3\n"
    )
    command = [sys.executable, "-c", PROGRAM, str(path)]
    started = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    answers = {process.communicate()[0] for process in started}
    assert [process.returncode for process in started] == [0] * 3
    assert len(answers) == 1
    assert next(iter(answers)).strip().endswith(" 1")
    assert [each.suffix for each in home.iterdir()] == [".conversion"]
