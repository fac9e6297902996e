"""Whether the processes of one run see the same files: a name may stand for other data on another machine."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from hashlib import sha256
from pathlib import Path

from elvis.core.base.errors import FormatError
from elvis.core.base.ranks import Ranks

#: blocks of a file that are compared, spread from its beginning to its end, and bytes of each
_BLOCKS, _BLOCK_BYTES = 32, 1 << 14
#: files of a folder that are compared
_MAX_FILES = 10_000


def check_same_files(paths: Sequence[Path], ranks: Ranks) -> None:
    """Raise FormatError on every rank if a file differs in size or content on one of them; times may differ.

    For long files blocks are compared, which cover the whole header and samples of the rest.
    """
    if ranks.size == 1:
        return
    own = [(path.name, _fingerprint(path)) for path in paths]
    first, *others = ranks.exchange(own, "the files of one state")
    for number, found in enumerate(others, 2):
        if len(found) != len(first):
            raise FormatError(f"part {number} of {ranks.size}: expected {len(first)} files, found {len(found)}")
        for expected, (name, other) in zip(first, found, strict=True):
            if (name, other) != expected:
                raise FormatError(
                    f"part {number} of {ranks.size}: {name} is another file there than at part 1; "
                    "all parts must see the same data"
                )


def _fingerprint(path: Path) -> list[tuple[str, int, bytes]]:
    """Name, size and checksum of a file, or of all files in a folder."""
    names = sorted(_files_in(path)) if path.is_dir() else [path]
    return [(str(own.relative_to(path)), own.stat().st_size, _checksum(own)) for own in names[:_MAX_FILES]]


def _files_in(folder: Path) -> Iterator[Path]:
    """All files in a folder and those below it."""
    for parent, _, names in os.walk(folder):
        yield from (Path(parent, name) for name in names)


def _checksum(path: Path) -> bytes:
    """Checksum of the blocks of a file."""
    size = path.stat().st_size
    total = sha256()
    with path.open("rb") as file:
        for number in range(_BLOCKS):
            file.seek(max(size - _BLOCK_BYTES, 0) * number // (_BLOCKS - 1))
            total.update(file.read(_BLOCK_BYTES))
    return total.digest()
