"""Stretching of a flow along streamlines: finite-time Lyapunov exponents, from the variational equation.

The derivative F of a particle's position with respect to its seed satisfies dF/dt = grad v F (Shadden, Lekien and
Marsden, Physica D 212, 2005).  The equation is integrated along each step of a line by Gauss's collocation of order 12
(Hairer, Norsett and Wanner, Solving ordinary differential equations I, II.7), with grad v on the dense output.  Since
it is linear, this is one linear system.  No differences of neighbouring lines are used.
"""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, rows_by_number
from elvis.core.base.errors import ElvisError
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.names import Names
from elvis.core.quantities.tree import AXES, world_derivative
from elvis.core.streamlines.course import Course
from elvis.core.streamlines.first_roots import bernstein_at
from elvis.core.streamlines.flow_data import FlowSource, flow_data
from elvis.core.streamlines.lines.steps import Piece
from elvis.core.streamlines.velocity import Velocity, components_in

_STAGES = 6
_NODES = 0.5 * (1 + gauss(_STAGES)[0])
_WEIGHTS = 0.5 * gauss(_STAGES)[1]


def _collocation() -> Floats:
    """(6, 6) integrals from 0 to node i of the Lagrange polynomial of node j."""
    powers = np.arange(_STAGES)
    integrals = _NODES[:, None] ** (powers + 1) / (powers + 1)
    return np.asarray(integrals @ np.linalg.inv(_NODES[:, None] ** powers))


_MATRIX = _collocation()


def slope_expressions(data: FlowSource, course: Course, names: Names | None = None) -> list[Expression]:
    """The derivatives of a velocity's components, a row of the gradient after the other.

    names  names for the components, None for the names of the data

    Raises ElvisError on walls, on surfaces in space, and for Fourier directions.
    """
    own_data = flow_data(data)
    components = components_in(names or own_data.names, course.velocity)
    if course.wall is not None or len(components) != own_data.dimension:
        raise ElvisError("FTLE: expected 2D data in the plane or 3D data, without walls and Fourier directions")
    axes = range(len(components))
    return [Expression(f"{own.text}_{AXES[k]}", world_derivative(own.root, k)) for own in components for k in axes]


class Stretching:
    """Gradients (n, d, d) of places of n lines by their seeds, under way; ``time`` (n,) that lines have lasted."""

    def __init__(self, velocity: Velocity, slopes: list[Expression], count: int, sign: int) -> None:
        d = max(1, round(len(slopes) ** 0.5))
        self.velocity, self.slopes, self.sign = velocity, slopes, sign
        self.gradients = np.tile(np.eye(d), (count, 1, 1))
        self.time = np.zeros(count)

    def follow(self, piece: Piece) -> None:
        """Go along steps of some lines."""
        d, count = self.gradients.shape[1], len(piece.line)
        rates = np.stack([self._rates(piece, node) for node in _NODES], axis=1)

        # K_i = A_i (F + h sum_j a_ij K_j): of order 12 in the step
        lasts = piece.lasts[:, None, None]
        blocks = np.einsum("kiab,ij->kiajb", rates, _MATRIX).reshape(count, _STAGES * d, _STAGES * d)
        start = self.gradients[piece.line]
        known = np.einsum("kiab,kbc->kiac", rates, start).reshape(count, _STAGES * d, d)
        changes = np.linalg.solve(np.eye(_STAGES * d) - lasts * blocks, known).reshape(count, _STAGES, d, d)
        self.gradients[piece.line] = start + lasts * np.einsum("i,kiab->kab", _WEIGHTS, changes)
        self.time[piece.line] += piece.lasts

    def exponents(self) -> Floats:
        """(n,) ln of the largest stretching by the time that a line lasts; NaN if it has no duration."""
        with np.errstate(all="ignore"):
            greatest = np.linalg.norm(np.nan_to_num(self.gradients), ord=2, axis=(1, 2))
            return np.asarray(np.where(self.time > 0, np.log(greatest) / self.time, np.nan))

    def _rates(self, piece: Piece, node: float) -> Floats:
        """(k, d, d) the velocity's gradients at a part of steps."""
        d = self.gradients.shape[1]
        points = bernstein_at(piece.nets, node * piece.part)[:, :-1]
        found = np.empty((len(points), d * d))
        for number, here in rows_by_number(piece.patch):
            values = self.velocity.together(self.slopes, number, piece.row[here], points[here])
            for column, value in enumerate(values):
                found[here, column] = value
        return self.sign * found.reshape(-1, d, d)
