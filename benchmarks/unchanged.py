"""Whether the pictures are what they were: every record and every image, byte by byte.

    python benchmarks/unchanged.py before/                      draw the gallery, the demo and 20 shared data sets
    python benchmarks/unchanged.py after/ --against before/     draw them again, in another tree, and compare

The pictures are small: the gallery and the demo at a fifth of their size.  Exit status 1 where one differs.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
SHARED = ROOT.parent / "shared" / "data" / "nektar"
ELVIS = Path(sys.executable).with_name("elvis")
SIZE = "180x150"
ISO = ["--camera", "iso"]

GALLERY = sorted(path.stem for path in (ROOT / "examples" / "scenes").glob("*.toml"))
#: pictures of the generated data: name of the data, options
DEMO = {
    "cylinder": ("cylinder", ["--field", "Cp", "--colormap", "turbo"]),
    "bend": ("bend", ["--plane", "0,0,0:0,0,1"]),
    "bend-across": ("bend", ["--plane", "1.4,1.4,0:-1,1,0"]),
    "blocks": ("blocks", ["--plane", "1.5,0.5,0.45:0.1,0.2,1"]),
    "blocks-faces": ("blocks", ["--faces", "all", "--mesh-lines", *ISO]),
}
FLAT = (
    *("bfs_tq7", "bfs_tq7_hdf5", "cyl_mixorder", "gen_quadface_2d", "helmholtz_tq", "interptest", "kova_varp"),
    *("nodal_triquad", "quad4", "taylor_q8"),
)
SOLID = (
    *("chan3d_tet", "gen_allelem_n4", "gen_allelem_ortho", "gen_allelem_var_h5", "gen_hex_xscale", "gen_pipe_curved"),
    *("gen_pyr_curved", "gen_tet_p8_nekg2", "hex_c0", "prismhex_wss"),
)

KINDS = ("cut", "faces", "isosurface", "volume")


def pictures(only: str = "") -> Iterator[tuple[str, list[str]]]:
    """Names of pictures that hold a text, and the arguments of ``elvis render`` that draw them."""
    yield from ((name, options) for name, options in flat_pictures() if only in name)
    for name in SOLID:
        # what is to be drawn of 3D data is read from ``elvis info``, which takes its time
        if any(only in f"{name}-{kind}" for kind in KINDS):
            yield from ((own, options) for own, options in solid_pictures(name) if only in own)


def flat_pictures() -> Iterator[tuple[str, list[str]]]:
    """Those of scenes, of the generated data and of 2D data."""
    for name in GALLERY:
        yield f"gallery-{name}", [f"examples/scenes/{name}.toml", "--size", SIZE, "--samples", "1"]
    for name, (data, options) in DEMO.items():
        yield f"demo-{name}", [f"out/data/{data}.xml", f"out/data/{data}.fld", *options, "--size", SIZE]
    for name in FLAT:
        yield f"{name}-lines", [*files_of(name), "--contours", "7", "--mesh-lines", "--size", SIZE]


def solid_pictures(name: str) -> Iterator[tuple[str, list[str]]]:
    """A cut, the boundary, an isosurface and a volume of 3D data, all of the field that varies most."""
    files = files_of(name)
    described = subprocess.run([ELVIS, "info", *files, "--json"], check=True, capture_output=True, text=True)
    facts = json.loads(described.stdout)
    field = max(facts["fields"], key=lambda item: item["range"]["upper"] - item["range"]["lower"])
    box = facts["geometry"]["box"]
    middle = (np.array(box["lower"]) + np.array(box["upper"])) / 2
    low, high = field["range"]["lower"], field["range"]["upper"]
    levels = low + (high - low) * np.array([0.2, 0.5, 0.6, 0.9])
    size = ["--size", SIZE, "--field", field["name"]]
    place = ",".join(f"{number:.6g}" for number in middle)
    transfer = f"{levels[0]:.6g}:0,{levels[2]:.6g}:{5 / np.ptp([box['lower'], box['upper']]):.6g},{levels[3]:.6g}:0"

    drawn = {
        "cut": ["--plane", f"{place}:0.1,0.2,1"],
        "faces": ["--faces", "all", "--mesh-lines", "--contours", "5", *ISO],
        "isosurface": [f"--isosurface={levels[1]:.6g},{levels[2]:.6g}", *ISO],
        "volume": [f"--volume={transfer}", *ISO],
    }
    for kind in KINDS:
        yield f"{name}-{kind}", [*files, *size, *drawn[kind]]


def files_of(name: str) -> list[str]:
    """Mesh and field files of shared data."""
    kept = (".xml", ".fld", ".chk", ".rst")
    return [str(path) for path in sorted((SHARED / name).iterdir()) if path.suffix in kept]


def main() -> int:
    """Draw all pictures; where asked, compare them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="where records and images go")
    parser.add_argument("--against", type=Path, help="a folder that an earlier run has made")
    parser.add_argument("--only", default="", help="names that hold this text")
    arguments = parser.parse_args()
    folder = arguments.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    make_data()
    chosen = list(pictures(arguments.only))
    for name, options in chosen:
        draw(folder / name, options)
    if arguments.against is None:
        return 0
    drawn = [name for name, _ in chosen]
    known = [name for name in drawn if Path(f"{arguments.against / name}.npz").exists()]
    different = [name for name in known if not same(folder / name, arguments.against / name)]
    for name in drawn:
        if name not in known:
            print(f"{name} is new")
    for name in different:
        print(f"{name} differs")
    print(f"{len(known) - len(different)} of {len(known)} pictures are what they were, byte by byte")
    return 1 if different or not known else 0


def make_data() -> None:
    """The generated data, where they are not there yet."""
    made = {
        "generate.py": [ROOT / "out" / "data" / "blocks.fld"],
        "cases.py": [ROOT / "out" / "cases" / "twist.fld"],
        "page_data.py": [ROOT / "out" / "pages" / "sphere.fld", SHARED.parent],
    }
    for script, (last, *sources) in made.items():
        if not last.exists():
            subprocess.run([sys.executable, f"examples/{script}", last.parent, *sources], cwd=ROOT, check=True)


def draw(place: Path, options: list[str]) -> None:
    """Draw one picture as PNG and as its record."""
    start = perf_counter()
    written = ["-o", f"{place}.png", "-o", f"{place}.npz", "--overwrite"]
    subprocess.run([ELVIS, "render", *options, *written], cwd=ROOT, check=True)
    print(f"{place.name}: {perf_counter() - start:.1f} s", flush=True)


def same(one: Path, other: Path) -> bool:
    """Whether image and record are equal in all bytes; a record's file also holds the time when it was written."""
    if Path(f"{one}.png").read_bytes() != Path(f"{other}.png").read_bytes():
        return False
    with np.load(f"{one}.npz") as here, np.load(f"{other}.npz") as there:
        return here.files == there.files and all(
            here[name].dtype == there[name].dtype and here[name].tobytes() == there[name].tobytes()
            for name in here.files
        )


if __name__ == "__main__":
    sys.exit(main())
