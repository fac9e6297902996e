"""Powers of many numbers at once."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats


def powers_of(t: Floats, count: int | np.int64) -> Floats:
    """(count, n) powers 0 to count - 1 of t (n,), each right to its last digit, which products of them are not."""
    result = np.ones((count, len(t)))
    for k in range(1, len(result)):
        result[k] = t**k
    return result
