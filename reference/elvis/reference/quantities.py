"""Quantities of a scene by name, evaluated from the modal expansions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from elvis.formats.arrays import Floats, Ints
from elvis.formats.evaluation import evaluate
from elvis.formats.patch import Patch
from elvis.reference.baseline.mesh import Quantity


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
