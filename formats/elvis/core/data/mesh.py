"""The mesh in memory: arrays by kind of entity, no object per element."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from elvis.core.base.arrays import (
    Floats,
    Ints,
    corners_of,
    distinct,
    frozen_floats,
    frozen_ints,
    frozen_view,
    index_type,
    rows_of,
)
from elvis.core.base.texts import check_name
from elvis.core.data import describing
from elvis.core.shapes import Shape


@dataclass(frozen=True, eq=False)
class Entities:
    """Edges, faces or elements of one shape.

    ids      (n,)    as in the file, in file order
    members  (n, k)  rows (not ids) of the bounding entities of one dimension less, in file order:
                     vertices of an edge, edges of a face, faces of a volume element; 32-bit if enough.
                     Face rows count the triangles first, then the quadrilaterals.
    """

    ids: Ints
    members: Ints

    def __len__(self) -> int:
        return len(self.ids)

    def rows_of(self, ids: Ints) -> Ints:
        """(n,) rows of entities with these ids (n,), all of which must exist."""
        return rows_of(self.ids, ids)

    @staticmethod
    def none(members: int) -> Entities:
        """No entities, of ``members`` members each."""
        return Entities(frozen_ints(np.empty(0)), frozen_view(np.empty((0, members), np.int32)))


@dataclass(frozen=True, eq=False)
class Curves:
    """Curved edges or faces.

    rows     (n,)    row of the curved edge, or of the curved face (triangles first, then quadrilaterals)
    kinds    (n,)    PointsType number of the nodes (format notes 1.8)
    offsets  (n+1,)  curve j owns points[offsets[j]:offsets[j+1]]
    points   (m, 3)  world coordinates, in the order of format notes 1.5
    """

    rows: Ints
    kinds: Ints
    offsets: Ints
    points: Floats

    def __len__(self) -> int:
        return len(self.rows)

    @staticmethod
    def none() -> Curves:
        """No curves."""
        empty = frozen_ints(np.empty(0))
        return Curves(empty, empty, frozen_ints([0]), frozen_floats(np.empty((0, 3))))


@dataclass(frozen=True, eq=False, slots=True)
class Composite:
    """A named set of entities; ``parts`` pairs a tag letter (V E S F T Q A P R H) with ids, in file order.

    label  name from a comment in the file, for a composite without a name; not unique
    """

    id: int
    parts: tuple[tuple[str, Ints], ...]
    name: str | None = None
    label: str | None = None

    def __post_init__(self) -> None:
        for text in (self.name, self.label):
            if text is not None:
                check_name(text, f"composite {self.id}")


#: bounding entities of an element: vertices of a segment, edges of a 2D element, faces of a 3D element
MEMBERS: Mapping[Shape, int] = {
    Shape.SEGMENT: 2,
    Shape.TRIANGLE: 3,
    Shape.QUADRILATERAL: 4,
    Shape.TETRAHEDRON: 4,
    Shape.PYRAMID: 5,
    Shape.PRISM: 5,
    Shape.HEXAHEDRON: 6,
}


#: name of the composite of sides that lie on sides of other elements, though no other element shares them
NON_CONFORMING = "(non-conforming)"
#: name of the composite of sides that a periodic mesh identifies
PERIODIC = "(periodic)"


@dataclass(frozen=True)
class Counts:
    """Sizes of a mesh.

    vertices    number of vertices
    entities    numbers by shape
    curves      for edges and for faces, the number that are curved, and the total of their points
    composites  for each composite, the number of entities in its parts
    """

    vertices: int
    entities: Mapping[Shape, int]
    curves: tuple[tuple[int, int], tuple[int, int]]
    composites: tuple[tuple[int, ...], ...]

    @property
    def total(self) -> int:
        """Vertices and entities together: more than any number of one of them."""
        return self.vertices + sum(self.entities.values())

    @property
    def bytes(self) -> int:
        """Memory for the arrays of a mesh of this size, in bytes: members are rows, other numbers have eight bytes."""
        numbers = 4 * self.vertices + sum(map(sum, self.composites)) + sum(self.entities.values())
        numbers += sum(3 * count + 1 + 3 * points for count, points in self.curves)
        members = sum(MEMBERS[shape] * count for shape, count in self.entities.items())
        of_row: int = np.dtype(index_type(self.total)).itemsize
        return 8 * numbers + of_row * members


@dataclass(frozen=True, eq=False)
class Excerpt:
    """Facts about the whole that a mesh must know if it is a part (`elvis.core.portions`).

    counts  of the whole
    sides   (n,) rows of faces (triangles first) or, in 2D meshes, of edges with elements of the whole on the other
            side; 32-bit if enough
    """

    counts: Counts
    sides: Ints


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices, edges, faces, elements, curves, composites and the domain.

    dimension   of the elements (DIM), 1 to 3
    space       of the coordinates (SPACE), dimension to 3; points always carry three coordinates
    vertex_ids  (n,)    ids, in file order
    vertices    (n, 3)  world coordinates, any scaling of the file applied
    entities    by shape; in 1D the elements are the segments, in 2D the elements are the triangles and
                quadrilaterals, in 3D segments are edges and triangles and quadrilaterals are faces
    domains     domain id -> composite ids
    excerpt     data of a mesh that is a part of another
    """

    dimension: int
    space: int
    vertex_ids: Ints
    vertices: Floats
    entities: Mapping[Shape, Entities]
    edge_curves: Curves = field(default_factory=Curves.none)
    face_curves: Curves = field(default_factory=Curves.none)
    composites: tuple[Composite, ...] = ()
    domains: Mapping[int, tuple[int, ...]] = field(default_factory=dict)
    excerpt: Excerpt | None = None

    def of(self, shape: Shape) -> Entities:
        """The entities of one shape, possibly none."""
        return self.entities.get(shape, Entities.none(MEMBERS[shape]))

    @property
    def counts(self) -> Counts:
        """Counts of the mesh, or of the whole if this is a part."""
        if self.excerpt is not None:
            return self.excerpt.counts
        entities = {shape: len(own) for shape, own in self.entities.items()}
        edges, faces = ((len(curves), len(curves.points)) for curves in (self.edge_curves, self.face_curves))
        composites = tuple(tuple(len(ids) for _, ids in composite.parts) for composite in self.composites)
        return Counts(len(self.vertices), entities, (edges, faces), composites)

    @property
    def count(self) -> int:
        """Number of elements, in the whole if this is a part."""
        entities = self.counts.entities
        return sum(entities.get(shape, 0) for shape in Shape.of_dimension(self.dimension))

    @property
    def corners(self) -> Floats:
        """(2, 3) smallest and largest coordinates of vertices and of points of curves."""
        return corners_of(self.vertices, self.edge_curves.points, self.face_curves.points)

    @property
    def elements(self) -> dict[Shape, Entities]:
        """The elements (entities of the top dimension) by shape, in the order of the format; no empty shapes."""
        return {s: self.of(s) for s in Shape.of_dimension(self.dimension) if len(self.of(s))}

    def composite(self, id: int) -> Composite | None:
        """The composite with this id, or None."""
        return next((c for c in self.composites if c.id == id), None)

    def named_parts(self) -> dict[str, tuple[tuple[str, Ints], ...]]:
        """The parts of composites by every valid name: names and ids, then labels that equal neither.

        Composites with the same name, or with the same label, are merged.
        """
        found: dict[str, tuple[tuple[str, Ints], ...]] = {}
        for composite in self.composites:
            for word in dict.fromkeys((composite.name, str(composite.id))):
                if word:
                    found[word] = (*found.get(word, ()), *composite.parts)
        labelled: dict[str, tuple[tuple[str, Ints], ...]] = {}
        for composite in self.composites:
            if composite.label and composite.label not in found:
                labelled[composite.label] = (*labelled.get(composite.label, ()), *composite.parts)
        return {**found, **labelled}

    def __repr__(self) -> str:
        return describing.line_of_mesh(self)

    def domain_composites(self) -> list[Composite]:
        """The composites that form the domain."""
        known = {composite.id: composite for composite in self.composites}
        return [known[c] for composites in self.domains.values() for c in composites if c in known]

    def domain_ids(self) -> Ints:
        """(n,) sorted ids of the elements in the domain; all elements if the mesh has no domain."""
        everything = [entities.ids for entities in self.elements.values()]
        present = distinct(np.concatenate(everything)) if everything else np.empty(0, np.int64)
        if not self.domains:
            return frozen_ints(present)

        # composites of the domain hold elements under their shape's tag; T and Q, A to H, S or E in 1D
        tags = {s.tag for s in Shape.of_dimension(self.dimension)} | ({"E"} if self.dimension == 1 else set())
        tags |= {"F"} if self.dimension == 2 else set()
        wanted = {c for composites in self.domains.values() for c in composites}
        parts = [ids for c in self.composites if c.id in wanted for tag, ids in c.parts if tag in tags]
        chosen = distinct(np.concatenate(parts)) if parts else np.empty(0, np.int64)
        if np.array_equal(chosen, present):
            return frozen_ints(present)
        return frozen_ints(np.intersect1d(chosen, present, assume_unique=True))
