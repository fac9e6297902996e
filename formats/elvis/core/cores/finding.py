"""All vortex cores of a dataset as arcs within its elements, and which of them are one line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.terminal import Progress
from elvis.core.cores.joining import Course, WorldArc, distinct_arcs, joined
from elvis.core.cores.parallel import ParallelVectors
from elvis.core.cores.search import CoreSearch
from elvis.core.cores.tracing import CoreTracing
from elvis.core.critical.points import size
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import NON_CONFORMING
from elvis.core.distances.boundaries import joined_sides, sides_of
from elvis.core.mapping.orientation import chunks, local_vertices
from elvis.core.mapping.patch import Patch
from elvis.core.quantities.expression import Expression
from elvis.core.streamlines.course import SPACING, components_of, positive

#: elements at once
_CHUNK = 64


@dataclass(frozen=True)
class CoreLimits:
    """Criteria for cores: settings of `vortex_cores`."""

    criterion: str = "acceleration"
    min_swirl: float = 0.0
    only_q: bool = False
    min_length: float = 0.0
    spacing: float | None = None

    def check(self) -> None:
        """Raise ElvisError for negative limits, and a spacing that is not positive."""
        for name, limit in (("minimum swirl", self.min_swirl), ("minimum length", self.min_length)):
            if not limit >= 0:
                raise ElvisError(f"{name}: expected a number that is not negative, found {limit}")
        positive("spacing", self.spacing)


#: stands among vertices for all sides that don't match
ANY_INTERFACE = -1


@dataclass(frozen=True, eq=False)
class CoreArcs:
    """Cores as arcs within elements.

    parallel   the velocity and the vector it is parallel to
    vertices   of the mesh, (n, k) for the elements of each of its patches
    interfaces  (n,) which of these elements have sides that don't match
    undecided  ids of elements that may contain further cores
    near_rest  ids of elements where this is the case only within 1/64 of a place at rest
    """

    parallel: ParallelVectors
    arcs: Sequence[WorldArc]
    vertices: Sequence[Ints]
    interfaces: Sequence[Bools]
    undecided: tuple[int, ...]
    near_rest: tuple[int, ...]

    def courses(self) -> Iterator[Course]:
        """The lines that they are parts of."""
        return joined(self.arcs, [self._touched(own.patch, own.arc.row) for own in self.arcs])

    def _touched(self, patch: int, row: int) -> Ints:
        """The vertices of an element, and ANY_INTERFACE where it may touch others without a common vertex."""
        vertices = self.vertices[patch][row]
        return np.append(vertices, ANY_INTERFACE) if self.interfaces[patch][row] else vertices


def core_arcs(
    dataset: Dataset,
    velocity: Sequence[str] | str | None,
    limits: CoreLimits,
    others: Sequence[Expression] = (),
    progress: Progress | None = None,
) -> CoreArcs:
    """All arcs of cores, each once; raises errors as `vortex_cores`.  ``others`` are evaluated on them later."""
    limits.check()
    parallel = ParallelVectors(dataset, components_of(velocity), limits.criterion, others)
    patches = parallel.evaluator.patches
    apart = SPACING * size(patches) if limits.spacing is None else float(limits.spacing)
    arcs: list[WorldArc] = []
    undecided: list[int] = []
    near_rest: list[int] = []
    done, planned = 0, sum(map(len, patches))
    for number, patch in enumerate(patches):
        search = CoreSearch(parallel, patch, limits.min_swirl, limits.only_q)
        for rows in chunks(len(patch), _CHUNK):
            own = np.arange(len(patch))[rows]
            search.run(own)
            done += len(own)
            if progress is not None:
                progress(done, planned)
        tracing = CoreTracing(search, apart)
        found = tracing.run(*search.points())
        arcs += [WorldArc.of(patch, number, arc) for arc in found]
        undecided += patch.element_ids[sorted(search.undecided | tracing.failed)].tolist()
        near_rest += patch.element_ids[sorted(search.near_rest - search.undecided)].tolist()
    tables, interfaces = _surroundings(dataset, patches)
    return CoreArcs(
        parallel, distinct_arcs(arcs), tables, interfaces, tuple(sorted(undecided)), tuple(sorted(near_rest))
    )


def _surroundings(dataset: Dataset, patches: Sequence[Patch]) -> tuple[list[Ints], list[Bools]]:
    """The mesh's vertices (n, k) of the elements of each patch, and which (n,) have sides that don't match."""
    tables, interfaces = list[Ints](), list[Bools]()
    hanging = joined_sides(dataset.mesh).get(NON_CONFORMING, np.empty(0, np.int64))
    for patch in patches:
        in_mesh = dataset.mesh.of(patch.shape).rows_of(patch.element_ids)
        tables.append(local_vertices(dataset.mesh, patch.shape)[in_mesh])
        members = sides_of(dataset.mesh, patch.shape, patch.element_ids)
        interfaces.append(np.isin(members, hanging).any(axis=1))
    return tables, interfaces
