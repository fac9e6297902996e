"""Make one folder of links for editors that check types: the package as it is where it is installed.

    python tools/checkout_package.py FOLDER        FOLDER/elvis, with links to the modules of all areas

A checkout has five folders elvis, of which pyright and Pylance see only one.  `make setup` makes .venv/package, where
pyproject.toml sends them.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def link(folder: Path) -> None:
    """Link the modules and slices of all areas to a folder ``elvis`` in this one, which is made again."""
    package = folder / "elvis"
    shutil.rmtree(package, ignore_errors=True)
    package.mkdir(parents=True)
    for area in ROOT.glob("*/elvis"):
        for path in area.iterdir():
            if path.name not in ("__pycache__", "py.typed"):
                (package / path.name).symlink_to(path)
    (package / "py.typed").touch()


if __name__ == "__main__":
    link(Path(sys.argv[1]))
