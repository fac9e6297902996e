"""Grouping of MFEM's texts: a mesh with its functions, pieces of parallel ones, streams that hold both.

GLVis saves and shows data as streams: a word, a mesh, a function.  Pieces are files whose names end in the number of a
process; a mesh among them may end in a list of entities shared with others, which is removed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from itertools import chain
from pathlib import Path

from elvis.converters.mfem.files import COMPLEX, SPACES, first_line, header_end, is_mesh, load
from elvis.core.base.errors import FormatError

#: first words of streams with functions and without; ``keys`` follow the numbers of some
_STREAM = re.compile(r"(?:parallel +(\d+) +(\d+)\s+)?(solution|quadrature|v?fem[23]d_gf_data(?:_keys)?|mesh)\s*")

_SHARED = re.compile(r"(?m)^(mfem_serial_mesh_end|communication_groups)\s*$")
_FUNCTION = re.compile(rf"(?m)^(?:(?:{'|'.join(COMPLEX)})\s+)?(?:{'|'.join(map(re.escape, SPACES))})\s*$")
_GROUP = re.compile(r"(?m)^\d+((?: \d+)+)\s*$")

#: names of pieces; last line of meshes of some versions
_NUMBERED, _END = re.compile(r"(.*)\.(\d{6})", re.DOTALL), "mfem_mesh_end"


@dataclass(frozen=True)
class Source:
    """A text of the library: ``named`` is the file that it came from, ``is_whole`` whether it is all of that."""

    named: Path
    text: str
    is_whole: bool

    def file(self, folder: Path) -> Path:
        """A file with only this text; created in ``folder`` if necessary."""
        if self.is_whole:
            return self.named
        path = folder / sha256(self.text.encode()).hexdigest()
        if not path.exists():
            path.write_text(self.text)
        return path


@dataclass(frozen=True)
class Piece:
    """A mesh, and functions on it by name."""

    mesh: Source
    functions: Mapping[str, Source]


def is_piece(path: Path) -> bool:
    """Whether a name ends in the number of a process."""
    return _NUMBERED.fullmatch(path.name) is not None


def is_stream(path: Path) -> bool:
    """Whether a file begins as streams do."""
    line = first_line(path)
    return re.fullmatch(r"parallel +\d+ +\d+", line) is not None or _STREAM.fullmatch(line) is not None


def pieces(paths: Sequence[Path]) -> list[Piece]:
    """The pieces in files; raises FormatError if they don't belong together, or can't be represented."""
    streams = [path for path in paths if is_stream(path)]
    if streams:
        return list(_read_streams(paths, streams))
    meshes, functions = [p for p in paths if is_mesh(p)], [p for p in paths if not is_mesh(p)]
    if not meshes:
        raise FormatError("expected also a mesh, found only grid functions: give the .mesh file", file=paths[0])
    if all(_NUMBERED.fullmatch(path.name) for path in meshes):
        return _parallel(meshes, functions)
    if len(meshes) > 1:
        raise FormatError(f"expected one mesh, found {len(meshes)}")
    return [_piece(meshes[0], functions)]


def _piece(mesh: Path, functions: Sequence[Path]) -> Piece:
    """A mesh and its functions, from files of their own."""
    text = load(mesh)
    shared = _SHARED.search(text)
    end = f"{_END}\n" if _END in text else ""
    source = Source(mesh, text[: shared.start()] + end if shared else text, shared is None)
    named: dict[str, Source] = {}
    for path in functions:
        named |= _functions(_name(mesh, path), Source(path, load(path), True))
    return Piece(source, named)


def _functions(name: str, source: Source) -> dict[str, Source]:
    """The function of a text by name; for a complex one, whose imaginary values follow the real ones, two functions."""
    path = source.named
    if not source.text.startswith(COMPLEX):
        return {name: source}
    text = source.text.partition("\n")[2].lstrip()
    end = header_end(path, text)
    words = text[end:].split()
    if len(words) % 2:
        raise FormatError(f"expected the same number of real and imaginary parts, found {len(words)}", file=path)
    parts = {"re": words[: len(words) // 2], "im": words[len(words) // 2 :]}
    head = text[:end]
    return {f"{name}_{part}": Source(path, f"{head}\n\n" + "\n".join(of) + "\n", False) for part, of in parts.items()}


def _name(mesh: Path, field: Path) -> str:
    """The name of a field's file without its ending, and without the mesh's name where another follows that."""
    numbered = _NUMBERED.fullmatch(field.name)
    if numbered and _NUMBERED.fullmatch(mesh.name):
        return numbered[1].removesuffix(".gf")
    name = field.name.removesuffix(".gf")
    rest = name.removeprefix(mesh.name.removesuffix(".mesh"))
    # pressure.gf on p.mesh keeps its full name: a separator must follow the mesh's name
    return rest.strip("._-") or name if rest[:1] in ("", *"._-") else name


def _numbered_files(folders: Iterable[Path]) -> dict[Path, dict[int, Path]]:
    """Files whose names end in the number of a process, by their paths without the number, and by the number."""
    found: dict[Path, dict[int, Path]] = {}
    for path in chain.from_iterable(folder.iterdir() for folder in folders):
        match = _NUMBERED.fullmatch(path.name)
        if match:
            found.setdefault(path.with_suffix(""), {})[int(match[2])] = path
    return found


def _processes(path: Path) -> int:
    """Number of pieces, from the groups of processes that share entities of a piece."""
    _, _, groups = load(path).partition("\nnumber_of_groups")
    own = groups.partition("\ntotal_shared")[0]
    return 1 + max((int(rank) for found in _GROUP.findall(own) for rank in found.split()), default=0)


def _parallel(meshes: Sequence[Path], functions: Sequence[Path]) -> list[Piece]:
    """One piece per process: the named files, and all next to them."""
    for path in (*meshes, *functions):
        if not _NUMBERED.fullmatch(path.name):
            raise FormatError("expected a name that ends in the number of a process, found another", file=path)
    pieces_of = _numbered_files({path.parent for path in (meshes[0], *functions)})
    whole = pieces_of[meshes[0].with_suffix("")]
    fields = {_name(meshes[0], path): pieces_of[path.with_suffix("")] for path in functions}
    numbers = sorted(whole)
    last = max(numbers[-1], *(_processes(path) - 1 for path in whole.values()))
    if numbers != list(range(last + 1)):
        found = ", ".join(map(str, numbers))
        raise FormatError(f"expected the pieces of processes 0 to {last}, found {found}", file=meshes[0])
    for name, own in fields.items():
        if sorted(own) != numbers:
            found = f"{len(own)} of the {len(numbers)} pieces"
            raise FormatError(f"expected a piece of {name} for every piece of the mesh, found {found}", file=meshes[0])
    return [_piece(whole[n], [own[n] for own in fields.values()]) for n in numbers]


def _read_streams(paths: Sequence[Path], streams: Sequence[Path]) -> Iterator[Piece]:
    """The content of streams: one mesh, or the pieces of one; for several meshes in a row, the last."""
    if len(streams) != len(paths):
        other = next(path for path in paths if not is_stream(path))
        raise FormatError("expected only streams, found another file next to them", file=other)
    last: dict[int, tuple[Path, str, bool]] = {}
    total = 1
    for path in streams:
        text, word = load(path), re.compile(rf"(?m)^{_STREAM.pattern}(?=MFEM )")
        found = list(word.finditer(text))
        if not found:
            raise FormatError(f"expected a mesh and a function, found {first_line(path)!r}", file=path)
        for one, following in zip(found, [*(each.start() for each in found[1:]), len(text)], strict=True):
            last[int(one[2] or 0)] = (path, text[one.end() : following], one[3] != "mesh")
            total = int(one[1] or 1)
    if sorted(last) != list(range(total)):
        raise FormatError(f"expected the pieces of {total} processes, found those of {len(last)}", file=streams[0])
    return (_of_stream(*last[number]) for number in range(total))


def _of_stream(path: Path, text: str, has_function: bool) -> Piece:
    """A mesh and the function that follows, whose space is the last; then may come commands, which begin with words."""
    spaces = list(_FUNCTION.finditer(text)) if has_function else []
    if not spaces:
        return Piece(Source(path, text, False), {})
    start = spaces[-1].start()
    function = text[start:]
    command = re.compile(r"(?m)^(?!nan|inf)[a-zA-Z]").search(function, header_end(path, function))
    own = Source(path, function[: command.start() if command else None], False)
    return Piece(Source(path, text[:start], False), _functions("solution", own))
