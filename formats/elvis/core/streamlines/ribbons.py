"""Ribbons: strips about streamlines that turn with the flow.

A strip is {P(u) + v n(u), |v| <= width / 2} with a unit vector n across the line, transported by the fluid.  With the
direction T = P'/|P'| of the line, it follows

    dn/dt = (T x dT/dt) x n + 1/2 (omega . T) T x n.

The first term bends it with the line without rotation about T (Bishop, There is more than one way to frame a curve,
Amer.  Math.  Monthly 82, 1975); the second turns it at half the vorticity's component along the line, as a small rigid
body in the fluid turns about T (Hultquist, Constructing stream surfaces in steady 3D vector fields, 1992; Ueng,
Sikorski and Ma, Efficient streamline, streamribbon, and streamtube constructions, IEEE TVCG 2, 1996).

The equation is linear.  On each piece of a line Gauss's collocation of order 14 solves it, whose own polynomial, of
degree 7, is n(u); it keeps lengths and angles.  The polynomial's residual in the equation bounds its distance from the
solution, since solutions do not grow; pieces are bisected until it is small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.tree import AXES, world_derivative
from elvis.core.streamlines.flow_data import FlowData, FlowSource, flow_data
from elvis.core.streamlines.lines.pieces import Pieces, halves
from elvis.core.streamlines.velocity import Velocity

#: maximum deviation of the vector across from the solution, and maximum number of bisections of a piece
DEVIATION, _HALVINGS = 1e-10, 8
#: length of a piece, relative to its coordinates, below which it has no direction
_POINT = 1e-10
#: change of the line's direction at a border that counts as zero
_JUMP = 1e-11
_STAGES = 7
_NODES, _WEIGHTS = gauss(_STAGES)
#: places of the largest residual of the equation, whose zeros are the nodes
_ENDS = np.array([-1.0, 1.0])


def _collocation() -> tuple[Floats, Floats]:
    """(7, 7) from values at the nodes to coefficients of powers, and (7, 7) to integrals from -1 to the nodes."""
    coefficients = np.linalg.inv(np.vander(_NODES, increasing=True))
    powers = np.arange(1, _STAGES + 1)
    integrals = (_NODES[:, None] ** powers - (-1.0) ** powers) / powers
    return coefficients, integrals @ coefficients


_COEFFICIENTS, _MATRIX = _collocation()


@dataclass(frozen=True, eq=False)
class Ribbons:
    """Strips along pieces of lines.

    pieces     their middle; a piece that only turns, where the velocity jumps, is one point
    across     (n, 8, 3) coefficients of powers of the unit vector across
    deviation  (n,) the vector is within this of the solution on its piece
    """

    pieces: Pieces
    across: Floats
    deviation: Floats

    def __len__(self) -> int:
        return len(self.pieces)


def check_space(source: FlowSource) -> None:
    """Raise ElvisError for surfaces in space, whose lines have no ribbons."""
    data = flow_data(source)
    if data.dimension != data.space:
        raise ElvisError("ribbons: expected 2D data in the plane or 3D data, found surfaces in space")


def ribbons(
    data: FlowSource,
    pieces: Pieces,
    velocity: Sequence[str] | None = None,
    across: Sequence[float] | None = None,
) -> Ribbons:
    """Strips along lines that follow a velocity, with its components as texts (None: the usual names in the data).

    across  (3,) direction of their width at the start of lines, projected across the line; None: the axis least aligned
            with the lines there

    Raises ElvisError for surfaces in space, and if the velocity has no derivatives.
    """
    check_space(data)
    data = flow_data(data)
    twist = _Twist(data, velocity)
    pieces = _with_length(pieces.along_lines())
    done, solved, deviations = [], [], []
    for halving in range(_HALVINGS + 1):
        if not len(pieces):
            break
        solution, left = _solved(pieces, twist)
        is_done = (left <= DEVIATION) | (halving == _HALVINGS)
        done.append(pieces.part(np.flatnonzero(is_done)))
        solved.append(solution[is_done])
        deviations.append(left[is_done])
        pieces = halves(pieces.part(np.flatnonzero(~is_done)))
    joined = Pieces.joined(done)
    order = np.lexsort([np.abs(joined.time[:, 0]), joined.line])
    none = np.empty((0, 8, 3, 3))
    solution = np.concatenate([none, *solved])[order]
    return _chained(joined.part(order), solution, np.concatenate([[], *deviations])[order], across, data.space)


def _with_length(pieces: Pieces) -> Pieces:
    """The pieces longer than rounding: a line that starts on a side may have a shorter one, of any direction."""
    length = np.abs(pieces.points[:, 1:]).sum(axis=(1, 2))
    largest = np.abs(pieces.points[:, 0]).max(axis=1, initial=0.0)
    return pieces.part(np.flatnonzero(length > _POINT * largest))


class _Twist:
    """Rate of rotation of strips about their lines: half the vorticity along these, zero in the plane."""

    def __init__(self, data: FlowData, velocity: Sequence[str] | None) -> None:
        components = data.components(velocity)
        self.velocity: Velocity | None = None
        if len(components) == len(AXES):
            pairs = [(2, 1), (1, 2), (0, 2), (2, 0), (1, 0), (0, 1)]
            expressions = [
                Expression(f"{components[k].text}_{AXES[axis]}", world_derivative(components[k].root, axis))
                for k, axis in pairs
            ]
            self.velocity = data.velocity(components, expressions)

    def rates(self, element: Ints, reference: Floats, direction: Floats) -> Floats:
        """(n,) in time, at places (n, 3) of elements (n,), about unit vectors (n, 3).

        Raises ElvisError if one is undefined.
        """
        if self.velocity is None:
            return np.zeros(len(element))
        slopes = [self.velocity.at(own, element, reference) for own in self.velocity.others]
        vorticity = np.stack([slopes[0] - slopes[1], slopes[2] - slopes[3], slopes[4] - slopes[5]], axis=1)
        found = 0.5 * np.einsum("ni,ni->n", vorticity, direction)
        unknown = np.flatnonzero(~np.isfinite(found))
        if len(unknown):
            raise ElvisError(
                f"ribbons: expected a velocity with derivatives, found none in element {element[unknown[0]]}, at its "
                f"coordinates {', '.join(f'{x:.6g}' for x in reference[unknown[0]])}"
            )
        return np.asarray(found)


def _spins(pieces: Pieces, twist: _Twist, u: Floats) -> Floats:
    """(n, m, 3, 3) matrices A of dn/du = A n on pieces at parameters (m,)."""
    count = len(pieces)
    powers = np.vander(u, 8, increasing=True)
    steps = np.arange(1, 8)
    speed = np.einsum("mp,npd->nmd", powers[:, :-1], steps[:, None] * pieces.points[:, 1:])
    bend = np.einsum("mp,npd->nmd", powers[:, :-2], (steps[1:] * steps[:-1])[:, None] * pieces.points[:, 2:])
    size = np.linalg.norm(speed, axis=2, keepdims=True)
    direction = speed / size
    places = np.einsum("mp,npd->nmd", powers, pieces.reference).reshape(-1, 3)
    rates = twist.rates(np.repeat(pieces.element, len(u)), places, direction.reshape(-1, 3)).reshape(count, -1)

    # dt/du is the same all along a piece, and negative against the stream
    turn = rates * (0.5 * (pieces.time[:, 1] - pieces.time[:, 0]))[:, None]
    axis = np.cross(direction, bend) / size + turn[..., None] * direction
    x, y, z = np.moveaxis(axis, 2, 0)
    none = np.zeros_like(x)
    rows = [[none, -z, y], [z, none, -x], [-y, x, none]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _solved(pieces: Pieces, twist: _Twist) -> tuple[Floats, Floats]:
    """Solutions from the unit matrix on pieces, (n, 8, 3, 3) coefficients of powers, and how far they may be off."""
    count = len(pieces)
    spins = _spins(pieces, twist, np.concatenate([_NODES, _ENDS]))
    at_nodes, at_ends = spins[:, :_STAGES], spins[:, _STAGES:]
    blocks = np.einsum("niab,ij->niajb", at_nodes, _MATRIX).reshape(count, 3 * _STAGES, -1)
    known = at_nodes.reshape(count, 3 * _STAGES, 3)
    slopes = np.linalg.solve(np.eye(3 * _STAGES) - blocks, known).reshape(count, _STAGES, 3, 3)
    rates = np.einsum("pi,niab->npab", _COEFFICIENTS, slopes)
    solution = np.empty((count, 8, 3, 3))
    solution[:, 1:] = rates / np.arange(1, 8)[:, None, None]
    start = np.einsum("p,npab->nab", (-1.0) ** np.arange(1, 8), solution[:, 1:])
    solution[:, 0] = np.eye(3) - start

    powers = np.vander(_ENDS, 8, increasing=True)
    left = np.einsum("mp,npab->nmab", powers[:, :-1], rates)
    left -= at_ends @ np.einsum("mp,npab->nmab", powers, solution)
    greatest = np.linalg.norm(left, axis=(2, 3)).max(axis=1)
    return solution, greatest * _HELD


def _left_over() -> float:
    """The integral of |P_7|; the residual of the equation is a multiple of P_7 to leading order."""
    x, w = gauss(64)
    return float(w @ np.abs(legendre.legval(x, np.eye(_STAGES + 1)[_STAGES])))


_HELD = _left_over()


def _chained(
    pieces: Pieces, solution: Floats, deviation: Floats, across: Sequence[float] | None, space: int
) -> Ribbons:
    """Strips from solutions on the pieces of lines, one after the other; where a direction jumps, the strip turns."""
    first, last = _directions(pieces)
    starts = np.flatnonzero(np.diff(pieces.line, prepend=-1))
    position = np.arange(len(pieces)) - np.repeat(starts, np.diff([*starts, len(pieces)]))
    begins, ends = np.empty((2, len(pieces), 3))
    begins[starts] = at_seeds(first[starts], across, space)
    final = solution.sum(axis=1)
    for number in range(int(position.max(initial=-1)) + 1):
        here = np.flatnonzero(position == number)
        if number:
            begins[here] = _turned(ends[here - 1], last[here - 1], first[here])
        ends[here] = np.einsum("nab,nb->na", final[here], begins[here])
    vectors = np.einsum("npab,nb->npa", solution, begins)
    jumps = np.flatnonzero((position > 0) & (np.linalg.norm(begins - np.roll(ends, 1, axis=0), axis=1) > _JUMP))
    if not len(jumps):
        return Ribbons(pieces, vectors, deviation)

    # the strip turns in one place, from the end of one piece to the beginning of the next
    fans = _standing(pieces.part(jumps))
    fan = np.zeros((len(jumps), 8, 3))
    fan[:, 0], fan[:, 1] = 0.5 * (begins[jumps] + ends[jumps - 1]), 0.5 * (begins[jumps] - ends[jumps - 1])
    every = Pieces.joined([pieces, fans])
    return Ribbons(every, np.concatenate([vectors, fan]), np.concatenate([deviation, np.zeros(len(jumps))]))


def _directions(pieces: Pieces) -> tuple[Floats, Floats]:
    """(n, 3) unit tangents where pieces begin, and where they end."""
    steps = np.arange(1, 8)[:, None] * pieces.points[:, 1:]
    found = []
    for u in _ENDS:
        speed = np.einsum("p,npd->nd", u ** np.arange(7), steps)
        found.append(speed / np.linalg.norm(speed, axis=1, keepdims=True))
    return found[0], found[1]


def at_seeds(directions: Floats, across: Sequence[float] | None, space: int) -> Floats:
    """(n, 3) unit vectors across directions (n, 3): parts of one vector, of an axis where that has none across."""
    axes = np.eye(3)[np.argsort((directions[:, :space] ** 2).sum(axis=0))]
    asked = axes if across is None else np.concatenate([[np.asarray(across, np.float64)], axes])
    found = np.zeros_like(directions)
    for vector in asked[::-1]:
        own = vector / np.linalg.norm(vector)
        part = own - (directions @ own)[:, None] * directions
        size = np.linalg.norm(part, axis=1)
        good = size > 1e-6
        found[good] = part[good] / size[good, None]
    return found


def _turned(vectors: Floats, before: Floats, after: Floats) -> Floats:
    """Vectors (n, 3) across directions ``before``, turned the shortest way to be across ``after``."""
    both = before + after
    part = np.einsum("ni,ni->n", vectors, after) / np.maximum(1.0 + np.einsum("ni,ni->n", before, after), 1e-300)
    found = vectors - part[:, None] * both
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def _standing(pieces: Pieces) -> Pieces:
    """The first points of pieces, as pieces."""
    signs = (-1.0) ** np.arange(8)
    points, reference, length = np.zeros((3, len(pieces), 8, 3))
    points[:, 0] = np.einsum("p,npd->nd", signs, pieces.points)
    reference[:, 0] = np.einsum("p,npd->nd", signs, pieces.reference)
    length[:, 0, 0] = pieces.length @ signs
    times = np.repeat(pieces.time[:, :1], 2, axis=1)
    return Pieces(points, reference, pieces.element, pieces.deviation, pieces.line, times, length[..., 0])
