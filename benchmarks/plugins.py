"""What the plugin interface costs: the native format hard-wired, and derivatives that are not supplied.

python benchmarks/plugins.py [--quick] [--device vulkan] [--rounds 7] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from cases import CUT, FIELD, of_order, standard
from measuring import contention, in_turn

from elvis import Renderer, Scene, Shape
from elvis.core.base.terminal import print_table
from elvis.plugins.native import NativeVolume
from elvis.plugins.native import buffers as native
from elvis.plugins.runtime.volume import Part, PartsVolume, Volume, interface_folder
from elvis.renderer.device import device as devices

#: how much slower than hard-wired the interface may be
LIMIT = 1.1
OWN = Path(__file__).parent / "shaders"


def hard_wired(renderer: Renderer, part: Part, folder: Path) -> None:
    """Let the renderer's kernels name the type themselves: no interface, no linking of an extern type."""
    import slangpy

    device = renderer.device
    sessions: dict[bool, Any] = {}

    def link(stage: str, *_: str) -> devices.Kernel:
        together = stage in devices.TOGETHER
        if together not in sessions:
            path = folder / str(together)
            write_hard_wired(path, part, together, devices.ROWS[device.adapter.software])
            options = slangpy.SlangCompilerOptions()
            options.include_paths = [str(path)]
            sessions[together] = device._device.create_slang_session(options)
        module = sessions[together].load_module(stage)
        entry = module.entry_point(stage.rsplit("_", maxsplit=1)[-1])
        program = sessions[together].link_program([module], [entry])
        return devices.Kernel(device._device, program, device.watch)

    device._link = link  # type: ignore[method-assign]


def write_hard_wired(path: Path, part: Part, together: bool, rows: int) -> None:
    """All shaders, with constants and the element type written where the renderer links them."""
    path.mkdir(parents=True)
    for source in (*devices.SHADERS, interface_folder(), Path(native.__file__).parent):
        for file in source.glob("*.slang"):
            text = file.read_text(encoding="utf-8")
            text = text.replace(
                "extern struct TheVolume : IVolume;", f"import {part.module};\n#define TheVolume {part.type}"
            )
            text = re.sub(r"extern (static const bool lanes_together =) \w+", rf"\1 {str(together).lower()}", text)
            text = re.sub(r"extern (static const int rows =) \w+", rf"\1 {rows}", text)
            (path / file.name).write_text(text, encoding="utf-8")


def interface(device: str, quick: bool, rounds: int) -> dict[str, Any]:
    """The standard cut, through the interface and hard-wired."""
    case = standard(quick)
    volume = NativeVolume.of(case.dataset(), FIELD)
    (part,) = volume.parts
    with TemporaryDirectory() as folder, Renderer(device) as linked, Renderer(device) as wired:
        hard_wired(wired, part, Path(folder))
        return {
            "case": case.label,
            **compared({"hard-wired": (wired, volume), "interface": (linked, volume)}, quick, rounds),
        }


def derivatives(device: str, quick: bool, rounds: int) -> dict[str, Any]:
    """Quadratic hexahedra, with the native derivatives and with automatic ones."""
    case = of_order(Shape.HEXAHEDRON, 2, 3, quick)
    volume = NativeVolume.of(case.dataset(), FIELD)
    (part,) = volume.parts
    with TemporaryDirectory() as folder, Renderer(device) as supplied, Renderer(device) as automatic:
        for source in (OWN, volume.shader_folder):
            for file in source.glob("*.slang"):
                shutil.copy(file, folder)
        buffers = {**part.buffers, "element_boxes": part.boxes}
        kind = part.type.replace("Hexahedron", "Automatic")
        own = replace(part, module="automatic_hexahedron", type=kind, buffers=buffers)
        both = {"supplied": (supplied, volume), "automatic": (automatic, PartsVolume([own], Path(folder)))}
        return {"case": case.label, **compared(both, quick, rounds)}


def compared(both: dict[str, tuple[Renderer, Volume]], quick: bool, rounds: int) -> dict[str, Any]:
    """Frames of both in turn; the fields must be the same. The ratio is that of the processor seconds."""
    scene = Scene(FIELD, plane=CUT, size=(200, 200) if quick else (1000, 1000))
    frames = {}
    for name, (renderer, volume) in both.items():
        renderer.show(volume)
        frames[name] = renderer.render(scene, references=False)
    (first, one), (second, other) = frames.items()
    worst = float(np.nanmax(np.abs(one.field - other.field)))
    assert worst < 1e-11, f"{first} and {second} differ by {worst:g}"

    works = {name: lambda r=renderer: r.render(scene, references=False) for name, (renderer, _) in both.items()}
    timings = in_turn(works, rounds)
    ratio = timings[second].effort / timings[first].effort
    return {
        **{name: timing.record() for name, timing in timings.items()},
        "ratio": ratio,
        "pixels": int(one.seen.sum()),
    }


def rows(results: dict[str, dict[str, Any]]) -> list[Sequence[object]]:
    """One a way of drawing."""
    return [
        (result["case"], name, f"{record['best']:.3f}", f"{record['median']:.3f}", f"{record['processor']:.3f}")
        for result in results.values()
        for name, record in result.items()
        if isinstance(record, dict)
    ]


def main() -> None:
    """Measure, print, and fail where the interface costs more than its limit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    arguments = (options.device, options.quick, options.rounds)
    results = {"interface": interface(*arguments), "derivatives": derivatives(*arguments)}
    print_table(("case", "way", "best s", "median s", "CPU s"), rows(results))
    print(f"interface over hard-wired: {results['interface']['ratio']:.3f} (limit {LIMIT})")
    print(f"automatic over supplied derivatives: {results['derivatives']['ratio']:.2f}")
    print(f"clock over processor seconds of a busy loop: {contention():.2f}")
    if options.json:
        options.json.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    if not options.quick and results["interface"]["ratio"] > LIMIT:
        sys.exit(1)


if __name__ == "__main__":
    main()
