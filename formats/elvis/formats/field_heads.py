"""The head of a native field file: its time, and its fields and the elements they are on."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from elvis.core.base.errors import FormatError
from elvis.core.files.plain import leading
from elvis.formats.nektar import hdf5, xml
from elvis.formats.nektar.fields_input import read_hdf5_metadata, time_of
from elvis.formats.nektar.hdf5 import HDF5_SIGNATURE

#: bytes at the beginning of a file in which its time and its first section stand, and at the end in which it closes
_HEAD, _TAIL = 1 << 20, 1 << 12

_SECTION = re.compile(rb"<ELEMENTS\s([^>]*)")
_FIELDS = re.compile(rb"""\bFIELDS\s*=\s*["']([^"']*)""")
_IDS = re.compile(rb"""\bID\s*=\s*["']([^"']*)""")
_PLANES = re.compile(rb"""\bHOMOGENEOUS[YZ]IDS\s*=\s*["']([^"']*)""")
_TIME = re.compile(rb"<Time>([^<]*)</Time>")
_PIECES = re.compile(rb"<Partition\s[^>]*>([^<]*)<")


@dataclass(frozen=True)
class FieldHead:
    """Facts about a field file that are known without reading its coefficients.

    time   None if the file has none
    mark   identifies the fields, their elements and the Fourier modes: files with one mark have the same
    fault  why the file can't be whole; empty if nothing speaks against it
    """

    time: float | None
    mark: str
    fault: str = ""


def field_head(path: Path) -> FieldHead | None:
    """The head of a field file, or of a folder that holds one in pieces.

    None for anything else, damaged files included.
    """
    if path.is_dir():
        info = path / "Info.xml"
        return _of_xml(info, _PIECES) if info.is_file() else None
    if leading(path, len(HDF5_SIGNATURE)) == HDF5_SIGNATURE:
        return _of_hdf5(path)
    return _of_xml(path, _SECTION)


def is_no_mesh(path: Path) -> bool:
    """Whether the beginning of a file excludes a mesh; the file may then be an unfinished field file."""
    if not path.is_file():
        return False
    try:
        start = xml.head(path, _HEAD)
        if not start.startswith(HDF5_SIGNATURE):
            return b"<GEOMETRY" not in start
        with hdf5.reading(path):
            return False
    except (FormatError, OSError):
        return True


def _of_xml(path: Path, section: re.Pattern[bytes]) -> FieldHead | None:
    """The head of an XML file; ``section`` matches the parts that hold its fields and elements."""
    try:
        start = xml.head(path, _HEAD)
    except OSError:
        return None
    found = section.findall(start)
    if not found or b"<GEOMETRY" in start:
        return None
    told = [search.search(found[0]) for search in (_FIELDS, _IDS)]
    parts = [own[1] for own in told if own] or found
    parts += _PLANES.findall(found[0])
    time = _TIME.search(start)
    fault = "" if _is_closed(path) else "the file ends before its last tag"
    return FieldHead(time_of({"Time": time[1].decode("ascii", "replace")} if time else {}), _mark(parts), fault)


def _is_closed(path: Path) -> bool:
    """Whether the last tag is present; packed files are not checked."""
    with path.open("rb") as file:
        if file.read(2) == xml.GZIP_SIGNATURE:
            return True
        file.seek(max(0, os.fstat(file.fileno()).st_size - _TAIL))
        return b"</NEKTAR>" in file.read()


def _of_hdf5(path: Path) -> FieldHead | None:
    """The head of an HDF5 file."""
    try:
        with hdf5.reading(path) as file, hdf5.format_errors():
            root = hdf5.group(file, "NEKTAR")
            ids = None if root is None else hdf5.ints(root, "ELEMENTIDS")
            if root is None or ids is None:
                return None
            time = time_of(read_hdf5_metadata(root))
            counts = hdf5.unsigned(root, "DECOMPOSITION")
            planes = hdf5.ints(root, "HOMOGENEOUSZIDS")
    except (FormatError, OSError):
        return None
    return FieldHead(time, _mark([b"" if own is None else own.tobytes() for own in (ids, counts, planes)]))


def _mark(parts: list[bytes]) -> str:
    return sha256(b"\0".join(parts)).hexdigest()
