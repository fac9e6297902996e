"""Inputs with a lot of one kind: ``python tests/fuzz/large.py [--points 10000000] [--fields 100000]``.

A table of ten million points, files with a hundred thousand fields, expressions of a hundred thousand characters.  Each
command ends with status 0, or with one sentence; its memory stays below 20 times the files and 300 MB.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from interruptions import ELVIS

from elvis import Dataset, Shape, write
from elvis.core.testing import approximated, grid

#: bytes of memory for each byte of the files, and in addition, of the rule for readers
PER_BYTE, BASE = 20, 300 << 20
#: lines that a command without an error prints at most
MOST_NOTES = 10
#: words of a command that a line of the report shows
SHOWN = 8
#: expressions of many characters
LONG = ("u" * 90_000, "u" + "+u" * 45_000, "(" * 90_000, "1" * 90_000, "'" + "a" * 90_000 + "'", "d(" * 30_000)


@dataclass(frozen=True)
class Outcome:
    """How a command ended, what it printed as errors and notes, its peak memory in bytes and processor seconds."""

    status: int
    text: str
    memory: int
    seconds: float


def outcome_of(folder: Path, words: Sequence[str]) -> Outcome:
    """Run a command in a folder."""
    # a cached conversion would hide the cost of the first one
    with TemporaryDirectory() as cache:
        process = subprocess.Popen(
            [*ELVIS, *words],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "XDG_CACHE_HOME": cache},
        )
        text = process.stderr.read() if process.stderr else ""
        _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return Outcome(process.returncode, text, usage.ru_maxrss << 10, usage.ru_utime + usage.ru_stime)


def run(folder: Path, files: Sequence[str], words: Sequence[str], base: int = BASE) -> str:
    """Run a command; its end, seconds and memory, and FAULT if it breaks the rule.

    base  bytes of memory in addition to those for the files
    """
    paths = [own for name in files for own in (folder / name, *(folder / name).rglob("*"))]
    size = sum(path.stat().st_size for path in paths if path.is_file())
    found = outcome_of(folder, words)
    lines = found.text.splitlines()
    # notes on what was converted precede an end that is good, and one sentence an error
    most_lines = {0: MOST_NOTES, 1: 1}.get(found.status, 0)
    limit = PER_BYTE * size + base
    is_good = found.memory <= limit and found.status <= len(lines) <= most_lines
    is_good &= all(len(line) < 2000 for line in lines)
    shown = " ".join(word if len(word) < 30 else word[:20] + "…" for word in words[:SHOWN])
    shown += f" … ({len(words)} words)" if len(words) > SHOWN else ""
    end = (
        f"status {found.status}, {found.seconds:.1f} s, {found.memory >> 20} of {limit >> 20} MB, {size >> 20} MB files"
    )
    return f"{shown}: {end} {lines[0][:100] if lines else ''}{'' if is_good else ' FAULT'}"


def main() -> int:
    """Print a line for each command; the exit status is 1 if one breaks the rule."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=10_000_000)
    parser.add_argument("--fields", type=int, default=100_000)
    given = parser.parse_args()
    found = []

    def note(line: str) -> None:
        print(line, flush=True)
        found.append(line)

    with TemporaryDirectory() as place:
        folder = Path(place)
        bare = Dataset(grid(Shape.TRIANGLE, 1))
        one = approximated(bare, "u", lambda x: x[:, 0] * x[:, 1], 3)
        write(replace(bare, fields=(one,)), folder / "m.xml", folder / "m.fld")
        for text in LONG:
            note(run(folder, ("m.xml", "m.fld"), ("probe", "m.xml", "m.fld", "--point", "0.2,0.2", "--field", text)))
            note(run(folder, ("m.xml", "m.fld"), ("render", "m.xml", "m.fld", "--field", text, "-o", "m.png")))
        names = ("m.xml", "many.fld")
        write(
            replace(bare, fields=tuple(replace(one, name=f"f{i}") for i in range(given.fields))),
            *map(folder.joinpath, names),
        )
        for words in (
            ("info",),
            ("probe", "--point", "0.2,0.2", "--field", "f7"),
            ("render", "--field", "f7", "--device", "reference", "-o", "m.png"),
        ):
            note(run(folder, names, (words[0], *names, *words[1:])))
        names = ("m.xml", "m.fld", "points.csv")
        with (folder / "points.csv").open("w") as file:
            file.write("x,y\n")
            line = "".join(f"{x:.6f},{y:.6f}\n" for x, y in np.random.default_rng(1).random((1000, 2)))
            file.writelines(line for _ in range(given.points // 1000))
        note(run(folder, names, ("probe", *names[:2], "--points", names[2], "-o", "values.npz")))
        with np.load(folder / "values.npz") as values:
            print({name: values[name].shape for name in values})
    return any(line.endswith("FAULT") for line in found)


if __name__ == "__main__":
    sys.exit(main())
