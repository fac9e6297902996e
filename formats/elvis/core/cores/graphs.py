"""Two functions on boxes that are zero on vortex cores, combined such that cores are graphs.

The vector that vanishes on cores is normal to a known vector a.  Two of its components across a vector b therefore
determine it, provided that b is nowhere normal to a.  There are three such pairs:

- velocity x w is normal to the velocity, and to w;
- (gradient - eigenvalue) velocity is normal to the left eigenvector, also where the velocity is zero.

Two are combined so that their derivatives across one coordinate are the unit matrix at the centre of the box.  If they
stay close to it on the whole box, a core is a graph over that coordinate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.rows import Rows
from elvis.core.cores.boxes import Boxes, combined, flat
from elvis.core.cores.matrix_ranges import Eigenvalue, MatrixRange, across, eigenbases, polished
from elvis.core.cores.parallel import rotations
from elvis.core.polynomials.bernstein import line_tables
from elvis.core.polynomials.net_zeros import has_no_zero, inverses, values_of

#: maximum deviation of combined derivatives from the unit matrix, and steps of the iteration, which converges by this
#: factor
_NEAR, _STEPS = 0.5, 34
#: derivatives along the core in units of the wide box, so that no arc leaves the box by more than its width
_SLOPE = 2 / 3
#: the last step of an iteration that came to rest, and one that is short enough to end it
_REST, _SHORT = 1e-6, 1e-13
_CENTRE = np.array([0.5])


@dataclass(frozen=True, eq=False)
class Graphs(Rows):
    """Two functions on each box.

    is_known   (k,) whether their zeros are exactly the cores
    combining  (k, 2, 3) coefficients of the components of the vector that vanishes
    axis       (k,) coordinate across which their derivatives are close to the unit matrix
    nets       (k, 2, …)
    errors     (k, 2)      of their values
    slope_errors (k, 2, 3) of their derivatives
    vectors    (k, 2, 3) left and right vectors between which the gradient is close to its eigenvalue; empty if unused
    """

    is_known: Bools
    combining: Floats
    axis: Ints
    nets: Floats
    errors: Floats
    slope_errors: Floats
    vectors: Floats

    def excluded(self) -> Bools:
        """(k,) whether no core passes the boxes."""
        return self.is_known & has_no_zero(self.nets, self.errors)

    def is_graph(self) -> Bools:
        """(k,) whether cores are graphs over the last coordinate, and as little inclined as is needed."""
        slopes = [flat(_slopes(self.nets, axis)) for axis in range(3)]
        off = np.zeros(self.nets.shape[:2])
        for axis in (0, 1):
            unit = np.eye(2)[axis][None, :, None]
            off += np.abs(slopes[axis] - unit).max(axis=2) + self.slope_errors[:, :, axis]
        along = (np.abs(slopes[2]).max(axis=2) + self.slope_errors[:, :, 2]).max(axis=1)
        near = off.max(axis=1)
        return np.asarray(self.is_known & (near <= _NEAR) & (along <= _SLOPE * (1 - near)))

    def at(self, boxes: Boxes, along: float) -> tuple[Floats, Bools]:
        """(k, 3) places of boxes on the core with the last coordinate ``along``, and whether they exist.

        If `is_graph` holds, the iteration is a contraction, also when steps are cut off at the border of the box.
        """
        places = np.full((len(boxes), 3), 0.5)
        places[:, 2] = along
        step = np.zeros((len(places), 2))
        is_turned = self.vectors.shape[1] > 0
        for _ in range(_STEPS):
            zero = values_of(boxes.turned if is_turned else boxes.crossed, places)
            if is_turned:
                gradient = values_of(boxes.gradient, places).reshape(-1, 3, 3)
                start = np.einsum("ni,nij,nj->n", self.vectors[:, 0], gradient, self.vectors[:, 1])
                zero -= polished(gradient, start)[:, None] * values_of(boxes.above, places)
            step = np.einsum("nai,ni->na", self.combining, zero)
            places[:, :2] = (places[:, :2] - step).clip(0, 1)
            if np.abs(step).max(initial=0.0) < _SHORT:
                break
        return places, np.asarray(np.abs(step).max(axis=1, initial=0.0) < _REST)


def by_velocity(boxes: Boxes, axis: int | None) -> Graphs:
    """Graphs from the product of velocity and acceleration: two components across the velocity."""
    normal = values_of(boxes.above, np.full((len(boxes), 3), 0.5))
    normal, is_known = _units(normal)
    is_known &= flat(np.einsum("ni,ni...->n...", normal, boxes.above)[:, None]).min(axis=(1, 2), initial=np.inf) > 0
    return _combined(boxes.crossed, across(normal), is_known, axis, boxes.crossed_error)


def by_rotation(boxes: Boxes, axis: int | None) -> Graphs:
    """Graphs from the product of velocity and rotation: two components across the rotation."""
    ranges = MatrixRange.of_nets(boxes.gradient)
    normal, is_known = _units(rotations(ranges.middle))
    spread = [ranges.radius[:, (i + 2) % 3, (i + 1) % 3] + ranges.radius[:, (i + 1) % 3, (i + 2) % 3] for i in range(3)]
    off = np.einsum("ni,in->n", np.abs(normal), np.array(spread).reshape(3, len(boxes)))
    is_known &= off < np.einsum("ni,ni->n", normal, rotations(ranges.middle))
    return _combined(boxes.crossed, across(normal), is_known, axis, boxes.crossed_error)


def by_eigenvalue(boxes: Boxes, axis: int | None) -> Graphs:
    """Graphs from (gradient - eigenvalue) velocity: two components across the left eigenvector.

    In bases of eigenvectors, the eigenvalue equals the first entry of the gradient up to second order in the box's
    size.
    """
    bases, inverse = eigenbases(MatrixRange.of_nets(boxes.gradient).middle)
    matrices = boxes.gradient.reshape(len(boxes), 3, 3, *boxes.gradient.shape[2:])
    matrices = np.einsum("nab,nbc...,ncd->nad...", inverse, matrices, bases, optimize=True)
    gradient = matrices.reshape(boxes.gradient.shape)
    first = gradient[:, :1]
    gradient = gradient - first * np.eye(3).reshape(1, 9, 1, 1, 1)
    steps = [MatrixRange.of_nets(_slopes(gradient, k)) for k in range(3)]
    eigenvalue = Eigenvalue.of(MatrixRange.of_nets(gradient), steps)

    nets = boxes.turned - combined(np.multiply, first, boxes.above)
    sizes = np.abs(boxes.above).max(axis=(2, 3, 4), initial=0.0)
    slopes = np.empty((len(boxes), 3, 3))
    for k in range(3):
        steep = np.abs(_slopes(boxes.above, k)).max(axis=(2, 3, 4), initial=0.0)
        slopes[:, :, k] = eigenvalue.error[:, None] * steep + eigenvalue.slope_error[:, k, None] * sizes
    errors = boxes.turned_error + eigenvalue.error[:, None] * sizes
    vectors = np.stack([inverse[:, 0], bases[:, :, 0]], axis=1)
    return _combined(nets, inverse[:, 1:], eigenvalue.is_known, axis, errors, slopes, vectors)


def _combined(
    nets: Floats,
    rows: Floats,
    is_known: Bools,
    axis: int | None,
    errors: Floats,
    slope_errors: Floats | None = None,
    vectors: Floats | None = None,
) -> Graphs:
    """Two components (k, 2, 3) so combined that derivatives across an axis, by default the best, are a unit matrix."""
    count = len(nets)
    slopes = np.einsum("nai,nik->nak", rows, _central_slopes(nets))
    tangent = np.abs(np.cross(slopes[:, 0], slopes[:, 1]))
    own = tangent.argmax(axis=1) if axis is None else np.full(count, axis)
    others = np.array([[1, 2], [0, 2], [0, 1]])[own]
    square = np.take_along_axis(slopes, others[:, None, :].repeat(2, axis=1), axis=2)
    size = np.abs(slopes).max(axis=(1, 2), initial=0.0)
    is_known = is_known & (tangent[np.arange(count), own] > 1e-12 * size**2)
    square[~is_known] = np.eye(2)
    combining = np.einsum("nab,nbi->nai", inverses(square), rows)
    off = np.zeros((count, 3, 3)) if slope_errors is None else slope_errors
    return Graphs(
        np.asarray(is_known),
        combining,
        own,
        (combining @ flat(nets)).reshape(count, 2, *nets.shape[2:]),
        np.einsum("nai,ni->na", np.abs(combining), errors),
        np.einsum("nai,nik->nak", np.abs(combining), off),
        np.empty((count, 0, 3)) if vectors is None else vectors,
    )


def _slopes(nets: Floats, axis: int) -> Floats:
    """Nets of derivatives of nets (k, c, …) in one direction, of the lower degree there."""
    return np.asarray((nets.shape[2 + axis] - 1) * np.diff(nets, axis=2 + axis))


def _central_slopes(nets: Floats) -> Floats:
    """(k, c, 3) derivatives of nets (k, c, …) at the centres of their boxes."""
    return np.asarray(flat(nets) @ _central_weights(nets.shape[2:]))


@bounded_cache
def _central_weights(sizes: tuple[int, ...]) -> Floats:
    """(n, 3) by which coefficients of nets of sizes add up to derivatives at the centre."""
    values, slopes = zip(*(line_tables(size - 1, _CENTRE, 1)[:, 0] for size in sizes), strict=True)
    columns = []
    for axis in range(3):
        first, second, third = (slopes[k] if k == axis else values[k] for k in range(3))
        columns.append(np.einsum("i,j,k->ijk", first, second, third).reshape(-1))
    return frozen_floats(np.stack(columns, axis=1))


def _units(vectors: Floats) -> tuple[Floats, Bools]:
    """(n, 3) unit vectors along vectors (n, 3), and whether these have a length."""
    length = np.linalg.norm(vectors, axis=1)
    sound = length > 0
    return np.where(sound[:, None], vectors / np.where(sound, length, 1.0)[:, None], [0.0, 0.0, 1.0]), sound
