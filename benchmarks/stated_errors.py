"""Stated errors against closed forms: python benchmarks/stated_errors.py [--cases 20000] [--only FAMILY].

A family (tests/exactness/audit) makes a random case from a number and compares it with its closed form.
The limit: no true error is larger than the stated one, wherever refinement ends; few points make many cases.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from time import perf_counter

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "exactness"))

from audit import integrals

from elvis.core.integrals import refinement

#: by name what returns a sentence if a case of a number is refuted, and None if it isn't
FAMILIES = {"integrals": integrals.refutation}


def main():
    """Run what the command line asks for; the exit status is 0 if nothing is refuted."""
    options = parsed()
    refinement._MOST = options.points
    lines = ["| family | cases | refuted | s |", "|---|---|---|---|"]
    refuted = []
    for name in options.only or FAMILIES:
        start = perf_counter()
        numbers = range(options.first, options.first + options.cases)
        found = [sentence for number in numbers if (sentence := FAMILIES[name](number))]
        lines.append(f"| {name} | {options.cases} | {len(found)} | {perf_counter() - start:.0f} |")
        refuted += [f"- {name}: {sentence}" for sentence in found]
    print("\n".join([*lines, *([""] if refuted else []), *refuted]))
    return int(bool(refuted))


def parsed():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=20_000, help="of each family (20000)")
    parser.add_argument("--first", type=int, default=0, help="the number of the first case (0)")
    parser.add_argument("--points", type=int, default=1 << 14, help="for the refinement of an integral (16384)")
    parser.add_argument("--only", action="append", choices=list(FAMILIES), metavar="FAMILY", help=", ".join(FAMILIES))
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
