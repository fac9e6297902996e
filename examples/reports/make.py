"""Accuracy reports of the example cases: `python examples/reports/make.py [NAME ...] [-- OPTION ...]`.

Writes out/reports/NAME/index.html for each case, and a table of what linear elements show of it into README.md next to
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

#: what is compared of each case: its data, the options, and why
CASES = {
    "delta": ("delta", "--field p --plane 0.9,0,0:1,0,0", "pressure in a cut across the vortex: cubic, many elements"),
    "hemisphere": (
        "hemisphere",
        "--field wave --plane 0,0.1,0.2:0.1,1,0.3 --refinements 0,1,2,3,4,5",
        "a cubic wave in few, curved elements",
    ),
    "twist": (
        "twist",
        "--field u --plane 0,0,0.05:0.1,0.2,1 --refinements 0,1,2,3,4,5",
        "a field of order 7 in few elements, maps of order 4",
    ),
    "distance": ("delta", "--field distance(wing) --plane 0.5,0,0:1,0,0", "the distance to the wing, which has kinks"),
    "vortex": (
        "delta",
        "--field p --isosurface -0.8 --camera -1.9,2.6,1.7:0.95,0.14,0.13:0,0,1:19",
        "the vortex as an isosurface of pressure, with the cracks of a DG field",
    ),
    "wing": (
        "wing",
        "--field p --faces wing,symmetry --contours 10 --camera -1.6,3.2,3.0:0.55,0.47,0.1:0,0,1:21 --memory-limit 4G",
        "pressure on a wing of thin, curved elements",
    ),
}
KEYS = ("n0", "n1", "n2", "n3", "n4", "n5", "vtk")
HEAD = """# Reports

The page compares exact pictures of the example cases with pictures of linear elements, by
`elvis compare`. To make the reports, run

    python examples/reports/make.py

The reports are written to `out/reports`. In the table, n is the number of refinements of every
element: after three refinements, a tetrahedron has become 512 linear ones. The column *VTK* has
VTK's own Lagrange cells, drawn through its own filters. The column *exact* has the pictures of
ElVis.

- *off*: percentage of the pixels that are wrong by more than a colour step (1/256 of the range), or
  missing, in a picture of {size} pixels.
- *contours*: maximum displacement of ten contours, in pixels.
- *surface*: maximum distance between the isosurface and the exact one, in both directions; the wing
  is 1 long.
- *memory*: memory of the linear mesh; for *exact*, of the coefficients from which the picture is
  drawn.
- *time*: seconds from data in memory to the picture, on two cores with software Vulkan. For
  *exact*, this includes opening the device and uploading the data. Linear pictures are cut in NumPy
  and traced by Embree.

![The report of twist](../../docs/report.png)

The picture is made by `python examples/reports/shoot.py twist`.

Linear pictures of smooth fields on many elements are right to within one pixel after 3 refinements.
They then need 70 to 85 times the memory of the coefficients; a distance, which has no coefficients,
needs 230 times the memory of the mesh. A few curved elements need 5 refinements, and thousands of
times the memory. A field of order 7 is 1.5 pixels off even then, and 6 refinements would need 22
GB. An isosurface with cracks is not right after 3 refinements.

| case | | n = 0 | n = 1 | n = 2 | n = 3 | n = 4 | n = 5 | VTK | exact |
|---|---|---|---|---|---|---|---|---|---|
"""


def main(arguments: list[str]) -> int:
    """Make the reports; 2 where a name is unknown, 1 where one fails."""
    cut = arguments.index("--") if "--" in arguments else len(arguments)
    names, options = arguments[:cut] or list(CASES), arguments[cut + 1 :]
    unknown = [name for name in names if name not in CASES]
    if unknown:
        print(f"there is no case {unknown[0]}; the cases are {', '.join(CASES)}", file=sys.stderr)
        return 2
    files = sorted({CASES[name][0] for name in names})
    missing = [name for name in files if not (ROOT / "out" / "cases" / f"{name}.fld").exists()]
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
    file, what, _ = CASES[name]
    data, what = [f"out/cases/{file}.xml", f"out/cases/{file}.fld"], shlex.split(what)
    command = ["elvis", "compare", *data, *what, "--size", "600x480", *options, "-o", f"out/reports/{name}"]
    print("$", shlex.join(command), flush=True)
    command[0] = str(Path(sys.executable).with_name("elvis"))
    return subprocess.run(command, cwd=ROOT).returncode


def write_page() -> None:
    """The table of all cases."""
    folders = {name: ROOT / "out" / "reports" / name for name in CASES}
    found = {name: json.loads((folder / "summary.json").read_text()) for name, folder in folders.items()}
    times = {name: json.loads((folder / "times.json").read_text())["seconds"] for name, folder in folders.items()}
    size = " x ".join(map(str, next(iter(found.values()))["picture"]["size"]))
    rows, said = [], []
    for name, numbers in found.items():
        rows += table_rows(name, numbers, times[name])
        data = numbers["data"]
        degrees = " to ".join(str(own) for own in sorted(set(data["degrees"])))
        what = f"{CASES[name][2]}; {data['elements_drawn']:,} elements" + (f" of degree {degrees}" if degrees else "")
        said.append(f"- **{name}**, {what}. {numbers['conclusion']}")
    PAGE.write_text(HEAD.format(size=size) + "\n".join([*rows, "", *said, ""]), encoding="utf-8")


def table_rows(name: str, numbers: dict, times: dict) -> list[str]:
    """The rows of a case: those of its numbers that it has."""
    rivals = {rival["key"]: rival for rival in numbers["baselines"]}
    exact = {"memory": memory(numbers["data"]["bytes"]), "time": f"{short(times['exact']['exact'])} s"}
    rows = [
        [word, *(cell(word, rivals[key], times.get(key, {})) if key in rivals else "" for key in KEYS)]
        for word in ("off", "contours", "surface", "memory", "time")
    ]
    kept = [[*row, exact.get(row[0], "")] for row in rows if set(row[1:]) - {"", "–"}]
    return [f"| {' | '.join([name if row is kept[0] else '', *row])} |" for row in kept]


def cell(word: str, rival: dict, seconds: dict) -> str:
    """One number of one picture; a dash where there is none."""
    if word == "memory":
        counts = rival["counts"]
        needs = "needed" in counts and "bytes" not in counts
        return f"needs {memory(counts['needed'])}" if needs else memory(counts["bytes"]) if "bytes" in counts else "–"
    if word == "time":
        return f"{short(sum(seconds.values()))} s" if seconds else "–"
    surfaces = [own["hausdorff"] for own in rival.get("surfaces", {}).values() if own]
    found = {"off": rival.get("off"), "contours": rival.get("contour_max"), "surface": max(surfaces, default=None)}
    unit = {"off": " %", "contours": " px", "surface": ""}[word]
    value = found[word]
    return "–" if value is None else short(value) + unit


def memory(count: float) -> str:
    """Bytes in megabytes."""
    return f"{short(count / 1e6)} MB"


def short(value: float) -> str:
    """Two digits, or all before the point."""
    return f"{value:.2g}" if value < 99.5 else f"{value:.0f}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
