"""A comparison: the exact picture, its validation, and the linear pictures of the same scene with their costs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from time import perf_counter
from typing import cast

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.base.memory import free_memory
from elvis.core.base.needing import MissingPackageError
from elvis.core.data.dataset import Dataset
from elvis.core.deformed.isometries import Isometry
from elvis.core.distances.boundaries import ALL, boundaries
from elvis.core.mapping.patch import Patch
from elvis.core.summary.picturing import Kind
from elvis.reference.baseline.deviations import (
    Deviation,
    Sampled,
    border_distances,
    deviation,
    face_points,
    picture_distances,
    triangle_distances,
    why_not,
)
from elvis.reference.baseline.distances import SurfaceDistance, surface_distance
from elvis.reference.baseline.exact import FINE, exact_isosurface
from elvis.reference.baseline.linear_drawing import Baseline, affordable
from elvis.reference.baseline.mesh import LinearMesh, estimate
from elvis.reference.baseline.vtk import VtkBaseline
from elvis.reference.line_study import LineStudy, line_studies
from elvis.reference.metrics import Errors, check_comparable, errors, not_narrow
from elvis.reference.pixel_lines import contour_values
from elvis.reference.quantities import Quantities, names_of
from elvis.reference.record import Record
from elvis.reference.sources import DatasetSource
from elvis.reference.tolerances import Check, check_tolerances
from elvis.scene import CutSurface, Faces, Isosurface, Scene, SceneObject, TriangleMesh, VolumeRendering
from elvis.scene.cameras.view import View
from elvis.scene.record.frame import Frame, Status

#: longest side of the picture that the reference checks, in pixels
VALIDATION_SIZE = 300
#: contours that are compared where the scene draws none
CONTOURS = 10
#: why a picture that shows nothing is not scored
NOTHING_DRAWN = "it draws no object of this scene, so there is no score"
#: why VTK has no picture of copies
NO_COPIES = "its cells are those of the data, without copies"


@dataclass(frozen=True, eq=False)
class Rival:
    """A picture that is compared with the exact one.

    key        short, for file names
    name       name in tables
    level      cuts of each element, None if not applicable
    counts     simplices, points and bytes
    seconds    by name
    surfaces   distances of its isosurfaces, by value
    deviations  distances of its faces and isosurfaces, by name, if open3d is available
    apart      (h, w) distances of the exact picture's points from these
    meshes     source meshes, by file name without suffix, if requested
    skipped    the reason for a missing picture
    """

    key: str
    name: str
    level: int | None = None
    record: Record | None = None
    errors: Errors | None = None
    counts: Mapping[str, int] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    surfaces: Mapping[str, SurfaceDistance | None] = field(default_factory=dict)
    deviations: Mapping[str, Deviation | None] = field(default_factory=dict)
    apart: Floats | None = None
    meshes: Mapping[str, LinearMesh] = field(default_factory=dict)
    skipped: str | None = None


@dataclass(frozen=True, eq=False)
class Validation:
    """A picture checked against the reference, at a size of (width, height) pixels.

    ambiguous  pixels that one of the two calls so: these may differ
    """

    size: tuple[int, int]
    checks: Sequence[Check]
    device: str
    ambiguous: int = 0

    @property
    def passed(self) -> bool:
        """Whether every pixel keeps every tolerance."""
        return all(check.passed for check in self.checks)


@dataclass(frozen=True, eq=False)
class Study:
    """The content of a report.

    scene      completed: with camera and size
    exact      the picture that serves as the reference
    ends       of the colour range
    contours   values of contours whose displacement is measured
    lines      ends of streamlines, for each object that has some
    next       cuts beyond the last ones, and the bytes that they would need
    stored     bytes of the coefficients from which the exact picture is drawn
    """

    exact: Record
    rivals: Sequence[Rival]
    ends: tuple[float, float]
    contours: Sequence[float]
    scene: Scene | None = None
    dataset: Dataset | None = None
    patches: Sequence[Patch] = ()
    validation: Validation | None = None
    device: str = ""
    stored: int = 0
    next: tuple[int, int] | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    remarks: Sequence[str] = ()
    meshes: Mapping[str, LinearMesh] = field(default_factory=dict)
    lines: Sequence[LineStudy] = ()


def compare_records(exact: Record, other: Record, name: str) -> Study:
    """Two records of one picture; raises ElvisError if they can't be compared."""
    check_comparable(exact, other)
    found = errors(exact, other, contours=even_levels(exact.field))
    rival = Rival("other", name, record=other, errors=found)
    validation = Validation(
        (exact.shape[1], exact.shape[0]), check_tolerances(exact, other), name, _ambiguous(exact, other)
    )
    return Study(exact, [rival], found.range, [own.value for own in found.contours], validation=validation)


def even_levels(values: Floats) -> tuple[float, ...]:
    """Values of contours, evenly between smallest and largest of the finite values."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    return tuple(np.linspace(low, high, CONTOURS + 2)[1:-1].tolist()) if not_narrow((low, high)) == (low, high) else ()


def memory_limit() -> int:
    """Half of the memory that is free now, in bytes; 2 GB if the system does not report it."""
    free = free_memory()
    return int(free / 2) if free < float("inf") else 2 << 30


def compare_scene(
    dataset: Dataset,
    scene: Scene,
    levels: Sequence[int] = (0, 1, 2, 3),
    limit: int | None = None,
    draw: Callable[..., Frame] | None = None,
    validation_size: int = VALIDATION_SIZE,
    meshes: bool = False,
) -> Study:
    """The exact picture of a scene compared with the linear ones.

    limit            maximum bytes of a linear mesh during construction and drawing; by default half of the free memory
    draw             the renderer, ``elvis.renderer.render`` by default
    validation_size  longest side of the picture that the reference checks; 0 disables the check
    meshes           whether all meshes are stored
    """
    if Kind.of(dataset) is Kind.LINE:
        raise ElvisError("1D data are drawn as curves: there are no linear pictures to compare with")
    draw, scene = draw or drawing_device(), _comparable(scene)
    start = perf_counter()
    frame = draw(dataset, scene, device=scene.device)
    seconds = {"exact": perf_counter() - start}
    exact, completed = Record.of(frame), complete(frame)
    names = names_of(completed)
    values = _contours(completed, exact, frame.range)
    quantities, allowed = _quantities(dataset, completed, names), memory_limit() if limit is None else limit
    surfaces = exact_surfaces(completed, quantities, allowed)
    sampled = sampled_surfaces(dataset, completed, quantities, surfaces)
    rivals = Rivals(dataset, completed, frame.view, exact, frame.range, values, quantities, surfaces, sampled, meshes)
    fine = max(levels) + 1
    return Study(
        exact,
        [*(rivals.at(level, allowed) for level in levels), *rivals.others()],
        frame.range,
        values,
        completed,
        dataset,
        quantities.patches,
        _validate(dataset, completed, draw, validation_size),
        str(frame.stats.get("device", {}).get("label", "")),
        sum(map(_stored_bytes, quantities.stored)),
        (fine, estimate(quantities.patches, fine, len(names))[2]),
        seconds,
        (*frame.remarks, *_left_out(completed)),
        {f"exact-isosurface-{i}": mesh for i, (_, mesh) in enumerate(surfaces.values())} if meshes else {},
        line_studies(dataset, completed, Quantities(dataset, names), levels, allowed),
    )


def _comparable(scene: Scene) -> Scene:
    """The scene without outputs, and without geometries next to the deformed one, which are not compared."""
    deform = scene.deform and replace(scene.deform, undeformed=None, walls=False)
    return replace(scene, samples=1, outputs=(), stats=None, deform=deform)


def _quantities(dataset: Dataset, scene: Scene, names: Sequence[str]) -> Quantities:
    """Quantities on the elements of a scene: on those of all copies, where it has some."""
    source = DatasetSource(dataset)
    return source.quantities(names) if scene.copies is None else source.copied(names, scene.copies.isometries())


@dataclass(frozen=True, eq=False)
class Rivals:
    """Common data of the linear pictures of a scene."""

    dataset: Dataset
    scene: Scene
    view: View
    exact: Record
    ends: tuple[float, float]
    contours: Sequence[float]
    quantities: Quantities
    surfaces: Mapping[str, tuple[Isosurface, LinearMesh]]
    sampled: Mapping[str, Sampled]
    keeps_meshes: bool = False

    def at(self, level: int, limit: int) -> Rival:
        """The picture of elements cut ``level`` times; skipped where it would exceed the limit."""
        name = f"{level} refinement{'s' * (level != 1)}"
        elements, count = self.quantities.patches, len(self.quantities.names)
        fits, needed = affordable(elements, level, count, limit)
        simplices, points, _ = estimate(elements, level, count)
        counts = {"simplices": simplices, "points": points, "needed": needed}
        if not fits:
            return Rival(f"n{level}", name, level, counts=counts, skipped="more than the memory limit")
        try:
            made = Baseline.of(self.quantities, level)
            record = made.draw(self.scene, self.view, self.ends)
        except MissingPackageError:
            raise
        except ElvisError as error:
            return Rival(f"n{level}", name, level, skipped=str(error))
        if _is_empty(record):
            return Rival(f"n{level}", name, level, counts=made.counts, skipped=NOTHING_DRAWN)
        return Rival(
            f"n{level}",
            name,
            level,
            record,
            errors(self.exact, record, self.ends, self.contours, _pixel(self.view)),
            {**counts, **made.counts},
            dict(made.seconds),
            self._surfaces(made),
            *self._deviations(made),
            self._meshes(made) if self.keeps_meshes else {},
        )

    def _meshes(self, made: Baseline) -> dict[str, LinearMesh]:
        """The volume, and the triangles of every object."""
        found = {f"n{made.level}": made.whole}
        for number, shown in enumerate(self.scene.every_object):
            if not isinstance(shown, VolumeRendering) and not _from_file(shown):
                found[f"n{made.level}-object-{number}"] = made.triangles(shown, self.scene.field)
        return found

    def others(self) -> list[Rival]:
        """The picture as VTK draws it, where VTK is installed and has filters for the scene."""
        name = "VTK's own cells"
        if self.scene.copies is not None:
            return [Rival("vtk", name, skipped=NO_COPIES)]
        try:
            made = VtkBaseline(self.dataset, self.quantities.names)
            record = made.draw(self.scene, self.view, self.ends)
        except MissingPackageError:
            return []
        except ElvisError as error:
            return [Rival("vtk", name, skipped=str(error))]
        if _is_empty(record):
            return [Rival("vtk", name, counts=made.counts, skipped=NOTHING_DRAWN)]
        found = errors(self.exact, record, self.ends, self.contours, _pixel(self.view))
        return [Rival("vtk", name, None, record, found, made.counts, made.seconds, self._surfaces(made))]

    def _surfaces(self, made: Baseline | VtkBaseline) -> dict[str, SurfaceDistance | None]:
        """Distances of each isosurface from the exact one."""
        return {
            name: surface_distance(exact, made.triangles(shown, self.scene.field))
            for name, (shown, exact) in self.surfaces.items()
        }

    def _deviations(self, made: Baseline) -> tuple[dict[str, Deviation | None], Floats | None]:
        """Distances of each surface from the exact points, and of the visible points from all surfaces."""
        meshes = {name: made.triangles(own.shown, self.scene.field) for name, own in self.sampled.items()}
        found = {name: deviation(own, meshes[name]) for name, own in self.sampled.items()}
        return found, picture_distances(self.exact.position, list(meshes.values())) if meshes else None


def _is_empty(record: Record) -> bool:
    """Whether a picture shows nothing, so that there is nothing to score; volumes have colours but no hits."""
    is_hit = bool((record.status != Status.MISS).any())
    has_colors = bool(np.ptp(record.color, axis=(0, 1)).any())
    return not is_hit and not has_colors


def exact_surfaces(scene: Scene, quantities: Quantities, limit: int) -> dict[str, tuple[Isosurface, LinearMesh]]:
    """Each isosurface of a scene at one value, by name, and its exact triangles, as fine as the memory limit allows."""
    elements, count = quantities.patches, len(quantities.names)
    level = max(level for level in range(FINE + 1) if level == 0 or affordable(elements, level, count, limit)[0])
    found = {}
    for shown in scene.objects:
        for value in shown.values if isinstance(shown, Isosurface) else ():
            quantity = (shown.quantity if isinstance(shown, Isosurface) else None) or scene.field
            mesh = exact_isosurface(quantities, quantity, value, level)
            found[f"{quantity} = {value:g}"] = Isosurface((value,), quantity), mesh
    return found


def sampled_surfaces(
    dataset: Dataset, scene: Scene, quantities: Quantities, surfaces: Mapping[str, tuple[Isosurface, LinearMesh]]
) -> dict[str, Sampled]:
    """The faces and isosurfaces of a scene in space by name; none if open3d is not there."""
    if dataset.mesh.dimension < 3 or why_not():
        return {}
    found = {
        name: Sampled(shown, mesh.points, partial(triangle_distances, mesh=mesh) if len(mesh) else None)
        for name, (shown, mesh) in surfaces.items()
    }
    known = (ALL, *boundaries(dataset.mesh))
    isometries = [Isometry()] if scene.copies is None else scene.copies.isometries()
    for shown in scene.every_object:
        if isinstance(shown, Faces):
            is_border = len(shown.select) == 1 and shown.select[0] in known
            back = border_distances(dataset, shown.select[0], isometries) if is_border else None
            own = face_points(dataset, quantities.stored, shown.select)
            points = np.concatenate([isometry.points(own) for isometry in isometries])
            found[f"faces {', '.join(shown.select)}"] = Sampled(shown, points, back)
    return found


def _left_out(scene: Scene) -> list[str]:
    """A message if distances of surfaces are missing."""
    has_some = any(isinstance(shown, Faces | Isosurface) for shown in scene.every_object)
    reason = why_not() if has_some else ""
    return [reason] if reason else []


def _from_file(shown: SceneObject) -> bool:
    """Whether an object is cut by triangles from a file."""
    return isinstance(shown, CutSurface) and isinstance(shown.surface, TriangleMesh)


def drawing_device() -> Callable[..., Frame]:
    """The default drawing function; the reference itself imports no renderer."""
    from elvis.plugins.command.registry import load

    return cast(Callable[..., Frame], load("elvis.devices", "auto"))


def complete(frame: Frame) -> Scene:
    """The scene with the camera, size and field that the frame was drawn with."""
    return replace(frame.scene, camera=frame.view.camera, size=(frame.view.width, frame.view.height))


def _validate(dataset: Dataset, scene: Scene, draw: Callable[..., Frame], longest: int) -> Validation | None:
    """Check the same picture, smaller, against the reference; None if the reference drew it itself."""
    if not longest or scene.device == "reference" or scene.size is None:
        return None
    width, height = scene.size
    part = min(1.0, longest / max(width, height))
    size = (max(1, round(width * part)), max(1, round(height * part)))
    small = replace(scene, size=size, samples=1)
    frame, true = draw(dataset, small, device=scene.device), draw(dataset, small, device="reference")
    exact, other = Record.of(true), Record.of(frame)
    label = str(frame.stats.get("device", {}).get("label", ""))
    return Validation(size, check_tolerances(exact, other), label, _ambiguous(exact, other))


def _ambiguous(exact: Record, other: Record) -> int:
    """Pixels that either record calls ambiguous."""
    return int(((exact.status == Status.AMBIGUOUS) | (other.status == Status.AMBIGUOUS)).sum())


def _contours(scene: Scene, exact: Record, ends: tuple[float, float]) -> tuple[float, ...]:
    """The values of the scene's contours, or else some spread over the visible values."""
    styles = [shown.style for shown in scene.every_object if hasattr(shown, "style")]
    drawn = sorted({value for style in styles for value in contour_values(style, ends)})
    return tuple(drawn) or even_levels(exact.field)


def _pixel(view: View) -> float | None:
    """The size of a pixel in world units, where it is the same at all depths."""
    return None if view.perspective else float(np.linalg.norm(view.column))


def _stored_bytes(patch: Patch) -> int:
    """Bytes of a patch's coefficients."""
    return patch.geometry_coefficients.nbytes + sum(own.nbytes for own in patch.coefficients if own is not None)
