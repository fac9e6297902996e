"""Isosurfaces whose corners lie on the exact ones: what linear isosurfaces are measured against, and what is saved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from elvis.formats.arrays import Floats, Ints
from elvis.formats.dataset import Dataset
from elvis.formats.evaluation import evaluate_at, evaluate_at_with_gradients
from elvis.formats.patch import Patch
from elvis.reference.baseline.drawing import Baseline
from elvis.reference.baseline.mesh import LinearMesh, Quantity, joined
from elvis.reference.baseline.sections import section

#: cuts of each element before its surface is moved to the exact place
FINE = 3
#: steps of Newton's method
_STEPS = 12


def exact_isosurface(
    dataset: Dataset,
    patches: Sequence[Patch],
    quantities: Mapping[str, Quantity],
    field: int,
    value: float,
    level: int = FINE,
) -> LinearMesh:
    """The isosurface of field number ``field`` at a value; every corner on it to rounding where steps settle.

    Corners move along the gradient in reference coordinates: r - (f - value) f' / |f'|^2 (Newton's method on the line
    of steepest ascent); those that don't settle keep their linear place.
    """
    made = Baseline.of(dataset, patches, level, quantities)
    name = list(quantities)[field]
    parts = [section(part, part.values[name] - value) for part in made.parts]
    return joined([_moved(patch, part, field, value) for patch, part in zip(patches, parts, strict=True)])


def _moved(patch: Patch, mesh: LinearMesh, field: int, value: float) -> LinearMesh:
    """The triangles of one patch with their corners on the surface."""
    rows = _rows(patch, mesh)
    start = mesh.reference[:, : patch.shape.dimension]
    reference, residual = _settled(patch, rows, start, field, value)
    far = np.linalg.norm(reference - start, axis=1) > 4.0 / (1 << FINE)
    reference[far | ~np.isfinite(residual)] = start[far | ~np.isfinite(residual)]
    points = evaluate_at(patch.geometry, patch.geometry_coefficients, rows, reference)
    return replace(mesh, points=points, reference=reference)


def _rows(patch: Patch, mesh: LinearMesh) -> Ints:
    """(n,) rows of the elements that the corners of a mesh belong to."""
    order = np.argsort(patch.element_ids)
    row = order[np.searchsorted(patch.element_ids, mesh.element, sorter=order)]
    rows = np.zeros(len(mesh.points), np.int64)
    rows[mesh.simplices] = row[:, None]
    return rows


def _settled(patch: Patch, rows: Ints, start: Floats, field: int, value: float) -> tuple[Floats, Floats]:
    """Reference points (n, d) of field value ``value``, and what is left of f - value."""
    expansion, coefficients = patch.fields[field], patch.coefficients[field]
    assert expansion is not None
    assert coefficients is not None
    reference, residual = start.copy(), np.zeros(len(start))
    for _ in range(_STEPS):
        found, slopes = evaluate_at_with_gradients(expansion, coefficients, rows, reference)
        residual = found - value
        with np.errstate(invalid="ignore", divide="ignore"):
            step = residual[:, None] * slopes / np.einsum("nd,nd->n", slopes, slopes)[:, None]
        reference -= np.where(np.isfinite(step), np.clip(step, -0.25, 0.25), 0.0)
    return reference, residual
