"""NURBS volumes as JSON, in a format of this project.

    {"format": "elvis-nurbs", "version": 1, "time": 0.5,
     "patches": [{"degrees": [2, 2, 1],
                  "knots": [[0, 0, 0, 1, 1, 1], [0, 0, 0, 1, 1, 1], [0, 0, 1, 1]],
                  "points": [[0, 0, 0], …], "weights": [1, …],
                  "fields": {"p": [0.25, …]}}],
     "boundaries": {"wall": [[0, "z-"], [0, "x+"]]}}

Points, weights and the control values of fields run along x first, then y, then z.  Missing weights are 1; fields are
rational with the weights of their patch.  Every patch has the same fields.  Boundaries are lists of patches, numbered
from 0, and sides.  Patches meet where corners of their elements coincide.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.files.plain import json_content, leading
from elvis.plugins.faces import vertices_at
from elvis.plugins.nurbs.knots import HIGHEST, KnotVector
from elvis.plugins.nurbs.mesh import side_elements

FORMAT, _VERSION = "elvis-nurbs", 1
#: numbers of the faces of a hexahedron (`elvis.core.shapes`) by name
_SIDES = {"z-": 0, "y-": 1, "x+": 2, "y+": 3, "x-": 4, "z+": 5}


@dataclass(frozen=True, eq=False)
class OwnMesh:
    """Patches that share nothing.

    knots    knot vectors of each patch in its three directions
    weights  (k,) of the control points of all patches
    points   (k, 3) control points
    fields   control values (k,) by name
    named    patches and faces of each boundary
    """

    knots: list[tuple[KnotVector, KnotVector, KnotVector]]
    weights: Floats
    points: Floats
    fields: dict[str, Floats]
    named: dict[str, list[tuple[int, int]]]
    time: float

    def controls(self) -> list[Ints]:
        """For each patch the numbers (n_x, n_y, n_z) of its control points."""
        counts = [[vector.count for vector in own] for own in self.knots]
        first = np.cumsum([0, *map(np.prod, counts)])
        ranges = (np.arange(first[k], first[k + 1]) for k in range(len(counts)))
        return [own.reshape(count[::-1]).transpose() for own, count in zip(ranges, counts, strict=True)]

    def elements(self, corners: Floats) -> Ints:
        """(e, 8) vertices of elements with these corners (e, 8, 3)."""
        return vertices_at(corners)

    def sides(self) -> dict[str, list[tuple[Ints, int]]]:
        """For each boundary numbers (n,) of elements, and which of their faces lie on it."""
        return {name: [side_elements(self.knots, *side) for side in sides] for name, sides in self.named.items()}


def is_own(path: Path) -> bool:
    """Whether a file begins as this form does."""
    start = leading(path, 4096)
    return start.lstrip().startswith(b"{") and f'"{FORMAT}"'.encode() in start


def read_own(path: Path) -> OwnMesh:
    """The patches of a file; FormatError where it breaks a rule of the form."""
    table = json_content(path)
    try:
        return _Reader().mesh(table)
    except FormatError as error:
        raise error.within(file=path) from error


class _Reader:
    """Reader from a table to a mesh; unexpected contents raise FormatError with their place."""

    def mesh(self, table: dict[str, Any]) -> OwnMesh:
        if table.get("format") != FORMAT or table.get("version") != _VERSION:
            found = f"{table.get('format')!r} {table.get('version')!r}"
            raise FormatError(f"expected the format {FORMAT} in version {_VERSION}, found {found}")
        patches = table.get("patches")
        if not isinstance(patches, list) or not patches:
            raise FormatError("expected a list of patches, found none", place="patches")
        knots, points, weights, fields = zip(*(self._patch(k, own) for k, own in enumerate(patches)), strict=True)
        for number, own in enumerate(fields):
            if own.keys() != fields[0].keys():
                wanted = ", ".join(fields[0]) or "none"
                raise FormatError(
                    f"expected the fields of patch 0 ({wanted}), found {', '.join(own) or 'none'}",
                    place=f"patch {number}, fields",
                )
        every = {name: np.concatenate([own[name] for own in fields]) for name in fields[0]}
        named = {name: self._sides(name, sides, len(patches)) for name, sides in table.get("boundaries", {}).items()}
        time = self._numbers(table.get("time", 0.0), (), "time")
        return OwnMesh(list(knots), np.concatenate(weights), np.concatenate(points), every, named, float(time))

    def _patch(
        self, number: int, patch: dict[str, Any]
    ) -> tuple[tuple[KnotVector, KnotVector, KnotVector], Floats, Floats, dict[str, Floats]]:
        place = f"patch {number}"
        degrees, lists = (self._three(patch, name, place) for name in ("degrees", "knots"))
        x, y, z = (self._vector(degrees[k], lists[k], f"{place}, knots {'xyz'[k]}") for k in range(3))
        count = x.count * y.count * z.count
        points = self._numbers(patch.get("points"), (count, 3), f"{place}, points")
        weights = self._numbers(patch.get("weights", [1.0] * count), (count,), f"{place}, weights")
        if not (weights > 0).all():
            raise FormatError(f"expected positive weights, found {weights.min():g}", place=f"{place}, weights")
        fields = {
            name: self._numbers(values, (count,), f"{place}, field {name}")
            for name, values in patch.get("fields", {}).items()
        }
        return (x, y, z), points, weights, fields

    def _three(self, patch: dict[str, Any], name: str, place: str) -> list[Any]:
        found = patch.get(name)
        if not isinstance(found, list) or len(found) != 3:
            raise FormatError(f"expected a list of three, found {found!r:.60}", place=f"{place}, {name}")
        return found

    def _vector(self, degree: object, knots: object, place: str) -> KnotVector:
        if not isinstance(degree, int) or not 1 <= degree <= HIGHEST:
            raise FormatError(f"expected a degree from 1 to {HIGHEST}, found {degree!r}", place=place)
        values = self._numbers(knots, (len(knots) if isinstance(knots, list) else 0,), place)
        vector = KnotVector(degree, values)
        if vector.count <= degree or (np.diff(values) < 0).any() or not len(vector.spans):
            raise FormatError(f"expected {2 * degree + 2} or more ascending knots, found {knots!r:.60}", place=place)
        return vector

    def _numbers(self, values: object, shape: tuple[int, ...], place: str) -> Floats:
        try:
            found = np.array(values, np.float64)
        except (TypeError, ValueError):
            found = np.empty(0)
        if found.shape != shape or not np.isfinite(found).all():
            what = f"an array {shape} of numbers" if shape else "a number"
            raise FormatError(f"expected {what}, found {found.shape if shape else repr(values)}", place=place)
        return found

    def _sides(self, name: str, sides: Any, patches: int) -> list[tuple[int, int]]:
        found = []
        for side in sides if isinstance(sides, list) else [sides]:
            good = isinstance(side, list) and len(side) == 2 and isinstance(side[0], int) and side[1] in _SIDES
            if not good or not 0 <= side[0] < patches:
                wanted = f"a patch from 0 to {patches - 1} and one of {', '.join(_SIDES)}"
                raise FormatError(f"expected {wanted}, found {side!r:.60}", place=f"boundary {name}")
            found.append((side[0], _SIDES[side[1]]))
        return found
