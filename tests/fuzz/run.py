"""Damage files by the thousand and read them: ``python tests/fuzz/run.py --cases 100000 [--only READER] [--seed N]``.

A case fails where anything but one sentence of ours comes out, where it takes more than 5 seconds of the processor,
more than twice the memory of the sound files (40 MB for the interpreter included) or more than 300 MB and 20 times the
files, or where the process ends.  Files of failures are retained, one of each kind.
"""

import argparse
import json
import os
import re
import select
import shutil
import signal
import sys
import tempfile
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

# one thread a library: those that wait for others spin, so that on a busy machine their processor time says nothing
os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}

import corpus
import work

#: cases of each reader, of a thousand
SHARES = {
    "native XML": 176, "native HDF5": 100, "messages": 20,
    "scene toml": 60, "scene yaml": 60, "scene json": 60, "palette": 60,
    "triangles": 80, "points": 40, "record": 60, "fourier": 60, "nurbs": 60, "elvisdat": 31, "nek": 15, "gmf": 15,
    "exodus": 15, "hopr": 12, "pyfr": 12, "ngsolve": 8, "gmsh": 15, "vtk": 15, "mfem": 6, "cgns": 20,
    "live blueprint": 30, "live arrays": 30, "live ngsolve": 6, "live mfem": 6,
    "trixi": 20, "horses": 15, "vtx": 6, "vtkhdf": 15,
}  # fmt: skip

#: seconds without a word after which a process is ended
SILENCE = 600


@dataclass
class Tally:
    """What came of a reader's cases."""

    cases: int = 0
    kinds: dict = field(default_factory=lambda: defaultdict(int))
    seconds: float = 0.0
    worst: float = 0.0
    ratio: float = 0.0
    failures: dict = field(default_factory=dict)

    def add(self, found):
        """Count a case."""
        self.cases += 1
        self.kinds[found["kind"]] += 1
        self.seconds += found["seconds"]
        self.worst, self.ratio = max(self.worst, found["seconds"]), max(self.ratio, found["ratio"])

    def row(self, name):
        bad = sum(count for kind, count in self.kinds.items() if kind not in ("read", "refused"))
        counts = (self.cases, self.kinds["refused"], self.kinds["read"], bad)
        return name, *map(str, counts), f"{self.worst:.2f}", f"{self.ratio:.2f}", f"{self.seconds:.0f}"


#: what is retained of a case
KEPT = ("kind", "message", "seconds", "ratio")
HEADERS = ("reader", "cases", "refused", "read", "failed", "worst s", "worst memory", "s in all")


class Reader:
    """The cases of one reader, in worker after worker."""

    def __init__(self, subjects, seed, keep, log):
        self.subjects, self.seed, self.keep, self.log = subjects, seed, keep, log
        self.name, self.tally, self.known = subjects[0].reader, Tally(), {}
        self.now = {}

    def run(self, numbers):
        """Cases of these numbers, with a new worker after each that dies."""
        left = list(numbers)
        while left:
            done = self._worker(left)
            left = left[done:]

    def _worker(self, numbers):
        """One worker's life; how many cases it finished, the last of which may have ended it."""
        folder = Path(tempfile.mkdtemp(prefix="fuzz", dir="/dev/shm" if os.path.isdir("/dev/shm") else None))
        read_end, write_end = os.pipe()
        child = os.fork()
        if not child:
            os.close(read_end)
            work.serve(self.subjects, self.seed, folder, numbers, write_end, self.known, self.keep)
        os.close(write_end)
        try:
            return self._watched(child, read_end, folder, numbers)
        finally:
            os.close(read_end)
            shutil.rmtree(folder, ignore_errors=True)

    def _watched(self, child, stream, folder, numbers):
        done, rest, ended = 0, b"", False
        while not ended:
            ready, _, _ = select.select([stream], [], [], SILENCE)
            block = os.read(stream, 1 << 16) if ready else b""
            if not ready:
                os.kill(child, signal.SIGKILL)
            ended = not block
            *lines, rest = (rest + block).split(b"\n")
            for line in lines:
                done += self._told(json.loads(line))
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if status == 3:
            raise SystemExit(self.now.get("message", "the harness failed"))
        if status and done < len(numbers):
            message = self.now.get("state", "")
            found = {"case": self.now["case"], "kind": _death(status), "message": message, "seconds": 0, "ratio": 0}
            self._count(found)
            work.keep(self.keep, self.name, _death(status), self.now["case"], folder)
            done += 1
        return done

    def _told(self, found):
        """Take in a word of the worker; 1 where a case is done."""
        self.now.update(found)
        if found["state"] == "baseline":
            self.known[found["key"]] = found["memory"], found["seconds"]
            if found["kind"] != "read":
                raise SystemExit(f"sound files aren't read: {found}")
        if found["state"] != "done":
            return 0
        self._count({"case": self.now["case"], **{key: found[key] for key in KEPT}})
        return 1

    def _count(self, found):
        self.tally.add(found)
        if self.log:
            kept = {"reader": self.name, "seed": self.seed, **found}
            self.log.write(json.dumps(kept) + "\n")
        if found["kind"] not in ("read", "refused"):
            self._fail(found)

    def _fail(self, found):
        """Remember a failure by its kind and place."""
        kind = found["kind"]
        signature = f"{kind} {re.sub(r'[0-9]+', 'N', found['message'].split(' at ')[-1])[:200]}"
        signature = f"{signature} {self.now.get('action')}" if kind not in ("traceback", "no sentence") else signature
        known = self.tally.failures.setdefault(signature, [0, dict(self.now, **found)])
        known[0] += 1
        if known[0] == 1:
            what = {
                key: self.now.get(key) for key in ("case", "subject", "file", "action", "damage", "seconds", "ratio")
            }
            print(f"{self.name}: {signature}\n    {found['message']}\n    {what}", flush=True)


def _death(status):
    if -status == signal.SIGPROF:
        return "hang"
    return "stuck" if -status == signal.SIGKILL else "crash"


def table(rows):
    """Rows as a table of Markdown."""
    widths = [max(len(row[i]) for row in (HEADERS, *rows)) for i in range(len(HEADERS))]
    lines = [HEADERS, ["-" * width for width in widths], *rows]
    return "\n".join("| " + " | ".join(t.ljust(w) for t, w in zip(line, widths, strict=True)) + " |" for line in lines)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--first", type=int, default=0, help="number of the first case of each reader")
    parser.add_argument("--only", help="readers, commas between them")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir()) / "elvis-fuzz", help="where files go")
    parser.add_argument("--small", action="store_true", help="only the files that are made here")
    parser.add_argument("--log", type=Path, help="append what came of each case, to sum up with --sum")
    parser.add_argument("--sum", type=Path, nargs="+", help="only print the table of such logs, each case counted once")
    return parser.parse_args()


def main():
    given = arguments()
    if given.sum:
        return summed(given.sum)
    total, failures = [], 0
    log = given.log.open("a", buffering=1) if given.log else None
    with tempfile.TemporaryDirectory() as folder:
        names = given.only.split(",") if given.only else list(SHARES)
        every = corpus.subjects(Path(folder), names)
        if given.small:
            every = [each for each in every if folder in str(each.files[0])]
        whole = sum(SHARES[name] for name in names)
        for name in names:
            own = [each for each in every if each.reader == name]
            if not own and not given.small:
                raise SystemExit(f"there are no files for {name}")
            count = round(given.cases * SHARES[name] / whole)
            if own:
                reader = Reader(own, given.seed, given.keep, log)
                reader.run(range(given.first, given.first + count))
                total.append(reader.tally.row(name))
                failures += report(reader)
    print(table(total))
    print(f"{sum(int(row[1]) for row in total)} cases, {failures} kinds of failures; seed {given.seed}")
    return 1 if failures else 0


def summed(logs):
    """Print the table of what several runs have logged; a reader without a case is a failure."""
    tallies, seen = {name: Tally() for name in SHARES}, set()
    for line in (line for log in logs for line in log.read_text().splitlines()):
        found = json.loads(line)
        key = found["reader"], found["seed"], found["case"]
        if key not in seen:
            tallies[found["reader"]].add(found)
        seen.add(key)
    rows = [tally.row(name) for name, tally in tallies.items()]
    print(table(rows))
    failures = sum(int(row[4]) for row in rows)
    print(f"{len(seen)} cases, {failures} failures")
    left = [name for name, tally in tallies.items() if not tally.cases]
    if left:
        print(f"no cases of {', '.join(left)}")
    return 1 if failures or left else 0


def report(reader):
    """Print a reader's failures, one of each kind; how many kinds there are."""
    for signature, (count, found) in reader.tally.failures.items():
        print(f"{reader.name}: {count} x {signature}, such as case {found['case']}", flush=True)
    print(f"({reader.name}: {reader.tally.cases} cases in {reader.tally.seconds:.0f} s)", flush=True)
    return len(reader.tally.failures)


if __name__ == "__main__":
    sys.exit(main())
