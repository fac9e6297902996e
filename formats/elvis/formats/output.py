"""Output files: written beside their place and renamed, so that no half file ever stands under the final name."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from elvis.formats.errors import ElvisError


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A file to write in place of ``path``: it takes that name when the block ends well, and vanishes otherwise.

    The name given out has the suffix of ``path`` and lies in the same folder.  A link keeps pointing where it did, an
    existing file keeps its mode; pipes and devices such as ``/dev/stdout`` are written directly, for want of a rename.
    Raises ElvisError where ``path`` is a folder, or lies in none that exists.
    """
    if _is_special(Path(path)):
        yield Path(path)
        return

    target = Path(os.path.realpath(path))
    beside = _reserved_beside(target, Path(path))
    try:
        yield beside
        os.replace(beside, target)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def write_bytes(path: str | Path, content: bytes) -> None:
    """Write a whole file of bytes, or none of it."""
    with replacing(path) as file:
        file.write_bytes(content)


def write_text(path: str | Path, content: str) -> None:
    """Write a whole UTF-8 file with plain line ends, or none of it."""
    write_bytes(path, content.encode())


def check_place(path: str | Path) -> None:
    """ElvisError where ``path`` is a folder, or lies in none that exists; to be asked before long work."""
    if Path(path).is_dir():
        raise ElvisError(f"{path}: cannot be written: it is a folder")
    folder = Path(os.path.realpath(path)).parent
    if not folder.is_dir():
        raise ElvisError(f"{path}: cannot be written: there is no folder {folder}")


def _is_special(path: Path) -> bool:
    return path.exists() and not path.is_file() and not path.is_dir()


def _reserved_beside(target: Path, named: Path) -> Path:
    """A new empty file in the folder of ``target``, with the mode that the final file shall have."""
    check_place(named)
    beside = target.with_name(f".{target.stem}.{os.getpid()}.{os.urandom(3).hex()}{target.suffix}")
    try:
        os.close(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    except OSError as error:
        raise ElvisError(f"{named}: cannot be written: {error.strerror}") from error
    if target.exists():
        beside.chmod(stat.S_IMODE(target.stat().st_mode))
    return beside
