"""Rays against ribbons of streamlines: a dense search along each step of a line, and bisection between signs.

The vector n across a line is solved for at 28 Chebyshev points of a step together.  The turning of its direction T
comes from the velocity's gradient, dT/dt = (1 - T T^T) (grad v) v / |v|.  With the vorticity omega, dn/dt = -(n .
dT/dt) T + 1/2 (omega .  T) T x n: no derivative of the line is used, and there are no bounds.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from elvis.core.base.arrays import Floats
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.tree import AXES, world_derivative
from elvis.core.streamlines.course import Flow
from elvis.core.streamlines.first_roots import bernstein_at
from elvis.core.streamlines.flow_data import FlowSource, flow_data
from elvis.core.streamlines.lines.steps import Piece
from elvis.core.streamlines.ribbons import at_seeds
from elvis.reference.quantities import Quantities
from elvis.reference.scenes.crossings import Crossings
from elvis.reference.scenes.tubes import near_pixels
from elvis.reference.scenes.unions import places_of
from elvis.scene import Streamlines
from elvis.scene.cameras.view import View
from elvis.scene.flow.flow import course_of
from elvis.scene.model.time_limit import check_time
from elvis.scene.record.frame import Status

#: points at which a step is solved, samples of it, halvings between samples, rays treated together
_NODES, _SAMPLES, _HALVINGS, _AT_ONCE = 28, 65, 54, 1 << 13
_POINTS = chebyshev.chebpts1(_NODES)
_TO_SERIES = np.linalg.inv(chebyshev.chebvander(_POINTS, _NODES - 1))
#: (28, 28) integrals from -1 to the points
_INTEGRALS = chebyshev.chebvander(_POINTS, _NODES) @ chebyshev.chebint(_TO_SERIES, lbnd=-1, axis=0)
_U = np.linspace(-1.0, 1.0, _SAMPLES)


@dataclass(frozen=True, eq=False)
class _Strip:
    """A step: Chebyshev series (28, 3) of its middle and (29, 3) of n; its net and part in the element of that id."""

    middle: Floats
    across: Floats
    net: Floats
    part: float
    element: int

    def at(self, u: Floats) -> tuple[Floats, Floats]:
        """(n, 3) middle and n at parameters (n,)."""
        middle, across = (np.asarray(chebyshev.chebval(u, own).T, np.float64) for own in (self.middle, self.across))
        return middle, across

    def normals(self, u: Floats, place: Floats) -> Floats:
        """(n, 3) normals of any length at parameters (n,) and places (n,) along n."""
        forth = chebyshev.chebval(u, chebyshev.chebder(self.middle)).T
        turn = chebyshev.chebval(u, chebyshev.chebder(self.across)).T
        return np.cross(forth + place[:, None] * turn, self.at(u)[1])

    def reference(self, u: Floats) -> Floats:
        """(n, 3) places of the middle in the element."""
        found = np.zeros((len(u), 3))
        nets = np.broadcast_to(self.net, (len(u), *self.net.shape))
        found[:, : self.net.shape[1]] = bernstein_at(nets, 0.5 * (u + 1.0) * self.part)
        return found


def ribbon_crossings(quantities: Quantities, shown: Streamlines, view: View) -> Crossings:
    """All places at which rays meet ribbons of streamlines."""
    assert shown.ribbon is not None
    places = places_of(quantities)
    found = []
    for strip in _strips(quantities.flow, shown):
        check_time()
        if strip.element in places:
            found.append(_met(strip, places[strip.element], view, 0.5 * shown.ribbon))
    return Crossings.concatenate(found)


def _strips(source: FlowSource, shown: Streamlines) -> Iterator[_Strip]:
    """The strips of all lines; if a direction jumps between two steps, also one that turns in place."""
    course = course_of(shown)
    data = flow_data(source)
    components = data.components(course.velocity)
    slopes = [
        Expression(f"{own.text}_{AXES[axis]}", world_derivative(own.root, axis))
        for own in components
        for axis in range(len(components))
    ]
    flow = Flow.of(data, course, slopes)
    seeds = flow.location
    inside = np.flatnonzero(seeds.patch >= 0)
    velocities = flow.velocity.motion(seeds.patch[inside], seeds.row[inside], seeds.reference[inside]).velocity
    starts = np.zeros((len(seeds), 3))
    starts[inside] = at_seeds(_units(velocities), shown.across, data.space)
    for tracer in flow.tracers():
        vectors = starts.copy()
        for piece in tracer.run():
            for k, line in enumerate(piece.line):
                strips = _step(flow, slopes, piece, k, tracer.sign, vectors[line])
                vectors[line] = chebyshev.chebval(1.0, strips[-1].across)
                yield from strips


def _step(flow: Flow, slopes: list[Expression], piece: Piece, k: int, sign: int, start: Floats) -> list[_Strip]:
    """A step's strip, from the vector (3,) where it begins; before it one that turns, where directions jump."""
    patch, row = np.full(_NODES + 1, piece.patch[k]), np.full(_NODES + 1, piece.row[k])
    u = np.concatenate([[-1.0], _POINTS])
    states = bernstein_at(np.repeat(piece.nets[k : k + 1, :, :-1], len(u), axis=0), 0.5 * (u + 1.0) * piece.part[k])
    own = flow.velocity.patches[piece.patch[k]]
    velocity = flow.velocity.motion(patch, row, states).velocity
    directions = _units(velocity)
    d = round(len(slopes) ** 0.5)
    gradient = np.zeros((len(u), 3, 3))
    values = flow.velocity.together(slopes, int(piece.patch[k]), row, states[:, : own.dimension])
    for number, value in enumerate(values):
        gradient[:, number // d, number % d] = value

    world = flow.velocity.positions(patch, row, states)
    net = piece.nets[k, :, : own.dimension]
    place = net, float(piece.part[k]), int(own.element_ids[piece.row[k]])
    begin = _turned(start, directions[0])
    found = []
    if np.linalg.norm(begin - start) > 1e-9:
        turning = np.stack([0.5 * (begin + start), 0.5 * (begin - start)])
        found.append(_Strip(world[:1], turning, net[:1], 0.0, place[2]))
    across = _solved(directions[1:], velocity[1:], gradient[1:], 0.5 * sign * float(piece.lasts[k]), begin)
    return [*found, _Strip(_TO_SERIES @ world[1:], across, *place)]


def _solved(directions: Floats, velocity: Floats, gradient: Floats, rate: float, begin: Floats) -> Floats:
    """(29, 3) the series of n, which is `begin` at -1; dt/du is `rate`."""
    speeds = np.linalg.norm(velocity, axis=1)
    changes = np.einsum("nij,nj->ni", gradient, velocity) / speeds[:, None]
    changes -= np.einsum("ni,ni->n", changes, directions)[:, None] * directions
    pairs = [(2, 1), (0, 2), (1, 0)]
    curl = np.stack([gradient[:, a, b] - gradient[:, b, a] for a, b in pairs], axis=1)
    twist = 0.5 * np.einsum("ni,ni->n", curl, directions)
    spins = -np.einsum("ni,nj->nij", directions, changes)
    spins += twist[:, None, None] * np.cross(directions[:, None], np.eye(3)[None]).transpose(0, 2, 1)
    spins *= rate
    blocks = np.einsum("iab,ij->iajb", spins, _INTEGRALS).reshape(3 * _NODES, 3 * _NODES)
    slopes = np.linalg.solve(np.eye(3 * _NODES) - blocks, (spins @ begin).ravel()).reshape(_NODES, 3)
    series = chebyshev.chebint(_TO_SERIES @ slopes, lbnd=-1, axis=0)
    series[0] += begin
    return np.asarray(series)


def _units(vectors: Floats) -> Floats:
    sizes = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(sizes > 0.0, sizes, 1.0))


def _turned(vector: Floats, direction: Floats) -> Floats:
    """A vector (3,) turned in its plane with a direction (3,) to be normal to that direction.

    If it was normal to another direction, this is the shortest turn to first order in the angle.
    """
    part = vector - (vector @ direction) * direction
    return np.asarray(part / np.linalg.norm(part))


def _met(strip: _Strip, place: tuple[int, int], view: View, half: float) -> Crossings:
    """All hits of rays with a strip, in the element at `place`."""
    middle, across = strip.at(_U)
    pixels = near_pixels(middle, view, half, 0.0)
    found = []
    for start in range(0, len(pixels), _AT_ONCE):
        pixel = pixels[start : start + _AT_ONCE]
        origins, directions = view.rays_of(pixel)
        # g is the volume between the ray, the way to the line, and n
        crossed = np.cross(across[None], directions[:, None])
        sign = np.einsum("nmi,nmi->nm", middle[None] - origins[:, None], crossed) < 0
        ray, before = np.nonzero(sign[:, :-1] != sign[:, 1:])
        low, high, is_below = _U[before], _U[before + 1], sign[ray, before]
        for _ in range(_HALVINGS):
            u = 0.5 * (low + high)
            points, vectors = strip.at(u)
            g = np.einsum("ni,ni->n", points - origins[ray], np.cross(vectors, directions[ray]))
            is_first = (g < 0) == is_below
            low, high = np.where(is_first, u, low), np.where(is_first, high, u)
        u = 0.5 * (low + high)
        points, vectors = strip.at(u)
        # o + z d = P + v n, by least squares
        pairs = np.stack([directions[ray], -vectors], axis=2)
        z, v = (np.linalg.pinv(pairs) @ (points - origins[ray])[..., None])[..., 0].T
        seen = np.flatnonzero((np.abs(v) <= half) & (z > 0))
        count = len(seen)
        status, unknown = np.full(count, Status.CERTAIN, np.uint8), np.full(count, np.nan)
        patch, row = (np.full(count, number) for number in place)
        normals = strip.normals(u[seen], v[seen])
        places = strip.reference(u[seen])
        found.append(Crossings(pixel[ray[seen]], z[seen], patch, row, places, normals, status, unknown))
    return Crossings.concatenate(found)
