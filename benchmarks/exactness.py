"""Certain pixels against analytic expressions: python benchmarks/exactness.py [--pixels 1e7] [--only FAMILY].

Families of cases (tests/exactness) are drawn in turns until each has its share of pixels; only those near data count.
The limit: no certain pixel is wrong, none has failed, and of ordinary scenes fewer than 0.1 % are ambiguous.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from time import perf_counter

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "exactness"))

from audit.families import FAMILIES
from audit.running import Gallery, case_of
from audit.validating import Count
from machine import description, sentences

#: largest part of the pixels of ordinary scenes that may be ambiguous
LIMIT = 1e-3
#: pictures of the reference have this part of the columns and rows
SMALLER = 4


def main():
    """Run what the command line asks for; the exit status is 0 where the limit is retained."""
    options = parsed()
    names = options.only or list(FAMILIES)
    counts = {name: Count() for name in names}
    gallery = Gallery(options.device, options.limit)
    try:
        run(gallery, options, counts)
    finally:
        gallery.close()
    print(report(counts, options))
    total = summed(counts)
    return int(total.wrong > 0 or total.failed > 0 or total.ordinary_ambiguous > LIMIT * total.ordinary)


def parsed():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pixels", type=float, default=1e7, help="pixels in all, spread over the families (1e7)")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after this many minutes")
    parser.add_argument("--limit", type=float, default=600.0, help="processor seconds for a picture (600)")
    parser.add_argument("--seed", type=int, default=1, help="of the sequences of cases (1)")
    parser.add_argument("--case", type=int, help="the case of this number alone")
    parser.add_argument(
        "--first", type=int, default=0, help="the number of the first case, to go on with a sequence (0)"
    )
    parser.add_argument("--only", action="append", choices=list(FAMILIES), metavar="FAMILY", help=", ".join(FAMILIES))
    parser.add_argument("--device", default="auto", help="as of elvis render; reference has smaller pictures")
    parser.add_argument("--verbose", action="store_true", help="a line for each case")
    return parser.parse_args()


def run(gallery, options, counts):
    """Cases of all families in turns, the number of the turn being that of the case."""
    start, parts = perf_counter(), {name: FAMILIES[name][2] for name in counts}
    shares = {name: options.pixels * part / sum(parts.values()) for name, part in parts.items()}
    number = options.first if options.case is None else options.case
    while any(count.pixels < shares[name] for name, count in counts.items()):
        for name, count in counts.items():
            if count.pixels < shares[name] and perf_counter() - start < 60 * options.minutes:
                one(gallery, options, name, number, count)
        if options.case is not None or perf_counter() - start >= 60 * options.minutes:
            return
        number += 1


def one(gallery, options, name, number, count):
    """Draw and count one case."""
    width, height = FAMILIES[name][1]
    size = (width // SMALLER, height // SMALLER) if options.device == "reference" else None
    case = case_of(name, options.seed, number, size)
    found = gallery.count(case)
    found.first = [f"{name}, case {number}: {sentence}" for sentence in found.first]
    found.slow = [f"{name}, case {number}: {sentence}" for sentence in found.slow]
    count.add(found)
    if options.verbose:
        counted = (found.pixels, found.wrong, found.ambiguous, found.failed, found.given_up)
        print(name, number, *counted, f"{found.seconds:.1f} s", flush=True)


def summed(counts):
    """The count of all families."""
    total = Count()
    for count in counts.values():
        total.add(count)
    return total


def report(counts, options):
    """The table, and what was wrong first."""
    lines = [sentences(description("auto" if options.device == "reference" else options.device)), ""]
    lines += [f"Device {options.device}, seed {options.seed}.", ""]
    titles = ["family", "cases", "pixels", "wrong and certain", "ambiguous", "failed", "ambiguous in ordinary scenes"]
    lines += ["| " + " | ".join([*titles, "given up", "s"]) + " |"]
    lines += ["|---|---|---|---|---|---|---|---|---|"]
    for name, count in {**counts, "all": summed(counts)}.items():
        part = f"{count.ordinary_ambiguous / count.ordinary:.4%} of {count.ordinary:,}" if count.ordinary else "-"
        row = [name, count.cases, f"{count.pixels:,}", count.wrong, count.ambiguous, count.failed, part]
        lines.append("| " + " | ".join(map(str, [*row, count.given_up, round(count.seconds)])) + " |")
    first = [sentence for count in counts.values() for sentence in [*count.first[:10], *count.slow[:10]]]
    return "\n".join([*lines, *([""] if first else []), *(f"- {sentence}" for sentence in first)])


if __name__ == "__main__":
    sys.exit(main())
