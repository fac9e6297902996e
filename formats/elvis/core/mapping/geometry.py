"""The geometry mapping of a dataset: which polynomials carry each element into the world (format notes 2.4).

The map of an element is an expansion of its three coordinates, put together from its vertices, edges and faces; or it
is given as fields of the dataset, named by the metadata key ``GeometryMap``.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats, frozen_ints, frozen_view, narrow_ints
from elvis.core.base.errors import FormatError
from elvis.core.data.dataset import Dataset, Expansion
from elvis.core.data.mesh import Mesh
from elvis.core.mapping.orientation import chunks, local_vertices
from elvis.core.mapping.skeleton import Skeleton
from elvis.core.mapping.solids import solid_modes, solid_orders
from elvis.core.polynomials.expansion import mode_count, mode_indices
from elvis.core.polynomials.grouping import Group, grouped
from elvis.core.polynomials.interpolation import modified
from elvis.core.shapes import Shape

T = TypeVar("T")
#: the mapping of elements of one expansion, whose ``take`` gives the coefficients of some of them
Part: TypeAlias = "GeometryBlock | Assembly | Columns"
#: elements put together at once, so that intermediate arrays stay small
_CHUNK = 1 << 13

#: derived data of meshes that several datasets share, such as the steps of a series, by the key of the request
_SHARED: WeakKeyDictionary[Mesh, dict[Hashable, Any]] = WeakKeyDictionary()
#: maximum number of derived results per mesh; the most recently used ones stay
_MOST_KEPT = 32
#: the key of what follows from a mesh and from those fields that gave its map last
_MAPPED = "mapped"


@dataclass(frozen=True, eq=False)
class Corners:
    """The vertices of straight elements, which their maps share.

    vertices  (v, 3)  world coordinates of all vertices of the mesh
    rows      (n, m) rows of an element's vertices, in the local order of its shape
    modes     the local vertex that each mode is
    """

    vertices: Floats
    rows: Ints
    modes: tuple[int, ...]

    def take(self, which: Ints) -> Corners:
        """The corners of some of the elements."""
        return Corners(self.vertices, frozen_view(self.rows[which]), self.modes)


@dataclass(frozen=True, eq=False)
class GeometryBlock:
    """The mapping of elements of one expansion.

    element_ids   (n,)       ids in the file
    coefficients  (n, 3, m)  of the world coordinates; those beyond the mesh's space are zero
    corners       where the coefficients are vertices of the mesh: which ones
    """

    expansion: Expansion
    element_ids: Ints
    coefficients: Floats
    corners: Corners | None = None

    def __len__(self) -> int:
        return len(self.element_ids)

    def take(self, which: Ints) -> Floats:
        """(k, 3, m) coefficients of the elements ``which`` (k,) of these."""
        return np.asarray(self.coefficients[which])


def geometry(dataset: Dataset) -> tuple[GeometryBlock, ...]:
    """The mapping of every element in the domain, by shape; straight elements apart from curved ones.

    Straight elements come in the lowest-order Modified expansion, curved ones in the Modified expansion their edges and
    faces need.  Elements that the fields of ``GeometryMap`` hold come last, in those fields' expansion.  FormatError,
    naming the element, for a mesh that breaks the rules of the format.
    """
    return kept(dataset, "geometry", lambda: _whole(parts(dataset)))


def mapping(dataset: Dataset) -> tuple[Part, ...]:
    """`geometry`, but without a cache, coefficients that are quickly put together are so on demand."""
    if dataset.mesh in _SHARED:
        return geometry(dataset)
    return tuple(part if isinstance(part, GeometryBlock) else part.at_hand() for part in parts(dataset))


def _whole(found: Iterable[Part]) -> tuple[GeometryBlock, ...]:
    return tuple(part if isinstance(part, GeometryBlock) else part.block() for part in found)


def share(mesh: Mesh) -> None:
    """Cache data derived from a mesh that several datasets share, for the lifetime of the mesh."""
    _SHARED.setdefault(mesh, {})


def is_shared(mesh: Mesh) -> bool:
    """Whether `share` was called for a mesh."""
    return mesh in _SHARED


def kept(dataset: Dataset, key: Hashable, make: Callable[[], T]) -> T:
    """A result that depends only on the mapping of a dataset; it is computed once if the mesh is shared.

    If fields define the mapping, a cached result also requires the identical fields.  The result must not refer to the
    mesh, which would then never be freed.
    """
    known = _known(dataset)
    if known is None:
        return make()
    found: T = known.pop(key) if key in known else make()
    known[key] = found
    while len(known) > _MOST_KEPT:
        del known[next(iter(known))]
    return found


def _known(dataset: Dataset) -> dict[Hashable, Any] | None:
    """The cached results for the mapping of a dataset; None if its mesh is not shared."""
    known = _SHARED.get(dataset.mesh)
    if known is None or not dataset.map_names:
        return known
    maps = dataset.map_fields
    last, of_maps = known.get(_MAPPED, ((), {}))
    if last != maps:
        known[_MAPPED] = maps, (of_maps := {})
    found: dict[Hashable, Any] = of_maps
    return found


def parts(dataset: Dataset) -> tuple[Part, ...]:
    """`geometry`, but coefficients are put together on demand."""
    mapped = tuple(_mapped_parts(dataset))
    ids = dataset.mesh.domain_ids()
    for block in mapped:
        ids = np.setdiff1d(ids, block.element_ids, assume_unique=True)
    if not len(ids):
        return mapped
    skeleton = Skeleton(dataset.mesh)
    shapes = dataset.mesh.elements
    return (*(part for shape in shapes for part in _assemble(skeleton, shape, ids)), *mapped)


def _mapped_parts(dataset: Dataset) -> Iterator[Columns]:
    """The elements whose mapping is given as fields."""
    names = dataset.map_names
    if not names:
        return
    present = {field.name: field.blocks for field in dataset.fields}
    if len(names) > 3 or not present.keys() >= set(names):
        found = f"{', '.join(names)} among {', '.join(present) or 'no fields'}"
        raise FormatError(f"expected up to three fields of the dataset as geometry map, found {found}")
    held = [np.concatenate([block.element_ids for block in present[name]] or [np.empty(0, np.int64)]) for name in names]
    for group in grouped(np.intersect1d(dataset.mesh.domain_ids(), np.concatenate(held)), [present[n] for n in names]):
        yield _columns(names, group)


def _columns(names: tuple[str, ...], group: Group) -> Columns:
    """The coordinates of a group of elements; FormatError if they don't share one expansion."""
    expansion = group.expansions[0]
    if expansion is None or expansion.homogeneous or set(group.expansions) != {expansion}:
        found = f"other expansions for element {group.element_ids[0]}"
        raise FormatError(
            f"expected one expansion, and not a Fourier one, for all of {', '.join(names)}, found {found}"
        )
    columns = [column for column in group.coefficients if column is not None]
    return Columns(expansion, frozen_ints(group.element_ids), columns)


@dataclass(frozen=True, eq=False)
class Columns:
    """The mapping of elements of one expansion, to be put together from fields.

    element_ids  (n,) ids in the file
    columns      (n, m) coefficients of each coordinate that has a field; others are zero
    """

    expansion: Expansion
    element_ids: Ints
    columns: Sequence[Floats]

    def __len__(self) -> int:
        return len(self.element_ids)

    def take(self, which: slice | Ints) -> Floats:
        """(k, 3, m) coefficients of the elements ``which`` (k,) of these."""
        some = [column[which] for column in self.columns]
        coefficients = np.zeros((len(some[0]), 3, mode_count(self.expansion)))
        for coordinate, column in enumerate(some):
            coefficients[:, coordinate] = column
        return coefficients

    def at_hand(self) -> Columns:
        """Itself, as its elements are quickly put together."""
        return self

    def block(self) -> GeometryBlock:
        """All of it."""
        return GeometryBlock(self.expansion, self.element_ids, frozen_floats(self.take(slice(None))))


@dataclass(frozen=True, eq=False)
class Assembly:
    """The mapping of elements of one expansion, to be put together from the vertices, edges and faces of the mesh.

    rows      (n,) of the elements among all of their shape
    vertices  (m, n_vertices) of all elements of the shape
    """

    skeleton: Skeleton
    expansion: Expansion
    rows: Ints
    vertices: Ints

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def element_ids(self) -> Ints:
        """(n,) ids in the file."""
        ids = self.skeleton.mesh.of(self.expansion.shape).ids
        # rows ascend, so as many rows as there are elements are all of them
        return frozen_view(ids if len(self.rows) == len(ids) else ids[self.rows])

    def take(self, which: Ints) -> Floats:
        """(k, 3, m) coefficients of the elements ``which`` (k,) of these."""
        assemble = _straight if self.is_straight else _CURVED[self.expansion.shape.dimension]
        rows = self.rows[which]
        coefficients = np.empty((len(rows), 3, mode_count(self.expansion)))
        for part in chunks(len(rows), _CHUNK):
            coefficients[part] = assemble(self.skeleton, self.expansion, rows[part], self.vertices[rows[part]])
        return coefficients

    def at_hand(self) -> GeometryBlock | Assembly:
        """Itself if its elements are straight and quickly assembled; otherwise the whole block."""
        return self if self.is_straight else self.block()

    def block(self) -> GeometryBlock:
        """All of it."""
        coefficients = frozen_floats(self.take(np.arange(len(self))))
        return GeometryBlock(self.expansion, self.element_ids, coefficients, self._corners())

    def _corners(self) -> Corners | None:
        """The vertices of straight elements; None of curved ones."""
        if not self.is_straight:
            return None
        own = self.vertices if len(self.rows) == len(self.vertices) else self.vertices[self.rows]
        rows = narrow_ints(own, len(self.skeleton.vertices))
        return Corners(self.skeleton.vertices, rows, tuple(_vertex_order(self.expansion)))

    @property
    def is_straight(self) -> bool:
        """Whether the maps are of order 1 in each direction."""
        return max(self.expansion.modes) == 2


def _assemble(skeleton: Skeleton, shape: Shape, wanted: Ints) -> Iterator[Assembly]:
    """The elements of a shape with ids among the sorted ``wanted``, one part for each set of orders."""
    entities, vertices = skeleton.mesh.of(shape), _vertices(skeleton, shape)
    chosen = narrow_ints(np.flatnonzero(np.isin(entities.ids, wanted)), len(entities))
    if len(chosen) and not skeleton.curved:
        yield Assembly(skeleton, modified(shape, (2,) * shape.dimension), chosen, vertices)
    if len(chosen) == 0 or not skeleton.curved:
        return
    orders, which = np.unique(_orders(skeleton, shape, vertices)[chosen], axis=0, return_inverse=True)
    for number, modes in enumerate(orders.tolist()):
        yield Assembly(skeleton, modified(shape, tuple(modes)), chosen[which.reshape(-1) == number], vertices)


def _vertices(skeleton: Skeleton, shape: Shape) -> Ints:
    """`local_vertices`, from the skeleton's faces."""
    if shape.dimension == 2:
        return skeleton.faces[shape]
    return local_vertices(skeleton.mesh, shape, lambda: skeleton.faces)


def _orders(skeleton: Skeleton, shape: Shape, vertices: Ints) -> Ints:
    """(n, d) numbers of modes of the elements of a shape; 2 if they are straight."""
    if shape.dimension == 1:
        return skeleton.edge_orders()
    return skeleton.face_orders(shape) if shape.dimension == 2 else solid_orders(skeleton, shape, vertices)


def _straight(skeleton: Skeleton, expansion: Expansion, rows: Ints, vertices: Ints) -> Floats:
    """Vertices alone."""
    return skeleton.vertices[vertices[:, _vertex_order(expansion)]].transpose(0, 2, 1)


def _vertex_order(expansion: Expansion) -> list[int]:
    """The vertex of each mode of a straight element: the mode is 0 in directions where it lies at -1, and 1 at +1."""
    modes = (expansion.shape.vertices > 0).astype(np.int64)
    return [int(np.flatnonzero((modes == mode).all(axis=1))[0]) for mode in mode_indices(expansion)]


def _segment(skeleton: Skeleton, expansion: Expansion, rows: Ints, vertices: Ints) -> Floats:
    return skeleton.edge_modes(rows, expansion.modes[0])


def _face(skeleton: Skeleton, expansion: Expansion, rows: Ints, vertices: Ints) -> Floats:
    modes = max(expansion.modes)
    p, q = mode_indices(expansion).T
    own: Floats = skeleton.face_modes(expansion.shape, rows, modes)[p * modes + q]
    return own.transpose(1, 2, 0)


_CURVED = {1: _segment, 2: _face, 3: solid_modes}
