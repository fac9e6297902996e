"""Motion on walls: the shear of a flow on the faces of a boundary, in the faces' own coordinates.

A fluid at rest on a wall moves, at the height h next to it, by h du/dn: along the wall shear.  Lines along that are
skin friction lines (Legendre 1956; Delery 2013, Three-dimensional separated flow topology, chapter 2).  The derivatives
are taken in the elements that have the faces; lines are followed in coordinates (r, s) of these faces, so that no point
leaves the wall.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats, frozen_ints, grid_points, rows_by_number
from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import ALONE, Ranks
from elvis.core.data.dataset import Dataset
from elvis.core.integrals.reference_cells import Piece
from elvis.core.integrals.targets import Places
from elvis.core.mapping import pointwise, tangents
from elvis.core.mapping.orientation import local_vertices
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import box_degrees
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities import tree
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.names import Names
from elvis.core.streamlines.neighbours import Sides
from elvis.core.streamlines.velocity import Motion, Velocity, velocity_expressions


def shear_expressions(dataset: Dataset, texts: Sequence[str] | None) -> list[Expression]:
    """The components of what lines on walls follow: given as texts, or the wall shear for a viscosity of one.

    Raises ElvisError if the data have no velocity, and for another number of components than three.
    """
    if texts is not None:
        return velocity_expressions(dataset, texts)
    flow = Names.of(dataset).flow
    names = [f"wall_shear_{axis}" for axis in tree.AXES]
    return [Expression(name, flow.node(name, {"mu": tree.number(1.0)})) for name in names]


def check_walls(dataset: Dataset, wall: str) -> None:
    """Raise ElvisError for data that have no walls of faces."""
    if dataset.mesh.dimension != 3:
        raise ElvisError(f"lines on the wall {wall}: expected 3D data")


def wall_pieces(dataset: Dataset, patches: Sequence[Patch], wall: str, ranks: Ranks = ALONE) -> list[Piece]:
    """The faces of a boundary as sides of elements; raises ElvisError for data that aren't 3D, and without faces.

    ranks  the ranks that have parts of the data, including this one; every rank must call this, and receives its own
           faces
    """
    check_walls(dataset, wall)
    target = Places(dataset, tuple(patches), {}, ranks=ranks).named(wall)
    rows = target.rows if target.total is None else (target.total,)
    pieces = [piece for row in rows for piece in row.pieces if isinstance(piece, Piece)]
    if not all(piece.is_side for piece in pieces):
        raise ElvisError(f"expected a wall, the name or id of a boundary, found {wall}")
    return pieces


def corners_of(dataset: Dataset, piece: Piece) -> Ints:
    """(n, corners) rows of the mesh's vertices at the corners of sides, in the order of the sides' shape."""
    shape = piece.patch.shape
    assert piece.number is not None
    entities = dataset.mesh.of(shape).rows_of(piece.patch.element_ids[piece.rows])
    return np.asarray(local_vertices(dataset.mesh, shape)[entities][:, list(shape.faces[piece.number])])


def facet_slope(piece: Piece) -> Floats:
    """(d,) the reference gradient of the height over a side, which is 0 on it and 1 at the far end of the element."""
    assert piece.number is not None
    return np.asarray(Sides.of(piece.patch.shape).normals[piece.number])


def outward(piece: Piece, jacobians: Floats) -> Floats:
    """(n, 3) unit normals of sides, out of their elements, from Jacobians (n, 3, D) of the elements there."""
    with np.errstate(all="ignore"):
        gradients = tangents.duals(jacobians) @ facet_slope(piece)
        return np.asarray(-gradients / np.linalg.norm(gradients, axis=1, keepdims=True))


class WallVelocity(Velocity):
    """The shear on a wall: as `Velocity`, with a patch for the faces of each kind instead of elements.

    pieces  the faces as sides of elements, one for each of ``patches``
    """

    is_oriented = False

    def __init__(
        self, dataset: Dataset, expressions: Sequence[Expression], others: Sequence[Expression], wall: str
    ) -> None:
        self.evaluator = Evaluator(dataset, [*expressions, *others])
        self.expressions, self.others = tuple(expressions), tuple(others)
        self.pieces = wall_pieces(dataset, self.evaluator.patches, wall)
        self.patches = tuple(_face_patch(piece) for piece in self.pieces)

    def is_straight(self, number: int) -> bool:
        """False for all faces: their maps come from elements."""
        return False

    def component_fields(self, number: int) -> None:
        """None, since fields belong to elements."""
        return

    def motion(self, patch: Ints, row: Ints, points: Floats) -> Motion:
        """The motion at reference points (n, 2) of faces: patches (n,) and rows in them (n,)."""
        found = Motion(np.zeros((len(points), 3)), np.empty((len(points), 2)), np.empty((len(points), 3, 2)))
        for number, here in rows_by_number(patch):
            piece, places = self._places(number, row[here], points[here])
            along = piece.along(places.jacobians)
            shear = np.zeros((len(here), 3))
            for axis, value in enumerate(self.evaluator.values_at(self.expressions, places)):
                shear[:, axis] = value
            with np.errstate(all="ignore"):
                reference = np.einsum("nci,nc->ni", tangents.duals(along), shear)
            found.velocity[here] = np.einsum("nci,ni->nc", along, reference)
            found.reference[here], found.jacobians[here] = reference, along
        return found

    def positions(self, patch: Ints, row: Ints, points: Floats) -> Floats:
        """(n, 3) world coordinates, by the maps of the elements."""
        found = np.empty((len(points), 3))
        for number, here in rows_by_number(patch):
            piece = self.pieces[number]
            found[here] = pointwise.positions(piece.patch, piece.rows[row[here]], piece.places(points[here]))
        return found

    def values(self, expression: Expression, patch: Ints, row: Ints, points: Floats) -> Floats:
        """(n,) values of one of the evaluator's expressions."""
        found = np.empty(len(points))
        for number, here in rows_by_number(patch):
            _, places = self._places(number, row[here], points[here])
            (value,) = self.evaluator.values_at([expression], places)
            found[here] = value
        return found

    def in_elements(self, number: int, points: Floats) -> Floats:
        """(…, 3) reference coordinates in elements of points (…, 2) on faces of a patch."""
        return self.pieces[number].places(points)

    def _places(self, number: int, row: Ints, points: Floats) -> tuple[Piece, ElementPoints]:
        """Points on faces as points of elements, with the normals of the wall, which stages beyond it also need."""
        piece = self.pieces[number]
        places = ElementPoints(piece.patch, piece.rows[row], piece.places(points))
        places.normals = outward(piece, places.jacobians)
        return piece, places


def _face_patch(piece: Piece) -> Patch:
    """Sides of elements as elements of a surface: their maps, interpolated where they are polynomials."""
    degree = max(1, *box_degrees(bernstein_space(piece.patch.geometry)))
    nodes = gauss(degree + 1)[0]
    lattice = grid_points(nodes, nodes)
    points = uncollapse(piece.shape, lattice)
    expansion = modified(piece.shape, (degree + 1, degree + 1))
    tables = values(piece.patch.geometry, piece.places(points))
    world = piece.patch.geometry_coefficients[piece.rows] @ tables.T
    coefficients = world @ np.linalg.pinv(values(expansion, points)).T
    ids = piece.patch.element_ids[piece.rows]
    return Patch(piece.shape, frozen_ints(ids), expansion, frozen_floats(coefficients), (), ())
