"""Stated errors against closed forms: python benchmarks/stated_errors.py [--cases 20000] [--only FAMILY].

A family (tests/exactness/audit) makes a random case from a number and compares it with its closed form; conversions
with NGSolve's own values.
The limit: no true error is larger than the stated one, wherever refinement ends; few points make many cases.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import process_time

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "exactness"))

from audit import conversions, integrals, levels

from elvis.core.integrals import refinement

#: by name what returns a sentence if a case of a number is refuted, and None if it isn't
FAMILIES = {
    "integrals": integrals.refutation,
    "level sets": levels.refutation,
    "conversions": conversions.refutation,
}


class GivenUpError(Exception):
    """A case that takes too long."""


def main():
    """Run what the command line asks for; the exit status is 0 if nothing is refuted."""
    options = parsed()
    refinement._MOST = options.points
    lines = ["| family | cases | refuted | given up | CPU s |", "|---|---|---|---|---|"]
    refuted, slow = [], []
    for name in options.only or FAMILIES:
        start, wrong, late = process_time(), [], []
        for number in range(options.first, options.first + options.cases):
            try:
                with limited(options.limit):
                    sentence = FAMILIES[name](number)
            except GivenUpError:
                late.append(f"- {name}: case {number} takes more than {options.limit:g} CPU s")
                continue
            if sentence:
                wrong.append(f"- {name}: {sentence}")
                print(wrong[-1], file=sys.stderr, flush=True)
        lines.append(f"| {name} | {options.cases} | {len(wrong)} | {len(late)} | {process_time() - start:.0f} |")
        refuted, slow = refuted + wrong, slow + late
    print("\n".join([*lines, "", *refuted, *slow]))
    return int(bool(refuted))


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """GivenUpError after so many processor seconds."""

    def give_up(*_):
        raise GivenUpError

    before = signal.signal(signal.SIGPROF, give_up)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def parsed():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=20_000, help="of each family (20000)")
    parser.add_argument("--first", type=int, default=0, help="the number of the first case (0)")
    parser.add_argument("--points", type=int, default=1 << 14, help="for the refinement of an integral (16384)")
    parser.add_argument("--limit", type=float, default=20.0, help="processor seconds of a case (20)")
    parser.add_argument("--only", action="append", choices=list(FAMILIES), metavar="FAMILY", help=", ".join(FAMILIES))
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
