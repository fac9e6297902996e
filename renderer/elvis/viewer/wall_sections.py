"""Values along a wall through a clicked point: the whole wall of 2D data, a plane section of a wall of 3D data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.distances.boundaries import names_of_boundaries
from elvis.core.quantities import Expression

if TYPE_CHECKING:
    from elvis.core.base.arrays import Floats
    from elvis.core.data.dataset import Dataset

#: points along a wall
COUNT = 1201
#: distance of a point of a 3D wall from the boundary, relative to the data's box
ON_WALL = 1e-6
AXES = ("x", "y", "z")


def wall_section(
    dataset: Dataset, place: Sequence[float], quantities: Sequence[str], axis: str | None
) -> dict[str, Any]:
    """Columns along the wall at a place, and its name.

    axis  normal of the section, ``x``, ``y`` or ``z``; None for the one whose section is closed, then the longest

    Raises ElvisError if the place is not on a wall, and if no plane through it gives a section.
    """
    from elvis.core.wall_curves import on_walls

    point = np.zeros(3)
    point[: len(place)] = place
    wall = _wall_at(dataset, point)
    curve, normal = (f"boundary:{wall}", None) if dataset.mesh.dimension == 2 else _section(dataset, wall, point, axis)
    columns = on_walls(dataset, curve, [Expression.of(dataset, text) for text in quantities], COUNT)
    return {"wall": wall, "axis": normal, "columns": {name: np.asarray(own).tolist() for name, own in columns.items()}}


def _wall_at(dataset: Dataset, point: Floats) -> str:
    """The boundary nearest to a point (3,); ElvisError if the point of 3D data is not on it."""
    from elvis.core.wall_curves import at_walls

    distances = {}
    for name in names_of_boundaries(dataset.mesh):
        found = at_walls(dataset, name, point[None], [])
        distances[name] = float(found["distance"][0])
    if not distances:
        raise ElvisError("the data have no boundaries with names")
    nearest = min(distances, key=lambda name: distances[name])
    low, high = dataset.mesh.corners
    if dataset.mesh.dimension == 3 and distances[nearest] > ON_WALL * np.linalg.norm(high - low):
        raise ElvisError("the point is not on a boundary: click a wall")
    return nearest


def _section(dataset: Dataset, wall: str, point: Floats, axis: str | None) -> tuple[str, str]:
    """Curve of the section of a wall through a point, and its normal; ElvisError if no plane gives one."""
    from elvis.core.wall_curves import wall_curves

    place = ",".join(map(repr, point.tolist()))
    ranked = []
    error = ElvisError(f"expected x, y or z as the normal of a section, found {axis!r:.20}")
    for name in AXES if axis is None else (axis,):
        if name not in AXES:
            break
        normal = ",".join(str(int(name == other)) for other in AXES)
        curve = f"section:{wall}:plane:{place}:{normal}"
        try:
            longest = wall_curves(dataset, curve)[0][0]
        except ElvisError as reason:
            error = reason
            continue
        ranked.append((longest.is_closed, longest.curve.length, curve, name))
    if not ranked:
        raise error
    *_, curve, name = max(ranked)
    return curve, name
