"""Faces of elements that a runtime plugin describes in NumPy: whose they are, and polynomials in place of their maps.

The stand-ins say where on the screen to look; what is seen there is decided on the plugin's own map.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.errors import ElvisError
from elvis.core.mapping.orientation import face_shape
from elvis.core.polynomials.bernstein import bernstein_values
from elvis.core.relative import error_limit, scale
from elvis.core.shapes import Shape
from elvis.plugins.faces.dataset_faces import frames
from elvis.plugins.faces.faces import FaceBlock, Faces
from elvis.plugins.faces.nets import FaceSpace, face_space, polynomial, sampled_nets
from elvis.plugins.host_evaluation import HostEvaluation
from elvis.plugins.projection.vertices import clusters, merging_tolerance

#: degrees that are tried for the maps of faces, and how far from them they may be, in parts of the faces' size
_DEGREES, _OFF = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12), 1e-10


def derived_faces(hosts: Sequence[HostEvaluation]) -> Faces:
    """The faces of all elements; those whose corners lie at the same places are one.  2D elements are faces themselves.

    ElvisError for a map that no polynomial of degree 12 comes near to.
    """
    corners = [_corners(host) for host in hosts]
    sizes = [own.shape[0] * own.shape[1] for own in corners]
    numbers = np.split(_vertices(corners), np.cumsum(sizes)[:-1])
    keys: list[Ints] = []
    blocks: list[tuple[int, Shape, list[int]]] = []
    for part, (host, places) in enumerate(zip(hosts, corners, strict=True)):
        vertices = numbers[part].reshape(places.shape[:2])
        for kind, local in _kinds(host.shape):
            around = [host.shape.faces[k] for k in local]
            key = np.sort(vertices[:, around].reshape(len(host) * len(local), -1), axis=1)
            keys.append(np.pad(key, ((0, 0), (0, 4 - key.shape[1])), constant_values=-1))
            blocks.append((part, kind, local))
    entity = np.unique(np.concatenate(keys), axis=0, return_inverse=True)[1].reshape(-1)
    owned = np.split(entity, np.cumsum([len(key) for key in keys])[:-1])
    faces = [_block(hosts[which[0]], *which, own) for which, own in zip(blocks, owned, strict=True)]
    return Faces(faces, [host.part.element_ids for host in hosts])


def _corners(host: HostEvaluation) -> Floats:
    """(n, v, 3) places of the elements' corners."""
    count = len(host.shape.vertices)
    rows = np.repeat(np.arange(len(host)), count)
    points = np.tile(host.shape.vertices, (len(host), 1))
    return host.evaluate(rows, points)[0].reshape(len(host), count, 3)


def _vertices(corners: Sequence[Floats]) -> Ints:
    """(m,) numbers of all corners, one part's after the other: those at one place have one number."""
    tolerance = min(merging_tolerance(own, np.finfo(float).eps) for own in corners)
    return clusters(np.concatenate([own.reshape(-1, 3) for own in corners]), tolerance)


def _kinds(shape: Shape) -> Iterator[tuple[Shape, list[int]]]:
    """Triangles, then quadrilaterals among a shape's faces, by their numbers."""
    for kind in (Shape.TRIANGLE, Shape.QUADRILATERAL):
        local = [k for k, face in enumerate(shape.faces) if face_shape(face) is kind]
        if local:
            yield kind, local


def _block(host: HostEvaluation, part: int, kind: Shape, faces: list[int], entity: Ints) -> FaceBlock:
    """The faces of one kind of a part's elements; their maps are those of the least degree that is near enough."""
    rows, local = (some.reshape(-1) for some in np.indices((len(host), len(faces))))
    places = frames(host.shape)[faces]

    def positions(elements: Ints, points: Floats) -> Floats:
        every = np.tile(points[:, : host.shape.dimension], (len(elements), 1))
        return host.evaluate(np.repeat(elements, len(points)), every)[0].reshape(len(elements), len(points), 3)

    for degree in _DEGREES:
        space = face_space(kind, degree)
        nets = sampled_nets(space, rows, local, places, polynomial(positions))
        off = _off(space, nets(np.arange(len(rows)))[..., :3], rows, local, places, positions)
        if off <= _OFF:
            break
    else:
        wanted = f"faces near to polynomials of degree {degree}, or a plugin that gives its faces itself"
        raise ElvisError(f"{host.part.type}: expected {wanted}, found some off by {off:.2g} of their size")
    moved = 0.5 * places + np.array([0.5, 0.0, 0.0])[:, None] if host.part.unit else places
    solid = "face" if host.shape.dimension == 2 else host.shape.label.lower()
    return FaceBlock(part, solid, space, rows, local, entity, moved, nets)


def _off(
    space: FaceSpace, nets: Floats, rows: Ints, local: Ints, places: Floats, positions: Callable[[Ints, Floats], Floats]
) -> float:
    """How far stand-ins are from the maps at points that they weren't made of, in parts of the greatest face.

    Nothing is off where rounding of the coordinates explains it.
    """
    points = face_space(space.shape, space.degree + 1).points
    found, worst = bernstein_values(space.space, points) @ nets, 0.0
    for side in np.unique(local):
        here = np.flatnonzero(local == side)
        truth = positions(rows[here], places[side, 0] + points @ places[side, 1:])
        worst = max(worst, float(np.abs(truth - found[here]).max(initial=0.0)))
    size, magnitude = float(np.ptp(nets, axis=1).max(initial=0.0)), float(np.abs(nets).max(initial=0.0))
    return 0.0 if worst <= error_limit(0.0, size, magnitude) else worst / scale(size, magnitude)
