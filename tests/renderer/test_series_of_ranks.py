"""Commands on series that several ranks run: each reads its part of the steps, and what comes out is that of one."""

import json
import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest
from archives import arrays_of

from elvis import Dataset, write
from elvis.core.base.errors import FormatError
from elvis.core.data.dataset import Field
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.core.testing.played_ranks import played
from elvis.formats.nektar import fields_input
from elvis.plugins.command.command import elvis
from elvis.plugins.command.running import Settings
from elvis.plugins.data import data as data_module
from elvis.plugins.series import series as series_module

CUT = ("--plane", "0.5,0.45,0.52:0.3,0.2,1", "--size", "48x64")


def run(*arguments, size=1, of_rank=lambda rank: ()):
    """A command by so many ranks; ``of_rank``: words that each has for itself."""

    def work(ranks):
        words = [str(word) for word in (*arguments, *of_rank(ranks.rank))]
        elvis.main(words, prog_name="elvis", standalone_mode=False, obj=Settings(False, ranks))

    if size == 1:
        elvis.main([str(word) for word in arguments], prog_name="elvis", standalone_mode=False, obj=Settings(False))
    else:
        played(size, work)


def function(time):
    return lambda p: np.sin(2.0 * p[:, 0] + p[:, 1] + time) * np.cos(3.0 * p[:, 2] - time)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Steps of two fields, HDF5 (h), XML (x) and VTK (v), which is converted; another solution on the same elements,
    and on others."""
    path = tmp_path_factory.mktemp("steps")
    bare = Dataset(curved(grid(Shape.TETRAHEDRON, 1), ripple(0.05), 3))
    for kind, options in {"h": {"mesh_format": "hdf5", "field_format": "hdf5"}, "x": {}}.items():
        write(bare, path / f"{kind}.xml", **options)
        (path / f"{kind}.fld").unlink(missing_ok=True)
        for number, time in enumerate((0.0, 0.5, 1.0)):
            fields = [approximated(bare, name, function(time + more), 4) for name, more in (("u", 0.0), ("v", 0.7))]
            write(Dataset(bare.mesh, tuple(fields), time), field_path=path / f"{kind}_{number}.chk", **options)
    for number in range(3):
        elvis.main(
            ["export", *map(str, [path / "x.xml", path / f"x_{number}.chk", "-o", path / f"v_{number}.vtu"])],
            standalone_mode=False,
        )
    entries = "".join(f'<DataSet timestep="{number / 2}" file="v_{number}.vtu"/>' for number in range(3))
    (path / "v.pvd").write_text(f'<VTKFile type="Collection"><Collection>{entries}</Collection></VTKFile>')
    for name, mesh in {"ref": bare.mesh, "apart": grid(Shape.HEXAHEDRON, 1)}.items():
        field = approximated(Dataset(mesh), "u", function(0.3), 3)
        write(Dataset(mesh, (field,)), path / f"{name}.xml", path / f"{name}.fld")
    return path


@pytest.fixture
def parts_alone(monkeypatch):
    """Nothing is read whole."""

    def never(*_, **__):
        raise AssertionError("a rank reads the whole")

    for module, name in ((data_module, "state_of"), (series_module, "read_native"), (series_module, "with_fields")):
        monkeypatch.setattr(module, name, never)
    return monkeypatch


def steps(folder, kind):
    if kind == "v":
        return [folder / "v.pvd"]
    return [folder / f"{kind}.xml", *sorted(folder.glob(f"{kind}_?.chk"))]


def beside(folder, name="ref"):
    return ("--other", f"ref={folder / name}.xml,{folder / name}.fld")


PICTURES = {
    "the last step": ("h", 3, ("--field", "v"), None),
    "between steps": ("x", 2, ("--field", "d(u,t)+v", "--time", "0.3", "--between", "cubic"), None),
    "converted": ("v", 3, ("--field", "u+v", "--time", "0.3"), None),
    "a range over all": ("h", 2, ("--field", "u-ref:u", "--step", "1", "--range", "series"), "ref"),
    "other elements": ("h", 2, ("--field", "u-ref:u+d(v,t)", "--step", "1"), "apart"),
}


@pytest.mark.sampled(least=3, free=("name",))
@pytest.mark.parametrize("name", PICTURES)
def test_pictures_of_a_moment(folder, name, tmp_path, parts_alone):
    kind, size, words, other = PICTURES[name]
    command = ["render", *CUT, *words, *steps(folder, kind), *(beside(folder, other) if other else ())]
    run(*command, "-o", tmp_path / "ranks.png", "-o", tmp_path / "ranks.npz", size=size)
    parts_alone.undo()
    run(*command, "-o", tmp_path / "one.png", "-o", tmp_path / "one.npz")
    for suffix in ("png", "npz"):
        assert (tmp_path / f"ranks.{suffix}").read_bytes() == (tmp_path / f"one.{suffix}").read_bytes()


FILMS = {
    "of moments": ("h", 3, ("--times", "0:1:3", "--range", "series")),
    "of one state": ("x", 1, ("--key", "plane.point[2]=0.4:0.6", "--frames", "2")),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", FILMS)
def test_animations(folder, name, tmp_path, parts_alone):
    """Frames that are there are retained by all ranks."""
    kind, count, words = FILMS[name]
    command = ["animate", *steps(folder, kind)[: count + 1], *words, *CUT]
    run(*command, "-o", tmp_path / "ranks", size=2)
    frames = sorted((tmp_path / "ranks").glob("*.png"))
    frames[1].unlink()
    first = frames[0].stat().st_mtime_ns
    run(*command, "-o", tmp_path / "ranks", size=2)
    assert frames[0].stat().st_mtime_ns == first
    parts_alone.undo()
    run(*command, "-o", tmp_path / "one")
    assert len(frames) == max(count, 2)
    assert [path.read_bytes() for path in frames] == [(tmp_path / "one" / path.name).read_bytes() for path in frames]
    assert (tmp_path / "ranks" / "film.json").read_text() == (tmp_path / "one" / "film.json").read_text()


PRINTED = {
    "info": ("x", "info", "--json", "--field", "d(u,t)+v"),
    "info of a moment beside other data": ("x", "info", "--json", "--time", "0.3", "--field", "u*v-ref:u"),
    "info of what is converted": ("v", "info", "--json", "--field", "d(u,t)+v"),
    "Jacobians": ("h", "info", "--json", "--jacobian"),
    "norms": ("x", "norms", "--json", "--time", "0.7", "--field", "d(u,t)-ref:u"),
    "norms of what is converted": ("v", "norms", "--json", "--time", "0.7"),
}


@pytest.mark.sampled(least=3, free=("name",))
@pytest.mark.parametrize("name", PRINTED)
def test_printed_output(folder, name, parts_alone, capsys):
    kind, *words = PRINTED[name]
    command = [*words, *steps(folder, kind), *(beside(folder) if "ref:u" in words[-1] else ())]
    run(*command, size=3)
    found = capsys.readouterr().out
    parts_alone.undo()
    run(*command)
    assert found == capsys.readouterr().out


TABLES = {
    "probe": ("h", "probe", "--line", "0,0,0:1,1,0.9", "-n", "4", "--times", "0:1:3", "--field", "d(u,t)"),
    "integrate": ("h", "integrate", "--field", "u", "--times", "all"),
    "integrate what is converted": ("v", "integrate", "--field", "u", "--times", "all"),
    "integrate over an element": ("h", "integrate", "--field", "u*nx", "--over", "element:0", "--times", "all"),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", TABLES)
def test_tables_over_times(folder, name, tmp_path, parts_alone):
    """What doesn't come apart the first rank does alone."""
    kind, *words = TABLES[name]
    command = [*words, *steps(folder, kind), "-o"]
    if "element" in name:
        parts_alone.undo()
    run(*command, tmp_path / "ranks.npz", size=3)
    parts_alone.undo()
    run(*command, tmp_path / "one.npz")
    found, wanted = (arrays_of(tmp_path / f"{of}.npz") for of in ("ranks", "one"))
    assert found.keys() == wanted.keys()
    if words[0] == "integrate" and "element" not in name:
        # sums of parts have other rounding
        assert np.allclose(found.pop("value"), wanted.pop("value"), rtol=1e-13)
        assert np.allclose(found.pop("measure"), wanted.pop("measure"), rtol=1e-13)
        assert found.pop("error").max() < 1e-12 > wanted.pop("error").max()
    for key, column in wanted.items():
        assert np.array_equal(found[key], column, equal_nan=column.dtype.kind == "f")


@pytest.mark.parametrize("kind", ["h", "x"])
@pytest.mark.parametrize("size", [1, 2])
def test_fields_of_a_state_that_are_read(folder, kind, size, tmp_path, monkeypatch):
    """Those alone that are requested, by ranks as by one process."""
    read = []

    def noted(make):
        def noting(sections, *rest):
            read.append([name for section in sections if section.values is not None for name in section.space.names])
            return make(sections, *rest)

        return noting

    for name in ("assemble", "assemble_part"):
        monkeypatch.setattr(fields_input, name, noted(getattr(fields_input, name)))
    names = {
        (*("probe", "--point", "0.4,0.3,0.2", "-o", tmp_path / "a.csv"), "--field", "v+1"): ["v"],
        (*("render", *CUT, "-o", tmp_path / "a.png"), "--field", "v"): ["v"],
        ("info", "--jacobian"): [],
        ("info",): ["u", "v"],
    }
    for words, wanted in names.items():
        read.clear()
        run(*words, *steps(folder, kind)[:2], size=size)
        assert [own for own in read if own] == size * [wanted] if wanted else not any(read)


def test_a_step_that_one_rank_cannot_read(folder, tmp_path, capsys):
    """All pass it over, or end where it is requested: the part is named, and nothing is written."""
    shutil.copytree(folder, tmp_path / "damaged")
    with h5py.File(tmp_path / "damaged" / "h_2.chk", "r+") as file:
        values = file["NEKTAR/DATA"][()]
        del file["NEKTAR/DATA"]
        file["NEKTAR/DATA"] = values[1:]
    command = ("probe", "--point", "0.4,0.3,0.2", "-o", tmp_path / "a.csv")
    own = {0: steps(folder, "h"), 1: steps(tmp_path / "damaged", "h")}
    with pytest.raises(FormatError, match=r"part 2 of 2: .*h_2\.chk"):
        run(*command, "--step", "2", size=2, of_rank=own.get)
    assert not list(tmp_path.glob("*.csv"))
    run(*command, size=2, of_rank=own.get)
    assert "h_2.chk can't be read and is skipped: part 2 of 2: " in capsys.readouterr().err
    run("probe", "--point", "0.4,0.3,0.2", "-o", tmp_path / "b.csv", "--step", "1", *steps(folder, "h"))
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_ranks_under_mpiexec(folder, started):
    command = ["probe", *(path.name for path in steps(folder, "h")), "--point", "0.4,0.3,0.2", "--times", "all"]
    alone, ranks = started.alone(folder, *command), started.ranks(folder, (2, *command))
    assert (ranks.returncode, ranks.stdout, ranks.stderr) == (0, alone.stdout, alone.stderr)
    assert len(alone.stdout.splitlines()) == 4


@pytest.fixture(scope="module")
def apart(tmp_path_factory):
    """Two steps of eight cubes and a displacement d that is another constant on each."""
    path = tmp_path_factory.mktemp("apart")
    bare = Dataset(grid(Shape.HEXAHEDRON, 2))
    (block,) = approximated(bare, "d", lambda p: np.ones(len(p)), 2).blocks
    shifts = replace(block, coefficients=block.coefficients * 0.1 * np.arange(8)[:, None])
    moved = Dataset(bare.mesh, (Field("d", (shifts,)), approximated(bare, "p", function(0.0), 3)))
    files = [path / "apart.xml", *(path / f"apart_{step}.fld" for step in range(2))]
    for step, own in enumerate(files[1:]):
        write(replace(moved, time=float(step)), None if step else files[0], own)
    return files


DISPLACED = ("--deform", "0,0,d", "--field", "p")
DEFORMED = {
    "a picture": ("render", (*DISPLACED, "--plane", "z=0.5"), "picture.npz"),
    "a film": ("animate", (*DISPLACED, "--scale", "0:1", "--frames", "2"), "frame-00001.png"),
    "a series": ("animate", (*DISPLACED, "--range", "series"), "frame-00000.png"),
    "a complex field": ("render", ("--complex", "E=p,d", "--phase", "30", "--field", "abs(E)"), "picture.npz"),
}


@pytest.mark.parametrize("name", DEFORMED)
def test_pictures_of_deformed_data_and_complex_fields(apart, name, tmp_path):
    """The displacement jumps between elements of one rank and of two."""
    command, words, found = DEFORMED[name]
    for size in (1, 2):
        folder = tmp_path / str(size)
        folder.mkdir()
        out = folder / found if command == "render" else folder
        run(command, *apart, *words, "--faces", "all", "--size", "32", "--plain", "-o", out, size=size)
    assert (tmp_path / "1" / found).read_bytes() == (tmp_path / "2" / found).read_bytes()


def test_sides_at_which_a_displacement_jumps_are_outer_ones_of_all_ranks(apart, capsys):
    run("integrate", *apart, *DISPLACED[:2], "--field", "1", "--over", "all", "--json", size=2)
    total = json.loads(capsys.readouterr().out)[-1]
    # all sides of eight cubes of edge 1/2
    assert total["value"] == pytest.approx(8 * 6 / 4, rel=1e-12)
