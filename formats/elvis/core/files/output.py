"""Outputs of one run as a unit: written next to their places, synced, then renamed together or not at all.

    with Outputs() as outputs:
        with outputs.file("wing.png") as temporary:
            picture.save(temporary)
        with outputs.file("wing.npz") as temporary:
            np.savez(temporary, ...)

Nothing under the final names changes before the outer block ends well.
"""

from __future__ import annotations

import os
import re
import shutil
import stat
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType

from elvis.core.base.errors import ElvisError
from elvis.core.files.replacement import Replacement
from elvis.core.files.scratch import scratch

_STREAMS = ("stdin", "stdout", "stderr")
_OPEN = re.compile(r"/dev/(stdin|stdout|stderr)|(?:/dev|/proc/self)/fd/([0-9]+)")


class Outputs:
    """Files and folders that take their places if the block succeeds; otherwise nothing changes.

    A link keeps its target, and a new file inherits the mode of the file it replaces.  Pipes and devices are written
    directly, since they cannot be renamed; output is appended to files that are already open, such as ``/dev/stdout``.
    """

    def __init__(self) -> None:
        self._closing = ExitStack()
        self._scratches: dict[Path, Path] = {}
        self._replacements: dict[Path, Replacement] = {}

    def __enter__(self) -> Outputs:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        with self._closing:
            if kind is None:
                self._take_places()

    @contextmanager
    def file(self, path: str | Path) -> Iterator[Path]:
        """A new file that replaces ``path``, with the same name in another folder.

        Raises ElvisError, which names ``path``, if it can't be written completely.
        """
        if _is_special(Path(path)):
            with _naming(path, Path(path)), _pour(path) as temporary:
                yield temporary
            return
        check_place(path)
        item = self._replacement(path, Path(os.path.realpath(path)))
        with _naming(path, item.new):
            os.close(os.open(item.new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
            yield item.new
            _sync(item.new)
            _hand_on_mode(item)

    @contextmanager
    def folder(self, path: str | Path) -> Iterator[Path]:
        """A new empty folder that replaces ``path``, which may be a folder."""
        check_folder_place(path)
        item = self._replacement(path, Path(os.path.realpath(path)))
        with _naming(path, item.new):
            item.new.mkdir()
            yield item.new
            for place, _, names in os.walk(item.new):
                for name in names:
                    _sync(Path(place, name))
                _sync_folder(Path(place))
            _hand_on_mode(item)

    def remove(self, path: str | Path) -> None:
        """Let the file of that name go when the others take their places; for a link, remove the link."""
        folder, name = os.path.split(path)
        self._replacement(path, Path(os.path.realpath(folder), name))

    def _replacement(self, path: str | Path, target: Path) -> Replacement:
        """The replacement of ``path``, which is at ``target``."""
        if target in self._replacements:
            raise _twice(path, self._replacements[target].named)
        try:
            own = self._scratch(target.parent)
        except OSError as error:
            raise ElvisError(f"{path}: cannot be written: {error.strerror}") from error
        found = Replacement(path, target, own / "new" / target.name, own / "old" / target.name)
        if os.path.lexists(found.new):  # names that differ, on a file system that treats them as equal
            raise _twice(path, found.named)
        self._replacements[target] = found
        return found

    def _scratch(self, folder: Path) -> Path:
        if folder not in self._scratches:
            self._scratches[folder] = self._closing.enter_context(scratch(folder))
        return self._scratches[folder]

    def _take_places(self) -> None:
        """Rename all; if one fails, the previous ones are undone."""
        items = list(self._replacements.values())
        at = ""
        try:
            for item in items:
                at = str(item.named)
                item.place()
        except BaseException as error:
            # an interrupt after the last one comes too late: all is in place
            if items and not items[-1].is_placed:
                for item in reversed(items):
                    item.restore()
            if isinstance(error, OSError):
                raise ElvisError(f"{at}: cannot be written: {error.strerror}") from error
            raise
        for folder in self._scratches:
            _sync_folder(folder)


@contextmanager
def replacing(path: str | Path, outputs: Outputs | None = None) -> Iterator[Path]:
    """A file that replaces ``path``, together with the files of ``outputs`` if given."""
    if outputs is not None:
        with outputs.file(path) as temporary:
            yield temporary
        return
    with Outputs() as own, own.file(path) as temporary:
        yield temporary


def write_bytes(path: str | Path, content: bytes) -> None:
    """Write a whole file of bytes, or none of it."""
    with replacing(path) as file:
        file.write_bytes(content)


def write_text(path: str | Path, content: str, outputs: Outputs | None = None) -> None:
    """Write a whole UTF-8 file with plain line ends, as `write_bytes` does."""
    with replacing(path, outputs) as file:
        file.write_bytes(content.encode())


def check_place(path: str | Path) -> None:
    """Raise ElvisError if no file ``path`` can be written; call this before long work."""
    if Path(path).is_dir():
        raise ElvisError(f"{path}: cannot be written: it is a folder")
    _check_writable(path)


def check_folder_place(path: str | Path) -> None:
    """Raise ElvisError if no folder ``path`` can be written; call this before long work."""
    if Path(path).exists() and not Path(path).is_dir():
        raise ElvisError(f"{path}: cannot be written: it is a file, and a folder is to be written")
    _check_writable(path)


def check_places(paths: Sequence[str | Path], inputs: Iterable[str | Path] = (), overwrite: bool = False) -> None:
    """Raise ElvisError if these files can't all be written, or one of them is an input; call this before long work.

    overwrite  whether inputs may be written over
    """
    taken: dict[str, str | Path] = {}
    for path in paths:
        check_place(path)
        target = os.path.realpath(path)
        if target in taken:
            raise _twice(path, taken[target])
        taken[target] = path
    if not overwrite:
        check_inputs(paths, inputs)


def check_inputs(
    paths: Iterable[str | Path],
    inputs: Iterable[str | Path],
    advice: str = "name another output, or pass --overwrite",
) -> None:
    """Raise ElvisError if a file to be written is an input or a link to one, or lies in an input folder.

    advice  the remedy for the message
    """
    given = [Path(each) for each in inputs]
    for path in filter(os.path.isfile, paths):
        for other in filter(Path.exists, given):
            inside = other.is_dir() and Path(os.path.realpath(other)) in Path(os.path.realpath(path)).parents
            if inside or os.path.samefile(path, other):
                what = "it is an input" if str(path) == str(other) else f"it is the input {other}"
                what = f"it lies in the input {other}" if inside else what
                raise ElvisError(f"{path}: not written: {what}; {advice}")


def _check_writable(path: str | Path) -> None:
    """Raise ElvisError if the folder of ``path`` is missing, or may not be written to, or what stands there may not."""
    if _descriptor(path) is not None:
        return
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise ElvisError(f"{path}: cannot be written: there is no folder {target.parent}")
    if not target.name:
        raise ElvisError(f"{path}: cannot be written: expected a name in a folder")
    if Path(path).exists() and not os.access(path, os.W_OK):
        raise ElvisError(f"{path}: cannot be written: it is write-protected")
    if not _is_special(Path(path)) and not os.access(target.parent, os.W_OK | os.X_OK):
        raise ElvisError(f"{path}: cannot be written: the folder {target.parent} is write-protected")


def _twice(path: str | Path, other: str | Path) -> ElvisError:
    shown = "" if str(path) == str(other) else f" is the same file as {other}, which"
    return ElvisError(f"{path}:{shown} is to be written twice: name two files")


def _is_special(path: Path) -> bool:
    return _descriptor(path) is not None or (path.exists() and not path.is_file() and not path.is_dir())


def _descriptor(path: str | Path) -> int | None:
    """The number of the open file with this name, None for other names."""
    found = _OPEN.fullmatch(str(path))
    if found is None:
        return None
    return int(found[2]) if found[2] else _STREAMS.index(found[1])


@contextmanager
def _pour(path: str | Path) -> Iterator[Path]:
    """The special file itself, or a temporary one whose content is appended to the open one at ``path``.

    Opening that file by its name would truncate the output of others.
    """
    number = _descriptor(path)
    if number is None:
        yield Path(path)
        return
    with TemporaryDirectory() as folder:
        temporary = Path(folder, "content")
        yield temporary
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        with temporary.open("rb") as source, os.fdopen(os.dup(number), "wb") as target:
            shutil.copyfileobj(source, target)


@contextmanager
def _naming(path: str | Path, written: Path) -> Iterator[None]:
    """Turn errors of the system or a library about a failed write into ElvisError with the name that the user gave.

    written  the file actually written, whose name would not help the user
    """
    try:
        yield
    except OSError as error:
        if error.filename is not None and not str(error.filename).startswith(str(written)):
            raise
        reason = error.strerror or str(error).replace(str(written), written.name)
        raise ElvisError(f"{path}: cannot be written: {' '.join(reason.split())}") from error
    except UnicodeEncodeError as error:
        found = error.object[max(0, error.start - 20) : error.end]
        raise ElvisError(f"{path}: cannot be written: expected names and text in UTF-8, found {found!r}") from error


def _hand_on_mode(item: Replacement) -> None:
    """Give a new file the mode of the file it replaces."""
    if item.target.exists():
        item.new.chmod(stat.S_IMODE(item.target.stat().st_mode))


def _sync(path: Path) -> None:
    """Let the content of a file reach the disk; a disk that is full may say so only here."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _sync_folder(folder: Path) -> None:
    """Let names reach the disk, where the file system does such a thing."""
    try:
        _sync(folder)
    except OSError:
        return
