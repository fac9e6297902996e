"""Values of quantities on a boundary, at the places that are nearest to given points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.distances import nearest, surface_of
from elvis.core.files.columns import Columns
from elvis.core.integrals.reference_cells import Piece
from elvis.core.mapping import pointwise
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Location, Locator
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression, taken_name
from elvis.core.streamlines.walls import outward
from elvis.core.wall_curves.curve import wall_sides

#: columns that quantities can't have
_OWN = ("point", "distance", "x", "y", "z", "nx", "ny", "nz", "element", "status")
#: tolerance for a place on a side, in its element's reference coordinates
_ON_SIDE = 1e-6


def at_walls(dataset: Dataset, boundary: str, points: Floats, expressions: Sequence[Expression]) -> Columns:
    """A table of quantities at the places of a boundary that are nearest to points.

    Parameters
    ----------
    dataset : Dataset
        The solution.
    boundary : str
        Name or id of a boundary, or ``all`` outer sides.
    points : (n, 3) array
        Points anywhere.
    expressions : sequence of Expression
        Quantities; they come from the element behind the side, with its normal ``nx``, ``ny``, ``nz``.

    Returns
    -------
    Columns
        point, distance to the place, x, y, z of the place, nx, ny, nz, element, status and the quantities.

    Raises
    ------
    ElvisError
        If the data have no such boundary, or a quantity has the name of another column.
    """
    evaluator = Evaluator(dataset, expressions)
    _check(evaluator, boundary)
    pieces = wall_sides(dataset, evaluator, boundary, boundary)
    places = nearest(surface_of(dataset, boundary), points).place
    count = len(points)
    found, normals = np.full((count, 3), np.nan), np.full((count, 3), np.nan)
    element, values = np.full(count, -1), np.full((count, len(expressions)), np.nan)
    for piece, point, rows, reference in _on_sides(pieces, evaluator, places):
        normals[point] = outward(piece, pointwise.jacobians(piece.patch, rows, reference))
        here = ElementPoints(piece.patch, rows, reference, normals[point])
        found[point], element[point] = here.positions, piece.patch.element_ids[rows]
        for column, own in enumerate(evaluator.values_at(expressions, here)):
            values[point, column] = own
    columns: dict[str, NDArray[np.generic]] = {
        "point": np.arange(count),
        "distance": np.linalg.norm(found - points, axis=1),
    }
    columns |= dict(zip("xyz", found.T, strict=True)) | dict(zip(("nx", "ny", "nz"), normals.T, strict=True))
    columns |= {"element": element, "status": np.where(element < 0, int(Status.FAILED), int(Status.INSIDE))}
    return columns | {own.text: column for own, column in zip(expressions, values.T, strict=True)}


def _check(evaluator: Evaluator, boundary: str) -> None:
    """Raise ElvisError for a quantity with the name of another column, and for data with Fourier directions."""
    taken = [own.text for own in evaluator.expressions if own.text in _OWN]
    if taken:
        raise ElvisError(taken_name(taken[0]))
    if any(patch.homogeneous for patch in evaluator.patches):
        raise ElvisError(f"{boundary}: expected data without Fourier directions")


def _on_sides(pieces: Sequence[Piece], evaluator: Evaluator, places: Floats) -> list[tuple[Piece, Ints, Ints, Floats]]:
    """Places (n, 3) on sides: the piece, numbers of places, rows of its patch, reference points; each place once."""
    location = Locator(evaluator.patches).locate(places, True)
    is_free = np.ones(len(places), bool)
    found = []
    for piece in pieces:
        here = _candidates(piece, evaluator, location, is_free)
        side, off = _projected(piece, location.reference[here, : piece.patch.dimension])
        chosen = here[off <= _ON_SIDE]
        point, first = np.unique(location.point[chosen], return_index=True)
        if len(point):
            is_free[point] = False
            rows = location.row[chosen[first]]
            found.append((piece, point, rows, side[off <= _ON_SIDE][first]))
    return found


def _candidates(piece: Piece, evaluator: Evaluator, location: Location, is_free: Bools) -> Ints:
    """Rows of a location that are in elements of a piece."""
    number = next(k for k, patch in enumerate(evaluator.patches) if patch is piece.patch)
    is_inside = (location.status == Status.INSIDE) & (location.patch == number) & is_free[location.point]
    return np.flatnonzero(is_inside & np.isin(location.row, piece.rows))


def _projected(piece: Piece, reference: Floats) -> tuple[Floats, Floats]:
    """Reference points (n, D) projected onto a side, and (n,) their distances from it.

    A side has places origin + axes xi in its element, so the projection is a least squares solution.
    """
    size = piece.shape.dimension
    corners = piece.places(np.vstack([np.zeros(size), np.eye(size)]))
    origin, axes = corners[0], (corners[1:] - corners[0]).T
    xi = np.linalg.lstsq(axes, (reference - origin).T, rcond=None)[0].T
    side = piece.places(xi)
    return side, np.linalg.norm(side - reference, axis=1)
