"""Meshes of a cube or square of elements of every type of CGNS, for files that are written in tests."""

import cgns_writing as writing
import numpy as np

from elvis.converters.cgns.elements import _TYPES, element_type, nodes_of_type
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape
from elvis.plugins.projection.naming import local_sides

SLOPE = 0.3
LINEAR = {shape: number for number, (_, shape, order, _) in _TYPES.items() if order == 1}
SIDES = ["imin", "imax", "jmin", "jmax", "kmin", "kmax"]


def type_of(shape, order, like):
    """The number of the type of a side of elements of a type."""
    where = _TYPES[like][3]
    if shape is Shape.SEGMENT or (shape is Shape.TRIANGLE and where == "faces"):
        where = "complete"
    found = [n for n, (_, own, degree, kind) in _TYPES.items() if own is shape and degree == order and kind == where]
    # nodes on edges alone are all nodes of a triangle of order 2
    return (found or [n for n, (_, own, degree, _) in _TYPES.items() if own is shape and degree == order])[-1]


def placed(number, corners, by_notes=False):
    """(k, d) the nodes of an element with given corners."""
    shape = _TYPES[number][1]
    return element_type(LINEAR[shape]).functions.at(nodes_of_type(number, by_notes)) @ np.asarray(corners, float)


class Block:
    """Two unit boxes side by side, filled with elements of a type, as vertices, elements and elements on each side."""

    def __init__(self, number, by_notes=False):
        shape = _TYPES[number][1]
        self.number, self.dimension = number, shape.dimension
        cells = (writing.CUBE if self.dimension == 3 else writing.SQUARE)[shape.label.lower()]
        shifts = [np.eye(self.dimension)[0] * i for i in range(2)]
        corners = [
            (np.array(cell, float) + shift) * [0.5, 1, 1][: self.dimension] for shift in shifts for cell in cells
        ]
        places = np.array([placed(number, own, by_notes) for own in corners])
        flat = places.reshape(-1, self.dimension)
        unique, first, which = np.unique(flat.round(9) + 0.0, axis=0, return_index=True, return_inverse=True)
        self.straight, self.table = flat[first], which.reshape(places.shape[:2])
        self.sides = {name: [] for name in SIDES[: 2 * self.dimension]}
        row = {tuple(place): i for i, place in enumerate(unique)}
        ours = element_type(number).corners
        order = _TYPES[number][2]
        for own in () if by_notes else corners:
            for side in local_sides(shape):
                ends = own[ours[list(side)]]
                flat = {2: Shape.SEGMENT, 3: Shape.TRIANGLE, 4: Shape.QUADRILATERAL}[len(side)]
                for name in self.sides:
                    axis, end = "ijk".index(name[0]), float(name.endswith("max"))
                    if (ends[:, axis] == end).all():
                        kind = type_of(flat, order, number)
                        nodes = placed(kind, ends).round(9) + 0.0
                        self.sides[name].append((kind, [row[tuple(place)] for place in nodes]))

    @property
    def degree(self):
        """Of the map: all that the functions contain for certain."""
        return _TYPES[self.number][2] if element_type(self.number).is_standard else min(2, _TYPES[self.number][2])

    @property
    def points(self):
        """Sheared by a power of the first coordinate, which keeps volumes."""
        moved = self.straight.copy()
        moved[:, 1] += SLOPE * moved[:, 0] ** self.degree
        return moved

    def area(self, name):
        """Only the sides across the second direction are longer than straight ones."""
        if name[0] != "j":
            return 1.0
        points, weights = gauss(60)
        slope = SLOPE * self.degree * ((points + 1) / 2) ** (self.degree - 1)
        return float((weights / 2) @ np.sqrt(1 + slope**2))
