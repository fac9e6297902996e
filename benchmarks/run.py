"""All benchmarks in one command: tables on the terminal, on request as JSON and in docs/benchmarks.md.

make bench        or    python benchmarks/run.py [--quick] [--only PART,…] [--json FILE] [--save]
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bent
import cases
import compiling
import conversion
import floor
import flow
import large
import machine
import measures
import measuring
import million
import orders
import pictures
import repeating
import resolution
import rivals
import running
import scenes
import sharing
import shown
import spectral
import starting
import steps
import targets
import viewing
from tables import Table

PAGE = Path(__file__).resolve().parents[1] / "docs" / "benchmarks.md"
Part = Callable[[argparse.Namespace], tuple[Any, list[Table]]]


def cut(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Exact against linear pictures."""
    side, rounds = (200, 2) if options.quick else (1000, options.rounds)
    numbers, tables = {}, []
    for case, title in (
        (cases.standard(options.quick), "Cut plane"),
        (cases.hard(options.quick), "Cut plane, hard case"),
    ):
        numbers[case.name] = pictures.compare(case, options.device, side, rounds, options.quick)
        tables.append(pictures.table(numbers[case.name], title))
    return numbers, tables


def shown_scenes(kinds: tuple[str, ...], options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Some kinds of pictures of both wings; of one where it is to be quick."""
    side, rounds = (100, 1) if options.quick else (1000, max(2, options.rounds // 2))
    peak = max(floor.peaks(options.device).values())
    numbers, tables = {}, []
    for each in shown.SHOWN[:1] if options.quick else shown.SHOWN:
        found = scenes.compare(kinds, each, options.device, side, rounds, options.quick)
        numbers[each.name] = found
        tables.append(scenes.table(found, peak))
    return numbers, tables


def surfaces(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Cut planes and surfaces with contours, and how they grow."""
    numbers, tables = shown_scenes(("cut", "faces"), options)
    side, rounds = (100, 1) if options.quick else (1000, max(2, options.rounds // 3))
    numbers["growth"] = scenes.growth(options.device, side, rounds, options.quick)
    return numbers, [*tables, *scenes.growth_table(numbers["growth"])]


def isosurface(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Isosurfaces."""
    return shown_scenes(("isosurface",), options)


def volume(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Everything in one picture of the delta wing, what is saved by sharing, and growth with elements."""
    side, rounds = (60, 1) if options.quick else (1000, 2)
    found = sharing.measure(shown.DELTA, options.device, side, rounds, options.quick)
    side, rounds = (60, 1) if options.quick else (400, 2)
    found["growth"] = bent.measure(options.device, side, rounds, options.quick)
    return found, [sharing.table(found), bent.table(found["growth"])]


def order(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Every shape at orders 2 to 8."""
    side, rounds = (100, 1) if options.quick else (1000, max(3, options.rounds // 2))
    numbers = orders.measure(options.device, side, rounds, (2,) if options.quick else range(2, 9), options.quick)
    return numbers, [orders.table(numbers)]


def compile(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Kernels that nobody has compiled before."""
    numbers = compiling.measure(options.device, *compiling.every(options.quick))
    return numbers, [compiling.table(numbers)]


def many(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """A million elements."""
    cells, side, points = (6, 100, 1000) if options.quick else (56, 1000, 100_000)
    numbers = million.measure(options.device, cells, side, points)
    return numbers, [million.table(numbers)]


def load(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """From the files of a million elements to the first picture."""
    cells, rounds = (8, 1) if options.quick else (56, max(2, options.rounds // 3))
    numbers = large.measure_loading(options.device, cells, rounds)
    return numbers, [large.loading_table(numbers)]


def convert(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Files of other programs."""
    numbers = conversion.measure((2,) if options.quick else (10, 20, 33))
    return numbers, [conversion.table(numbers)]


def start(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Whole processes."""
    numbers = starting.measure(options.device, 1 if options.quick else options.rounds)
    return numbers, [starting.table(numbers)]


def repeat(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Many pictures in one process."""
    numbers = repeating.measure(options.device, 1 if options.quick else 500)
    numbers["steady"] = repeating.steady(options.device, 2 if options.quick else 60, options.quick)
    return numbers, [repeating.table(numbers), repeating.steady_table(numbers["steady"])]


def view(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Pictures while the mouse turns them."""
    side, duration = (100, 0.5) if options.quick else (1000, 5.0)
    numbers = viewing.measure(shown.DELTA, options.device, side, duration, options.quick)
    return numbers, viewing.tables(numbers)


def size(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Large pictures."""
    side, kinds = (300, ["cut"]) if options.quick else (20000, list(large.KINDS))
    numbers = large.measure(options.device, side, kinds)
    return numbers, [large.table(numbers)]


def promised(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """The request, next to the seconds before and now."""
    side, rounds = (60, 1) if options.quick else (1000, max(3, options.rounds // 2))
    numbers = targets.measure(options.device, side, rounds, options.quick)
    return numbers, [targets.table(numbers)]


def series(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Steps of a series on one mesh."""
    cells, count, side = (3, 5, 100) if options.quick else (23, 50, 1000)
    kinds = ("surfaces",) if options.quick else tuple(steps.KINDS)
    numbers = steps.measure(options.device, cells, count, side, kinds)
    return numbers, [steps.table(numbers)]


def measure(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Integrals, extrema, differences."""
    side, rounds = (60, 1) if options.quick else (1000, max(3, options.rounds // 2))
    numbers = measures.measure(options.device, side, rounds, options.quick)
    return numbers, measures.tables(numbers)


def streamlines(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Streamlines, and pictures with tubes."""
    lines, tubes, side, rounds = (5, 5, 60, 1) if options.quick else (1000, 200, 1000, max(3, options.rounds // 2))
    numbers = flow.measure(options.device, lines, tubes, side, rounds, options.quick)
    return numbers, flow.tables(numbers)


def situ(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Pictures of a running solver."""
    cells, side, count = (2, 60, 16) if options.quick else (10, 1000, 1000)
    numbers = running.measure(options.device, cells, side, count)
    return numbers, [running.table(numbers)]


def high_order(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Elements of orders 5 to 9, as production runs have them."""
    side, rounds = (60, 1) if options.quick else (1000, 2)
    numbers = spectral.measure(options.device, side, rounds, options.quick)
    return numbers, spectral.tables(numbers)


def resolved(options: argparse.Namespace) -> tuple[Any, list[Table]]:
    """Estimates of resolution against true errors."""
    numbers = resolution.measure(options.quick)
    return numbers, resolution.tables(numbers)


PARTS: dict[str, Part] = {
    "spectral": high_order,
    "cut": cut,
    "surfaces": surfaces,
    "isosurface": isosurface,
    "volume": volume,
    "orders": order,
    "compile": compile,
    "million": many,
    "load": load,
    "convert": convert,
    "start": start,
    "repeat": repeat,
    "view": view,
    "large": size,
    "targets": promised,
    "series": series,
    "measure": measure,
    "resolution": resolved,
    "flow": streamlines,
    "in-situ": situ,
}


def main() -> None:
    """Run the parts that were requested."""
    options = parsed()
    about = machine.description(options.device)
    print(f"# Benchmarks\n\n{machine.sentences(about)}\n", flush=True)
    numbers, parts = {"machine": about}, {}
    for name in options.only:
        numbers[name], tables = PARTS[name](options)
        parts[name] = "\n".join(table.text() for table in tables)
        print(parts[name], flush=True)
    rows = [
        *(("cut plane, " + name, found) for name, found in numbers.get("cut", {}).items()),
        *(
            (f"{case}: {scenes.WORDS[kind]}, {view}", found)
            for part in ("surfaces", "isosurface")
            for case, own in numbers.get(part, {}).items()
            for kind, views in own.get("kinds", {}).items()
            for view, found in views.items()
        ),
    ]
    if rows:
        parts["rivals"] = rivals.table(rows).text()
        print(parts["rivals"], flush=True)
    about["contention"].append(round(measuring.contention(), 2))
    print(f"Clock over processor seconds of a busy loop, now: {about['contention'][-1]:.2f}")
    if options.json:
        options.json.write_text(json.dumps(numbers, indent=2) + "\n")
    if options.save:
        PAGE.write_text(with_tables(PAGE.read_text(), parts, machine.sentences(about)))
        print(f"saved in {PAGE}", file=sys.stderr)


def with_tables(page: str, parts: dict[str, str], machine: str) -> str:
    """The page of benchmarks with new tables of some parts, each between its two comments; a new part comes last."""
    for name, tables in parts.items():
        begin, end = f"<!-- begin {name} -->", f"<!-- end {name} -->"
        block = f"{begin}\n{tables}\n{machine}\n{end}"
        before, found, rest = page.partition(begin)
        page = before + block + rest.partition(end)[2] if found else f"{page.rstrip()}\n\n{block}\n"
    return page


def parsed() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description="ElVis benchmarks; see benchmarks/README.md.")
    parser.add_argument("--quick", action="store_true", help="tiny sizes: whether it runs, not how fast")
    parser.add_argument(
        "--only", type=chosen, default=list(PARTS), metavar="PART,…", help=f"some of {', '.join(PARTS)}"
    )
    parser.add_argument("--device", default="auto", help="as of elvis render")
    parser.add_argument("--rounds", type=int, default=10, help="runs of which best and median are told")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all numbers")
    parser.add_argument("--save", action="store_true", help="replace the tables of these parts in docs/benchmarks.md")
    return parser.parse_args()


def chosen(text: str) -> list[str]:
    """Names of parts, split at commas."""
    names = text.split(",")
    unknown = [name for name in names if name not in PARTS]
    if unknown:
        raise argparse.ArgumentTypeError(f"unknown part {unknown[0]!r}: expected some of {', '.join(PARTS)}")
    return names


if __name__ == "__main__":
    main()
