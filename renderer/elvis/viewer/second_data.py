"""A second dataset that a page sends to compare: its files, and the source that reads them next to the first."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from elvis.core.errors import ElvisError

if TYPE_CHECKING:
    from elvis.viewer.drawing_process import Source

#: name of the second dataset in expressions, as in ``other:p``
NAME = "other"
#: bytes of all files of a second dataset, at most
MAX_BYTES = 4 << 30
MAX_FILES = 100
#: bytes read at once
_CHUNK = 1 << 20


class SecondData:
    """Files of a second dataset in private folders, which last until others are accepted or the session ends."""

    def __init__(self) -> None:
        self._folders: list[tempfile.TemporaryDirectory[str]] = []
        self._files: list[Path] = []
        self._left = MAX_BYTES

    async def receive(self, parts: Any) -> list[Path]:
        """The files of a multipart request, next to those before; ElvisError if they are too many or too large."""
        self.begin()
        async for part in parts:
            self.open(part.filename)
            while content := await part.read_chunk(_CHUNK):
                self.append(content)
        return self.files

    def begin(self) -> None:
        """Make a folder for files, next to those before."""
        self._folders.append(tempfile.TemporaryDirectory(prefix="elvis-compare-"))
        self._files, self._left = [], MAX_BYTES

    def open(self, name: str | None) -> None:
        """Make an empty file; ElvisError if there are too many."""
        if name is None or len(self._files) == MAX_FILES:
            raise ElvisError(f"expected at most {MAX_FILES} files")
        if not self._folders:
            self.begin()
        path = Path(self._folders[-1].name, plain_name(name))
        path.touch(exist_ok=False)
        self._files.append(path)

    def append(self, content: bytes) -> None:
        """Append to the last file; ElvisError if all files together are too large."""
        self._left -= len(content)
        if self._left < 0:
            raise ElvisError(f"the files are larger than {MAX_BYTES >> 30} GiB; use --other {NAME}=FILE,…")
        with self.files[-1].open("ab") as file:
            file.write(content)

    @property
    def files(self) -> list[Path]:
        """The last files; ElvisError if there are none."""
        if not self._files:
            raise ElvisError("expected the files of a dataset, found none")
        return self._files

    def accept(self) -> None:
        """Remove the files before the last ones."""
        while len(self._folders) > 1:
            self._folders.pop(0).cleanup()

    def reject(self) -> None:
        """Remove the last files."""
        self._folders.pop().cleanup()

    def close(self) -> None:
        """Remove all files."""
        while self._folders:
            self.reject()


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
    from elvis.core.dataset import Dataset
    from elvis.plugins.data import Reading, dataset_of

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
