"""The coverage of each pixel by contours on a plane, and the pixels for which it is proved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.mapping.patch import Patch
from elvis.reference.chebyshev import degrees_of, map_degrees
from elvis.reference.quantities import Quantities
from elvis.reference.scenes.contour_search import Search
from elvis.reference.scenes.rasters import pixels_between
from elvis.scene import Plane
from elvis.scene.cameras.view import View

#: coverage is certain that is known to this
_KNOWN = 0.01


def plane_contours(
    quantities: Quantities, name: str, values: Sequence[float], width: float, plane: Plane, view: View
) -> tuple[Floats, Bools] | None:
    """Coverage (n,) by the lines of a quantity on a plane, and whether it is proved; None if nothing can be proved.

    width  of the lines in pixels
    """
    least, greatest = np.full((2, view.count), np.inf)
    for patch in quantities.patches:
        for value in values:
            search = _search(quantities, name, value, plane, view, patch, 0.5 * width + 1.0)
            if search is None:
                return None
            segments = search.segments()
            lines = [(least, segments.ends, -segments.radius), (greatest, segments.sure, segments.radius)]
            for distance, ends, more in lines:
                for pixel, found in _distances(ends, more, 0.5 * width + 0.5, view):
                    np.minimum.at(distance, pixel, found)
    most, fewest = (np.clip(0.5 * width + 0.5 - distance, 0.0, min(1.0, width)) for distance in (least, greatest))
    return 0.5 * (most + fewest), most - fewest <= _KNOWN


def _search(
    quantities: Quantities, name: str, value: float, plane: Plane, view: View, patch: Patch, half_width: float
) -> Search | None:
    """The search for one value in a patch; None if fields or map aren't polynomials."""
    equation = quantities.equation(name, value)
    if equation is None:
        return None
    constant = not equation.leaves and (equation.root.op != "number" or equation.root.value == 0.0)
    if constant or not equation.is_known:
        return None
    names = tuple(dict.fromkeys(leaf.name for leaf in equation.leaves if leaf.op == "field"))
    numbers = quantities.modes(names, patch)
    if numbers is None:
        return None
    degrees = [degrees_of(patch, patch.fields[number]) for number in numbers.values()]
    shared = tuple(max(each) for each in zip(map_degrees(patch), *degrees, strict=True))
    solid = plane if patch.dimension == 3 else None
    return Search(patch, equation, shared, numbers, view, solid, half_width)


def _distances(ends: Floats, more: Floats, half_width: float, view: View) -> Iterator[tuple[Ints, Floats]]:
    """Pixels (m,) near segments with ends (k, 2, 2), and their distances plus ``more`` (k,) of each segment."""
    known = np.isfinite(ends).all(axis=(1, 2)) & np.isfinite(more)
    ends, more = ends[known], more[known]
    room = half_width + np.abs(more)[:, None]
    for own, pixel in pixels_between(view, ends.min(axis=1) - room, ends.max(axis=1) + room):
        place = np.column_stack([pixel % view.width, pixel // view.width])
        start, along = ends[own, 0], (ends[:, 1] - ends[:, 0])[own]
        length = np.maximum(np.einsum("ki,ki->k", along, along), 1e-300)
        share = np.clip(np.einsum("ki,ki->k", place - start, along) / length, 0.0, 1.0)
        away = np.linalg.norm(place - start - share[:, None] * along, axis=1)
        yield pixel, np.maximum(away + more[own], 0.0)
