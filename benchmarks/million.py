"""A million straight tetrahedra with a cubic field: read, build, draw, probe; time, memory and bytes on the device.

python benchmarks/million.py FOLDER DEVICE SIDE POINTS      one process that does it and prints JSON
"""

from __future__ import annotations

import gc
import json
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np
from cases import FIELD, cut, million
from measuring import ENVIRONMENT, forget_peak, memory, once, peak_memory
from tables import Table, mebibytes, seconds

from elvis import Dataset, read, write
from elvis.core.base.arrays import Floats
from elvis.core.mapping.boxes import BoxTree
from elvis.core.mapping.patch import patches

T = TypeVar("T")
FILES = ("million.xml", "million.nekg", "million.fld")


class Diary:
    """Seconds and memory of one step after the other."""

    def __init__(self) -> None:
        self.steps: dict[str, dict[str, float]] = {}

    def step(self, name: str, work: Callable[[], T]) -> T:
        """Do the work; note its seconds, and the resident memory before, after and at its largest."""
        gc.collect()
        before = memory()
        forget_peak()
        result, timing = once(work)
        self.steps[name] = {
            "seconds": timing.best,
            "processor": timing.effort,
            "before": before,
            "peak": peak_memory(),
            "after": memory(),
        }
        return result


def measure(device: str, cells: int, side: int, points: int) -> dict[str, Any]:
    """Write the files, then run the steps in a process of their own."""
    case = million(cells=cells)
    with TemporaryDirectory() as folder:
        made, making = once(case.dataset)
        path = Path(folder) / FILES[0]
        _, writing = once(partial(write, made, path, mesh_format="hdf5", field_format="hdf5"))
        sizes = {name: (Path(folder) / name).stat().st_size for name in FILES}
        del made
        command = [sys.executable, __file__, folder, device, str(side), str(points)]
        process = subprocess.run(command, env=ENVIRONMENT, stdout=subprocess.PIPE, text=True, check=True)
    return {
        "case": case.label,
        "elements": case.elements,
        "pixels": [side, side],
        "points": points,
        "make": making.best,
        "write": writing.best,
        "files": sizes,
        **json.loads(process.stdout.splitlines()[-1]),
    }


def steps(folder: Path, device: str, side: int, points: int) -> dict[str, Any]:
    """From the files to pictures and probes."""
    from elvis import Renderer
    from elvis.plugins.native import NativeVolume

    diary = Diary()
    dataset = diary.step("read", lambda: read(folder / FILES[0], folder / FILES[2]))
    diary.step("patches", lambda: patches(dataset, [FIELD]))
    volume = diary.step("volume", lambda: NativeVolume.of(dataset, FIELD))
    boxes = np.concatenate([part.boxes for part in volume.parts])
    tree = diary.step("tree", lambda: BoxTree.build(boxes))
    renderer = diary.step("open the device", lambda: Renderer(device))
    diary.step("upload", lambda: renderer.show(volume))
    held = renderer.device.bytes_made
    frame = diary.step("first picture", lambda: renderer.render(cut(side), references=False))
    for _ in range(3):
        diary.step("next picture", lambda: renderer.render(cut(side), references=False))
    drawn = renderer.device.bytes_made
    where = np.random.default_rng(0).random((points, 3))
    diary.step("first probe", lambda: renderer.probe(where))
    probing = renderer.device.bytes_made - drawn
    places = diary.step("next probe", lambda: renderer.probe(where))
    return {
        "steps": diary.steps,
        "arrays": array_bytes(dataset),
        "raw": raw_bytes(dataset),
        "device": {"loaded": held, "all frames": drawn - held, "probe": probing},
        "tree": {"nodes": len(tree.nodes), "boxes": len(boxes)},
        "status": frame.counts(),
        "probe error": probe_error(dataset, where[:500], places.field[:500]),
    }


def array_bytes(dataset: Dataset) -> int:
    """Bytes of the arrays of a dataset."""
    mesh = dataset.mesh
    arrays = [mesh.vertex_ids, mesh.vertices]
    for entities in mesh.entities.values():
        arrays += [entities.ids, entities.members]
    for composite in mesh.composites:
        arrays += [ids for _, ids in composite.parts]
    arrays += [
        array for field in dataset.fields for block in field.blocks for array in (block.element_ids, block.coefficients)
    ]
    return sum(array.nbytes for array in arrays)


def raw_bytes(dataset: Dataset) -> int:
    """Bytes of the field's coefficients and the vertices alone."""
    return dataset.mesh.vertices.nbytes + sum(block.coefficients.nbytes for block in dataset.fields[0].blocks)


def probe_error(dataset: Dataset, points: Floats, found: Floats) -> float:
    """Largest difference from the NumPy evaluation, as a share of the range of the values found."""
    from elvis.core.numbers.sampling import sample

    truth = sample(dataset, [FIELD], points).values[:, 0]
    return float(np.nanmax(np.abs(truth - found)) / np.ptp(truth[np.isfinite(truth)]))


def table(numbers: dict[str, Any]) -> Table:
    """A row a step."""
    shown = Table(
        f"{numbers['elements']:,} tetrahedra", ["step", "s", "CPU s", "MiB before", "MiB at most", "MiB after"]
    )
    for name, step in numbers["steps"].items():
        sizes = [mebibytes(step[key]) for key in ("before", "peak", "after")]
        shown.rows.append([name, seconds(step["seconds"]), seconds(step["processor"]), *sizes])
    arrays, raw, device = numbers["arrays"], numbers["raw"], numbers["device"]
    growth = (numbers["steps"]["read"]["peak"] - numbers["steps"]["read"]["before"]) / arrays
    files, (width, height) = sum(numbers["files"].values()), numbers["pixels"]
    shown.notes = [
        f"{numbers['case']}; {width} x {height} pixels; {numbers['points']:,} random points; HDF5 files of "
        f"{mebibytes(files)} MiB (made in {seconds(numbers['make'])} s, written in {seconds(numbers['write'])} s). "
        "Memory is that of the process, which is the device's memory too where Vulkan is software.",
        f"Arrays of the dataset: {mebibytes(arrays)} MiB; reading took at most {growth:.2f} times that. Coefficients "
        f"and vertices: {mebibytes(raw)} MiB; on the device for pictures: {mebibytes(device['loaded'])} MiB, "
        f"{device['loaded'] / raw:.3f} times that; for probes another {mebibytes(device['probe'])} MiB. The tree is "
        f"over {numbers['tree']['boxes']:,} boxes. Probe error: {numbers['probe error']:.0e} of the range.",
    ]
    return shown


if __name__ == "__main__":
    print(json.dumps(steps(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))))
