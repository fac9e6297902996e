"""Entry of lines into elements located by position, because they share no side with the element before."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, rows_by_number
from elvis.core.mapping.locate import Location
from elvis.core.streamlines.neighbours import Neighbours
from elvis.core.streamlines.velocity import Velocity

#: height over a side, in reference coordinates, up to which a place is on it
ON_SIDE = 1e-9
#: a velocity across a side, as part of its size, that is rounding
ALONG = 1e-9


def taking_up(
    velocity: Velocity, neighbours: Neighbours, location: Location, states: Floats, candidates: Ints, sign: int
) -> Bools:
    """(k,) whether elements take up lines that are at places of a location, on some of their sides.

    states      (n, D) reference coordinates of all places, those along Fourier directions too.  The coordinates of the
                candidates are put onto the sides that they are on.
    candidates  (k,) places
    sign        of the direction in which lines go
    An element takes up a line that leads into it from each of its sides that the place is on, or along it.
    """
    takes = np.zeros(len(candidates), bool)
    for number, here in rows_by_number(location.patch[candidates]):
        chosen = candidates[here]
        normals, offsets = neighbours.facets(number)
        plane = normals.shape[1]
        heights = states[chosen, :plane] @ normals.T + offsets
        on_side = heights <= ON_SIDE
        states[chosen, :plane] = _onto_sides(states[chosen, :plane], heights, on_side, normals)
        motion = velocity.motion(location.patch[chosen], location.row[chosen], states[chosen])
        slope = sign * motion.reference[:, :plane]
        onwards = slope @ normals.T
        leads_out = on_side & (onwards < -ALONG * np.abs(slope).max(axis=1, keepdims=True))
        takes[here] = np.isfinite(onwards).all(axis=1) & ~leads_out.any(axis=1)
    return takes


def _onto_sides(reference: Floats, heights: Floats, on_side: Bools, normals: Floats) -> Floats:
    """(k, d) coordinates put onto the nearest of the sides that they are on, where they are on any.

    A line that starts beyond the side by rounding would leave at once.
    """
    nearest = np.where(on_side, np.abs(heights), np.inf).argmin(axis=1)
    height = np.take_along_axis(heights, nearest[:, None], axis=1)
    normal = normals[nearest]
    shift = height * normal / np.einsum("ni,ni->n", normal, normal)[:, None]
    return np.where(on_side.any(axis=1)[:, None], reference - shift, reference)
