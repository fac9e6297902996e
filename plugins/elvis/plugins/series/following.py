"""A run that is followed: its newest step, once that is complete.

A solver may write in place, and slowly: so a file counts only if its size and time of change are the same as at the
previous check, and its contents only if they are still the same after reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.formats.field_heads import field_head
from elvis.formats.reading import is_native
from elvis.plugins.data.data import Reading, state_with_others
from elvis.plugins.series.series import Series, series_in
from elvis.plugins.series.step_names import expanded, groups

#: how files that list steps end
_INDICES = (".pvd", ".series", ".nek5000")
#: seconds between the first two checks, so that steps that are already complete appear soon
SOON = 0.3
#: bytes, and when a file was changed
Stamp = tuple[int, int]


class Following:
    """Files of a run, checked repeatedly.

    paths    names of files, with * in them or not, and folders in which a solver writes
    waiting  message on the missing data; empty if the newest step is available
    number   of the newest step among the run's steps so far, from 0
    """

    def __init__(self, paths: Sequence[Path], reading: Reading) -> None:
        self._paths, self._reading = tuple(paths), reading
        self._before: dict[Path, Stamp] = {}
        self._taken: dict[Path, Stamp] = {}
        self._series: Series | None = None
        self._shown: tuple[object, ...] = ()
        self._shown_files: tuple[Path, ...] = ()
        self.waiting, self.number = "", 0

    @property
    def series(self) -> Series | None:
        """The series that the run is so far; None where it has one state."""
        return self._series

    def look(self) -> Dataset | None:
        """The newest whole step; None where that is known already, or there is none yet (see `waiting`)."""
        now = {path: own for path in self._files() if (own := _stamp(path)) is not None}
        stable = {path: own for path, own in now.items() if self._before.get(path) == own}
        self._before = now
        if not stable:
            self.waiting = f"waiting for files in {', '.join(map(str, self._paths))}" if not now else ""
            return None
        is_rewritten = any(path in now and path not in stable for path in self._shown_files)
        if stable == self._taken or is_rewritten:
            return None
        try:
            return self._newest(stable)
        except (ElvisError, OSError) as error:  # the solver's user may delete its files meanwhile
            self.waiting = f"waiting: {error}"
            return None

    def _newest(self, stable: dict[Path, Stamp]) -> Dataset | None:
        """The newest step of files that do not change; None where it is the one that was shown last."""
        series = series_in(list(stable), self._reading)
        if series is None:
            number, files = 0, tuple(stable)
            found = state_with_others(files, self._reading)
        else:
            if self._series is not None and self._is_old(series.common, stable):
                series.take_mesh_of(self._series)
            number = series.last_readable()
            found, files = series.at_moment(), (*series.common, *series.steps[number].files)
        if any(_stamp(path) != stable[path] for path in files):
            return None
        if not found.solution:
            self.waiting = "waiting for a step: found a mesh, but no field yet"
            return None
        shown = tuple((path, stable[path]) for path in files), found.time
        self._series, self._taken, self.waiting, self.number = series, stable, "", number
        if shown == self._shown:
            return None
        self._shown, self._shown_files = shown, files
        return found

    def _is_old(self, common: Sequence[Path], stable: dict[Path, Stamp]) -> bool:
        """Whether the files of the mesh are the previous series' files."""
        assert self._series is not None
        is_same = tuple(common) == self._series.common
        return is_same and all(self._taken.get(path) == stable[path] for path in common)

    def _files(self) -> list[Path]:
        """The current files."""
        found: list[Path] = []
        for path in self._paths:
            with suppress(ElvisError, OSError):  # none of such names yet, or no longer
                found += files_of_run(path) if path.is_dir() and not is_native(path) else expanded([path])
        return found


def files_of_run(folder: Path) -> list[Path]:
    """The data in a folder: native files, else an index of steps, else the most files whose names differ in a number.

    Other files may contain the mesh of numbered files: those with the same suffix up to its last letter are included
    (``case.pyfrm`` for ``case-1.pyfrs``).
    """
    paths = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    native = [path for path in paths if is_native(path) or field_head(path) is not None]
    if native:
        return native
    paths = [path for path in paths if path.is_file()]
    for suffix in _INDICES:
        if listed := [path for path in paths if path.suffix == suffix]:
            return listed[:1]
    most = max(groups(paths), key=len, default=[])
    kin = [path for path in paths if path not in most and path.suffix[:-1] == most[0].suffix[:-1]]
    return [*kin, *most]


def _stamp(path: Path) -> Stamp | None:
    """Stamp that detects changes of a file, or of a folder's files; None for a missing file."""
    try:
        members = [path, *path.iterdir()] if path.is_dir() else [path]
        found = [member.stat() for member in members]
    except OSError:
        return None
    return sum(own.st_size for own in found), max(own.st_mtime_ns for own in found)
