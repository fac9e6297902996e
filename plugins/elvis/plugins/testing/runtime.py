"""The test of a runtime plugin: its maps, boxes and values on a device, against each other and against NumPy.

from elvis.plugins.testing import check_volume
with Renderer() as renderer:
    check_volume(MyPlugin([path]).volume("p"), renderer)     raises AssertionError with one line where it is wrong
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elvis.core.base.arrays import Floats, Ints, joined_columns, rows_of
from elvis.core.polynomials.bernstein import bernstein_values
from elvis.plugins.faces import FaceBlock, Faces, faces_of
from elvis.plugins.runtime import volume_checks
from elvis.plugins.runtime.evaluation_service import EvaluationService
from elvis.plugins.runtime.host.evaluation import host_evaluations
from elvis.plugins.runtime.volume import Part, Volume
from elvis.plugins.runtime.volume_checks import Samples, probes

#: reference step of central differences, and how far they may be from derivatives
_STEP, _DIFFERENCE = 1e-4, 1e-5
#: what rounding does to values and places
_ROUNDING = 1e-11
#: status of pixels about which nothing is known
_FAILED = 3
#: number of faces of a block that are checked; tolerances relative to the largest coordinate and to the reference shape
_MANY_FACES, _OFF, _BORDER = 256, 1e-9, 1e-9


def check_volume(
    volume: Volume, service: EvaluationService, name: str = "under test", picture: str | Path | None = None
) -> None:
    """AssertionError, in one line, if the volume breaks a promise.

    Buffers and boxes are valid; derivatives of map and field match their values; elements lie in their boxes; the
    inverse map inverts the map; values and positions match ``Part.evaluate``; faces lie on their elements, and where
    elements meet.  Finally a cut is drawn, in which every pixel must be right.

    picture  a file for that cut, for inspection: .png or .npz
    """
    volume_checks.check_volume(name, volume)
    service.show(volume)
    for number, part in enumerate(volume.parts):
        elements, offsets = probes(part, volume.dimension)
        samples = service.sample_elements(number, elements, offsets)
        volume_checks.check_samples(name, part, elements, samples)
        _check_derivatives(service, number, part, elements, offsets, samples)
        inside = samples.margin > 1e-6
        assert inside.any(), f"{part.type}: expected points with a positive margin near the centre, found none"
        reference = (samples.center + offsets)[inside]
        _check_round_trip(service, part, volume.dimension, elements[inside], reference, samples.position[inside])
        if part.evaluate is not None:
            _check_host_evaluation(part, elements[inside], reference, samples.position[inside], samples.value[inside])
    if getattr(volume, "faces", None) is not None or host_evaluations(volume) is not None:
        _check_faces(volume, faces_of(None, volume), service)
    _check_picture(volume, service, picture)


def _check_derivatives(
    service: EvaluationService, number: int, part: Part, elements: Ints, offsets: Floats, samples: Samples
) -> None:
    """The Jacobian and the gradient are the central differences of positions and values, where that stays inside."""
    inside = samples.margin > 10 * _STEP
    size, steepest = (np.abs(some[inside]).max(initial=1e-300) for some in (samples.jacobian, samples.gradient))
    for axis in range(3):
        step = _STEP * np.eye(3)[axis]
        high, low = (service.sample_elements(number, elements, offsets + sign * step) for sign in (1, -1))
        difference = (high.position - low.position) / (2 * _STEP)
        error = np.abs(difference - samples.jacobian[:, :, axis])[inside].max(initial=0.0)
        assert error <= _DIFFERENCE * size, (
            f"{part.type}: expected d(position)/d(r.{'xyz'[axis]}) to be that of the positions, "
            f"found a difference of {error / size:.3g} of its size"
        )
        difference = (high.value - low.value) / (2 * _STEP)
        error = np.nanmax(np.abs(difference - samples.gradient[:, axis])[inside], initial=0.0)
        assert error <= _DIFFERENCE * max(steepest, 1.0), (
            f"{part.type}: expected the gradient along r.{'xyz'[axis]} to be that of the values, "
            f"found a difference of {error / steepest:.3g} of its size"
        )


def _check_round_trip(
    service: EvaluationService, part: Part, dimension: int, elements: Ints, reference: Floats, positions: Floats
) -> None:
    """Points of elements are found, at their reference points where it is in their own element."""
    axes = np.arange(3) < dimension
    found = service.probe(np.where(axes, positions, 0.0))
    lost = np.flatnonzero(found.element < 0)
    assert not len(lost), f"{part.type}: expected to find a point of element {elements[lost[0]]}, found none"
    own = found.element == part.element_ids[elements]
    error = np.abs(found.reference - reference)[own][:, axes].max(initial=0.0)
    assert error <= 1e-8, f"{part.type}: expected the inverse map to lead back, found it off by {error:.3g}"


def _check_host_evaluation(part: Part, elements: Ints, reference: Floats, positions: Floats, values: Floats) -> None:
    """Check positions and values against NumPy's."""
    assert part.evaluate is not None
    host_positions, host_values = part.evaluate(elements, reference)
    for what, found, wanted in (("positions", positions, host_positions), ("values", values, host_values)):
        assert found.shape == np.shape(wanted), f"{part.type}: expected {found.shape} {what}, found {np.shape(wanted)}"
        error = np.nanmax(np.abs(found - wanted), initial=0.0)
        assert error <= _ROUNDING * np.abs(wanted).max(initial=1e-300), (
            f"{part.type}: expected the {what} that NumPy gives, found them off by {error:.3g}"
        )


def _check_faces(volume: Volume, faces: Faces, service: EvaluationService) -> None:
    """AssertionError, in one line, if faces aren't on the border of their element, or not on its map.

    A face has at most two sides, with their corners at the same positions.
    """
    sides = np.bincount(np.concatenate([block.entity for block in faces.blocks]))
    assert sides.max() <= 2, (
        f"expected a face between two elements at most, found face {sides.argmax()} of {sides.max()}"
    )
    size = max(float(np.abs(part.boxes).max()) for part in volume.parts)
    found = []
    for block in faces.blocks:
        rows = np.unique(np.linspace(0, len(block) - 1, min(len(block), _MANY_FACES)).round().astype(np.int64))
        points = block.space.points
        positions = _check_face_block(volume, block, rows, points, service, size)
        found.append((block.entity[rows], positions.mean(axis=1)))

    # the means of the points of a face's two sides are one place, whichever way round they run
    entity, middles = joined_columns(found)
    order = np.argsort(entity, kind="stable")
    pairs = np.flatnonzero(np.diff(entity[order]) == 0)
    apart = np.abs(middles[order[pairs]] - middles[order[pairs + 1]]).max(axis=1, initial=0.0)
    worst = float(apart.max(initial=0.0))
    assert worst <= _OFF * size, f"expected coincident sides of a face, found distances of {worst:.3g} apart"


def _check_face_block(
    volume: Volume, block: FaceBlock, rows: Ints, points: Floats, service: EvaluationService, size: float
) -> Floats:
    """(n, k, 3) where points (k, 2) of some faces (n,) lie, by the map of their elements."""
    part, frames = volume.parts[block.part], block.frames[block.local[rows]]
    reference = frames[:, None, 0] + np.einsum("pi,nij->npj", points, frames[:, 1:])
    elements = np.repeat(block.element[rows], len(points))
    center = service.sample_elements(block.part, elements[:1], np.zeros((1, 3))).center[0]
    samples = service.sample_elements(block.part, elements, reference.reshape(-1, 3) - center)
    off = float(np.abs(samples.margin).max()) if volume.dimension == 3 else 0.0
    assert off <= _BORDER, f"{part.type}: expected faces on the border of the reference shape, found some {off:.3g} off"
    homogeneous = np.einsum("pk,nkd->npd", bernstein_values(block.space.space, points), block.nets(rows))
    places = homogeneous[..., :3] / homogeneous[..., 3:]
    positions = samples.position.reshape(places.shape)
    off = float(np.abs(places - positions).max())
    assert off <= _OFF * size, f"{part.type}: expected faces where the map has them, found some off by {off:.3g}"
    return positions


def _check_picture(volume: Volume, service: EvaluationService, path: str | Path | None) -> None:
    """A cut through an element shows something, fails nowhere, and has the values that NumPy gives."""
    center = service.sample_elements(0, np.zeros(1, np.int64), np.zeros((1, 3))).position[0]
    x, y, z = center.tolist()
    frame = service.preview((x, y, z if volume.dimension == 3 else 0.0))
    if path is not None:
        frame.save(path)
    failed, seen = (frame.status == _FAILED), frame.element >= 0
    assert seen.any(), f"expected to see elements in a cut through ({x:g}, {y:g}, {z:g}), found none"
    assert not failed.any(), f"expected a result at every pixel of a cut, found {failed.sum()} that failed"
    for part in volume.parts:
        here = seen & np.isin(frame.element, part.element_ids)
        if part.evaluate is not None and here.any() and frame.reference is not None:
            rows = rows_of(part.element_ids, frame.element[here])
            _check_host_evaluation(part, rows, frame.reference[here], frame.position[here], frame.field[here])
