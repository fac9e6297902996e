"""Largest anonymous memory of each rank of a command, next to that of one process divided among them.

python benchmarks/parts_memory.py [--cells 56] [--ranks 1,2,4,8] [--memory 1GiB,…] [--of plane,info,…] [--folder F]

Anonymous memory is what a process has of its own: no pages of mapped files, which the system takes back when it needs
them.  It is examined a hundred times a second, from outside (Linux).  A device that is software has its memory in the
process, too.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, sleep

from cases import million
from measuring import ENVIRONMENT
from tables import Table, seconds

from elvis import write

ELVIS = [sys.executable, "-c", "from elvis.plugins.command.command import main; main()"]
MPIEXEC = Path(sys.executable).parent / "mpiexec"
_PLANE = "render --plane 0.5,0.45,0.52:0.3,0.2,1"
#: a velocity that is zero on all walls of the cube
_AT_REST = " ".join(f"--field x*(1-x)*y*(1-y)*z*(1-z)*({own})" for own in ("u-0.5", "x-0.3", "y-0.4"))
#: commands by what they are of
COMMANDS = {
    "plane": _PLANE,
    "info": "info --json",
    "jacobian": "info --json --jacobian",
    "extrema": "info --json --extrema",
    "extrema of polynomials": "info --json --extrema --field u*x-y",
    "extrema by intervals": "info --json --extrema --field max(u,x)",
    "strict": "info --json --strict",
    "critical": "info --json --critical --field u-0.5 --field x-0.3 --field y-0.4",
    "wall": f"info --json --critical --wall all {_AT_REST}",
    "info of packed XML": "info --json",
    "plane of a series": f"{_PLANE} --time 0.3",
    "info of a series": "info --json --time 0.3",
    "probe of a series": "probe --line 0,0,0:1,1,1 -n 20000 --times all",
    "plane beside other data": f"{_PLANE} --field u-0.5*ref:u",
    "plane of distances": f"{_PLANE} --field u+distance(boundary)",
    "plane of jumps": f"{_PLANE} --field jump(u)",
    "norms of jumps": "norms --json --field jump(u)",
    "probe of distances": "probe --line 0,0,0:1,1,1 -n 20000 --field u+distance(boundary)",
}
COLUMNS = ["", "anonymous memory, MB", "whole / K", "the greatest, more", "s", "CPU s of a process"]
#: seconds between two looks
PAUSE = 0.01
_TICK = 1.0 / os.sysconf("SC_CLK_TCK")


@dataclass
class Run:
    """A command that was run: the largest anonymous memory in bytes and processor seconds of each process."""

    bytes: dict[int, int] = field(default_factory=dict)
    processor: dict[int, float] = field(default_factory=dict)
    seconds: float = 0.0

    @staticmethod
    def of(command: list[str], printed: Path) -> Run:
        """Run a command to its end; CalledProcessError where it fails.

        printed  a file for what it prints
        """
        found, start = Run(), perf_counter()
        with printed.open("wb") as file, subprocess.Popen(command, env=ENVIRONMENT, stdout=file) as process:
            while process.poll() is None:
                found.look(process.pid)
                sleep(PAUSE)
        found.seconds = perf_counter() - start
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, command)
        return found

    def look(self, first: int) -> None:
        """Note what the Python processes among a process and those that it started have now."""
        for pid in descendants(first):
            try:
                status = Path(f"/proc/{pid}/status").read_text()
                times = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            values = dict(line.split(":", 1) for line in status.splitlines())
            if values["Name"].strip().startswith("python") and "RssAnon" in values:
                now = 1024 * int(values["RssAnon"].split()[0])
                self.bytes[pid] = max(now, self.bytes.get(pid, 0))
                self.processor[pid] = _TICK * (int(times[11]) + int(times[12]))


def descendants(pid: int) -> Iterator[int]:
    """A process and all that it started, which still run."""
    yield pid
    try:
        threads = list(Path(f"/proc/{pid}/task").iterdir())
        children = " ".join((thread / "children").read_text() for thread in threads).split()
    except OSError:
        return
    for child in children:
        yield from descendants(int(child))


def row(name: str, run: Run, count: int, share: float) -> list[str]:
    """A line of the table of ``count`` ranks; ``share`` is the memory that is compared with."""
    # what a rank itself starts, for a moment, has less than any rank
    ranks = sorted(run.bytes.values())[-count:]
    spent = sorted(run.processor.values())[-count:]
    return [
        name,
        f"{ranks[0] / 1e6:,.0f} to {ranks[-1] / 1e6:,.0f}",
        f"{share / 1e6:,.0f}",
        f"{100 * (ranks[-1] / share - 1):+.0f} %",
        seconds(run.seconds),
        f"{seconds(spent[0])} to {seconds(spent[-1])}",
    ]


def words_of(name: str, folder: Path, output: Path) -> list[str]:
    """A command by its name in COMMANDS, on the data in a folder."""
    stem = "packed" if "packed" in name else "million"
    state, reference = [folder / f"{stem}.{end}" for end in ("xml", "fld")], folder / "reference.fld"
    files = [state[0], *sorted(folder.glob("step_*.chk"))] if "series" in name else state
    other = ["--other", f"ref={state[0]},{reference}"] if "other" in name else []
    words = COMMANDS[name].split()
    drawn = ["--size", "1000x1000", "--overwrite", "-o", str(output)] if words[0] == "render" else []
    return [*ELVIS, *words, *map(str, files), *other, *drawn]


def measured(name: str, folder: Path, output: Path, ranks: list[int], memories: list[str]) -> Table:
    """What a command takes by so many ranks, and whether what comes out is the same."""
    found, command, whole = set(), words_of(name, folder, output), 0.0
    table = Table(f"{name}: {COMMANDS[name]}", COLUMNS)
    for count in ranks:
        run = Run.of([str(MPIEXEC), "-n", str(count), *command] if count > 1 else command, output)
        whole = whole or count * max(run.bytes.values())
        table.rows.append(row(f"{count} ranks" if count > 1 else "one process", run, count, whole / count))
        found.add(hashlib.sha256(output.read_bytes()).hexdigest())
    for memory in memories:
        run = Run.of([*command, "--memory", memory], output)
        table.rows.append(row(f"--memory {memory}", run, 1, whole))
        found.add(hashlib.sha256(output.read_bytes()).hexdigest())
    table.notes.append(f"What comes out is {'the same to the byte' if len(found) == 1 else 'NOT the same'}.")
    return table


def write_data(folder: Path, cells: int) -> str:
    """A state, packed too, three steps of a series, and another solution, unless they are there; what they are."""
    case, hdf5 = million(cells=cells), {"mesh_format": "hdf5", "field_format": "hdf5"}
    path = folder / "million.xml"
    if not path.exists():
        dataset = case.dataset()
        write(dataset, path, **hdf5)
        for number in range(3):
            write(replace(dataset, time=float(number)), field_path=folder / f"step_{number}.chk", **hdf5)
        write(dataset, field_path=folder / "reference.fld", **hdf5)
        write(dataset, folder / "packed.xml", mesh_format="compressed", field_format="xml")
    return case.label


def main() -> None:
    """Write the data, run, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=56, help="along each side of a cube, six tetrahedra each (56)")
    parser.add_argument("--ranks", default="1,2,4,8", help="numbers of processes; whole is by the first (1,2,4,8)")
    parser.add_argument("--memory", default="", help="limits of one process, such as 1GiB,500MB")
    parser.add_argument("--of", default="plane", help=f"some of {', '.join(COMMANDS)}, with commas between (plane)")
    parser.add_argument("--folder", type=Path, help="where the data are kept for the next time, or are")
    asked = parser.parse_args()
    if unknown := [name for name in asked.of.split(",") if name not in COMMANDS]:
        parser.error(f"--of: expected some of {', '.join(COMMANDS)}, found {', '.join(unknown)}")
    with TemporaryDirectory() as temporary:
        folder = asked.folder or Path(temporary)
        print(write_data(folder, asked.cells))
        ranks = [int(count) for count in asked.ranks.split(",")]
        for name in asked.of.split(","):
            memories = list(filter(None, asked.memory.split(",")))
            print(measured(name, folder, Path(temporary) / "picture.png", ranks, memories).text(), flush=True)


if __name__ == "__main__":
    main()
