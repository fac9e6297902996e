"""Vectors at points: where glyphs stand, and which way they point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints, rows_by_number
from elvis.core.streamlines.course import REST, diagonal
from elvis.core.streamlines.flow_data import FlowSource, flow_data
from elvis.core.streamlines.seeds import seed_points


@dataclass(frozen=True, eq=False)
class Anchors:
    """Points with a nonzero vector.

    points     (n, 3)  world coordinates
    vectors    (n, 3)  tangential on surfaces in space
    reference  (n, 3)  in the element, zero beyond its dimension
    element    (n,)    ids in the file
    left       reasons for excluding other points, and their numbers
    name       of the vector: its components
    size       diagonal of the box of all elements
    """

    points: Floats
    vectors: Floats
    reference: Floats
    element: Ints
    left: Mapping[str, int]
    name: str
    size: float

    def __len__(self) -> int:
        return len(self.element)


def anchors(data: FlowSource, points: Any, vector: Sequence[str] | None = None, random: int = 0) -> Anchors:
    """A vector at points (n, d) or at points described by texts (`seeds`).

    vector  its components as texts; None: the velocity that is customary in the data
    random  number that random points are drawn with

    Raises ElvisError for 1D data, for what names no quantity, and for too few components.
    """
    own_data = flow_data(data)
    expressions = own_data.components(vector)
    velocity = own_data.velocity(expressions)
    locator = own_data.locator(velocity)
    asked = seed_points(own_data.seed_places(velocity, locator), points, random)
    found = locator.locate(asked)
    inside = np.flatnonzero(found.patch >= 0)
    patch, row, own = found.patch[inside], found.row[inside], found.reference[inside]
    vectors = velocity.vectors(patch, row, own)
    size = np.linalg.norm(vectors, axis=1)
    known = np.isfinite(size)
    moving = known & (size > REST * size[known].max(initial=0.0))
    left = {
        "lie outside the mesh": len(asked) - len(inside),
        "have a vector that is not a number": int((~known).sum()),
        "have the vector zero": int((known & ~moving).sum()),
    }
    reference = np.zeros((len(inside), 3))
    for number, here in rows_by_number(patch):
        places = velocity.in_elements(number, own[here, : velocity.patches[number].dimension])
        reference[here, : places.shape[1]] = places
    chosen = inside[moving]
    return Anchors(
        asked[found.point[chosen]],
        vectors[moving],
        reference[moving],
        found.element_id[chosen],
        {why: count for why, count in left.items() if count},
        ", ".join(expression.text for expression in expressions),
        diagonal(locator),
    )
