"""Faces of elements that a runtime plugin describes in NumPy: their owners, and polynomials that replace their maps.

The polynomials give the positions on the screen; the plugin's own map decides what is visible there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from elvis.core.base.arrays import Floats, Ints, rows_by_number
from elvis.core.base.errors import ElvisError
from elvis.core.base.relative import error_limit, scale
from elvis.core.polynomials.bernstein import bernstein_values
from elvis.core.shapes import Shape
from elvis.plugins.faces.dataset_faces import faces_by_shape, frames
from elvis.plugins.faces.faces import FaceBlock, Faces
from elvis.plugins.faces.nets import FaceSpace, face_space, polynomial, sampled_nets
from elvis.plugins.projection.vertices import clusters, merging_tolerance
from elvis.plugins.runtime.host.evaluation import HostEvaluation

#: degrees that are tried for the maps of faces
_DEGREES = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12)
#: tolerance for polynomials against the maps, relative to the faces' size
_DEVIATION = 1e-10


def derived_faces(hosts: Sequence[HostEvaluation]) -> Faces:
    """The faces of all elements; those whose corners lie at the same places are one.  2D elements are faces themselves.

    ElvisError for a map that no polynomial of degree 12 comes near to.
    """
    vertices = vertex_numbers(hosts)

    # the vertices of each face say which one it is
    keys: list[Ints] = []
    blocks: list[tuple[int, Shape, list[int]]] = []
    for part, host in enumerate(hosts):
        for kind, local in faces_by_shape(host.shape):
            around = [host.shape.faces[k] for k in local]
            key = np.sort(vertices[part][:, around].reshape(len(host) * len(local), -1), axis=1)
            missing = 4 - key.shape[1]
            keys.append(np.pad(key, ((0, 0), (0, missing)), constant_values=-1))
            blocks.append((part, kind, local))
    _, which = np.unique(np.concatenate(keys), axis=0, return_inverse=True)
    ends = np.cumsum([len(key) for key in keys])[:-1]
    entities = np.split(which.reshape(-1), ends)

    faces = []
    for (part, kind, local), entity in zip(blocks, entities, strict=True):
        faces.append(_block(hosts[part], part, kind, local, entity))
    return Faces(faces, [host.part.element_ids for host in hosts])


def vertex_numbers(hosts: Sequence[HostEvaluation]) -> list[Ints]:
    """(n, v) vertex numbers for the corners of the elements of each part: those at one place are one vertex."""
    corners = [host.positions(np.arange(len(host)), host.shape.vertices) for host in hosts]
    tolerance = min(merging_tolerance([own], np.finfo(float).eps) for own in corners)
    numbers = clusters(np.concatenate([own.reshape(-1, 3) for own in corners]), tolerance)
    ends = np.cumsum([own.shape[0] * own.shape[1] for own in corners])[:-1]
    split = np.split(numbers, ends)
    return [part.reshape(own.shape[:2]) for part, own in zip(split, corners, strict=True)]


def _block(host: HostEvaluation, part: int, kind: Shape, faces: list[int], entity: Ints) -> FaceBlock:
    """The faces of one kind of a part's elements; their maps have the lowest degree that is accurate enough."""
    element, local = np.indices((len(host), len(faces))).reshape(2, -1)
    places = frames(host.shape)[faces]

    def positions(elements: Ints, points: Floats) -> Floats:
        return host.positions(elements, points[:, : host.shape.dimension])

    for degree in _DEGREES:
        space = face_space(kind, degree)
        nets = sampled_nets(space, element, local, places, polynomial(positions))
        every_net = nets(np.arange(len(element)))[..., :3]
        deviation = _deviation(space, every_net, element, local, places, positions)
        if deviation <= _DEVIATION:
            break
    else:
        wanted = f"faces near to polynomials of degree {degree}, or a plugin that gives its faces itself"
        raise ElvisError(f"{host.part.type}: expected {wanted}, found some off by {deviation:.2g} of their size")
    solid = "face" if host.shape.dimension == 2 else host.shape.label.lower()
    own_places = frames(host.shape, host.part.unit)[faces]
    return FaceBlock(part, solid, space, element, local, entity, own_places, nets)


def _deviation(
    space: FaceSpace, nets: Floats, rows: Ints, local: Ints, places: Floats, positions: Callable[[Ints, Floats], Floats]
) -> float:
    """Deviation of polynomials from the maps at other points, relative to the largest face.

    It is zero if rounding of the coordinates explains it.
    """
    points = face_space(space.shape, space.degree + 1).points
    found = bernstein_values(space.space, points) @ nets
    worst = 0.0
    for side, here in rows_by_number(local):
        origin = places[side, 0]
        axes = places[side, 1:]
        truth = positions(rows[here], origin + points @ axes)
        worst = max(worst, float(np.abs(truth - found[here]).max(initial=0.0)))
    size = float(np.ptp(nets, axis=1).max(initial=0.0))
    magnitude = float(np.abs(nets).max(initial=0.0))
    if worst <= error_limit(0.0, size, magnitude):
        return 0.0
    return worst / scale(size, magnitude)
