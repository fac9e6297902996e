"""Critical points of the wall shear: all points of a wall where it is zero, isolated by Bernstein bounds on its faces.

If a fluid is at rest on a wall, the velocity's gradient there equals the gradient of lambda, the height over the face
in its element, times du/dlambda, a polynomial.  The shear is zero if both its components along the tangents of the face
are zero, t_i . du/dlambda, which are polynomials in (r, s) even if the face is curved.  Fluid comes to the wall at
attachments, where lines on the wall leave the point.  There the trace of the shear's gradient is positive, since by
continuity the velocity normal to the wall is -h^2/2 times this trace (Delery 2013, Three-dimensional separated flow
topology).  Each of several ranks searches the faces of its part, once all ranks know how fast the velocity grows away
from the wall.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, grid_points
from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import ALONE, Ranks
from elvis.core.bounds.zero_search import ZeroSearch
from elvis.core.critical.points import (
    CriticalPoint,
    CriticalPoints,
    Found,
    classified,
    degree_of,
    ends,
    numerator,
    united,
)
from elvis.core.data.dataset import Dataset
from elvis.core.distances.boundaries import ALL, sides_by_name
from elvis.core.integrals.reference_cells import Piece
from elvis.core.integrals.targets import has_outer_boundaries
from elvis.core.mapping import pointwise, tangents
from elvis.core.mapping.orientation import chunks
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import box_degrees
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.expansion import values, values_and_gradients
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.quadrature import gauss
from elvis.core.portions.portion import Portion, knows_inner_sides
from elvis.core.quantities.elements.points import Lattice
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.tree import AXES, world_derivative
from elvis.core.streamlines.velocity import velocity_expressions
from elvis.core.streamlines.walls import facet_slope, wall_pieces

#: faces at once
_CHUNK = 512
#: a velocity on the wall below this share of its growth across an element is zero
_AT_REST = 1e-9
#: tolerance for the shear's components to count as polynomials, relative to the largest value on the face
_NO_POLYNOMIAL = 1e-10
#: share of the largest eigenvalue that the trace must exceed to distinguish attachment from separation
_NEUTRAL = 1e-9


def wall_points(dataset: Dataset, wall: str, velocity: Sequence[str] | None = None) -> CriticalPoints:
    """All points of a boundary of 3D data where the wall shear is zero, by kind: attachment node, separation focus, ….

    velocity  names of its components, zero on the wall; None for the usual names in the data
    Eigenvalues belong to the shear's gradient for a viscosity of one, and to momenta if the data have momenta.  Points
    on edges along which all shear is zero, as between two walls, are excluded.  Raises ElvisError as `critical_points`,
    for data that aren't 3D, for unknown boundaries, and if the velocity isn't zero on the wall.

    >>> elvis.wall_points(elvis.read("car.xml", "car.fld"), "body").points  # doctest: +SKIP
    """
    return united([_found(dataset, wall, velocity, ALONE)])


def shared_wall_points(
    portion: Portion, wall: str, velocity: Sequence[str] | None, ranks: Ranks
) -> CriticalPoints | None:
    """`wall_points` if each of several ranks has a part of the data; None except at the first rank.

    For walls that are outer boundaries (`is_outer_wall`).
    """
    every = ranks.gather(_found(portion.dataset, wall, velocity, ranks), f"critical points of {velocity} on {wall}")
    return united(every) if every else None


def is_outer_wall(dataset: Dataset, wall: str) -> bool:
    """Whether a part of a dataset knows its inner sides, and a name means a boundary that has none of them."""
    is_known = wall == ALL or wall in sides_by_name(dataset.mesh)
    return is_known and knows_inner_sides(dataset) and has_outer_boundaries(dataset, [wall])


def _found(dataset: Dataset, wall: str, velocity: Sequence[str] | None, ranks: Ranks) -> Found:
    """The zeros on the wall's faces in a dataset, which is one rank's part."""
    zeros = [numerator(each) for each in velocity_expressions(dataset, velocity)]
    slopes = [
        Expression(f"{each.text}_{x}", world_derivative(each.root, k)) for each in zeros for k, x in enumerate(AXES)
    ]
    evaluator = Evaluator(dataset, [*zeros, *slopes])
    pieces = wall_pieces(dataset, evaluator.patches, wall, ranks)
    batches = [piece.part(np.arange(len(piece))[some]) for piece in pieces for some in chunks(len(piece), _CHUNK)]
    searches = [_OnFaces(evaluator, batch, zeros, slopes) for batch in batches]
    _check_rest([own for search in searches for own in search.fastest], wall, ranks)
    found: list[CriticalPoint] = []
    undecided: set[int] = set()
    for search in searches:
        search.run(search.sound)
        found += search.points()
        open_rows = sorted(search.undecided | search.unsound)
        undecided |= set(search.piece.patch.element_ids[search.piece.rows[open_rows]].tolist())
    return Found(found, sorted(undecided), [], ends(evaluator.patches))


@dataclass(frozen=True)
class _Fastest:
    """The maximum of a velocity on some faces.

    speed   its largest component there; element (an id) and place (3,) of the maximum
    length  of the velocity there
    growth  the largest component of any velocity's growth from the faces across an element
    """

    speed: float
    element: int
    place: tuple[float, ...]
    length: float
    growth: float


def _check_rest(own: Sequence[_Fastest], wall: str, ranks: Ranks) -> None:
    """Raise ElvisError if the velocity isn't zero on a wall, relative to its growth across all ranks' elements."""
    every = [some for part in ranks.exchange(list(own), f"the velocity on {wall}") for some in part]
    if not every:
        return
    fastest = max(every, key=lambda some: (some.speed, -some.element))
    if fastest.speed > _AT_REST * max(some.growth for some in every):
        x, y, z = fastest.place
        found = f"{fastest.length:.3g} at {x:.6g}, {y:.6g}, {z:.6g}"
        raise ElvisError(f"expected a velocity that is zero on the wall {wall}, found {found}")


class _OnFaces(ZeroSearch):
    """The zeros of shear on sides of elements; rows refer to the piece.

    sound, unsound  faces on which the components of the shear are polynomials, and the remaining faces
    fastest         maxima of the velocity at the points that determine the shear
    """

    def __init__(
        self, evaluator: Evaluator, piece: Piece, zeros: Sequence[Expression], slopes: Sequence[Expression]
    ) -> None:
        patch = piece.patch
        curved = max(box_degrees(bernstein_space(patch.geometry)))
        super().__init__(piece.shape, curved + max(degree_of(each, evaluator, patch) for each in zeros))
        self.evaluator, self.piece, self.zeros, self.slopes = evaluator, piece, zeros, slopes
        self._expansion = modified(piece.shape, (self.degree + 1,) * 2)
        self._coefficients = self._interpolated()

    def _interpolated(self) -> Floats:
        """(n, 2, m) coefficients of the shear's components on each face.

        Other points show on which faces they are valid.
        """
        count, tables, fastest = len(self.piece), [], []
        for nodes in (gauss(self.degree + 1)[0], gauss(self.degree + 2)[0]):
            lattice = grid_points(nodes, nodes)
            points = uncollapse(self.shape, lattice)
            places, velocity, across = self._motion(np.arange(count), points)
            fastest.append(_fastest(places, velocity, across))
            tables.append((values(self._expansion, points), self._shear(places, across).reshape(count, -1, 2)))
        (modes, shear), (others, more) = tables
        found = np.einsum("mq,nqi->nim", np.linalg.pinv(modes), shear)
        apart = np.abs(np.einsum("nim,qm->nqi", found, others) - more).max(axis=(1, 2))
        is_sound = apart <= _NO_POLYNOMIAL * np.abs(shear).max(axis=(1, 2))
        self.sound, self.unsound = np.flatnonzero(is_sound), set(np.flatnonzero(~is_sound).tolist())
        self.fastest = fastest
        return np.asarray(found)

    def values(self, rows: Ints, lattice: Floats) -> Floats:
        """The values t_i . du/dlambda, as required by `ZeroSearch`."""
        places, _, across = self._motion(rows, lattice)
        return self._shear(places, across)

    def _motion(self, rows: Ints, lattice: Floats) -> tuple[Lattice, Floats, Floats]:
        """Points of faces, the velocity (n, 3) there, and du/dlambda (n, 3)."""
        piece = self.piece
        places = Lattice(piece.patch, piece.rows[rows], piece.places(lattice))
        found = [
            np.broadcast_to(own, len(places)) for own in self.evaluator.values_at([*self.zeros, *self.slopes], places)
        ]
        velocity, gradient = np.stack(found[:3], axis=1), np.stack(found[3:], axis=1).reshape(-1, 3, 3)

        # across the face along any step that lambda grows by one on: along the face the velocity doesn't change
        slope = facet_slope(piece)
        return places, velocity, np.einsum("nck,nki,i->nc", gradient, places.jacobians, slope / (slope @ slope))

    def _shear(self, places: Lattice, across: Floats) -> Floats:
        """(n, 2) its parts along the tangents."""
        return np.asarray(np.einsum("nci,nc->ni", self.piece.along(places.jacobians), across))

    def is_outer(self, rows: Ints, touched: Bools) -> Bools:
        """Nowhere true: no places are excluded."""
        return np.zeros(len(rows), bool)

    def points(self) -> Iterator[CriticalPoint]:
        """The zeros, each with its kind."""
        if not self.rows:
            return
        rows, xi, piece = np.array(self.rows), np.array(self.xi), self.piece
        inner, elements = piece.places(xi), piece.rows[rows]
        positions, jacobians = pointwise.positions_and_jacobians(piece.patch, elements, inner)
        derivatives = values_and_gradients(self._expansion, xi)[1]
        changes = np.einsum("nim,njm->nij", self._coefficients[rows], derivatives)

        # from parts along the tangents to rates of (r, s), by the metric; lambda by height
        along = piece.along(jacobians)
        metric = np.einsum("nci,ncj->nij", along, along)
        steep = np.linalg.norm(tangents.duals(jacobians) @ facet_slope(piece), axis=1)
        gradients = np.linalg.solve(metric, changes) * steep[:, None, None]
        greatest = np.abs(self._coefficients[rows]).max(axis=(1, 2))
        for number, row in enumerate(elements):
            if np.abs(changes[number]).max() <= _NEUTRAL * greatest[number]:
                continue
            point = classified(gradients[number], positions[number], int(piece.patch.element_ids[row]))
            yield _on_wall(point)


def _fastest(places: Lattice, velocity: Floats, across: Floats) -> _Fastest:
    """The maximum of a velocity (n, 3), and its growth ``across`` (n, 3).

    The first element counts if several are equal.
    """
    speed = np.nan_to_num(np.abs(velocity).max(axis=1), nan=0.0)
    ids = places.patch.element_ids[places.rows]
    first = int(np.lexsort((ids, -speed))[0])
    growth = float(np.nan_to_num(np.abs(across), nan=0.0).max())
    length = float(np.linalg.norm(velocity[first]))
    return _Fastest(float(speed[first]), int(ids[first]), tuple(map(float, places.positions[first])), length, growth)


def _on_wall(point: CriticalPoint) -> CriticalPoint:
    """The point with the words for kinds on walls."""
    rates = np.array(point.eigenvalues)
    trace = rates.sum().real
    if point.kind in ("centre", "degenerate") or abs(trace) <= _NEUTRAL * np.abs(rates).max():
        return point
    word = point.kind.split()[0].replace("spiral", "focus")
    side = "attachment" if trace > 0 else "separation"
    return CriticalPoint(f"{side} {word}", point.index, point.position, point.element, point.eigenvalues)
