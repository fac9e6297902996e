"""A mesh as files hold it, everything named by global ids: what the three geometry codecs agree on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.shapes import Shape
from elvis.formats.nektar.idlist import IdList

#: a composite before its ids are compared with the mesh: id, tokens (tag letter, list), name
RawComposite = tuple[int, tuple[tuple[str, IdList], ...], str | None]


@dataclass(frozen=True, eq=False)
class RawCurves:
    """Curved edges or faces: ids of the entities, PointsType numbers, number of points of each, points (m, 3)."""

    entities: Ints
    kinds: Ints
    counts: Ints
    points: Floats

    @staticmethod
    def none() -> RawCurves:
        """Nothing is curved."""
        empty = np.empty(0, np.int64)
        return RawCurves(empty, empty, empty, np.empty((0, 3)))


@dataclass(frozen=True, eq=False)
class RawGeometry:
    """A mesh, or one piece of a partitioned one.

    tables  by shape: ids (n,) and members (n, k), the ids of vertices, edges or faces in file order
    """

    file: str
    dimension: int
    space: int
    vertex_ids: Ints
    vertices: Floats
    tables: Mapping[Shape, tuple[Ints, Ints]]
    edge_curves: RawCurves = field(default_factory=RawCurves.none)
    face_curves: RawCurves = field(default_factory=RawCurves.none)
    composites: tuple[RawComposite, ...] = ()
    domains: Mapping[int, IdList] = field(default_factory=dict)
