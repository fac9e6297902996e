"""Two trees of this repository in turn: how many times slower this one is than another, and what is noise.

    git worktree add ../before COMMIT
    python benchmarks/against.py ../before
    python benchmarks/against.py ../before --only integrals --rounds 2

Each tree draws in a process of its own, this one in two, whose ratios to one another tell the noise.  All take turns,
scene by scene, so that what disturbs one disturbs all.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from measuring import ENVIRONMENT

ROOT = Path(__file__).resolve().parent.parent
AREAS = ("formats", "plugins", "converters", "renderer", "reference")
#: what is drawn, and all parts
SCENES = ("cut", "faces", "isosurface", "volume", "together")
PARTS = (*SCENES, "integrals", "start")
#: pixels of a side: a large picture, where kernels count, and a small one, where all else does
SIDES = {True: (40,), False: (700, 100)}
#: what the processes are, in the order of the columns
TREES = ("this", "other", "this again")
#: kinds of seconds
KEYS = ("processor", "wall")


class Worker:
    """A process that does the works of a tree."""

    def __init__(self, tree: Path, quick: bool) -> None:
        command = [sys.executable, __file__, str(tree), "--worker", *(["--quick"] if quick else [])]
        self._process = subprocess.Popen(command, stdin=-1, stdout=-1, text=True, env=environment(tree))

    def ask(self, question: str) -> Any:
        """The answer to one line."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(question, file=self._process.stdin, flush=True)
        answer = self._process.stdout.readline()
        if not answer:
            raise SystemExit(f"the process that draws ended with exit status {self._process.wait()}")
        return json.loads(answer)

    def close(self) -> None:
        """Let it end."""
        self._process.communicate()


#: a package `elvis` of a tree that has none: Python would prefer the installed one to folders without
PACKAGE = "from pkgutil import extend_path\n\n__path__ = extend_path([], __name__)\n"


def environment(tree: Path) -> dict[str, str]:
    """Settings under which this Python finds a tree's modules before all others."""
    package = tree / "renderer" / "elvis" / "__init__.py"
    if not package.exists():
        package.write_text(PACKAGE, encoding="utf-8")
    return {**ENVIRONMENT, "PYTHONPATH": os.pathsep.join(str(tree / name) for name in AREAS)}


def serve(tree: Path, quick: bool) -> None:
    """Do works by name, a line each, from standard input; answer with seconds by the clock and of the processor."""
    sys.path[0] = str(tree / "benchmarks")
    sys.path.append(str(ROOT / "benchmarks"))
    from everyday import integrals
    from measuring import Timing

    import elvis.renderer

    assert Path(elvis.renderer.__file__).is_relative_to(tree), f"{elvis.renderer.__file__} is not in {tree}"
    with elvis.renderer.Renderer("auto") as renderer:
        works = {f"integrals {name}": (each.make, each.value) for name, each in integrals(quick).items()}
        works |= drawings(renderer, quick)
        timing = Timing()
        for line in sys.stdin:
            name = line.strip()
            if name not in works:
                print(json.dumps(list(works)), flush=True)
                continue
            prepare, work = works[name]
            prepare()
            timing.run(work)
            print(json.dumps([timing.processor[-1], timing.wall[-1]]), flush=True)


def drawings(renderer: Any, quick: bool) -> dict[str, tuple[Callable[[], object], Callable[[], object]]]:
    """Two functions for each scene, by its name: one loads the data, the other draws."""
    from cases import FIELD, cut, standard
    from shown import DELTA

    from elvis.scene.figure.picture import picture

    case, held = standard(quick), []
    scenes = {f"cut {side}^2, {case.label}": (case.dataset, FIELD, cut(side)) for side in SIDES[quick]}
    for kind in SCENES:
        for side in SIDES[quick]:
            views = DELTA.scenes(kind, side).items()
            found = {f"{kind} {side}^2, {DELTA.name}, {view}": scene for view, scene in views}
            scenes |= {name: (partial(DELTA.dataset, quick), DELTA.field, scene) for name, scene in found.items()}

    def load(make: Callable[[], Any], field: str) -> None:
        if held != [make]:
            renderer.load(make(), field)
            held[:] = [make]

    def draw(scene: Any) -> None:
        picture(renderer.render(scene, references=False), plain=True)

    return {name: (partial(load, make, field), partial(draw, scene)) for name, (make, field, scene) in scenes.items()}


@contextmanager
def workers(trees: Sequence[Path], quick: bool) -> Iterator[list[Worker]]:
    """A process for each tree."""
    own = [Worker(tree, quick) for tree in trees]
    try:
        yield own
    finally:
        for worker in own:
            worker.close()


def in_turns(works: Sequence[Callable[[], Sequence[float]]], rounds: int) -> list[list[Sequence[float]]]:
    """What each of some works returns in rounds that another one begins each time; the first round doesn't count."""
    found: list[list[Sequence[float]]] = [[] for _ in works]
    for number in range(rounds + 1):
        for place in range(len(works)):
            one = (place + number) % len(works)
            seconds = works[one]()
            if number:
                found[one].append(seconds)
    return found


def compare(works: Sequence[Callable[[], Sequence[float]]], rounds: int) -> dict[str, Any]:
    """Processor seconds of the cheapest run and clock seconds of the usual one, of each tree."""
    found = in_turns(works, rounds)
    processor = [min(seconds[0] for seconds in own) for own in found]
    wall = [median(seconds[1] for seconds in own) for own in found]
    return {"processor": dict(zip(TREES, processor, strict=True)), "wall": dict(zip(TREES, wall, strict=True))}


def drawn(trees: Sequence[Path], parts: Sequence[str], rounds: int, quick: bool) -> dict[str, Any]:
    """The scenes and integrals of some parts, in all trees."""
    with workers(trees, quick) as own:
        names = [worker.ask("") for worker in own]
        chosen = [name for name in names[0] if name.split()[0] in parts and all(name in known for known in names)]
        return {name: compare([partial(worker.ask, name) for worker in own], rounds) for name in chosen}


def started(trees: Sequence[Path], rounds: int) -> dict[str, Any]:
    """Whole processes: the help, and a small picture with kernels at hand."""
    from cases import Case, mild
    from measuring import Timing
    from starting import ELVIS, children

    from elvis import Shape, write

    def run(tree: Path, arguments: Sequence[str]) -> tuple[float, float]:
        command, before, timing = [*ELVIS, *arguments], children(), Timing()
        timing.run(lambda: subprocess.run(command, check=True, capture_output=True, env=environment(tree)))
        return children() - before, timing.wall[0]

    case = Case("small", Shape.TETRAHEDRON, cells=3, degree=2, order=4, field=mild)
    with TemporaryDirectory() as folder:
        files = [str(path) for path in write(case.dataset(), Path(folder) / "small.xml")]
        picture = ["render", *files, "--plane", "0.5,0.5,0.5:0,0,1", "-o", f"{folder}/small.png", "--overwrite"]
        commands = {"elvis --help": ["--help"], "elvis render": picture}
        return {
            name: compare([partial(run, tree, arguments) for tree in trees], rounds)
            for name, arguments in commands.items()
        }


def table(numbers: dict[str, Any], other: str) -> str:
    """A row a scene or command, with the largest noise below."""
    from tables import Table, seconds

    shown = Table(f"Against {other}", ["", "CPU s", "other", "CPU ratio", "wall ratio", "A/A CPU", "A/A wall"])
    for name, found in numbers.items():
        figures = [seconds(found["processor"][tree]) for tree in TREES[:2]]
        ratios = [ratio(found[key], tree) for tree in TREES[1:] for key in ("processor", "wall")]
        shown.rows.append([name, *figures, *(f"{each:.3f}" for each in ratios)])
    noise = [max((abs(ratio(found[key], TREES[2]) - 1) for found in numbers.values()), default=0.0) for key in KEYS]
    shown.rows.append(["A/A, farthest from 1", "", "", "", "", *(f"{each:.3f}" for each in noise)])
    shown.notes = [
        "Processor seconds of the cheapest run, clock seconds of the usual one; ratios are this tree over the other.",
        "A/A: this tree over itself, in two processes: what is no farther from 1 than that is noise.",
    ]
    return shown.text()


def ratio(seconds: dict[str, float], tree: str) -> float:
    """How many times as long this tree takes as another."""
    return seconds[TREES[0]] / seconds[tree]


def main() -> int:
    """Compare and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tree", type=Path, help="another working tree of this repository")
    parser.add_argument("--only", default=",".join(PARTS), help=f"some of {', '.join(PARTS)}")
    parser.add_argument("--rounds", type=int, default=9, help="runs of each scene and tree")
    parser.add_argument("--quick", action="store_true", help="tiny: whether it runs, not how fast")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    tree = options.tree.resolve()
    if options.worker:
        serve(tree, options.quick)
        return 0
    parts = options.only.split(",")
    unknown = [part for part in parts if part not in PARTS]
    if unknown:
        parser.error(f"unknown part {unknown[0]!r}: expected some of {', '.join(PARTS)}")
    if not (tree / "benchmarks" / "shown.py").is_file():
        parser.error(f"{options.tree} is no tree of this repository with its benchmarks")
    trees = (ROOT, tree, ROOT)
    numbers = drawn(trees, [part for part in parts if part != "start"], options.rounds, options.quick)
    if "start" in parts:
        numbers |= started(trees, options.rounds)
    print(table(numbers, str(options.tree)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
