"""Files that ElVis wrote: what a scene file names may replace these, and nothing else without ``--overwrite``."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from elvis.scene.model.errors import SceneError

#: what files that ElVis writes name as their program
SOFTWARE = "ElVis"
#: what the comment of JPEG files says
JPEG_COMMENT = b"Software: ElVis"
#: generator of HTML files, before the version
HTML_GENERATOR = "ElVis"
#: bytes at the beginning and at the end of a file that are searched for the mark
SEARCHED = 1 << 14
#: how the mark looks in each format: a text of PNG, an attribute of EXR, the creator in SVG and PDF, a generator in
#: HTML, a key of JSON
MARKS = {
    ".png": b"Software\0ElVis",
    ".jpg": JPEG_COMMENT,
    ".jpeg": JPEG_COMMENT,
    ".exr": b"software\0string\0\5\0\0\0ElVis",
    ".svg": b"<dc:title>ElVis</dc:title>",
    ".pdf": b"/Creator (ElVis)",
    ".html": f'<meta name="generator" content="{HTML_GENERATOR} '.encode(),
    ".json": b'"software": "ElVis"',
}
#: some arrays of a record, by which an archive is known
RECORD = {"color.npy", "depth.npy", "element.npy", "status.npy", "uncertainty.npy"}


def is_own(path: str | Path) -> bool:
    """Whether a file is one that ElVis wrote, by the mark in it."""
    with suppress(OSError, zipfile.BadZipFile):
        suffix = Path(path).suffix.lower()
        if suffix == ".npz":
            with zipfile.ZipFile(path) as archive:
                return set(archive.namelist()) >= RECORD
        return suffix in MARKS and MARKS[suffix] in _ends(Path(path))
    return False


def check_own(names: Iterable[str]) -> None:
    """Raise SceneError if a scene file names an output that is there and was not written by ElVis."""
    for name in names:
        if os.path.lexists(name) and not is_own(name):
            raise SceneError(
                f"{name}: not written: the scene file names it, but ElVis did not write the existing file; "
                "name another output with -o or --stats, or pass --overwrite"
            )


def _ends(path: Path) -> bytes:
    """The first and the last bytes of a plain file."""
    if not path.is_file():
        return b""
    with path.open("rb") as stream:
        start = stream.read(SEARCHED)
        size = stream.seek(0, os.SEEK_END)
        stream.seek(max(0, size - SEARCHED))
        return start + stream.read()
