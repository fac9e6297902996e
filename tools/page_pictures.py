"""Draw the pictures of the pages again: run the commands that stand in them, and keep what they show in docs/pictures.

    python tools/page_pictures.py FOLDER [PAGE ...]      FOLDER has the data (examples/page_data.py)

Only commands whose picture the page shows are run.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
PICTURES = DOCS / "pictures"
BLOCK = re.compile(r"^```sh\n(.*?)^```$", re.M | re.S)
SHOWN = re.compile(r"\]\((?:\.\./)?pictures/([^)]+)\)")


def main(arguments: list[str]) -> None:
    """Draw the pictures of some pages, or of all."""
    folder, *names = arguments
    pages = [Path(name).resolve() for name in names] or sorted(DOCS.rglob("*.md"))
    for page in pages:
        for picture, words in commands(page.read_text(encoding="utf-8")):
            draw(Path(folder), picture, words)


def commands(text: str) -> Iterator[tuple[str, list[str]]]:
    """Each picture that a page shows, with the command that draws it."""
    lines = [line for block in BLOCK.findall(text) for line in block.replace("\\\n", "").splitlines()]
    for picture in dict.fromkeys(SHOWN.findall(text)):
        # other commands may go on over lines, which are no words by themselves
        yield picture, shlex.split(next(line for line in lines if line.endswith(f" {picture}")))


def draw(folder: Path, picture: str, words: list[str]) -> None:
    """Run a command, and keep its picture."""
    command = [Path(sys.executable).with_name("elvis"), *words[1:], "--overwrite"]
    subprocess.run(command, cwd=folder, check=True)
    PICTURES.mkdir(exist_ok=True)
    shutil.copy(folder / picture, PICTURES)
    print(f"{picture}: {(folder / picture).stat().st_size / 1000:.0f} kB", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
