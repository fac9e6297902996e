"""NGSolve's own files: Netgen meshes (.vol) and the numbers of grid functions (.gfu), read by the library.

A .gfu file holds numbers alone; the user says in which space they are.  What the library does not survive in a mesh is
looked for before it reads.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elvis.converters.ngsolve_export import samples
from elvis.formats.arrays import Ints
from elvis.formats.errors import ElvisError, FormatError
from elvis.plugins.discovery import EXTRA

#: spaces that can be named
SPACES = ("H1", "L2", "VectorH1", "VectorL2", "HDiv", "HCurl")

_BEGIN = re.compile(rb"(?m)^mesh[123]d\s*$")
_SPACE = re.compile(rf"({'|'.join(SPACES)}):(\d{{1,2}})")
_HIGHEST, _HEAD = 20, 400

#: sections of elements, with the columns of the number of vertices
_ELEMENTS = {
    "surfaceelements": 4,
    "surfaceelementsgi": 4,
    "surfaceelementsuv": 4,
    "surfaceelementsgi3": 4,
    "volumeelements": 1,
}

#: what a process of its own tries, with bytes of memory at most
_TRIAL = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[2]),) * 2)
import ngsolve
mesh = ngsolve.Mesh(sys.argv[1])
space = ngsolve.H1(mesh, order=1)
"""
_LIMIT, _PER_BYTE = 4 << 30, 200


def is_mesh(path: Path) -> bool:
    """Whether a file begins as Netgen's meshes do."""
    try:
        with path.open("rb") as file:
            return _BEGIN.search(file.read(_HEAD)) is not None
    except OSError:
        return False


def sampled(paths: Sequence[Path], spaces: str | None) -> dict[str, Any]:
    """What the samples of a mesh and its functions are: see `ngsolve_export.samples`.

    spaces  of the functions, as ``H1:5,L2:4``, in the order of their files
    FormatError for damaged files; ElvisError where spaces are missing or don't fit.
    """
    meshes, functions = [p for p in paths if is_mesh(p)], [p for p in paths if not is_mesh(p)]
    if len(meshes) != 1:
        raise FormatError(f"expected one mesh (.vol), found {len(meshes)}", file=paths[0])
    named = _spaces(spaces, functions)
    try:
        import ngsolve
    except ImportError:
        raise ElvisError(
            f"the converter ngsolve needs ngsolve for {meshes[0].name}, which is not installed; "
            f"pip install 'elvis-viz[{EXTRA}]' brings it"
        ) from None
    _check(meshes[0])
    mesh = ngsolve.Mesh(str(meshes[0]))
    fields = {_name(meshes[0], path): _function(ngsolve, mesh, path, *own) for path, own in named}
    return samples(mesh, fields)


def _spaces(spaces: str | None, functions: Sequence[Path]) -> list[tuple[Path, tuple[str, int]]]:
    """The space and order of each function's file."""
    found = [part.strip() for part in (spaces or "").split(",") if part.strip()]
    if len(found) != len(functions):
        expected = f"a space for each of {len(functions)} .gfu files, which don't say theirs"
        raise ElvisError(f"expected {expected} (--spaces H1:5,L2:4), found {len(found)}")
    result = []
    for path, text in zip(functions, found, strict=True):
        match = _SPACE.fullmatch(text)
        if match is None or int(match[2]) > _HIGHEST:
            expected = f"{', '.join(SPACES)}, a colon and an order up to {_HIGHEST}"
            raise ElvisError(f"expected a space among {expected}, found {text!r}")
        result.append((path, (match[1], int(match[2]))))
    return result


def _function(ngsolve: Any, mesh: Any, path: Path, kind: str, order: int) -> Any:
    """The grid function of a file; FormatError where it has another number of values than the space."""
    space = getattr(ngsolve, kind)(mesh, order=order)
    if path.stat().st_size != 8 * space.ndof:
        expected = f"{space.ndof} numbers of {kind} of order {order}"
        raise FormatError(f"expected {expected}, found {path.stat().st_size / 8:g}", file=path)
    function = ngsolve.GridFunction(space)
    function.Load(str(path))
    return function


def _name(mesh: Path, path: Path) -> str:
    """The name of a function's file without what it has in common with the mesh's, and without its ending."""
    return path.stem.removeprefix(mesh.name.removesuffix(".vol")).strip("._-") or path.stem


def _check(path: Path) -> None:
    """FormatError where the mesh is cut off, has elements on points that aren't there, or the library fails on it."""
    lines = path.read_text("ascii", "replace").splitlines()
    if "endmesh" not in (line.strip() for line in lines):
        raise FormatError("expected a whole mesh, found no endmesh", file=path)
    starts = {line.strip(): at for at, line in enumerate(lines) if line and line[0].isalpha()}
    count = _count(path, lines, starts, "points")
    for section, column in _ELEMENTS.items():
        if section in starts:
            at = starts[section] + 2
            _check_elements(path, section, lines[at : at + _count(path, lines, starts, section)], column, count)
    limit = _LIMIT + _PER_BYTE * path.stat().st_size
    done = subprocess.run([sys.executable, "-c", _TRIAL, str(path), str(limit)], capture_output=True, check=False)
    if done.returncode:
        raise FormatError("expected a mesh that NGSolve reads, found one on which it fails", file=path)


def _count(path: Path, lines: Sequence[str], starts: dict[str, int], section: str) -> int:
    """How many lines a section has; FormatError where it has fewer than it says."""
    at = starts.get(section, len(lines))
    text = lines[at + 1].strip() if at + 1 < len(lines) else ""
    if not text.isdigit() or at + 1 + int(text) >= len(lines):
        raise FormatError(f"expected a number of {section} and as many lines, found {text!r}", file=path, place=section)
    return int(text)


def _check_elements(path: Path, section: str, lines: Sequence[str], column: int, count: int) -> None:
    """FormatError unless elements name points from 1 to ``count``; ``column`` tells how many points each has."""
    named: list[Ints] = []
    for number, line in enumerate(lines):
        words = line.split()
        corners = int(words[column]) if len(words) > column and words[column].isdigit() else 0
        own = words[column + 1 : column + 1 + corners]
        if not corners or len(own) < corners or not all(word.isdigit() for word in own):
            raise FormatError(
                "expected an element and its points, found others", file=path, place=f"{section} {number}"
            )
        named.append(np.array(own, np.int64))
    used = np.concatenate([np.ones(1, np.int64), *named])
    if not 1 <= used.min() <= used.max() <= count:
        found = int(used.max() if used.max() > count else used.min())
        raise FormatError(f"expected points 1 to {count}, found {found}", file=path, place=section)
