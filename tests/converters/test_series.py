"""Series: steps found among files, what is left out and told."""

import gc
import re
import weakref
from dataclasses import replace

import h5py
import numpy as np
import pytest

from elvis import Dataset, ElvisError, FormatError, open_series, read, sample, write
from elvis.core.mapping.geometry import geometry
from elvis.core.shapes import Shape
from elvis.core.testing.fields import approximated
from elvis.core.testing.meshes import grid, mixed_plane
from elvis.formats.field_heads import field_head
from elvis.plugins.data.data import Reading
from elvis.plugins.series.series import series_in
from elvis.plugins.testing.steps import polynomial, steps_of, waves

POINTS = np.array([[0.31, 0.22, 0.0], [0.55, 0.71, 0.0], [0.83, 0.4, 0.0]])


def test_steps_are_read_unchanged(tmp_path):
    files = steps_of(tmp_path, [0.0, 0.5, 1.0], waves)
    series = open_series(*files)
    assert len(series) == 3
    for number in (0, 1, 2, -1):
        alone = read(files[0], files[number if number < 0 else number + 1])
        assert np.array_equal(series[number]["u"].blocks[0].coefficients, alone["u"].blocks[0].coefficients)
    with pytest.raises(IndexError, match="expected a step from 0 to 2, found 3"):
        series[3]
    nearest = series.at(0.7, "nearest")
    assert nearest.time == 0.5
    assert nearest.remarks == ("time 0.7: step 1, time 0.5, is the nearest",)
    assert "interpolated in time (linear) between steps 1 to 2" in series.at(0.7).remarks[0]
    with pytest.raises(ElvisError, match=r"expected a time from 0 to 1, found 1\.5"):
        series.at(1.5)
    with pytest.raises(ElvisError, match="expected linear, cubic, nearest between steps, found 'spline'"):
        series.at(0.5, "spline")
    last = read(*files)
    assert last.time == 1.0
    assert last.remarks == ("step 2 of 0 to 2, time 1: --step and --time choose others",)


def test_the_map_of_a_shared_mesh_is_assembled_once(tmp_path):
    series = open_series(*steps_of(tmp_path, [0.0, 1.0], waves))
    first, second = geometry(series[0]), geometry(series.at(0.3))
    assert first is second
    alone = weakref.ref(series[0].mesh)
    del series, first, second
    gc.collect()
    assert alone() is None


def test_steps_are_ordered_by_number_not_by_the_shell(tmp_path):
    files = steps_of(tmp_path, range(11), waves)
    assert open_series(*sorted(files)).times.tolist() == list(range(11))
    assert open_series(files[0], tmp_path / "run_*.chk").times.tolist() == list(range(11))
    with pytest.raises(ElvisError, match="expected files of such names, found none"):
        open_series(files[0], tmp_path / "walk_*.chk")


def test_skipped_steps_are_reported(tmp_path):
    files = steps_of(tmp_path, [0.0, 1.0, 1.0, 0.5, 2.0, 3.0, 4.0, 5.0], waves)
    files[7].write_bytes(files[7].read_bytes()[:-60])
    files[8].write_bytes(b"")
    files.remove(gap := files[5])
    series = open_series(*files)
    assert series.times.tolist() == [0.0, 1.0, 3.0]
    told = {
        "run_6.chk: the file ends before its last tag: the step is skipped",
        "run_7.chk: the field file is incomplete: the step is skipped",
        "run_2.chk: its time, 1, is that of run_1.chk: it is skipped",
        "run_3.chk: its time, 0.5, is before that of run_1.chk, 1: it is skipped",
    }
    assert told <= set(series.remarks)
    assert gap.name == "run_4.chk"
    assert told <= set(series.at(0.4).remarks)


def test_a_series_of_one_step_is_that_step(tmp_path, elvis):
    files = steps_of(tmp_path, [0.5, 1.0], waves)
    whole = files[2].read_bytes()
    for part, fault in ((whole[:-60], "the file ends before its last tag"), (b"", "the field file is incomplete")):
        files[2].write_bytes(part)
        found = read(*files)
        assert found.time == 0.5
        assert found.remarks == (f"run_1.chk: {fault}: the step is skipped",)
    assert "one step, time 0.5" in elvis("info", *files)


def test_invalid_times_are_skipped(tmp_path):
    series = open_series(*steps_of(tmp_path, [0.0, np.nan, None, 3.0], lambda p, t: p[:, 0]))
    assert series.times.tolist() == [0.0, 3.0]
    assert series.remarks[:2] == [
        "run_1.chk: its time is nan: the step is skipped",
        "run_2.chk: it has no time, unlike the others: the step is skipped",
    ]


def test_steps_on_another_mesh_are_skipped(tmp_path, elvis):
    files = steps_of(tmp_path, [0.0, 1.0, 2.0], lambda p, t: polynomial(p, t, 1))
    dataset = Dataset(grid(Shape.QUADRILATERAL, 3))
    field = approximated(dataset, "u", lambda p: p[:, 0], 3)
    write(replace(dataset, fields=(field,), time=1.0), field_path=files[2])
    elvis("average", *files, "-o", tmp_path / "mean.fld")
    mean = sample(read(files[0], tmp_path / "mean.fld"), "u", POINTS)["u"]
    assert np.abs(mean - polynomial(POINTS, 1.0, 1)).max() < 1e-12
    series = open_series(*files)
    assert list(series.readable()) == [0, 2]
    (fault,) = series.told
    assert fault.startswith("run_1.chk can't be read and is skipped: ")
    assert fault.endswith("found 5 elements that the mesh lacks, which other steps don't have")
    # so it is where the step on another mesh is read first
    series = open_series(*files)
    found = series.at(1.2)
    assert found.instant.steps == (0, 2)
    assert np.abs(sample(found, "u", POINTS)["u"] - polynomial(POINTS, 1.2, 1)).max() < 1e-12
    with pytest.raises(FormatError, match="found 5 elements that the mesh lacks, which other steps don't have"):
        open_series(*files)[1]


def test_a_mesh_may_be_a_part_of_that_of_all_steps(tmp_path):
    files = steps_of(tmp_path, [0.0, 1.0], waves)
    dataset = Dataset(grid(Shape.QUADRILATERAL, 3))
    for number, file in enumerate(files[1:]):
        field = approximated(dataset, "u", lambda p: p[:, 0], 3)
        write(replace(dataset, fields=(field,), time=float(number)), field_path=file)
    for step in open_series(*files):
        assert "on 5 elements that are not in the mesh; they are ignored" in step.remarks[0]


def test_both_ends_of_long_series_are_listed(tmp_path, elvis):
    files = steps_of(tmp_path, [0.0], waves)
    text = files[1].read_text()
    for number in range(1, 31):
        (tmp_path / f"run_{number}.chk").write_text(text.replace("<Time>0.0<", f"<Time>{number / 2}<"))
    lines = elvis("info", files[0], tmp_path / "run_*.chk").splitlines()
    assert [line.split()[:3] for line in (lines[1], lines[11], lines[20])] == [
        ["0", "0", "run_0.chk"],
        ["...", "12", "more,"],
        ["30", "15", "run_30.chk"],
    ]
    assert "31 steps, times 0 to 15" in lines


def test_gaps_are_reported(tmp_path):
    files = steps_of(tmp_path, range(6), waves)
    assert open_series(*files[:3], *files[4:]).remarks == ["steps are missing between run_1.chk and run_3.chk"]


def test_damaged_steps_are_skipped(tmp_path):
    files = steps_of(tmp_path, [0.0, 1.0, 2.0, 3.0], lambda p, t: polynomial(p, t, 1))
    text = files[2].read_text()
    files[2].write_text(re.sub(r"(<ELEMENTS[^>]*>).{40}", r"\1", text))
    series = open_series(*files)
    found = series.at(1.5)
    assert np.abs(sample(found, "u", POINTS)["u"] - polynomial(POINTS, 1.5, 1)).max() < 1e-12
    assert found.remarks[0].startswith("run_1.chk can't be read and is skipped: ")
    with pytest.raises(FormatError):
        series[1]
    files[4].write_text(re.sub(r"(<ELEMENTS[^>]*>).{40}", r"\1", files[4].read_text()))
    assert read(*files).time == 2.0


def test_changing_meshes_and_fields_are_not_mixed(tmp_path):
    files = steps_of(tmp_path, [0.0, 1.0], waves)
    dataset = read(files[0], files[1])
    more = (*dataset.fields, replace(dataset.fields[0], name="v"))
    write(replace(dataset, fields=more, time=2.0), field_path=tmp_path / "run_2.chk")
    found = open_series(*files, tmp_path / "run_2.chk").at(1.5)
    assert list(found) == ["u"]
    assert found.remarks[-1] == "fields that differ between steps are skipped: v"


def test_incomplete_steps_are_skipped(tmp_path, elvis, elvis_json):
    """In values over time, integrals, ranges, between steps and at the end; what no step has is a mistake."""
    files = steps_of(tmp_path, [0.0, 0.5, 1.0, 1.5], lambda p, t: polynomial(p, t, 1))
    for file in (files[2], files[4]):
        file.write_text(file.read_text().replace('FIELDS="u"', 'FIELDS="v"'))
    at = ["--point", "0.31,0.22"]
    for how in (["--field", "u"], ["--field", "d(u,t)"], []):
        table = elvis("probe", *files, *at, "--times", "all", *how).splitlines()
        assert [float(line.split(",")[0]) for line in table[1:]] == [0.0, 1.0]
    table = elvis_json("integrate", *files, "--field", "u", "--times", "all")
    assert [row["value"] for row in table] == pytest.approx([0.75, 1.375], abs=1e-12)
    series = series_in(files, Reading(quantities=("u",)))
    found = series.at(0.6)
    assert np.abs(sample(found, "u", POINTS)["u"] - polynomial(POINTS, 0.6, 1)).max() < 1e-12
    assert "run_1.chk is skipped: expression 'u': character 1: there is no 'u'" in found.remarks
    assert series.at_moment().time == 1.0
    for asked in ("all", "0:1:3"):
        with pytest.raises(ElvisError, match="there is no 'w'"):
            elvis("probe", *files, *at, "--field", "w", "--times", asked)


def test_times_within_gaps_are_reported(tmp_path, elvis):
    files = steps_of(tmp_path, [0.0, 0.5, 1.0], waves)
    files[3].write_bytes(files[3].read_bytes()[:-60])
    told = (
        r"expected a time from 0 to 0\.5, found 1 \(run_2\.chk: the file ends before its last tag: the step is skipped"
    )
    with pytest.raises(ElvisError, match=told):
        open_series(*files).at(1.0)
    with pytest.raises(ElvisError, match=told):
        elvis("animate", *files, "--times", "0:1:3", "--range", "series", "-o", tmp_path / "film.webp")
    assert not list(tmp_path.glob("film*"))


def test_empty_folders_are_reported(tmp_path, elvis):
    (folder := tmp_path / "run").mkdir()
    for command in (["info"], ["average", "-o", tmp_path / "x.fld"], ["probe", "--times", "all", "--point", "0,0"]):
        with pytest.raises(ElvisError, match="run: expected files in this folder, found none"):
            elvis(*command, folder)


def test_invalid_step_numbers_are_reported(tmp_path):
    files = steps_of(tmp_path, [0.0, 1.0, 2.0], lambda p, t: polynomial(p, t, 1) if t < 2 else p[:, 0] * np.nan)
    series = open_series(*files)
    told = "step 2 contains values that are not finite, and so do the interpolated values next to it"
    assert told in series.at(1.5).remarks
    assert series.faults == ["step 2, run_2.chk, contains values that are not finite"]
    assert series[2].remarks == ("step 2, run_2.chk, contains values that are not finite",)
    assert told not in series.at(0.5).remarks


def test_times_come_from_names_if_files_state_none(tmp_path):
    files = steps_of(tmp_path, [None, None, None], lambda p, t: p[:, 0])
    series = open_series(*files)
    assert series.times.tolist() == [0.0, 1.0, 2.0]
    assert series.remarks == ["the files contain no times: the numbers in their names are used"]
    assert series.at(0.5).time == 0.5


def test_single_states_are_not_series(tmp_path, elvis):
    files = steps_of(tmp_path, [0.5, 1.0], waves)
    with pytest.raises(FormatError, match="expected at least two steps of a series, found one state"):
        open_series(*files[:2])
    with pytest.raises(ElvisError, match=r"absent\.chk: there is no such file"):
        open_series(files[0], tmp_path / "absent.chk")
    assert read(*files[:2]).remarks == ()
    with pytest.raises(ElvisError, match="expected step 0, as the files contain one state, found 3"):
        elvis("norms", *files[:2], "--step", "3")
    table = elvis("probe", *files[:2], "--point", "0.5,0.5", "--field", "t", "--time", "7")
    assert float(table.splitlines()[1].split(",")[-1]) == 7.0


def test_commands_accept_steps_and_times(tmp_path, elvis, elvis_json):
    files = steps_of(tmp_path, [0.0, 0.5, 1.0], lambda p, t: polynomial(p, t, 1))
    facts = elvis_json("info", *files)
    assert [(step["step"], step["time"]) for step in facts["series"]["steps"]] == [(0, 0.0), (1, 0.5), (2, 1.0)]
    assert facts["time"] == 1.0
    facts = elvis_json("info", *files, "--time", "0.25")
    assert facts["time"] == 0.25
    assert "series" not in facts
    assert "run_1.chk" in elvis("info", *files)
    for options, time in ((["--step", "1"], 0.5), (["--time", "0.3"], 0.3), (["--step", "-3"], 0.0)):
        table = elvis("probe", *files, "--point", "0.31,0.22", "--field", "u", *options)
        value = float(table.splitlines()[1].split(",")[-1])
        assert np.isclose(value, polynomial(POINTS, time, 1)[0], rtol=0, atol=1e-12)
    with pytest.raises(ElvisError, match=r"expected a step or a time, found step 1 and time 0\.3"):
        elvis("norms", *files, "--step", "1", "--time", "0.3")
    with pytest.raises(ElvisError, match="expected a step from 0 to 2, found 3"):
        elvis("norms", *files, "--step", "3")


def test_fields_on_mixed_elements_keep_their_bases(tmp_path):
    mesh = mixed_plane()
    write(Dataset(mesh), tmp_path / "m.xml")
    (tmp_path / "m.fld").unlink(missing_ok=True)
    for number in range(2):
        field = approximated(Dataset(mesh), "u", lambda p, t=number: polynomial(p, t, 1), 3)
        write(Dataset(mesh, (field,), float(number)), field_path=tmp_path / f"{number}.fld", field_format="hdf5")
    found = open_series(tmp_path / "m.xml", tmp_path / "*.fld").at(0.5)
    with h5py.File(tmp_path / "0.fld") as file:
        assert "NEKTAR" in file
    assert [block.expansion for block in found["u"].blocks] == [
        block.expansion for block in read(tmp_path / "m.xml", tmp_path / "0.fld")["u"].blocks
    ]


def test_solutions_of_pyfr_are_steps(solvers, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = solvers / "pyfr"
    files = [folder / "mixed3d_p3.pyfrm", *(folder / f"mixed3d_p3-0{i}.pyfrs" for i in range(2))]
    series = open_series(*files)
    first, last = (read(files[0], file) for file in files[1:])
    assert series.times.tolist() == [first.time, last.time]
    middle = series.at(series.times.mean())
    for name in first:
        for own, one, other in zip(middle[name].blocks, first[name].blocks, last[name].blocks, strict=True):
            mean = (one.coefficients + other.coefficients) / 2
            assert np.allclose(own.coefficients, mean, rtol=0, atol=1e-14 * np.abs(mean).max())
    assert series[0].mesh is series[1].mesh
    assert read(*files).time == last.time


@pytest.mark.parametrize("form", ["xml", "hdf5"])
def test_only_the_fields_of_quantities_are_read_from_steps(tmp_path, form):
    """Fields of one section and of several, in one order of modes each."""
    mesh = mixed_plane(seed=3)
    orders = {"u": 3, "v": 3, "w": 4, "p": 3}
    fields = [approximated(Dataset(mesh), name, lambda x, n=n: x[:, 0] ** n, n) for name, n in orders.items()]
    for step in range(2):
        write(Dataset(mesh, fields, float(step)), tmp_path / "a.xml", tmp_path / f"a_{step}.fld", field_format=form)
    files = [tmp_path / "a.xml", tmp_path / "a_*.fld"]
    whole = open_series(*files)[1]

    def read_for(*quantities):
        found = series_in(files, Reading(quantities=quantities))[1]
        for field in found.fields:
            for one, other in zip(field.blocks, whole[field.name].blocks, strict=True):
                assert np.array_equal(one.coefficients, other.coefficients)
        return [field.name for field in found.fields]

    assert read_for() == ["u", "v", "p", "w"]
    assert read_for("v") == ["v"]
    assert read_for("d(w,t) + x", "u") == ["u", "w"]
    # the first field stands for an empty text, and for none; what is unknown, or of all fields, takes them all
    assert read_for("") == read_for("x + t") == ["u"]
    assert read_for("p + q") == read_for("order") == ["u", "v", "p", "w"]
    assert sorted(read_for("speed")) == ["u", "v", "w"]


def test_reading_stops_after_the_requested_fields(tmp_path, elvis, elvis_json):
    files = steps_of(tmp_path, [0.0, 1.0], waves)
    dataset = read(*files[:2])
    fields = [replace(dataset["u"], name=name) for name in "uv"]
    for number in range(2):
        write(replace(dataset, fields=fields, time=number), field_path=files[1 + number])
    text = files[2].read_text()
    end = text.index("</ELEMENTS>")
    files[2].write_text(text[: end - 4] + text[end:])
    assert series_in(files, Reading(quantities=("u",)))[1].time == 1.0
    with pytest.raises(FormatError, match="ends early"):
        series_in(files, Reading(quantities=("v",)))[1]
    # so it is for all that is asked of steps
    assert open_series(*files).narrowed("u")[1].time == 1.0
    at = ["--point", "0.31,0.22"]
    for times in (["--times", "all"], ["--step", "1"]):
        table = elvis("probe", *files, *at, *times, "--field", "u+t").splitlines()
        assert float(table[-1].split(",")[-1]) == pytest.approx(1.0, abs=1e-12)  # u is zero
        table = elvis_json("integrate", *files, *times, "--field", "u+t")
        assert table[-1]["value"] == pytest.approx(1.0, abs=1e-12)
    assert len(elvis("probe", *files, *at, "--times", "all").splitlines()) == 2
    with pytest.raises(FormatError, match="ends early"):
        elvis("integrate", *files, "--step", "1", "--field", "u", "--clip", "v=0.1")


def test_numbers_replace_a_time_that_all_files_share(tmp_path):
    """But for parts of one state, which hold other Fourier modes."""
    files = steps_of(tmp_path, [2.0, 2.0, 2.0], waves)
    series = open_series(*files)
    assert series.times.tolist() == [0.0, 1.0, 2.0]
    assert series.remarks == ["all files have the time 2: the numbers in their names are used instead"]
    for number, path in enumerate(files[1:]):
        path.write_text(path.read_text().replace("<ELEMENTS ", f'<ELEMENTS HOMOGENEOUSZIDS="{number}" '))
    assert len({field_head(path).mark for path in files[1:]}) == 3
