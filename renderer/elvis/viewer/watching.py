"""Detection of changes in the files that were read."""

from __future__ import annotations

import os
from collections.abc import Iterable

#: stamp of a file: time of the last change, size in bytes; None for a missing file
Stamp = tuple[int, int] | None


class WatchedFiles:
    """Files, and folders of files, that are compared with their state at the time of reading."""

    def __init__(self, names: Iterable[str]) -> None:
        self._names = tuple(names)
        self._known: dict[str, Stamp] = {}

    def note(self, stamps: dict[str, Stamp]) -> None:
        """They were read as they were with these stamps."""
        self._known = stamps

    def sentence(self) -> str:
        """A sentence on changes since reading; empty if there are none."""
        now = self.stamps()
        changed = [name for name, known in self._known.items() if now.get(name) != known]
        if not changed:
            return ""
        how = "was removed" if now.get(changed[0]) is None else "has changed on disk"
        return f"{changed[0]} {how}; the picture shows the previous contents"

    def stamps(self) -> dict[str, Stamp]:
        """Stamps of all files by path, at present."""
        found = {}
        for name in self._names:
            for path in (name, *_content(name)):
                found[path] = _stamp(path)
        return found


def _content(name: str) -> list[str]:
    """The paths of the contents of a folder; empty for anything else."""
    try:
        return sorted(os.path.join(name, each) for each in os.listdir(name))
    except OSError:
        return []


def _stamp(path: str) -> Stamp:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size
