"""Quantities of a scene by name, evaluated from the modal expansions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from elvis.formats.arrays import Floats, Ints
from elvis.formats.evaluation import evaluate
from elvis.formats.patch import Patch
from elvis.reference.baseline.mesh import Quantity
from elvis.renderer.scene import Isosurface, Scene, VolumeRendering


def names_of(scene: Scene) -> tuple[str, ...]:
    """The names of all quantities that a scene needs, its field first."""
    names = [scene.field]
    for shown in scene.every_object:
        if isinstance(shown, (Isosurface, VolumeRendering)):
            names.append(shown.quantity or scene.field)
        if not isinstance(shown, VolumeRendering):
            style = shown.style
            names.append(style.quantity or scene.field)
            names.append((style.contours.quantity if style.contours else None) or scene.field)
    return tuple(dict.fromkeys(names))


def at_corners(names: Sequence[str]) -> Mapping[str, Quantity]:
    """The fields of patches that carry ``names`` in this order."""
    return {name: _field(number) for number, name in enumerate(names)}


def _field(number: int) -> Quantity:
    def values(patch: Patch, rows: Ints, points: Floats) -> Floats:
        expansion, coefficients = patch.fields[number], patch.coefficients[number]
        if expansion is None or coefficients is None:
            return np.full((len(rows), len(points)), np.nan)
        return evaluate(expansion, coefficients[rows], points)

    return values
