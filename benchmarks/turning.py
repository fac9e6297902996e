"""Turning in a browser: drafts a second, their sizes and bytes, processor seconds of each, time until all is sharp.

    python benchmarks/turning.py                  five data sets as `elvis DATA` shows them, and the wing with a cut
    python benchmarks/turning.py wing delta       some of them
    python benchmarks/turning.py --seconds 5 --pictures out

A browser (Playwright, Chromium) opens the page of `elvis view`, drags the mouse round over the picture, 60 events a
second, and lets go.  The page records every draft that it shows.  Data that are missing are made or converted into
out/turning.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import pairwise
from math import cos, pi, sin
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from playwright.sync_api import Page, sync_playwright
from starting import ELVIS
from tables import Table, seconds

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared" / "data"
FOLDER = ROOT / "out" / "turning"
NACA = [
    SHARED / "solvers/hopr_flexi" / name
    for name in ("NACA0012_Re5000_AoA8_3D_Referenz_0000010.000000000.h5", "NACA0012_652_Ng2_mesh.h5")
]
PIPE = [SHARED / "nektar/gen_pipe_curved" / name for name in ("Womersley_PipeFlow.xml", "gen_pipe_curved.fld")]
#: names of scenes: the command that makes the data if they are missing, the data, options of `elvis view`
SCENES: dict[str, tuple[list[str], list[Path], list[str]]] = {
    "wing": ([*ELVIS, "sample", "wing"], [FOLDER / "wing.xml", FOLDER / "wing.fld"], []),
    "wing, cut": (
        [*ELVIS, "sample", "wing"],
        [FOLDER / "wing.xml", FOLDER / "wing.fld"],
        ["--field", "p", "--faces", "wing", "--plane", "z=0.2", "--mesh-lines"],
    ),
    "delta": (
        [sys.executable, str(ROOT / "examples/cases.py"), ".", "delta"],
        [FOLDER / "delta.xml", FOLDER / "delta.fld"],
        [],
    ),
    "NACA": ([], NACA, []),
    "pipe": ([], PIPE, []),
    "2D cylinder": ([*ELVIS, "sample", "cylinder"], [FOLDER / "cylinder.xml", FOLDER / "cylinder.fld"], []),
}
#: the window in CSS pixels
WINDOW = {"width": 1280, "height": 800}
#: events of the mouse a second, and the radius of the circle that it describes, in CSS pixels
RATE, RADIUS = 60.0, 120.0
#: seconds until the first picture has to be there
PATIENCE = 300.0
#: let the page note what it shows: each draft with its time, size and bytes, and each moved picture
RECORD = """() => {
  const { elvis } = window, notes = (window.notes = { pictures: [], moved: 0 });
  const queue = elvis.queue.bind(elvis), show = elvis.warp.show.bind(elvis.warp);
  elvis.queue = (facts, buffer) => {
    const { final, image, revision } = facts;
    notes.pictures.push({ when: performance.now() / 1000, final, width: image[2], bytes: buffer.byteLength, revision });
    return queue(facts, buffer);
  };
  elvis.warp.show = (camera) => { notes.moved += 1; return show(camera); };
}"""
IS_SHARP = "window.elvis?.root.dataset.final && window.elvis.root.dataset.final == window.elvis.revision"


@contextmanager
def served(data: list[Path], options: list[str]) -> Iterator[tuple[str, int]]:
    """Address of the page, and id of the process that serves."""
    command = [*ELVIS, "view", *map(str, data), *options, "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip(), process.pid
        finally:
            process.terminate()


def children(pid: int) -> list[int]:
    """The processes that a process has started."""
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        found += map(int, (task / "children").read_text().split())
    return found


def processor_seconds(pid: int) -> float:
    """Processor seconds of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def below(pid: int, without: int = 0) -> float:
    """Processor seconds of all processes below one, but for one of these with those below it."""
    total = 0.0
    for child in children(pid):
        if child != without:
            total += processor_seconds(child) + below(child, without)
    return total


def efforts(server: int) -> dict[str, float]:
    """Processor seconds of the process that draws, of the one that serves, and of the browser with its driver."""
    return {"drawing": below(server), "serving": processor_seconds(server), "browser": below(os.getpid(), server)}


def drag(page: Page, duration: float) -> None:
    """Describe circles with the mouse from the middle of the picture, and let go."""
    box = page.get_by_label("the picture", exact=True).bounding_box()
    assert box is not None
    x, y = box["x"] + 0.45 * box["width"], box["y"] + 0.5 * box["height"]
    page.mouse.move(x, y)
    page.mouse.down()
    begin = perf_counter()
    number = 0
    while perf_counter() - begin < duration:
        number += 1
        angle = 0.4 * pi * (perf_counter() - begin)
        page.mouse.move(x + RADIUS * sin(angle), y + RADIUS * (1 - cos(angle)))
        page.wait_for_timeout(max(0.0, 1000 * (number / RATE - (perf_counter() - begin))))


def measure(page: Page, pid: int, duration: float, picture: Path | None) -> dict[str, float]:
    """Numbers of the second of two drags, since the first one may compile kernels."""
    page.wait_for_function(IS_SHARP, timeout=1000 * PATIENCE)
    drag(page, 1.0)
    page.mouse.up()
    page.wait_for_function(IS_SHARP, timeout=1000 * PATIENCE)
    page.wait_for_timeout(1000)
    page.evaluate(RECORD)
    full = page.evaluate("window.elvis.picture.image[2]")
    before = efforts(pid)
    drag(page, duration)
    after = efforts(pid)
    notes = page.evaluate("window.notes")
    if picture is not None:
        page.screenshot(path=picture)
    count = sum(not one["final"] for one in notes["pictures"])
    released = perf_counter()
    page.mouse.up()
    page.wait_for_function(IS_SHARP, timeout=1000 * PATIENCE)
    sharp = perf_counter() - released
    return {**numbers_of(notes["pictures"], full), "moved": notes["moved"] / duration, "sharp": sharp} | {
        **{name: (after[name] - before[name]) / max(1, count) for name in before},
        "rate": count / duration,
    }


def numbers_of(pictures: list[Mapping[str, Any]], full: int) -> dict[str, float]:
    """Sizes, changes of the size, seconds between drafts and bytes of the drafts of a drag."""
    drafts = [one for one in pictures if not one["final"]]
    sizes = [one["width"] for one in drafts]
    waits = [after["when"] - before["when"] for before, after in pairwise(drafts)]
    return {
        "share": float(np.median(sizes)) / full if sizes else np.nan,
        "changes": sum(one != other for one, other in pairwise(sizes)),
        "wait": float(np.percentile(waits, 95)) if waits else np.nan,
        "bytes": float(np.median([one["bytes"] for one in drafts])) if drafts else np.nan,
    }


def table(found: dict[str, dict[str, float]]) -> Table:
    """A row a scene."""
    columns = ["scene", "drafts a second", "95 % gap s", "width", "size changes", "kB a draft", "CPU s of drawing"]
    rows = [
        [
            name,
            f"{own['rate']:.1f}",
            seconds(own["wait"]),
            f"{own['share']:.2f}",
            f"{own['changes']:.0f}",
            f"{own['bytes'] / 1000:.1f}",
            *(seconds(own[name]) for name in ("drawing", "serving", "browser")),
            f"{own['moved']:.0f}",
            seconds(own["sharp"]),
        ]
        for name, own in found.items()
    ]
    columns += ["serving", "browser", "moved a second", "sharp after s"]
    notes = [
        "width: of a draft, as a part of the sharp picture's; moved: pictures that the page moves by itself.",
        "Processor seconds are those of a draft.",
    ]
    return Table("Turning in a browser", columns, rows, notes)


def main() -> None:
    """Measure the scenes that were named."""
    parser = argparse.ArgumentParser(description="Turning in a browser.")
    parser.add_argument("scenes", nargs="*", choices=[*SCENES, []], metavar="SCENE", help=", ".join(SCENES))
    parser.add_argument("--seconds", type=float, default=4.0, help="duration of a drag")
    parser.add_argument("--device", default="auto", help="as of elvis render")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="write a screenshot taken within each drag")
    options = parser.parse_args()
    found = {}
    FOLDER.mkdir(parents=True, exist_ok=True)
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
    with sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        for name in options.scenes or SCENES:
            making, data, more = SCENES[name]
            if not all(file.exists() for file in data):
                subprocess.run(making, cwd=FOLDER, check=True, stdout=subprocess.DEVNULL)
            picture = options.pictures / f"{name.replace(', ', '-')}.png" if options.pictures else None
            with served(data, [*more, "--device", options.device]) as (address, pid):
                page = browser.new_page(viewport=WINDOW, bypass_csp=True)
                page.goto(address)
                found[name] = measure(page, pid, options.seconds, picture)
                page.close()
        browser.close()
    print(table(found).text())


if __name__ == "__main__":
    main()
