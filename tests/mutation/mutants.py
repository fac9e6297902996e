"""Mutants of ElVis, and which of them the tests kill: `make mutants`.

python tests/mutation/mutants.py --seed 1 --count 60                lines of all kinds, margins and bounds preferred
python tests/mutation/mutants.py --seed 1 --count 30 --margins      only lines that name an error, a margin or a bound
python tests/mutation/mutants.py --lines formats/elvis/core/x.py:12 all mutants of a line; x.py:12-40 of several
python tests/mutation/mutants.py --under core/x.py --every --tests tests/formats/test_x.py   all mutants, these tests

A mutant is one small change of one line, in a copy of the tree.  A failing test that runs the line kills it.  The first
run finds the lines and kernels that each test runs, which takes about as long as all tests, and keeps them in
out/mutation; later runs do so for test modules that have changed.  For each mutant, tests of up to ``--seconds`` of
processor time run, those of the nearest modules first (choosing.py).  equivalent.txt lists equivalent mutants with
reasons; they are not drawn.  The tool prints the survivors and a table of killed mutants by kind and slice.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

from choosing import AREAS, Imports, Touched, chosen_tests, run_within
from operators import Mutation, mutations

ROOT = Path(__file__).resolve().parents[2]
EQUIVALENT = Path(__file__).with_name("equivalent.txt")
#: words of lines that state a bound; _ and capitals divide names
MARGIN = re.compile(
    r"(?i)error|rounding|margin|bound|toleran|slack|radius|radii|remainder|\brest|reach|lower|upper|bend|bulge|uncertain"
    r"|gamma|\bUNIT\b|nextafter|spread|steep|deviation|touch"
)
#: parts of the tree from which half of all mutants come: what is called certain rests on these
PREFERRED = re.compile(
    r"core/(bounds|mapping|quantities|validity|integrals|cores|differences|distances|polynomials)/|\.slang$"
)
#: a mutant may loop: after so many times the processor seconds of its tests, and a minute, it counts as killed
PATIENCE = 5.0


@dataclass(frozen=True)
class Mutant:
    """A mutation of a file."""

    name: str
    change: Mutation
    text: str

    @property
    def lines(self) -> range:
        """Numbers of the lines that the change spans."""
        return range(self.change.line, self.change.line + self.change.old.count("\n") + 1)

    @property
    def statement(self) -> str:
        """The first line that changes."""
        return self.text.splitlines()[self.change.line - 1].strip()

    @property
    def key(self) -> str:
        """How equivalent.txt names the mutant: by texts, as lines move."""
        old, new = (" ".join(text.split()) for text in (self.change.old, self.change.new))
        return f"{self.name} | {self.statement} | {old} -> {new}"


def main() -> None:
    """Draw mutants, run their tests, print the table."""
    options = arguments()
    chosen = drawn(options)
    with copies(options.jobs) as roots:
        runner = Runner(roots, options.seconds, options.tests)
        with ThreadPoolExecutor(options.jobs) as pool:
            results = list(pool.map(runner.judge, chosen))
    print_table(results)


def arguments() -> argparse.Namespace:
    """Options of the command."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--margins", action="store_true", help="Only lines that name an error, a margin or a bound.")
    parser.add_argument("--under", default="", help="Only files whose name has this text.")
    parser.add_argument("--lines", nargs="*", help="FILE:LINE or FILE:FIRST-LAST: all mutants of these lines.")
    parser.add_argument("--every", action="store_true", help="All mutants instead of a sample.")
    parser.add_argument("--tests", nargs="*", help="Tests to run for each mutant instead of those chosen by coverage.")
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="Processor seconds of tests for a mutant. [default: 60]"
    )
    parser.add_argument("--jobs", type=int, default=1, help="Mutants at a time. [default: 1]")
    parser.add_argument("--list", action="store_true", help="Print the mutants and run nothing.")
    options = parser.parse_args()
    print(f"seed {options.seed}, {options.count} mutants, {'margins' if options.margins else 'all lines'}", flush=True)
    return options


def drawn(options: argparse.Namespace) -> list[Mutant]:
    """The mutants of this run."""
    known = equivalents()
    every = list(every_mutant(options))
    if not options.under and not options.lines:
        for key in sorted(known - {mutant.key for mutant in every}):
            print(f"listed as equivalent, but no longer a mutant: {key}", flush=True)
    found = [mutant for mutant in every if mutant.key not in known]
    if options.lines:
        wanted = {(name, line) for name, lines in map(span, options.lines) for line in lines}
        found = [mutant for mutant in found if (mutant.name, mutant.change.line) in wanted]
    is_every = options.every or options.lines
    chosen = [each for of in eligible(found, options).values() for each in of] if is_every else sample(found, options)
    if options.list:
        for mutant in chosen:
            print(f"{mutant.name}:{mutant.change.line} {mutant.change.kind}\n    {mutant.key}")
        sys.exit()
    return chosen


def span(text: str) -> tuple[str, range]:
    """A file and its lines, from FILE:LINE or FILE:FIRST-LAST."""
    name, _, lines = text.rpartition(":")
    first, _, last = lines.partition("-")
    return name, range(int(first), int(last or first) + 1)


def equivalents() -> set[str]:
    """Mutants that no test can kill: lines of equivalent.txt that aren't a reason (indented) or a comment."""
    lines = EQUIVALENT.read_text(encoding="utf-8").splitlines()
    return {line for line in lines if line and not line.startswith((" ", "#"))}


def every_mutant(options: argparse.Namespace) -> Iterator[Mutant]:
    """All mutants of the five areas, or of the files that are requested."""
    files = None if options.lines is None else {span(text)[0] for text in options.lines}
    for path in sorted(path for area in AREAS for path in (ROOT / area / "elvis").rglob("*")):
        name = str(path.relative_to(ROOT))
        is_code = path.suffix in (".py", ".slang") and "/testing/" not in name
        if not is_code or options.under not in name or (files is not None and name not in files):
            continue
        text = path.read_text(encoding="utf-8")
        for change in mutations(text, path.suffix):
            yield Mutant(name, change, text)


def sample(found: list[Mutant], options: argparse.Namespace) -> list[Mutant]:
    """One mutant a line; a line that states a bound in a preferred part counts ten times, in another four times."""
    lines = eligible(found, options)
    rng = random.Random(options.seed)
    weights = {line: weight(line[0], of[0].statement) for line, of in lines.items()}
    order = sorted(lines, key=lambda line: rng.random() ** (1.0 / weights[line]), reverse=True)
    return [rng.choice(lines[line]) for line in order[: options.count]]


def eligible(found: list[Mutant], options: argparse.Namespace) -> dict[tuple[str, int], list[Mutant]]:
    """Mutants by line, with --margins those of lines that state a bound in a preferred part."""
    lines: dict[tuple[str, int], list[Mutant]] = {}
    for mutant in found:
        states_bound = MARGIN.search(mutant.statement) is not None
        if not options.margins or (states_bound and PREFERRED.search(mutant.name)):
            lines.setdefault((mutant.name, mutant.change.line), []).append(mutant)
    return lines


def weight(name: str, statement: str) -> float:
    """How often a line is drawn, relative to one that states no bound."""
    if MARGIN.search(statement) is None:
        return 1.0
    return 10.0 if PREFERRED.search(name) else 4.0


@contextmanager
def copies(count: int) -> Iterator[list[Path]]:
    """Copies of the tree; compiled kernels and data next to the tree are shared with it."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        roots = [Path(folder) / str(number) / ROOT.name for number in range(count)]
        for root in roots:
            copy_tree(root)
        yield roots


def copy_tree(root: Path) -> None:
    """Files that git knows or doesn't ignore, without their history."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True).stdout
    for name in listed.split("\0"):
        if (ROOT / name).is_file():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, root / name)
    for beside in (ROOT.parent / "shared", ROOT / ".pytest_cache"):
        if beside.exists():
            link = root.parent / beside.name if beside.parent == ROOT.parent else root / beside.name
            link.symlink_to(beside)


class Runner:
    """Runs the tests of mutants, each mutant in a copy of the tree that no other uses meanwhile."""

    def __init__(self, roots: list[Path], budget: float, tests: list[str] | None = None) -> None:
        self._free: SimpleQueue[Path] = SimpleQueue()
        for root in roots:
            self._free.put(root)
        self._budget = budget
        self._tests = tests
        self._imports = Imports(ROOT)
        self._touched = Touched(ROOT, self._imports, ROOT / "out" / "mutation")
        if tests is None:
            self._touched.update()

    def judge(self, mutant: Mutant) -> tuple[Mutant, str]:
        """The mutant, and the test that killed it, or why it lives."""
        tests = self._tests or self._near(mutant)
        root = self._free.get()
        target = root / mutant.name
        target.write_text(mutant.change.apply(mutant.text), encoding="utf-8")
        try:
            result = self._failure(root, tests) if tests else ""
        finally:
            target.write_text(mutant.text, encoding="utf-8")
            self._free.put(root)
        if not result:
            result = f"SURVIVED {len(tests)} tests" if tests else "NOT RUN by any test"
        print(f"{mutant.name}:{mutant.change.line}: {mutant.change.kind}: {result}", flush=True)
        return mutant, result

    def _near(self, mutant: Mutant) -> list[str]:
        """Tests that run the lines of a mutant."""
        return chosen_tests(self._imports, self._touched, ROOT / mutant.name, mutant.lines, self._budget)

    def _failure(self, root: Path, tests: list[str]) -> str:
        """The first of these tests that fails, or an empty text; all run in one process, as starting takes seconds."""
        paths = [str(root / area) for area in AREAS]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths), "PYTHONDONTWRITEBYTECODE": "1"}
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "--tb=no", *tests]
        limit = 60.0 + PATIENCE * self._budget
        run = run_within(command, limit, cwd=root, env=environment)
        if run is None:
            return f"more than {limit:.0f} s: {tests[0]} …"
        failed = re.search(r"^(?:FAILED|ERROR) (\S+)", run.stdout, re.M)
        return "" if run.returncode == 0 else failed[1] if failed else f"exit status {run.returncode} of {tests[0]}"


def print_table(results: list[tuple[Mutant, str]]) -> None:
    """Survivors with their texts, then how many of each kind were killed."""
    drawn_of: Counter[str] = Counter()
    killed_of: Counter[str] = Counter()
    for mutant, result in results:
        survived = result.startswith(("SURVIVED", "NOT RUN"))
        parts = mutant.name.split("/")
        slice_name = (
            "kernels" if mutant.name.endswith(".slang") else "/".join(parts[: 2 if parts[2] != "core" else 4 : 1])
        )
        for key in (mutant.change.kind, slice_name, "all"):
            drawn_of[key] += 1
            killed_of[key] += not survived
        if survived:
            print(f"\n{mutant.name}:{mutant.change.line}: {mutant.change.kind}: {result}\n{mutant.key}")
    print("\n| | killed | of | |\n|---|---|---|---|")
    for key in drawn_of:
        print(f"| {key} | {killed_of[key]} | {drawn_of[key]} | {100 * killed_of[key] / drawn_of[key]:.0f} % |")


if __name__ == "__main__":
    main()
