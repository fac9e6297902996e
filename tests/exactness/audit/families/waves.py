"""Cuts through plane elements with a Fourier series along z: u = p + q cos(2 pi z / L) - r sin(2 pi z / L)."""

from dataclasses import replace
from functools import partial

import numpy as np

from audit.cases import Case, camera, random_polynomial
from audit.families.cuts import NORMALS, plane_roots
from audit.polynomials import exact_block
from audit.truths import Rays, Truth
from audit.validating import validate
from audit.worlds import BORDER, world
from elvis import Plane
from elvis.core.base.arrays import frozen_floats
from elvis.core.data.dataset import Block, Dataset, Field, Homogeneous
from elvis.core.mapping.geometry import geometry
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape


class Wave:
    """The field at straight points (n, 3) whose third coordinate is z."""

    def __init__(self, parts, length):
        self.parts, self.length = parts, length

    def __call__(self, points):
        angle = 2 * np.pi * points[:, 2] / self.length
        flat = points * [1.0, 1.0, 0.0]
        p, q, r = (part(flat) for part in self.parts)
        return p + q * np.cos(angle) - r * np.sin(angle)

    def greatest_derivative(self):
        return sum(part.greatest_derivative() + 7 / self.length * part.size() for part in self.parts)


def case(rng, size):
    """One cut."""
    shapes = (Shape.QUADRILATERAL,)
    own = world(rng, 2, shapes, placements=("plain",), bends=("straight", "bent"))
    length = float(rng.choice([0.5, 1.0, 2.0]))
    parts = [random_polynomial(rng, 3, 2) for _ in range(3)]
    flat = own.dataset({}, 4)
    homogeneous = Homogeneous((Basis.FOURIER,), (length,), (0, 1, 2, 3))
    blocks = []
    for block in geometry(Dataset(own.mesh)):
        planes = [exact_block(block, part, 4) for part in (parts[0], parts[0] * 0, *parts[1:])]
        expansion = replace(planes[0].expansion, homogeneous=homogeneous)
        joined = np.concatenate([plane.coefficients for plane in planes], axis=1)
        blocks.append(Block(expansion, block.element_ids, frozen_floats(joined)))
    data = replace(flat, fields=(Field("u", tuple(blocks)), *flat.fields))
    solid = replace(own, mesh=_thick(own.mesh, length))
    view = camera(rng, solid, str(rng.choice(["oblique", "perspective", "close"])))
    point = (*solid.placed(solid.bent(rng.integers(1, 64, (1, 3)) / 64))[0, :2], length * rng.integers(1, 64) / 64)
    plane = Plane(tuple(map(float, point)), tuple(map(float, NORMALS[rng.integers(len(NORMALS))])))
    scene = {"field": "u", "plane": plane, "camera": view, "size": size}
    name = f"{own.name}, period {length}, plane {plane.point} {plane.normal}, {view}"
    return Case(name, data, scene, partial(count, own, solid, plane, Wave(parts, length)), True)


def _thick(mesh, length):
    """The mesh with a vertex at the end of the period, for boxes alone."""
    vertices = np.concatenate([mesh.vertices, np.add(mesh.vertices, (0.0, 0.0, length))])
    return replace(mesh, vertices=vertices)


def count(own, solid, plane, field, case, frame):
    """The count of a cut through one period."""
    rays = Rays(own, frame.view, solid.corners())
    ends = np.array([1.0, 1.0, field.length])

    def inside(points):
        away, slack = np.minimum(points, ends - points), BORDER * max(1.0, field.length) + rays.rounding
        return (away >= -slack).all(axis=1), (away >= slack).all(axis=1)

    depth, sure, slack, free = plane_roots(rays, plane, inside)
    values = field(np.random.default_rng(0).random((4000, 3)) * ends)
    truth = Truth(rays.counted, depth, sure, slack, free, field, 1e-11 * float(np.ptp(values)))
    return validate(case, frame, truth, rays)
