"""NGSolve's own files: Netgen meshes (.vol) and the numbers of grid functions (.gfu), read by the library.

A .gfu file holds only numbers; the user specifies their space.  Defects of a mesh that would crash the library are
checked before it reads the file.
"""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from elvis.converters.shared.apart import Apart, LibraryError
from elvis.converters.shared.inputs import is_count
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.files.plain import content, leading, unpacked_limit
from elvis.plugins.conversion.discovery import installing

#: spaces that can be named
SPACES = ("H1", "L2", "VectorH1", "VectorL2", "HDiv", "HCurl", "IntegrationRuleSpace")

_BEGIN = re.compile(rb"(?m)^mesh[123]d\s*$")
#: a space: its kind and order, whether it is complex, the part of the mesh that it is defined on
_SPACE = re.compile(rf"({'|'.join(SPACES)}):(\d{{1,2}})(:complex)?(?:@([\w.|-]{{1,200}}))?")
_HIGHEST, _HEAD = 20, 400

#: kind and order of a space, whether it is complex, and the names of the parts of the mesh that it is defined on
Space = tuple[str, int, bool, str]

#: sections of elements, with the columns of the number of vertices
_ELEMENTS = {
    "surfaceelements": 4,
    "surfaceelementsgi": 4,
    "surfaceelementsuv": 4,
    "surfaceelementsgi3": 4,
    "volumeelements": 1,
}

#: words for each point of the elements of a section, where nothing else follows
_WORDS = {"surfaceelements": 1, "surfaceelementsgi": 2, "volumeelements": 1}

#: sections that may come last in a mesh without an end mark, with one line per entry
_LISTS = {*_ELEMENTS, "points", "edgesegments", "edgesegmentsgi", "edgesegmentsgi2", "edgesegmentsgi3", "pointelements",
          "materials", "bcnames", "cd2names", "cd3names", "face_colours", "face_transparencies"}  # fmt: skip

#: beginning of compressed files
_GZIP = b"\x1f\x8b"

#: reads and samples in another process, where the library may crash
_WORKER = "elvis.converters.ngsolve.export:Library"


def is_mesh(path: Path) -> bool:
    """Whether a file begins as Netgen's meshes do, compressed or not."""
    start = leading(path, _HEAD)
    try:
        if start.startswith(_GZIP):
            start = zlib.decompressobj(wbits=31).decompress(start, _HEAD)
    except zlib.error:
        return False
    return _BEGIN.search(start) is not None


def _is_compressed(path: Path) -> bool:
    return leading(path, len(_GZIP)) == _GZIP


class Reader:
    """A mesh and its functions in the library's process; ``path`` is the mesh.

    Raises FormatError if the library fails.
    """

    def __init__(self, path: Path, fields: Mapping[str, tuple[str, Sequence[Space]]], size: int) -> None:
        self._path, self._library = path, Apart(_WORKER, size)
        with _link(path) as link:
            self.data: dict[str, Any] = self._ask("read", str(link), str(path), dict(fields), size=size)
        self._counts = {key[6:]: int(array) for key, array in self.data.items() if key.startswith("count_")}

    def positions(self, elements: Ints, points: Floats) -> Floats:
        """See `elvis.converters.ngsolve.export.Session`."""
        return np.asarray(self._ask("positions", elements, points, size=24 * len(elements) * len(points)))

    def values(self, name: str, elements: Ints, points: Floats) -> Floats:
        """See `elvis.converters.ngsolve.export.Session`."""
        size = 8 * self._counts[name] * len(elements) * len(points)
        return np.asarray(self._ask("values", name, elements, points, size=size))

    def _ask(self, method: str, *given: Any, size: int) -> Any:
        try:
            return self._library.ask(method, *given, size=size)
        except LibraryError as failure:
            message = f"expected a mesh that NGSolve reads, found {failure.reason}"
            raise FormatError(message, file=self._path) from failure


def opened(paths: Sequence[Path], spaces: str | None) -> tuple[dict[str, Any], Path, Reader]:
    """Description of a mesh and its functions (`export.Session`), the mesh, and a reader with the library.

    spaces  of the functions, as ``H1:5,L2:4``, in the order of their files
    Raises FormatError for damaged files; raises ElvisError if spaces are missing or don't fit.
    """
    meshes, functions = [p for p in paths if is_mesh(p)], [p for p in paths if not is_mesh(p)]
    if len(meshes) != 1:
        raise FormatError(f"expected one mesh (.vol), found {len(meshes)}", file=paths[0])
    named = _spaces(spaces, functions)
    if find_spec("ngsolve") is None:
        raise ElvisError(
            f"the converter ngsolve needs ngsolve for {meshes[0].name}, which is not installed; "
            f"{installing('ngsolve')} installs it"
        )
    text = _text(meshes[0])
    notes = _check(meshes[0], text)
    fields = {_name(meshes[0], path): (str(path), own) for path, own in named}
    size = len(text) + sum(path.stat().st_size for path in functions)
    reader = Reader(meshes[0], fields, size)
    declared = np.array(_declared(meshes[0], text))
    return {**reader.data, "notes": np.array(notes, dtype="U"), "declared": declared}, meshes[0], reader


@contextmanager
def _link(path: Path) -> Iterator[Path]:
    """A link to a mesh by a name from which the library recognises the format; it reads no others."""
    with TemporaryDirectory() as folder:
        link = Path(folder) / ("mesh.vol.gz" if _is_compressed(path) else "mesh.vol")
        link.symlink_to(path.resolve())
        yield link


def _spaces(spaces: str | None, functions: Sequence[Path]) -> list[tuple[Path, list[Space]]]:
    """The spaces of each function's file: one, or the factors of a product."""
    found = [part.strip() for part in (spaces or "").split(",") if part.strip()]
    if len(found) != len(functions):
        expected = f"a space for each of {len(functions)} .gfu files, which do not state it"
        raise ElvisError(
            f"expected {expected} (--reader spaces=H1:5,L2:4; of elvis convert --spaces), found {len(found)}"
        )
    return [(path, [_space(part) for part in text.split("*")]) for path, text in zip(functions, found, strict=True)]


def _space(text: str) -> Space:
    """A space by its text; raises ElvisError for others."""
    match = _SPACE.fullmatch(text.strip())
    if match is None or int(match[2]) > _HIGHEST:
        expected = f"{', '.join(SPACES)}, a colon and an order up to {_HIGHEST}"
        raise ElvisError(
            f"expected a space among {expected}, perhaps with :complex or @PART behind it, found {text.strip()!r}"
        )
    return match[1], int(match[2]), match[3] is not None, match[4] or ""


def _name(mesh: Path, path: Path) -> str:
    """The name of a function's file without the part shared with the mesh's, and without its ending."""
    rest = path.stem.removeprefix(mesh.name.removesuffix(".gz").removesuffix(".vol"))
    return rest.strip("._-") or path.stem if rest[:1] in ("", *"._-") else path.stem


def _check(path: Path, text: str) -> list[str]:
    """Sentences for the report.

    Raises FormatError if the mesh is cut off, or has elements on points that aren't there.
    """
    lines = [line for line in text.splitlines() if line.strip()]
    starts = {line.strip(): at for at, line in enumerate(lines) if line and line[0].isalpha()}
    count = _count(path, lines, starts, "points")
    for section, column in _ELEMENTS.items():
        if section in starts:
            at = starts[section] + 2
            number = _count(path, lines, starts, section)
            _check_elements(path, section, _rows(section, lines[at:], number, column), column, count)
    has_end = any(line.strip() == "endmesh" for line in lines)
    return [] if has_end else [_unended(path, text, starts)]


def _declared(path: Path, text: str) -> int:
    """The number of elements of the mesh's dimension that a file declares; -1 for meshes of lines."""
    lines = [line for line in text.splitlines() if line.strip()]
    starts = {line.strip(): at for at, line in enumerate(lines) if line[0].isalpha()}
    if "volumeelements" in starts and _count(path, lines, starts, "volumeelements"):
        return _count(path, lines, starts, "volumeelements")
    found = [_count(path, lines, starts, name) for name in _ELEMENTS if name in starts and name != "volumeelements"]
    return sum(found) or -1


def _text(path: Path) -> str:
    """All of a file; raises FormatError if it is compressed and damaged, or holds far more than its size suggests."""
    if not _is_compressed(path):
        return content(path).decode("ascii", "replace")
    limit = unpacked_limit(path.stat().st_size)
    try:
        with gzip.open(path) as file:
            raw = file.read(limit + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise FormatError(f"expected a complete compressed file, found: {error}", file=path) from None
    if len(raw) > limit:
        raise FormatError(f"expected at most {limit} bytes in the compressed file, found more", file=path)
    return raw.decode("ascii", "replace")


def _unended(path: Path, text: str, starts: dict[str, int]) -> str:
    """A note on a mesh without an end whose sections are all there.

    Raises FormatError if the last one may be cut off.
    """
    lines = [line for line in text.splitlines() if line.strip()]
    while lines[-1].startswith("#"):
        lines.pop()
    last = max(starts, key=lambda section: starts[section])
    if last not in _LISTS or not text.endswith("\n"):
        raise FormatError("expected a complete mesh, found no endmesh", file=path)
    if starts[last] + 2 + _count(path, lines, starts, last) != len(lines):
        raise FormatError("expected a complete mesh, found no endmesh", file=path)
    return f"the mesh has no endmesh: whatever followed its section {last}, such as curved elements, is missing"


def _count(path: Path, lines: Sequence[str], starts: dict[str, int], section: str) -> int:
    """Number of lines of a section; raises FormatError if it has fewer than declared."""
    at = starts.get(section, len(lines))
    text = lines[at + 1].strip() if at + 1 < len(lines) else ""
    if not is_count(text) or at + 1 + int(text) >= len(lines):
        raise FormatError(f"expected a number of {section} and as many lines, found {text!r}", file=path, place=section)
    return int(text)


def _rows(section: str, lines: Sequence[str], count: int, column: int) -> list[str]:
    """The first rows of a section: lines, or if their words run on over lines, as many words as each row must have."""
    rows = list(lines[:count])
    per_point = _WORDS.get(section)
    if per_point is None or all(_width(row.split(), column, per_point) == len(row.split()) for row in rows):
        return rows
    words = iter(" ".join(lines).split())
    found = []
    for _ in range(count):
        head = list(islice(words, column + 1))
        own = int(head[-1]) if head and is_count(head[-1]) else 0
        found.append(" ".join([*head, *islice(words, own * per_point)]))
    return found


def _width(words: Sequence[str], column: int, per_point: int) -> int:
    """The number of words that a row must have; 0 if unknown."""
    own = words[column] if len(words) > column else ""
    return column + 1 + per_point * int(own) if is_count(own) else 0


def _check_elements(path: Path, section: str, lines: Sequence[str], column: int, count: int) -> None:
    """Raise FormatError unless elements name points from 1 to ``count``.

    ``column`` holds the number of points of each.
    """
    named: list[Ints] = []
    for number, line in enumerate(lines):
        words = line.split()
        corners = int(words[column]) if len(words) > column and is_count(words[column]) else 0
        own = words[column + 1 : column + 1 + corners]
        if not corners or len(own) < corners or not all(is_count(word) for word in own):
            raise FormatError(
                "expected an element and its points, found others", file=path, place=f"{section} {number}"
            )
        named.append(np.array(own, np.int64))
    used = np.concatenate([np.ones(1, np.int64), *named])
    if not 1 <= used.min() <= used.max() <= count:
        found = int(used.max() if used.max() > count else used.min())
        raise FormatError(f"expected points 1 to {count}, found {found}", file=path, place=section)
