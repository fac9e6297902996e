"""Volume elements from their faces: the last step of the geometry mapping (format notes 2.3, 2.4).

The face modes of an element are copied to its volume modes; volume-interior modes are zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import Expansion
from elvis.core.mapping.orientation import face_shape, face_turns, first_face_row, orientation_matrix, transposed
from elvis.core.mapping.skeleton import Skeleton
from elvis.core.polynomials.expansion import mode_indices
from elvis.core.shapes import Shape

#: the volume mode of face mode (p, q), by local face
_PLACES: Mapping[Shape, tuple[str, ...]] = {
    Shape.TETRAHEDRON: ("pq0", "p0q", "1pq", "0pq"),
    Shape.PYRAMID: ("pq0", "p0q", "1pq", "p1q", "0pq"),
    Shape.PRISM: ("pq0", "p0q", "1pq", "p1q", "0pq"),
    Shape.HEXAHEDRON: ("pq0", "p0q", "1pq", "p1q", "0pq", "pq1"),
}

#: directions along which a face at +1 folds onto the collapsed vertex or edge
_FOLDING = {Shape.TETRAHEDRON: (0,), Shape.PYRAMID: (0, 1), Shape.PRISM: (0,), Shape.HEXAHEDRON: ()}

#: directions that take one number of modes, because they share a collapsed coordinate
_TIED = {Shape.TETRAHEDRON: [0, 1, 2], Shape.PYRAMID: [0, 1, 2], Shape.PRISM: [0, 2], Shape.HEXAHEDRON: []}


def volume_modes(shape: Shape, face: int, p: Ints, q: Ints) -> Ints:
    """(3, n) volume mode of the modes (p, q) of a local face, seen in the element's own frame."""
    place = _PLACES[shape][face]
    indices = {"p": p, "q": q, "0": np.zeros_like(p), "1": np.ones_like(p)}
    modes = np.stack([indices[letter] for letter in place])
    fixed = place.find("1")
    if fixed not in _FOLDING[shape]:
        return modes

    # the edge in the collapsed direction: its top vertex is shared, its other modes move one down
    column = np.ones_like(p, bool) if shape is Shape.PRISM else p == 0
    modes[fixed] = np.where(column & (q == 1), 0, 1)
    modes[2] = np.where(column & (q > 1), q - 1, q)
    if shape is Shape.TETRAHEDRON:
        modes[0] = np.where(p == 1, 0, modes[0])
        modes[1] = np.where(p > 1, p - 1, p)
    return modes


def solid_orders(skeleton: Skeleton, shape: Shape, vertices: Ints) -> Ints:
    """(n, 3) numbers of modes that the faces of each element need; ``vertices`` as from `local_vertices`."""
    orders = np.full((len(vertices), 3), 2)
    face_orders = {kind: skeleton.face_orders(kind) for kind in skeleton.faces}
    for number, (kind, faces, turns) in enumerate(_faces(skeleton, shape, np.arange(len(vertices)), vertices)):
        needed = face_orders[kind][faces]
        if kind is Shape.QUADRILATERAL:
            is_transposed = transposed(turns)[:, None]
            needed = np.where(is_transposed, needed[:, ::-1], needed)
        axes = [_PLACES[shape][number].index(letter) for letter in "pq"]
        orders[:, axes] = np.maximum(orders[:, axes], needed)
    tied = _TIED[shape]
    orders[:, tied] = orders[:, tied].max(axis=1, keepdims=True, initial=2)
    return orders


def solid_modes(skeleton: Skeleton, expansion: Expansion, rows: Ints, vertices: Ints) -> Floats:
    """(n, 3, m) geometry coefficients of the elements ``rows`` (n,) with local ``vertices`` (n, n_vertices)."""
    # a table from mode indices to the number of the mode, -1 if none
    modes = max(expansion.modes)
    indices = mode_indices(expansion)
    numbers = np.full((modes,) * 3, -1)
    numbers[tuple(indices.T)] = np.arange(len(indices))

    # modes first: each is one stretch of memory for many elements
    shape = expansion.shape
    result = np.zeros((len(indices), len(rows), 3))
    p, q = np.divmod(np.arange(modes * modes), modes)
    for number, (kind, faces, turns) in enumerate(_faces(skeleton, shape, rows, vertices)):
        own = skeleton.face_modes(kind, faces, modes)
        targets = numbers[tuple(volume_modes(shape, number, p, q))]
        is_mode = (kind is Shape.QUADRILATERAL) | (p + q < modes)
        valid = np.flatnonzero((targets >= 0) & is_mode)

        # modes as the element sees them, for every way in which the face may be turned
        for turn in np.flatnonzero(np.bincount(turns)).tolist():
            here = np.flatnonzero(turns == turn)
            is_all = len(here) == len(turns)
            index, sign = orientation_matrix(len(skeleton.faces[kind][0]), turn, modes)
            for mode in valid:
                seen = own[index[mode]] if is_all else own[index[mode]][here]
                result[targets[mode], slice(None) if is_all else here] = seen * sign[mode]
    return np.ascontiguousarray(result.transpose(1, 2, 0))


def _faces(skeleton: Skeleton, shape: Shape, rows: Ints, vertices: Ints) -> Iterator[tuple[Shape, Ints, Ints]]:
    """For each local face: its shape, the rows of the elements' faces among that shape, how each is turned."""
    members = skeleton.mesh.of(shape).members[rows]
    for local, faces in zip(shape.faces, members.T, strict=True):
        kind = face_shape(local)
        own = faces - first_face_row(skeleton.mesh, kind)
        turns = face_turns(vertices[:, list(local)], skeleton.faces[kind][own])
        yield kind, own, turns
