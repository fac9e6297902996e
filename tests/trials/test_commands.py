"""What new users try on the command line, and what they expect of it: exit status, words, files.

Each trial is a command as a user types it, in a folder with the sample data (examples/generate.py) and files of other
solvers; `$` stands before it.  Beneath it are words that must be among what is said, words with a `!` that must not,
and names of files, with a `>`, that must be there afterwards.  A status other than 0 stands behind the command.
"""

import asyncio
import re
import runpy
import shlex
from dataclasses import dataclass
from pathlib import Path

import pytest

from elvis.plugins.command import command, running

ROOT = Path(__file__).resolve().parents[2]
SOLVERS = ROOT.parent / "shared" / "data" / "solvers"
NEKTAR = ROOT.parent / "shared" / "data" / "nektar"
#: pictures are small, and drawn by NumPy: what is tried are words and files
QUICK = ["--size", "24x24", "--device", "reference"]

TRIALS = """
# The door

$ elvis --help
Commands:
  render
  convert
$ elvis render --help
Data:
Objects:
Colours and lines:
Camera:
Figure:
Output:
$ elvis rendr [2]
there is no command 'rendr'; did you mean render?
$ elvis [0]
Usage: elvis
$ elvis --version
elvis 0.
$ elvis devices
reference
$ elvis plugins
converters
! does not load
$ elvis convert --list
nek

# Files

$ elvis info blocks.xml blocks.fld
wave
! JSON
$ elvis info eddies0.f00000
max error
velocity_x
$ elvis info flow.vtu
max error
$ elvis info case.pyfrm case-00.pyfrs
max error
$ elvis info escher.mesh escher.u.gf
max error
! map_x
$ elvis info shell.h5
EnergyStagnationDensity
$ elvis norms shell.h5
EnergyStagnationDensity
! map_x
$ elvis norms eddies0.f00000 --field speed
speed
converted in memory, exact to the rounding of its numbers
$ elvis norms flow.vtu --json
"L2"
$ elvis norms eddies0.f00000 --no-cache
velocity_y
$ elvis probe eddies0.f00000 --point 1,2 --point 9,9 --field vorticity_z
point,x,y,z,element,status,vorticity_z
nan
$ elvis probe flow.vtu --line 0,0,0:0.8,0,0 -n 5 -o line.csv
> line.csv
$ elvis render eddies0.f00000
> eddies0.png
$ elvis render flow.vtu --faces all --size 12x12 --device reference -o flow.npz
> flow.npz
$ elvis render notes.txt [1]
notes.txt: expected a file of a known format
nek
found a text that begins 'hello'
$ elvis view notes.txt --no-browser [1]
notes.txt: expected a file of a known format
$ elvis info folder [1]
found a folder: pass files from it
$ elvis info nothing.xml [1]
nothing.xml: there is no such file
$ elvis render blocks.fld [1]
also give the mesh file, perhaps blocks.xml
$ elvis info escher.u.gf [1]
give the .mesh file
$ elvis render case.pyfrm case-00.pyfrs case-01.pyfrs
wrote case.png
step 1 of 0 to 1, time 0.02: --step and --time choose others
> case.png
$ elvis info cylinder.xml blocks.fld [1]
expected element 0 to be a triangle as in the mesh
$ elvis convert flow.vtu
wrote flow.xml and flow.fld
> flow.xml flow.fld
$ elvis convert escher.mesh escher.u.gf -o shell
wrote shell.xml and shell.fld
> shell.xml shell.fld
$ elvis convert blocks.xml blocks.fld [1]
not written: it is an input
$ elvis convert flow.vtu -o flow.vtu [2]
.xml
$ elvis render cylinder.xml
the data contain a mesh but no field: elements are shown in one colour
> cylinder.png
$ elvis export blocks.xml blocks.fld -o blocks.foo [2]
expected a name ending in .csv, .dat, .msh, .plt, .pts or .vtu

# The command line

$ elvis render cylinder.xml cylinder.fld --region 0:2,0:2 -o part.png
> part.png
$ elvis render cylinder.xml cylinder.fld --faces all --mesh-lines -o lines.png
> lines.png
$ elvis render blocks.xml blocks.fld --plane 1.5,0.5,0.45:0.1,0.2,1 --zoom 3 -o near.png
> near.png
$ elvis render blocks.xml blocks.fld --camera top -o top.png
> top.png
$ elvis render blocks.xml blocks.fld --camera 0,0,9:0,0,0:0,0,1 -o up.png
> up.png
$ elvis render blocks.xml blocks.fld --camera x --size 9 --device reference -o along.png
> along.png
$ elvis render cylinder.xml cylinder.fld --camera topp [2]
(perhaps top)
$ elvis render cylinder.xml cylinder.fld --field CP [1]
there is no 'CP' (perhaps Cp)
$ elvis render cylinder.xml cylinder.fld --field U [1]
(perhaps u)
$ elvis render cylinder.xml cylinder.fld --colormap virids [1]
unknown colour map 'virids' (perhaps viridis)
$ elvis render cylinder.xml cylinder.fld --field velocity_x -o vx.png
> vx.png
$ elvis norms cylinder.xml cylinder.fld --field velocity_z [1]
velocity_z needs 3 coordinates, and the data have 2
$ elvis norms blocks.xml blocks.fld --field speed [1]
speed needs a velocity
$ elvis render step.xml --faces Wall [1]
faces of 2D data are their elements: expected all, element:NAME, shape:NAME, region:NAME, found 'Wall'
$ elvis norms step.xml --field 'distance(Wal)' [1]
(perhaps Wall)
$ elvis norms step.xml --field 'distance(Wall)'
distance(Wall)
$ elvis render cylinder.xml cylinder.fld --size 10x [2]
expected WIDTHxHEIGHT such as 1000x800, or one number
$ elvis render blocks.xml blocks.fld --plane 9,9,9:0,0,1 [1]
the picture is empty
the domain lies between
$ elvis render bend.xml bend.fld --plane 0,0,0.1:0,0,1 --size 16x16 --device reference -o cut.png
pixels are ambiguous
the plane runs along borders of elements
> cut.png
$ elvis probe blocks.xml blocks.fld [2]
expected one of --points, --point, --line, --plane and --grid
$ elvis render cylinder.xml cylinder.fld -o cylinder.xml [1]
cylinder.xml

# Words of other programs, and everyday ones

$ elvis cylinder.xml cylinder.fld -f Cp --size 12 --device reference -o opened.png
no screen here, so this draws a picture; elvis view DATA serves a page
> opened.png
$ elvis nothing.vtu [1]
nothing.vtu: there is no such file
$ elvis render blocks.xml blocks.fld --slice z=0.45 --cmap turbo --clim 0:1 --size 16 --device reference -o words.png
> words.png
$ elvis render blocks.xml blocks.fld --plane z=0.45 --camera xy --clip x=0.5 -o across.png
> across.png
$ elvis render cylinder.xml cylinder.fld --scalars u --levels 5 --show-edges --window-size 9,9 -o e.png
> e.png
$ elvis render cylinder.xml cylinder.fld --vmin 0 [2]
there is no option --vmin: range holds both ends, LOW:HIGH
$ elvis render cylinder.xml cylinder.fld --contour 5 [2]
contours draws lines, isosurface draws surfaces
$ elvis render blocks.xml blocks.fld --plane z -o middle.png
> middle.png
$ elvis render blocks.xml blocks.fld --plane up [2]
expected POINT:NORMAL or z=VALUE, such as 0,0,0.2:0,0,1 or z=0.2, found 'up'
$ elvis trace cylinder.xml cylinder.fld --seeds 5 --velocity u,v --length 0.2 --tolerance 1e-4 -o five.csv
> five.csv
$ elvis integrate blocks.xml blocks.fld -f 1 --over plane:z=0.45
plane:z=0.45
$ elvis probe blocks.xml blocks.fld --grid 3x2x2 -f wave -f x
point,x,y,z,element,status,wave
11,
$ elvis probe blocks.xml blocks.fld --plane z=0.45 -n 3x2 -f wave -o plane.csv
> plane.csv
$ elvis probe cylinder.xml cylinder.fld --line 1.5,0:4,0 -n 9 -f Cp --plot cp.svg
> cp.svg
$ elvis probe blocks.xml blocks.fld --grid 2x2x2 -f x -o x.nrrd [1]
expected a quantity other than the coordinates

# Figures

$ elvis render cylinder.xml cylinder.fld --field Cp --contours 5:labels --axes --scale-bar --outline -o cp.pdf -o cp.svg
> cp.pdf cp.svg
$ elvis render cylinder.xml cylinder.fld --field Cp --title '$C_p$' --bar unit=Pa,bands=6,position=left -o cp.png
> cp.png
$ elvis render cylinder.xml cylinder.fld --background '#ffffff00' --plain -o clear.png
> clear.png
$ elvis render cylinder.xml cylinder.fld --background black --box -o dark.png
> dark.png
$ elvis render blocks.xml blocks.fld --range 0:1 --bar scale=log [1]
expected a range above zero, found 0 to 1: use two values for the range, or scale=symlog
$ elvis render cylinder.xml cylinder.fld --field Cp --bar scale=symlog,linear=0.1 -o symlog.png
> symlog.png
$ elvis render cylinder.xml cylinder.fld --field '0*u+2' -o two.png
2 everywhere in the picture: one colour
> two.png
$ elvis render cylinder.xml cylinder.fld --field u --save-scene u.toml -o u.png
> u.toml u.png
$ elvis render u.toml v.toml --panels 1x2 -o pair.svg
> pair.svg
$ elvis render cylinder.xml cylinder.fld --set bar.titel=3 [1]
unknown key 'bar.titel', did you mean title?

# Reports

$ elvis compare cylinder.xml cylinder.fld --field Cp --size 24x24 --refinements 0 --validate 0 -o report
Linear elements after 0 refinements
> report/index.html report/summary.json
$ elvis compare u.toml --size 24x24 --refinements 0 --validate 0 --json -o numbers
"conclusion"
"""


@dataclass
class Trial:
    """A command with its arguments, and what is expected of it."""

    arguments: list[str]
    status: int
    words: list[str]
    absent: list[str]
    files: list[str]


def parsed(text):
    """The trials of a text."""
    for block in re.split(r"^\$ elvis", text, flags=re.M)[1:]:
        line, *rest = block.strip().splitlines() if block.strip() else [""]
        rest = [words for words in rest if words.strip() and not words.startswith("# ")]
        line, status = re.fullmatch(r"(.*?) *(?:\[(\d)\])?", line).groups()
        yield Trial(
            shlex.split(line),
            int(status or 0),
            [words.strip() for words in rest if not words.startswith(("!", ">"))],
            [words[1:].strip() for words in rest if words.startswith("!")],
            [name for words in rest if words.startswith(">") for name in words[1:].split()],
        )


EVERY = list(parsed(TRIALS))


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A folder with the sample data, files of other solvers and scenes."""
    if not SOLVERS.is_dir():
        pytest.skip(f"there is no {SOLVERS}")
    folder = tmp_path_factory.mktemp("data")
    runpy.run_path(str(ROOT / "examples" / "generate.py"))["main"](folder)
    solvers = {
        "flow.vtu": "vtk/dealii_shell_p4.vtu",
        "case.pyfrm": "pyfr/mixed3d_p3.pyfrm",
        "case-00.pyfrs": "pyfr/mixed3d_p3-00.pyfrs",
        "case-01.pyfrs": "pyfr/mixed3d_p3-01.pyfrs",
        "escher.mesh": "mfem/escher_p3.mesh",
        "escher.u.gf": "mfem/escher_p3.u.gf",
        "shell.h5": "hopr_flexi/convcurved_N4_State.h5",
        "convcurved_N4_mesh.h5": "hopr_flexi/convcurved_N4_mesh.h5",
    }
    for name, source in solvers.items():
        (folder / name).symlink_to(SOLVERS / source)
    (folder / "step.xml").symlink_to(NEKTAR / "bfs_tq7" / "bfs_tg.xml")
    (folder / "notes.txt").write_text("hello\n")
    (folder / "folder").mkdir()
    (folder / "folder" / "cylinder.xml").symlink_to(folder / "cylinder.xml")
    (folder / "folder" / "blocks.xml").symlink_to(folder / "blocks.xml")
    for name in "uv":
        (folder / f"{name}.toml").write_text(
            f'data = ["cylinder.xml", "cylinder.fld"]\nfield = "{name}"\nsize = [24, 24]\ndevice = "reference"\n'
        )
    return folder


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory):
    """What is converted is retained for all trials of this module, and apart from the user's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def place(data, tmp_path, monkeypatch):
    """A folder of a trial's own in which all data are."""
    for path in data.iterdir():
        (tmp_path / path.name).symlink_to(path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(running, "has_screen", lambda: False)

    # a browser of other tests may have a loop in this thread, beside which commands could not run theirs
    loop = asyncio._get_running_loop()
    asyncio._set_running_loop(None)
    yield tmp_path
    asyncio._set_running_loop(loop)


def completed(arguments):
    """The arguments, those of a drawing command with a small picture and the device that starts at once."""
    draws = arguments[:1] == ["render"] and "--help" not in arguments
    return [*arguments, *(QUICK if draws and "--size" not in arguments else [])]


@pytest.mark.parametrize("trial", EVERY, ids=lambda trial: " ".join(trial.arguments)[:60] or "nothing")
def test_output_and_files(trial, place, capfd):
    for name in trial.files:
        (place / name).unlink(missing_ok=True)
    with pytest.raises(SystemExit) as ended:
        command.main(completed(trial.arguments))
    said = "".join(capfd.readouterr())
    assert (ended.value.code or 0) == trial.status, said
    for words in trial.words:
        assert words in said
    for words in trial.absent:
        assert words not in said
    assert all((place / name).stat().st_size for name in trial.files)
    if trial.status:
        assert said.count("elvis: error:") == 1
        assert "bug in ElVis" not in said


@pytest.mark.parametrize("has_screen", [True, False])
def test_files_alone_open_the_viewer_where_there_is_a_screen_or_options_of_its_server(
    place, monkeypatch, capfd, has_screen
):
    monkeypatch.setattr(running, "has_screen", lambda: has_screen)
    with pytest.raises(SystemExit) as ended:
        command.main(["nothing.vtu", "--no-browser", "--idle", "0.1"])
    said = "".join(capfd.readouterr())
    assert (ended.value.code, "no screen here" in said) == (1, False)
    assert "nothing.vtu: there is no such file" in said


def test_enough_commands_are_listed():
    assert len(EVERY) >= 60
    assert sum(trial.status != 0 for trial in EVERY) >= 20
