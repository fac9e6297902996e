"""Exports: what writes native data as files of other programs, by the suffix that it is registered for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, cast

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.needing import is_there
from elvis.core.base.relative import error_limit, scale
from elvis.core.data.dataset import Dataset
from elvis.plugins.command.registry import load
from elvis.plugins.conversion.discovery import installing

GROUP = "elvis.exporters"


@dataclass(eq=False)
class Loss:
    """The largest difference between data and export, and the range of the data."""

    name: str
    order: int = 0
    error: float = 0.0
    element: int = -1
    low: float = np.inf
    high: float = -np.inf

    @property
    def spread(self) -> float:
        """Largest minus smallest value."""
        return self.high - self.low

    @property
    def magnitude(self) -> float:
        """The largest absolute value."""
        return max(abs(self.low), abs(self.high))

    @property
    def relative(self) -> float:
        """The error as a share of the range, or of the magnitude where the range is rounding."""
        return self.error / scale(self.spread, self.magnitude)

    def note(self, element_ids: Ints, exact: Floats, found: Floats) -> None:
        """Take in exact and other values (n, k) on elements with these ids (n,)."""
        errors = np.abs(exact - found).max(axis=1, initial=0.0)
        first = int(np.nanargmax(errors)) if np.isfinite(errors).any() else 0
        if len(errors) and (errors[first] > self.error or self.element < 0):
            self.error, self.element = float(errors[first]), int(element_ids[first])
        finite = exact[np.isfinite(exact)]
        if finite.size:
            self.low, self.high = min(self.low, float(finite.min())), max(self.high, float(finite.max()))

    def is_within(self, bound: float) -> bool:
        """Whether the relative error is at most ``bound``, or rounding of the magnitude."""
        return self.error <= error_limit(bound, self.spread, self.magnitude)


class Exporter(Protocol):
    """A function that writes a file; its entry point has the name of the suffix, without the dot."""

    def __call__(
        self,
        dataset: Dataset,
        names: Sequence[str] | None,
        order: int | None,
        path: Path,
        report: Callable[[Sequence[Loss]], object],
    ) -> Sequence[str]:
        """Write the dataset to ``path``; returns sentences on names and other data that the file can't represent.

        names   of the fields to write, None for all
        order   of all cells, None for the lowest that contains map and fields
        report  called with the errors of the coordinates and of each field, before anything is written; it may raise
        """


def exporter(suffix: str) -> Exporter:
    """The function for files of a suffix; PluginError where there is none."""
    return cast(Exporter, load(GROUP, suffix))


def require(module: str, package: str) -> None:
    """ElvisError, naming what brings it, where a package that an export needs is missing."""
    if not is_there(module):
        raise ElvisError(f"the export needs {package}, which is not installed; {installing(package)} installs it")
