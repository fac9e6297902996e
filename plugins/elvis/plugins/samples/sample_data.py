"""Sample data: a swept, tapered wing between two planes, on curved elements of order 4.

Each section is an ellipse.  The map of Joukowski, z = zeta + c²/zeta, takes the plane outside the unit circle to the
plane outside the ellipse.  The velocity belongs to the plane potential flow past the section, with lift, and the
pressure follows from Bernoulli's equation: an analytic field with the features of a wing, not a solution in space.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import Composite, Mesh
from elvis.core.mapping.connectivity import connected
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved

Complexes = NDArray[np.complex128]

#: elements around the section, away from it, and along the span
AROUND, OUTWARDS, ALONG = 20, 6, 4
#: modes of the fields, and nodes along each edge of the elements, of order 4 both
MODES = NODES = 5
#: c² of the map: sections are (1 - c²) / (1 + c²), 11 %, thick
SQUARE = 0.8
#: radius of the far field in the circle's plane
FAR = 8.0
SPAN = 3.0
#: tangent of the sweep, and taper ratio at the tip
SWEEP, TIP = 0.5, 0.5
#: angle of attack in radians, and circulation relative to 4 pi sin(angle), the value for a sharp trailing edge
ANGLE, LIFT = np.radians(4.0), 0.9


def wing() -> Dataset:
    """Velocity u, v, w and pressure p around the wing; boundaries ``wing``, ``far`` and ``symmetry``."""
    bare = Dataset(_named(curved(_straight(), _warped, NODES)))
    fields = (approximated(bare, name, _component(number), MODES) for number, name in enumerate("uvwp"))
    return replace(bare, fields=tuple(fields), metadata={"Title": "sample: a swept wing, analytic"})


def _straight() -> Mesh:
    """The mesh in the circle's plane: hexahedra whose corners lie on circles."""
    angle = 2 * np.pi * np.arange(AROUND) / AROUND
    # elements grow in proportion to their distance
    radius = FAR ** (np.arange(OUTWARDS + 1) / OUTWARDS)
    height = SPAN * np.arange(ALONG + 1) / ALONG
    z, r, a = np.meshgrid(height, radius, angle, indexing="ij")
    vertices = np.column_stack([(r * np.cos(a)).ravel(), (r * np.sin(a)).ravel(), z.ravel()])
    k, j, i = np.meshgrid(np.arange(ALONG), np.arange(OUTWARDS), np.arange(AROUND), indexing="ij")

    def row(right: int, out: int, up: int) -> Ints:
        """(n,) the vertices at one corner of all elements."""
        return np.asarray((((k + up) * (OUTWARDS + 1) + j + out) * AROUND + (i + right) % AROUND).ravel())

    corners = [(0, 0), (0, 1), (1, 1), (1, 0)]
    elements = np.stack([row(right, out, up) for up in (0, 1) for right, out in corners], axis=1)
    return connected(vertices, {Shape.HEXAHEDRON: elements})


def _warped(points: Floats) -> Floats:
    """(n, 3) places around the wing of points of the straight mesh (n, 3)."""
    zeta = points[:, 0] + 1j * points[:, 1]
    # sides of polygons become arcs: their middles are nearer to the centre by the cosine of half their angle
    step = 2 * np.pi / AROUND
    off = np.mod(np.angle(zeta), step) - 0.5 * step
    zeta = zeta * np.cos(off) / np.cos(0.5 * step)
    place = zeta + SQUARE / zeta
    part = points[:, 2] / SPAN
    scale = 1 - (1 - TIP) * part
    return np.column_stack([scale * place.real + SWEEP * points[:, 2], scale * place.imag, points[:, 2]])


def _flow(points: Floats) -> Floats:
    """(n, 4) velocity and pressure at places (n, 3) around the wing."""
    zeta = _outside(_section(points))
    turn = np.exp(-1j * ANGLE)
    circulation = 4 * np.pi * LIFT * np.sin(ANGLE)
    # complex velocity u - iv of the circle, over the derivative of the map (Milne-Thomson, Theoretical aerodynamics)
    circle = turn - np.conj(turn) / zeta**2 + 1j * circulation / (2 * np.pi * zeta)
    velocity = circle / (1 - SQUARE / zeta**2)
    pressure = 0.5 * (1 - np.abs(velocity) ** 2)
    return np.column_stack([velocity.real, -velocity.imag, np.zeros(len(points)), pressure])


def _outside(place: Complexes) -> Complexes:
    """The one of the two zeta of each place that lies outside of the other's circle."""
    root = np.sqrt(place**2 - 4 * SQUARE)
    one, other = 0.5 * (place + root), 0.5 * (place - root)
    return np.where(np.abs(one) > np.abs(other), one, other)


def _component(number: int) -> Callable[[Floats], Floats]:
    """One field of the flow, as a function of places (n, 3)."""
    return lambda points: np.asarray(_flow(points)[:, number])


def _named(mesh: Mesh) -> Mesh:
    """The mesh with its boundaries apart."""
    faces, edges = mesh.of(Shape.QUADRILATERAL), mesh.of(Shape.SEGMENT)
    places = mesh.vertices[edges.members[faces.members]].reshape(len(faces), -1, 3)
    inverse = _outside(_section(places.reshape(-1, 3))).reshape(len(faces), -1)
    radius = np.abs(inverse)
    height = places[..., 2]
    on = {
        "wing": (radius < 1 + 1e-9).all(axis=1),
        "far": (radius > FAR - 1e-9).all(axis=1),
        "symmetry": (height == 0).all(axis=1) | (height == SPAN).all(axis=1),
    }
    own = [Composite(number, (("F", faces.ids[which]),), name) for number, (name, which) in enumerate(on.items(), 1)]
    return replace(mesh, composites=(mesh.composites[0], *own))


def _section(points: Floats) -> Complexes:
    """Places (n,) in the plane of the unscaled section of places (n, 3)."""
    scale = 1 - (1 - TIP) * points[:, 2] / SPAN
    return np.asarray((points[:, 0] - SWEEP * points[:, 2] + 1j * points[:, 1]) / scale)
