"""The reference on every shared case: seconds of a picture, and the tolerances that the device keeps against it.

    python benchmarks/validated.py                        all cases of ../shared/data, a cut, the outer faces and an
                                                       isosurface of each
    python benchmarks/validated.py tet_small fichera_q3   some of them
    python benchmarks/validated.py --size 60 --device cpu

Data of lines are left out: they have no exact reference.

Limit: 300 x 300 pixels in less than a minute of processor time.  One line a picture, in the form of a table.
"""

from __future__ import annotations

import argparse
import sys
import traceback
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np

from elvis import Faces, Plane, Renderer, Scene
from elvis.core.base.errors import ElvisError
from elvis.core.bounds.ranges import field_range
from elvis.core.data.dataset import Dataset
from elvis.core.summary.picturing import Kind
from elvis.formats.reading import read
from elvis.plugins.conversion.converting import convert
from elvis.plugins.conversion.discovery import choose_converter, installed_converters, with_defaults
from elvis.reference.record import Record
from elvis.reference.tolerances import check_tolerances
from elvis.renderer.asking.completing import completed
from elvis.renderer.frame.rendering import render as draw
from elvis.scene import Isosurface

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
HEAD = (
    "| case | elements | scene | reference, CPU s | pixels seen | ambiguous | value | position | fails |\n"
    "|---|---|---|---|---|---|---|---|---|"
)
#: the value of isosurfaces, between the ends of the range
MIDDLE = 0.52
#: endings of files that hold a mesh with its fields, or begin a conversion; what goes with them has the same stem
MESHES = (".msh", ".mesh", ".meshb", ".vtu", ".cgns", ".e", ".gen", ".vol", ".pyfrm", ".f00001", ".h5")


def cases() -> dict[str, tuple[Path, ...]]:
    """Files of every case by name."""
    found: dict[str, tuple[Path, ...]] = {}
    for folder in sorted((SHARED / "nektar").iterdir()):
        if folder.is_dir():
            names = sorted(path for path in folder.iterdir() if "zVariation" not in path.name)
            meshes = [path for path in names if path.name.endswith((".xml", "_xml"))]
            fields = [path for path in names if path.name.endswith((".fld", ".rst", ".chk"))]
            if meshes and fields:
                found[folder.name] = (meshes[0], fields[0])
    for folder in sorted((SHARED / "solvers").iterdir()):
        for path in sorted(folder.iterdir()) if folder.is_dir() else ():
            found.update((path.name, files) for files in _source(path))
    return found


def _source(path: Path) -> Iterator[tuple[Path, ...]]:
    """The files that a solver's mesh or solution is converted with."""
    siblings = sorted(path.parent.iterdir())
    if path.suffix == ".pyfrm":
        yield path, next(own for own in siblings if own.suffix == ".pyfrs")
    elif "State" in path.name or "Referenz" in path.name:
        meshes = [own for own in siblings if own.name.endswith("_mesh.h5")]
        yield path, next(own for own in meshes if own.name[:4].lower() == path.name.replace("reggie_", "")[:4].lower())
    elif path.suffix in MESHES and "mesh.h5" not in path.name:
        ends = (".gf", ".gfu", ".sol", ".solb")
        yield (
            path,
            *(own for own in siblings if own.suffix in ends and own.name.split(".")[0] == path.name.split(".")[0]),
        )


def opened(files: tuple[Path, ...]) -> Dataset:
    """The dataset of native files, or of converted ones."""
    if (SHARED / "nektar") in files[0].parents:
        return read(*files)
    converter = choose_converter(installed_converters(), files).converter
    assert converter is not None
    return convert(converter(files, **with_defaults(converter, {})), files=files).dataset


def scenes(data: Dataset, size: int) -> Iterator[tuple[str, Scene]]:
    """What there is to show of data: a cut, the faces and an isosurface of volumes, all else as it is."""
    spread = [np.ptp(np.concatenate([block.coefficients.ravel() for block in own.blocks])) for own in data.fields]
    name = data.fields[int(np.argmax(spread))].name if spread else "x"
    plain = Scene(name, size=(size, size))
    low, high = data.mesh.vertices.min(axis=0), data.mesh.vertices.max(axis=0)
    waves = data.fields[0].blocks[0].expansion.homogeneous if data.fields else None
    if waves:
        high[3 - len(waves.lengths) :] = waves.lengths
    if data.mesh.space != data.mesh.dimension or data.mesh.dimension + len(waves.lengths if waves else ()) < 3:
        yield "whole", plain
        return
    x, y, z = low + 0.51 * (high - low)
    yield "cut", replace(plain, plane=Plane((x, y, z), (0.1, 0.2, 1.0)))
    yield "faces", replace(plain, objects=(Faces(),), camera="iso")
    if name in [own.name for own in data.fields]:
        bounds = field_range(data.field(name).blocks)
        value = bounds.lower + MIDDLE * (bounds.upper - bounds.lower)
        yield "isosurface", replace(plain, objects=(Isosurface((value,)),), camera="iso")


def compared(name: str, what: str, data: Dataset, scene: Scene, device: str) -> str:
    """A row of the table: the picture by both, and where they differ."""
    start = process_time()
    frame = draw(data, scene, device="reference")
    seconds = process_time() - start
    scene = replace(frame.scene, camera=frame.view.camera, size=(frame.view.width, frame.view.height))
    known = scene.field in [field.name for field in data.fields]
    whole = field_range(data.field(scene.field).blocks) if known else None
    if device == "none":
        found = []
    else:
        with Renderer(device) as renderer:
            renderer.load(data, scene.field)
            drawn = renderer.render(completed(data, scene))
        span = float(np.linalg.norm(np.ptp(data.mesh.vertices, axis=0)))
        found = check_tolerances(Record.of(frame), Record.of(drawn), whole and (whole.lower, whole.upper), span)
    counts, measured = frame.counts(), {check.name: f"{check.found:.1e}" for check in found}
    elements = sum(map(len, data.mesh.elements.values()))
    fails = ", ".join(f"{check.name} {check.failed}" for check in found if not check.passed) or "none"
    cells = (f"{seconds:.1f}", int(frame.seen.sum()), counts["ambiguous"])
    cells = (*cells, measured.get("field value", "–"), measured.get("position", "–"), fails)
    return f"| {' | '.join(map(str, (name, elements, what, *cells)))} |"


def main(arguments: list[str]) -> int:
    """Print the table; 1 where a case could not be drawn."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", metavar="CASE")
    parser.add_argument("--size", type=int, default=300, help="pixels a side")
    parser.add_argument("--device", default="auto", help="what is held against the reference; none: seconds alone")
    options = parser.parse_args(arguments)
    every, failed = cases(), 0
    unknown = [name for name in options.cases if name not in every]
    if unknown:
        parser.error(f"there is no case {unknown[0]}; the cases are {', '.join(every)}")
    print(HEAD, flush=True)
    for name in options.cases or every:
        try:
            data = opened(every[name])
            if Kind.of(data) is Kind.LINE:
                continue
            for what, scene in scenes(data, options.size):
                print(compared(name, what, data, scene, options.device), flush=True)
        except (ElvisError, IndexError) as error:
            failed = 1
            print(f"| {name} | | | | | | | | {type(error).__name__}: {error} |", flush=True)
        except Exception:
            failed = 1
            traceback.print_exc()
    return failed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
