"""The points that ``elvis probe`` evaluates at: what its options say, and the arrays."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import click

from elvis.core.base.errors import ElvisError
from elvis.core.data.arguments import Triple, triples
from elvis.core.data.axis_planes import box_of, is_across_axis, point_and_normal

if TYPE_CHECKING:
    from elvis.core.base.arrays import Floats
    from elvis.core.files.nrrd import Grid
    from elvis.renderer.commands.sources import Source

#: columns of a table that are not quantities
COLUMNS = ("point", "x", "y", "z", "element", "status")
#: points along a line, and along each side of a plane, where -n says nothing
ALONG = 101
#: points of a grid along one axis
_MOST = 65536
#: rows of the table of a grid: about 4 GB of a field
_MOST_ROWS = 50_000_000


def counts_of(value: str) -> tuple[int, ...]:
    """``200`` as (200,), ``200x100`` as (200, 100)."""
    try:
        counts = tuple(int(part) for part in value.lower().replace(",", "x").split("x"))
    except ValueError:
        counts = ()
    if len(counts) not in (1, 2) or min(counts) < 2:
        raise click.BadParameter(
            f"expected a number such as 200, or 200x100 for a plane, each at least 2, found {value!r}"
        )
    return counts


def grid_counts(value: str) -> tuple[int, ...]:
    """``64x64x32`` or ``64,64,32``: points along x, y and z."""
    parts = value.lower().replace("x", ",").split(",")
    if len(parts) != 3 or not all(part.strip().isdecimal() and 1 <= int(part) <= _MOST for part in parts):
        raise click.BadParameter(f"expected three numbers from 1 to {_MOST} such as 64x64x32, found {value!r}")
    return tuple(map(int, parts))


def spanned(value: str) -> tuple[Triple, ...] | str:
    """``P:U:V`` as three triples; ``z=0.2`` and ``z`` unchanged, since its ends depend on the data."""
    return value if is_across_axis(value) else triples(value, 3)


def chosen_points(
    points: str | None,
    single: tuple[tuple[Triple], ...],
    line: tuple[Triple, Triple] | None,
    plane: tuple[Triple, Triple, Triple] | None,
    counts: tuple[int, ...] | None,
) -> Floats:
    """(n, 3) the requested points; usage error unless there is just one way."""
    import numpy as np

    from elvis.core.numbers.queries import points_in_table, points_on_line, points_on_plane

    if sum(way is not None for way in (points, single or None, line, plane)) != 1:
        ways = "--points, --point, --line, --plane and --grid"
        raise click.UsageError(f"expected one of {ways}", click.get_current_context())
    if plane is not None:
        n, m = counts * 2 if counts and len(counts) == 1 else counts or (ALONG, ALONG)
        return points_on_plane(*plane, (n, m))
    if counts and (line is None or len(counts) == 2):
        expected = "no -n with points" if line is None else "one number of points along a line"
        raise click.BadParameter(f"expected {expected}", click.get_current_context(), param_hint="'-n'")
    if line is not None:
        return points_on_line(*line, counts[0] if counts else ALONG)
    if single:
        return np.array([point for (point,) in single], np.float64)
    assert points is not None
    return points_in_table(points)


def grid_of(source: Source, counts: tuple[int, int, int], box: tuple[Triple, Triple] | None) -> Grid:
    """The grid in a box, by default that of the data; ElvisError if several points would coincide."""
    from elvis.core.files.nrrd import Grid

    if box is None:
        box = _box_of(source)
    for name, low, high, count in zip("xyz", *box, counts, strict=True):
        if not low < high and count > 1:
            raise ElvisError(f"--grid: expected one point along {name}, where the box goes from {low:g} to {high:g}")
    return Grid(*box, counts)


def _box_of(source: Source) -> tuple[Triple, Triple]:
    """The lowest and the highest coordinates of the data; 0 where there is none."""
    found = source.box()
    lower, upper = ([float(end or 0.0) for end in found[name]] for name in ("lower", "upper"))
    return (lower[0], lower[1], lower[2]), (upper[0], upper[1], upper[2])


def _corners(source: Source) -> Floats:
    """(2, 3) corners of the box whose middle planes across an axis go through, the same as in pictures."""
    import numpy as np

    return np.array(_box_of(source)) if source.dataset is None else box_of(source.dataset)


def points_of_grid(grid: Grid) -> Floats:
    """(n, 3) its points; ElvisError for more than a table holds."""
    count = math.prod(grid.counts)
    if count > _MOST_ROWS:
        raise ElvisError(f"--grid: expected at most {_MOST_ROWS} points of a table, found {count}; use -o NAME.nrrd")
    return grid.planes(0, grid.counts[2])


def across_box(source: Source, text: str) -> tuple[Triple, Triple, Triple]:
    """The corner and the sides of a plane across an axis, ``z=0.2`` or ``z``, that spans the box of the data."""
    lower, upper = _box_of(source)
    point, normal = triples(point_and_normal(text, partial(_corners, source)), 2)
    across = normal.index(1.0)
    corner = [point[axis] if axis == across else lower[axis] for axis in range(3)]
    sides = []
    for axis in (axis for axis in range(3) if axis != across):
        side = [0.0, 0.0, 0.0]
        side[axis] = upper[axis] - lower[axis]
        sides.append((side[0], side[1], side[2]))
    return (corner[0], corner[1], corner[2]), sides[0], sides[1]
