"""What a command is asked about: a native dataset, or what a runtime plugin opens."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from elvis.core.dataset import Dataset
    from elvis.renderer.evaluation import Evaluation


def source_of(paths: Sequence[Path], plugin: str | None) -> Dataset | Evaluation:
    """The dataset of native files; what a runtime plugin opens is evaluated on a device."""
    from elvis.core.terminal import warn
    from elvis.plugins.opening import open_files

    opened = open_files(paths, plugin, warn)
    if opened is None:
        from elvis.formats.reading import read_data

        return read_data(paths)
    from elvis.renderer.evaluation import Evaluation

    return Evaluation(opened, warn)
