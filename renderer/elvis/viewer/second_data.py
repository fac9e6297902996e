"""A second dataset that a page sends to compare: its files, and the source that reads them next to the first."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from elvis.core.base.errors import ElvisError

if TYPE_CHECKING:
    from elvis.viewer.drawing_process import Source

#: name of the second dataset in expressions, as in ``other:p``
NAME = "other"
#: bytes of all files of a second dataset, at most
MAX_BYTES = 4 << 30
MAX_FILES = 100
#: bytes read at once
_CHUNK = 1 << 20


class SentFiles:
    """Files of a second dataset in a private folder, which lasts until it is removed; ElvisError without room.

    As a context it removes them if the block fails.
    """

    def __init__(self) -> None:
        with _storing():
            self._folder = tempfile.TemporaryDirectory(prefix="elvis-compare-")
        self._files: list[Path] = []
        self._left = MAX_BYTES

    def open(self, name: str | None) -> None:
        """Make an empty file; ElvisError if there are too many."""
        if name is None or len(self._files) == MAX_FILES:
            raise ElvisError(f"expected at most {MAX_FILES} files")
        path = Path(self._folder.name, plain_name(name))
        with _storing():
            path.touch(exist_ok=False)
        self._files.append(path)

    def append(self, content: bytes) -> None:
        """Append to the last file; ElvisError if all files together are too large."""
        self._left -= len(content)
        if self._left < 0:
            raise ElvisError(f"the files are larger than {MAX_BYTES >> 30} GiB; use --other {NAME}=FILE,…")
        with _storing(), self.files[-1].open("ab") as file:
            file.write(content)

    @property
    def files(self) -> list[Path]:
        """The files so far; ElvisError if there are none."""
        if not self._files:
            raise ElvisError("expected the files of a dataset, found none")
        return self._files

    def remove(self) -> None:
        """Remove the files."""
        self._folder.cleanup()

    def __enter__(self) -> SentFiles:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None:
            self.remove()


@contextmanager
def _storing() -> Iterator[None]:
    """Converts errors of the disk into an ElvisError."""
    try:
        yield
    except OSError as error:
        raise ElvisError(f"the files can't be stored: {error.strerror or error}") from error


async def received(parts: Any) -> SentFiles:
    """The files of a multipart request; ElvisError if they are too many or too large, and none remain."""
    with SentFiles() as sent:
        async for part in parts:
            sent.open(part.filename)
            while content := await part.read_chunk(_CHUNK):
                sent.append(content)
    return sent


def plain_name(name: str) -> str:
    """A name of a file without folders, and without characters that separate names in ``--other``."""
    plain = re.sub(r"[^\w.+-]", "_", re.split(r"[/\\]", name)[-1])[-100:].lstrip(".")
    if not plain:
        raise ElvisError(f"expected a name of a file, found {name!r:.80}")
    return plain


def sources_with(source: Source, files: Sequence[Path]) -> list[Source]:
    """Sources with a second dataset, to be tried in turn: of these files alone, then with the first dataset's mesh.

    Data in memory get a second dataset in memory.
    """
    from elvis.core.data.dataset import Dataset
    from elvis.plugins.data.data import Reading, dataset_of

    if isinstance(source.data, Dataset):
        return [replace(source, data=source.data.with_others(**{NAME: dataset_of(files, Reading())}))]
    if source.data is not None or source.is_live:
        raise ElvisError("a second dataset needs data in files; start elvis view with them")
    suffixes = {path.suffix for path in files}
    own = [Path(name) for name in source.files if Path(name).suffix not in suffixes]
    reading = source.reading or Reading()
    kept = tuple(text for text in reading.others if not text.startswith(f"{NAME}="))
    found = []
    for chosen in (files, [*own, *files]) if own else (files,):
        text = f"{NAME}={','.join(map(str, chosen))}"
        found.append(replace(source, reading=replace(reading, others=(*kept, text))))
    return found
