"""Isosurfaces whose corners lie on the exact ones, as the reference for linear isosurfaces and for saving."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Ints
from elvis.core.mapping.patch import Patch
from elvis.core.mapping.pointwise import positions
from elvis.reference.baseline.linear_drawing import Baseline
from elvis.reference.baseline.mesh import LinearMesh, concatenate
from elvis.reference.baseline.sections import section
from elvis.reference.quantities import Quantities

#: cuts of each element before its surface is moved to the exact place
FINE = 3
#: steps of Newton's method
_STEPS = 12


def exact_isosurface(quantities: Quantities, name: str, value: float, level: int = FINE) -> LinearMesh:
    """The isosurface of a quantity at a value; every corner is on it up to rounding if steps converge.

    Corners move along the gradient in reference coordinates: r - (f - value) f' / |f'|^2 (Newton's method on the line
    of steepest ascent); corners that don't converge keep their linear place.
    """
    made = Baseline.of(quantities, level)
    parts = [section(part, part.values[name] - value) for part in made.parts]
    pairs = zip(quantities.patches, parts, strict=True)
    return concatenate([_corners_on_surface(quantities, name, patch, part, value) for patch, part in pairs])


def _corners_on_surface(quantities: Quantities, name: str, patch: Patch, mesh: LinearMesh, value: float) -> LinearMesh:
    """The triangles of one patch with their corners on the surface."""
    rows = _rows(patch, mesh)
    start = mesh.reference[:, : patch.dimension]
    reference = start.copy()
    for _ in range(_STEPS):
        found, gradients = quantities.values_and_gradients(name, patch, rows, reference)
        with np.errstate(invalid="ignore", divide="ignore"):
            step = (found - value)[:, None] * gradients / np.einsum("nd,nd->n", gradients, gradients)[:, None]
        reference -= np.where(np.isfinite(step), np.clip(step, -0.25, 0.25), 0.0)
    far = np.linalg.norm(reference - start, axis=1) > 4.0 / (1 << FINE)
    reference[far] = start[far]
    points = positions(patch, rows, reference)
    return replace(mesh, points=points, reference=reference)


def _rows(patch: Patch, mesh: LinearMesh) -> Ints:
    """(n,) rows of the elements that the corners of a mesh belong to."""
    order = np.argsort(patch.element_ids)
    row = order[np.searchsorted(patch.element_ids, mesh.element, sorter=order)]
    rows = np.zeros(len(mesh.points), np.int64)
    rows[mesh.simplices] = row[:, None]
    return rows
