"""Large pictures of few elements, and first pictures of many, whole processes: seconds and memory."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from cases import Case, mild, million
from tables import Table, mebibytes, seconds

from elvis import Shape, write

ELVIS = [sys.executable, "-c", "from elvis.plugins.command.command import main; main()"]
CAMERA = ["--camera", "2,-1.6,1.7:0.5,0.5,0.5:0,0,1:35"]
KINDS = {
    "cut": ["--plane", "0.5,0.5,0.4:0.1,0.2,1"],
    "faces": ["--faces", "all", *CAMERA],
    "isosurface": ["--isosurface", "0.3", *CAMERA],
}


def measure(device: str, side: int, kinds: Sequence[str]) -> dict[str, Any]:
    """Pictures of side^2 pixels, and small ones next to them, which hold what all processes do."""
    case = Case("few", Shape.TETRAHEDRON, 1, 1, 3, mild)
    found: dict[str, Any] = {"side": side, "elements": case.elements, "kinds": {}}
    with TemporaryDirectory() as folder:
        files = [str(path) for path in write(case.dataset(), Path(folder) / "few.xml")]
        for kind in kinds:
            common = [*ELVIS, "render", *files, *KINDS[kind], "--device", device, "-o", f"{folder}/out.png"]
            small = drawn([*common, "--size", "100x100"])
            large = drawn([*common, "--size", f"{side}x{side}"])
            file = (Path(folder) / "out.png").stat().st_size
            found["kinds"][kind] = {"small": small, "large": large, "file": file}
    return found


def measure_loading(device: str, cells: int, rounds: int) -> dict[str, Any]:
    """First pictures of 6 cells^3 straight tetrahedra from HDF5 files, kernels at hand: the quickest of some rounds."""
    case = million(cells=cells)
    found: dict[str, Any] = {"case": case.label, "elements": case.elements, "kinds": {}}
    with TemporaryDirectory() as folder:
        path = Path(folder) / "million.xml"
        written = write(case.dataset(), path, mesh_format="hdf5", field_format="hdf5")
        found["files"] = sum(file.stat().st_size for file in written)
        for kind in ("cut", "faces"):
            options = [*KINDS[kind], "--device", device, "--size", "1000x1000"]
            files = [str(path), str(path.with_suffix(".fld")), "-o", f"{folder}/out.png", "--overwrite"]
            command = [*ELVIS, "render", *files, *options]
            runs = [drawn(command) for _ in range(1 + rounds)][1:]
            found["kinds"][kind] = {key: min(run[key] for run in runs) for key in runs[0]}
    return found


def loading_table(numbers: dict[str, Any]) -> Table:
    """A row a kind."""
    columns = ["", "s", "CPU s", "CPU us an element", "MiB"]
    shown = Table(f"First picture of {numbers['elements']:,} tetrahedra", columns)
    for kind, found in numbers["kinds"].items():
        each = f"{1e6 * found['processor'] / numbers['elements']:.2f}"
        costs = [seconds(found["seconds"]), seconds(found["processor"]), each, mebibytes(found["bytes"])]
        shown.rows.append([kind, *costs])
    shown.notes = [
        f"{numbers['case']}; HDF5 files of {mebibytes(numbers['files'])} MiB; 1000 x 1000 pixels, whole processes. "
        "CPU seconds include drawing where Vulkan is software."
    ]
    return shown


def drawn(command: list[str]) -> dict[str, float]:
    """Run a process to its end: seconds, processor seconds, most bytes in memory."""
    start = perf_counter()
    process = subprocess.Popen(command)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    busy = usage.ru_utime + usage.ru_stime
    return {"seconds": perf_counter() - start, "processor": busy, "bytes": 1024 * usage.ru_maxrss}


def table(numbers: dict[str, Any]) -> Table:
    """A row a kind."""
    side = numbers["side"]
    columns = ["", "s", "CPU s", "ns per pixel", "MiB", "bytes per pixel", "MiB of 100 x 100", "MiB of the file"]
    shown = Table(f"{side} x {side} pixels of {numbers['elements']} elements", columns)
    for kind, found in numbers["kinds"].items():
        large, small = found["large"], found["small"]
        pixels = side * side
        costs = [seconds(large["seconds"]), seconds(large["processor"]), f"{1e9 * large['processor'] / pixels:.0f}"]
        memory = [mebibytes(large["bytes"]), f"{large['bytes'] / pixels:.1f}", mebibytes(small["bytes"])]
        shown.rows.append([kind, *costs, *memory, mebibytes(found["file"])])
    shown.notes = ["From files to PNG, with legend and axes. The image and its statuses alone are 4 bytes per pixel."]
    return shown
