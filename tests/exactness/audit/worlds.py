"""Meshes whose maps have an inverse in closed form: affine elements, curved by polynomials, put anywhere at any scale.

Straight coordinates X, Y, Z are those of the affine mesh, local ones x = X + a Y^2 + e Y, y = Y, z = Z + b Y^2 + f Y.
World coordinates are shift + scale * local; all numbers are dyadic, so that all data are exact.
"""

from dataclasses import dataclass, replace

import numpy as np

from audit.polynomials import X, Y, Z, exact_block
from elvis.core.data.dataset import Dataset, Field
from elvis.core.data.mesh import Mesh
from elvis.core.mapping.connectivity import connected
from elvis.core.mapping.geometry import geometry
from elvis.core.mapping.orientation import local_vertices
from elvis.core.shapes import Shape
from elvis.core.testing import grid, mixed_plane, mixed_volume

#: borders of elements, in straight coordinates: nearer to them neighbours are as right
BORDER = 1e-9
#: unit roundings that a computed coordinate may be off by
ROUNDINGS = 16
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class World:
    """A mesh of affine elements, and where it is put.

    name   says how it was made
    mesh   in straight coordinates
    bend   (a, b) and shear (e, f) of the map
    shift, scale  (3,) of the placement
    boxes  (n, 2, 3) boxes in straight coordinates that together are the domain
    """

    name: str
    mesh: Mesh
    bend: tuple[float, float] = (0.0, 0.0)
    shear: tuple[float, float] = (0.0, 0.0)
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def dimension(self):
        return self.mesh.dimension

    @property
    def shapes(self):
        return tuple(self.mesh.elements)

    def placed(self, local):
        """World points of local ones."""
        return np.asarray(self.shift) + np.asarray(self.scale) * local

    def bent(self, straight):
        """Local points (n, 3) of straight ones."""
        (a, b), (e, f) = self.bend, self.shear
        x, y, z = np.asarray(straight).T
        return np.stack([x + a * y * y + e * y, y, z + b * y * y + f * y], axis=1)

    def straightened(self, points):
        """Straight points (n, 3) of world points, in extended precision."""
        points = np.asarray(points, np.longdouble)
        x, y, z = ((points - np.asarray(self.shift)) / np.asarray(self.scale)).T
        (a, b), (e, f) = self.bend, self.shear
        return np.stack([x - a * y * y - e * y, y, z - b * y * y - f * y], axis=1)

    def along(self, origins, ways):
        """(n, 3, 3) for each ray and straight coordinate the coefficients of 1, t and t^2, in extended precision."""
        shift, scale = (np.asarray(part, np.longdouble) for part in (self.shift, self.scale))
        start, way = (origins - shift) / scale, ways / scale
        result = np.stack([start, way, np.zeros_like(start)], axis=2)
        y, (a, b), (e, f) = result[:, 1], self.bend, self.shear
        squares = np.stack([y[:, 0] ** 2, 2 * y[:, 0] * y[:, 1], y[:, 1] ** 2], axis=1)
        result[:, 0] -= a * squares + e * y
        result[:, 2] -= b * squares + f * y
        return result

    def rounding(self, extent):
        """(3,) how far straight coordinates may be off where world coordinates up to ``extent`` are rounded."""
        rounding = ROUNDINGS * EPS * extent / np.abs(self.scale)
        (a, b), (e, f) = np.abs(self.bend), np.abs(self.shear)
        return rounding + rounding[1] * np.array([2 * a + e, 0.0, 2 * b + f])

    def dataset(self, fields, modes, local=None, map_modes=3):
        """The mesh with fields of straight coordinates, by name; without any rounding.

        modes  of the fields; of two numbers elements have the one and the other by turns
        local  three polynomials, the local coordinates, in place of the world's own
        """
        straight = Dataset(self.mesh)
        blocks = geometry(straight)
        counts = np.atleast_1d(modes).tolist()
        parts = [(_some(block, k, len(counts)), n) for block in blocks for k, n in enumerate(counts)]
        parts = [(block, n) for block, n in parts if len(block)]
        made = [Field(name, tuple(exact_block(b, p, n) for b, n in parts)) for name, p in fields.items()]
        vertices = self.placed(self.bent(self.mesh.vertices))
        mesh = replace(self.mesh, vertices=vertices)
        if self.bend == (0.0, 0.0) and local is None:
            return Dataset(mesh, tuple(made))
        (a, b), (e, f) = self.bend, self.shear
        local = local or (X + a * Y**2 + e * Y, Y, Z + b * Y**2 + f * Y)
        for axis in range(3 if self.dimension == 3 else 2):
            placed = local[axis] * self.scale[axis] + self.shift[axis]
            own = tuple(exact_block(block, placed, map_modes) for block in blocks)
            made.append(Field(f"map_{'xyz'[axis]}", own))
        names = ",".join(field.name for field in made[len(fields) :])
        return Dataset(mesh, tuple(made), metadata={"GeometryMap": names})

    def sides(self):
        """(n, 6, 4) planes of the elements by id: normal and offset, positive inside; those too many are 1."""
        count = sum(map(len, self.mesh.elements.values()))
        result = np.tile([0.0, 0.0, 0.0, 1.0], (count, 6, 1))
        for shape, entities in self.mesh.elements.items():
            sides = shape.faces if shape.dimension == 3 else [(*edge,) for edge in shape.edges]
            corners = self.mesh.vertices[local_vertices(self.mesh, shape)]
            for number, side in enumerate(sides):
                result[entities.ids, number] = _side(corners, side)
        return result

    def corners(self):
        """(8, 3) world corners of a box around the domain."""
        low, high = self.mesh.vertices.min(axis=0), self.mesh.vertices.max(axis=0)
        steps = np.linspace(low, high, 5)
        places = np.stack(np.meshgrid(*steps.T, indexing="ij"), axis=-1).reshape(-1, 3)
        world = self.placed(self.bent(places))
        box = np.stack([world.min(axis=0), world.max(axis=0)])
        return np.array([[box[k >> axis & 1, axis] for axis in range(3)] for k in range(8)])


def _some(block, first, step):
    """Every this many elements of a geometry block, from the first one on."""
    return replace(block, element_ids=block.element_ids[first::step], coefficients=block.coefficients[first::step])


def _side(corners, side):
    """(n, 4) planes through a side of elements with vertices (n, v, 3), positive towards the middle."""
    origin = corners[:, side[0]]
    along = corners[:, side[1]] - origin
    across = np.array([0.0, 0.0, 1.0]) if len(side) == 2 else corners[:, side[2]] - origin
    normal = np.cross(along, np.broadcast_to(across, along.shape))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    inner = corners.mean(axis=1) - origin
    normal *= np.sign((normal * inner).sum(axis=1, keepdims=True))
    return np.column_stack([normal, -(normal * origin).sum(axis=1)])


def margins(sides, ids, points):
    """(n,) smallest distance of straight points (n, 3) from the sides of elements ``ids`` (n,), positive inside."""
    chosen = sides[ids]
    return (np.einsum("nij,nj->ni", chosen[:, :, :3], points.astype(float)) + chosen[:, :, 3]).min(axis=1)


def doubled(mesh):
    """The mesh twice at one place, without a shared vertex: every face is coincident with one of another element."""
    count = len(mesh.vertices)
    elements = {}
    for shape in mesh.elements:
        rows = np.asarray(local_vertices(mesh, shape))
        elements[shape] = np.concatenate([rows, rows + count])
    return connected(np.concatenate([mesh.vertices, mesh.vertices]), elements, mesh.dimension)


def apart(mesh):
    """The mesh with elements that share no vertex: faces between them are coincident outer faces."""
    elements, vertices, first = {}, [], 0
    for shape in mesh.elements:
        rows = np.asarray(local_vertices(mesh, shape))
        vertices.append(mesh.vertices[rows.reshape(-1)])
        elements[shape] = first + np.arange(rows.size).reshape(rows.shape)
        first += rows.size
    return connected(np.concatenate(vertices), elements, mesh.dimension)


#: shift and scale by name
PLACEMENTS = {
    "plain": ((0.0,) * 3, (1.0,) * 3),
    "far": ((2.0**20, -(2.0**20), 2.0**20), (1.0,) * 3),
    "large": ((0.0,) * 3, (2.0**30,) * 3),
    "small": ((0.0,) * 3, (2.0**-30,) * 3),
    "sliver": ((0.0,) * 3, (1.0, 1.0, 2.0**-20)),
    "mirrored": ((0.0,) * 3, (-1.0, 1.0, 1.0)),
    "off": ((3.0, 5.0, -2.0), (0.5, 2.0, 1.0)),
}
BENDS = {"straight": (0.0, 0.0), "bent": (0.25, -0.375), "bowed": (-0.5, 0.125)}
SHEARS = {"upright": (0.0, 0.0), "sheared": (0.25, -0.5)}


def world(rng, dimension=3, shapes=None, placements=tuple(PLACEMENTS), bends=tuple(BENDS), joins=("joined",)):
    """A world at random; the flat ones have no third direction."""
    choices = shapes or Shape.of_dimension(dimension)
    shape = choices[rng.integers(len(choices))]
    cells = int(rng.choice([1, 2, 2, 4] if dimension == 2 else [1, 2, 2]))
    place, bend, shear = (str(rng.choice(some)) for some in (placements, bends, tuple(SHEARS)))
    join = str(rng.choice(joins))
    # each of two curved elements at one place is searched for every pixel that the other does not own, on the host
    bend = "straight" if join == "doubled" else bend
    mesh = {"joined": lambda mesh: mesh, "doubled": doubled, "apart": apart}[join](grid(shape, cells))
    shift, scale = PLACEMENTS[place]
    own, sheared = BENDS[bend], SHEARS[shear]
    if dimension == 2:
        own, sheared, shift, scale = (own[0], 0.0), (sheared[0], 0.0), (*shift[:2], 0.0), (*scale[:2], 1.0)
    name = f"{shape.label.lower()} {cells} {join} {bend} {shear} {place}"
    return World(name, mesh, own, sheared, shift, scale)


def mixed(rng, dimension=3):
    """All shapes in one mesh of unit cells, as they are."""
    mesh = mixed_volume(seed=int(rng.integers(99))) if dimension == 3 else mixed_plane(seed=int(rng.integers(99)))
    return World("mixed", mesh)
