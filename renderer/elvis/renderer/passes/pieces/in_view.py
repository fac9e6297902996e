"""Pieces of lines in a view, with their shapes; they are subdivided while they are large in the picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.streamlines.lines.pieces import Pieces, bernstein_of, halved
from elvis.renderer.raster.ball_bounds import bounds_of_balls, is_in_picture, pixels_within
from elvis.scene.cameras.view import View

#: pixels of a piece's longer side above which it is bisected, beyond four radii; how often at most, and next to the eye
_LARGE, _HALVINGS, _HALVINGS_HERE = 40.0, 12, 4


@dataclass(frozen=True)
class Girth:
    """How thick tubes are: a radius in the world, or a width in pixels at any depth."""

    radius: float | None
    width: float | None

    def in_view(self, view: View) -> tuple[float, float]:
        """The radius at the plane of the eye, and its growth with depth."""
        if self.width is None:
            assert self.radius is not None
            return self.radius, 0.0
        half = 0.5 * self.width * float(np.linalg.norm(view.column))
        return (0.0, half) if view.perspective else (half, 0.0)


@dataclass(frozen=True, eq=False)
class PiecesInView:
    """Pieces that a view sees.

    number       (n,)          which pieces they are a part of
    points       (n, 8, 3)     coefficients of powers in the world
    place        (n, 2)        the middle and half the width of their parameters in the piece's
    near         (n,)          no point of the tube has a smaller depth
    least, most  (n, 4)        bounds of x, y, x + y and x - y of their pixels
    """

    number: Ints
    points: Floats
    place: Floats
    near: Floats
    least: Ints
    most: Ints


def part_of(points: Floats, place: Floats) -> Floats:
    """(n, k, 3) coefficients of parts of polynomials (n, k, 3): u is m + h v with m, h in ``place`` (n, 2)."""
    middle, half = place.T[:, :, None]
    found = np.zeros_like(points)
    for k in range(points.shape[1] - 1, -1, -1):
        shifted = middle[:, None] * found
        shifted[:, 1:] += half[:, None] * found[:, :-1]
        shifted[:, 0] += points[:, k]
        found = shifted
    return found


def pieces_in_view(view: View, pieces: Pieces, girth: Girth, chosen: Ints) -> PiecesInView:
    """Visible pieces, subdivided while they are large in the picture, nearest first."""
    number, points = chosen, pieces.points[chosen]
    place = np.tile([0.0, 1.0], (len(chosen), 1))
    found: list[PiecesInView] = []
    for halving in range(_HALVINGS + 1):
        near, low, high, thick = _bounds(view, points, girth)
        seen = is_in_picture(view, low, high)
        large = (high - low)[:, :2].max(axis=1) > _LARGE + 2.0 * thick
        large &= halving < np.where(near > 0.0, _HALVINGS, _HALVINGS_HERE)
        done = np.flatnonzero(seen & ~large)
        pixels = pixels_within(view, low[done], high[done])
        found.append(PiecesInView(number[done], points[done], place[done], near[done], *pixels))
        left = np.flatnonzero(seen & large)
        if not len(left):
            break
        number, points = np.tile(number[left], 2), halved(points[left])
        half = 0.5 * place[left, 1]
        middles = np.concatenate([place[left, 0] - half, place[left, 0] + half])
        place = np.stack([middles, np.tile(half, 2)], axis=1)
    joined = [np.concatenate(column) for column in zip(*(vars(own).values() for own in found), strict=True)]
    order = np.argsort(joined[3], kind="stable")
    return PiecesInView(*(column[order] for column in joined))


def _bounds(view: View, points: Floats, girth: Girth) -> tuple[Floats, Floats, Floats, Floats]:
    """Bounds in the picture of tubes about curves (n, 8, 3), as `bounds_of_balls`, from balls at control points."""
    control = bernstein_of(points)
    radius, growth = girth.in_view(view)
    return bounds_of_balls(view, control, radius + growth * np.abs(view.depth_of(control)))
