"""Runs that are killed, interrupted, or meet a full disk: `python tests/fuzz/interruptions.py [KIND=COUNT ...]`.

    killed       by a signal that no process can take, at a random moment, every other time while it writes
    interrupted  by Ctrl-C, at a random moment
    warm         by Ctrl-C at a random moment of the work, in forked processes that need not import anything
    disks        with random room for the outputs: as root on file systems in memory, else by a limit on file sizes

Each run is a command that writes several files, or a report, where an earlier one has written before.  Afterwards every
input is as it was, every output is the old or the new one, whole, a report is of one piece, and nothing else is there,
or, of a process that was killed, nothing that the next run does not remove.  Without arguments 200 killed runs, 100
interrupted ones, 200 of each command interrupted at work and 200 disks; the exit status is 1 where anything is lost.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import warm

from elvis import Dataset, Shape, write
from elvis.core.files.output import write_text
from elvis.core.testing import approximated, grid

ELVIS = [sys.executable, "-c", "from elvis.plugins.command.command import main; main()"]
PLANE = ["--plane", "0.5,0.5,0.4:0.1,0.2,1", "--device", "reference"]
SEEDS = ["--seeds", "line:0.1,0.1,0.1:0.9,0.9,0.9:5"]
PICTURES = ["-o", "a.png", "-o", "a.npz", "-o", "a.exr", "--save-scene", "a.toml"]
STEPS = ["in/s_0.chk", "in/s_1.chk"]
#: names of commands, what they are told, and in which two ways: for the old outputs, and for the new ones
COMMANDS = {
    "convert": (["in/m.xml", "in/m.fld", "-o", "out/c.xml", "--format", "hdf5"], ["--order", "2"], ["--order", "3"]),
    "export": (["in/m.xml", "in/m.fld", "-o", "out/e.vtu"], ["--order", "1"], ["--order", "2"]),
    "probe": (["in/m.xml", "in/m.fld", "--points", "in/p.csv", "-o", "out/p.npz"], [], ["--field", "u^2"]),
    "render": (
        ["in/m.xml", "in/m.fld", *PLANE, *(f"out/{each}" if "." in each else each for each in PICTURES)],
        ["--size", "40x30"],
        ["--size", "50x40"],
    ),
    "compare": (
        ["in/m.xml", "in/m.fld", *PLANE, "--refinements", "0", "-o", "out/report"],
        ["--size", "20x16"],
        ["--size", "24x18"],
    ),
    "integrate": (["in/m.xml", "in/m.fld", "-o", "out/i.npz"], ["--field", "u"], ["--field", "u^2"]),
    "trace": (
        [
            "in/m.xml",
            "in/m.fld",
            "--seeds",
            "line:0.1,0.1,0.1:0.9,0.9,0.9:5",
            "--velocity",
            "u,0.1,1",
            "-o",
            "out/t.vtp",
        ],
        ["--field", "u"],
        ["--field", "u^2"],
    ),
    "info": (["in/m.xml", "in/m.fld"], [], ["--jacobian"]),
    "norms": (["in/m.xml", "in/m.fld"], [], []),
    "diff": (["in/m.xml,in/m.fld", "in/m.xml,in/m.fld"], [], []),
    "devices": ([], [], ["--caches"]),
    "plugins": ([], [], []),
    "extract": (["in/m.xml", "in/m.fld", "-o", "out/s.stl"], ["--plane", "z=0.3"], ["--plane", "z=0.6"]),
    "average": (["in/m.xml", *STEPS, "-o", "out/m.fld"], [], ["--extrema"]),
    "animate": (["in/m.xml", *STEPS, *PLANE, "-o", "out/a.webp"], ["--size", "20x16"], ["--size", "24x18"]),
    "watch": (
        ["in/m.xml", "in/s_*.chk", *PLANE, "--every", "0.05", "--idle", "0.1", "-o", "out/w.png"],
        ["--size", "20x16"],
        ["--size", "24x18"],
    ),
    "sample": (["wave", "-o", "out", "--overwrite"], [], []),
    "view": (["in/m.xml", "in/m.fld", "--no-browser", "--idle", "0.2"], [], []),
    "help": ([], [], ["geometry"]),
}
COUNTS = {"killed": 200, "interrupted": 100, "warm": 200 * len(COMMANDS), "disks": 200}
#: folders of files that are written one by one: those of a report, and frames
ALONE = ("report/", "-frames/")
#: seconds that Python takes to come to the command, whatever happens until then
START = 0.3
#: seconds that a forked process takes to come to the command
FORK = 0.01


@dataclass
class Case:
    """A command, the files before and after it, and how long it takes; inputs are among them."""

    name: str
    arguments: list[str]
    before: dict[str, bytes]
    after: dict[str, bytes]
    seconds: float
    warm_seconds: float = 0.0

    @property
    def writes(self) -> bool:
        """Whether it writes files, and does more than print."""
        return any(name.startswith("out/") for name in self.after)

    @property
    def changing(self) -> set[str]:
        """The names of its outputs, but for what a report holds besides its mark and its numbers, and for frames."""
        names = {name for name in (*self.before, *self.after) if not any(part in name for part in ALONE)}
        return {name for name in names if self.before.get(name) != self.after.get(name)}


@dataclass
class Tally:
    """What became of the runs: counts by kind of run and ending, and sentences on what should not have happened."""

    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)

    def report(self) -> int:
        """Print counts and faults; returns the exit status."""
        for (kind, ending), count in sorted(self.counts.items()):
            print(f"{kind:12} {count:4}  {ending}")
        print(f"{len(self.faults)} faults", *self.faults, sep="\n  ")
        return 1 if self.faults else 0


def contents(folder: Path) -> dict[str, bytes]:
    """All files below a folder by name."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def fill(folder: Path, files: dict[str, bytes]) -> None:
    """Write files below a folder."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def inputs(folder: Path) -> None:
    """A small mesh with a field, points, and a place for outputs."""
    (folder / "in").mkdir()
    (folder / "out").mkdir()
    bare = Dataset(grid(Shape.HEXAHEDRON, 3))
    data = replace(bare, fields=(approximated(bare, "u", lambda x: x[:, 0] * x[:, 1] ** 2, 4),))
    write(data, folder / "in" / "m.xml")
    for number in range(2):
        write(replace(data, time=float(number)), folder / "in" / "m.xml", folder / "in" / f"s_{number}.chk")
    points = "".join(f"{i / 999!r},0.5,0.25\n" for i in range(1000))
    (folder / "in" / "p.csv").write_text(f"x,y,z\n{points}")


def cases(names: list[str]) -> list[Case]:
    """The commands, run twice without trouble: with what they are told for the old outputs, then for the new ones."""
    found = []
    for name in names:
        shared, old, new = COMMANDS[name]
        with TemporaryDirectory() as place:
            folder = Path(place)
            inputs(folder)
            subprocess.run([*ELVIS, name, *shared, *old], cwd=folder, check=True, stdout=subprocess.DEVNULL)
            before = contents(folder)
            start = time.perf_counter()
            subprocess.run([*ELVIS, name, *shared, *new], cwd=folder, check=True, stdout=subprocess.DEVNULL)
            seconds = time.perf_counter() - start
            found.append(Case(name, [*shared, *new], before, contents(folder), seconds))
    return found


def begun(case: Case, folder: Path, **options: object) -> subprocess.Popen[str]:
    """The command, running in a folder."""
    command = [*ELVIS, case.name, *case.arguments]
    pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, cwd=folder, **pipes, **options)


def check(case: Case, folder: Path, tally: Tally, what: str, is_unit: bool) -> str:
    """Whether the outputs are old or new; faults are noted.

    is_unit  whether they must all be of one kind
    """
    found = {name: text for name, text in contents(folder).items() if "/.elvis-" not in name}
    strange = set(found) - set(case.before) - set(case.after)
    faults = [f"{name} should not be there" for name in strange]
    kinds = set()
    single = {name for name in case.before if any(part in name for part in ALONE)}
    for name in sorted(case.changing | set(case.before) - single):
        if found.get(name) not in (case.before.get(name), case.after.get(name)):
            faults.append(f"{name} is neither old nor new")
        elif name in case.changing:
            kinds.add("old" if found.get(name) == case.before.get(name) else "new")
    if case.name == "compare":
        kinds.add(_report(case, found, faults))
    if len(kinds) != 1 and is_unit and case.changing:
        faults.append(f"outputs are {' and '.join(sorted(kinds))}")
    tally.faults += [f"{case.name} {what}: {fault}" for fault in faults]
    return " and ".join(sorted(kinds))


def _report(case: Case, found: dict[str, bytes], faults: list[str]) -> str:
    """Which of two reports stands there: its own files are all there and whole, those of the other are not."""
    numbers = found.get("out/report/summary.json")
    kind = {case.before["out/report/summary.json"]: "old", case.after["out/report/summary.json"]: "new"}.get(numbers)
    if kind is None:
        faults.append("there is no whole report")
        return "none"
    wanted = case.before if kind == "old" else case.after
    listed = {f"out/report/{name}" for name in json.loads(found["out/report/report.json"])["files"]}
    present = {name for name in found if name.startswith("out/report/")}
    if listed != present:
        faults.append(f"the report lists {len(listed)} files, and {len(present)} are there")
    timed = ("times.", "index.html")  # no two runs write the same
    torn = [name for name in listed if not any(t in name for t in timed) and found.get(name) != wanted.get(name)]
    faults += [f"{name} is not of the {kind} report" for name in torn]
    return kind


def killed(case: Case, folder: Path, dice: random.Random, tally: Tally) -> None:
    """A run that no signal handler ends; the next one cleans up."""
    at = dice.uniform(0, 1.05 * case.seconds)
    is_writing = dice.random() < 0.5
    process = begun(case, folder)
    if is_writing:
        while process.poll() is None and not any((folder / "out").glob(".elvis-*")):
            time.sleep(0.0005)
        time.sleep(dice.uniform(0, 0.1))
    else:
        time.sleep(at)
    process.kill()
    process.communicate()
    kinds = check(case, folder, tally, f"killed {'while writing' if is_writing else f'after {at:.2f} s'}", False)
    left = any((folder / "out").glob(".elvis-*"))
    write_text(folder / "out" / "next", "")
    (folder / "out" / "next").unlink()
    check(case, folder, tally, "killed, then another run", False)
    if any((folder / "out").glob(".elvis-*")):
        tally.faults.append(f"{case.name} killed: the next run leaves what it has left")
    tally.counts["killed", f"{kinds}{', with leftovers, which the next run removes' if left else ''}"] += 1


def interrupted(case: Case, folder: Path, dice: random.Random, tally: Tally) -> None:
    """A run that is told to stop: it does, with a sentence, or had come to its end."""
    at = dice.uniform(START, max(START, case.seconds))
    process = begun(case, folder, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))
    time.sleep(at)
    _interrupt(process, case, folder, tally, "interrupted", at)


def warmed(case: Case, folder: Path, dice: random.Random, tally: Tally) -> None:
    """The same while it works, of a process that need not import anything."""
    at = dice.uniform(FORK, max(FORK, 1.02 * case.warm_seconds))
    process = warm.Warm([case.name, *case.arguments], folder)
    time.sleep(at)
    _interrupt(process, case, folder, tally, "warm", at)


def _interrupt(
    process: subprocess.Popen[str] | warm.Warm, case: Case, folder: Path, tally: Tally, kind: str, at: float
) -> None:
    """Interrupt a process, and check how it ends and what it leaves."""
    process.send_signal(signal.SIGINT)
    lines = process.communicate()[1].strip().splitlines()
    what = f"{kind} after {at:.3f} s"
    told = [line for line in lines if not line.startswith("elvis: note: ")]
    if (process.returncode, told) not in ((0, []), (130, ["elvis: error: interrupted"])):
        tally.faults.append(f"{case.name} {what}: status {process.returncode}, {lines}")
    kinds = check(case, folder, tally, what, True)
    _check_clean(case, folder, tally, what)
    tally.counts[kind, f"{case.name}: status {process.returncode}, {kinds}"] += 1


def disks(case: Case, folder: Path, dice: random.Random, tally: Tally) -> None:
    """A run that has too little room, or just enough: it names the file, or all is well."""
    pages = sum(-(-len(text) // 4096) for name, text in case.after.items() if name.startswith("out/"))
    room = int(dice.uniform(0, 1.1 * 4096 * pages))
    options = {} if limit_disk(folder, room) else {"preexec_fn": lambda: limit_files(room // 4)}
    process = begun(case, folder, **options)
    said = process.communicate()[1]
    what = f"with room for {room} bytes"
    full = [reason for reason in ("No space left on device", "File too large", "could not write all") if reason in said]
    names_output = "out/" in said and said.startswith("elvis: error: ") and said.count("\n") == 1
    if process.returncode not in (0, 1) or (process.returncode == 1 and not (full and names_output)):
        tally.faults.append(f"{case.name} {what}: status {process.returncode}, {said!r}")
    kinds = check(case, folder, tally, what, True)
    if (process.returncode == 0) != (kinds == "new"):
        tally.faults.append(f"{case.name} {what}: status {process.returncode}, but the outputs are {kinds}")
    _check_clean(case, folder, tally, what)
    tally.counts["disks", f"status {process.returncode}, {kinds}"] += 1


def _check_clean(case: Case, folder: Path, tally: Tally, what: str) -> None:
    if any((folder / "out").glob(".elvis-*")):
        tally.faults.append(f"{case.name} {what}: a scratch folder is left")


def limit_disk(folder: Path, room: int) -> bool:
    """Leave so much room on the file system in memory that is mounted there; False where none is."""
    if not os.path.ismount(folder):
        return False
    used = os.statvfs(folder)
    size = (used.f_blocks - used.f_bfree) * used.f_frsize + room
    subprocess.run(["mount", "-o", f"remount,size={size}", folder], check=True)
    return True


def limit_files(size: int) -> None:
    """Let no file of this process become larger."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


@contextmanager
def place_for(kind: str):
    """A folder for one run; of a disk with a file system of its own, where that may be."""
    with TemporaryDirectory() as place:
        mount = ["mount", "-t", "tmpfs", "-o", "size=256m", "elvis", place]
        is_mounted = kind == "disks" and not os.geteuid() and not subprocess.run(mount, capture_output=True).returncode
        try:
            yield Path(place)
        finally:
            if is_mounted:
                subprocess.run(["umount", place], check=True)


def measure_warm(case: Case) -> None:
    """Import here what the command needs, and measure how long a forked process takes."""
    for _ in range(2):
        with TemporaryDirectory() as place:
            fill(Path(place), case.before)
            start = time.perf_counter()
            warm.inherit([case.name, *case.arguments], Path(place))
            case.warm_seconds = time.perf_counter() - start


KINDS = {"killed": killed, "interrupted": interrupted, "warm": warmed, "disks": disks}


def run(counts: dict[str, int], seed: int, names: list[str]) -> Tally:
    """This many runs of each kind, the commands in turn."""
    every, tally = cases(names), Tally()
    for kind, count in counts.items():
        dice = random.Random(f"{kind} {seed}")
        # what only prints loses nothing when it is killed or a disk is full
        chosen = [case for case in every if case.writes or kind in ("interrupted", "warm")]
        for case in chosen if kind == "warm" else ():
            measure_warm(case)
        for number in range(count):
            case = chosen[number % len(chosen)]
            with place_for(kind) as folder:
                fill(folder, case.before)
                KINDS[kind](case, folder, dice, tally)
            if sys.stderr.isatty():
                print(f"\r{kind} {number + 1} of {count}, {len(tally.faults)} faults", end="", file=sys.stderr)
    return tally


def main() -> int:
    """The table of what became of all runs, and what should not have happened."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--commands", default=",".join(COMMANDS), help="names with commas between them")
    parser.add_argument("counts", nargs="*", metavar="KIND=COUNT", help=", ".join(COUNTS))
    given = parser.parse_args()
    counts = {kind: int(count) for kind, count in (each.split("=") for each in given.counts)} or COUNTS
    return run(counts, given.seed, given.commands.split(",")).report()


if __name__ == "__main__":
    if shutil.which("mount") is None:
        print("there is no mount: limits on file sizes stand for full disks", file=sys.stderr)
    sys.exit(main())
