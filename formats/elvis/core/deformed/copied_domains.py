"""Copies of the domain of data: declared periods, mirrors that cut the domain, copies that overlap."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.bounds.bounding import quantity_range
from elvis.core.data.axis_planes import box_of
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import PERIODIC, Mesh
from elvis.core.deformed.isometries import Isometry
from elvis.core.distances.boundaries import sides_by_name
from elvis.core.mapping.geometry import geometry
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Locator
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.tree import AXES, call, coordinate, number
from elvis.core.shapes import Shape

#: part of the size of the domain by which copies may overlap, as coordinates in files are rounded
SLACK = 1e-6
#: points of the domain that are located in copies
_POINTS = 2048
#: position of points near the corners of elements, from their centres (0) to the corners (1)
_OUTWARD = 0.9
#: copies of which all pairs are compared; of more, each is compared with the data
_PAIRS = 64
#: margin in reference coordinates beyond which a point is well inside an element
_MARGIN = 1e-6


def periods(dataset: Dataset) -> dict[str, float]:
    """The periods that data declare, by the names of the axes.

    They are the lengths of Fourier directions, and the extents of the domain between sides that the mesh identifies.
    """
    found: dict[str, float] = {}
    for block in (block for field in dataset.fields for block in field.blocks):
        lengths = block.expansion.homogeneous.lengths if block.expansion.homogeneous else ()
        found |= dict(zip(AXES[3 - len(lengths) :], lengths, strict=True))
    return {**found, **_extents(dataset.mesh)}


def _extents(mesh: Mesh) -> dict[str, float]:
    """Extents of a mesh along the axes at both ends of which sides are identified."""
    if all(PERIODIC not in (composite.name, composite.label) for composite in mesh.composites):
        return {}
    ids = sides_by_name(mesh).get(PERIODIC)
    if ids is None:
        return {}
    corners = mesh.corners
    slack = SLACK * float(np.linalg.norm(corners[1] - corners[0]))
    found = {}
    sides = [mesh.vertices[own] for own in _vertices_of_sides(mesh, ids)]
    for axis, name in enumerate(AXES[: mesh.dimension]):
        ends = [bool(any(np.abs(side[:, axis] - corner[axis]).max() <= slack for side in sides)) for corner in corners]
        if all(ends):
            found[name] = float(corners[1, axis] - corners[0, axis])
    return found


def _vertices_of_sides(mesh: Mesh, ids: Ints) -> Iterator[Ints]:
    """Rows of the vertices of some sides."""
    edges = mesh.of(Shape.SEGMENT)
    shapes = Shape.of_dimension(mesh.dimension - 1)
    for shape in shapes:
        sides = mesh.of(shape)
        for row in np.flatnonzero(np.isin(sides.ids, ids)):
            members = sides.members[row]
            yield np.unique(members if shape is Shape.SEGMENT else edges.members[members])


def check_mirror(dataset: Dataset, before: Sequence[Isometry], point: Floats, normal: Floats) -> None:
    """Raise ElvisError for a plane that cuts the copies of the domain that it mirrors.

    The bounds of n · x over the elements are certified.

    before  isometries of the copies that are mirrored
    """
    n = normal / np.linalg.norm(normal)
    corners = box_of(dataset)
    slack = SLACK * float(np.linalg.norm(corners[1] - corners[0]))
    low, high = np.inf, -np.inf
    for direction, offset in {
        (tuple(own.directions_before(n) + 0.0), float(n @ (own.vector - point))) for own in before
    }:
        known = quantity_range(dataset, _height(direction, offset))
        if known is not None:
            low, high = min(low, known.lower), max(high, known.upper)
    if low < -slack and high > slack:
        where = f"{', '.join(f'{x:g}' for x in point)} with normal {', '.join(f'{x:g}' for x in normal)}"
        raise ElvisError(
            f"mirror: the plane through {where} cuts the domain, which reaches from {low:.6g} to {high:.6g} across it: "
            "expected a plane beside the domain"
        )


def _height(direction: Sequence[float], offset: float) -> Expression:
    """The distance from a plane: direction · x + offset."""
    total = number(offset)
    for axis, factor in enumerate(direction):
        if factor != 0.0:
            total = call("+", total, call("*", number(factor), coordinate(axis)))
    return Expression("distance from the mirror", total)


def check_overlaps(dataset: Dataset, isometries: Sequence[Isometry]) -> None:
    """Raise ElvisError for copies that overlap.

    Boxes that are apart prove that two copies are.  For others, points inside elements of one copy are located in the
    other: an estimate, as a smaller overlap may be missed.
    """
    relative = _relative(isometries)
    box = box_of(dataset)
    slack = SLACK * float(np.linalg.norm(box[1] - box[0]))
    near = [(own, pair) for own, pair in relative if _boxes_meet(box, own.box(box), slack)]
    if not near:
        return
    locator = Locator(patches(dataset))
    places = inner_points(dataset)
    for own, (first, second) in near:
        inside = _held(dataset, locator, own.points(places))
        if inside.any():
            x, y, z = isometries[first].points(own.points(places))[np.argmax(inside)].tolist()
            raise ElvisError(
                f"copies: copy {second} overlaps copy {first}, as near {x:.6g}, {y:.6g}, {z:.6g} (found by "
                f"{len(places)} points inside elements): expected copies that only touch"
            )


def _relative(isometries: Sequence[Isometry]) -> list[tuple[Isometry, tuple[int, int]]]:
    """Each different isometry g_i^-1 g_j of two copies once, with i and j."""
    count = len(isometries)
    pairs = combinations(range(count), 2) if count <= _PAIRS else ((0, other) for other in range(1, count))
    found: dict[bytes, tuple[Isometry, tuple[int, int]]] = {}
    for first, second in pairs:
        one, other = isometries[first], isometries[second]
        own = Isometry.of(one.matrix.T @ other.matrix, one.points_before(other.vector))
        key = np.round([*own.matrix.reshape(-1), *own.vector], 9) + 0.0
        found.setdefault(key.tobytes(), (own, (first, second)))
    return list(found.values())


def _boxes_meet(one: Floats, other: Floats, slack: float) -> bool:
    """Whether two boxes (2, 3) overlap by more than a slack, along axes in which they have an extent."""
    overlap = np.minimum(one[1], other[1]) - np.maximum(one[0], other[0])
    wide = (one[1] - one[0] > slack) | (other[1] - other[0] > slack)
    return bool((overlap[wide] > slack).all() and (overlap[~wide] >= -slack).all())


def inner_points(dataset: Dataset) -> Floats:
    """(n, 3) the centres of elements and points near their corners, some of them, evenly chosen."""
    lengths = periods(dataset)
    found = []
    for block in geometry(dataset):
        corners = block.expansion.shape.vertices
        centre = corners.mean(axis=0, keepdims=True)
        inner = np.concatenate([centre, centre + _OUTWARD * (corners - centre)])
        places = np.moveaxis(evaluate(block.expansion, block.coefficients, inner), 1, 2)
        found.append(places.reshape(-1, 3))
    points = np.concatenate(found) if found else np.empty((0, 3))
    points = points[:: max(1, -(-len(points) // _POINTS))]
    for axis in range(dataset.mesh.dimension, 3):
        if AXES[axis] in lengths:
            points[:, axis] = 0.5 * lengths[AXES[axis]]
    return points


def _held(dataset: Dataset, locator: Locator, points: Floats) -> np.ndarray:
    """(n,) whether points (n, 3) are well inside an element."""
    location = locator.locate(points)
    inside = (location.status == Status.INSIDE) & (location.margin > _MARGIN)
    # along Fourier directions the data are periodic, so locations say nothing there
    for name, length in periods(dataset).items():
        axis = AXES.index(name)
        if axis >= dataset.mesh.dimension:
            inside &= (points[:, axis] > SLACK * length) & (points[:, axis] < (1.0 - SLACK) * length)
    return np.asarray(inside)


def check_copies(dataset: Dataset, mirrors: Sequence[tuple[Floats, Floats]], isometries: Sequence[Isometry]) -> None:
    """Raise ElvisError for mirrors that cut the domain, and copies that overlap.

    mirrors     point and normal (3,) of each, in the order in which they are applied
    isometries  of all copies
    """
    before = [Isometry()]
    for point, normal in mirrors:
        check_mirror(dataset, before, point, normal)
        image = Isometry.mirror(point, normal)
        before += [image.after(own) for own in before]
    check_overlaps(dataset, isometries)
