"""Runtime plugins: what opens files and hands out volumes, for data that are drawn without conversion."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from elvis.plugins.runtime.volume import Volume


class VolumeSource(ABC):
    """Data in a plugin's own representation; the constructor takes the paths and opens them.

    format  what files it opens, in a few words
    fields  names, in the order of the file
    time    of the solution
    """

    format: ClassVar[str] = ""
    fields: Sequence[str] = ()
    time: float = 0.0

    @classmethod
    @abstractmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether the files are of this plugin's format, decided by their content; never raises for other files."""

    @abstractmethod
    def __init__(self, paths: Sequence[Path]) -> None:
        """Open the files.  FormatError for files that don't hold what the format promises."""

    @abstractmethod
    def volume(self, field: str) -> Volume:
        """The elements with one of the fields."""
