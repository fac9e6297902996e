"""Accuracy reports of the example cases: `python examples/reports/make.py [NAME ...] [-- OPTION ...]`.

Writes out/reports/NAME/index.html for each case, and a table of what linear elements show of it into README.md beside
this file.  Data that are not in out/cases yet are made first; what follows `--` goes to `elvis compare`.
"""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = Path(__file__).with_name("README.md")

#: what is compared of each case, and why
CASES = {
    "delta": ("--field p --plane 0.9,0,0:1,0,0", "pressure in a cut across the vortex: cubic, many small elements"),
    "hemisphere": ("--field wave --plane 0,0.1,0.2:0.1,1,0.3", "a cubic wave in few, curved elements"),
    "twist": ("--field u --plane 0,0,0.05:0.1,0.2,1", "a field of order 7 in few elements, maps of order 4"),
    "distance": ("--field distance --plane 0.5,0,0:1,0,0", "the distance to the wing, which has a kink"),
}
HEAD = """# Reports

What linear elements show of the example cases, by `elvis compare`; the reports themselves are made by

    python examples/reports/make.py

into `out/reports`. Off: percent of the pixels that are wrong by more than a colour step (1/256 of the range) or
missing. Contours: greatest displacement of ten contours, in pixels of a picture of {size}. n is the number of times
that every element is cut; one cut three times is 512 tetrahedra. VTK: its own Lagrange cells through its own filters.

![The report of twist](../../docs/report.png)

| case | elements | degree | | n = 0 | n = 1 | n = 2 | n = 3 | VTK | n = 4 needs | exact needs |
|---|---|---|---|---|---|---|---|---|---|---|
"""


def main(arguments: list[str]) -> int:
    """Make the reports; 2 where a name is unknown, 1 where one fails."""
    cut = arguments.index("--") if "--" in arguments else len(arguments)
    names, options = arguments[:cut] or list(CASES), arguments[cut + 1 :]
    unknown = [name for name in names if name not in CASES]
    if unknown:
        print(f"there is no case {unknown[0]}; the cases are {', '.join(CASES)}", file=sys.stderr)
        return 2
    missing = [name for name in names if not (ROOT / "out" / "cases" / f"{name}.fld").exists()]
    if missing:
        subprocess.run([sys.executable, "examples/cases.py", "out/cases", *missing], cwd=ROOT, check=True)
    (ROOT / "out" / "reports").mkdir(parents=True, exist_ok=True)
    if any(compare(name, options) for name in names):
        return 1
    if len(names) == len(CASES):
        write_page()
    return 0


def compare(name: str, options: list[str]) -> int:
    """One report; the exit status of the command."""
    data = [f"out/cases/{name}.xml", f"out/cases/{name}.fld"]
    what = shlex.split(CASES[name][0])
    command = ["elvis", "compare", *data, *what, "--size", "600x480", *options, "-o", f"out/reports/{name}"]
    print("$", shlex.join(command), flush=True)
    command[0] = str(Path(sys.executable).with_name("elvis"))
    return subprocess.run(command, cwd=ROOT).returncode


def write_page() -> None:
    """The table of all cases."""
    found = {name: json.loads((ROOT / "out" / "reports" / name / "summary.json").read_text()) for name in CASES}
    size = " x ".join(map(str, next(iter(found.values()))["picture"]["size"]))
    rows, said = [], []
    for name, numbers in found.items():
        rows += table_rows(name, numbers)
        said.append(f"- **{name}**, {CASES[name][1]}. {numbers['verdict']}")
    PAGE.write_text(HEAD.format(size=size) + "\n".join([*rows, "", *said, ""]), encoding="utf-8")


def table_rows(name: str, numbers: dict) -> list[str]:
    """Two rows of the table: pixels off, contours."""
    data, rivals = numbers["data"], {rival["key"]: rival for rival in numbers["rivals"]}
    keys = ("n0", "n1", "n2", "n3", "vtk")

    def cells(key: str, unit: str) -> list[str]:
        values = [rivals[own].get(key) if own in rivals else None for own in keys]
        return ["–" if value is None else short(value) + unit for value in values]

    elements = f"{data['elements_drawn']:,}"
    degrees = " to ".join(str(own) for own in sorted(set(data["degrees"])))
    costs = f"{numbers['next']['bytes'] / 1e6:.0f} MB", f"{data['bytes'] / 1e6:.2g} MB"
    return [
        f"| {' | '.join([name, elements, degrees, 'off', *cells('off', ' %'), *costs])} |",
        f"| {' | '.join(['', '', '', 'contours', *cells('contour_max', ' px'), '', ''])} |",
    ]


def short(value: float) -> str:
    """Two digits, or all before the point."""
    return f"{value:.2g}" if value < 99.5 else f"{value:.0f}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
