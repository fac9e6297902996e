"""Pictures of linear meshes: the scene's objects as triangles, traced by Embree from the exact picture's camera."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.mapping.patch import Patch
from elvis.reference.baseline.linear_volumes import volume_fragments
from elvis.reference.baseline.mesh import LinearMesh, concatenate, estimate, linear_meshes
from elvis.reference.baseline.probing import Probe
from elvis.reference.baseline.sections import boundary, section
from elvis.reference.baseline.tracing import Tracer
from elvis.reference.clipping import is_clipped
from elvis.reference.composing import Fragments, SurfaceHits, colored, is_lit, record
from elvis.reference.hits import Hits
from elvis.reference.pixel_lines import lines
from elvis.reference.quantities import Quantities
from elvis.reference.record import Record
from elvis.reference.selection import on_faces
from elvis.reference.solids import cells_of
from elvis.reference.surfaces import levels, triangles
from elvis.scene import (
    CutSurface,
    Faces,
    Implicit,
    Isosurface,
    Scene,
    SceneObject,
    Style,
    Surface,
    TriangleMesh,
    VolumeRendering,
)
from elvis.scene.cameras.view import View
from elvis.scene.model.time_limit import check_time

#: surfaces of one object that a ray is followed through
_DEEPEST = 16
#: hits that are stored at the same time, about: 0.4 GB with what is computed from them
_HITS_AT_ONCE = 1 << 19
#: rows around a strip: lines are found by differences between neighbouring rows
_MARGIN = 1


@dataclass(eq=False)
class Baseline:
    """A dataset cut into simplices, and what that costs.

    parts       the mesh of each patch
    quantities  at the corners
    seconds     for making and drawing, by name
    """

    quantities: Quantities
    level: int
    parts: Sequence[LinearMesh]
    seconds: dict[str, float] = field(default_factory=dict)

    @staticmethod
    def of(quantities: Quantities, level: int) -> Baseline:
        """All elements, each cut ``level`` times, with the quantities at the corners."""
        start = perf_counter()
        parts = linear_meshes(quantities.patches, level, quantities.corners())
        made = Baseline(quantities, level, parts)
        made.seconds["mesh"] = perf_counter() - start
        return made

    @property
    def patches(self) -> Sequence[Patch]:
        """The elements that are cut."""
        return self.quantities.patches

    @property
    def flat(self) -> bool:
        """Whether the elements have two dimensions: they are their own picture."""
        return all(patch.dimension == 2 for patch in self.patches)

    @property
    def whole(self) -> LinearMesh:
        """All parts as one mesh."""
        return concatenate(self.parts)

    @property
    def counts(self) -> dict[str, int]:
        """Simplices, points and bytes."""
        return {
            "simplices": sum(map(len, self.parts)),
            "points": sum(len(part.points) for part in self.parts),
            "bytes": sum(part.bytes for part in self.parts),
        }

    def triangles(self, shown: SceneObject, field: str) -> LinearMesh:
        """An object of a scene as triangles; raises ElvisError for what linear meshes are not drawn of here.

        field  the scene's field, for isosurfaces that don't name their quantity
        """
        match shown:
            case CutSurface() if self.flat:
                cuts = list(self.parts)
            case CutSurface(surface=TriangleMesh()):
                raise ElvisError("triangles from a file do not change: linear meshes are only evaluated on them")
            case CutSurface(surface=Implicit(expression=expression)):
                cuts = [section(part, part.values[expression]) for part in self._solid()]
            case CutSurface(surface=surface):
                cuts = [section(part, _levels(surface, part.points)) for part in self._solid()]
            case Isosurface(values=values, quantity=quantity):
                cuts = [section(part, part.values[quantity or field] - v) for v in values for part in self._solid()]
            case Faces(select=select):
                cuts = [self._faces(number, select) for number in range(len(self.parts))]
            case _:
                raise ElvisError(f"the linear baseline draws no {type(shown).__name__}")
        return concatenate(cuts)

    def _solid(self) -> Sequence[LinearMesh]:
        """The parts, if they have volume."""
        if self.flat:
            raise ElvisError("isosurfaces need volumes, found elements of two dimensions")
        return self.parts

    def _faces(self, number: int, select: Sequence[str]) -> LinearMesh:
        """The selected faces of a patch."""
        patch, part = self.patches[number], self.parts[number]
        chosen = self.quantities.selected_faces(number, select)
        if patch.dimension == 2:
            return part.part(np.isin(part.element, patch.element_ids[chosen[:, 0]]))
        on = on_faces(patch, cells_of(patch, self.level).points)
        return boundary(part, (chosen[:, None, :] & on).reshape(-1, on.shape[1]))

    def draw(self, scene: Scene, view: View, ends: tuple[float, float]) -> Record:
        """The picture of a scene with the camera and size of ``view``; ``ends`` is the colour range."""
        return Record.of_strips(self.strips(scene, view, ends))

    def strips(self, scene: Scene, view: View, ends: tuple[float, float]) -> Iterator[Record]:
        """The records of some rows of a picture each, from the top: memory does not grow with the picture."""
        start = perf_counter()
        tracers = list[tuple[SceneObject, Tracer | Probe]]()
        for shown in scene.every_object:
            check_time()
            if not isinstance(shown, VolumeRendering):
                tracers.append((shown, self._tracer(shown, scene.field)))
        self.seconds["cut"] = perf_counter() - start

        rows = max(_MARGIN, _HITS_AT_ONCE // (view.width * self._hits_of_a_pixel(scene)))
        for first in range(0, view.height, rows):
            last = min(first + rows, view.height)
            strip = self._strip(scene, tracers, view.rows(first - _MARGIN, last + _MARGIN), ends)
            above = min(_MARGIN, first)
            yield strip.rows(above, above + last - first)
        self.seconds["draw"] = perf_counter() - start - self.seconds["cut"]

    def _hits_of_a_pixel(self, scene: Scene) -> int:
        """Hits of a ray that are stored at the same time, about."""
        across = round(3 * sum(map(len, self.parts)) ** (1 / 3))
        counts = [
            across if isinstance(shown, VolumeRendering) else _surfaces_of_a_ray(shown.style)
            for shown in scene.every_object
        ]
        return max(1, sum(counts))

    def _strip(
        self, scene: Scene, tracers: Sequence[tuple[SceneObject, Tracer | Probe]], view: View, ends: tuple[float, float]
    ) -> Record:
        """The record of a window of the picture."""
        surfaces = list[SurfaceHits]()
        for shown, tracer in tracers:
            check_time()
            surfaces += surfaces_of(tracer, shown, scene, view, ends)
        depths = [own.hits.depth for own in surfaces]
        picture = record(surfaces, scene, view, ends, self._volume_fragments(scene, view, depths, ends))
        return replace(picture, element=self.quantities.data_ids(picture.element))

    def _tracer(self, shown: SceneObject, field: str) -> Tracer | Probe:
        """An object, ready for rays."""
        if isinstance(shown, CutSurface) and isinstance(shown.surface, TriangleMesh) and not self.flat:
            return Probe(self.whole, triangles(shown.surface.file))
        return Tracer(self.triangles(shown, field))

    def _volume_fragments(
        self, scene: Scene, view: View, cuts: Sequence[Floats], ends: tuple[float, float]
    ) -> list[Fragments]:
        """The fragments of volumes between the depths (n,) of surfaces."""
        media = []
        for shown in scene.every_object:
            if isinstance(shown, VolumeRendering):
                name = shown.quantity or scene.field
                media.append((name, colored(shown.transfer, scene, ends if name == scene.field else None)))
        fragments: list[Fragments] = []
        for part in self._solid() if media else ():
            check_time()
            fragments += volume_fragments(part, media, scene.clip, view, cuts)
        return fragments


def affordable(patches: Sequence[Patch], level: int, quantities: int, limit: int) -> tuple[bool, int]:
    """Whether a linear mesh stays within ``limit`` bytes while it is made and drawn, and the bytes it would take."""
    bytes = estimate(patches, level, quantities)[2]
    return bytes <= limit, bytes


def _surfaces_of_a_ray(style: Style) -> int:
    """Surfaces of one object that a ray is followed through, at most."""
    return 1 if style.opacity == 1.0 else _DEEPEST


def _levels(surface: Surface, points: Floats) -> Floats:
    """The surface's function at the corners; values next to rounding are zero."""
    found = levels(surface, points)
    return np.where(np.abs(found) < 1e-14 * np.abs(points).max(initial=0.0), 0.0, found)


def surfaces_of(
    tracer: Tracer | Probe, shown: SceneObject, scene: Scene, view: View, ends: tuple[float, float]
) -> list[SurfaceHits]:
    """The surfaces of an object along rays: the first one, and surfaces behind it if it is transparent."""
    style: Style = shown.style  # type: ignore[union-attr]
    beyond, surfaces = None, []
    for _ in range(_surfaces_of_a_ray(style)):
        hits = _nearest_kept(tracer, view, beyond, scene)
        if not hits.seen.any():
            break
        quantity = style.quantity or scene.field
        drawn = lines(hits, style, quantity, view, ends)
        surfaces.append(SurfaceHits(hits, style, quantity, is_lit(style, not isinstance(shown, CutSurface)), drawn))
        beyond = hits.depth
    return surfaces


def _nearest_kept(tracer: Tracer | Probe, view: View, beyond: Floats | None, scene: Scene) -> Hits:
    """The nearest hits beyond some depths that no clip takes away."""
    kept = tracer.first(view, beyond)
    size = tracer.mesh.size
    for _ in range(_DEEPEST if scene.clip else 0):
        gone = is_clipped(scene.clip, kept.position, kept.values.__getitem__, size)
        if not gone.any():
            break
        further = tracer.first(view, np.where(gone, kept.depth, np.inf))
        kept.put(gone, further, gone)
    return kept
