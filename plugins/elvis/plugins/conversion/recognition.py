"""Descriptions of files that no converter opens, with advice, for messages.

Converters know files related to their own formats (`Converter.hint`); this module covers the others.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

from elvis.core.base.errors import FormatError
from elvis.plugins.conversion.plugin import Converter

_HEAD = 4096
#: maximum number of files of a folder that are examined
_MANY = 200

#: beginnings of files, with their kind and advice
_BEGINNINGS: Sequence[tuple[bytes, str]] = (
    (rb"\x1f\x8b|BZh|\xfd7zXZ|PK\x03\x04(?!.{26}[^\0]*\.npy)|\x28\xb5\x2f\xfd", "a compressed file: unpack it"),
    (rb"PK\x03\x04", "an archive of NumPy arrays of unknown names"),
    (rb"\x93NUMPY", "a NumPy array"),
    (rb"\x80[\x02-\x05]", "a Python pickle, which could run any code: export from the program that wrote it"),
    (rb"\x89PNG|\xff\xd8\xff|GIF8|RIFF|%PDF", "a picture"),
    (rb"solid |ply\r?\n|glTF", "a surface of triangles, without a volume: it may be the target of distances"),
    (rb"#!TDV|(?i:\s*(title|variables)\s*=)", "a Tecplot file, whose values lie at points: export from the solver"),
    (rb"FoamFile|/\*-+\*- C\+\+ -\*-+\*\\", "an OpenFOAM file: write VTK with foamToVTK, and convert that"),
    (rb"(?s).{0,2000}?^\s*NDIME\s*=", "an SU2 mesh: write its solution as VTK or CGNS, and convert that"),
    (
        rb"\xec\x2b\x08\0|\0\x08\x2b\xec",
        "a restart file of SU2, which names no elements: write the solution as VTK or CGNS, and convert that",
    ),
    (
        rb"(?s)(# EnSight|FORMAT\s+type:\s*ensight|C Binary)",
        "EnSight data: save an unstructured grid (.vtu) in ParaView",
    ),
    (
        rb"""(?i)#?\s*("?\w+"?\s*,\s*)?"?[xyz]"?\s*,\s*"?\w+""",
        "a table of points: elvis convert --onto MESH interpolates its values onto a mesh",
    ),
    (
        rb"""(?s)(.*?^)?[\s{]*"?data"?\s*[=:]\s*["'\[]""",
        "a scene, which only render, view, animate and compare read: pass the data files that it names, and its "
        "[reference] as --set NAME=VALUE",
    ),
    (rb"CDF[\x01\x02\x05]", "a netCDF file without elements of Exodus"),
    (rb"(?s)(<\?xml.*?)?<Xdmf", "an XDMF file, which names others: save an unstructured grid (.vtu) in ParaView"),
    (rb"(?s)(<\?xml.*?)?<(\w+)", "an XML file with another root"),
)


def found_instead(path: Path, converters: Sequence[type[Converter]] = ()) -> str:
    """The kind of a file, in words that follow ``found``."""
    if path.is_dir():
        return _folder(path, converters)
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError as error:
        return f"a file that can't be read ({error.strerror})"
    if not head:
        return "an empty file"
    for converter in converters:
        hint = converter.hint(path)
        if hint:
            return hint
    return next(_describe(path, head))


def _folder(path: Path, converters: Sequence[type[Converter]]) -> str:
    """A folder, which holds files that are to be given in its place, or doesn't."""
    try:
        files = sorted(each for each in islice(path.iterdir(), _MANY) if each.is_file())
    except OSError as error:
        return f"a folder that can't be read ({error.strerror})"
    for file in files:
        if any(converter.opens([file]) for converter in converters):
            return f"a folder: pass files from it, such as {file}"
    return "a folder without pieces of a parallel run and without files of a known format"


def _describe(path: Path, head: bytes) -> Iterator[str]:
    if head.startswith(b"\x89HDF"):
        yield _hdf5(path)
    for beginning, words in _BEGINNINGS:
        if re.match(beginning, head, re.M):
            yield words
    if b"\0" in head:
        yield f"a binary file that begins {head[:8]!r}"
    line = head.decode("utf-8", "replace").strip().split("\n")[0].strip()
    yield f"a text that begins {line[:40]!r}"


def _hdf5(path: Path) -> str:
    """The kind of an HDF5 file by its contents."""
    import h5py  # type: ignore[import-untyped]

    from elvis.formats.nektar.hdf5 import format_errors
    from elvis.formats.nektar.hdf5_heaps import check_heaps

    try:
        check_heaps(path)
        with format_errors(), h5py.File(path) as file:
            # a name that is not valid UTF-8 comes as bytes
            names = sorted(name if isinstance(name, str) else name.decode("utf-8", "replace") for name in file)
    except FormatError:
        return "a damaged HDF5 file"
    if "topologies" in names:
        return "a checkpoint of Firedrake or PETSc: write its functions by VTKFile (.pvd), and convert that"
    return f"an HDF5 file with {', '.join(names[:5]) or 'nothing'}{', ...' if len(names) > 5 else ''}"
