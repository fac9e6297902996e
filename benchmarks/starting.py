"""Whole processes: the help, and a picture of a small case from files with kernels at hand."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from tempfile import TemporaryDirectory
from typing import Any

from cases import Case, mild
from measuring import Timing
from tables import Table, seconds

from elvis import Shape, write

ELVIS = [sys.executable, "-c", "from elvis.plugins.command.command import main; main()"]
LIMITS = {"elvis --help": 0.3, "elvis render": 3.0}


def measure(device: str, rounds: int) -> dict[str, Any]:
    """Seconds of the commands in turn; the first round, which may compile, doesn't count."""
    case = Case("small", Shape.TETRAHEDRON, cells=3, degree=2, order=4, field=mild)
    with TemporaryDirectory() as folder:
        files = [str(path) for path in write(case.dataset(), Path(folder) / "small.xml")]
        drawn = ["render", *files, "--plane", "0.5,0.5,0.5:0,0,1", "--device", device, "-o", f"{folder}/small.png"]
        commands = {"elvis --help": [*ELVIS, "--help"], "elvis render": [*ELVIS, *drawn]}
        timings = {name: Timing() for name in commands}
        for number in range(rounds + 1):
            for name, command in commands.items():
                run(command, timings[name] if number else Timing())
    return {"case": case.label, "commands": {name: timing.record() for name, timing in timings.items()}}


def run(command: list[str], timing: Timing) -> None:
    """Run a process to its end; processor seconds are its own."""
    before = children()
    timing.run(lambda: subprocess.run(command, check=True, capture_output=True))
    timing.processor[-1] = children() - before


def children() -> float:
    """Processor seconds of all child processes so far."""
    usage = getrusage(RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def table(numbers: dict[str, Any]) -> Table:
    """A row a command."""
    shown = Table("Start-up, whole processes", ["command", "best s", "median s", "CPU s", "limit s", "best / limit"])
    for name, timing in numbers["commands"].items():
        figures = [seconds(timing[key]) for key in ("best", "median", "processor")]
        shown.rows.append([name, *figures, str(LIMITS[name]), f"{timing['best'] / LIMITS[name]:.2f}"])
    shown.notes = [f"The picture: {numbers['case']}, from files to PNG, kernels at hand."]
    return shown
