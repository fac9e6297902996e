"""The precision in which a field was written."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.data.dataset import Expansion
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.evaluation import evaluate

#: rounding of coefficients, relative to the largest root mean square on an element: of double and single precision
DOUBLE, SINGLE = 1e-12, 2.5e-7
#: rounding that the jumps of a continuous field may add up to
JUMPS = 10.0
#: share by which a single precision number may be off after a change of basis in double precision
_CHANGED = 1e-13
#: elements whose values at vertices tell the precision
_TOLD_BY = 256


def is_single(patch: Patch) -> bool:
    """Whether the field was written in single precision, by its values at vertices of some elements."""
    expansion, coefficients = patch.fields[0], patch.coefficients[0]
    assert expansion is not None
    assert coefficients is not None
    return are_single(expansion, coefficients)


def are_single(expansion: Expansion, coefficients: Floats) -> bool:
    """Whether coefficients (n, m) were written in single precision, by values at vertices of some elements."""
    values = evaluate(expansion, coefficients[:_TOLD_BY], expansion.shape.vertices)
    # values that are too large for single precision become infinite, and differ
    with np.errstate(over="ignore", invalid="ignore"):
        rounded = values.astype(np.float32).astype(np.float64)
        return bool((np.abs(values - rounded) <= _CHANGED * np.abs(values).max(initial=0.0)).all())
