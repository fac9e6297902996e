"""Declared contents of the files of a source, compared with the output of its converter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from elvis.core.base.errors import FormatError

if TYPE_CHECKING:
    from elvis.plugins.conversion.plugin import Boundary, Converter


@dataclass(frozen=True)
class Declared:
    """Numbers that the files of a source state.

    elements  of the mesh, without those that only mark boundaries; None if the files state no number
    sides     of each boundary, by its name
    omitted   numbers of elements that the converter skips on purpose, by kind
    """

    elements: int | None = None
    sides: Mapping[str, int] = field(default_factory=dict)
    omitted: Mapping[str, int] = field(default_factory=dict)

    def check(self, source: Converter) -> list[str]:
        """Sentences on skipped contents.

        Raises FormatError if elements are missing or duplicated without a reason.
        """
        self._check_elements(source)
        return [*self._omissions(), *self._missing_sides(source)]

    def _check_elements(self, source: Converter) -> None:
        arrived = sum(map(len, source.blocks))
        accounted = arrived + sum(self.omitted.values())
        if self.elements is not None and accounted != self.elements:
            raise FormatError(f"expected {self.elements} elements, as the files declare, found {accounted}")

    def _omissions(self) -> Iterator[str]:
        for kind, count in self.omitted.items():
            if count:
                yield f"{count} {kind} were skipped"

    def _missing_sides(self, source: Converter) -> Iterator[str]:
        arrived: dict[str, int] = {}
        for boundary in source.boundaries:
            arrived[boundary.name] = arrived.get(boundary.name, 0) + _entries(boundary)
        for name, count in self.sides.items():
            missing = count - arrived.get(name, 0)
            if missing:
                yield f"{missing} of the {count} sides of the boundary {name!r} were skipped"


def _entries(boundary: Boundary) -> int:
    """Number of sides that a boundary lists."""
    of_vertices = sum(len(np.atleast_2d(vertices)) for vertices in boundary.vertices)
    return of_vertices + sum(len(rows) for _, rows, _ in boundary.sides)
