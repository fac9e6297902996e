"""Draw the gallery again.

    python examples/gallery.py [NAME ...] [-- OPTION ...]      docs/NAME.png of examples/scenes/NAME.toml, or of all

Data that are not in out/cases yet are made first; files of solvers lie in out/pages (examples/page_data.py).  What
follows `--` goes to `elvis render`, so that a small, coarse
picture is quick: `python examples/gallery.py together -- --samples 1 --size 550x380`.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

from cases import CASES

from elvis.scene.model.files import read_scene

ROOT = Path(__file__).resolve().parent.parent
SCENES = ROOT / "examples" / "scenes"


def main(arguments: list[str]) -> int:
    """Draw the scenes; 2 where one is unknown, 1 where one fails."""
    cut = arguments.index("--") if "--" in arguments else len(arguments)
    names, options = arguments[:cut], arguments[cut + 1 :]
    known = sorted(path.stem for path in SCENES.glob("*.toml"))
    unknown = [name for name in names if name not in known]
    if unknown:
        print(f"there is no scene {unknown[0]}; the scenes are {', '.join(known)}", file=sys.stderr)
        return 2
    make_data(names or known)
    return max(draw(name, options) for name in names or known)


def make_data(names: list[str]) -> None:
    """Make the data of the scenes that are not there yet."""
    files = {Path(file) for name in names for file in read_scene(SCENES / f"{name}.toml").data}
    missing = [name for name in CASES if any(file.stem == name and not file.exists() for file in files)]
    if missing:
        folder = ROOT / "out" / "cases"
        subprocess.run([sys.executable, ROOT / "examples" / "cases.py", folder, *missing], check=True)
    if any(file.parent.name == "street" and not file.exists() for file in files):
        subprocess.run([sys.executable, ROOT / "examples" / "street.py"], check=True)


def draw(name: str, options: list[str]) -> int:
    """Draw one scene; the exit status of `elvis render`."""
    picture = ROOT / "docs" / f"{name}.png"
    command = [Path(sys.executable).with_name("elvis"), "render", SCENES / f"{name}.toml", "-o", picture, *options]
    start = time.perf_counter()
    status = subprocess.run(command).returncode
    size = picture.stat().st_size / 1000 if picture.exists() else 0
    print(f"{name}: {time.perf_counter() - start:.0f} s, {size:.0f} kB", flush=True)
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
