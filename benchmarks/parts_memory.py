"""Greatest anonymous memory of each rank that draws one picture, beside that of one process divided among them.

python benchmarks/parts_memory.py [--cells 56] [--ranks 1,2,4,8] [--memory 1GiB,…] [--folder F]    prints a table

Anonymous memory is what a process has of its own: no pages of mapped files, which the system takes back when it needs
them.  It is looked at a hundred times a second, from outside (Linux).  A device that is software has its memory in the
process, too.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, sleep

from cases import million
from measuring import ENVIRONMENT
from tables import Table, seconds

from elvis.formats import write

ELVIS = [sys.executable, "-c", "from elvis.plugins.command import main; main()"]
MPIEXEC = Path(sys.executable).parent / "mpiexec"
PLANE = ["--plane", "0.5,0.45,0.52:0.3,0.2,1"]
#: seconds between two looks
PAUSE = 0.01
_TICK = 1.0 / os.sysconf("SC_CLK_TCK")


@dataclass
class Run:
    """A command that was run: the greatest anonymous memory in bytes and processor seconds of each process."""

    bytes: dict[int, int] = field(default_factory=dict)
    processor: dict[int, float] = field(default_factory=dict)
    seconds: float = 0.0

    @staticmethod
    def of(command: list[str]) -> Run:
        """Run a command to its end; CalledProcessError where it fails."""
        found, start = Run(), perf_counter()
        with subprocess.Popen(command, env=ENVIRONMENT) as process:
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


def measured(files: list[str], folder: Path, ranks: list[int], memories: list[str]) -> tuple[list[list[str]], bool]:
    """The rows of the table, and whether all pictures are the same."""
    rows, pictures = [], set()
    output = folder / "picture.png"
    render = [*ELVIS, "render", *files, *PLANE, "--size", "1000x1000", "--overwrite", "-o", str(output)]
    whole = 0.0
    for count in ranks:
        run = Run.of([str(MPIEXEC), "-n", str(count), *render] if count > 1 else render)
        whole = whole or count * max(run.bytes.values())
        rows.append(row(f"{count} ranks" if count > 1 else "one process", run, count, whole / count))
        pictures.add(hashlib.sha256(output.read_bytes()).hexdigest())
    for memory in memories:
        run = Run.of([*render, "--memory", memory])
        rows.append(row(f"--memory {memory}", run, 1, whole))
        pictures.add(hashlib.sha256(output.read_bytes()).hexdigest())
    return rows, len(pictures) == 1


def main() -> None:
    """Write the data, draw, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=56, help="along each side of a cube, six tetrahedra each (56)")
    parser.add_argument("--ranks", default="1,2,4,8", help="numbers of processes; whole is by the first (1,2,4,8)")
    parser.add_argument("--memory", default="", help="limits of one process, such as 1GiB,500MB")
    parser.add_argument("--folder", type=Path, help="where the data are kept for the next time, or are")
    asked = parser.parse_args()
    case = million(cells=asked.cells)
    with TemporaryDirectory() as temporary:
        folder = asked.folder or Path(temporary)
        path = folder / "million.xml"
        if not path.exists():
            write(case.dataset(), path, mesh_format="hdf5", field_format="hdf5")
        files = [str(path), str(path.with_suffix(".fld"))]
        ranks = [int(count) for count in asked.ranks.split(",")]
        rows, is_same = measured(files, Path(temporary), ranks, list(filter(None, asked.memory.split(","))))
    columns = ["", "anonymous memory, MB", "whole / K", "the greatest, more", "s", "CPU s of a process"]
    table = Table(f"A plane, {case.label}", columns, rows)
    table.notes.append(f"The pictures are {'the same to the byte' if is_same else 'NOT the same'}.")
    print(table.text())


if __name__ == "__main__":
    main()
