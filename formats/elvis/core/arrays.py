"""Names for the arrays of the project.

Axis convention, everywhere: points are ``(n, d)``, values ``(n,)``, modes ``(n, m)``; the last axis is contiguous.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Bools: TypeAlias = NDArray[np.bool_]


def frozen_floats(values: object) -> Floats:
    """``values`` as a read-only, C-contiguous float64 array; no copy where none is needed."""
    array = np.ascontiguousarray(values, dtype=np.float64).view()
    array.flags.writeable = False
    return array


def frozen_ints(values: object) -> Ints:
    """``values`` as a read-only, C-contiguous int64 array; no copy where none is needed."""
    array = np.ascontiguousarray(values, dtype=np.int64).view()
    array.flags.writeable = False
    return array
