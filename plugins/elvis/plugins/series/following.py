"""A run that is followed: its newest step, once that is whole.

A solver may write in place, and take long over it: so a file counts once its size and time of change are what they were
at the look before, and what was read counts where they still are after that.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from elvis.core.dataset import Dataset
from elvis.core.errors import ElvisError
from elvis.formats.field_heads import field_head
from elvis.formats.reading import is_native
from elvis.plugins.data import Reading, state_with_others
from elvis.plugins.series.series import Series, series_in
from elvis.plugins.series.step_names import expanded, groups

#: how files that list steps end
_INDICES = (".pvd", ".series", ".nek5000")
#: seconds between the first two looks, so that what is whole already comes soon
SOON = 0.3
#: bytes, and when a file was changed
Stamp = tuple[int, int]


class Following:
    """Files of a run, looked at again and again.

    paths    names of files, with * in them or not, and folders in which a solver writes
    waiting  a sentence on what is waited for; empty where the newest step is at hand
    number   of the newest step among those of the run so far, from 0
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
        except (ElvisError, OSError) as error:  # whoever runs the solver may also delete its files meanwhile
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
            self.waiting = "waiting for a step: there is a mesh, and no field yet"
            return None
        shown = tuple((path, stable[path]) for path in files), found.time
        self._series, self._taken, self.waiting, self.number = series, stable, "", number
        if shown == self._shown:
            return None
        self._shown, self._shown_files = shown, files
        return found

    def _is_old(self, common: Sequence[Path], stable: dict[Path, Stamp]) -> bool:
        """Whether the files of the mesh are those of the series before."""
        assert self._series is not None
        is_same = tuple(common) == self._series.common
        return is_same and all(self._taken.get(path) == stable[path] for path in common)

    def _files(self) -> list[Path]:
        """The files as they are now."""
        found: list[Path] = []
        for path in self._paths:
            with suppress(ElvisError, OSError):  # none of such names yet, or no longer
                found += files_of_run(path) if path.is_dir() and not is_native(path) else expanded([path])
        return found


def files_of_run(folder: Path) -> list[Path]:
    """The data in a folder: native files, else an index of steps, else the most files whose names differ in a number.

    Beside these numbered files those of other names may hold the mesh: of them, what has their suffix, short of its
    last letter, is taken (``case.pyfrm`` for ``case-1.pyfrs``).
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
    """What tells whether a file, or one of a folder, has changed; None where there is none."""
    try:
        members = [path, *path.iterdir()] if path.is_dir() else [path]
        found = [member.stat() for member in members]
    except OSError:
        return None
    return sum(own.st_size for own in found), max(own.st_mtime_ns for own in found)
